"""Poses spread over the joint box, its faces and edges, and over pitch limits of load cases.

The lowest frequency that brings the tool to a place is often at the end of a joint range or on a
pitch limit, sometimes at several at once; a grid alone meets few such poses.

A load case with a pitch range exists only while its link's pitch lies in the range; its limits cut
the joint box along surfaces.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from itertools import product

import numpy as np

from armdesign.arrays import Array, Flags, chunks, mesh
from armdesign.machine.load_case import LoadCase
from armdesign.machine.machine import Machine
from armdesign.mechanism.joint_ranges import over

SMALLEST_SLOPE = 0.1  # of the pitch by the joint, below which the joint cannot set it
ON_EDGE = 1000  # most poses on an edge of the joint box


def tipping_joints(machine: Machine, payload: LoadCase) -> list[int]:
    """Revolute joints that tip the link of a load case with pitch limits, root first."""
    chain = machine.arm.chain(payload.link) if payload.link and payload.limits else ()
    joints, slewing = machine.arm.joints, machine.arm.slewing
    return [j for j in chain if j < len(joints) and joints[j].revolute and j not in slewing]


def turned_onto_pitch_limits(
    machine: Machine, payload: LoadCase, q: Array, joint: int, ranges: Array
) -> Array:
    """Poses (n, nq) with ``joint`` turned onto each pitch limit, the other joints as they are.

    Poses that would need the joint beyond its range (nq, 2) are left out. The corners, where a
    pitch limit meets the ends of all other joints, are among them if q has these ends.
    """
    turned = [np.empty((0, len(ranges)))]
    for limit in payload.limits:
        for rows in chunks(len(q)):
            _, on_limit = onto_pitch_limit(machine, payload, q[rows], joint, limit)
            turned.append(on_limit[_within(on_limit[:, joint], ranges[joint])])
    return np.concatenate(turned)


def _within(values: Array, ends: Array) -> Flags:
    return np.asarray((values >= ends[0]) & (values <= ends[1]))


def onto_pitch_limit(
    machine: Machine, payload: LoadCase, q: Array, joint: int, limit: float
) -> tuple[Array, Array]:
    """Poses with ``joint`` turned until the link's pitch is ``limit`` [rad] (Newton).

    Which of the poses (n, nq) can be turned so (m,), and these poses (m, nq).
    """
    own, step = np.eye(q.shape[1])[joint], 0.1
    turns = np.ones(len(q), dtype=bool)
    for _ in range(8):
        pitch = payload.limited_angle(machine.heading, machine.arm.kinematics(q))
        error = wrapped(limit - pitch)
        if np.abs(error[turns]).max(initial=0.0) < 1e-13:
            break
        ahead = payload.limited_angle(machine.heading, machine.arm.kinematics(q + step * own))
        slope = wrapped(ahead - pitch) / step
        turns = np.abs(slope) > SMALLEST_SLOPE
        q = q + (error / np.where(turns, slope, np.inf))[:, None] * own
    turned = np.flatnonzero(np.abs(error) < 1e-10)
    return turned, q[turned]


def wrapped(angle: Array) -> Array:
    """Angles brought into (−π, π]."""
    return np.asarray(np.arctan2(np.sin(angle), np.cos(angle)))


def edge_poses(
    machine: Machine, ranges: Array, count: int
) -> Iterator[tuple[Array, LoadCase | None]]:
    """Poses on the faces of the joint box, then poses on pitch limits with their load case.

    ``count`` for each combination of joint ends; none where two joints or fewer move the tool.
    """
    fixed = joints_that_change_nothing(machine)
    moving = len(ranges) - len(fixed)
    if moving < 3:
        return
    most_alike = max(_faces_alike(moving, inner) for inner in range(2, moving))
    yield box_poses(ranges, fixed, 0, count * most_alike), None
    for payload in machine.payloads:
        joints = tipping_joints(machine, payload)
        for joint in joints if moving > 3 else joints[-1:]:
            inside = count if joint == joints[-1] else 0
            others = box_poses(ranges, fixed | {joint}, inside, count * (moving > 3))
            yield turned_onto_pitch_limits(machine, payload, others, joint, ranges), payload


def box_poses(ranges: Array, fixed: Collection[int], inside: int, faces: int) -> Array:
    """Even poses: ``inside`` in the joint box, ``faces`` on its faces, as many on its edges.

    ``fixed`` joints stand at their lower end. An edge has up to ``ON_EDGE`` poses, a face up to
    that number squared.
    """
    parts, moving = [np.empty((0, len(ranges)))], len(ranges) - len(fixed)
    for ends in product(*((0,) if j in fixed else (0, 1, None) for j in range(len(ranges)))):
        inner = ends.count(None)
        alike = _faces_alike(moving, inner)
        poses = inside if inner == moving else min(faces / alike, ON_EDGE**inner)
        if poses > 0:
            values = max(int(poses ** (1 / max(inner, 1))), 2)
            parts.append(mesh(_values(r, e, values) for r, e in zip(ranges, ends, strict=True)))
    return np.concatenate(parts)


def surfaces(case: Machine, ranges: Array, values: int) -> Iterator[Array]:
    """Poses (values, values, nq) on the surfaces at which all joints but two are held by a limit.

    The limits are the ends of joint ranges and the pitch limits of the load case at work; NaN
    where a pitch limit would need a joint beyond its range. A linear function of the poses that
    bring the tool to a cell is least on these surfaces.
    """
    fixed = joints_that_change_nothing(case)
    yield from _faces(ranges, fixed, values)
    for joint in tipping_joints(case, case.payload):
        for q in _faces(ranges, fixed | {joint}, values):
            for limit in case.payload.limits:
                flat, turned = q.reshape(-1, len(ranges)), np.full_like(q, np.nan)
                known, on_limit = onto_pitch_limit(case, case.payload, flat, joint, limit)
                inside = _within(on_limit[:, joint], ranges[joint])
                turned.reshape(flat.shape)[known[inside]] = on_limit[inside]
                yield turned


def _faces(ranges: Array, fixed: Collection[int], values: int) -> Iterator[Array]:
    """Even poses (values, values, nq) on each face of the joint box on which two joints move."""
    for ends in product(*((0,) if j in fixed else (0, 1, None) for j in range(len(ranges)))):
        if ends.count(None) == 2:
            axes = (_values(r, e, values) for r, e in zip(ranges, ends, strict=True))
            yield mesh(axes).reshape(values, values, -1)


def joints_that_change_nothing(machine: Machine) -> set[int]:
    """Joints that change neither frequency nor reach: those without effect about the root's z."""
    feet = machine.arm.zero.translation[0, :, :2]
    return {j for j in machine.joints_without_effect if np.hypot(*feet[j]) < 1e-9}


def _faces_alike(joints: int, inner: int) -> int:
    """Number of faces of ``inner`` dimensions that a box of ``joints`` dimensions has."""
    return math.comb(joints, inner) * 2 ** (joints - inner)


def _values(ends: Array, end: int | None, count: int) -> Array:
    return over(ends, count) if end is None else ends[[end]]
