"""Irreducible infeasible subsets of the requirements: without any one, the rest can be met.

A requirement without which the others can be met belongs to the subset (deletion filter, Chinneck
and Dravnieks 1991). A subset that was found is set aside and the rest is searched on, so that all
conflicts are known; then all of them give at once, each as little as can be, with bores and rods
on the grid. All of it is local, from several starts.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from armdesign.arrays import Array
from armdesign.design.requirements.record import Evaluation
from armdesign.design.search.infeasibility.concessions import largest_share
from armdesign.design.search.infeasibility.elastic_programme import (
    MET,
    STARTS,
    ElasticProgramme,
    ElasticSolution,
    Roles,
)

PAIRS = 60  # of requirements that are tried for a smaller subset
SUBSETS = 8  # that are looked for


@dataclass(frozen=True, eq=False)
class Relaxation:
    """Amounts by which requirements are relaxed, in their units; a design that then meets all."""

    conditions: dict[str, Evaluation]
    amounts: dict[str, float]
    x: Array

    @property
    def nothing(self) -> bool:
        """Whether nothing need give."""
        return all(
            amount <= MET * abs(self.conditions[name].limit)
            for name, amount in self.amounts.items()
        )


@dataclass(eq=False)
class ConflictSearch(ElasticProgramme):
    """The search for subsets from the design ``x``; it moves on to better ones."""

    def irreducible_subset(self, suspects: Sequence[str] | None = None) -> tuple[str, ...]:
        """Names of requirements that cannot be met together, and can without any one of them.

        Empty if all can. The smallest subset that was found among ``suspects`` (all requirements
        if None): single requirements are tried first, and pairs where it has more than two.
        """
        everything = self.names if suspects is None else suspects
        nearest = self.solve(Roles((), everything))
        self.x = nearest.x
        if nearest.met:
            return ()
        violated = self.violated(nearest.x)
        missed = [n for n in everything if n in violated]
        for name in missed:
            if not self.feasible((name,)):
                return (name,)
        involved = [n for n in everything if n in nearest.tight or n in missed]
        if self.feasible(involved):
            involved = list(everything)
        subset = self._deletion_filter(involved, missed, 1)
        if self.feasible(subset):  # one start took for infeasible what others show to be feasible
            subset = self._deletion_filter(involved, missed, STARTS)
        pairs = [(a, b) for a in missed for b in involved if a != b]
        if len(subset) > 2 and len(pairs) <= PAIRS:
            subset = next((pair for pair in pairs if not self.feasible(pair)), subset)
        return tuple(sorted(subset, key=everything.index))

    def disjoint_subsets(self) -> tuple[tuple[str, ...], ...]:
        """Irreducible subsets without a common requirement, until what they leave can be met."""
        subsets: list[tuple[str, ...]] = []
        left = self.names
        while len(subsets) < SUBSETS and (names := self.irreducible_subset(left)):
            subsets.append(names)
            left = [name for name in left if name not in names]
        return tuple(subsets)

    def _deletion_filter(
        self, suspects: Sequence[str], missed: Collection[str], starts: int
    ) -> tuple[str, ...]:
        """Requirements left when all go without which the rest conflicts, by so many starts.

        What is missed goes last.
        """
        kept = list(suspects)
        for name in sorted(suspects, key=lambda n: n in missed):
            others = [n for n in kept if n != name]
            if not self.feasible(others, starts):
                kept = others
        return tuple(kept)

    def roles(self, groups: Sequence[Sequence[str]]) -> Roles:
        """Roles in which groups of requirements give what a file may state; all else must hold."""
        requirements, amounts = self.problem.requirements, self.amounts(self.x)
        most = {name: largest_share(requirements, c) for name, (c, _) in amounts.items()}
        soft = [tuple(name for name in group if most[name] > 0) for group in groups]
        hard = [name for name in amounts if not any(name in group for group in soft)]
        limited = {name: share for name, share in most.items() if 0 < share < math.inf}
        return Roles(soft, hard, limited)

    def least_relaxation(
        self, subsets: Sequence[Sequence[str]], near: Array | None = None
    ) -> Relaxation | None:
        """The least relaxation of the requirements of subsets, equal shares within a subset.

        None if that does not help. What no setting states, like a dead length, is not relaxed. It
        is sought from several starts, least among what they lead to; from that one and today's
        machine if one is ``near``.
        """
        conditions = {name: condition for name, (condition, _) in self.amounts(self.x).items()}
        roles = self.roles(subsets)
        self.x = self.x if near is None else near
        solution = self.solve(roles, starts=2 if near is not None else STARTS)
        if solution.missed > MET:
            return None
        rounded = self.on_grid(solution, roles)
        best: ElasticSolution = rounded if rounded.missed <= MET else solution
        amounts = self.amounts(best.x)
        gives = {name: amounts[name][1] for part in roles.soft for name in part}
        if any(_gives_all(conditions[name], amount) for name, amount in gives.items()):
            return None
        return Relaxation(conditions, gives, best.x)


def _gives_all(condition: Evaluation, amount: float) -> bool:
    """Whether nothing is left of a lower limit that gives an amount."""
    return condition.at_least and amount >= abs(condition.limit) > 0
