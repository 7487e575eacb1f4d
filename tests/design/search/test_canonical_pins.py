"""Canonical pins: equal designs have the same pins, whatever the start."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from armdesign import Requirements, Workspace
from armdesign.design.program.constraints import constraints_at
from armdesign.design.program.problem import Problem
from armdesign.design.search.canonical_pins import least_moved_pins
from armdesign.design.search.sequential_sdp import Search
from tests.design.designs import double, problem_of, solved, some_x


def test_pins_turned_together_are_an_equal_design() -> None:
    """The triangle of joint, base and rod end stays: every limit and frequency to rounding; moves
    are smaller.
    """
    problem = problem_of("excavator", ("areas", "linkages"))
    x = some_x(problem, 7, 0.4)
    y = least_moved_pins(problem, x)
    moving = np.array([v.pin is not None for v in problem.vector.variables])
    assert np.abs(x - y).max() > 0.01
    assert np.all(x[~moving] == y[~moving])
    assert np.sum(y[moving] ** 2) < np.sum(x[moving] ** 2)
    assert_allclose(
        problem.dynamics.omega_squared(y), problem.dynamics.omega_squared(x), rtol=1e-10
    )
    holding = np.arange(0, len(problem.dynamics.rows), 7)
    one, other = (constraints_at(problem, z, holding).values for z in (x, y))
    assert_allclose(one, other, atol=1e-10)
    assert_allclose(least_moved_pins(problem, y), y, atol=1e-9)


def test_least_moved_pins_stay_in_the_box() -> None:
    problem = problem_of("excavator")
    for seed in range(20):
        x = some_x(problem, seed, 1.0)
        moving = np.array([v.pin is not None for v in problem.vector.variables])
        assert np.abs(least_moved_pins(problem, x)[moving]).max() <= 1 + 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_answer_does_not_depend_on_the_start(seed: int) -> None:
    """From today's machine and from drawn pins: the same frequency, areas and pins to a tenth of a
    millimetre.
    """
    problem = problem_of("excavator")
    x = problem.vector.start.copy()
    moving = np.array([v.pin is not None for v in problem.vector.variables])
    x[moving] = np.random.default_rng(seed).uniform(-0.7, 0.7, moving.sum())
    searches = [
        Search(problem=problem, x=start).run(trust=0.2, tolerance=1e-7)
        for start in (problem.vector.start, x)
    ]
    one, other = (least_moved_pins(problem, s.x) for s in searches)
    assert searches[0].squared == pytest.approx(searches[1].squared, rel=1e-6)
    assert_allclose(one[~moving], other[~moving], atol=1e-3)
    assert np.abs(one - other)[moving].max() * problem.vector.pin_box < 2e-4


@pytest.mark.slow
def test_order_of_cylinders_does_not_matter_for_pins() -> None:
    """The same machine written the other way round has the same pins."""
    pins = []
    for reverse in (False, True):
        machine = double(reverse)
        space = Workspace.grid(machine, points=5)
        problem = Problem.of(
            machine=machine, workspace=space, requirements=Requirements(), vary=("areas", "pins")
        )
        search = solved(problem, 1e-8)
        pins_by_name = dict(
            zip(
                [c.name for c in machine.cylinders],
                problem.vector.linkages(least_moved_pins(problem, search.x)),
                strict=True,
            )
        )
        pins.append(
            [
                pins_by_name[name].place(pin)
                for name in ("lift", "fold")
                for pin in ("base", "rod_end")
            ]
        )
    assert_allclose(pins[0], pins[1], atol=5e-4)
