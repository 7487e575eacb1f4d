"""Sizes that each cylinder may have, what they leave of every requirement, and why none may be left.

With pins given and as many functions as joints, static forces do not depend on the sizes. Then every requirement is of
one cylinder (thrust, holding, buckling), or a sum over the cylinders (oil): its slack at a combination of sizes is

    slack = slack of the frame + Σ_i change by the size of cylinder i,

and ``check``, asked once for every size of every cylinder, knows all combinations. A requirement for which
this fails on random combinations is left to ``Choices.allowed``, which judges combinations themselves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from armdesign.arrays import Array, Flags
from armdesign.cylinder import Cylinder
from armdesign.design.catalogue import Sizes, offered, sized
from armdesign.design.check import slacks, static_loads
from armdesign.design.requirements import Requirements
from armdesign.errors import ArmDesignError, InfeasibleError
from armdesign.machine import Machine
from armdesign.workspace import Workspace

TOLERANCE = 1e-9  # of a slack
PROBES = 40  # random combinations on which requirements must be sums
TOUCHED = 1e-12  # a slack that moves less hangs on other things
LOST = 1e3  # times its limit: a slack below minus this is as good as any other
BATCH = 500  # combinations judged at a time


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
        return np.array([[[f.bore_area, f.annulus_area] for f in self.frame.functions]])

    def slacks(self, areas: Array) -> Array:
        """Slack (b, m) of every requirement at areas (b, nc, 2); what lies below −``LOST`` is lost anyhow."""
        parts = np.array_split(areas, -(-len(areas) // BATCH))
        return np.maximum(np.concatenate([self._judged(part)[1] for part in parts]) + self.tolerance, -LOST)

    def _judged(self, areas: Array) -> tuple[list[str], Array]:
        return slacks(self.frame, areas, self.today, self.workspace, self._requirements, self._loads)

    @cached_property
    def _requirements(self) -> Requirements:
        return replace(self.requirements, pin_box=self.requirements.box(self.today, self.workspace))

    @cached_property
    def _loads(self) -> tuple[Array, Array]:
        return static_loads(self.frame, self.workspace)


@dataclass(frozen=True, eq=False, kw_only=True)
class Choices:
    """Cylinders to choose from, and the requirements that they share.

    Attributes:
        cylinders: of every function, the cylinders that meet all requirements of their own.
        slack: of the shared requirements (m,), without the changes, and the tolerance; a combination is allowed at ≥ 0.
        changes: of every function, what each of its cylinders changes on them (sizes, m).
        judge: of all requirements.
        touched: requirements that hang on the sizes, by their number: those that ``allowed`` looks at.
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
        ArmDesignError: more cylinders and motors than joints; no size with a bore or rod that stays.
        InfeasibleError: no combination meets the requirements; names the fewest that exclude each other.
    """
    if len(frame.functions) > len(frame.joints):
        raise ArmDesignError(
            "catalogue",
            f"{frame.name} has {len(frame.functions)} {'cylinders and motors' if frame.motors else 'cylinders'} "
            f"on {len(frame.joints)} joints: "
            "their static forces hang on the sizes",
            "choose sizes without a catalogue",
        )
    judge = Judge(frame=frame, today=today, workspace=workspace, requirements=requirements, tolerance=tolerance)
    options = []
    for i, old in enumerate(today.cylinders):
        stroke, closed = frame.cylinders[i].stroke, frame.cylinders[i].closed_length
        own_sizes = offered(old, sizes, *free[i]) if free else sizes
        made = [
            replace(sized(old, bore, rod, proportional), stroke=stroke, closed_length=closed) for bore, rod in own_sizes
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
    if not _possible(slack, changes, touched, np.flatnonzero(touched.any(axis=0))):
        what = _conflict(judge.names, slack, changes, touched)
        raise InfeasibleError(judge.frame.name, f"no sizes of the catalogue meet {what}", "loosen them or offer others")
    own_alone, shared = touched.sum(axis=0) == 1, np.flatnonzero(touched.sum(axis=0) > 1)
    kept = [_meeting(slack, change, np.flatnonzero(own_alone & touched[i])) for i, change in enumerate(changes)]
    return Choices(
        cylinders=tuple(tuple(made[o] for o in keep) for made, keep in zip(options, kept, strict=True)),
        slack=slack[shared],
        changes=tuple(change[np.ix_(keep, shared)] for change, keep in zip(changes, kept, strict=True)),
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


def _possible(slack: Array, changes: list[Array], touched: Array, columns: Array) -> bool:
    """Whether some combination meets the requirements in ``columns``."""
    own = touched.sum(axis=0) == 1
    shared = columns[~own[columns]]
    reached = slack[None, shared]
    for i, change in enumerate(changes):
        left = change[_meeting(slack, change, columns[own[columns] & touched[i, columns]])]
        if len(left) == 0:
            return False
        before, more = _undominated(reached), _undominated(left[:, shared])
        reached = (before[:, None] + more).reshape(len(before) * len(more), len(shared))
    return bool(np.any(np.all(reached >= 0, axis=1)))


def _undominated(points: Array) -> Array:
    """Points (n, m) than which no other is at least as large in everything."""
    kept = []
    while len(points) > 0:
        best = points[points.sum(axis=1).argmax()]
        kept.append(best)
        points = points[np.any(points > best, axis=1)]
    return np.array(kept)


def _conflict(names: list[str], slack: Array, changes: list[Array], touched: Array) -> str:
    """Requirements that no combination meets together while any one less could be met; what a lone one is missed by."""
    columns = np.flatnonzero(touched.any(axis=0))
    best = slack + sum(change.max(axis=0) for change in changes)
    missed = columns[best[columns] < 0]
    if len(missed) > 0:
        return " and ".join(f"{names[c]} (the nearest misses it by {100 * -best[c]:.2g} %)" for c in missed)
    for column in columns:
        fewer = columns[columns != column]
        if not _possible(slack, changes, touched, fewer):
            columns = fewer
    return " together with ".join(names[c] for c in columns)
