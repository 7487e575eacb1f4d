"""The highest line of a spectrum, as the source paper reads a sweep."""

from __future__ import annotations

import math

import numpy as np
import pytest

from armdesign.errors import SimulationError
from armdesign.simulation.identification.modal_fit import spectral_peak


def test_spectral_peak_of_two_sines() -> None:
    """Whole periods in 10 s: 7.3 Hz is the higher line in the band; a mean and a stronger sine
    outside do not count.
    """
    time = np.arange(0, 10, 1 / 100)
    answer = 5 + 0.3 * np.sin(2 * math.pi * 4.1 * time) + np.sin(2 * math.pi * 7.3 * time)
    answer += 3 * np.sin(2 * math.pi * 20 * time)
    assert spectral_peak(time, answer, (1.0, 15.0)) == pytest.approx(7.3, rel=1e-12)
    assert spectral_peak(time, answer, (1.0, 6.0)) == pytest.approx(4.1, rel=1e-12)
    assert spectral_peak(time, answer, (1.0, 30.0)) == pytest.approx(20, rel=1e-12)


def test_spectral_peak_refuses_nothing() -> None:
    time = np.arange(0, 1, 0.01)
    with pytest.raises(SimulationError, match=r"no line from 1.2 to 1.7 Hz; record 2 s or more"):
        spectral_peak(time, np.sin(time), (1.2, 1.7))
    with pytest.raises(SimulationError, match="rig: nothing moves"):
        spectral_peak(time, np.zeros_like(time), (1.0, 20.0), "rig")
