"""The bound on what can be built: above every machine on the drawing's grid, and near the best."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from armdesign import Machine, Requirements, Workspace
from armdesign.design.bound.certificate import certificate_of
from armdesign.design.bound.columns import joint_drives
from armdesign.design.bound.drawn_lengths import DrawnLengths, largest
from armdesign.design.catalogue.alternation import with_sizes
from armdesign.design.catalogue.sizes import BUILDABLE, Sizes
from armdesign.design.program.problem import Problem
from armdesign.design.requirements.candidate import peak
from armdesign.design.requirements.check import check
from armdesign.design.requirements.places import Outline
from armdesign.units import mm
from tests.design.designs import solved
from tests.machines import ANY_LIFT_AND_TORQUE, named

SIZES: Sizes = ((61 * mm, 36 * mm), (64 * mm, 36 * mm))
BOX = 6  # [mm] that a coordinate may move


def one_cylinder(pin: str, **limits: object) -> Problem:
    """The paper's mechanism with one free pin, and sizes of a catalogue."""
    machine = named("paper_1dof")
    some = {**ANY_LIFT_AND_TORQUE, "pin_box": BOX * mm, "oil_total_share": 1.05, **limits}
    problem = Problem.of(
        machine=machine,
        workspace=Workspace.grid(machine, points=(15,)),
        requirements=replace(Requirements.of(machine), **some),
        vary=("areas", f"cylinder.lift.{pin}"),
    )
    return replace(problem, grid=replace(BUILDABLE, sizes=SIZES))


def drawn(problem: Problem) -> DrawnLengths:
    """Grid of the only cylinder's lengths."""
    (drive,) = joint_drives(problem, drawn=True)
    assert drive.limits.drawn is not None
    return drive.limits.drawn


def built_machines(problem: Problem, pin: str) -> Iterator[tuple[Machine, Machine]]:
    """Every machine with the pin on whole millimetres of its box and sizes of the catalogue.

    With the longest closed length on the grid and the stroke for it, or today's where the pin
    stays; and beside each the same with lengths that just fit, on no grid.
    """
    today = problem.machine
    (poses,) = problem.vector.range_poses
    assert poses is not None
    at = np.array(today.linkages[0].place(pin)) / mm
    for x, z in itertools.product(range(-BOX, BOX + 1), repeat=2):
        new = (at + np.array([x, 0, z])).tolist()  # today's are whole
        placed = today.replace({f"cylinder.lift.{pin}.at_mm": new})
        length = placed.linkages[0].length(poses) / mm
        closed = np.floor(length.min() + 1e-6)
        lengths = closed, 5 * np.ceil((length.max() - closed) / 5 - 1e-6)
        if x == z == 0:
            lengths = today.cylinders[0].closed_length / mm, today.cylinders[0].stroke / mm
        for size in SIZES:
            built, fitting = (
                placed.replace({f"cylinder.lift.{k}_mm": float(v) for k, v in zip(
                    ("bore", "rod", "closed_length", "stroke"), [*np.divide(size, mm), *own],
                    strict=True,
                )})
                for own in (lengths, (length.min(), np.ptp(length)))
            )  # fmt: skip
            yield built, fitting


@pytest.mark.slow
@pytest.mark.parametrize(("pin", "torque"), [("base", 0.0), ("rod_end", 0.9)])
def test_no_built_machine_exceeds_the_bound(pin: str, torque: float) -> None:
    """Every one of a small box, judged by ``check`` and its own frequency. The best of those that
    are allowed is below the bound, which takes no oil for strokes beyond the joint's range: with
    lengths that just fit the best is as good to 0.1 %. The bound for any lengths is above.
    """
    problem = one_cylinder(pin, torque_share=torque)
    given = problem.machine, problem.workspace, problem.requirements
    reached = [
        [problem.dynamics.corners.judged(one) for one in both]
        for both in built_machines(problem, pin)
        if all(c.slack >= -1e-9 for c in check(both[0], *given))
    ]
    built, fitting = np.max(reached, axis=0)
    search = with_sizes(solved(replace(problem, grid=replace(BUILDABLE, sizes=()))), SIZES)
    of_built, of_any = (
        certificate_of(problem, search.x, search.rows, fitting, one) for one in (True, False)
    )
    assert of_built is not None
    assert of_any is not None
    assert built * (1 - 1e-9) <= fitting * (1 - 1e-9) <= of_built.frequency < fitting * 1.001
    assert of_built.frequency < of_any.frequency * 0.999  # steps cost
    assert of_built.assumptions[-1] == "sizes of the catalogue, lengths on the drawing's grid"


def test_lengths_on_the_grid() -> None:
    """By hand: closed lengths are whole millimetres, strokes fives; today's 422.015 and 198.5 only
    where pins stay.
    """
    grid = replace(drawn(one_cylinder("base")), today=(0.422015325, 0.1985))
    closed = grid.closed(np.array([0.4199, 0.4215, 0.4221, 0.4221]), np.array([1, 1, 1, 0]) > 0)
    np.testing.assert_allclose(closed, [0.419, 0.421, 0.422015325, 0.422], atol=1e-12)
    stays, moved = np.full(2, True), np.full(2, False)
    # a closed length of 420 leaves 620.3 − 420 = 200.3, of 421 but 199.3
    ends = np.array([0.4209, 0.421]), np.full(2, 0.6203)
    built = grid.built(np.full(2, 0.1993), *ends, stays)
    np.testing.assert_allclose(built, [0.205, 0.2], atol=1e-12)
    ends = np.full(2, 0.42), np.array([0.6163, 0.6187])
    for where, expected in ((stays, [0.1985, 0.2]), (moved, [0.2, 0.2])):
        short = grid.built(np.array([0.1963, 0.1987]), *ends, where)
        np.testing.assert_allclose(short, expected, atol=1e-12)
    np.testing.assert_allclose(grid.fitting(np.array([0.1984, 0.199, 0.2])), [0.195, 0.1985, 0.2])
    part = grid.between(0.2025, 0.2125)
    assert (part.least, part.most) == pytest.approx((0.205, 0.21))
    one = (np.array([length]) for length in (0.1, 0.42, 0.52))
    assert part.built(*one, stays[:1]) == pytest.approx(0.205)


def test_places_of_a_pin() -> None:
    """By hand: of today's pin at x 0.4 and z −0.3 mm whole millimetres or no move; boxes without
    one are empty; the nearest place is within the region.
    """
    grid = replace(drawn(one_cylinder("base")), pin=np.array([0.4, -0.3]) * mm)
    low, high = np.array([[-1.5, -1.5], [0.1, -0.1]]) * mm, np.array([[1.5, 1.5], [0.5, 0.2]]) * mm
    first, last = grid.shrunk(low, high)
    np.testing.assert_allclose(first[0] / mm, [-1.4, -0.7], atol=1e-9)
    np.testing.assert_allclose(last[0] / mm, [0.6, 1.3], atol=1e-9)
    assert first[1, 0] > last[1, 0]  # between no move and 1 mm
    assert (first[1, 1], last[1, 1]) == (0.0, 0.0)
    near = grid.nearest(np.array([[0.9, 5.0]]) * mm, low[0], high[0])
    np.testing.assert_allclose(near / mm, [[0.6, 1.3]], atol=1e-9)
    free = replace(grid, pin=None)
    assert free.shrunk(low, high) == (low, high)


def test_outlines_hold_a_pin() -> None:
    """By hand: within a square of 10 mm by a radius of 3 mm, boxes that reach it are kept."""
    square = ((0.0, 0.0), (10 * mm, 0.0), (10 * mm, 10 * mm), (0.0, 10 * mm))
    outline = Outline(link="base", points=square, pin_radius=3 * mm)
    grid = replace(drawn(one_cylinder("base")), pin=np.zeros(2), outlines=(outline,))
    low = np.array([[5.0, 5.0], [2.0, 5.0], [1.0, 4.0], [-9.0, 5.0]]) * mm
    high = np.array([[5.0, 5.0], [2.0, 5.0], [3.0, 6.0], [-8.0, 5.0]]) * mm
    assert grid.held(low, high).tolist() == [True, False, True, False]


def test_largest_as_the_requirements_take_it() -> None:
    """The peak by a parabola of the requirements' own formula, also at an end."""
    values = np.array([[1.0, 3.0, 2.5, 0.0], [4.0, 3.0, 2.0, 1.0], [0.0, 1.0, 2.0, 2.1]])
    for row in values:
        expected = peak(np.arange(4), row[None])[1]
        np.testing.assert_allclose(largest(row[None]), expected, rtol=1e-14)
