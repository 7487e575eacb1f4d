"""Poses spread over the joint box and over pitch limits, denser on faces, edges and corners.

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
from armdesign.frequency.pitch_limits import tipping_joints, turned_onto_pitch_limits
from armdesign.machine.load_case import LoadCase
from armdesign.machine.machine import Machine
from armdesign.mechanism.joint_ranges import over

ON_EDGE = (
    4000  # poses that `spread` takes on an edge of the joint box, and on its cuts with limits
)
Ends = tuple[int | None, ...]  # of each joint 0 (lower end), 1 (upper end) or None (in between)


def spread(case: Machine, ranges: Array, count: int) -> Array:
    """Poses (n, nq) over the joint box and over the pitch limits of the load case at work.

    ``count`` of them are inside the box. Joints without effect stand at one value.
    """
    fixed = joints_without_effect(case)
    parts = [box_poses(ranges, fixed, count, count * 3 // 4, ON_EDGE)]
    joints = tipping_joints(case, case.payload)
    for joint in joints:
        inside = count // 10 if joint == joints[-1] else 0
        others = box_poses(ranges, fixed | {joint}, inside, count // 6, ON_EDGE)
        parts.append(turned_onto_pitch_limits(case, case.payload, others, joint, ranges))
    return np.concatenate(parts)


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


def joints_without_effect(machine: Machine) -> set[int]:
    """Joints that change neither frequency nor reach: idle ones about the root's z axis."""
    feet = machine.arm.kinematics(np.zeros((1, len(machine.joints)))).translation[0, :, :2]
    return {j for j in machine.idle_joints if np.hypot(*feet[j]) < 1e-9}


def _faces_alike(joints: int, inner: int) -> int:
    """Number of faces of ``inner`` dimensions that a box of ``joints`` dimensions has."""
    return math.comb(joints, inner) * 2 ** (joints - inner)


def _values(ends: Array, end: int | None, count: int) -> Array:
    return over(ends, count) if end is None else ends[[end]]
