"""Sizes of a catalogue for given pins, and sizes and pins in turn."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple, TypeAlias

import numpy as np

from armdesign.arrays import Array
from armdesign.design.catalogue.branch_and_bound import SizeSelection, select
from armdesign.design.catalogue.separable import TOLERANCE, allowed_sizes
from armdesign.design.catalogue.sizes import Sizes, offered, size_in_mm
from armdesign.design.program.problem import Problem
from armdesign.design.search.file_changes import changes_of_sizes
from armdesign.design.search.infeasibility.elastic_programme import (
    MET,
    ROUGH,
    ElasticSolution,
    Roles,
)
from armdesign.design.search.infeasibility.explanation import Conflict, Subsets, not_written
from armdesign.design.search.infeasibility.irreducible_subset import ConflictSearch
from armdesign.design.search.infeasibility.restoration import nearest_design, restore_feasibility
from armdesign.design.search.multistart import Starts, multistart, run_to_end
from armdesign.design.search.rounding import (
    CheckedMachine,
    best_allowed,
    inmost_machine,
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


def first_machine(nearest: Search, sizes: Sizes | None) -> tuple[Search, CheckedMachine] | None:
    """A machine that meets all requirements near a search for which frequency does not count.

    With sizes of a catalogue where there are some; None if none was found.
    """
    if nearest.violation > MISSED:
        return None
    if sizes is not None:
        nearest = _missing_least(nearest, sizes)
    machine = inmost_machine(nearest, any_will_do=True)
    return None if machine is None else (nearest, machine)


def refuse_conflict(nearest: Search, sizes: Sizes | None) -> None:
    """Raise where requirements conflict near a search, whatever sizes are chosen.

    Raises:
        InfeasibleError: no design meets them; what they give is enough for sizes of a catalogue.
    """
    conflict = Conflict.near(nearest)
    if not conflict.must_give:
        return
    if sizes is not None:
        near, free = nearest.of(nearest.problem, conflict.x), conflict
        for groups in (free.subsets, None):  # more gives where these cannot give enough
            conflict = free.with_sizes(_missing_least(near, sizes, groups))
            if conflict.relaxation is not None:
                break

    def enough(problem: Problem) -> bool:
        granted = replace(problem, sizes=())
        return first_machine(nearest_design(granted), sizes) is not None

    raise conflict.error("no design meets", enough)


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
    """Sizes near a search's own, the largest cylinder first, that miss requirements least.

    Frequency is left aside: pins, and the sizes that are not chosen yet, follow the requirements.
    Groups of requirements give, all if None; the others are met before. Where one is missed that
    should not be, each cylinder is let go and sized once more.
    """
    elastic = ConflictSearch(search.problem, search.x, search.holding)
    roles = elastic.roles([elastic.names] if groups is None else groups, groups is None)
    for i in _largest_first(search):
        best = _missing_least_by(search, i, sizes, roles)
        search = best.search
    for i in _largest_first(search):
        solution = best.solution  # of all that may give, none should have to
        if (solution.cost if groups is None else solution.missed) <= BEYOND:
            break
        free = _missing(_with_size(search, i, None), roles)
        best = min(best, _missing_least_by(free.search, i, sizes, roles), key=lambda one: one.cost)
        search = best.search
    return search.look()


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


def _missing_least_by(search: Search, i: int, sizes: Sizes, roles: Roles) -> Missed:
    """The size of one cylinder, near a search's own, that misses least: the first that is met."""
    tried: list[Missed] = []
    for size in _near_sizes(search, i, sizes):
        tried.append(_missing(_with_size(search, i, size), roles))
        if tried[-1].cost <= MET:
            break
    return min(tried, key=lambda one: one.cost)


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
        size is not None and any(np.allclose(size, pair) for pair in offered(c, sizes, *free))
        for c, size, free in pairs
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
