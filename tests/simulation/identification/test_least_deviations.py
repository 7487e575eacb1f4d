"""What no method can tell: Cramér and Rao's bound of two damped modes near each other."""

from __future__ import annotations

import math

import numpy as np
import pytest


def ring(parameters: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Two decays of frequency [Hz], damping ratio, amplitude and phase each."""
    total = np.zeros_like(time)
    for frequency, damping, amplitude, phase in parameters.reshape(2, 4):
        omega = 2 * math.pi * frequency
        turned = omega * math.sqrt(1 - damping**2) * time + phase
        total += amplitude * np.exp(-damping * omega * time) * np.cos(turned)
    return total


@pytest.mark.parametrize(("noise", "percent"), [(0.1, 29), (0.01, 3)])
def test_two_strongly_damped_modes_are_open_by_what_the_readme_says(
    noise: float, percent: int
) -> None:
    """The inverse of Fisher's information, for white noise as a share of the largest swing."""
    time = np.arange(0, 8, 1 / 50)
    truth = np.array([1.0, 0.3, 1.0, 0.3, 1.3, 0.3, 1.0, 1.0])
    step = 1e-6
    jacobian = np.stack(
        [
            (ring(truth + change, time) - ring(truth - change, time)) / (2 * step)
            for change in step * np.eye(8)
        ],
        axis=1,
    )
    deviation = noise * np.abs(ring(truth, time)).max()
    least = deviation * np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    assert round(100 * least[0] / truth[0]) == percent
    assert least[4] / truth[4] == pytest.approx(least[0], rel=0.05)
