"""Arguments of the formulas that cannot be, and arrays of them."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose

import armdesign as ad
from armdesign.paper import formulas
from tests.checks import difference
from tests.paper.nonlinear import ASYMMETRIC, PINS, SYMMETRIC, VALVE, Nonlinear

# ------------------------------------------------------------------------ arguments that cannot be

DISTANCES = ("link_pin_distance", "base_pin_distance", "moment_arm")


WHOLE: dict[str, dict[str, object]] = {  # every function of the module with arguments that suit it
    "symmetric_stiffness": SYMMETRIC,
    "rigid_load": {"mass": 100.0, **SYMMETRIC},
    "rigid_load_asymmetric": {"mass": 80.0, "bulk_modulus": 1e9, **ASYMMETRIC},
    "rigid_load_asymmetric_as_printed": {"mass": 80.0, "bulk_modulus": 1e9, **ASYMMETRIC},
    "equivalent_mass": {"static_force": -1000.0},
    "reflected_mass": {"joint_inertia": 90.0, "moment_arm": 0.14},
    "cylinder_length": {**PINS, "angle": 1.0},
    "joint_angle": {**PINS, "length": 0.5},
    "moment_arm": {**PINS, "angle": 1.0},
    "joint_inertia": {"load_mass": 100.0, "link_pin_distance": 0.15, "link_length": 0.9},
    "gravity_torque": {
        "load_mass": 100.0,
        "link_pin_distance": 0.15,
        "link_length": 0.9,
        "angle": 1.0,
    },
    "static_force": {"load_mass": 100.0, **PINS, "link_length": 0.9, "angle": 1.0},
    "static_pressure_difference": {"load_mass": 100.0, **PINS, "link_length": 0.9, "area": 1e-3},
    "static_pressure_difference_as_printed": {
        "load_mass": 100.0,
        **PINS,
        "link_length": 0.9,
        "area": 1e-3,
    },
    "joint_coupled": {"load_mass": 100.0, **PINS, "link_length": 0.9, **SYMMETRIC},
    "joint_coupled_as_printed": {"load_mass": 100.0, **PINS, "link_length": 0.9, **SYMMETRIC},
    "transfer_function": {"load_mass": 100.0, **PINS, "link_length": 0.9, **SYMMETRIC, **VALVE},
    "transfer_function_as_printed": {
        "load_mass": 100.0,
        **PINS,
        "link_length": 0.9,
        **SYMMETRIC,
        **VALVE,
    },
}


EACH = [(name, argument) for name, given in WHOLE.items() for argument in given]


def test_every_function_is_looked_at() -> None:
    public = {name for name, value in vars(formulas).items() if callable(value)}
    assert set(WHOLE) == public - {"TransferFunction"}
    assert public == set(formulas.__all__)


@pytest.mark.parametrize(("name", "argument"), EACH)
def test_what_an_argument_cannot_be_is_refused(name: str, argument: str) -> None:
    """No function answers with NaN: not finite, no number, complex, a distance ≤ 0; alone or
    within an array.
    """
    formula, given = getattr(formulas, name), WHOLE[name]
    wrong: list[object] = [math.nan, math.inf, "x", "", 1j, [given[argument], math.nan], {}]
    if argument in DISTANCES:
        wrong += [0, -0.1, [given[argument], 0.0], [given[argument], -1e-9]]
    elif argument not in ("link_length", "angle", "static_force"):
        wrong += [-1e-9, [given[argument], -1.0]]
    for value in wrong:
        with pytest.raises(ad.ArmDesignError, match=f"{argument}: ") as caught:
            formula(**{**given, argument: value})
        assert "give" in str(caught.value)


@pytest.mark.parametrize(("name", "argument"), EACH)
def test_arrays_are_answered_element_by_element(name: str, argument: str) -> None:
    """Lists and arrays of numbers, whole ones too: each element as if it had been given alone."""
    formula, given = getattr(formulas, name), WHOLE[name]
    values = [given[argument], 0.9 * given[argument]]  # type: ignore[operator]
    alone = [np.atleast_1d(formula(**{**given, argument: value})) for value in values]
    for shape in (values, np.array(values)[:, None]):
        answer = formula(**{**given, argument: shape})
        terms = answer if name.startswith("transfer") else [answer]
        rows = np.stack([np.broadcast_to(np.ravel(term), 2) for term in terms], axis=1)
        assert_allclose(rows, np.stack(alone), rtol=1e-14)


def test_shapes_that_do_not_go_together_are_refused() -> None:
    for name, given in WHOLE.items():
        for first, other in pairwise(given):
            arrays = {first: [given[first]] * 2, other: [given[other]] * 3}
            with pytest.raises(ad.ArmDesignError, match="shapes do not go together"):
                getattr(formulas, name)(**{**given, **arrays})


def test_a_load_on_the_other_side_is_right() -> None:
    """l2 < 0: the frequency of the nonlinear model, linearised by differences, as on this side; it
    pushes the rod.
    """
    model = Nonlinear(250, -0.9)
    data = {"load_mass": 250, "link_length": -0.9, **PINS}
    angle, step = math.pi / 2, 1e-5
    forces = [formulas.static_force(**data, angle=angle + sign * step) for sign in (-1, 1)]
    assert formulas.static_force(**data) == pytest.approx(sum(forces) / 2, rel=1e-6)
    assert (
        formulas.static_force(**data) > 0 > formulas.static_force(**{**data, "link_length": 0.9})
    )
    equilibrium = np.array([[math.pi / 2, 0, model.static_pressure, 0]])
    scale = np.array([1.0, 1.0, 1e6, 1e-3])
    slopes = difference(lambda x: model.rate(x * scale), equilibrium / scale)[0] / scale
    terms = formulas.transfer_function(**data, **SYMMETRIC, **VALVE)
    assert_allclose(np.poly(slopes[:, :3])[1:] * terms.K, [terms.F, terms.Q, -terms.H], rtol=1e-7)
    assert_allclose(
        formulas.joint_coupled(**data, **SYMMETRIC), math.sqrt(terms.Q / terms.K) / (2 * math.pi)
    )


def test_places_without_a_moment_arm() -> None:
    """In line with the joint the arm vanishes and no force holds a load; pins in one place have no
    direction.
    """
    alike = {"link_pin_distance": 0.5, "base_pin_distance": 0.5}
    assert formulas.cylinder_length(**alike, angle=0.0) == 0
    with pytest.raises(
        ad.ArmDesignError,
        match=r"moment_arm: angle: both pins .* in one place; give it in \(0, π\)",
    ):
        formulas.moment_arm(**alike, angle=[1.0, 0.0])
    assert_allclose(formulas.moment_arm(**PINS, angle=[0.0, math.pi]), 0, atol=1e-16)
    with pytest.raises(
        ad.ArmDesignError, match=r"static_force: angle: 3\.14159 rad is a dead centre"
    ):
        formulas.static_force(**PINS, load_mass=1.0, link_length=1.0, angle=[1.0, math.pi])
    near = formulas.cylinder_length(link_pin_distance=0.3, base_pin_distance=0.3, angle=1e-9)
    # a chord is radius × angle; 1 − cos of it would be 0
    assert near == pytest.approx(0.3e-9, rel=1e-12)
