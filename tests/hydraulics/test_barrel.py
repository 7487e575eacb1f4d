"""The barrel's wall: thin and thick."""

from __future__ import annotations

from numpy.testing import assert_allclose

from armdesign.hydraulics.cylinder_build import BARREL_STRESS, barrel_ratio
from armdesign.units import MPa


def test_barrel_wall() -> None:
    """Limiting case p → 0: Barlow's thin wall t = p D/(2 σ); and Lamé's stresses inside a wall of
    finite thickness.
    """
    thin = 1e-5 * BARREL_STRESS
    assert_allclose((barrel_ratio(thin) - 1) / 2, thin / (2 * BARREL_STRESS), rtol=1e-4)
    p, k = 35 * MPa, barrel_ratio(35 * MPa)
    hoop, radial = p * (k**2 + 1) / (k**2 - 1), -p
    assert_allclose(hoop - radial, BARREL_STRESS, rtol=1e-12)
