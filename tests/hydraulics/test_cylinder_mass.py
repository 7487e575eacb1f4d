"""Estimated mass of a cylinder: by hand, derivatives, limit of the wall."""

from __future__ import annotations

import math

import pytest
from numpy.testing import assert_allclose

from armdesign.errors import ArmDesignError
from armdesign.hydraulics.cylinder_build import barrel_ratio, estimated_mass
from armdesign.units import MPa, bar


def test_mass_by_hand() -> None:
    """By hand, 120/85 mm × 1260 mm at 350 bar: k² = 236.67/166.67 = 1.42, so D_a² = 0.020448 m².

    Barrel 0.006048 · 1.38, bottom 0.020448 · 0.06, rings 0.007175 · 0.12, rod 0.007225 · 1.38
    [m³], × 7850 π/4 kg/m³.
    """
    volume = 0.006048 * 1.38 + 0.020448 * 0.06 + 0.007175 * 0.12 + 0.007225 * 1.38
    assert_allclose(
        estimated_mass(0.12, 0.085, 1.26, None, 350 * bar), 7850 * math.pi / 4 * volume, rtol=1e-6
    )


def test_mass_by_its_wall() -> None:
    """By hand, as above with a wall of 25 mm, D_a = 170 mm: barrel 0.0145 · 1.38, bottom 0.0289 ·
    0.06 [m³]. Along the bore D the steel 4 w (D + w) (S + D) + (D + 2 w)² D/2 + (D² − d²) D +
    d² (S + D) grows by its derivative, whatever the pressure.
    """
    volume = 0.0145 * 1.38 + 0.0289 * 0.06 + 0.007175 * 0.12 + 0.007225 * 1.38
    steel = estimated_mass(0.12 + 1e-30j, 0.085, 1.26, 0.025, 350 * bar)
    assert_allclose(steel.real, 7850 * math.pi / 4 * volume, rtol=1e-12)
    slope = 4 * 0.025 * (1.38 + 0.145) + 2 * 0.17 * 0.06 + 0.17**2 / 2 + 3 * 0.12**2
    assert_allclose(steel.imag / 1e-30, 7850 * math.pi / 4 * slope, rtol=1e-12)
    assert steel == estimated_mass(0.12 + 1e-30j, 0.085, 1.26, 0.025, 0.0)


def test_mass_derivatives_and_limit() -> None:
    """Complex step against the derivative by hand: a longer stroke adds tube wall and rod, nothing
    else.
    """
    step = estimated_mass(0.12, 0.085, 1.26 + 1e-30j, None, 350 * bar).imag / 1e-30
    wall = 0.12**2 * (barrel_ratio(350 * bar) ** 2 - 1)
    assert_allclose(step, 7850 * math.pi / 4 * (wall + 0.085**2), rtol=1e-12)
    with pytest.raises(ArmDesignError, match="no steel barrel carries 1184 bar; give less"):
        estimated_mass(0.12, 0.085, 1.26, None, 118.4 * MPa)
