"""Irreducible infeasible subsets of the requirements: without any one, the rest can be met.

A requirement without which the others can be met belongs to the subset (deletion filter, Chinneck
and Dravnieks 1991). The filter works on linear programmes: on the requirements linearised over all
bounds, at a few designs at once. What conflicts at each of these is then sought a design for; one
that is found is a further place to linearise, until there is none. So few searches are needed.

A subset that was found is set aside and the rest is searched on, so that all conflicts are known;
then all of them give at once, each as little as can be, with bores and rods on the grid. All of it
is local, from several starts.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from armdesign.arrays import Array
from armdesign.design.catalogue.sizes import FINE as FINE_GRID
from armdesign.design.program.constraints import holding_rows
from armdesign.design.requirements.record import Evaluation
from armdesign.design.search.infeasibility.concessions import largest_share
from armdesign.design.search.infeasibility.elastic_programme import (
    FINE,
    MET,
    ROUGH,
    STARTS,
    ElasticProgramme,
    ElasticSolution,
    Roles,
    Rooms,
)

SUBSETS = 8  # that are looked for
PLACES = 12  # at which requirements are linearised for one
NEAR = 2  # starts of a search that only sorts out: the nearest design known, and today's


@dataclass(frozen=True, eq=False)
class Relaxation:
    """Amounts by which requirements are relaxed, in their units; a design that then meets all."""

    conditions: dict[str, Evaluation]
    amounts: dict[str, float]
    x: Array

    @property
    def nothing(self) -> bool:
        """Whether nothing need give."""
        return not any(map(self.gives, self.amounts))

    def gives(self, name: str) -> bool:
        """Whether a requirement is relaxed, by more than what searches may miss it by."""
        return self.amounts.get(name, 0.0) > MET * abs(self.conditions[name].limit)


@dataclass(eq=False)
class ConflictSearch(ElasticProgramme):
    """The search for subsets near the design ``x``.

    Attributes:
        visited: rooms of all requirements at the designs that were found.
    """

    visited: list[Rooms] = field(default_factory=list)

    def feasible(self, names: Collection[str], starts: int = STARTS) -> bool:
        """Whether some design meets these requirements: one found before, or from so many starts.

        The first of them is the design known that misses fewest.
        """
        return self._meeting(names) is not None or self._sought(names, starts).met

    def irreducible_subset(self, suspects: Sequence[str] | None = None) -> tuple[str, ...]:
        """Names of requirements that cannot be met together, and can without any one of them.

        Empty if all can. Of ``suspects``, all requirements if None.
        """
        everything = self.names if suspects is None else suspects
        if self._meeting(everything) or self._sought(everything, 1).met:
            return ()
        nearest, subset = self.visited[-1], list[str]()
        places = [self.rooms(self.problem.vector.start), nearest]
        for _ in range(PLACES):
            subset = self._linear_subset(places, everything, nearest.missed)
            if not subset or not self.feasible(subset):
                break
            places.append(self._meeting(subset) or self.visited[-1])
        if not subset or self._meeting(subset):  # no linear programme shows a conflict
            solution = self._sought(everything, STARTS)
            if solution.met:
                return ()
            nearest = self.visited[-1]
            held = solution.tight | nearest.missed
            subset = [n for n in everything if n in held]
            subset = list(everything) if self.feasible(subset) else subset
        missed = nearest.missed
        found = self._deletion_filter(subset, missed, NEAR)
        if len(found) < len(subset) and self.feasible(found):  # others show that it is feasible
            found = self._deletion_filter(subset, missed, STARTS)
        return tuple(sorted(found, key=everything.index))

    def disjoint_subsets(self) -> tuple[tuple[str, ...], ...]:
        """Irreducible subsets without a common requirement, until what they leave can be met.

        The smallest first. The search moves on to the design that misses fewest.
        """
        subsets: list[tuple[str, ...]] = []
        left = self.names
        while len(subsets) < SUBSETS and (names := self.irreducible_subset(left)):
            subsets.append(names)
            left = [name for name in left if name not in names]
        self.x = min(self.visited, key=lambda at: len(at.missed)).x
        return tuple(sorted(subsets, key=lambda names: (len(names), self.names.index(names[0]))))

    def _sought(self, names: Collection[str], starts: int) -> ElasticSolution:
        """The design that misses these requirements least, from so many starts."""
        near = min(self.visited, key=lambda at: len(at.missed.intersection(names)), default=None)
        x = self.x if near is None else near.x
        search = replace(self, x=x)
        solution = search.solve(Roles((), names), ROUGH, starts)
        self.holding = search.holding
        self.visited.append(self.rooms(solution.x))
        return solution

    def _meeting(self, names: Collection[str]) -> Rooms | None:
        """The rooms at a design found before that meets these requirements, if any."""
        for at in self.visited:
            if at.missed.isdisjoint(names) and self._watched(at.x, names):
                return at
        return None

    def _watched(self, x: Array, names: Collection[str]) -> bool:
        """Whether all rows are watched at which x is loaded most, where a load is limited."""
        loads = any(name.startswith("holding.") for name in names)
        return not loads or bool(np.isin(holding_rows(self.problem, x), self.holding).all())

    def _linear_subset(
        self, places: Sequence[Rooms], names: Sequence[str], missed: Collection[str]
    ) -> list[str]:
        """Requirements that conflict linearised at each place, and do not without any one of them.

        Empty if all can be met at some place. What is missed goes last.
        """
        kept = self._multipliers(places, names)
        for name in sorted(kept, key=lambda n: (n in missed, names.index(n))):
            others = [n for n in kept if n != name]
            if name in kept and (fewer := self._multipliers(places, others)):
                kept = fewer
        return [name for name in names if name in kept]

    def _multipliers(self, places: Sequence[Rooms], names: Collection[str]) -> frozenset[str]:
        """Those of the requirements with a multiplier in their conflict at some place.

        Empty if they can be met at one: what met them last is tried first.
        """
        held: frozenset[str] = frozenset()
        for at in reversed(places):
            tight = at.conflict(names, self.problem.bounds)
            if not tight:
                return tight
            held |= tight
        return held

    def _deletion_filter(
        self, suspects: Sequence[str], missed: Collection[str], starts: int
    ) -> list[str]:
        """Requirements left when all go without which the rest conflicts, by so many starts.

        What is missed goes last.
        """
        kept = list(suspects)
        for name in sorted(suspects, key=lambda n: n in missed):
            others = [n for n in kept if n != name]
            if not self.feasible(others, starts):
                kept = others
        return kept

    def roles(self, groups: Sequence[Sequence[str]], with_places: bool = True) -> Roles:
        """Roles in which groups of requirements give what a file may state; all else must hold.

        Distances of pins and barrels from edges and parts, which are lengths and no shares of
        today's, too; only where nothing else of their group can if not ``with_places``.
        """
        requirements, amounts = self.problem.requirements, self.amounts(self.x)
        most = {name: largest_share(requirements, c) for name, (c, _) in amounts.items()}
        soft = [tuple(name for name in group if most[name] > 0) for group in groups]
        if not with_places:
            places = {name for name, (c, _) in amounts.items() if c.slack_scale is not None}
            soft = [tuple(n for n in group if n not in places) or group for group in soft]
        hard = [name for name in amounts if not any(name in group for group in soft)]
        limited = {n: amounts[n][0].room(s) for n, s in most.items() if 0 < s < math.inf}
        return Roles(soft, hard, limited)

    def least_relaxation(
        self,
        subsets: Sequence[Sequence[str]],
        near: Array | None = None,
        with_places: bool = True,
        tolerance: float = FINE,
    ) -> Relaxation | None:
        """The least relaxation of the requirements of subsets, equal shares within a subset.

        None if that does not help. What no setting states, like a dead length, is not relaxed. It
        is sought from several starts, least among what they lead to; from that one and today's
        machine if one is ``near``, with the ``tolerance`` of ``solve``. Places give as ``roles``
        says. Sizes go to the grid where that is fine.
        """
        conditions = {name: condition for name, (condition, _) in self.amounts(self.x).items()}
        roles = self.roles(subsets, with_places)
        self.x = self.x if near is None else near
        fine = self.problem.grid == FINE_GRID
        starts = STARTS if near is None else NEAR
        solution = self.solve(roles, tolerance, starts)
        if solution.missed > MET:
            return None
        best: ElasticSolution = solution
        if fine and (rounded := self.on_grid(solution, roles)).missed <= MET:
            best = rounded
        amounts = self.amounts(best.x)
        gives = {name: amounts[name][1] for part in roles.soft for name in part}
        if any(_gives_all(conditions[name], amount) for name, amount in gives.items()):
            return None
        return Relaxation(conditions, gives, best.x)


def _gives_all(condition: Evaluation, amount: float) -> bool:
    """Whether nothing is left of a lower limit that gives an amount."""
    return condition.at_least and amount >= abs(condition.limit) > 0
