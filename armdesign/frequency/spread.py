"""Poses spread over the joint box, its faces and edges, and over pitch limits.

The lowest frequency that brings the tool to a place is often at the end of a joint range or on a
pitch limit, sometimes at several at once; a grid alone meets few such poses.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from itertools import product

import numpy as np

from armdesign.arrays import Array
from armdesign.frequency.joint_grid import mesh
from armdesign.frequency.pitch_limits import (
    onto_pitch_limit,
    tipping_joints,
    turned_onto_pitch_limits,
)
from armdesign.machine.load_case import LoadCase
from armdesign.machine.machine import Machine
from armdesign.mechanism.joint_ranges import over


def edge_poses(
    machine: Machine, ranges: Array, count: int
) -> Iterator[tuple[Array, LoadCase | None]]:
    """Poses on the faces of the joint box, then poses on pitch limits with their load case.

    ``count`` for each combination of joint ends; none where two joints or fewer move the tool.
    """
    fixed = joints_without_effect(machine)
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


def box_poses(
    ranges: Array, fixed: Collection[int], inside: int, faces: int, on_edge: int = 1000
) -> Array:
    """Even poses: ``inside`` in the joint box, ``faces`` on its faces, as many on its edges.

    ``fixed`` joints stand at their lower end. An edge has up to ``on_edge`` poses, a face up to
    that number squared.
    """
    parts, moving = [np.empty((0, len(ranges)))], len(ranges) - len(fixed)
    for ends in product(*((0,) if j in fixed else (0, 1, None) for j in range(len(ranges)))):
        inner = ends.count(None)
        alike = _faces_alike(moving, inner)
        poses = inside if inner == moving else min(faces / alike, on_edge**inner)
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
    fixed = joints_without_effect(case)
    yield from _faces(ranges, fixed, values)
    for joint in tipping_joints(case, case.payload):
        for q in _faces(ranges, fixed | {joint}, values):
            for limit in case.payload.pitch or ():
                flat, turned = q.reshape(-1, len(ranges)), np.full_like(q, np.nan)
                known, on_limit = onto_pitch_limit(case, case.payload, flat, joint, limit)
                low, high = ranges[joint]
                inside = (on_limit[:, joint] >= low) & (on_limit[:, joint] <= high)
                turned.reshape(flat.shape)[known[inside]] = on_limit[inside]
                yield turned


def _faces(ranges: Array, fixed: Collection[int], values: int) -> Iterator[Array]:
    """Even poses (values, values, nq) on each face of the joint box on which two joints move."""
    for ends in product(*((0,) if j in fixed else (0, 1, None) for j in range(len(ranges)))):
        if ends.count(None) == 2:
            axes = (_values(r, e, values) for r, e in zip(ranges, ends, strict=True))
            yield mesh(axes).reshape(values, values, -1)


def joints_without_effect(machine: Machine) -> set[int]:
    """Joints that change neither frequency nor reach: idle ones about the root's z axis."""
    feet = machine.arm.kinematics(np.zeros((1, len(machine.joints)))).translation[0, :, :2]
    return {j for j in machine.idle_joints if np.hypot(*feet[j]) < 1e-9}


def _faces_alike(joints: int, inner: int) -> int:
    """Number of faces of ``inner`` dimensions that a box of ``joints`` dimensions has."""
    return math.comb(joints, inner) * 2 ** (joints - inner)


def _values(ends: Array, end: int | None, count: int) -> Array:
    return over(ends, count) if end is None else ends[[end]]
