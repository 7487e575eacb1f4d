"""Sizes of a catalogue for given pins, and sizes and pins in turn."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple, TypeAlias

import numpy as np

from armdesign.arrays import Array
from armdesign.design.catalogue.branch_and_bound import SizeSelection, select
from armdesign.design.catalogue.separable import TOLERANCE, allowed_sizes
from armdesign.design.catalogue.sizes import Sizes, is_offered, offered, size_in_mm
from armdesign.design.program.problem import Problem
from armdesign.design.search.file_changes import changes_of_sizes
from armdesign.design.search.infeasibility.best_choice import Choice, best_choice
from armdesign.design.search.infeasibility.elastic_programme import ROUGH, ElasticSolution, Roles
from armdesign.design.search.infeasibility.explanation import Conflict, Subsets, not_written
from armdesign.design.search.infeasibility.irreducible_subset import ConflictSearch
from armdesign.design.search.infeasibility.restoration import restore_feasibility
from armdesign.design.search.multistart import Starts, multistart, run_to_end
from armdesign.design.search.rounding import (
    CheckedMachine,
    best_allowed,
    or_today,
    rounded_machine,
)
from armdesign.design.search.sequential_sdp import MISSED, NEARLY, Search
from armdesign.errors import ArmDesignError, InfeasibleError
from armdesign.frequency.modes import hertz
from armdesign.machine.machine import Machine

MOST_DRAWN = 6  # combinations of sizes that are drawn
TURNS = 5  # of choosing sizes for pins and pins for sizes
BEYOND = 1e-4  # of a limit that is missed and should not be, for which sizes are sought again
# nearest bores, and rods for each, that are tried on a cylinder while the pins follow
BORES, RODS = 2, 2
FAR = 0.5  # how far entries of x follow a size in what it promises,
UNFORESEEN = 0.3  # and the share of the loss foreseen that may not come

# bore and rod [m] of each cylinder; None where any size may be
ChosenSizes: TypeAlias = tuple[tuple[float, float] | None, ...]


class Tried:
    """Searches that were run to their end with sizes of a catalogue, one for each combination.

    Attributes:
        unmoved: what today's pins exceed with none of the sizes [Hz].
    """

    def __init__(self) -> None:
        self._best: dict[ChosenSizes, Search] = {}
        self.unmoved = -math.inf

    def to_end(self, search: Search, trust: float) -> Search:
        """A search run to its end; remembered if it is the best with its sizes."""
        ended = run_to_end(search, trust=trust)
        sizes = ended.problem.sizes
        if sizes not in self._best or ended.rank > self._best[sizes].rank:
            self._best[sizes] = ended
        return ended

    @property
    def allowed(self) -> list[Search]:
        """Those that meet all requirements, the best first."""
        met = (one for one in self._best.values() if one.violation <= MISSED)
        return sorted(met, key=lambda one: one.rank, reverse=True)


def sizes_for_pins(problem: Problem, sizes: Sizes) -> tuple[Search, SizeSelection]:
    """The best sizes of a catalogue where nothing else varies, with their proof.

    Raises:
        ArmDesignError: no size varies, or forces depend on the sizes.
        InfeasibleError: no combination meets the requirements.
    """
    refuse_fixed_sizes(problem)
    best_sizes = _best_sizes(problem, problem.vector.start, sizes)
    search = _search_with(problem, problem.vector.start, best_sizes.sizes).run(trust=0.02, looks=1)
    return search, best_sizes


def sizes_and_pins(
    problem: Problem,
    sizes: Sizes,
    starts: int | None,
    seed: int,
    workers: int,
    start: tuple[Array, ChosenSizes] | None = None,
) -> tuple[Search, Starts, CheckedMachine | None]:
    """Sizes of a catalogue and the pins for them, with the machine on the drawing's grid, if any.

    Between them stands what each start came to with free sizes.

    ``start`` is a design to begin with, and the sizes that it has of a catalogue.

    Of the combinations of sizes that were tried, some leave little room for lengths on the
    drawing's grid: the one that is best when drawn is taken. Today's machine is the answer where
    it has sizes of the catalogue and none is better; today's pins with the best sizes for them
    where these are.

    Where no design was found that meets all requirements, with free sizes or without, the search
    misses some: their relaxation is then sought with sizes of the catalogue, which need more than
    free ones.

    Raises:
        ArmDesignError: no size varies, or forces depend on the sizes.
        InfeasibleError: sizes and pins meet all requirements, but not on the drawing's grid.
    """
    refuse_fixed_sizes(problem)
    best, outcomes = multistart(problem, starts, seed, workers, start and start[0])
    best = restore_feasibility(best)
    if best.violation <= MISSED:
        tried = Tried()
        first = _one_after_another(best, sizes, tried)
        _with_sizes(first, sizes, start, tried)
        if tried.allowed:
            sized, machine = _best_drawn(tried.allowed)
            if machine is None or machine.judged < tried.unmoved:
                unmoved = _of_todays_pins(problem, sizes)
                machine = best_allowed([machine, unmoved and unmoved[1]])
            own = tuple((cylinder.bore, cylinder.rod) for cylinder in problem.machine.cylinders)
            if _in_catalogue(problem, own, sizes):
                machine = or_today(machine, problem)
            if machine is None:  # all that are allowed were drawn
                raise not_written(sized)
            return sized, outcomes, machine
    unmoved = _of_todays_pins(problem, sizes)
    if unmoved and unmoved[0].violation <= MISSED:
        return unmoved[0], outcomes, unmoved[1]
    nearest = _missing_least(best, sizes)
    if nearest.violation <= MISSED:
        nearest = improve_in_turn(run_to_end(nearest, trust=0.05), sizes)
    return nearest, outcomes, None


def sized(nearest: Search, sizes: Sizes | None) -> Search:
    """A search for which frequency does not count, on with sizes of a catalogue if there are any.

    Those that miss requirements least, sought near it, and near today's machine if they miss any.
    """
    if sizes is None:
        return nearest
    near = _missing_least(nearest, sizes)
    if near.violation <= MISSED:
        return near
    today = nearest.of(nearest.problem, nearest.problem.vector.start)
    return min(near, _missing_least(today, sizes), key=lambda one: one.violation)


def meeting_all(nearest: Search, sizes: Sizes | None) -> Search:
    """A search at a design that meets all requirements, sought from one that does not.

    Raises:
        InfeasibleError: they conflict, whatever sizes are chosen; what they give is enough for
            sizes of a catalogue.
    """
    conflict = Conflict.near(nearest, roughly=sizes is not None)
    near = nearest.of(nearest.problem, conflict.x)
    if not conflict.must_give:
        return near.look()
    if sizes is not None:
        free = conflict
        for groups in (free.subsets, None):  # more gives where these cannot give enough
            conflict = free.with_sizes(_missing_least(near, sizes, groups))
            if conflict.relaxation is not None:
                break
    raise conflict.error("no design meets", drawn=sizes is None)


def _of_todays_pins(problem: Problem, sizes: Sizes) -> tuple[Search, CheckedMachine] | None:
    """Today's machine, nothing moved, with its best sizes; None where no sizes are allowed."""
    try:
        best_sizes = _selected(problem, problem.machine, sizes, TOLERANCE)
    except InfeasibleError:
        return None
    search = _search_with(problem, problem.vector.start, best_sizes.sizes)
    in_mm = [size_in_mm(size) for pair in best_sizes.sizes for size in pair]
    changes = changes_of_sizes(problem, in_mm, search.x)
    machine = CheckedMachine.of(problem.machine.replace(changes), problem)
    return (search.look(), machine) if machine.allowed else None


def _best_drawn(searches: list[Search]) -> tuple[Search, CheckedMachine | None]:
    """The best machine on the drawing's grid, and the search that it is of.

    Combinations of sizes are drawn, the best first, until none promises more than what is drawn.
    """
    drawn, best = searches[0], None
    for search in searches[:MOST_DRAWN]:
        if best and hertz(search.squared) <= best.judged:
            break
        machine = rounded_machine(search)
        if machine and (best is None or machine.judged > best.judged):
            drawn, best = search, machine
    return drawn, best


def with_sizes(search: Search, sizes: Sizes) -> Search:
    """The best design with sizes of a catalogue, from one with free sizes.

    It may miss a requirement.
    """
    tried = Tried()
    return _with_sizes(_one_after_another(search, sizes, tried), sizes, None, tried)


def _one_after_another(search: Search, sizes: Sizes, tried: Tried) -> Search:
    """A design with sizes: one cylinder after the other takes one while the rest follows."""
    for i in _largest_first(search):  # the largest cylinder takes a size first
        search = _best_near_size(search, i, sizes)
    return tried.to_end(search, trust=0.05)


def _with_sizes(
    first: Search, sizes: Sizes, start: tuple[Array, ChosenSizes] | None, tried: Tried
) -> Search:
    """The best of ``first``, of the sizes as today's pins want them, and of ``start``.

    It goes through ``improve_in_turn``. What is run to its end goes into ``tried``.
    """
    problem, searches = replace(first.problem, sizes=()), [first]
    if start and _in_catalogue(problem, start[1], sizes):
        searches.append(tried.to_end(_search_with(problem, *start), trust=0.1))
    try:
        best_sizes = _best_sizes(problem, problem.vector.start, sizes)
        tried.unmoved = best_sizes.bound
        of_today = _search_with(problem, problem.vector.start, best_sizes.sizes)
        searches.append(tried.to_end(of_today, trust=0.1))
    except InfeasibleError:  # today's pins want others; those found above may do
        pass
    return improve_in_turn(max(searches, key=lambda one: one.rank), sizes, tried)


def _missing_least(search: Search, sizes: Sizes, groups: Subsets | None = None) -> Search:
    """Sizes near a search's own that miss requirements least.

    Frequency is left aside: pins follow the requirements. Groups of requirements give, all if
    None; the others are met before. Sizes that are foreseen to miss least are tried, and others
    about what they lead to, while less is foreseen than is known.
    """
    elastic = ConflictSearch(search.problem, search.x, search.holding)
    roles = elastic.roles([elastic.names] if groups is None else groups, groups is None)
    free = replace(search.problem, sizes=())
    best, tried = None, set[ChosenSizes]()
    about = search.of(free, search.x)
    for _ in range(TURNS):
        combination = _foreseen(about, sizes, roles, tried)
        if combination is None or (best and combination[1] >= best.cost):
            break
        tried.add(combination[0])
        one = _missing(_search_with(free, about.x, combination[0]), roles)
        best = min(best or one, one, key=lambda each: each.cost)
        if (best.solution.cost if groups is None else best.solution.missed) <= BEYOND:
            break
        about = search.of(free, one.search.x)
    assert best  # there are sizes to try
    return best.search.look()


def _foreseen(
    search: Search, sizes: Sizes, roles: Roles, tried: set[ChosenSizes]
) -> tuple[ChosenSizes, float] | None:
    """Sizes near a search's own that miss least, all linear about it, and what they miss."""
    count = len(search.problem.machine.cylinders)
    near = [_near_sizes(search, i, sizes) for i in range(count)]
    choices = []
    for i, some in enumerate(near):
        entries = np.array([2 * i, 2 * i + 1])
        values = [_with_size(search, i, size).x[entries] for size in some]
        choices.append(Choice(entries, np.array(values)))
    known = [
        tuple(some.index(size) for some, size in zip(near, each, strict=True))
        for each in tried
        if all(size in some for some, size in zip(near, each, strict=True))
    ]
    elastic = ConflictSearch(search.problem, search.x, search.holding)
    at, bounds = elastic.rooms(search.x, roles), search.problem.bounds
    best = best_choice(at, roles, bounds, choices, known)
    if best is None:
        return None
    return tuple(some[k] for some, k in zip(near, best[0], strict=True)), best[1]


class Missed(NamedTuple):
    """A search at the design that misses requirements least with its sizes, and by how much."""

    solution: ElasticSolution
    search: Search

    @property
    def cost(self) -> float:
        """What solutions are compared by."""
        return self.solution.cost


def _missing(search: Search, roles: Roles) -> Missed:
    """A search, on to where requirements are missed least."""
    elastic = ConflictSearch(search.problem, search.x, search.holding)
    solution = elastic.solve(roles, ROUGH, starts=1)
    return Missed(solution, search.of(search.problem, solution.x))


def improve_in_turn(search: Search, sizes: Sizes, tried: Tried | None = None) -> Search:
    """Sizes and pins found in turn, then one size after the other, until nothing is better."""
    tried = Tried() if tried is None else tried
    return _one_by_one(_alternate(search, sizes, tried), sizes, tried)


def refuse_fixed_sizes(problem: Problem) -> None:
    """Raise where no size varies."""
    if not problem.vector.any_size_varies:
        fault = "has no use where sizes stay as they are"
        raise ArmDesignError("catalogue", fault, 'add "areas" to what varies')


def _in_catalogue(problem: Problem, chosen: ChosenSizes, sizes: Sizes) -> bool:
    """Whether every cylinder has a size, and one that it is offered."""
    cylinders = problem.machine.cylinders
    pairs = zip(cylinders, chosen, problem.vector.resized, strict=False)  # motors have none
    return len(chosen) == len(cylinders) and all(
        size is not None and is_offered(c, size, sizes, *free) for c, size, free in pairs
    )


def _largest_first(search: Search) -> list[int]:
    oil = [cylinder.bore_area * cylinder.stroke for cylinder in search.problem.machine.cylinders]
    return sorted(range(len(oil)), key=lambda i: -oil[i])


def _best_near_size(search: Search, i: int, sizes: Sizes, known: Search | None = None) -> Search:
    """The best of ``known`` and of the sizes near a cylinder's, tried while the rest follows.

    The first to be tried is what promises most to first order; what is reached by then leaves
    those that would not be better with a part of the loss that they foresee. On the shipped
    machines a fourth of it did not come at most, where sizes were near the best.
    """
    if known and search.merit <= known.merit:
        return known
    foreseen, best = search.foreseen_merit(reach=FAR), known
    near = [_with_size(search, i, size) for size in _near_sizes(search, i, sizes)]
    others = [one for one in near if known is None or one.problem.sizes != known.problem.sizes]
    promised = [foreseen(one.x, np.equal(*one.bounds)) for one in others]
    for k in np.argsort(promised)[::-1]:
        hoped = promised[k] + UNFORESEEN * (search.merit - promised[k])
        if best and best.violation <= NEARLY and hoped < best.merit:
            break
        tried = _roughly(others[k])
        best = max(best or tried, tried, key=lambda one: (one.violation <= NEARLY, one.merit))
    assert best  # there is a size to try
    return best


def _near_sizes(search: Search, i: int, sizes: Sizes) -> Sizes:
    """The nearest bores of the catalogue, each with rods that are nearly as stout."""
    cylinder = search.problem.machine.cylinders[i]
    cap, annulus = search.problem.vector.areas(search.x)[i]
    wanted = cylinder.bore * math.sqrt(search.x[2 * i])
    stoutness = math.sqrt(max(1 - annulus / cap, 0.0))
    rods: dict[float, list[float]] = {}
    for bore, rod in offered(cylinder, sizes, *search.problem.vector.resized[i]):
        rods.setdefault(bore, []).append(rod)
    return tuple(
        (bore, rod)
        for bore in sorted(rods, key=lambda b: abs(b - wanted))[:BORES]
        for rod in sorted(rods[bore], key=lambda r: abs(r / bore - stoutness))[:RODS]
    )


def _with_size(search: Search, i: int, size: tuple[float, float] | None) -> Search:
    """A search from where another stands, with another size of one cylinder; any if None."""
    chosen = list(search.problem.sizes or [None] * len(search.problem.machine.cylinders))
    chosen[i] = size
    return _search_with(search.problem, search.x, tuple(chosen))


def _roughly(search: Search) -> Search:
    return search.run(trust=0.1, tolerance=1e-3, looks=2)


def _one_by_one(search: Search, sizes: Sizes, tried: Tried) -> Search:
    """One cylinder after the other let go and sized anew, until none is better."""
    for _ in range(TURNS):
        before = search.problem.sizes
        for i in _largest_first(search):
            free = _roughly(_with_size(search, i, None))
            if (other := _best_near_size(free, i, sizes, search)) is not search:
                search = max(search, tried.to_end(other, trust=0.05), key=lambda one: one.rank)
        if search.problem.sizes == before:
            break
    return search


def _alternate(search: Search, sizes: Sizes, tried: Tried) -> Search:
    """Sizes chosen anew for the pins and pins tuned for these sizes, until neither changes."""
    for _ in range(TURNS):
        try:
            best_sizes = _best_sizes(search.problem, search.x, sizes)
        except InfeasibleError:  # by less than the search lets pass
            break
        if best_sizes.sizes == search.problem.sizes:
            break
        other = tried.to_end(_search_with(search.problem, search.x, best_sizes.sizes), trust=0.1)
        if other.rank <= search.rank:
            break
        search = other
    return search


def _best_sizes(problem: Problem, x: Array, sizes: Sizes) -> SizeSelection:
    """The best sizes for the pins of x."""
    tolerance = MISSED if problem.vector.moving else TOLERANCE
    return _selected(problem, problem.vector.with_pins(x), sizes, tolerance)


def _selected(problem: Problem, placed: Machine, sizes: Sizes, tolerance: float) -> SizeSelection:
    """The best sizes for the pins and lengths of a machine."""
    allowed = allowed_sizes(
        placed,
        problem.machine,
        problem.workspace,
        problem.requirements,
        sizes,
        proportional=problem.dynamics.corners.proportional,
        tolerance=tolerance,
        free=problem.vector.resized,
    )
    return select(allowed, problem.dynamics.corners)


def _search_with(problem: Problem, x: Array, sizes: ChosenSizes) -> Search:
    """A search from the pins of x with sizes that are chosen."""
    fixed = replace(problem, sizes=sizes)
    return Search(problem=fixed, x=np.clip(x, *fixed.bounds))
