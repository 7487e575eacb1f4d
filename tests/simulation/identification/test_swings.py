"""Frequency and damping of a decay against its amplitude, in any unit."""

from __future__ import annotations

import numpy as np
import pytest

import armdesign as ad
from armdesign.simulation.identification.swings import Swings


def pieces(unit: float) -> Swings:
    """A ring whose frequency rises from 2 Hz as it decays."""
    time = np.arange(0, 6, 0.01)
    ring = np.exp(-0.4 * time) * np.cos(2 * np.pi * (2 * time + 0.02 * time**2))
    noise = 1e-4 * np.random.default_rng(1).normal(size=len(time))
    columns = {"time_s": time, "swing": unit * (ring + noise)}
    (window,) = ad.identify(columns, [(0, 6)], signal="swing").windows
    assert window.swings is not None
    return window.swings


@pytest.mark.parametrize("unit", [1e-300, 1e-150])
def test_frequencies_do_not_depend_on_the_unit(unit: float) -> None:
    """Their squares are too small for a number."""
    one, other = pieces(1.0), pieces(unit)
    assert one.change is not None
    assert other.frequencies == pytest.approx(one.frequencies, rel=1e-9)
    assert other.amplitudes / unit == pytest.approx(one.amplitudes, rel=1e-6)
    assert other.change == pytest.approx(np.multiply(one.change, [1, 1, unit, unit]), rel=1e-6)
