"""Designs whose bores and rods are those of a catalogue: sizes for given pins, and sizes and pins in turn."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from armdesign.arrays import Array
from armdesign.design.catalogue.branch_and_bound import Selection, select
from armdesign.design.catalogue.separable import TOLERANCE, choices
from armdesign.design.catalogue.sizes import Sizes, offered
from armdesign.design.program.problem import Problem
from armdesign.design.search.multistart import MISSED, Starts, finished, led_back, multistart
from armdesign.design.search.semidefinite import StepProgramme
from armdesign.design.search.sequential_sdp import Search
from armdesign.errors import ArmDesignError, InfeasibleError

TURNS = 5  # of choosing sizes for pins and pins for sizes
Taken: TypeAlias = tuple[
    tuple[float, float] | None, ...
]  # bore and rod [m] of cylinders whose size is chosen
BORES, RODS = (
    2,
    2,
)  # nearest bores, and rods for each, that are tried on a cylinder while the pins follow


def sizes_for_pins(problem: Problem, sizes: Sizes) -> tuple[Search, Selection]:
    """The best sizes of a catalogue where nothing else varies, with their proof.

    Raises:
        ArmDesignError: no size varies, or forces depend on the sizes.
        InfeasibleError: no combination meets the requirements.
    """
    refuse_fixed(problem)
    found = _selected(problem, problem.vector.start, sizes)
    return _sized(problem, problem.vector.start, found.sizes).run(trust=0.02, looks=1), found


def sizes_and_pins(
    problem: Problem,
    sizes: Sizes,
    starts: int | None,
    seed: int,
    workers: int,
    start: tuple[Array, Taken] | None = None,
) -> tuple[Search, Starts]:
    """Sizes of a catalogue and the pins for them; and what each start came to with free sizes.

    ``start`` is a design to begin with, and the sizes that it has of a catalogue.

    Where no design was found that meets all requirements, with free sizes or without, the search
    misses some: what they must give is then asked of sizes of the catalogue, which need more than
    free ones.

    Raises:
        ArmDesignError: no size varies, or forces depend on the sizes.
    """
    refuse_fixed(problem)
    best, came_to = multistart(problem, starts, seed, workers, start and start[0])
    return with_sizes(led_back(best), sizes, start), came_to


def with_sizes(search: Search, sizes: Sizes, start: tuple[Array, Taken] | None = None) -> Search:
    """The best design with sizes of a catalogue, from one with free sizes.

    It may miss a requirement.

    One cylinder after the other takes a size while the rest follows; or all of them as today's
    pins want them; or as in ``start``. The best of these is ``bettered``.
    """
    problem = search.problem
    found = [finished(_nearest(search, sizes), trust=0.05)]
    if start and _in_catalogue(problem, start[1], sizes):
        found.append(finished(_sized(problem, *start), trust=0.1))
    try:
        chosen = _selected(problem, problem.vector.start, sizes)
        found.append(finished(_sized(problem, problem.vector.start, chosen.sizes), trust=0.1))
    except InfeasibleError:  # today's pins want others; those found above may do
        pass
    return bettered(max(found, key=_rank), sizes)


def _in_catalogue(problem: Problem, taken: Taken, sizes: Sizes) -> bool:
    """Whether every cylinder has a size, and one that it is offered."""
    cylinders = problem.machine.cylinders
    pairs = zip(cylinders, taken, problem.vector.resized, strict=False)  # motors have none
    return len(taken) == len(cylinders) and all(
        size in offered(c, sizes, *free) for c, size, free in pairs
    )


def bettered(search: Search, sizes: Sizes) -> Search:
    """Sizes and pins found in turn, and one size after the other taken anew, until nothing is better."""
    return _one_by_one(_in_turn(search, sizes), sizes)


def refuse_fixed(problem: Problem) -> None:
    """Raise where no size varies.

    Raises:
        ArmDesignError: none does.
    """
    if not any(bore or rod for bore, rod in problem.vector.resized):
        raise ArmDesignError(
            "catalogue", "has no use where sizes stay as they are", 'add "areas" to what varies'
        )


def _nearest(search: Search, sizes: Sizes) -> Search:
    """Sizes of the catalogue near those of a search, cylinder by cylinder, the largest first.

    The rest follows.
    """
    for i in _largest_first(search):
        search = _taken(search, i, sizes)
    return search


def _largest_first(search: Search) -> list[int]:
    cylinders = search.problem.machine.cylinders
    return sorted(
        range(len(cylinders)), key=lambda i: -cylinders[i].bore_area * cylinders[i].stroke
    )


def _taken(search: Search, i: int, sizes: Sizes) -> Search:
    """The best of the sizes near that of a cylinder in a search, each tried while the rest follows."""
    tried = [
        _with_size(search, i, size).run(trust=0.1, tolerance=1e-3, looks=2)
        for size in _near(search, i, sizes)
    ]
    return max(tried, key=_rank)


def _near(search: Search, i: int, sizes: Sizes) -> Sizes:
    """The nearest bores of the catalogue, and the rods that are nearly as stout for them as that of the search."""
    cylinder = search.problem.machine.cylinders[i]
    cap, annulus = search.problem.vector.areas(search.x)[i]
    bore, stoutness = (
        cylinder.bore * math.sqrt(search.x[2 * i]),
        math.sqrt(max(1 - annulus / cap, 0.0)),
    )
    rods: dict[float, list[float]] = {}
    for size in offered(cylinder, sizes, *search.problem.vector.resized[i]):
        rods.setdefault(size[0], []).append(size[1])
    return tuple(
        (own, rod)
        for own in sorted(rods, key=lambda b: abs(b - bore))[:BORES]
        for rod in sorted(rods[own], key=lambda r: abs(r / own - stoutness))[:RODS]
    )


def _with_size(search: Search, i: int, size: tuple[float, float] | None) -> Search:
    """A search from where another stands, with another size of one cylinder; any if None."""
    taken = list(search.problem.sizes or [None] * len(search.problem.machine.cylinders))
    taken[i] = size
    return _sized(search.problem, search.x, tuple(taken), search.programme)


def _one_by_one(search: Search, sizes: Sizes) -> Search:
    """The size of one cylinder after the other let go and taken anew while the pins follow, until none is better."""
    for _ in range(TURNS):
        before = search.problem.sizes
        for i in _largest_first(search):
            other = _taken(
                _with_size(search, i, None).run(trust=0.1, tolerance=1e-3, looks=2), i, sizes
            )
            if other.problem.sizes != search.problem.sizes:
                search = max(search, finished(other, trust=0.05), key=_rank)
        if search.problem.sizes == before:
            break
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
        problem.vector.with_pins(x),
        problem.machine,
        problem.workspace,
        problem.requirements,
        sizes,
        proportional=problem.dynamics.proportional,
        tolerance=MISSED if problem.vector.moving else TOLERANCE,
        free=problem.vector.resized,
    )
    return select(offered, problem.dynamics.bands)


def _sized(
    problem: Problem, x: Array, sizes: Taken, programme: StepProgramme | None = None
) -> Search:
    """A search from the pins of x with sizes that are chosen."""
    fixed = replace(problem, sizes=sizes)
    return Search(problem=fixed, x=np.clip(x, *fixed.bounds), programme=programme)
