"""The source paper's equations: as printed, put right, and as the general machine answers.

Pencelli et al., "On the Estimation of Resonance Frequencies of Hydraulically Actuated Systems",
ISARC 2019. Each of its misprints (docs/errata.md) has its test here. Expected numbers come from
the nonlinear model of the mechanism, differentiated (independent method), from limiting cases, or
from the published example that is named.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

import armdesign as ad
from armdesign.paper import formulas
from armdesign.units import GRAVITY, MPa, mm
from tests.checks import difference
from tests.machines import named
from tests.paper.nonlinear import (
    ASYMMETRIC,
    GRID,
    LENGTHS,
    MASSES,
    PINS,
    REST,
    SYMMETRIC,
    VALVE,
    Nonlinear,
    slope,
)

# -------------------------------------------------------------------------------------- rigid load


def test_published_worked_example() -> None:
    """4 in bore, 2.5 in rod, 12 in stroke, middle, no dead volume, 180 000 psi, 1000 lb: 77.03 Hz.

    Source:
    https://forum.deltamotion.com/t/computing-the-natural-frequency-of-the-cylinder-and-load/1042
    """
    inch, pound, psi = 25.4 * mm, 0.45359237, 6894.757293
    bore_area, rod_area = (math.pi / 4 * (d * inch) ** 2 for d in (4, 2.5))
    areas = {"bore_area": bore_area, "annulus_area": bore_area - rod_area}
    volumes = {
        "cap_volume": 6 * inch * bore_area,
        "annulus_volume": 6 * inch * (bore_area - rod_area),
    }
    omega = formulas.rigid_load_asymmetric(
        mass=1000 * pound, bulk_modulus=180e3 * psi, **areas, **volumes
    )
    # four figures: the source's unit constants are not given
    assert_allclose(omega, 77.03, atol=0.005)


def test_eq_11_by_hand() -> None:
    """k = 2 · 1e9 · (1e-3)²/1e-3 = 2e6 N/m on 2e6/(2π)² kg swings once a second."""
    mass = 2e6 / (2 * math.pi) ** 2
    data = {"area": 1e-3, "chamber_volume": 1e-3, "bulk_modulus": 1e9}
    assert_allclose(formulas.rigid_load(mass=mass, **data), 1.0, rtol=1e-12)
    assert_allclose(formulas.rigid_load(mass=mass, stiffness=2e6), 1.0, rtol=1e-12)
    assert np.isinf(formulas.rigid_load(mass=0.0, stiffness=2e6))


def test_eq_12_prints_a_factor_2_too_much() -> None:
    """With A1 = A2 and V01 = V02 it must be (11); as printed its square is twice that."""
    A, V0, beta = SYMMETRIC.values()
    alike = {"bore_area": A, "annulus_area": A, "cap_volume": V0, "annulus_volume": V0}
    eq_11 = formulas.rigid_load(mass=80.0, **SYMMETRIC)
    assert_allclose(
        formulas.rigid_load_asymmetric(mass=80.0, bulk_modulus=beta, **alike), eq_11, rtol=1e-14
    )
    printed = formulas.rigid_load_asymmetric_as_printed(mass=80.0, bulk_modulus=beta, **alike)
    assert_allclose(printed**2, 2 * eq_11**2, rtol=1e-14)


def test_eq_12_as_printed_is_what_the_paper_prints() -> None:
    A1, A2, V01, V02 = ASYMMETRIC.values()
    printed = 1 / (2 * math.pi) * math.sqrt(2 * 1e9 / 80 * (A1**2 / V01 + A2**2 / V02))
    assert_allclose(
        formulas.rigid_load_asymmetric_as_printed(mass=80, bulk_modulus=1e9, **ASYMMETRIC), printed
    )


# ----------------------------------------------------------------------------------- the mechanism


def test_eq_13_14_21_are_the_triangle() -> None:
    """Length from the pins' coordinates, angle back from it, moment arm as its derivative, d1 cos
    α at θ = π/2.
    """
    model, angle = Nonlinear(100, 1), np.linspace(0.2, 3, 9)[:, None]
    length = formulas.cylinder_length(**PINS, angle=angle)
    assert_allclose(length, model.length(angle), rtol=1e-14)
    assert_allclose(formulas.joint_angle(**PINS, length=length), angle, rtol=1e-12)
    arm = formulas.moment_arm(**PINS, angle=angle)
    assert_allclose(arm, slope(model.length, angle), rtol=1e-10)
    alpha = math.atan(0.5 / 0.15)  # eq. (29)
    assert_allclose(formulas.moment_arm(**PINS), 0.5 * math.cos(alpha), rtol=1e-14)
    with pytest.raises(ad.ArmDesignError, match="no triangle"):
        formulas.joint_angle(**PINS, length=0.7)


def test_eq_16_22_inertia_and_gravity_of_a_point_mass() -> None:
    """J = m2 (distance)², g(θ) = ∂/∂θ of m2 g × height."""
    model, angle = Nonlinear(130, 0.8), np.linspace(0.2, 3, 9)[:, None]
    load = {"load_mass": 130, "link_pin_distance": 0.15, "link_length": 0.8}
    assert_allclose(formulas.joint_inertia(**load), 130 * math.hypot(0.15, 0.8) ** 2, rtol=1e-14)
    weight = 130 * GRAVITY * slope(model.height, angle)
    assert_allclose(formulas.gravity_torque(**load, angle=angle), weight, rtol=1e-9, atol=1e-9)


def test_eq_27_prints_the_wrong_sign() -> None:
    """The load pulls the rod: Δp is where the nonlinear torque vanishes, the printed one is its
    negative.
    """
    data = {"load_mass": 130, **PINS, "link_length": 0.8}
    exact = formulas.static_pressure_difference(**data, area=SYMMETRIC["area"])
    assert exact < 0
    assert_allclose(exact, Nonlinear(130, 0.8).static_pressure, rtol=1e-9)
    assert_allclose(
        formulas.static_pressure_difference_as_printed(**data, area=SYMMETRIC["area"]), -exact
    )
    assert_allclose(formulas.static_force(**data), exact * SYMMETRIC["area"], rtol=1e-12)


# ------------------------------------------------------------------------------ joint-coupled load


@pytest.mark.parametrize("length", LENGTHS)
@pytest.mark.parametrize("mass", [50.0, 400.0])
def test_the_exact_formula_is_the_differentiated_nonlinear_model(
    mass: float, length: float
) -> None:
    """ω² = −(∂/∂θ of the net torque on trapped oil)/J at θ = π/2: errata (33), (38), (42)."""
    model = Nonlinear(mass, length)
    stiffness = -slope(model.trapped_torque, REST).item()
    expected = math.sqrt(stiffness / model.inertia) / (2 * math.pi)
    data = {"load_mass": mass, "link_length": length, **PINS}
    assert_allclose(formulas.joint_coupled(**data, **SYMMETRIC), expected, rtol=1e-9)
    printed = formulas.joint_coupled_as_printed(**data, **SYMMETRIC)
    assert abs(printed / expected - 1) > 1e-5, "the printed gravity term is another one"


def test_eq_42_as_printed_is_what_the_paper_prints() -> None:
    """Its second line, letter by letter; √(Q/K) of (36) and (38); with k_h in the place of
    2βA²/V0.
    """
    m2, l2, a1, d1 = GRID.values()
    A, V0, beta = SYMMETRIC.values()
    d1_cos_alpha = d1 * math.cos(math.atan(d1 / a1))
    n = 1 / d1_cos_alpha
    numerator = 2 * d1_cos_alpha * A**2 - m2 * 9.81 * l2 * n * V0 / beta
    printed = np.sqrt(numerator / (V0 / beta * m2 * (a1**2 + l2**2) * n)) / (2 * math.pi)
    assert_allclose(formulas.joint_coupled_as_printed(**GRID, **SYMMETRIC), printed, rtol=1e-13)
    terms = formulas.transfer_function_as_printed(**GRID, **SYMMETRIC, **VALVE)
    assert_allclose(np.sqrt(terms.Q / terms.K) / (2 * math.pi), printed, rtol=1e-13)
    spring = formulas.symmetric_stiffness(**SYMMETRIC)
    assert_allclose(
        formulas.joint_coupled_as_printed(**GRID, stiffness=spring), printed, rtol=1e-13
    )


def test_printed_and_exact_differ_by_gravity_alone() -> None:
    """ω² = k_h r²/J − G/J with G = m2 g l2 printed, m2 g a1 (1 + l2 d1/(a1² + d1²)) exact; (11)
    with J/r² is G = 0.
    """
    J = formulas.joint_inertia(
        load_mass=GRID["load_mass"], link_pin_distance=0.15, link_length=LENGTHS
    )
    mass = formulas.reflected_mass(joint_inertia=J, moment_arm=formulas.moment_arm(**PINS))
    without = formulas.rigid_load(mass=mass, **SYMMETRIC)
    weight = GRID["load_mass"] * 9.81
    printed = formulas.joint_coupled_as_printed(**GRID, **SYMMETRIC)
    exact = formulas.joint_coupled(**GRID, **SYMMETRIC)
    gravity = 0.15 * (1 + LENGTHS * 0.5 / (0.15**2 + 0.5**2))
    for omega, lever in ((printed, LENGTHS), (exact, gravity)):
        assert_allclose(
            (2 * math.pi) ** 2 * (without**2 - omega**2), weight * lever / J, rtol=1e-9
        )


def test_transfer_function_is_the_linearised_nonlinear_model() -> None:
    """Poles (36)–(39) and gain (40), exact: state matrices by finite differences of eq.

    (22) and (34) at rest.
    """
    model = Nonlinear(250, 0.9)
    equilibrium = np.array([[math.pi / 2, 0, model.static_pressure, 0]])
    # one step suits all when the pressure is counted in MPa
    scale = np.array([1.0, 1.0, 1e6, 1e-3])
    slopes = difference(lambda x: model.rate(x * scale), equilibrium / scale)[0] / scale
    A, B = slopes[:, :3], slopes[:, 3]
    terms = formulas.transfer_function(
        load_mass=250, link_length=0.9, **PINS, **SYMMETRIC, **VALVE
    )
    assert_allclose(np.poly(A)[1:] * terms.K, [terms.F, terms.Q, -terms.H], rtol=1e-7)
    s = 12 + 30j
    output = np.array([formulas.moment_arm(**PINS), 0, 0])  # δx_p = r δθ
    expected = terms.mu / (terms.K * s**3 + terms.F * s**2 + terms.Q * s - terms.H)
    assert_allclose(output @ np.linalg.solve(s * np.eye(3) - A, B), expected, rtol=1e-7)


def test_eq_38_39_40_as_printed() -> None:
    """Gravity with l2 in the place of a1 (1 + …), and μ twice too large."""
    printed = formulas.transfer_function_as_printed(**GRID, **SYMMETRIC, **VALVE)
    exact = formulas.transfer_function(**GRID, **SYMMETRIC, **VALVE)
    assert_allclose(printed.mu, 2 * exact.mu)
    assert_allclose(printed.K, exact.K)
    assert_allclose(printed.F, exact.F)
    n = 1 / formulas.moment_arm(**PINS)
    assert_allclose(
        printed.H, 2 * VALVE["leakage"] * GRID["load_mass"] * 9.81 * LENGTHS * n, rtol=1e-13
    )


def test_gravity_stronger_than_the_oil_is_0_hz() -> None:
    soft = {"load_mass": [100.0, 1e6], "link_length": 1.0, **PINS, "stiffness": 1e6}
    for formula in (formulas.joint_coupled, formulas.joint_coupled_as_printed):
        assert formula(**soft)[0] > 0
        assert formula(**soft)[1] == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, "the cylinder not given"),
        ({"stiffness": 1e6, "area": 1e-3}, "stiffness and area describe the cylinder twice"),
        ({"area": 1e-3, "bulk_modulus": 1e9}, "chamber_volume not given"),
        ({"stiffness": -1e6}, r"stiffness: -1e\+06 is not allowed"),
        ({"stiffness": [1e6, math.nan]}, "stiffness: nan is not allowed"),
        ({"stiffness": "soft"}, "'soft' is no number"),
        ({"stiffness": 1e6, "mechanism": -1.0}, "-1 is not allowed"),
    ],
)
def test_the_cylinder_is_given_once_and_whole(arguments: dict[str, object], message: str) -> None:
    mass = arguments.pop("mechanism", 100.0)
    for formula in (formulas.joint_coupled, formulas.joint_coupled_as_printed):
        with pytest.raises(ad.ArmDesignError, match=message) as caught:
            formula(load_mass=mass, link_length=1.0, **PINS, **arguments)
        assert "\n" not in str(caught.value)
    with pytest.raises(ad.ArmDesignError, match=message):
        formulas.rigid_load(mass=mass, **arguments)


# ----------------------------------------------------------------------------- the general machine


def grid_modes(machine: ad.Machine) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Coupled, locked and rigid frequency (8, 5) of the shipped machine at q = 0, the paper's θ =
    π/2.
    """
    omega = np.empty((3, len(MASSES), len(LENGTHS)))
    for i, mass in enumerate(MASSES):
        for j, length in enumerate(LENGTHS):
            changes = {
                "payload.load.mass_kg": float(mass),
                "payload.load.at_mm": [1000 * float(length), 0, 150],
            }
            modes = ad.natural_modes(machine.replace(changes).at(np.zeros((1, 1))))
            for row, values in enumerate(
                (modes.frequencies, modes.locked_frequencies, modes.rigid_frequencies)
            ):
                omega[row, i, j] = values[0, 0]
    return omega[0], omega[1], omega[2]


def test_the_papers_40_configurations_through_the_general_machine() -> None:
    """`paper_1dof` knows nothing of the paper's formulas; its eigenvalue is (42) put right with
    the asymmetric k_h.

    k_h = β (A1²/V1 + A2²/V2) by hand from the machine file: 63/36 mm, mid-stroke of 200 mm, 0.1 l
    dead on each side.
    """
    coupled, locked, rigid = grid_modes(named("paper_1dof"))
    A1, A2 = math.pi / 4 * 0.063**2, math.pi / 4 * (0.063**2 - 0.036**2)
    length, closed = math.hypot(0.15, 0.5), 0.422015325
    V1, V2 = A1 * (length - closed) + 1e-4, A2 * (closed + 0.2 - length) + 1e-4
    stiffness = 1200 * MPa * (A1**2 / V1 + A2**2 / V2)
    assert_allclose(coupled, formulas.joint_coupled(**GRID, stiffness=stiffness), rtol=1e-8)
    assert_allclose(locked, coupled, rtol=1e-12)
    mass = formulas.equivalent_mass(static_force=formulas.static_force(**GRID))
    assert_allclose(rigid, formulas.rigid_load(mass=mass, stiffness=stiffness), rtol=1e-8)
    volumes = {"bore_area": A1, "annulus_area": A2, "cap_volume": V1, "annulus_volume": V2}
    other = formulas.rigid_load_asymmetric(mass=mass, bulk_modulus=1200 * MPa, **volumes)
    assert_allclose(rigid, other, rtol=1e-8)


def test_the_papers_findings() -> None:
    """Section 4: frequencies fall with load and length, and the rigid load's are far too
    high.

    Its RMSE of 23.4900 rad/s cannot be compared: the paper does not give its dimensions.
    """
    coupled, _, rigid = grid_modes(named("paper_1dof"))
    assert np.all(np.diff(coupled, axis=0) < 0)
    assert np.all(np.diff(coupled, axis=1) < 0)
    assert np.all(rigid > coupled)
