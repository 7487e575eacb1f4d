"""Explanation of infeasibility: why no design is possible, and a relaxation that is enough.

Conflicts are sought with limits tightened by what rounding takes. The requirements are relaxed,
and a design is sought and rounded near the one that misses least; where that fails, they are
relaxed a little more.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias, TypeVar

import numpy as np

from armdesign.arrays import Array
from armdesign.design.catalogue.sizes import FINE as FINE_GRID
from armdesign.design.program.problem import Problem
from armdesign.design.requirements.check import check
from armdesign.design.requirements.record import BESIDES, Concession, Evaluation, Requirement
from armdesign.design.requirements.settings import Requirements
from armdesign.design.search.infeasibility.concessions import (
    OTHER_SIZES,
    concessions,
    conflict_error,
    largest_share,
    nearest_error,
)
from armdesign.design.search.infeasibility.elastic_programme import MET, ROUGH
from armdesign.design.search.infeasibility.irreducible_subset import ConflictSearch, Relaxation
from armdesign.design.search.infeasibility.restoration import (
    restore_feasibility,
    run_from_feasible,
)
from armdesign.design.search.rounding import inmost_machine, nearest_misses
from armdesign.design.search.sequential_sdp import MISSED, Search
from armdesign.errors import InfeasibleError

# shares by which limits are tightened, until there is a conflict
TIGHTENED_BY = (1e-4, 1e-3, 3e-3, 1e-2)
# of their limits that requirements give besides, until a drawing has room
MORE, MORE_OF_COARSE = (0.0, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2), (3e-3, 1e-2, 3e-2)
UNDRAWN = 1e-2  # of their limits besides, where nothing is drawn
GRANTS = 5  # refusals in a row that are granted, all that they ask for
NOTHING = 1e-4  # of a limit, which is not said where more is given besides
WITH_SIZES = "with the sizes of the catalogue that were tried, "

T = TypeVar("T")
Subsets: TypeAlias = tuple[tuple[str, ...], ...]


def design_or_proof(problem: Problem, design: Callable[[Problem, bool], T], catalogue: bool) -> T:
    """What is found for a problem, or a refusal whose amounts were all granted, and gave a design.

    ``design`` is told whether any will do: under what is granted, where none is asked for.
    What is refused again under what a refusal grants joins it, until there is a design, or a
    machine was drawn on the way to the refusal. A machine with sizes of a ``catalogue`` is no
    proof that a search, which may choose others, comes to one: that is then run in full.

    Raises:
        InfeasibleError: of ``design``, with amounts that are enough in the same setting.
    """
    requirements, settled, drawn = problem.requirements, False, False
    refusals: list[InfeasibleError] = []
    while len(refusals) < GRANTS:
        try:
            answer = design(problem.under(requirements), bool(refusals) and not drawn)
        except InfeasibleError as refusal:
            refusals.append(refusal)
            granted = requirements.granting(refusal.conflict)
            if granted == requirements:  # nothing that a file could state helps
                break
            requirements = granted
            drawn = refusal.drawn
            if drawn and not catalogue:
                settled = True
                break
        else:
            if not refusals:
                return answer
            settled = True
            break
    one = len(refusals) == 1
    conflict = refusals[0].conflict if one else _all_together(problem, refusals, requirements)
    needed = _needed(problem, design, conflict) if settled else conflict
    if one and needed == conflict:
        raise refusals[0]
    last = [] if settled else [c.name for c in refusals[-1].conflict]
    none_meets, otherwise = "no design meets", ""
    if catalogue and any(WITH_SIZES in refusal.fault for refusal in refusals):
        none_meets, otherwise = f"{WITH_SIZES}{none_meets}", OTHER_SIZES
    raise conflict_error(
        problem.machine.name, needed, none_meets, settled, otherwise, last, least=False
    )


def _needed(
    problem: Problem, design: Callable[[Problem, bool], T], conflict: tuple[Concession, ...]
) -> tuple[Concession, ...]:
    """What a conflict asks for, without what gives besides where there is a design without it."""
    needed = tuple(c for c in conflict if c.part != BESIDES)
    if needed == conflict:
        return conflict
    try:
        design(problem.under(problem.requirements.granting(needed)), True)
    except InfeasibleError:
        return conflict
    return needed


def _all_together(
    problem: Problem, refusals: Sequence[InfeasibleError], granted: Requirements
) -> tuple[Concession, ...]:
    """The requests of several refusals, each under what the ones before it grant.

    A requirement may count only under what was granted, as digging does under less torque.
    """
    machine = problem.machine
    before, after = (
        {c.name: c for c in check(machine, machine, problem.workspace, requirements)}
        for requirements in (problem.requirements, granted)
    )
    joined: dict[str, Concession] = {}
    parts = _joined_parts(refusals)
    for refusal in refusals:
        for c in refusal.conflict:
            known, old = joined.get(c.name), before.get(c.name, c)
            value = known.value if known else None  # a later refusal may ask for no more of it
            if c.inverse and c.value is not None:  # factors
                value = c.value * (value or 1.0)
            elif not c.inverse and (c.value is not None or value is not None):
                value = granted.setting(c.setting)
            changed = abs(after.get(c.name, c).limit - old.limit)
            joined[c.name] = Concession(
                **old.identity,
                together=old.limit * (1 / value - 1) if c.inverse and value else changed,
                alone=None,
                part=parts[c.name],
                value=value,
            )
    return tuple(sorted(joined.values(), key=lambda c: (c.part == BESIDES, c.part)))


def _joined_parts(refusals: Sequence[InfeasibleError]) -> dict[str, int]:
    """Part of each requirement of several refusals: conflicts with a common one are one."""
    joined: list[set[str]] = []
    besides: dict[str, int] = {}
    for refusal in refusals:
        for part in dict.fromkeys(c.part for c in refusal.conflict):
            names = {c.name for c in refusal.conflict if c.part == part}
            if part == BESIDES:
                besides |= dict.fromkeys(names, BESIDES)
                continue
            common = [one for one in joined if one & names]
            joined = [one for one in joined if not one & names]
            joined.append(names.union(*common))
    return besides | {name: k for k, names in enumerate(joined) for name in names}


def require_feasible(search: Search) -> Search:
    """The search, on from where all requirements are met if it ended where one is missed.

    Raises:
        InfeasibleError: no design meets them all; names those that conflict and what they must
            give.
    """
    search = restore_feasibility(search)
    if search.violation <= MISSED:
        return search
    conflict = Conflict.near(search)
    if conflict.must_give:
        raise conflict.error("no design meets")
    return run_from_feasible(search, conflict.x)


def not_written(search: Search) -> InfeasibleError:
    """The error where designs meet all requirements, but none was found that can be written."""
    for share in TIGHTENED_BY if search.problem.vector.moving else ():
        conflict = Conflict.near(search, share)
        if conflict.must_give:
            return conflict.error(f"no sizes and pins {_grid(search.problem)} meet")
    missed = nearest_misses(search)
    by_name = {c.name: c for c in missed}
    amounts = {c.name: abs(c.value - c.limit) for c in missed}
    given, _ = _sufficient(search, (tuple(by_name),), by_name, amounts, {}, search.x)
    none_meets = f"no sizes {_grid(search.problem)} meet all requirements"
    return nearest_error(search.problem.machine.name, none_meets, given)


def _grid(problem: Problem) -> str:
    return f"on the {problem.grid.lengths:g} mm grid"


@dataclass(frozen=True, eq=False)
class Conflict:
    """Conflicts near a search, and the least relaxation that a local search finds, if any.

    Attributes:
        search: near which requirements conflict.
        subsets: names of the requirements of each conflict, and of what gives besides.
        relaxation: of these, with which a design is found; None if there is none.
        among: the search for it.
        by_sizes: whether they conflict only with sizes that were chosen from a catalogue.
        conflicting: how many of the subsets are conflicts, the first; the rest gives besides.
    """

    search: Search
    subsets: Subsets
    relaxation: Relaxation | None
    among: ConflictSearch
    by_sizes: bool
    conflicting: int

    @classmethod
    def near(cls, search: Search, share: float | None = None, roughly: bool = False) -> Conflict:
        """The conflict near a search with limits tightened by a share; a little by default.

        What must give may be known ``roughly``, from fewer starts, if sizes are still to come.
        """
        among = _among(search, share)
        subsets = among.disjoint_subsets()
        if not subsets:
            return cls(search, (), None, among, bool(search.problem.sizes), 0)
        by_sizes, count = bool(search.problem.sizes), len(subsets)
        if roughly and (known := among.least_relaxation(subsets, among.x, False, ROUGH)):
            return cls(search, subsets, known, among, by_sizes, count)
        return cls(search, *_relaxed(among, subsets), among, by_sizes, count)

    def with_sizes(self, search: Search) -> Conflict:
        """The same conflict, relaxed so far that a search with sizes of a catalogue is allowed."""
        among = _among(search)
        subsets, relaxation = _relaxed(among, self.subsets, search.x)
        return replace(self, search=search, subsets=subsets, relaxation=relaxation, among=among)

    @property
    def must_give(self) -> bool:
        """Whether a requirement has to be relaxed."""
        return bool(self.subsets) and not (self.relaxation and self.relaxation.nothing)

    @property
    def x(self) -> Array:
        """The design that misses least."""
        return self.relaxation.x if self.relaxation else self.among.x

    def error(self, none_meets: str, drawn: bool = True) -> InfeasibleError:
        """The error that names the conflict and what relaxation is enough, together and alone.

        If ``drawn`` so much that a machine near the design that misses least can be drawn.
        """
        search, amounts, enough = self.search, self.among.amounts(self.among.x), False
        by_name = {name: evaluation for name, (evaluation, _) in amounts.items()}
        if self.relaxation is None:  # what misses least says what lacks
            lacks = {n: much for n, (c, much) in amounts.items() if much > MET * abs(c.limit)}
            given = concessions(search.problem.requirements, [tuple(lacks)], by_name, lacks, {})
        else:
            together, x = self.relaxation.amounts, self.relaxation.x
            alone = {} if search.problem.sizes else self._alone(by_name, together, x)
            near = x if drawn else None
            given, enough = _sufficient(search, self.subsets, by_name, together, alone, near)
            given = tuple(
                c if c.part < self.conflicting else replace(c, part=BESIDES, alone=None)
                for c in given
                if c.part < self.conflicting or c.together > 0
            )
        none_meets = f"{WITH_SIZES}{none_meets}" if self.by_sizes else none_meets
        otherwise = OTHER_SIZES if self.by_sizes else ""
        settled = self.relaxation is not None
        error = conflict_error(
            search.problem.machine.name, given, none_meets, settled, otherwise, least=False
        )
        error.drawn = enough
        return error

    def _alone(
        self, by_name: Mapping[str, Evaluation], together: Mapping[str, float], near: Array
    ) -> dict[str, float | None]:
        """Relaxation of each requirement of a subset where no other of its subset is relaxed.

        None where that does not help, or was tried and gave no design.
        """
        alone: dict[str, float | None] = {}
        for subset in self.subsets:
            others = [other for other in self.subsets if other is not subset]
            of_others = {n: together[n] for names in others for n in names if n in together}
            for name in subset if len(subset) > 1 else ():
                alone[name] = None
                if not by_name[name].setting:
                    continue
                relaxation = self.among.least_relaxation([(name,), *others], near)
                if relaxation is None:
                    continue
                amounts = {**of_others, name: relaxation.amounts[name]}
                subsets = [(name,), *others]
                given, enough = _sufficient(
                    self.search, subsets, by_name, amounts, {}, relaxation.x
                )
                if enough:
                    alone[name] = next(c.together for c in given if c.name == name)
        return alone


def _among(search: Search, share: float | None = None) -> ConflictSearch:
    """The search for conflicts near a search with limits tightened; a little by default."""
    if share is None:
        share = TIGHTENED_BY[0] if search.problem.vector.moving else 0.0
    return ConflictSearch(search.problem.tightened(share), search.x, search.holding)


def _relaxed(
    among: ConflictSearch, subsets: Subsets, near: Array | None = None
) -> tuple[Subsets, Relaxation | None]:
    """The least relaxation of subsets, and of what else helps where they cannot give enough.

    There the sum of all shares is least, so that few give: equal shares asked for many.
    """
    for with_places in (False, True):
        relaxation = among.least_relaxation(subsets, near, with_places)
        if relaxation is not None:
            return subsets, relaxation
    others = tuple(n for n in among.names if not any(n in names for names in subsets))
    relaxation = among.least_relaxation([(name,) for name in among.names], near)
    helps = tuple(name for name in others if relaxation and relaxation.gives(name))
    return ((*subsets, helps) if helps else subsets), relaxation


def _sufficient(
    search: Search,
    subsets: Sequence[Sequence[str]],
    by_name: Mapping[str, Requirement],
    amounts: Mapping[str, float],
    alone: Mapping[str, float | None],
    x: Array | None,
) -> tuple[tuple[Concession, ...], bool]:
    """The concessions with which a design near ``x`` is found and can be written, and whether.

    The largest tried if none is. If there is no ``x``, nothing is drawn.
    """
    problem = search.problem
    coarse = problem.grid != FINE_GRID and bool(problem.vector.moving)
    mores = MORE_OF_COARSE if coarse else MORE
    for more in mores if x is not None else (UNDRAWN,):
        larger = {}
        for name, amount in amounts.items():
            limit = abs(by_name[name].limit)
            if amount > (NOTHING * limit if coarse else 0.0):
                most = largest_share(problem.requirements, by_name[name]) * limit
                larger[name] = max(amount, min(amount + more * limit, most))
        given = concessions(problem.requirements, subsets, by_name, larger, alone)
        granted = problem.under(problem.requirements.granting(given))
        if x is None:
            break
        near = search.of(granted, np.clip(x, *granted.bounds))
        if inmost_machine(near, any_will_do=True):
            return given, True
    return given, False
