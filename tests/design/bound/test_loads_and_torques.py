"""Lifts, torques, motors and parallel cylinders in the bound: what is allowed is never left out,
and what a single cylinder misses is.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from armdesign import Machine, Requirements, Workspace
from armdesign.design.bound.certificate import Certificate, certificate_of
from armdesign.design.bound.columns import joint_drives
from armdesign.design.bound.cylinder_constraints import (
    PEAK,
    CylinderConstraints,
    cylinder_constraints,
)
from armdesign.design.bound.cylinder_loads import Loads
from armdesign.design.bound.intervals import Interval
from armdesign.design.bound.shape_of_pins import coordinates
from armdesign.design.program.constraints import constraints_at, evaluations_at
from armdesign.design.program.problem import Problem
from armdesign.design.requirements.holding import Lift
from armdesign.design.search.sequential_sdp import Search
from armdesign.frequency.modes import hertz
from tests.design.designs import problem_of, solved
from tests.machines import BOOM, FOLD, LIFT, STICK, CylinderSpec, build, named

AT = ({"boom": 0.25, "stick": -0.2}, {"boom": -0.25, "stick": 0.2})


@cache
def lifting(share: float = 0.95, name: str = "double") -> Problem:
    """Two joints whose machine keeps a share of what it lifts today at two poses."""
    lifts = tuple(Lift(name=f"at_{k}", mass=1.0, joints=at) for k, at in enumerate(AT))
    problem = problem_of(name, lifts=lifts)
    now = {e.name: e.value[0].real for e in evaluations_at(problem, problem.vector.start)}
    masses = [float(now[f"lift.{lift.name}"].min()) * share for lift in lifts]
    kept = (replace(lift, mass=mass) for lift, mass in zip(lifts, masses, strict=True))
    return problem_of(name, lifts=tuple(kept))


def designs(problem: Problem, count: int, seed: int) -> list[np.ndarray]:
    """Any pins and areas around today's."""
    random, (low, high) = np.random.default_rng(seed), problem.bounds
    pins = np.array([v.pin is not None for v in problem.vector.variables])
    return [
        np.where(
            pins, random.uniform(low, high) * random.uniform(), random.uniform(0.8, 1.1, len(low))
        )
        for _ in range(count)
    ]


def let_pass(problem: Problem, i: int, x: np.ndarray) -> bool:
    """Whether the bound lets cylinder ``i`` of x pass, as a box of no width."""
    limits = cylinder_constraints(problem, i)
    assert limits is not None
    areas, stroke = problem.vector.areas(x)[i], problem.vector.strokes(x)[1][i]
    box = np.append(coordinates(problem, i, limits.shape, x), areas * stroke)[None]
    # coordinates are what the design is made from, but for rounding
    width = 1e-9 * np.abs(box)
    return len(limits.allowed(box - width, box + width).kept) > 0


def of_cylinder(problem: Problem, x: np.ndarray, i: int, names: tuple[str, ...]) -> float:
    """The least slack of cylinder ``i`` in requirements whose names begin like these."""
    name, least = problem.machine.cylinders[i].name, np.inf
    for e in evaluations_at(problem, x):
        values = e.constraint[0].real
        if e.name.startswith("lift.") and "lift." in names:
            least = min(least, float(values[i]))
        elif e.name.startswith(names) and e.name.endswith(f".{name}"):
            least = min(least, float(values.min()))
    return least


KEPT: dict[str, tuple[dict[str, Any], tuple[str, ...]]] = {
    "lifts": ({}, ("lift.",)),
    "relieved_lifts": ({}, ("lift.",)),
    "lift_chart": ({"lift_share": 0.98}, ("lift_share.",)),
    "torques": ({"torque_share": 0.97}, ("torque.",)),
    "end_torques": ({"end_torque_share": 0.9}, ("end_torque.",)),
}


def kept_by(kind: str) -> Problem:
    """Two joints that keep something of today's, one with a relief below supply pressure."""
    if kind.endswith("lifts"):
        return lifting(name="relieved" if kind == "relieved_lifts" else "double")
    return problem_of("double", **KEPT[kind][0])


@pytest.mark.slow
@pytest.mark.parametrize("kind", KEPT)
def test_limits_of_single_cylinders(kind: str) -> None:
    """By the requirements' own formulas: designs that meet all pass, and of those that miss one
    by more than the bound gives away none does.
    """
    problem, names = kept_by(kind), KEPT[kind][1]
    passed = missed = 0
    for x in designs(problem, 400, 3):
        allowed = constraints_at(problem, x).values.min() >= 0
        for i in range(2):
            slack = of_cylinder(problem, x, i, names)
            if allowed:
                assert let_pass(problem, i, x)
                passed += 1
            elif slack < -2 * PEAK:
                assert not let_pass(problem, i, x)
                missed += 1
    assert passed >= 5
    assert missed >= 50


def test_of_several_poses_of_a_place_the_easiest_counts() -> None:
    """A place that two poses reach asks for the easier one, another place beside it for both."""
    loads = Loads(
        angle=np.zeros(3),
        held=np.array([[6.0, 8.0, 2.0], [0.0, 1.0, 3.0]]),
        place=np.array([0, 0, 1]),
    )
    size = np.array([[1.0, 2.0, 1.0], [3.0, 1.0, 0.5]]).T
    # by hand: min(6/1, 8/2) and 2/1; min(6/3, 8/1) and 2/0.5; pulling 0 and 3/1, 0 and 3/0.5
    np.testing.assert_array_equal(loads.most(size), [[4.0, 4.0], [3.0, 6.0]])


def test_loads_that_are_left_out_ask_for_less() -> None:
    """At any rates between the ends given, those that may be the greatest ask for as much as all
    do, in each box with its own and in all with all of them: ten places, some of two poses.
    """
    random = np.random.default_rng(0)
    place = np.repeat(np.arange(10), 1 + np.arange(10) % 2)
    n, left_out = len(place), 0
    for _ in range(50):
        held = random.uniform(1, 4, (2, n)) * (random.uniform(size=(2, n)) < 0.7)
        loads = Loads(angle=np.arange(n), held=held, place=place)
        low = random.uniform(1, 4, (n, 3))
        ends = Interval(low, low * random.uniform(1, 1.3, (n, 3)))
        greatest = loads.greatest(ends)
        rates = random.uniform(ends.low, ends.high)
        each = [(np.array([k]), few) for k, few in enumerate(greatest.T)]
        for boxes, few in [*each, (np.arange(3), greatest.any(axis=1))]:
            kept, own = np.flatnonzero(few), rates[:, boxes]
            np.testing.assert_array_equal(loads[kept].most(own[kept]), loads.most(own))
            np.testing.assert_array_equal(loads[kept].angle, loads.angle[kept])
            left_out += n - len(kept)
    assert left_out > 200


@pytest.mark.parametrize("kind", KEPT)
def test_angles_that_are_left_out_ask_for_less(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without them the same designs are allowed, with the same volumes."""
    problem = kept_by(kind)
    few = [cylinder_constraints(problem, i) for i in range(2)]
    monkeypatch.setattr(CylinderConstraints, "of_useful_angles", lambda limits: limits)
    for i, useful in enumerate(few):
        limits = cylinder_constraints(problem, i)
        assert limits is not None
        assert useful is not None
        assert len(useful.shape.constant) < len(limits.shape.constant)
        places = np.random.default_rng(i).uniform(*limits.shape.region, (4000, 3))
        ours, all_angles = useful.allowed(places, places), limits.allowed(places, places)
        assert len(ours.kept) > 20
        np.testing.assert_array_equal(ours.kept, all_angles.kept)
        np.testing.assert_allclose(ours.volume, all_angles.volume, rtol=1e-12)


@pytest.mark.parametrize("kind", KEPT)
def test_angles_that_do_not_count_in_a_box_change_nothing_in_it(kind: str) -> None:
    """With a box's own angles the same designs in it are allowed, with the same volumes."""
    problem = kept_by(kind)
    limits = cylinder_constraints(problem, 0)
    assert limits is not None
    low, high = limits.shape.cut((60, 60, 4))
    boxes, random, looked, angles = limits.allowed(low, high), np.random.default_rng(0), 0, []
    for k in random.permutation(len(boxes.kept))[:100]:
        box, useful = boxes.kept[k], boxes.useful[k]
        few = limits.at(np.flatnonzero(useful))
        places = random.uniform(low[box], high[box], (200, 3))
        ours, all_angles = few.allowed(places, places), limits.allowed(places, places)
        np.testing.assert_array_equal(ours.kept, all_angles.kept)
        np.testing.assert_allclose(ours.volume, all_angles.volume, rtol=1e-12)
        looked += len(ours.kept)
        angles.append(useful.sum())
    assert looked > 200
    assert np.mean(angles) < 0.5 * (len(limits.shape.constant) - 2)


def near_bound(search: Search, gap: float) -> Certificate:
    """The bound of a search's problem, asserted to be near and above the search's end."""
    bound = certificate_of(search.problem, search.x, search.rows)
    assert bound is not None
    assert bound.refused == ""
    assert hertz(search.squared) <= bound.frequency < hertz(search.squared) * (1 + gap)
    return bound


@cache
def parallel() -> Machine:
    """Two unlike cylinders on the boom, one on the stick."""
    support = CylinderSpec(
        "help", ("root", (-0.6, 0, 0.2)), ("boom", (0.3, 0, 0.8)), bore_mm=63, rod_mm=36
    )
    return build([BOOM, STICK], [LIFT, support, FOLD])


def posed(machine: Machine, points: int) -> Problem:
    return Problem.of(
        machine=machine,
        workspace=Workspace.grid(machine, points=[points] * len(machine.joints)),
        requirements=Requirements.of(machine),
        vary=("areas", "pins"),
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", ["parallel", "rotator"])
def test_parallel_cylinders_and_motors_are_known(name: str) -> None:
    """Above what is found and all designs drawn, by 10 % at most; nothing is taken as rigid but a
    cylinder with pins out of its joint's plane.
    """
    problem = posed(parallel(), 5) if name == "parallel" else posed(named("rotator"), 3)
    search = solved(problem, 1e-4)
    bound = near_bound(search, 0.10)
    assert bound.held == (() if name == "parallel" else ("tilt",))
    for x in designs(problem, 500, 2):
        if constraints_at(problem, x).values.min() >= 0:
            assert hertz(float(problem.dynamics.omega_squared(x).min())) <= bound.frequency


def test_a_joint_is_known_by_all_its_actuators() -> None:
    """Parallel cylinders count together; one that moves another joint too leaves both unknown."""
    assert [drive.partners for drive in joint_drives(posed(parallel(), 3))] == [2, 2, 1]
    assert joint_drives(posed(named("redundant"), 3)) == ()
