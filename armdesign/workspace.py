"""Workspaces: sets of poses at which a machine is asked questions.

The edges belong to it, because there the worst poses lie: joint ranges end exactly where a cylinder keeps its end
margin, and poses exactly on the pitch limits of the load cases are added to the grid.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armdesign.arm import RigidPoses
from armdesign.arrays import Array
from armdesign.errors import ArmDesignError
from armdesign.machine import Machine, Payload
from armdesign.ranges import over

POSES = 20_000  # of the default grid
MARGIN_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class Workspace:
    """Poses of a machine; make one with ``Workspace.grid``.

    Attributes:
        q: joint positions (n, nq) [rad, m]: the grid (last joint fastest), then the poses on pitch limits.
        axes: grid values of each joint [rad, m].
        end_margin: share of its stroke that every cylinder keeps free at both ends.
        machine: the machine that the workspace was made for: today's.
    """

    q: Array
    axes: tuple[Array, ...]
    end_margin: float
    machine: Machine

    @classmethod
    def grid(
        cls, machine: Machine, points: int | Sequence[int] | None = None, end_margin: float | None = None
    ) -> Workspace:
        """Joint grid, ends included, with the poses on the load cases' pitch limits added.

        Args:
            machine: today's machine.
            points: number of values per joint, one for all or one each (≥ 2); default about 20 000 poses, the last
                joint finest.
            end_margin: share of the stroke, 0 ≤ … < 0.5; default: the machine's requirement.

        Raises:
            ArmDesignError: counts or margin that cannot be, or nothing left.
        """
        nq = len(machine.joints)
        counts = _counts(machine, points)
        margin = machine.section.requirements.end_margin if end_margin is None else end_margin
        if isinstance(margin, bool) or not isinstance(margin, int | float | np.number) or not 0 <= margin < 0.5:
            raise ArmDesignError("end_margin", f"{margin!r} is not allowed", "give a share of the stroke in [0, 0.5)")
        ranges = machine.range_within(margin)
        axes = tuple(over(ends, count) for ends, count in zip(ranges, counts, strict=True))
        q = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, nq)
        edges = [_on_pitch_limits(machine, payload, axes) for payload in machine.payloads if payload.pitch]
        q = np.concatenate([q, *edges])
        q = q[machine.margins(q).min(axis=1) >= margin - MARGIN_TOLERANCE]
        if len(q) == 0:
            raise ArmDesignError(f"{machine.name}: workspace", "no pose of the grid is in stroke", "give more points")
        q.setflags(write=False)
        return cls(q, axes, margin, machine)

    def __len__(self) -> int:
        return len(self.q)

    @property
    def ranges(self) -> Array:
        """Ends of the grid (nq, 2) [rad, m]."""
        return np.array([[axis[0], axis[-1]] for axis in self.axes])

    @cached_property
    def rigid(self) -> RigidPoses:
        """The bare links at all poses: computed once, used for every design and payload."""
        return self.machine.rigid_poses(self.q)


def _counts(machine: Machine, points: int | Sequence[int] | None) -> list[int]:
    nq = len(machine.joints)
    if points is None:
        base = max(min(int((POSES / 1.5) ** (1 / nq)), 240), 5)
        return [base] * (nq - 1) + [3 * base // 2]
    each = list(points) if isinstance(points, Sequence | np.ndarray) and not isinstance(points, str) else [points] * nq
    whole = all(isinstance(n, int | np.integer) and not isinstance(n, bool) for n in each)
    counts = [int(n) for n in each] if whole else []
    if len(counts) != nq or min(counts) < 2:
        raise ArmDesignError("points", f"{points} is not allowed", f"give one number ≥ 2, or {nq} (one per joint)")
    if math.prod(counts) > 5_000_000:
        raise ArmDesignError("points", f"{math.prod(counts):,} poses are too many", "give at most 5 million in all")
    return counts


def _on_pitch_limits(machine: Machine, payload: Payload, axes: tuple[Array, ...]) -> Array:
    """Poses on a load case's pitch limits: each joint that tips its link in turn solved for all values of the others.

    So the corners, where a pitch limit meets the ends of all other joints, are among them.
    """
    found = [np.empty((0, len(axes)))]
    for joint in tipping_joints(machine, payload):
        free = [axis if j != joint else axis[[len(axis) // 2]] for j, axis in enumerate(axes)]
        others = np.stack(np.meshgrid(*free, indexing="ij"), axis=-1).reshape(-1, len(axes))
        for limit in payload.pitch or ():
            q = onto_pitch_limit(machine, payload, others, joint, limit)
            found.append(q[(q[:, joint] >= axes[joint][0]) & (q[:, joint] <= axes[joint][-1])])
    return np.concatenate(found)


def tipping_joints(machine: Machine, payload: Payload) -> list[int]:
    """Revolute joints between the root and a load case's link, root first."""
    chain = machine.arm.chain(payload.link) if payload.link else ()
    return [j for j in chain if machine.arm.joints[j].revolute]


def onto_pitch_limit(machine: Machine, payload: Payload, q: Array, joint: int, limit: float) -> Array:
    """The poses with ``joint`` turned until the link's pitch is ``limit`` [rad] (Newton); those that can be."""
    assert payload.link is not None
    q = q.copy()
    step = np.zeros(q.shape[1])
    step[joint] = 0.1
    for _ in range(8):
        pitch = machine.arm.pitch(machine.arm.kinematics(q), payload.link)
        slope = _wrapped(machine.arm.pitch(machine.arm.kinematics(q + step), payload.link) - pitch) / 0.1
        error = _wrapped(limit - pitch)
        q[:, joint] += error / np.where(np.abs(slope) > 0.1, slope, np.inf)
    return q[np.abs(error) < 1e-10]


def _wrapped(angle: Array) -> Array:
    return np.asarray(np.arctan2(np.sin(angle), np.cos(angle)))
