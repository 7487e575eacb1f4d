"""Joint grids: even values of every joint, all combinations of them, and places between them.

An axis holds the even values of one joint [rad, m], from one end of its range to the other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from armdesign.arrays import Array, mesh
from armdesign.errors import ArmDesignError
from armdesign.machine.machine import Machine
from armdesign.mechanism.joint_ranges import over

POSES = 20_000  # of the default grid
MOST = 5_000_000  # poses of a workspace
Axes = tuple[Array, ...]


def joint_axes(machine: Machine, points: int | Sequence[int] | None, end_margin: float) -> Axes:
    """Axes over the joint ranges in which every cylinder keeps ``end_margin``.

    Args:
        machine: today's machine.
        points: number of values per joint, one for all or one each (≥ 2); None: about ``POSES``
            poses, the last joint finest, of one without effect middle and end.
        end_margin: share of the stroke.

    Raises:
        ArmDesignError: counts that cannot be.
    """
    ranges = machine.range_within(end_margin).copy()
    if points is None:
        for j in machine.joints_without_effect:
            ranges[j, 0] = ranges[j].mean()
    counts = default_counts(machine) if points is None else _checked_counts(machine, points)
    return tuple(over(ends, count) for ends, count in zip(ranges, counts, strict=True))


def box_shares(axes: Axes) -> Array:
    """Share of joint space that each pose of the mesh stands for (n,), in boxes of the grid.

    A value stands for one step of its axis, for half a step at the ends.
    """
    ends = (np.arange(len(axis)) % (len(axis) - 1) == 0 for axis in axes)
    return np.prod(mesh(np.where(at_end, 0.5, 1.0) for at_end in ends), axis=1)


def steps_along(axes: Axes, q: Array) -> Array:
    """Places of poses (n, nq) on the axes, in steps from their first values (nq, n)."""
    return np.stack([(q[:, j] - axis[0]) / _step(axis) for j, axis in enumerate(axes)])


def nearest(axis: Array, values: Array) -> Array:
    """Index of the axis value next to each of the values."""
    return np.clip(np.rint((values - axis[0]) / _step(axis)).astype(int), 0, len(axis) - 1)


def cell_edges(axis: Array) -> Array:
    """Edges of the cells about n values of an axis (n + 1,): halfway, and where the axis ends.

    The cell of a value alone is one unit wide.
    """
    ends = (axis[0], axis[-1]) if len(axis) > 1 else (axis[0] - 0.5, axis[0] + 0.5)
    return np.concatenate([ends[:1], (axis[1:] + axis[:-1]) / 2, ends[1:]])


def _step(axis: Array) -> float:
    return float((axis[-1] - axis[0]) / max(len(axis) - 1, 1) or 1.0)


def default_counts(machine: Machine) -> list[int]:
    """Number of values per joint of the default grid."""
    nq, without = len(machine.joints), machine.joints_without_effect
    base = max(min(int((POSES / 1.5) ** (1 / max(nq - len(without), 1))), 240), 5)
    return [2 if j in without else base for j in range(nq - 1)] + [3 * base // 2]


def _checked_counts(machine: Machine, points: int | Sequence[int]) -> list[int]:
    nq = len(machine.joints)
    each: list[Any] = (
        list(points)
        if isinstance(points, Sequence | np.ndarray) and not isinstance(points, str)
        else [points] * nq
    )
    whole = all(isinstance(n, int | np.integer) and not isinstance(n, bool) for n in each)
    counts = [int(n) for n in each] if whole else []
    if len(counts) != nq or min(counts) < 2:
        remedy = "give one number ≥ 2" + (f", or {nq} numbers, one per joint" if nq > 1 else "")
        raise ArmDesignError("points", f"{points} is not allowed", remedy)
    if math.prod(counts) > MOST:
        remedy = f"give at most {MOST // 10**6} million in all"
        raise ArmDesignError("points", f"{math.prod(counts):,} poses are too many", remedy)
    return counts
