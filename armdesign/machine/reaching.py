"""Poses that bring a point of a link exactly to given places of the reach/height plane.

Newton's method on two joints, or on one where heights alone are given, from the middles of a
lattice's cells near whose image a place lies.
"""

from __future__ import annotations

import itertools

import numpy as np

from armdesign.arrays import Array, Flags, chunks, mesh
from armdesign.machine.machine import Machine
from armdesign.mechanism.joint_ranges import over
from armdesign.mechanism.linkage.base import Pin

LATTICE = 41  # values of each joint
NEAR = 0.75  # of the size of a cell's image, how far from it a place may lie
ITERATIONS, LARGEST_STEP = 30, 0.2  # of Newton's method, in shares of the joint ranges
TOLERANCE = 1e-9  # [m] by which the place may be missed, [rad, m] by which a range may be left


def poses_reaching(
    machine: Machine, point: Pin, joints: tuple[int, ...], q: Array, places: Array
) -> tuple[Array, Array]:
    """Every pose that brings a point to a place: q (m, nq), and the index of its place (m,).

    Poses are within joint ranges and strokes, and in the order of their places.

    Args:
        machine: joint ranges, strokes.
        point: of a link.
        joints: the one or two that bring it there.
        q: where the other joints stand (nq,) [rad, m].
        places: reach and height (n, 2) [m]; with one joint heights alone (n, 1).
    """
    starts, which = _starts(machine, point, joints, q, places)
    parts = [
        _newton(machine, point, joints, starts[rows], places[which[rows]])
        for rows in chunks(len(starts))
    ]
    poses, missed = (np.concatenate(part) for part in zip(*parts, strict=True))
    met = np.flatnonzero(missed < TOLERANCE)
    met = met[within_reach(machine, poses[met])]
    rounded = np.column_stack([which[met], np.rint(poses[met] * 1e6)])
    _, first = np.unique(rounded, axis=0, return_index=True)
    return poses[met[first]], which[met[first]]


def within_reach(machine: Machine, q: Array) -> Flags:
    """Whether poses (n, nq) are within joint ranges and strokes (n,)."""
    low, high = machine.ranges.T
    inside = np.all((q >= low - TOLERANCE) & (q <= high + TOLERANCE), axis=1)
    return np.asarray(inside & (machine.margins(q).min(axis=1, initial=np.inf) >= -TOLERANCE))


def lattice(
    machine: Machine, joints: tuple[int, ...], q: Array, spans: Array | None = None
) -> Array:
    """Poses (LATTICE ** k, nq) with k joints at even values of their ranges, others as in q.

    ``spans`` (k, 2) [rad, m] instead of the ranges.
    """
    ends = machine.ranges[list(joints)] if spans is None else spans
    nodes = np.tile(q, (LATTICE ** len(joints), 1))
    nodes[:, joints] = mesh(over(span, LATTICE) for span in ends)
    return nodes


def place_and_slopes(
    machine: Machine, point: Pin, joints: tuple[int, ...], q: Array
) -> tuple[Array, Array]:
    """Reach and height of a point (n, 2) [m] and their slopes by k joints (n, 2, k)."""
    arm, at, parts = machine.arm, np.array(point.at), []
    for rows in chunks(len(q)):
        motion = arm.motion(arm.kinematics(q[rows]), point.link, at, arm.root, joints)
        parts.append(machine.heading.reach_and_height(q[rows], motion))
    places, slopes = zip(*parts, strict=True)
    return np.concatenate(places), np.concatenate(slopes)


def _starts(
    machine: Machine, point: Pin, joints: tuple[int, ...], q: Array, places: Array
) -> tuple[Array, Array]:
    """Middles of the cells (m, nq) near whose image a place lies, and its index (m,)."""
    nodes, shape, wanted = lattice(machine, joints, q), [LATTICE] * len(joints), places.shape[1]
    image = place_and_slopes(machine, point, joints, nodes)[0][:, -wanted:].reshape(*shape, -1)
    numbers = np.arange(len(nodes)).reshape(shape)
    ends = [
        numbers[tuple(slice(k, LATTICE - 1 + k) for k in corner)].ravel()
        for corner in itertools.product((0, 1), repeat=len(joints))
    ]
    corners = np.stack([image.reshape(-1, wanted)[end] for end in ends])
    low, high = corners.min(axis=0), corners.max(axis=0)
    room = NEAR * (high - low).max(axis=1, keepdims=True)
    inside = (places[:, None] >= low - room) & (places[:, None] <= high + room)
    which, cell = np.nonzero(inside.all(axis=2))
    return (nodes[ends[0][cell]] + nodes[ends[-1][cell]]) / 2, which


def _newton(
    machine: Machine, point: Pin, joints: tuple[int, ...], q: Array, places: Array
) -> tuple[Array, Array]:
    """Poses moved towards their places, and by how much they miss them (m,) [m]."""
    q, span, wanted = q.copy(), np.ptp(machine.ranges[list(joints)], axis=1), places.shape[1]
    missed = np.full(len(q), np.inf)
    left = np.arange(len(q))
    for _ in range(ITERATIONS):
        place, slope = place_and_slopes(machine, point, joints, q[left])
        error = place[:, -wanted:] - places[left]
        missed[left] = np.abs(error).max(axis=1)
        onward = missed[left] > TOLERANCE / 1000
        left, error, slope = left[onward], error[onward], slope[onward, -wanted:]
        if len(left) == 0:
            break
        step = (np.linalg.pinv(slope * span, rcond=1e-6) @ error[..., None])[..., 0]
        q[np.ix_(left, np.array(joints))] -= span * np.clip(step, -LARGEST_STEP, LARGEST_STEP)
    return q, missed
