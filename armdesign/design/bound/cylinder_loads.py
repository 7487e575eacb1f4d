"""Loads that one cylinder must hold: of the workspace, and of lifts at their poses.

A load is a torque about the cylinder's joint. Where a place can be reached in several poses, one
of them is enough. The requirements themselves are in ``requirements/`` (``holding``,
``lift_share``); ``test_branching_against_dense_sampling`` and ``test_limits_of_single_cylinders``
tie the two statements.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from armdesign.arrays import Array, Flags
from armdesign.design.bound.intervals import Interval, interval
from armdesign.design.bound.mass_enclosure import BarEnclosure
from armdesign.design.program.problem import Problem
from armdesign.design.requirements.holding import lift_pose
from armdesign.design.requirements.lift_share import chart_today
from armdesign.machine.file.schema import share_of
from armdesign.machine.lift_chart import HYDRAULIC_SHARE
from armdesign.machine.lifting import unloaded
from armdesign.mechanism.rigid_poses import RigidPoses

HOLDING_ANGLES = 5  # of most push and pull today
CHART_PLACES = 40  # of a lift chart, that ask for most today


@dataclass(frozen=True, eq=False, kw_only=True)
class Loads:
    """Loads of one cylinder at poses of its joint.

    Attributes:
        angle: of the joint (n,) [rad, m].
        held: torques over the share of the supply that may hold them (2, n) [N m], ≥ 0: by which
            they push and by which they pull.
        place: index of what asks for each (n,), ascending; of several poses of one place the
            easiest counts.
    """

    angle: Array
    held: Array
    place: Array

    def most(self, size: Array) -> Array:
        """Greatest torque over rate of push and pull (2, m), for rates (n, m) of this size."""
        if len(self.angle) == 0:
            return np.zeros((2, size.shape[1]))
        starts = np.flatnonzero(np.diff(self.place, prepend=-1))
        easiest = np.minimum.reduceat(self.held[..., None] / size, starts, axis=1)
        return np.asarray(easiest.max(axis=1))

    def greatest(self, size: Interval) -> Flags:
        """Loads (n, m) of places that may ask for most where rates (n, m) have these sizes."""
        if len(self.angle) == 0:
            return np.zeros(size.low.shape, dtype=bool)
        starts = np.flatnonzero(np.diff(self.place, prepend=-1))
        least, most = (
            np.minimum.reduceat(self.held[..., None] / end, starts, axis=1)
            for end in (size.high, size.low)
        )
        greatest = (most > 0) & (most >= least.max(axis=1, keepdims=True))
        count = np.diff([*starts, len(self.place)])
        return np.repeat(greatest.any(axis=0), count, axis=0)

    def __getitem__(self, loads: Array) -> Loads:
        place = np.unique(self.place[loads], return_inverse=True)[1]
        return Loads(angle=self.angle[loads], held=self.held[:, loads], place=place)


def loads_of(problem: Problem, i: int, bars: Sequence[BarEnclosure], sign: float) -> Loads:
    """Loads of cylinder ``i``, of a moment arm of some sign, under ``bars``."""
    parts = [
        _of_workspace(problem, i, bars),
        *_of_lifts(problem, i, bars),
        *_of_chart(problem, i, bars),
    ]
    places = [part.place for part in parts]
    starts = np.cumsum([0, *(int(place[-1]) + 1 for place in places[:-1])])
    held = np.concatenate([part.held for part in parts], axis=1)
    return Loads(
        angle=np.concatenate([part.angle for part in parts]),
        held=held if sign > 0 else held[::-1],
        place=np.concatenate([p + start for p, start in zip(places, starts, strict=True)]),
    )


def _of_workspace(problem: Problem, i: int, bars: Sequence[BarEnclosure]) -> Loads:
    """At the angles at which today's cylinder pushes or pulls most.

    The greatest that some load asks for at least, and the least that some load asks for at most.
    """
    joint, rows = problem.machine.linkages[i].joints[0], problem.dynamics.nominal_rows
    own, torque = problem.workspace.q[rows.pose, joint], rows.gravity[:, joint]
    angles, index = np.unique(own, return_inverse=True)
    order = np.lexsort([torque, index])
    starts = np.searchsorted(index[order], np.arange(len(angles) + 1))
    ends = np.stack([order[starts[1:] - 1], order[starts[:-1]]])
    ranged = problem.vector.range_poses[i]
    assert ranged is not None
    order = np.argsort(ranged.q[:, joint])
    arms = np.interp(angles, ranged.q[order, joint], problem.vector.arms_today[i][order])
    chosen = np.unique(
        [np.argsort(way * torque[e] / arms)[-HOLDING_ANGLES:] for e in ends for way in (1, -1)]
    )
    most, least = (
        _with_bars(torque[e], bars, problem.workspace.rigid[rows.pose[e]], joint)
        for e in ends[:, chosen]
    )
    held = np.maximum([np.maximum(most.low, least.low), -np.minimum(most.high, least.high)], 0.0)
    share = share_of(problem.requirements.holding_share, problem.machine.cylinders[i].name)
    return Loads(angle=angles[chosen], held=held / share, place=np.arange(len(chosen)))


def _of_lifts(problem: Problem, i: int, bars: Sequence[BarEnclosure]) -> list[Loads]:
    """Of each lift, in the direction in which its mass loads the cylinder."""
    joint, shares = problem.machine.linkages[i].joints[0], problem.requirements.holding_share
    share, loads = share_of(shares, problem.machine.cylinders[i].name), []
    for lift in problem.requirements.lifts:
        at = lift_pose(problem.machine, lift, shares)
        held = _lifted(problem, bars, at.rigid, at.torque * lift.mass, joint) / share
        place = np.zeros(len(at.rigid), dtype=int)
        loads.append(Loads(angle=at.rigid.q[:, joint], held=held, place=place))
    return loads


def _of_chart(problem: Problem, i: int, bars: Sequence[BarEnclosure]) -> Iterator[Loads]:
    """Of the places of today's lift chart that ask for most of today's cylinder."""
    machine, joint = problem.machine, problem.machine.linkages[i].joints[0]
    share = share_of(problem.requirements.lift_share, machine.cylinders[i].name)
    known = chart_today(machine) if share > 0 else None
    if known is None:
        return
    poses, today = known
    own = np.flatnonzero(today[poses.place] > 0)
    rigid, place = poses.rigid[own], poses.place[own]
    load = poses.torque[own] * (share * today[place])[:, None]
    held = _lifted(problem, bars, rigid, load, joint) / HYDRAULIC_SHARE
    arms = machine.linkages[i].actuation(rigid).moment_arm[:, joint]
    each, starts = np.unique(place, return_index=True)
    needed = np.minimum.reduceat(held.max(axis=0) / np.abs(arms), starts)
    chosen = np.isin(place, each[np.argsort(-needed)[:CHART_PLACES]])
    index = np.unique(place[chosen], return_inverse=True)[1]
    yield Loads(angle=rigid.q[chosen, joint], held=held[:, chosen], place=index)


def _lifted(
    problem: Problem, bars: Sequence[BarEnclosure], rigid: RigidPoses, load: Array, joint: int
) -> Array:
    """Torques (2, n) [N m], ≥ 0, that a load's own torques (n, nq) and the machine's ask for."""
    own = load[:, joint]
    bare = _with_bars(unloaded(problem.vector.bare, rigid)[:, joint], bars, rigid, joint)
    needed = np.stack([bare.low + own, -bare.high - own])
    return np.where(np.stack([own, -own]) > 0, np.maximum(needed, 0.0), 0.0)


def _with_bars(
    torque: Array, bars: Sequence[BarEnclosure], rigid: RigidPoses, joint: int
) -> Interval:
    """Gravity torques about a joint (n,), whatever the bars' designs."""
    total = interval(torque)
    for bar in bars:
        total = total + bar.gravity(rigid)[:, joint]
    return total
