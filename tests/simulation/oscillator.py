"""A linear oscillator in closed form, and a multisine to excite it."""

from __future__ import annotations

import math

import numpy as np
from scipy.signal import StateSpace, lsim


def answer_of(
    frequency: float, zeta: float, time: np.ndarray, excitation: np.ndarray
) -> np.ndarray:
    """ω²/(s² + 2ζωs + ω²) from rest."""
    omega = 2 * math.pi * frequency
    system = StateSpace(
        [[0, 1], [-(omega**2), -2 * zeta * omega]], [[0], [omega**2]], [[1, 0]], [[0]]
    )
    return np.asarray(lsim(system, excitation, time)[1])


def exact(frequency: float, zeta: float, lines: np.ndarray) -> np.ndarray:
    return np.asarray(frequency**2 / (frequency**2 - lines**2 + 2j * zeta * frequency * lines))


def multisine(time: np.ndarray, period: float, lines: np.ndarray) -> np.ndarray:
    """Sines of lines k/T [Hz] with phases of low peaks (Schroeder 1970), mean square 1/2."""
    number = np.arange(1, len(lines) + 1)
    phases = -math.pi * number * (number - 1) / len(lines)
    angles = 2 * math.pi * lines * (np.asarray(time)[..., None] % period) + phases
    return np.asarray(np.sin(angles).sum(axis=-1) / math.sqrt(len(lines)))
