"""The cylinder and its oil: formulas against hand calculation, published tables and limiting
cases.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from armdesign.errors import ArmDesignError
from armdesign.hydraulics.actuator import (
    BARREL_STRESS,
    Cylinder,
    Fluid,
    Supply,
    barrel_ratio,
    estimated_mass,
    euler_safety,
    holding_force,
    oil_stiffness,
    softest_extension,
    static_pressures,
    stiffness,
)
from armdesign.hydraulics.fluid import bulk_modulus
from armdesign.units import MPa, bar

OIL = Fluid(bulk_modulus=1200 * MPa)
PLAIN = Cylinder(
    name="plain",
    bore=0.12,
    rod=0.085,
    stroke=1.2,
    closed_length=1.8,
    cap_dead_volume=0.0,
    annulus_dead_volume=0.0,
)


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
    """THEORY, section 7: E = 1.6 GPa, n = 1.4, gauge pressure; the mixture law of Simscape's
    hydraulic fluid [GPa].
    """
    assert_allclose(
        bulk_modulus(pressure_bar * bar, 1600 * MPa, air_percent / 100) / 1e9, published, atol=6e-4
    )


def test_bulk_modulus_is_that_of_a_mixture() -> None:
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


def test_no_rod_at_mid_stroke() -> None:
    """k = 4βA²/V_total (Merritt)."""
    area, total = math.pi / 4 * 0.12**2, math.pi / 4 * 0.12**2 * 1.2
    bare = Cylinder(**(vars(PLAIN) | {"rod": 0.0}))
    assert_allclose(bare.stiffness(0.6, 0.0, OIL, 0.0), 4 * 1200e6 * area**2 / total, rtol=1e-12)


def test_softest_extension_without_dead_volume() -> None:
    """s* = S √A1/(√A1 + √A2), k_min = β (√A1 + √A2)²/S: no neighbour is softer."""
    A1, A2 = PLAIN.bore_area, PLAIN.annulus_area
    softest = softest_extension(A1, A2, PLAIN.stroke)
    least = PLAIN.stiffness(softest, 0.0, OIL, 0.0)
    assert_allclose(
        least, 1200e6 * (math.sqrt(A1) + math.sqrt(A2)) ** 2 / PLAIN.stroke, rtol=1e-12
    )
    assert np.all(PLAIN.stiffness(np.linspace(0.01, 1.19, 400), 0.0, OIL, 0.0) >= least)


def test_hose_and_mounting_are_springs_in_series() -> None:
    """Compliances add: per chamber V/(βA²) + V_hose/(β_hose A²), then the mounting's."""
    soft = Cylinder(
        **(
            vars(PLAIN)
            | {
                "cap_dead_volume": 2e-3,
                "cap_hose_volume": 1e-3,
                "annulus_hose_volume": 5e-4,
                "compliance": 1e-8,
            }
            | {"annulus_dead_volume": 1e-3, "hose_modulus": 500e6}
        )
    )
    A1, A2 = PLAIN.bore_area, PLAIN.annulus_area
    cap = (A1 * 0.4 + 2e-3) / (1200e6 * A1**2) + 1e-3 / (500e6 * A1**2)
    annulus = (A2 * 0.8 + 1e-3) / (1200e6 * A2**2) + 5e-4 / (500e6 * A2**2)
    expected = 1 / (1 / (1 / cap + 1 / annulus) + 1e-8)
    assert_allclose(soft.stiffness(0.4, 0.0, OIL, 0.0), expected, rtol=1e-12)


def test_each_chamber_has_the_modulus_of_its_own_pressure() -> None:
    """A pushing load leaves the annulus at return pressure, a pulling one the cap; areas from the
    definition.
    """
    airy, back = Fluid(bulk_modulus=1200 * MPa, air=0.01), 5 * bar
    A1, A2 = PLAIN.bore_area, PLAIN.annulus_area
    for force, loaded in ((2e5, (2e5 + A2 * back) / A1), (-2e5, (2e5 + A1 * back) / A2)):
        pressures = (loaded, back) if force > 0 else (back, loaded)
        beta = [bulk_modulus(p, 1200 * MPa, 0.01) for p in pressures]
        expected = oil_stiffness(A1, A2, A1 * 0.5 / beta[0], A2 * 0.7 / beta[1])
        assert_allclose(PLAIN.stiffness(0.5, force, airy, back), expected, rtol=1e-12)


def test_static_pressures_carry_the_force() -> None:
    """F = A1 p1 − A2 p2, no chamber below return pressure and one of them at it, for every
    force.
    """
    A1, A2, back = PLAIN.bore_area, PLAIN.annulus_area, 5 * bar
    force = np.linspace(-4e5, 4e5, 81)
    cap, annulus = static_pressures(force, A1, A2, back)
    assert_allclose(A1 * cap - A2 * annulus, force, atol=1e-6)
    assert np.all(np.minimum(cap, annulus) >= back * (1 - 1e-12))
    assert_allclose(np.minimum(cap, annulus), back, rtol=1e-12)


def test_stiffness_by_areas_is_complex_safe() -> None:
    """The complex step that designs differentiate by agrees with central differences, air
    included.
    """
    airy = Fluid(bulk_modulus=1200 * MPa, air=0.005)

    def k(bore_area: complex) -> complex:
        return stiffness(PLAIN, bore_area, 0.006, 0.5, 1.2, 1e5, airy, 5 * bar)

    exact = np.imag(k(0.011 + 1e-20j)) / 1e-20
    assert_allclose(exact, (k(0.011 + 1e-7) - k(0.011 - 1e-7)) / 2e-7, rtol=1e-6)


def test_holding_force_and_buckling_by_hand() -> None:
    """100 bar on 0.01 m² against 10 bar on 0.006 m², and the other way; π² 210e9 I/L² over p A for
    a 50 mm rod.
    """
    supply = Supply(pressure=100 * bar, return_pressure=10 * bar, flow=1e-3)
    assert_allclose(holding_force(0.01, 0.006, supply, np.array([True, False])), [94e3, 50e3])
    load = math.pi**2 * 210e9 * (math.pi * 0.05**4 / 64) / 2.0**2
    assert_allclose(
        euler_safety(0.1, 0.05, 2.0, 100 * bar), load / (100 * bar * math.pi * 0.05**2), rtol=1e-12
    )


def test_barrel_wall() -> None:
    """Limiting case p → 0: Barlow's thin wall t = p D/(2 σ); and Lamé's stresses inside a wall of
    finite thickness.
    """
    thin = 1e-5 * BARREL_STRESS
    assert_allclose((barrel_ratio(thin) - 1) / 2, thin / (2 * BARREL_STRESS), rtol=1e-4)
    p, k = 35 * MPa, barrel_ratio(35 * MPa)
    hoop, radial = p * (k**2 + 1) / (k**2 - 1), -p
    assert_allclose(hoop - radial, BARREL_STRESS, rtol=1e-12)


def test_mass_by_hand() -> None:
    """By hand, 120/85 mm × 1260 mm at 350 bar: k² = 236.67/166.67 = 1.42, so D_a² = 0.020448 m².

    Barrel 0.006048 · 1.38, bottom 0.020448 · 0.06, rings 0.007175 · 0.12, rod 0.007225 · 1.38
    [m³], × 7850 π/4 kg/m³.
    """
    volume = 0.006048 * 1.38 + 0.020448 * 0.06 + 0.007175 * 0.12 + 0.007225 * 1.38
    assert_allclose(
        estimated_mass(0.12, 0.085, 1.26, 350 * bar), 7850 * math.pi / 4 * volume, rtol=1e-6
    )


def test_mass_derivatives_and_limit() -> None:
    """Complex step against the derivative by hand: a longer stroke adds tube wall and rod, nothing
    else.
    """
    step = estimated_mass(0.12, 0.085, 1.26 + 1e-30j, 350 * bar).imag / 1e-30
    wall = 0.12**2 * (barrel_ratio(350 * bar) ** 2 - 1)
    assert_allclose(step, 7850 * math.pi / 4 * (wall + 0.085**2), rtol=1e-12)
    with pytest.raises(ArmDesignError, match="no steel barrel carries 118"):
        estimated_mass(0.12, 0.085, 1.26, 118.4 * MPa)
