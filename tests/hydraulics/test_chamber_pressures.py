"""Static pressures and holding forces: balance and hand calculation."""

from __future__ import annotations

import math

import numpy as np
from numpy.testing import assert_allclose

from armdesign.hydraulics.oil_spring import holding_force, static_pressures
from armdesign.units import bar


def test_static_pressures_carry_the_force() -> None:
    """F = A1 p1 − A2 p2, no chamber below return pressure and one of them at it, for every
    force.
    """
    A1, A2, back = math.pi / 4 * 0.12**2, math.pi / 4 * (0.12**2 - 0.085**2), 5 * bar
    force = np.linspace(-4e5, 4e5, 81)
    cap, annulus = static_pressures(force, A1, A2, back)
    assert_allclose(A1 * cap - A2 * annulus, force, atol=1e-6)
    assert np.all(np.minimum(cap, annulus) >= back * (1 - 1e-12))
    assert_allclose(np.minimum(cap, annulus), back, rtol=1e-12)


def test_holding_force_by_hand() -> None:
    """100 bar on 0.01 m² against 10 bar on 0.006 m², and the other way."""
    held = holding_force(0.01, 0.006, 100 * bar, 10 * bar, np.array([True, False]))
    assert_allclose(held, [94e3, 50e3])
