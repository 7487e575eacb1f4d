"""Sizes that each cylinder may have, and the slack that they leave in every requirement.

With pins given and as many actuators as joints, static forces do not depend on the sizes. Then
every requirement is of one cylinder (thrust, holding, buckling), or a sum over the cylinders
(oil): its slack at a combination of sizes is

    slack = slack of the placed machine + Σ_i change by the size of cylinder i,

and ``check``, asked once for every size of every cylinder, knows all combinations. A requirement
for which this fails on random combinations is left to ``AllowedSizes.meets``, which judges
combinations themselves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from armdesign.arrays import Array, Flags
from armdesign.design.catalogue.sizes import (
    Sizes,
    areas_of_sizes,
    offered,
    refuse_shared_joints,
    sized,
)
from armdesign.design.requirements.check import check, slacks, static_loads
from armdesign.design.requirements.record import Check
from armdesign.design.requirements.settings import Requirements
from armdesign.design.search.infeasibility.concessions import (
    OTHER_SIZES,
    concessions,
    conflict_error,
    largest_share,
    nearest_error,
)
from armdesign.errors import InfeasibleError, UntriedError
from armdesign.frequency.workspace import Workspace
from armdesign.hydraulics.actuator import Cylinder, areas_of
from armdesign.machine.machine import Machine

LOST = 1e3  # times its limit: a slack below minus this is as good as any other
ROUNDING = 1e-12  # of a slack
TOLERANCE = 1e-9  # of a slack


@dataclass(frozen=True, eq=False)
class SlackSums:
    """Slacks as sums over the cylinders."""

    slack: Array  # of the machine as it is placed (m,)
    changes: list[Array]  # by each cylinder's sizes (sizes, m)
    touched: Flags  # which cylinder changes which (nc, m)

    def combination(self, columns: Array) -> Array | None:
        """A combination (nc,) that meets the requirements in ``columns``; None if none does.

        Cylinder after cylinder, combinations that another beats in all that they share are
        dropped.
        """
        alone = self.touched.sum(axis=0) == 1
        shared = columns[~alone[columns]]
        reached, chosen = self.slack[None, shared], np.zeros((1, 0), dtype=int)
        for i, change in enumerate(self.changes):
            left = meeting(self.slack, change, columns[alone[columns] & self.touched[i, columns]])
            if len(left) == 0:
                return None
            left = left[_undominated(change[np.ix_(left, shared)])]
            more = np.tile(change[np.ix_(left, shared)], (len(reached), 1))
            reached = np.repeat(reached, len(left), axis=0) + more
            before = np.repeat(chosen, len(left), axis=0)
            chosen = np.column_stack([before, np.tile(left, len(chosen))])
            best = _undominated(reached)
            reached, chosen = reached[best], chosen[best]
        meets = np.flatnonzero(np.all(reached >= 0, axis=1))
        return chosen[meets[0]] if len(meets) > 0 else None

    def nearest(self, give: Array, keep: Array, most: Array) -> Array | None:
        """The combination that meets ``keep`` and misses ``give`` least in order, or None.

        Of all combinations, so the largest share is proved least, then each share in turn. Nothing
        gives more than the share ``most`` (m,).
        """
        shares, every = np.zeros(len(self.slack)), np.union1d(keep, give)
        shares[give] = most[give]
        best = self.eased(shares).combination(every)
        if best is None:
            return None
        for some in (give, *give[:, None]):
            low, trial, high = 0.0, 0.0, self._missed(best, some)
            while trial < high:
                shares[some] = np.minimum(trial, most[some])
                met = self.eased(shares).combination(every)
                if met is None:
                    low = trial
                else:
                    best, high = met, self._missed(met, some)
                trial = (low + high) / 2 if high - low > TOLERANCE * (1 + high) else high
            shares[some] = np.minimum(high + ROUNDING * (1 + high), most[some])
        return best

    def eased(self, shares: Array) -> SlackSums:
        """The same with requirements eased by shares (m,)."""
        return replace(self, slack=self.slack + shares)

    def _missed(self, combination: Array, columns: Array) -> float:
        """The largest share by which a combination misses requirements."""
        changed = sum(
            change[o, columns] for change, o in zip(self.changes, combination, strict=True)
        )
        return float(np.maximum(-(self.slack[columns] + changed), 0.0).max())


def _undominated(points: Array) -> Array:
    """Rows of points (n, m) than which no other is at least as large in everything."""
    kept, left = [], np.arange(len(points))
    while len(left) > 0:
        best = left[points[left].sum(axis=1).argmax()]
        kept.append(best)
        left = left[np.any(points[left] > points[best], axis=1)]
    return np.array(kept)


def meeting(slack: Array, change: Array, columns: Array) -> Array:
    """Rows of ``change`` that meet the requirements in ``columns``."""
    return np.flatnonzero(np.all(slack[columns] + change[:, columns] >= 0, axis=1))


def disjoint_subsets(sums: SlackSums, columns: Array) -> list[Array]:
    """Irreducible infeasible subsets without a common requirement, until the rest can be met."""
    subsets, left = [], columns
    while sums.combination(left) is None:
        subsets.append(_irreducible_subset(sums, left))
        left = np.setdiff1d(left, subsets[-1])
    return subsets


def _irreducible_subset(sums: SlackSums, columns: Array) -> Array:
    """Requirements that no combination meets together while any one less could be met."""
    for column in columns:
        if sums.combination(np.array([column])) is None:
            return np.array([column])
    for column in columns:
        fewer = columns[columns != column]
        if sums.combination(fewer) is None:
            columns = fewer
    return columns


PROBES = 40  # random combinations on which requirements must be sums
TOUCHED = 1e-12  # a slack that changes less does not depend on the sizes
BATCH = 2000  # combinations judged at a time


@dataclass(frozen=True, eq=False)
class OfferedSizes:
    """Sizes to choose from for a cylinder; each makes one of it when it is asked for."""

    cylinder: Cylinder
    sizes: Sizes
    proportional: bool  # whether dead volumes grow with the areas

    def __getitem__(self, k: int) -> Cylinder:
        """The cylinder with a size."""
        return sized(self.cylinder, *self.sizes[k], self.proportional)

    @cached_property
    def areas(self) -> Array:
        """Bore and annulus area with each size (k, 2) [m²]."""
        return areas_of_sizes(self.cylinder, self.sizes)


@dataclass(frozen=True, eq=False, kw_only=True)
class Judge:
    """Every requirement's slack, with a tolerance added, for other cylinders of a machine."""

    placed: Machine
    today: Machine
    workspace: Workspace
    requirements: Requirements
    tolerance: float

    @cached_property
    def names(self) -> list[str]:
        """Names of the requirements (m)."""
        return self._judged(self.own)[0]

    @cached_property
    def own(self) -> Array:
        """Areas of the placed machine (1, nc, 2) [m², of a motor m³/rad]."""
        return areas_of(self.placed.actuators)[None]

    def slacks(self, areas: Array) -> Array:
        """Slack (b, m) of every requirement at areas (b, nc, 2); below −``LOST`` all is lost."""
        parts = np.array_split(areas, -(-len(areas) // BATCH))
        judged = np.concatenate([self._judged(part)[1] for part in parts])
        return np.maximum(judged + self.tolerance, -LOST)

    def _judged(self, areas: Array) -> tuple[list[str], Array]:
        return slacks(self.placed, areas, self.today, self.workspace, self.limits, self._loads)

    @cached_property
    def limits(self) -> Requirements:
        """The requirements with the pin box of today's workspace."""
        return self.requirements.with_box(self.today, self.workspace)

    @cached_property
    def _loads(self) -> tuple[Array, Array]:
        return static_loads(self.placed, self.workspace)


@dataclass(frozen=True, eq=False, kw_only=True)
class AllowedSizes:
    """Cylinders to choose from, and the requirements that they share.

    A combination is allowed where ``slack`` and what its cylinders change on it are ≥ 0.
    """

    cylinders: tuple[tuple[Cylinder, ...], ...]  # of every actuator those that meet its own limits
    slack: Array  # of the shared requirements (m,), without the changes, with the tolerance
    changes: tuple[Array, ...]  # of every actuator, by each of its cylinders (sizes, m)
    judge: Judge  # of all requirements
    touched: Array  # indices of requirements that depend on the sizes, which ``meets`` judges

    def meets(self, combinations: Array) -> Flags:
        """Whether combinations (k, nc) meet every requirement that sizes touch (k,)."""
        return np.asarray(np.all(self._touched_slacks(combinations) >= 0, axis=1))

    def refusal(self, words: str) -> InfeasibleError:
        """The error where no combination is allowed: what the nearest of some misses."""
        random = np.random.default_rng(0)
        chosen = np.column_stack(
            [random.integers(len(sizes), size=BATCH) for sizes in self.cylinders]
        )
        best = chosen[self._touched_slacks(chosen).min(axis=1).argmax()]
        checks = _checks(self.judge, self.cylinders, best)
        lacks = {c.name: _missed(c) for c in checks if c.slack < -self.judge.tolerance}
        by_name = {c.name: c for c in checks}
        given = concessions(self.judge.requirements, [tuple(lacks)], by_name, lacks, {})
        return nearest_error(self.judge.placed.name, words, given, OTHER_SIZES, UntriedError)

    def _touched_slacks(self, combinations: Array) -> Array:
        areas = np.tile(self.judge.own, (len(combinations), 1, 1))
        for i, sizes in enumerate(self.cylinders):
            areas[:, i] = areas_of(sizes)[combinations[:, i]]
        return self.judge.slacks(areas)[:, self.touched]


def allowed_sizes(
    placed: Machine,
    today: Machine,
    workspace: Workspace,
    requirements: Requirements,
    sizes: Sizes,
    proportional: bool = False,
    tolerance: float = TOLERANCE,
    free: Sequence[tuple[bool, bool]] = (),
) -> AllowedSizes:
    """Sizes of a catalogue that each cylinder of ``placed`` may have.

    Args:
        placed: the machine whose pins, strokes and oil count; its own sizes do not.
        today: the machine that requirements and proportional dead volumes refer to.
        workspace: today's.
        requirements: the limits.
        sizes: bores and rods of the catalogue.
        proportional: dead volumes grow with the areas.
        tolerance: by which a requirement may be missed, for pins that are not final.
        free: of every cylinder, whether its bore and whether its rod may change; all may if empty.

    Raises:
        ArmDesignError: more cylinders and motors than joints; no size with a bore or rod that
            stays.
        InfeasibleError: no combination meets the requirements; names the fewest that exclude each
            other.
    """
    refuse_shared_joints(placed)
    within = {"today": today, "workspace": workspace, "requirements": requirements}
    judge = Judge(placed=placed, **within, tolerance=tolerance)  # type: ignore[arg-type]
    choices = []
    for i, old in enumerate(today.cylinders):
        now = placed.cylinders[i]
        old = replace(old, stroke=now.stroke, closed_length=now.closed_length)
        pairs = offered(old, sizes, *free[i]) if free else sizes
        choices.append(OfferedSizes(old, pairs, proportional))
    return _allowed(judge, choices)


def _allowed(judge: Judge, choices: list[OfferedSizes]) -> AllowedSizes:
    """The cylinders that meet all requirements of their own, and the shared requirements."""
    areas = [choice.areas for choice in choices]
    (slack,), changes = judge.slacks(judge.own), []
    for i, own in enumerate(areas):
        tried = np.tile(judge.own, (len(own), 1, 1))
        tried[:, i] = own
        changes.append(judge.slacks(tried) - slack)
    whole = _not_sums(judge, slack, areas, changes)
    moved = np.array([np.any(np.abs(change) > TOUCHED, axis=0) for change in changes])
    touched = moved & ~whole
    sums = SlackSums(slack, changes, touched)
    if sums.combination(np.flatnonzero(touched.any(axis=0))) is None:
        raise _refusal(judge, choices, sums)
    own_alone, shared = touched.sum(axis=0) == 1, np.flatnonzero(touched.sum(axis=0) > 1)
    kept = [
        meeting(slack, change, np.flatnonzero(own_alone & touched[i]))
        for i, change in enumerate(changes)
    ]
    return AllowedSizes(
        cylinders=tuple(
            tuple(choice[o] for o in keep) for choice, keep in zip(choices, kept, strict=True)
        ),
        slack=slack[shared],
        changes=tuple(
            change[np.ix_(keep, shared)] for change, keep in zip(changes, kept, strict=True)
        ),
        judge=judge,
        touched=np.flatnonzero(moved.any(axis=0) | whole),
    )


def _not_sums(judge: Judge, slack: Array, areas: list[Array], changes: list[Array]) -> Flags:
    """Requirements (m,) whose slack at some random combinations is not the sum of the changes."""
    random = np.random.default_rng(0)
    chosen = [random.integers(len(own), size=PROBES) for own in areas]
    tried = np.tile(judge.own, (PROBES, 1, 1))
    for i, (own, o) in enumerate(zip(areas, chosen, strict=True)):
        tried[:, i] = own[o]
    foreseen = slack + sum(change[o] for change, o in zip(changes, chosen, strict=True))
    true = judge.slacks(tried)
    return np.asarray(np.any(np.abs(true - foreseen) > 1e-9 * (1 + np.abs(true)), axis=0))


def _refusal(judge: Judge, choices: Sequence[OfferedSizes], sums: SlackSums) -> InfeasibleError:
    """The error that names requirements that exclude each other, and their least relaxation."""
    every = np.flatnonzero(sums.touched.any(axis=0))
    subsets = disjoint_subsets(sums, every)
    columns = np.concatenate(subsets)
    others = np.setdiff1d(every, columns)
    any_share, most = np.full(len(sums.slack), 2 * LOST), _largest_shares(judge)
    together = sums.nearest(columns, others, most)
    if together is None:  # no file may state enough
        most = any_share
        together = sums.nearest(columns, others, most)
    assert together is not None  # what is left can be met
    checks = _checks(judge, choices, together)
    alone: dict[str, float | None] = {}
    for subset in subsets:
        eased = np.zeros(len(sums.slack))
        given = np.setdiff1d(columns, subset)
        eased[given] = [max(-checks[column].slack, 0.0) + ROUNDING for column in given]
        for column in subset:
            only = sums.eased(eased).nearest(np.array([column]), every[every != column], most)
            amount = None if only is None else _missed(_checks(judge, choices, only)[column])
            alone[checks[column].name] = amount
    names = [tuple(checks[column].name for column in subset) for subset in subsets]
    amounts = {checks[column].name: _missed(checks[column]) for column in columns}
    conflict = concessions(judge.requirements, names, {c.name: c for c in checks}, amounts, alone)
    return conflict_error(
        judge.placed.name, conflict, "no sizes of the catalogue meet", otherwise=OTHER_SIZES
    )


def _largest_shares(judge: Judge) -> Array:
    """Shares (m,) by which requirements can be relaxed, until no file allows their settings."""
    checks = check(judge.placed, judge.today, judge.workspace, judge.limits)
    shares = [largest_share(judge.requirements, c) for c in checks]
    return np.minimum(shares, 2 * LOST)


def _checks(
    judge: Judge, choices: Sequence[OfferedSizes | Sequence[Cylinder]], combination: Array
) -> tuple[Check, ...]:
    """Every requirement of a combination, in the order of the judge's names."""
    chosen = tuple(sizes[o] for sizes, o in zip(choices, combination, strict=True))
    machine = replace(judge.placed, cylinders=chosen)
    return check(machine, judge.today, judge.workspace, judge.limits)


def _missed(c: Check) -> float:
    """Amount by which a requirement is missed, in its unit; 0 if it is met."""
    return abs(c.value - c.limit) if c.slack < 0 else 0.0
