"""Sizes that each cylinder may have, what they leave of every requirement, and why none may be left.

With pins given and as many actuators as joints, static forces do not depend on the sizes. Then
every requirement is of one cylinder (thrust, holding, buckling), or a sum over the cylinders
(oil): its slack at a combination of sizes is

    slack = slack of the frame + Σ_i change by the size of cylinder i,

and ``check``, asked once for every size of every cylinder, knows all combinations. A requirement
for which this fails on random combinations is left to ``Choices.allowed``, which judges
combinations themselves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from armdesign.arrays import Array, Flags
from armdesign.design.catalogue.sizes import Sizes, offered, sized
from armdesign.design.requirements.check import check, slacks, static_loads
from armdesign.design.requirements.record import Check
from armdesign.design.requirements.settings import Requirements
from armdesign.design.search.infeasibility import concessions, nearest, remedy, sentence
from armdesign.errors import ArmDesignError, InfeasibleError, UntriedError
from armdesign.frequency.workspace import Workspace
from armdesign.hydraulics.actuator import Cylinder
from armdesign.machine.machine import Machine

TOLERANCE = 1e-9  # of a slack
PROBES = 40  # random combinations on which requirements must be sums
TOUCHED = 1e-12  # a slack that moves less depends on other things
LOST = 1e3  # times its limit: a slack below minus this is as good as any other
BATCH = 500  # combinations judged at a time
ROUNDING = 1e-12  # of a slack


@dataclass(frozen=True, eq=False, kw_only=True)
class Judge:
    """Every requirement's slack, with a tolerance added, for other cylinders on the pins and strokes of ``frame``."""

    frame: Machine
    today: Machine
    workspace: Workspace
    requirements: Requirements
    tolerance: float

    @cached_property
    def names(self) -> list[str]:
        """Of the requirements (m)."""
        return self._judged(self.own)[0]

    @cached_property
    def own(self) -> Array:
        """Areas of the frame (1, nc, 2) [m², of a motor m³/rad]."""
        return np.array([[[f.bore_area, f.annulus_area] for f in self.frame.actuators]])

    def slacks(self, areas: Array) -> Array:
        """Slack (b, m) of every requirement at areas (b, nc, 2).

        What lies below −``LOST`` is lost anyhow.
        """
        parts = np.array_split(areas, -(-len(areas) // BATCH))
        return np.maximum(
            np.concatenate([self._judged(part)[1] for part in parts]) + self.tolerance, -LOST
        )

    def _judged(self, areas: Array) -> tuple[list[str], Array]:
        return slacks(self.frame, areas, self.today, self.workspace, self.limits, self._loads)

    @cached_property
    def limits(self) -> Requirements:
        """The requirements, the pin box that of today's workspace."""
        return replace(
            self.requirements, pin_box=self.requirements.box(self.today, self.workspace)
        )

    @cached_property
    def _loads(self) -> tuple[Array, Array]:
        return static_loads(self.frame, self.workspace)


@dataclass(frozen=True, eq=False, kw_only=True)
class Choices:
    """Cylinders to choose from, and the requirements that they share.

    Attributes:
        cylinders: of every actuator, the cylinders that meet all requirements of their own.
        slack: of the shared requirements (m,), without the changes, and the tolerance; a
            combination is allowed at ≥ 0.
        changes: of every actuator, what each of its cylinders changes on them (sizes, m).
        judge: of all requirements.
        touched: requirements that depend on the sizes, by their number: those that ``allowed``
            looks at.
    """

    cylinders: tuple[tuple[Cylinder, ...], ...]
    slack: Array
    changes: tuple[Array, ...]
    judge: Judge
    touched: Array

    def allowed(self, combinations: Array) -> Flags:
        """Whether combinations (k, nc) meet every requirement that sizes touch (k,)."""
        areas = np.tile(self.judge.own, (len(combinations), 1, 1))
        for i, options in enumerate(self.cylinders):
            areas[:, i] = _areas(options)[combinations[:, i]]
        return np.asarray(np.all(self.judge.slacks(areas)[:, self.touched] >= 0, axis=1))

    def refusal(self, words: str) -> UntriedError:
        """The error where no combination is allowed: what the one of some at random that misses least must be given."""
        random = np.random.default_rng(0)
        chosen = np.column_stack(
            [random.integers(len(options), size=BATCH) for options in self.cylinders]
        )
        areas = np.tile(self.judge.own, (BATCH, 1, 1))
        for i, options in enumerate(self.cylinders):
            areas[:, i] = _areas(options)[chosen[:, i]]
        best = chosen[self.judge.slacks(areas)[:, self.touched].min(axis=1).argmax()]
        checks = _checks(self.judge, [list(options) for options in self.cylinders], best)
        lacks = {c.name: _missed(c) for c in checks if c.slack < -self.judge.tolerance}
        of = {c.name: c for c in checks}
        given = concessions(self.judge.requirements, [tuple(lacks)], of, lacks, {})
        told = f"{words}{nearest(given)}"
        return UntriedError(
            self.judge.frame.name, told, remedy(given, " or offer other sizes"), given
        )


def choices(
    frame: Machine,
    today: Machine,
    workspace: Workspace,
    requirements: Requirements,
    sizes: Sizes,
    proportional: bool = False,
    tolerance: float = TOLERANCE,
    free: Sequence[tuple[bool, bool]] = (),
) -> Choices:
    """Which sizes of a catalogue each cylinder of ``frame`` may have.

    Args:
        frame: the machine whose pins, strokes and oil count; its own sizes do not.
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
    if len(frame.actuators) > len(frame.joints):
        raise ArmDesignError(
            "catalogue",
            f"{frame.name} has {len(frame.actuators)}"
            f" {'cylinders and motors' if frame.motors else 'cylinders'} on {len(frame.joints)}"
            " joints: their static forces depend on the sizes",
            "choose sizes without a catalogue",
        )
    judge = Judge(
        frame=frame,
        today=today,
        workspace=workspace,
        requirements=requirements,
        tolerance=tolerance,
    )
    options = []
    for i, old in enumerate(today.cylinders):
        stroke, closed = frame.cylinders[i].stroke, frame.cylinders[i].closed_length
        own_sizes = offered(old, sizes, *free[i]) if free else sizes
        made = [
            replace(sized(old, bore, rod, proportional), stroke=stroke, closed_length=closed)
            for bore, rod in own_sizes
        ]
        options.append(made)
    return _allowed(judge, options)


def _areas(options: Sequence[Cylinder]) -> Array:
    """Areas (sizes, 2) [m²]."""
    return np.array([[c.bore_area, c.annulus_area] for c in options])


def _allowed(judge: Judge, options: list[list[Cylinder]]) -> Choices:
    """What is left of the options when each meets the requirements of its own cylinder."""
    areas = [_areas(made) for made in options]
    (slack,), changes = judge.slacks(judge.own), []
    for i, own in enumerate(areas):
        tried = np.tile(judge.own, (len(own), 1, 1))
        tried[:, i] = own
        changes.append(judge.slacks(tried) - slack)
    whole = _not_sums(judge, slack, areas, changes)
    moved = np.array([np.any(np.abs(change) > TOUCHED, axis=0) for change in changes])
    touched = moved & ~whole
    sums = _Sums(slack, changes, touched)
    if sums.possible(np.flatnonzero(touched.any(axis=0))) is None:
        raise _refusal(judge, options, sums)
    own_alone, shared = touched.sum(axis=0) == 1, np.flatnonzero(touched.sum(axis=0) > 1)
    kept = [
        _meeting(slack, change, np.flatnonzero(own_alone & touched[i]))
        for i, change in enumerate(changes)
    ]
    return Choices(
        cylinders=tuple(
            tuple(made[o] for o in keep) for made, keep in zip(options, kept, strict=True)
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


def _meeting(slack: Array, change: Array, columns: Array) -> Array:
    """Rows of ``change`` that meet the requirements in ``columns``."""
    return np.flatnonzero(np.all(slack[columns] + change[:, columns] >= 0, axis=1))


@dataclass(frozen=True, eq=False)
class _Sums:
    """Slacks as sums: of the frame (m,), changes by each cylinder's sizes (sizes, m), who touches which (nc, m)."""

    slack: Array
    changes: list[Array]
    touched: Flags

    def possible(self, columns: Array) -> Array | None:
        """A combination (nc,) that meets the requirements in ``columns``; None if none does.

        Cylinder after cylinder, combinations that another beats in all that they share are
        dropped.
        """
        alone = self.touched.sum(axis=0) == 1
        shared = columns[~alone[columns]]
        reached, chosen = self.slack[None, shared], np.zeros((1, 0), dtype=int)
        for i, change in enumerate(self.changes):
            left = _meeting(self.slack, change, columns[alone[columns] & self.touched[i, columns]])
            if len(left) == 0:
                return None
            left = left[_undominated(change[np.ix_(left, shared)])]
            reached = np.repeat(reached, len(left), axis=0) + np.tile(
                change[np.ix_(left, shared)], (len(reached), 1)
            )
            chosen = np.column_stack(
                [np.repeat(chosen, len(left), axis=0), np.tile(left, len(chosen))]
            )
            best = _undominated(reached)
            reached, chosen = reached[best], chosen[best]
        meets = np.flatnonzero(np.all(reached >= 0, axis=1))
        return chosen[meets[0]] if len(meets) > 0 else None

    def nearest(self, give: Array, keep: Array) -> Array | None:
        """The combination (nc,) that meets ``keep`` and misses ``give`` by the least largest share; None if none can.

        Of several that do, one that misses the first of ``give`` least, then the next.
        """
        shares, every = np.zeros(len(self.slack)), np.union1d(keep, give)
        shares[give] = 2 * LOST
        best = self.eased(shares).possible(every)
        if best is None:
            return None
        for some in (give, *give[:, None]):
            low, trial, high = 0.0, 0.0, self._missed(best, some)
            while trial < high:
                shares[some] = trial
                met = self.eased(shares).possible(every)
                if met is None:
                    low = trial
                else:
                    best, high = met, self._missed(met, some)
                trial = (low + high) / 2 if high - low > TOLERANCE * (1 + high) else high
            shares[some] = high + ROUNDING * (1 + high)
        return best

    def eased(self, shares: Array) -> _Sums:
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


def _refusal(judge: Judge, options: list[list[Cylinder]], sums: _Sums) -> InfeasibleError:
    """The error that names requirements that exclude each other, and what they must give: an allowed combination."""
    every = np.flatnonzero(sums.touched.any(axis=0))
    parts = _conflicts(sums, every)
    columns = np.concatenate(parts)
    others = np.setdiff1d(every, columns)
    together = sums.nearest(columns, others)
    assert together is not None  # what is left can be met
    checks = _checks(judge, options, together)
    alone: dict[str, float | None] = {}
    for part in parts:
        eased = np.zeros(len(sums.slack))
        given = np.setdiff1d(columns, part)
        eased[given] = [max(-checks[column].slack, 0.0) + ROUNDING for column in given]
        for column in part:
            only = sums.eased(eased).nearest(np.array([column]), every[every != column])
            c = checks[column]
            alone[c.name] = (
                None if only is None else _missed(_checks(judge, options, only)[column])
            )
    names = [tuple(checks[column].name for column in part) for part in parts]
    amounts = {checks[column].name: _missed(checks[column]) for column in columns}
    conflict = concessions(judge.requirements, names, {c.name: c for c in checks}, amounts, alone)
    words = sentence(conflict, none_meets="no sizes of the catalogue meet")
    return InfeasibleError(
        judge.frame.name, words, remedy(conflict, " or offer other sizes"), conflict
    )


def _checks(judge: Judge, options: list[list[Cylinder]], combination: Array) -> tuple[Check, ...]:
    """Every requirement of a combination, in the order of the judge's names."""
    cylinders = tuple(made[o] for made, o in zip(options, combination, strict=True))
    return check(
        replace(judge.frame, cylinders=cylinders), judge.today, judge.workspace, judge.limits
    )


def _missed(c: Check) -> float:
    """By how much, in its unit."""
    return abs(c.value - c.limit) if c.slack < 0 else 0.0


def _conflicts(sums: _Sums, columns: Array) -> list[Array]:
    """Conflicts that have no requirement in common, until what they leave can be met."""
    found, left = [], columns
    while sums.possible(left) is None:
        found.append(_conflicting(sums, left))
        left = np.setdiff1d(left, found[-1])
    return found


def _conflicting(sums: _Sums, columns: Array) -> Array:
    """Requirements that no combination meets together while any one less could be met."""
    for column in columns:
        if sums.possible(np.array([column])) is None:
            return np.array([column])
    for column in columns:
        fewer = columns[columns != column]
        if sums.possible(fewer) is None:
            columns = fewer
    return columns
