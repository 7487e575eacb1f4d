"""Sizes that each cylinder may have, what they leave of every requirement, and why none may be left.

With pins given and as many functions as joints, static forces do not depend on the sizes. Then every requirement is of
one cylinder (thrust, holding, buckling), or a sum over the cylinders (oil): its slack at a combination of sizes is

    slack = slack of the frame + Σ_i change by the size of cylinder i,

and ``check``, asked once for every size of every cylinder, knows all combinations. A requirement for which
this fails on random combinations is left to ``Choices.allowed``, which asks for one combination at a time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from armdesign.arrays import Array
from armdesign.cylinder import Cylinder
from armdesign.design.catalogue import Sizes, offered, sized
from armdesign.design.check import check, static_loads
from armdesign.design.requirements import Requirements
from armdesign.errors import ArmDesignError, InfeasibleError
from armdesign.machine import Machine
from armdesign.workspace import Workspace

TOLERANCE = 1e-9  # of a slack
PROBES = 40  # random combinations on which requirements must be sums
TOUCHED = 1e-12  # a slack that moves less hangs on other things


@dataclass(frozen=True, eq=False, kw_only=True)
class Choices:
    """Cylinders to choose from, and the requirements that they share.

    Attributes:
        cylinders: of every function, the cylinders that meet all requirements of their own.
        slack: of the shared requirements (m,), without the changes, and the tolerance; a combination is allowed at ≥ 0.
        changes: of every function, what each of its cylinders changes on them (sizes, m).
        judge: of all requirements, one combination at a time.
    """

    cylinders: tuple[tuple[Cylinder, ...], ...]
    slack: Array
    changes: tuple[Array, ...]
    judge: Judge

    def allowed(self, combination: Array) -> bool:
        """Whether a combination meets every requirement that sizes touch."""
        made = [options[o] for options, o in zip(self.cylinders, combination, strict=True)]
        return bool(np.all(self.judge.slacks(made)[self.judge.counted] >= 0))


@dataclass(eq=False, kw_only=True)
class Judge:
    """Every requirement's slack, with a tolerance added, for cylinders on the frame; ``counted`` those they touch."""

    frame: Machine
    today: Machine
    workspace: Workspace
    requirements: Requirements
    tolerance: float
    names: list[str] = field(init=False)
    counted: Array = field(init=False)

    def __post_init__(self) -> None:
        self.requirements = replace(self.requirements, pin_box=self.requirements.box(self.today, self.workspace))
        self._loads = static_loads(self.frame, self.workspace)
        self.slacks(self.frame.cylinders)

    def slacks(self, cylinders: Sequence[Cylinder]) -> Array:
        """Slack of every requirement (m,)."""
        machine = replace(self.frame, cylinders=tuple(cylinders))
        checks = check(machine, self.today, self.workspace, self.requirements, self._loads)
        self.names = [c.name for c in checks]
        return np.array([c.slack for c in checks]) + self.tolerance


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
    own, options, changes = list(frame.cylinders), [], []
    slack = judge.slacks(own)
    for i, old in enumerate(today.cylinders):
        stroke, closed = frame.cylinders[i].stroke, frame.cylinders[i].closed_length
        own_sizes = offered(old, sizes, *free[i]) if free else sizes
        made = [
            replace(sized(old, bore, rod, proportional), stroke=stroke, closed_length=closed) for bore, rod in own_sizes
        ]
        options.append(made)
        changes.append(np.array([judge.slacks([*own[:i], c, *own[i + 1 :]]) for c in made]) - slack)
    return _allowed(judge, slack, options, changes)


def _allowed(judge: Judge, slack: Array, options: list[list[Cylinder]], changes: list[Array]) -> Choices:
    """What is left of the options when each meets the requirements of its own cylinder."""
    whole = _not_sums(judge, slack, options, changes)
    moved = np.array([np.any(np.abs(change) > TOUCHED, axis=0) for change in changes])
    touched, judge.counted = moved & ~whole, moved.any(axis=0) | whole
    if not _possible(slack, changes, touched, np.flatnonzero(touched.any(axis=0))):
        what = _conflict(judge.names, slack, changes, touched)
        raise InfeasibleError(judge.frame.name, f"no sizes of the catalogue meet {what}", "loosen them or offer others")
    own, shared = touched.sum(axis=0) == 1, np.flatnonzero(touched.sum(axis=0) > 1)
    kept = [_meeting(slack, change, np.flatnonzero(own & touched[i])) for i, change in enumerate(changes)]
    return Choices(
        cylinders=tuple(tuple(made[o] for o in keep) for made, keep in zip(options, kept, strict=True)),
        slack=slack[shared],
        changes=tuple(change[np.ix_(keep, shared)] for change, keep in zip(changes, kept, strict=True)),
        judge=judge,
    )


def _not_sums(judge: Judge, slack: Array, options: list[list[Cylinder]], changes: list[Array]) -> Array:
    """Requirements (m,) whose slack at some random combinations is not the sum of the changes."""
    random = np.random.default_rng(0)
    found = np.zeros(len(slack), dtype=bool)
    for _ in range(PROBES):
        chosen = [int(random.integers(len(made))) for made in options]
        foreseen = slack + sum(change[o] for change, o in zip(changes, chosen, strict=True))
        true = judge.slacks([made[o] for made, o in zip(options, chosen, strict=True)])
        found |= np.abs(true - foreseen) > 1e-9 * (1 + np.abs(true))
    return found


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
