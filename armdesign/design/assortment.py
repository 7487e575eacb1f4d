"""Designs whose bores and rods are those of a catalogue: sizes for given pins, and sizes and pins in turn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armdesign.arrays import Array
from armdesign.design.catalogue import Sizes, offered, relative_areas
from armdesign.design.choices import TOLERANCE, choices
from armdesign.design.codesign import Search
from armdesign.design.problem import Problem
from armdesign.design.searching import MISSED, finished, met, multistart
from armdesign.design.selection import Selection, select
from armdesign.design.sizing import StepProgramme
from armdesign.errors import ArmDesignError, InfeasibleError

TURNS = 5  # of choosing sizes for pins and pins for sizes
NEAREST = 4  # sizes that are tried on a cylinder while the pins follow


def sizes_for_pins(problem: Problem, sizes: Sizes) -> tuple[Search, Selection]:
    """The best sizes of a catalogue where nothing else varies, with their proof.

    Raises:
        ArmDesignError: no size varies, or forces hang on the sizes.
        InfeasibleError: no combination meets the requirements.
    """
    _refuse_fixed(problem)
    found = _selected(problem, problem.start, sizes)
    return _sized(problem, problem.start, found.sizes).run(trust=0.02, looks=1), found


def sizes_and_pins(
    problem: Problem, sizes: Sizes, starts: int, seed: int, workers: int
) -> tuple[Search, tuple[float, ...]]:
    """Sizes of a catalogue and the pins for them; and what each start reached with free sizes [Hz].

    From the best free sizes one cylinder after the other takes a size of the catalogue while the rest follows; or all
    of them as today's pins want them. From the better of both, sizes and pins are found in turn.

    Raises:
        ArmDesignError: no size varies, or forces hang on the sizes.
        InfeasibleError: no design meets the requirements.
    """
    _refuse_fixed(problem)
    best, reached = multistart(problem, starts, seed, workers)
    found = [finished(_nearest(met(best), sizes), trust=0.05)]
    try:
        chosen = _selected(problem, problem.start, sizes)
        found.append(finished(_sized(problem, problem.start, chosen.sizes), trust=0.1))
    except InfeasibleError:
        if found[0].violation > MISSED:
            raise
    return _in_turn(max(found, key=_rank), sizes), reached


def _refuse_fixed(problem: Problem) -> None:
    if not any(bore or rod for bore, rod in problem.resized):
        raise ArmDesignError("catalogue", "has no use where sizes stay as they are", 'add "areas" to what varies')


def _nearest(search: Search, sizes: Sizes) -> Search:
    """Sizes of the catalogue near those of a search, cylinder by cylinder, the largest first; the rest follows."""
    cylinders = search.problem.machine.cylinders
    for i in sorted(range(len(cylinders)), key=lambda i: -cylinders[i].bore_area * cylinders[i].stroke):
        own = offered(cylinders[i], sizes, *search.problem.resized[i])
        areas = np.array([relative_areas(cylinders[i], *size) for size in own])
        nearest = np.argsort(np.abs(areas - search.x[2 * i : 2 * i + 2]).sum(axis=1), kind="stable")[:NEAREST]
        tried = []
        for size in (own[k] for k in nearest):
            taken = list(search.problem.sizes or [None] * len(cylinders))
            taken[i] = size
            tried.append(_sized(search.problem, search.x, tuple(taken), search.programme))
            tried[-1].run(trust=0.1, tolerance=1e-3, looks=2)
        search = max(tried, key=_rank)
    return search


def _in_turn(search: Search, sizes: Sizes) -> Search:
    """Sizes chosen anew for the pins and pins tuned for these sizes, until neither changes."""
    for _ in range(TURNS):
        try:
            chosen = _selected(search.problem, search.x, sizes)
        except InfeasibleError:  # by less than the search lets pass
            break
        if chosen.sizes == search.problem.sizes:
            break
        other = finished(_sized(search.problem, search.x, chosen.sizes), trust=0.1)
        if _rank(other) <= _rank(search):
            break
        search = other
    return search


def _rank(search: Search) -> tuple[bool, float]:
    return search.violation <= MISSED, search.merit


def _selected(problem: Problem, x: Array, sizes: Sizes) -> Selection:
    """The best sizes for the pins of x."""
    offered = choices(
        problem.placed(x),
        problem.machine,
        problem.workspace,
        problem.requirements,
        sizes,
        proportional=problem.proportional,
        tolerance=MISSED if problem.moving else TOLERANCE,
        free=problem.resized,
    )
    return select(offered, problem.bands)


def _sized(
    problem: Problem, x: Array, sizes: tuple[tuple[float, float] | None, ...], programme: StepProgramme | None = None
) -> Search:
    """A search from the pins of x with sizes that are chosen."""
    fixed = replace(problem, sizes=sizes)
    return Search(problem=fixed, x=np.clip(x, *fixed.bounds), programme=programme)
