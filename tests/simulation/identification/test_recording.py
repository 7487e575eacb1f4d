"""What spoils a recording: limits of sensors, with noise too, and values that are repeated."""

from __future__ import annotations

import math

import numpy as np
import pytest

from armdesign.errors import SimulationError
from armdesign.simulation.identification.recording import Recording, recording_of

TIME = np.arange(0, 6, 0.01)
OMEGA, ZETA = 2 * math.pi * 1.7, 0.03
RING = 80 + 6 * np.exp(-ZETA * OMEGA * TIME) * np.cos(OMEGA * TIME)


def recorded(values: np.ndarray) -> Recording:
    return recording_of({"time_s": TIME, "boom_cap_bar": values})


def noise(size: float) -> np.ndarray:
    return size * np.random.default_rng(0).normal(size=len(TIME))


@pytest.mark.parametrize("quantum", [1e-6, 0.01])
@pytest.mark.parametrize("size", [0.002, 0.004])
def test_a_sensor_at_its_limit_is_told_beneath_its_noise(size: float, quantum: float) -> None:
    """At 83 bar; the fit's damping was 0.025, where 0.030 is true."""
    clipped = recorded(np.round((np.minimum(RING, 83) + noise(size)) / quantum) * quantum)
    for part in (clipped, clipped.between(0.75, 5.9)):
        with pytest.raises(SimulationError, match=r"clipped at 83.*; choose a window of smaller"):
            part.signal("boom_cap_bar")
    free = clipped.between(2.5, 5.9)  # 6 exp(−0.32 · 2.5) is less than 3
    assert len(free.signal("boom_cap_bar")) == len(free.time)


@pytest.mark.parametrize("quantum", [1e-6, 0.01, 0.1, 0.5])
@pytest.mark.parametrize("size", [0.0, 0.004, 0.1, 1.0])
def test_rounded_peaks_are_no_limit(size: float, quantum: float) -> None:
    values = np.round((RING + noise(size)) / quantum) * quantum
    assert recorded(values).signal("boom_cap_bar") is not None


@pytest.mark.parametrize("each", [3, 4, 5])
def test_values_that_are_repeated_are_no_limit(each: int) -> None:
    """A slow sensor beside a fast clock: "clipped at 74.526" was said."""
    with pytest.raises(SimulationError, match=f"each value of boom_cap_bar stands for {each} sa"):
        recorded(RING[np.arange(len(TIME)) // each * each]).signal("boom_cap_bar")
