"""Modes that cross at the optimum: it is a kink, which no single gradient sees."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import armdesign as ad
from armdesign import Machine, Requirements, Workspace
from armdesign.design.program.constraints import constraints_at
from armdesign.design.program.problem import Problem
from armdesign.design.search.sequential_sdp import Search
from armdesign.frequency.modes import hertz
from tests.design.designs import as_machine
from tests.machines import ANY_LIFT_AND_TORQUE, BOOM, CylinderSpec, Joint, build


@cache
def arms_apart() -> Machine:
    """Two arms on one root that do not feel each other, a cylinder each: two modes, one for each
    arm.
    """
    other = replace(BOOM, name="mast", xyz=(-0.6, 0.2, 0.5), mass=350, com=(1.0, 0, 0.3))
    stay = CylinderSpec(
        "stay", ("root", (0.1, 0.2, 0.1)), ("mast", (1.0, 0, 0.35)), bore_mm=90, rod_mm=56
    )
    lift = CylinderSpec("lift", ("root", (0.7, 0, 0.1)), ("boom", (1.1, 0, 0.4)))
    joints: list[Joint] = [BOOM, other]
    return build(joints, [lift, stay], payload=("boom", (1.3, 0.0, 0.0)), payload_kg=30)


def twin_problem() -> Problem:
    machine = arms_apart()
    any_areas = {"oil_each_share": 1.6, "thrust_share": 1.6, "holding_share": 5.0}
    requirements = Requirements(**any_areas, **ANY_LIFT_AND_TORQUE)
    space = Workspace.grid(machine, points=5)
    return Problem.of(machine=machine, workspace=space, requirements=requirements, vary=("areas",))


@pytest.mark.slow
def test_modes_that_coincide_at_the_optimum() -> None:
    """Oil moves from one arm to the other until the two lowest modes are one: a kink where neither
    gradient is zero.

    Brute force: all areas of either arm on a grid; of the second the best that the oil left by the
    first allows.
    """
    problem = twin_problem()
    search = Search(problem=problem, x=problem.vector.start).run(trust=0.3, tolerance=1e-8)
    poses = as_machine(problem, search.x).evaluate(problem.workspace.rigid)
    frequencies = ad.natural_modes(poses).frequencies
    lowest = frequencies[frequencies[:, 1].argmin()]  # where both arms stand worst
    assert lowest[1] == pytest.approx(lowest[0], rel=1e-4)
    assert hertz(search.squared) == pytest.approx(lowest[0], rel=1e-9)
    today = ad.natural_modes(arms_apart().evaluate(problem.workspace.rigid)).frequencies
    assert today[:, 1].min() > 1.05 * today[:, 0].min()  # and they did not coincide before
    best = best_on_grid(problem, search.holding, np.linspace(0.8, 1.3, 31))
    assert best > 1.02 * problem.dynamics.omega_squared(problem.vector.start).min()
    assert search.squared > best * (1 - 1e-6)
    assert search.squared == pytest.approx(best, rel=0.035)  # the grid's step is 1.7 % of an area


def best_on_grid(problem: Problem, holding: np.ndarray, grid: np.ndarray) -> float:
    """Largest lowest ω² of two arms that share only the oil, bore and annulus areas of both on a
    grid.
    """
    names, every = (
        [c.name for c in problem.machine.cylinders],
        np.arange(len(problem.dynamics.rows)),
    )
    # lowest ω² of one arm, 0 where one of its own limits forbids it
    own = np.zeros((2, len(grid), len(grid)))
    for i, name in enumerate(names):
        for k, cap in enumerate(grid):
            for j, annulus in enumerate(grid):
                x = problem.vector.start.copy()
                x[2 * i : 2 * i + 2] = cap, annulus
                limits = constraints_at(problem, x, holding)
                own_limits = np.array([label.endswith(f".{name}") for label in limits.names])
                if limits.values[own_limits].min() >= -1e-9:
                    own[i, k, j] = problem.dynamics.scaled_stiffness(x, every)[:, i, i].min()
    reachable = np.maximum.accumulate(np.maximum.accumulate(own[1], axis=0), axis=1)
    oil = problem.vector.areas_today * np.array([[c.stroke] for c in problem.machine.cylinders])
    # share of today's that the second arm may have, of either side
    left = 1 + (1 - grid)[:, None] * oil[0] / oil[1]
    most = np.searchsorted(grid, left + 1e-12, side="right") - 1
    pairs = [
        (k, j)
        for k in range(len(grid))
        for j in range(len(grid))
        if min(most[k, 0], most[j, 1]) >= 0
    ]
    return max(min(own[0, k, j], reachable[most[k, 0], most[j, 1]]) for k, j in pairs)


def test_the_kink_is_the_optimum_along_every_direction() -> None:
    """At a double eigenvalue a single gradient misleads: along each mode's own gradient the other
    one falls.
    """
    problem = twin_problem()
    search = Search(problem=problem, x=problem.vector.start).run(trust=0.3, tolerance=1e-8)
    worst = np.array([int(problem.dynamics.omega_squared(search.x).argmin())])
    base, slope = problem.dynamics.scaled_stiffness_and_gradient(search.x, worst)
    _, vectors = np.linalg.eigh(base[0])
    for mode in range(2):
        gradient = np.einsum("i,vij,j->v", vectors[:, mode], slope[:, 0], vectors[:, mode])
        for size in (1e-3, 1e-2):
            x = search.x + size * gradient / np.abs(gradient).max()
            better = problem.dynamics.omega_squared(x).min() > search.squared * (1 + 1e-6)
            assert not better or constraints_at(problem, x).values.min() < -1e-7
