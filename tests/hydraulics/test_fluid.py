"""Bulk modulus of oil with air: published values, and the definition."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from armdesign.hydraulics.fluid import bulk_modulus
from armdesign.units import MPa, bar


@pytest.mark.parametrize(
    ("pressure_bar", "air_percent", "published"),
    [
        (10, 0.1, 1.346),
        (10, 0.5, 0.824),
        (10, 1.0, 0.555),
        (50, 0.1, 1.579),
        (50, 0.5, 1.498),
        (50, 1.0, 1.409),
        (200, 0.1, 1.598),
        (200, 0.5, 1.590),
        (200, 1.0, 1.580),
    ],
)
def test_bulk_modulus_with_air(pressure_bar: float, air_percent: float, published: float) -> None:
    """E = 1.6 GPa, n = 1.4, gauge pressure; the mixture law of Simscape's
    hydraulic fluid [GPa].
    """
    assert_allclose(
        bulk_modulus(pressure_bar * bar, 1600 * MPa, air_percent / 100) / 1e9, published, atol=6e-4
    )


def test_bulk_modulus_of_a_mixture() -> None:
    """β = −V dP/dV of oil and gas that are squeezed side by side (definition, finite difference),
    and E without air.
    """
    E, a, n, atm = 1.6e9, 0.005, 1.4, 101_325.0

    def volume(p: float) -> float:
        """Oil e^(−p/E) ≈ 1 in the mixture law, and gas a (p_atm/P)^(1/n)."""
        return 1 - p / E + a * (atm / (p + atm)) ** (1 / n)

    for p in (1e5, 1e6, 5e6):
        step = 1e-4 * p
        slope = (volume(p + step) - volume(p - step)) / (2 * step)
        mixed = 1 + a * (atm / (p + atm)) ** (1 / n)
        assert_allclose(bulk_modulus(p, E, a), -mixed / slope, rtol=1e-6)
    assert_allclose(bulk_modulus(np.array([0.0, 1e7]), E, 0.0), E, rtol=1e-15)
    assert np.all(np.isfinite(bulk_modulus(np.array([-2e5, -1e9, 0.0]), E, a)))
