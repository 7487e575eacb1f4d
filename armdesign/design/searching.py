"""Searches from several starts, taken to their end: what ``optimize``, catalogues and the reverse question share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from armdesign.arrays import Array
from armdesign.bands import Bands
from armdesign.design.codesign import Search, hertz
from armdesign.design.elastic import Elastic
from armdesign.design.polishing import polish
from armdesign.design.problem import Problem
from armdesign.design.refusal import kept_within, refusal
from armdesign.design.requirements import Requirements
from armdesign.design.settling import settled
from armdesign.design.variables import chosen
from armdesign.machine import Machine
from armdesign.workspace import Workspace

STARTS = 3
MISSED = 1e-5  # by which a search may miss a requirement
EXACT = 1e-6  # share of what is missed that a step must promise, where a design that meets all is sought
NEARLY = 1e-3  # by which a search that is not at its end may miss one, and still meet it there
NEAR = 0.2  # of today's lowest ω²: starts that end this far below the best are left there


def posed(
    machine: Machine,
    workspace: Workspace | None,
    requirements: Requirements | None,
    vary: Sequence[str],
    proportional: bool = False,
    bands: Bands | None = None,
) -> Problem:
    """The design problem; where no workspace or requirements are given, the default grid and those of the file.

    Raises:
        ArmDesignError: a word or path of ``vary`` that names nothing that can vary; a requirement on what is not there.
    """
    chosen(machine, vary)
    requirements = requirements or Requirements.of(machine)
    requirements.refuse_unknown(machine)
    workspace = workspace or Workspace.grid(machine, end_margin=requirements.end_margin)
    return Problem(
        machine=machine,
        workspace=workspace,
        requirements=requirements,
        vary=tuple(vary),
        proportional=proportional,
        bands=bands or Bands(),
    )


def multistart(
    problem: Problem, starts: int, seed: int, workers: int, given: Array | None = None
) -> tuple[Search, tuple[float, ...]]:
    """The best of several starts, finished; and what each start reached [Hz].

    They are the one ``given``, if any, today's machine and random pins. Every start is followed roughly; those that
    come near the best are polished and finished.
    """
    random = np.random.default_rng(seed)
    moving = np.array([v.pin is not None for v in problem.variables])
    searches = [] if given is None else [Search(problem=problem, x=given)]
    for k in range((max(starts, 1) if problem.moving else 1) - len(searches)):
        x = problem.start.copy()
        x[moving] = random.uniform(-0.7, 0.7, moving.sum()) if k > 0 else 0.0
        x = np.clip(x, *problem.bounds)
        while not problem.closes(x):
            x[moving] *= 0.7
        searches.append(Search(problem=problem, x=x))
    _run(searches, workers, trust=0.2, tolerance=2e-3, looks=3)
    near = max(s.merit for s in searches) - NEAR
    _run([s for s in searches if s.merit >= near], workers, curved=True, trust=0.05, tolerance=1e-5)
    best = max(searches, key=lambda s: (s.violation < NEARLY, s.merit))
    return _with_least_moves(best), tuple(hertz(s.squared) for s in searches)


def finished(search: Search, trust: float) -> Search:
    """The search run to its end."""
    return _with_least_moves(search.run(trust=trust, tolerance=1e-5))


def _with_least_moves(search: Search) -> Search:
    """The equal design whose pins move least."""
    search.x = settled(search.problem, search.x)
    search.look()
    return search


def _run(searches: list[Search], workers: int, **settings: Any) -> None:
    """Follow searches of one problem: in this process with one programme, or in several that set up their own."""
    if workers <= 1 or len(searches) < 2:
        for search in searches:
            search.programme = searches[0].programme
            _follow(search, **settings)
        return
    from joblib import Parallel, delayed

    tasks = [delayed(_outcome)(s.problem, s.x, s.rows, s.holding, settings) for s in searches]
    for search, found in zip(searches, Parallel(workers)(tasks), strict=True):
        search.x, search.rows, search.holding, search.reference = found
        search.look()


def _follow(search: Search, curved: bool = False, **settings: Any) -> Search:
    """Run a search; first along what bends, if ``curved`` and nothing is in its way."""
    if curved:
        search.look()
        if search.violation < NEARLY:
            polish(search)
    return search.run(**settings)


def _outcome(
    problem: Problem, x: Array, rows: Array, holding: Array, settings: dict[str, Any]
) -> tuple[Array, Array, Array, float]:
    """Where a search ends, which rows it watches and what it measures by then: what one process tells another."""
    search = _follow(Search(problem=problem, x=x, rows=rows, holding=holding), **settings)
    return search.x, search.rows, search.holding, search.reference


def met(search: Search) -> Search:
    """The search, on from where all requirements are met if it ended where one is missed.

    Raises:
        InfeasibleError: no design meets them all; names those that conflict and what they must give.
    """
    if search.violation > MISSED:
        elastic = Elastic(search.problem, search.x, search.holding)
        found = elastic.least((), elastic.names, EXACT)
        if found.met:
            kept_within(search, found.x)
        elif error := refusal(search):
            raise error
    return search
