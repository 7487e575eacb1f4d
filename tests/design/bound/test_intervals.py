"""Intervals hold what they say: arithmetic, triangles of pins, shapes and shares of cylinders, all
against samples.
"""

from __future__ import annotations

import operator
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armdesign import Requirements, Workspace, load
from armdesign.design.bound.cylinder_constraints import cylinder_constraints
from armdesign.design.bound.cylinder_shape import Shape, coordinates, shape_of
from armdesign.design.bound.cylinder_term import CylinderTerm
from armdesign.design.bound.intervals import Interval, interval
from armdesign.design.program.problem import Problem
from armdesign.mechanism.joint_ranges import sweep

ROUNDING = 1e-9  # what bound.py allows for
numbers = st.floats(-5, 5)
shares = st.floats(0, 1)


@given(*[numbers] * 4, shares, shares)
def test_arithmetic_holds_samples(
    a: float, b: float, c: float, d: float, u: float, v: float
) -> None:
    """Every result of numbers from two intervals lies in the interval of results; 1e-12:
    rounding.
    """
    x, y = (Interval(np.array([min(e)]), np.array([max(e)])) for e in ((a, b), (c, d)))
    p, q = x.low + u * (x.high - x.low), y.low + v * (y.high - y.low)

    def holds(whole: Interval, part: np.ndarray) -> bool:
        return bool(np.all((whole.low <= part + 1e-12) & (part <= whole.high + 1e-12)))

    for operation in (operator.add, operator.sub, operator.mul):
        assert holds(operation(x, y), operation(p, q))
        assert holds(operation(x, q), operation(p, q))
    assert holds(2.0 - x, 2.0 - p)
    assert holds(x.square(), p**2)
    assert holds(x.above(0.5), np.maximum(p, 0.5))
    positive, number = x.square() + 0.1, p**2 + 0.1
    assert holds(positive.reciprocal(), 1 / number)
    assert holds(positive.sqrt(), np.sqrt(number))
    assert x.size >= abs(p) - 1e-12


def shipped_problem(name: str) -> Problem:
    machine = load(name)
    workspace = Workspace.grid(machine, points=[3] * len(machine.joints))
    return Problem.of(
        machine=machine,
        workspace=workspace,
        requirements=Requirements.of(machine),
        vary=("areas", "pins"),
    )


CYLINDERS = {
    "boom": ("excavator_20t", 0),
    "stick": ("excavator_20t", 1),
    "bucket": ("excavator_20t", 2),  # four-bar: its base pin moves
    "telescope": ("loader_crane", 2),  # along its slide
    "lift": ("patu_boom", 0),
}


@cache
def cylinder(name: str) -> tuple[Problem, int, np.ndarray, Shape]:
    machine, i = CYLINDERS[name]
    problem = shipped_problem(machine)
    angles = np.linspace(*problem.machine.ranges[problem.machine.linkages[i].joints[0]], 6)
    shape = shape_of(problem, i, angles)
    assert shape is not None
    return problem, i, angles, shape


def box_around(
    point: np.ndarray, shape: Shape, width: np.ndarray, place: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """A box (1, 3) of shares ``width`` of the region, with the point at shares ``place`` of it."""
    low, high = shape.region
    size = width * (high - low)
    return (point - place * size)[None], (point + (1 - place) * size)[None]


box_shares = st.lists(shares, min_size=3, max_size=3)
designs = st.integers(0, 10**6)


def some_design(problem: Problem, seed: int) -> np.ndarray:
    """Any pins in their boxes, often at corners; any areas."""
    random = np.random.default_rng(seed)
    low, high = problem.bounds
    x = random.uniform(low, high)
    pins = np.array([v.pin is not None for v in problem.vector.variables])
    return np.where(
        pins & (random.uniform(size=len(x)) < 0.3),
        np.sign(x),
        np.where(pins, x, random.uniform(0.5, 1.1)),
    )


@pytest.mark.parametrize("name", CYLINDERS)
@settings(max_examples=80)
@given(seed=designs, width=box_shares, place=box_shares)
def test_shapes_hold_lengths_arms_and_bends(
    name: str, seed: int, width: list[float], place: list[float]
) -> None:
    """ℓ, r and H by ``Linkage.actuation`` at random pins lie within the enclosures of boxes around
    them.
    """
    problem, i, angles, shape = cylinder(name)
    x = some_design(problem, seed)
    joint = problem.machine.linkages[i].joints[0]
    exact = problem.vector.linkages(x)[i].actuation(sweep(problem.machine.arm, joint, angles))
    length, arm = exact.length, exact.moment_arm[:, joint]
    if (arm * shape.sign).min() < 1e-3:
        return  # not a cylinder that works
    at = coordinates(problem, i, shape, x)
    assert np.all(at >= shape.region[0] - ROUNDING)
    assert np.all(at <= shape.region[1] + ROUNDING)
    low, high = box_around(at, shape, np.array(width) * 0.2, np.array(place))
    e, scale = shape.enclose(low[:, :2], high[:, :2]), at[2]
    stroke = np.ptp(length)
    for part, value in (
        (e.wide.arm[:, 2:], arm / scale),
        (e.wide.closed, length[[length.argmin()]] / scale),
        (e.wide.open, length[[length.argmax()]] / scale),
        (e.stroke, np.array([stroke / scale])),
        (e.place[:, 2:], (length - length.min()) / stroke),
        (e.rate[:, 2:], arm / stroke),
        (e.bend[:, 2:], exact.moment_arm_derivative[:, joint, joint] / arm),
    ):
        slack = ROUNDING * np.maximum(1.0, np.abs(value))
        assert np.all(part.low <= value + slack)
        assert np.all(part.high >= value - slack)


@pytest.mark.parametrize("name", ["boom", "stick", "lift"])
@settings(max_examples=80)
@given(seed=designs, width=box_shares, place=box_shares)
def test_no_triangle_of_pins_in_their_boxes_is_refused(
    name: str, seed: int, width: list[float], place: list[float]
) -> None:
    """Also those with pins at corners: the scale of the design is among those left of any box
    around it.
    """
    problem, i, _, shape = cylinder(name)
    at = coordinates(problem, i, shape, some_design(problem, seed))
    low, high = box_around(at, shape, np.array(width) * 0.3, np.array(place))
    assert shape.pin_boxes is not None
    left = shape.pin_boxes.scales(low[:, :2], high[:, :2], Interval(low[:, 2], high[:, 2]))
    assert left.low[0] <= at[2] + ROUNDING
    assert left.high[0] >= at[2] - ROUNDING


@pytest.mark.parametrize("name", ["boom", "stick", "lift"])
def test_triangles_are_refused_only_where_no_turn_fits_both_pins(name: str) -> None:
    """Points all over the region, as boxes of no width, against turning each triangle about its
    joint in fine steps.
    """
    shape = cylinder(name)[3]
    assert shape.pin_boxes is not None
    points = np.random.default_rng(3).uniform(*shape.region, (300, 3))
    left = shape.pin_boxes.scales(
        points[:, :2], points[:, :2], Interval(points[:, 2], points[:, 2])
    )
    turns = np.exp(1j * np.linspace(-np.pi, np.pi, 20_001))
    fits = left.low <= left.high
    assert 0 < fits.sum() < len(points)
    for at, fit in zip(points, fits, strict=True):
        out = np.zeros(len(turns))
        base = at[2] * complex(*at[:2]) * turns
        for pin, (low, high) in (
            (at[2] * turns, shape.pin_boxes.rod_end),
            (base, shape.pin_boxes.base),
        ):
            for part, a, b in ((pin.real, low[0], high[0]), (pin.imag, low[1], high[1])):
                out = np.maximum(out, np.maximum(a - part, part - b))
        assert out.min() < 2e-3 if fit else out.min() > 0  # [m]: a step of the turns


@pytest.mark.parametrize("name", CYLINDERS)
@settings(max_examples=80)
@given(seed=designs, width=box_shares, place=box_shares)
def test_shares_hold_stiffness(
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
def test_slopes_of_a_share_are_its_derivatives(name: str) -> None:
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
    found = share._slopes(shape.enclose(at[None], at[None]), volume, (1.0, 1.0))[0][0]
    np.testing.assert_allclose(found, np.abs(slopes).T, atol=1e-6 * np.abs(found).max())
