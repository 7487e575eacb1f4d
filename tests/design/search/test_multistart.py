"""Starts of a search: how many, which failed and why; a search ends at an optimum, not at a box of
its own.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import armdesign as ad
from armdesign import Requirements, Workspace
from armdesign.design.program.constraints import constraints_at
from armdesign.design.program.dynamics import Dynamics
from armdesign.design.program.problem import Problem
from armdesign.design.search import multistart as module
from armdesign.design.search.multistart import follow, follow_all, multistart, start_designs
from armdesign.design.search.semidefinite import programme
from armdesign.design.search.sequential_sdp import Search
from armdesign.design.search.slsqp import improve_by_slsqp
from armdesign.errors import InfeasibleError
from armdesign.frequency.modes import hertz
from armdesign.report.designs import design_sheets, notes_on_starts
from tests.design.designs import problem_of
from tests.machines import named


def coarse(name: str, vary: tuple[str, ...]) -> Problem:
    machine = named(name)
    workspace = Workspace.grid(machine, points=(3, 3, 5))
    return Problem.of(
        machine=machine, workspace=workspace, requirements=Requirements.of(machine), vary=vary
    )


@pytest.fixture
def only_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    """Searches stay where they start."""

    monkeypatch.setattr(Search, "run", lambda search, **_: search.look())
    monkeypatch.setattr(module, "improve_by_slsqp", lambda search: search)
    monkeypatch.setattr(module, "with_least_moved_pins", lambda search: search)


@pytest.mark.usefixtures("only_looked_at")
@pytest.mark.parametrize(
    ("vary", "count"),
    [
        (("areas", "pins"), 3),
        pytest.param(("linkages",), 4, marks=pytest.mark.slow),
        (("areas",), 1),
    ],
)
def test_more_starts_where_four_bars_move(vary: tuple[str, ...], count: int) -> None:
    """Unless told otherwise; every one of them reached something or failed."""
    problem = coarse("excavator_20t", vary)
    for starts_given, expected in ((None, count), (2, min(count, 2))):
        starts = multistart(problem, starts_given, 0, 1)[1]
        assert len(starts.reached) + len(starts.failed) == expected


@pytest.mark.slow
@pytest.mark.parametrize("name", ["mini_excavator_2t", "excavator_20t"])
def test_of_starts_near_one_optimum_one_is_searched_to_the_end(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It ends where the best of all of them ends, and fewer are searched."""
    problem, counts = coarse(name, ("linkages",)), []

    def counted(searches: list[Search], *others: Any, **settings: Any) -> list[Search]:
        counts.append(len(searches))
        return follow_all(searches, *others, **settings)

    monkeypatch.setattr(module, "follow_all", counted)
    one = multistart(problem, None, 0, 1)[0]
    monkeypatch.setattr(module, "of_other_shapes", lambda _, designs: list(range(len(designs))))
    every = multistart(problem, None, 0, 1)[0]
    assert one.merit == pytest.approx(every.merit, abs=2e-5)
    assert counts[1] < counts[3]


def test_a_seed_below_zero_is_refused() -> None:
    machine = named("paper_1dof")
    for search in (ad.optimize, ad.steps):
        with pytest.raises(ad.ArmDesignError, match="seed: -1 is not allowed; give a whole"):
            search(machine, Workspace.grid(machine, points=3), seed=-1)


@pytest.mark.slow
@pytest.mark.usefixtures("only_looked_at")
def test_a_start_that_fails_is_named() -> None:
    """Left where they are drawn, starts miss requirements: each says which, and none of them says
    0 Hz.
    """
    problem = coarse("excavator_20t", ("linkages",))
    best, starts = multistart(problem, 4, 0, 1)
    assert starts.reached == (hertz(problem.dynamics.omega_squared_today),)
    assert hertz(best.squared) == starts.reached[0]
    assert len(starts.failed) == 3
    x = start_designs(problem, 4, 0)[1]
    assert problem.vector.closes(x)
    at = constraints_at(problem, x)
    assert at.names[int(at.values.argmin())] in starts.failed[0]


@pytest.mark.slow
def test_failed_starts_are_printed_once_for_every_reason() -> None:
    design = ad.optimize(
        named("paper_1dof"), Workspace.grid(named("paper_1dof"), points=5), starts=1
    )
    why = "no way found to meet moment_arm.lift"
    some = replace(design, starts=(7.5, 7.4), failed_starts=(why, why, "the arm gives way"))
    words = f"starts reached 7.500, 7.400 Hz; 3 of 5 starts failed: {why}; the arm gives way"
    assert design_sheets(some)[0].note.endswith(words)
    assert notes_on_starts(design) == ""
    assert (
        notes_on_starts(replace(design, starts=(), failed_starts=(why, why)))
        == f"; 2 of 2 starts failed: {why}"
    )


# ------------------------------------------------------------------------------------ not a number


def test_what_is_not_a_number_is_missed_and_has_no_merit() -> None:
    """A requirement that is not a number is not met; other searches are compared as if this one
    were not.
    """
    search = Search(problem=problem_of("single"), x=problem_of("single").vector.start)
    search.look()
    values = search.limits.values.copy()
    values[2] = np.nan
    search.limits = replace(search.limits, values=values)
    assert search.violation == math.inf
    assert search.merit == -math.inf
    assert search.missed[0] == search.limits.names[2]


def test_a_search_at_a_dead_centre_ends_without_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """Stiffness that is not a number gives no step: the search stays where it is."""
    problem = problem_of("single")
    true = Dynamics.scaled_stiffness_and_gradient

    def dead(self: Dynamics, *args: Any) -> tuple[np.ndarray, np.ndarray]:
        base, slopes = true(self, *args)
        return base * np.nan, slopes

    monkeypatch.setattr(Dynamics, "scaled_stiffness_and_gradient", dead)
    search = Search(problem=problem, x=problem.vector.start).run(trust=0.2)
    assert search.x == pytest.approx(problem.vector.start)
    monkeypatch.undo()
    base, slopes = problem.dynamics.scaled_stiffness_and_gradient(
        problem.vector.start, np.arange(2)
    )
    step = programme(2, 1, 1, len(problem.vector.start))
    ends = np.zeros(len(problem.vector.start))
    with pytest.raises(InfeasibleError, match="not finite"):
        step.solve(base, slopes * np.inf, np.ones(1), np.zeros((1, len(ends))), ends, ends)


# ----------------------------------------------------------------------------------------- the end


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "vary"),
    [("excavator_20t", ("linkages",)), ("mini_excavator_2t", ("cylinder.bucket",))],
)
def test_slsqp_ends_where_nothing_is_better(name: str, vary: tuple[str, ...]) -> None:
    """An optimum stays where it is: searched once more along what bends, it gains nothing."""
    problem = coarse(name, vary)
    search = Search(problem=problem, x=problem.vector.start).run(
        trust=0.2, tolerance=2e-3, looks=3
    )
    search = follow(search, curved=True, trust=0.05, tolerance=1e-5)
    assert improve_by_slsqp(search).merit < search.merit + 1e-4


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "vary", "points", "best"),
    [
        ("rigid_excavator_20t", ("cylinder.bucket",), (3, 3, 5), 0.9312),
        ("rigid_mini_excavator_2t", ("areas", "linkages"), (4, 4, 5), 5.474),
        ("mini_excavator_2t", ("areas", "linkages"), (4, 4, 5), 3.731),
    ],
)
def test_seeds_agree_where_four_bars_move(
    name: str, vary: tuple[str, ...], points: tuple[int, ...], best: float
) -> None:
    """Whatever is drawn, to 0.06 %; and none of 24 starts with drawn four-bars ends higher.

    The rigid mini excavator has an optimum at 5.474 Hz, where the bucket's moment arm falls over
    its range, in which one of these ends, and others up to 5.433 Hz, where it has a hump. As
    shipped, its structure yielding, 9 end at 3.731 Hz and 12 at 3.697 Hz.
    """
    machine = named(name)
    problem = Problem.of(
        machine=machine,
        workspace=Workspace.grid(machine, points),
        requirements=Requirements.of(machine),
        vary=vary,
    )
    reached = [hertz(multistart(problem, None, seed, 1)[0].squared) for seed in (0, 1, 5)]
    assert reached == pytest.approx([best] * 3, rel=6e-4)
