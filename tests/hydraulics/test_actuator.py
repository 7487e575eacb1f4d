"""Stiffness of a cylinder: limiting cases and hand calculation."""

from __future__ import annotations

import math

import numpy as np
from numpy.testing import assert_allclose

from armdesign.hydraulics.actuator import Cylinder, Motor
from armdesign.hydraulics.fluid import Fluid, Supply, bulk_modulus
from armdesign.hydraulics.oil_spring import oil_stiffness
from armdesign.units import MPa, bar

OIL = Fluid(bulk_modulus=1200 * MPa)
SUPPLY = Supply(pressure=300 * bar, return_pressure=5 * bar, flow=1e-3)
PLAIN = Cylinder(
    name="plain",
    bore=0.12,
    rod=0.085,
    stroke=1.2,
    closed_length=1.8,
    cap_dead_volume=0.0,
    annulus_dead_volume=0.0,
)


def test_no_rod_at_mid_stroke() -> None:
    """k = 4βA²/V_total (Merritt)."""
    area, total = math.pi / 4 * 0.12**2, math.pi / 4 * 0.12**2 * 1.2
    bare = Cylinder(**(vars(PLAIN) | {"rod": 0.0}))
    assert_allclose(
        bare.stiffness(0.6, 0.0, OIL, SUPPLY), 4 * 1200e6 * area**2 / total, rtol=1e-12
    )


def test_softest_extension_without_dead_volume() -> None:
    """s* = S √A1/(√A1 + √A2), k_min = β (√A1 + √A2)²/S: no neighbour is softer."""
    A1, A2 = PLAIN.bore_area, PLAIN.annulus_area
    softest = PLAIN.stroke * math.sqrt(A1) / (math.sqrt(A1) + math.sqrt(A2))
    least = PLAIN.stiffness(softest, 0.0, OIL, SUPPLY)
    assert_allclose(
        least, 1200e6 * (math.sqrt(A1) + math.sqrt(A2)) ** 2 / PLAIN.stroke, rtol=1e-12
    )
    assert np.all(PLAIN.stiffness(np.linspace(0.01, 1.19, 400), 0.0, OIL, SUPPLY) >= least)


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
    assert_allclose(soft.stiffness(0.4, 0.0, OIL, SUPPLY), expected, rtol=1e-12)


def test_each_chamber_has_the_modulus_of_its_own_pressure() -> None:
    """A pushing load leaves the annulus at return pressure, a pulling one the cap; areas from the
    definition.
    """
    airy, back = Fluid(bulk_modulus=1200 * MPa, air=0.01), SUPPLY.return_pressure
    A1, A2 = PLAIN.bore_area, PLAIN.annulus_area
    for force, loaded in ((2e5, (2e5 + A2 * back) / A1), (-2e5, (2e5 + A1 * back) / A2)):
        pressures = (loaded, back) if force > 0 else (back, loaded)
        beta = [bulk_modulus(p, 1200 * MPa, 0.01) for p in pressures]
        expected = oil_stiffness(A1, A2, A1 * 0.5 / beta[0], A2 * 0.7 / beta[1])
        assert_allclose(PLAIN.stiffness(0.5, force, airy, SUPPLY), expected, rtol=1e-12)


def test_stiffness_by_areas_is_complex_safe() -> None:
    """The complex step that designs differentiate by agrees with central differences, air
    included.
    """
    airy = Fluid(bulk_modulus=1200 * MPa, air=0.005)

    def k(bore_area: complex) -> complex:
        return PLAIN.stiffness(0.5, 1e5, airy, SUPPLY, areas=(bore_area, 0.006))

    exact = np.imag(k(0.011 + 1e-20j)) / 1e-20
    assert_allclose(exact, (k(0.011 + 1e-7) - k(0.011 - 1e-7)) / 2e-7, rtol=1e-6)


def test_a_motor_is_as_stiff_at_a_singular_pose() -> None:
    """No angle changes its volumes, not even the endless one by which a force of inf bends it."""
    motor = Motor(
        name="slew",
        joint="slew",
        displacement=1e-4,
        gear_ratio=100.0,
        cap_dead_volume=1e-3,
        annulus_dead_volume=1e-3,
        compliance=1e-8,
    )
    at_rest, singular = motor.stiffness(np.zeros(2), np.array([0.0, math.inf]), OIL, SUPPLY)
    assert at_rest == singular > 0
