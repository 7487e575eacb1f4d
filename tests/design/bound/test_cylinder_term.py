"""Terms of cylinders hold stiffness, and their slopes are derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings

from armdesign.design.bound.cylinder_constraints import cylinder_constraints
from armdesign.design.bound.cylinder_shape import coordinates
from armdesign.design.bound.cylinder_term import CylinderTerm
from armdesign.design.bound.intervals import interval
from armdesign.mechanism.joint_ranges import sweep
from tests.design.bound.shapes import (
    CYLINDERS,
    ROUNDING,
    box_around,
    box_shares,
    cylinder,
    designs,
    some_design,
)


@pytest.mark.parametrize("name", CYLINDERS)
@settings(max_examples=80)
@given(seed=designs, width=box_shares, place=box_shares)
def test_terms_hold_stiffness(
    name: str, seed: int, width: list[float], place: list[float]
) -> None:
    """k_h r² − F H − μ·v by the machine's own formulas, at any pins of a box and any v, is below
    the box's bound.

    Boxes of no width are exact.
    """
    problem, i, angles, shape = cylinder(name)
    x, random = some_design(problem, seed), np.random.default_rng(seed)
    machine, old = problem.machine, problem.machine.cylinders[i]
    joint, limits = machine.linkages[i].joints[0], cylinder_constraints(problem, i)
    assert limits is not None
    exact = problem.vector.linkages(x)[i].actuation(sweep(machine.arm, joint, angles))
    arm, curve, stroke = (
        exact.moment_arm[:, joint],
        exact.moment_arm_derivative[:, joint, joint],
        np.ptp(exact.length),
    )
    if (arm * shape.sign).min() < 1e-3:
        return  # not a cylinder that works
    area = np.array([old.bore_area, old.annulus_area]) * random.uniform(0.5, 1.1, (5, 2))
    weight, gravity = random.uniform(0, 1, len(angles)), random.normal(size=len(angles)) * 1e4
    price, values = random.normal(size=2) * 1e6, []
    out = exact.length - exact.length.min()
    for areas in area:
        k = old.stiffness(
            out, 0.0, machine.fluid, machine.supply, areas=tuple(areas), stroke=stroke
        )
        values.append(weight @ (k * arm**2 - gravity / arm * curve) - price @ areas * stroke)
    share = CylinderTerm(
        shape=shape,
        limits=limits,
        weight=np.concatenate([[0, 0], weight * machine.fluid.bulk_modulus]),
        bend=interval(np.concatenate([[0, 0], weight * gravity])),
        price=price,
        dead=np.array([old.cap_dead_volume, old.annulus_dead_volume]),
        hoses=np.zeros(2),
    )
    at = coordinates(problem, i, shape, x)
    low, high = box_around(at, shape, np.array(width) * 0.1, np.array(place))
    volume, scale = (area * stroke)[None], np.abs(values).max()
    bound, _, _ = share.enclosed(shape.enclose(low[:, :2], high[:, :2]), volume, share.price[None])
    assert np.all(bound[0] >= np.array(values) - ROUNDING * scale)
    none, _, _ = share.enclosed(
        shape.enclose(at[None, :2], at[None, :2]), volume, share.price[None]
    )
    np.testing.assert_allclose(none[0], values, atol=1e-8 * scale)


@pytest.mark.parametrize("name", CYLINDERS)
def test_slopes_of_a_term_are_its_derivatives(name: str) -> None:
    """In a box of no width they are |∂/∂b|, by central differences of the value; 1e-6: their
    truncation.
    """
    problem, i, angles, shape = cylinder(name)
    limits, random, n = cylinder_constraints(problem, i), np.random.default_rng(5), len(angles) + 2
    assert limits is not None
    weight, bend = (
        np.concatenate([[0, 0], random.uniform(size=n - 2)]),
        np.concatenate([[0, 0], random.normal(size=n - 2)]),
    )
    dead = problem.vector.areas_today[i] * problem.machine.cylinders[i].stroke * 0.3
    share = CylinderTerm(
        shape=shape, limits=limits, weight=weight, bend=interval(1e-3 * bend), price=np.zeros(2),
        dead=dead,
        hoses=np.zeros(2),
    )  # fmt: skip
    volume = (
        problem.vector.areas_today[i]
        * problem.machine.cylinders[i].stroke
        * random.uniform(0.5, 1.5, (5, 2))
    )[None]
    # off the telescope's axis
    at = coordinates(problem, i, shape, problem.vector.start)[:2] + 0.05 * (shape.high - shape.low)

    def value(b: np.ndarray) -> np.ndarray:
        return share.enclosed(shape.enclose(b[None], b[None]), volume, share.price[None])[0][0]

    steps = 1e-5 * (shape.high - shape.low)
    slopes = [(value(at + step) - value(at - step)) / (2 * step.sum()) for step in np.diag(steps)]
    found = share.slopes(shape.enclose(at[None], at[None]), volume, (1.0, 1.0))[0][0]
    np.testing.assert_allclose(found, np.abs(slopes).T, atol=1e-6 * np.abs(found).max())
