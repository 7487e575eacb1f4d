"""Poses that bring the tool into cells of which the reach covers but a corner.

The rim of what a tool reaches cuts slivers off square cells that poses spread over joint space
miss. From the nearest places that are known the tool is led towards each cell beside them, joints
within their ranges and the load case's link within its pitch range: damped Gauss–Newton steps, in
which joints that lean against an end stay there.
"""

from __future__ import annotations

import numpy as np

from armdesign.arrays import Array
from armdesign.frequency.joint_grid import nearest
from armdesign.frequency.reach_plane import place_and_pitch, place_and_slopes
from armdesign.machine.machine import Machine

STARTS = 12  # known places from which the tool is led into a cell
STEPS = 40  # at most
STALLED = 0.99  # of what was missed a step before, at which it is given up
ROUNDS = 4  # of a step, after which what leans against an end, or would leave a cell, is known
WITHIN = 1e-4  # of a cell, how far from its border the tool is to be
DAMPING = 1e-3  # of a cell, motion that a joint's whole range must make at least


def poses_over_rim(
    machine: Machine, ranges: Array, q: Array, place: Array, cells: tuple[Array, Array]
) -> Array:
    """Poses (n, nq) with the tool in, or near, cells beside those that hold a known place.

    Args:
        machine: with the load case at work.
        ranges: of the joints (nq, 2) [rad, m].
        q: known poses (m, nq).
        place: reach and height of their tools (m, 2) [m].
        cells: middles of the cells, along reach and along height [m].
    """
    from scipy.spatial import cKDTree

    middles = _beside(place, cells)
    if len(middles) == 0:
        return q[:0]
    tree = cKDTree(place, balanced_tree=False, compact_nodes=False)  # few questions are asked
    _, near = tree.query(middles, k=min(STARTS, len(q)))
    near = near.reshape(len(middles), -1)
    goals = np.repeat(middles, near.shape[1], axis=0)
    return led_into_cells(machine, ranges, q[near.ravel()], goals, cells)


def _beside(place: Array, cells: tuple[Array, Array]) -> Array:
    """Middles (m, 2) of the cells that hold no place (n, 2), but one of whose neighbours does."""
    from scipy.ndimage import binary_dilation

    holds = np.zeros([len(axis) for axis in cells], dtype=bool)
    holds[nearest(cells[0], place[:, 0]), nearest(cells[1], place[:, 1])] = True
    beside = np.nonzero(binary_dilation(holds, np.ones((3, 3))) & ~holds)
    return np.stack([axis[i] for axis, i in zip(cells, beside, strict=True)], axis=1)


def led_into_cells(
    machine: Machine, ranges: Array, starts: Array, middles: Array, cells: tuple[Array, Array]
) -> Array:
    """Poses (n, nq) with the tool in, or near, the cells about middles (n, 2), from starts."""
    (low, high), size = ranges.T, max(float(axis[1] - axis[0]) for axis in cells if len(axis) > 1)
    half = (0.5 - WITHIN) * size
    q, left, before = starts.copy(), np.arange(len(starts)), np.full(len(starts), np.inf)
    for _ in range(STEPS):
        place, slope, beyond = _place_and_tip(machine, q[left], size)
        least = np.column_stack([middles[left] - half - place, np.full(len(left), -np.inf)])
        most = np.column_stack([middles[left] + half - place, -beyond])
        missed = np.linalg.norm(np.clip(0, least, most), axis=1)
        nearer = (missed > 0) & (missed < STALLED * before[left])
        before[left] = missed
        left = left[nearer]
        if len(left) == 0:
            break
        slopes = slope[nearer] * (high - low)
        way = _step(slopes, least[nearer], most[nearer], q[left], ranges, size)
        q[left] = np.clip(q[left] + way, low, high)
    return q


def _step(slopes: Array, least: Array, most: Array, q: Array, ranges: Array, size: float) -> Array:
    """Motion (n, nq) by which places and pitch change by between least and most, if they can.

    What lies between already is free to move as far: along a rim the tool comes nearer to a cell
    only by going aside. Joints that lean against an end stay there.

    Args:
        slopes: of places and pitch by shares of the joint ranges (n, 3, nq).
        least: changes (n, 3).
        most: changes (n, 3).
        q: from where (n, nq).
        ranges: of the joints (nq, 2).
        size: of a cell.
    """
    low, high = ranges.T
    free, way = np.ones(q.shape, dtype=bool), np.zeros_like(q)
    change = np.zeros_like(least)
    bound = np.zeros(change.shape, dtype=bool)
    for _ in range(ROUNDS):
        ends = np.clip(change, least, most)
        bound |= ends != change
        change = np.where(bound, ends, change)
        part = slopes * free[:, None] * bound[..., None]
        way = least_motion(part, change[..., None], (DAMPING * size) ** 2)[..., 0]
        change = np.where(bound, change, (slopes @ way[..., None])[..., 0])
        free &= ~((q <= low) & (way < 0)) & ~((q >= high) & (way > 0))
    return np.asarray(way * (high - low))


def least_motion(slopes: Array, changes: Array, damping: Array | float) -> Array:
    """Smallest motions (n, nq, m) by which all changes (n, k, m) of what has slopes (n, k, nq).

    Damped least squares: where nothing can move, no motion. The ``damping`` (n,) is that of
    squared slopes.
    """
    square = slopes @ slopes.swapaxes(1, 2)
    square += np.reshape(damping, (-1, 1, 1)) * np.eye(square.shape[1])
    return np.asarray(slopes.swapaxes(1, 2) @ np.linalg.solve(square, changes))


def _place_and_tip(machine: Machine, q: Array, size: float) -> tuple[Array, Array, Array]:
    """Places (n, 2), slopes (n, 3, nq), and the angle that a load case's link is tipped too far.

    An angle (n,) of one radian counts as a cell's size, in which places are measured. Within the
    pitch range it is negative and has no slopes.
    """
    payload = machine.payload
    if not payload.limits:
        place, slope = place_and_slopes(machine, q)
        return place, np.pad(slope, ((0, 0), (0, 1), (0, 0))), np.full(len(q), -np.inf)
    value, slope = place_and_pitch(machine, q, payload)
    beyond, side = payload.excess(value[:, 2]), np.sign(payload.offset(value[:, 2]))
    slope[:, 2] *= size * np.where(beyond > 0, side, 0.0)[:, None]
    return value[:, :2], slope, size * beyond
