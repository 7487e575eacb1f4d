"""Searches from several starts, taken to their end: what ``optimize``, catalogues and the reverse question share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from armdesign.arrays import Array
from armdesign.design.program.problem import Problem
from armdesign.design.program.variables import chosen
from armdesign.design.requirements.settings import Requirements
from armdesign.design.search.canonical_pins import settled
from armdesign.design.search.elastic import Elastic
from armdesign.design.search.refusal import kept_within, refusal
from armdesign.design.search.sequential_sdp import NEARLY, Search
from armdesign.design.search.slsqp import polish
from armdesign.frequency.bands import Bands
from armdesign.frequency.modes import hertz
from armdesign.frequency.workspace import Workspace
from armdesign.machine.machine import Machine

STARTS, BENDING = 3, 6  # where pins move, and where four-bars do, which have more local optima
POLISHED = 4  # times at most, where four-bars move
GAINED = 1e-5  # of today's lowest ω², by the last of them
NAMED = 3  # requirements, of a start that failed
MISSED = 1e-5  # by which a search may miss a requirement
# share of what is missed that a step must promise, where a design that meets all is sought
EXACT = 1e-6
NEAR = 0.2  # of today's lowest ω²: starts that end this far below the best are left there


def posed(
    machine: Machine,
    workspace: Workspace | None,
    requirements: Requirements | None,
    vary: Sequence[str],
    proportional: bool = False,
    bands: Bands | None = None,
) -> Problem:
    """The design problem.

    Where no workspace or requirements are given, the default grid and those of the file.

    Raises:
        ArmDesignError: a word or path of ``vary`` that names nothing that can vary; a requirement
            on what is not there.
    """
    chosen(machine, vary)
    requirements = requirements or Requirements.of(machine)
    requirements.refuse_unknown(machine)
    workspace = workspace or Workspace.grid(machine, end_margin=requirements.end_margin)
    return Problem.of(
        machine=machine,
        workspace=workspace,
        requirements=requirements,
        vary=tuple(vary),
        proportional=proportional,
        bands=bands or Bands(),
    )


@dataclass(frozen=True)
class Starts:
    """What the starts of a search came to: worst frequencies [Hz] of those that ended where all requirements are met.

    And of every other one why it failed, in words.
    """

    reached: tuple[float, ...] = ()
    failed: tuple[str, ...] = ()

    @classmethod
    def of(cls, searches: Sequence[Search]) -> Starts:
        """Of searches that are finished, or were left because others are better."""
        return cls(
            tuple(hertz(s.squared) for s in searches if not _failure(s)),
            tuple(_failure(s) for s in searches if _failure(s)),
        )


def _failure(search: Search) -> str:
    """Why a search ended in no design, in words; empty where it did in one."""
    if missed := search.missed:
        more = f" and {len(missed) - NAMED} more" if len(missed) > NAMED else ""
        return f"no way found to meet {', '.join(missed[:NAMED])}{more}"
    return "" if search.squared > 0 else "the arm gives way at its worst pose (ω² ≤ 0)"


def multistart(
    problem: Problem, starts: int | None, seed: int, workers: int, given: Array | None = None
) -> tuple[Search, Starts]:
    """The best of several starts, finished; and what each start came to.

    They are the one ``given``, if any, today's machine and random pins; as many as told, or more
    where four-bars move. Every start is followed roughly; those that come near the best are
    polished and finished.
    """
    random = np.random.default_rng(seed)
    moving = np.array([v.pin is not None for v in problem.vector.variables])
    searches = [] if given is None else [Search(problem=problem, x=given)]
    if starts is None:
        starts = BENDING if problem.vector.moves_within else STARTS
    for k in range((max(starts, 1) if problem.vector.moving else 1) - len(searches)):
        x = problem.vector.start.copy()
        x[moving] = random.uniform(-0.7, 0.7, moving.sum()) if k > 0 else 0.0
        x = np.clip(x, *problem.bounds)
        while not problem.vector.closes(x):
            x[moving] *= 0.7
        searches.append(Search(problem=problem, x=x))
    _run(searches, workers, trust=0.2, tolerance=2e-3, looks=3)
    near = max(s.merit for s in searches) - NEAR
    _run(
        [s for s in searches if s.merit >= near], workers, curved=True, trust=0.05, tolerance=1e-5
    )
    best = max(searches, key=lambda s: (s.violation < NEARLY, s.merit))
    came_to = Starts.of(searches)
    return _with_least_moves(best), came_to


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
    """Run a search; first along what bends, if ``curved`` and nothing is in its way.

    In turn, where four-bars move.
    """
    for _ in range(POLISHED if curved and search.problem.vector.moves_within else 1):
        search.look()
        before = search.merit
        if curved and search.violation < NEARLY:
            polish(search)
        search.run(**settings)
        if search.merit < before + GAINED:
            break
    return search


def _outcome(
    problem: Problem, x: Array, rows: Array, holding: Array, settings: dict[str, Any]
) -> tuple[Array, Array, Array, float]:
    """Where a search ends, which rows it watches and what it measures by then: what one process tells another."""
    search = _follow(Search(problem=problem, x=x, rows=rows, holding=holding), **settings)
    return search.x, search.rows, search.holding, search.reference


def led_back(search: Search) -> Search:
    """The search, on from where all requirements are met if it ended where one is missed and a way is found."""
    if search.violation > MISSED:
        elastic = Elastic(search.problem, search.x, search.holding)
        found = elastic.least((), elastic.names, EXACT)
        if found.met:
            kept_within(search, found.x)
    return search


def met(search: Search) -> Search:
    """The search, on from where all requirements are met if it ended where one is missed.

    Raises:
        InfeasibleError: no design meets them all; names those that conflict and what they must
            give.
    """
    if led_back(search).violation > MISSED and (error := refusal(search)):
        raise error
    return search
