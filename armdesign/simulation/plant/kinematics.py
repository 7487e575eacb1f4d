"""Kinematics, compiled: motion of points of the links, lengths and moment arms of cylinders.

The same geometry as ``linkage``, of one pose at a time and without what a simulation does not
need. All is seen from the world. A joint j moves a point P on a link behind it by ∂P/∂q_j = a_j ×
(P − o_j), its axis if it slides. With joint speeds q̇ and no joint acceleration, P has the Coriolis
and centrifugal acceleration Σ_j q̇_j ω_j × (∂P/∂q_j q̇_j + 2 Σ_k ∂P/∂q_k q̇_k), k the joints
between j and P. A moment arm is r_j = d · (∂E/∂q_j − ∂B/∂q_j) with the cylinder's direction d, B
its base pin and E its rod end: what moves both alike does not count.

The plane of a four-bar has the coordinates right and up. From pivot to lug (a, c), e = a² + c²,
the knee is at x (a, c) + y (−c, a),  x = ½ + (rocker² − coupler²)/2e,  y = ± √(rocker²/e − x²).
"""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

import numpy as np

from armdesign.arrays import Array
from armdesign.hydraulics.actuator import Cylinder
from armdesign.machine.machine import Machine
from armdesign.mechanism.arm import Arm
from armdesign.mechanism.linkage.base import Pin
from armdesign.mechanism.urdf import Joint, turning
from armdesign.simulation.plant.compiled import Record, Records, new_records, within
from armdesign.simulation.plant.vectors import ZERO, Vector, cross, dot, plus, scaled, turned

JOINT = np.dtype(  # its frame in its parent's, turned by constant + sin q sine + cos q cosine
    [
        ("next", "i8"),  # the joint to place in this turn, so that each comes after its parent
        ("parent", "i8"),  # −1: the world
        ("revolute", "?"),
        *((name, "f8", (3, 3)) for name in ("constant", "sine", "cosine")),
        *((name, "f8", 3) for name in ("translation", "slide", "axis")),
    ],
    align=True,
)
PIN = np.dtype([("frame", "i8"), ("at", "f8", 3)], align=True)  # of a joint; −1: the world
DRIVE = np.dtype(  # of a cylinder its pins and bars, of a motor the joint that it turns
    [
        ("joint", "i8"),  # −1: a cylinder
        ("knee", "?"),  # whether the rod end is one, where rocker and coupler meet
        *((name, PIN) for name in ("base_pin", "far_pin", "pivot_pin")),  # far: rod end or lug
        *((name, "f8", 3) for name in ("right", "up")),
        *((name, "f8") for name in ("rocker", "coupler", "side", "closed_length")),
        *((name, "f8") for name in ("barrel_mass", "rod_mass", "rocker_mass", "coupler_mass")),
        ("weighs", "?"),  # whether one of these is not zero
    ],
    align=True,
)
Moving: TypeAlias = tuple[Vector, Vector, Vector]  # a vector, its first and second derivative

BASE, END, FAR, PIVOT, RIGHT, UP = range(6)  # points of a drive; END: rod end or knee
BARREL, ROD = 6, 7  # inner ends
POINTS = 8


class Frames(NamedTuple):
    """Joint frames in the world: rotations (nq, 3, 3), origins (nq, 3) and axes (nq, 3)."""

    rotation: Array
    origin: Array
    axis: Array


class PinMotion(NamedTuple):
    """Motion of the points of a drive."""

    slope: Array  # by each joint (POINTS, nq, 3)
    coriolis: Array  # Coriolis and centrifugal accelerations (POINTS, 3)
    arm: Array  # moment arms (nq,)


def new_frames(nq: int) -> Frames:
    """Frames to be written."""
    return Frames(np.empty((nq, 3, 3)), np.empty((nq, 3)), np.empty((nq, 3)))


def new_pin_motion(nq: int) -> PinMotion:
    """Motion of a drive's points, to be written."""
    return PinMotion(np.empty((POINTS, nq, 3)), np.empty((POINTS, 3)), np.empty(nq))


# ---------------------------------------------------------------------------------------- machines


def joints_of(arm: Arm) -> Records:
    """Joints, springs last, as records ``JOINT``."""
    records = new_records(len(arm.coordinates), JOINT)
    for row, joint, following in zip(records, arm.coordinates, arm.outwards, strict=True):
        row["next"], row["parent"], row["revolute"] = following, joint.parent, joint.revolute
        row["translation"], row["axis"] = joint.translation, joint.axis
        row["constant"], row["sine"], row["cosine"] = _turn(joint)
        row["slide"] = 0.0 if joint.revolute else joint.rotation @ joint.axis
    return records


def _turn(joint: Joint) -> tuple[Array, Array, Array]:
    """Rotation about a joint's axis by q as constant, sine and cosine parts, by Rodrigues.

    With the cross-product matrix K of the axis it is I + K² + sin q K − cos q K².
    """
    if not joint.revolute:
        return joint.rotation, np.zeros((3, 3)), np.zeros((3, 3))
    before, sine, square = turning(joint.axis, joint.rotation).reshape(3, 3, 3)
    return before + square, sine, -square


def drives_of(machine: Machine) -> Records:
    """Cylinders, and motors after them, (nc,) as records ``DRIVE``."""
    records = new_records(len(machine.actuators), DRIVE)
    for row, actuator, drive in zip(records, machine.actuators, machine.drives, strict=True):
        fields = drive.record()
        row["joint"], row["knee"] = -1, "pivot" in fields
        for field, value in fields.items():
            if isinstance(value, Pin):
                row[f"{field}_pin"] = _pin(machine.arm, value)
            else:
                row[field] = value
        if isinstance(actuator, Cylinder):
            row["closed_length"] = actuator.closed_length
            row["weighs"] = bool(actuator.moving_masses)
            for name, mass in actuator.moving_masses.items():
                row[f"{name}_mass"] = mass
    return records


def _pin(arm: Arm, pin: Pin) -> tuple[int, tuple[float, ...]]:
    body = arm.links[pin.link]
    return body.joint, tuple(body.translation + body.rotation @ np.array(pin.at))


# ------------------------------------------------------------------------------------------ motion


@within
def place_joints(joints: Records, q: Array, frames: Frames) -> None:
    """Write the joint frames in the world at q (nq,)."""
    rotation, origin, axis = frames
    for k in range(len(joints)):
        j = joints[k].next
        joint = joints[j]
        sine, cosine, parent = math.sin(q[j]), math.cos(q[j]), joint.parent
        for row in range(3):
            origin[j, row] = joint.translation[row] + q[j] * joint.slide[row]
            for column in range(3):
                rotation[j, row, column] = (
                    joint.constant[row, column]
                    + sine * joint.sine[row, column]
                    + cosine * joint.cosine[row, column]
                )
        if parent >= 0:
            before = rotation[parent]
            write(
                origin,
                j,
                plus(turned(before, vector_of(origin, j)), vector_of(origin, parent), 1.0),
            )
            for column in range(3):
                x, y, z = turned(
                    before,
                    (rotation[j, 0, column], rotation[j, 1, column], rotation[j, 2, column]),
                )
                rotation[j, 0, column], rotation[j, 1, column], rotation[j, 2, column] = x, y, z
        write(axis, j, turned(rotation[j], (joint.axis[0], joint.axis[1], joint.axis[2])))


@within
def vector_of(rows: Array, index: int) -> Vector:
    """A row of (n, 3)."""
    return (rows[index, 0], rows[index, 1], rows[index, 2])


@within
def write(rows: Array, index: int, vector: Vector) -> None:
    """Make a vector a row of (n, 3)."""
    rows[index, 0], rows[index, 1], rows[index, 2] = vector


@within
def _position(pin: Record, frames: Frames) -> Vector:
    """A pin in the world."""
    at = (pin.at[0], pin.at[1], pin.at[2])
    if pin.frame < 0:
        return at
    return plus(vector_of(frames.origin, pin.frame), turned(frames.rotation[pin.frame], at), 1.0)


@within
def direction(frame: int, along: Array, frames: Frames) -> Vector:
    """A direction of a joint's frame in the world."""
    given = (along[0], along[1], along[2])
    return given if frame < 0 else turned(frames.rotation[frame], given)


@within
def moved(
    joints: Records,
    frames: Frames,
    speed: Array,
    frame: int,
    vector: Vector,
    bound: bool,
    slope: Array,
) -> Moving:
    """A point on a joint's frame, or a direction if not ``bound``, with rate and acceleration.

    The acceleration is Coriolis and centrifugal alone. Slopes by the joints (nq, 3) are written.
    From the frame down to the world: what is added up is the motion by the joints between.
    """
    slope[:] = 0.0
    rate, coriolis, j = ZERO, ZERO, frame
    while j >= 0:
        joint, turn = joints[j], vector_of(frames.axis, j)
        if joint.revolute:
            lever = plus(vector, vector_of(frames.origin, j), -1.0) if bound else vector
            own = cross(turn, lever)
        else:
            own = turn if bound else ZERO
        write(slope, j, own)
        own = scaled(own, speed[j])
        if joint.revolute:
            coriolis = plus(coriolis, cross(turn, plus(own, rate, 2.0)), speed[j])
        rate, j = plus(rate, own, 1.0), joint.parent
    return vector, rate, coriolis


@within
def _knee(drive: Record, a: Vector, c: Vector) -> tuple[Vector, Vector]:
    """Coordinates of the knee, right and up, from the lug's a and c, with two time derivatives."""
    e = a[0] * a[0] + c[0] * c[0]
    e1 = 2 * (a[0] * a[1] + c[0] * c[1])
    e2 = 2 * (a[1] * a[1] + a[0] * a[2] + c[1] * c[1] + c[0] * c[2])
    inverse = 1 / e
    i1, i2 = -e1 * inverse**2, (2 * e1 * e1 * inverse - e2) * inverse**2
    half, square = (drive.rocker**2 - drive.coupler**2) / 2, drive.rocker**2
    x, x1, x2 = 0.5 + half * inverse, half * i1, half * i2
    y = drive.side * math.sqrt(square * inverse - x * x)
    y1 = (square * i1 - 2 * x * x1) / (2 * y)
    y2 = (square * i2 - 2 * x1 * x1 - 2 * x * x2 - 2 * y1 * y1) / (2 * y)
    right = (
        x * a[0] - y * c[0],
        x1 * a[0] + x * a[1] - y1 * c[0] - y * c[1],
        x2 * a[0] + 2 * x1 * a[1] + x * a[2] - y2 * c[0] - 2 * y1 * c[1] - y * c[2],
    )
    up = (
        x * c[0] + y * a[0],
        x1 * c[0] + x * c[1] + y1 * a[0] + y * a[1],
        x2 * c[0] + 2 * x1 * c[1] + x * c[2] + y2 * a[0] + 2 * y1 * a[1] + y * a[2],
    )
    return right, up


@within
def _product(along: Moving, vector: Moving) -> Vector:
    """Scalar product of two vectors, with its first and second derivative."""
    return (
        dot(along[0], vector[0]),
        dot(along[1], vector[0]) + dot(along[0], vector[1]),
        dot(along[2], vector[0]) + 2 * dot(along[1], vector[1]) + dot(along[0], vector[2]),
    )


@within
def times(number: Vector, vector: Moving) -> Moving:
    """A number times a vector, each with its first and second derivative."""
    first = plus(scaled(vector[0], number[1]), vector[1], number[0])
    second = plus(
        plus(scaled(vector[0], number[2]), vector[1], 2 * number[1]), vector[2], number[0]
    )
    return scaled(vector[0], number[0]), first, second


@within
def _sum(one: Moving, other: Moving, factor: float) -> Moving:
    return (
        plus(one[0], other[0], factor),
        plus(one[1], other[1], factor),
        plus(one[2], other[2], factor),
    )


@within
def _folded(drive: Record, pivot: Moving, lug: Moving, right: Moving, up: Moving) -> Moving:
    """The knee of a four-bar from its pins and the directions of its plane."""
    vector = _sum(lug, pivot, -1.0)
    across, height = _knee(drive, _product(right, vector), _product(up, vector))
    return _sum(pivot, _sum(times(across, right), times(height, up), 1.0), 1.0)


@within
def place_drive(
    drive: Record, joints: Records, frames: Frames, speed: Array, pins: PinMotion
) -> tuple[float, Vector]:
    """Length of a cylinder and vector from base pin to rod end; its ``PinMotion`` is written."""
    slope, coriolis = pins.slope, pins.coriolis
    at, frame = _position(drive.base_pin, frames), drive.base_pin.frame
    base = moved(joints, frames, speed, frame, at, True, slope[BASE])
    at, frame = _position(drive.far_pin, frames), drive.far_pin.frame
    far = moved(joints, frames, speed, frame, at, True, slope[FAR])
    end = far
    if drive.knee:
        end = _place_knee(drive, joints, frames, speed, far, pins)
    else:
        for j in range(len(joints)):
            write(slope[END], j, vector_of(slope[FAR], j))
    write(coriolis, BASE, base[2])
    write(coriolis, FAR, far[2])
    write(coriolis, END, end[2])
    span = plus(end[0], base[0], -1.0)
    length = math.sqrt(dot(span, span))
    for j in range(len(joints)):
        relative = plus(vector_of(slope[END], j), vector_of(slope[BASE], j), -1.0)
        pins.arm[j] = dot(span, relative) / length
    return length, span


@within
def _place_knee(
    drive: Record, joints: Records, frames: Frames, speed: Array, lug: Moving, pins: PinMotion
) -> Moving:
    """The knee of a four-bar; slopes of pivot, plane and knee are written."""
    frame, slope = drive.pivot_pin.frame, pins.slope
    at = _position(drive.pivot_pin, frames)
    pivot = moved(joints, frames, speed, frame, at, True, slope[PIVOT])
    along = direction(frame, drive.right, frames)
    right = moved(joints, frames, speed, frame, along, False, slope[RIGHT])
    along = direction(frame, drive.up, frames)
    up = moved(joints, frames, speed, frame, along, False, slope[UP])
    for j in range(len(joints)):
        knee = _folded(
            drive,
            (pivot[0], vector_of(slope[PIVOT], j), ZERO),
            (lug[0], vector_of(slope[FAR], j), ZERO),
            (right[0], vector_of(slope[RIGHT], j), ZERO),
            (up[0], vector_of(slope[UP], j), ZERO),
        )
        write(slope[END], j, knee[1])
    write(pins.coriolis, PIVOT, pivot[2])
    return _folded(drive, pivot, lug, right, up)
