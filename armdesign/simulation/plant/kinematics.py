"""Where pins are and how they move, compiled: lengths and moment arms of cylinders, inertia and bias of their bars.

The same geometry as ``linkage``, of one pose at a time and without what a simulation does not
need. All is seen from the world. A joint j moves a point P on a link behind it by ∂P/∂q_j = a_j ×
(P − o_j), its axis if it slides; with joint speeds q̇ and no joint acceleration P is accelerated
by Σ_j q̇_j ω_j × (∂P/∂q_j q̇_j + 2 Σ_k ∂P/∂q_k q̇_k), k the joints between j and P: its bias. A
moment arm is r_j = d · (∂E/∂q_j − ∂B/∂q_j) with the cylinder's direction d, B its base pin and E
its rod end: what moves both alike does not count.

The plane of a four-bar has the coordinates right and up. From pivot to lug (a, c), e = a² + c²,
the knee is at x (a, c) + y (−c, a),  x = ½ + (rocker² − coupler²)/2e,  y = ± √(rocker²/e − x²).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from armdesign.arrays import Array
from armdesign.hydraulics.actuator import Cylinder
from armdesign.machine.machine import Machine
from armdesign.mechanism.arm import Arm
from armdesign.mechanism.linkage.base import Pin
from armdesign.mechanism.linkage.four_bar import FourBar
from armdesign.mechanism.linkage.gear import Gear
from armdesign.mechanism.urdf import Joint
from armdesign.simulation.plant.compiled import compiled
from armdesign.simulation.plant.vectors import ZERO, cross, dot, plus, scaled, turned
from armdesign.units import GRAVITY

JOINT = (
    np.dtype(  # a joint's frame in the one before it: turned by still + sin q sine + cos q cosine
        [
            ("next", "i8"),  # the joint to place in this turn, so that each comes after its parent
            ("parent", "i8"),  # −1: the world
            ("revolute", "?"),
            *((name, "f8", (3, 3)) for name in ("still", "sine", "cosine")),
            *((name, "f8", 3) for name in ("translation", "slide", "axis")),
        ],
        align=True,
    )
)
PIN = np.dtype(
    [("frame", "i8"), ("at", "f8", 3)], align=True
)  # in the frame of a joint; −1: the world
GEAR, FOUR_BAR = Gear.number, FourBar.number
DRIVE = np.dtype(  # of a cylinder its pins and bars, of a motor the joint that it turns
    [
        ("kind", "i8"),  # the ``number`` of its class
        ("joint", "i8"),
        *((name, PIN) for name in ("base", "far", "pivot")),  # far: rod end or lug
        *((name, "f8", 3) for name in ("right", "up")),
        *((name, "f8") for name in ("rocker", "coupler", "side", "closed_length")),
        *((name, "f8") for name in ("barrel_mass", "rod_mass", "rocker_mass", "coupler_mass")),
    ],
    align=True,
)


# ---------------------------------------------------------------------------------------- machines


def joints_of(arm: Arm) -> Array:
    """Joints (nq,) as records ``JOINT``."""
    made = np.zeros(len(arm.joints), JOINT)
    for row, joint, following in zip(made, arm.joints, arm.outwards, strict=True):
        row["next"], row["parent"], row["revolute"] = following, joint.parent, joint.revolute
        row["translation"], row["axis"] = joint.translation, joint.axis
        row["still"], row["sine"], row["cosine"] = _turn(joint)
        row["slide"] = 0.0 if joint.revolute else joint.rotation @ joint.axis
    return made


def _turn(joint: Joint) -> tuple[Array, Array, Array]:
    """Rodrigues: turned about the unit axis with cross-product matrix K by q is I + K² + sin q K − cos q K²."""
    if not joint.revolute:
        return joint.rotation, np.zeros((3, 3)), np.zeros((3, 3))
    x, y, z = joint.axis
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return joint.rotation @ (np.eye(3) + k @ k), joint.rotation @ k, -joint.rotation @ k @ k


def drives_of(machine: Machine) -> Array:
    """Cylinders, and motors after them, (nc,) as records ``DRIVE``."""
    made = np.zeros(len(machine.actuators), DRIVE)
    for row, actuator, drive in zip(made, machine.actuators, machine.drives, strict=True):
        for field, value in drive.record().items():
            row[field] = _pin(machine.arm, value) if isinstance(value, Pin) else value
        if isinstance(actuator, Cylinder):
            row["closed_length"] = actuator.closed_length
            for name, mass in actuator.moving_masses.items():
                row[f"{name}_mass"] = mass
    return made


def _pin(arm: Arm, pin: Pin) -> tuple[int, tuple[float, ...]]:
    body = arm.links[pin.link]
    return body.joint, tuple(body.translation + body.rotation @ np.array(pin.at))


# ------------------------------------------------------------------------------------------ motion


@compiled
def place_joints(joints: Any, q: Any, rotation: Any, origin: Any, axis: Any) -> None:
    """Joint frames in the world at q (nq,): rotations (nq, 3, 3), origins (nq, 3) and axes (nq, 3) are written."""
    for k in range(len(joints)):
        j = joints[k].next
        joint = joints[j]
        sine, cosine, parent = math.sin(q[j]), math.cos(q[j]), joint.parent
        for row in range(3):
            origin[j, row] = joint.translation[row] + q[j] * joint.slide[row]
            for column in range(3):
                rotation[j, row, column] = (
                    joint.still[row, column]
                    + sine * joint.sine[row, column]
                    + cosine * joint.cosine[row, column]
                )
        if parent >= 0:
            before = rotation[parent]
            x, y, z = turned(before, (origin[j, 0], origin[j, 1], origin[j, 2]))
            origin[j, 0], origin[j, 1], origin[j, 2] = (
                x + origin[parent, 0],
                y + origin[parent, 1],
                z + origin[parent, 2],
            )
            for column in range(3):
                x, y, z = turned(
                    before,
                    (rotation[j, 0, column], rotation[j, 1, column], rotation[j, 2, column]),
                )
                rotation[j, 0, column], rotation[j, 1, column], rotation[j, 2, column] = x, y, z
        axis[j, 0], axis[j, 1], axis[j, 2] = turned(
            rotation[j], (joint.axis[0], joint.axis[1], joint.axis[2])
        )


@compiled
def _vector(rows: Any, index: int) -> Any:
    return (rows[index, 0], rows[index, 1], rows[index, 2])


@compiled
def _place(pin: Any, rotation: Any, origin: Any) -> Any:
    """A pin in the world."""
    at = (pin.at[0], pin.at[1], pin.at[2])
    return (
        at
        if pin.frame < 0
        else plus(_vector(origin, pin.frame), turned(rotation[pin.frame], at), 1.0)
    )


@compiled
def _direction(frame: int, along: Any, rotation: Any) -> Any:
    """A direction of a joint's frame in the world."""
    given = (along[0], along[1], along[2])
    return given if frame < 0 else turned(rotation[frame], given)


@compiled
def _moved(
    joints: Any,
    origin: Any,
    axis: Any,
    speed: Any,
    frame: int,
    vector: Any,
    bound: bool,
    slope: Any,
) -> Any:
    """Rate and bias of a point on a joint's frame, or of a direction if not ``bound``.

    Its slopes (nq, 3) are written.

    From the frame down to the world: what is added up is the motion by the joints between.
    """
    slope[:] = 0.0
    rate, bias, j = ZERO, ZERO, frame
    while j >= 0:
        joint, turn = joints[j], _vector(axis, j)
        if joint.revolute:
            lever = plus(vector, _vector(origin, j), -1.0) if bound else vector
            own = cross(turn, lever)
        else:
            own = turn if bound else ZERO
        slope[j, 0], slope[j, 1], slope[j, 2] = own
        own = scaled(own, speed[j])
        if joint.revolute:
            bias = plus(bias, cross(turn, plus(own, rate, 2.0)), speed[j])
        rate, j = plus(rate, own, 1.0), joint.parent
    return rate, bias


@compiled
def _knee(drive: Any, a: Any, c: Any) -> Any:
    """The knee's two coordinates from those of the lug.

    Each number with its first and second derivative in time.
    """
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


@compiled
def _within(along: Any, vector: Any) -> Any:
    """Scalar product of two vectors with their first and second derivatives, with the product's."""
    return (
        dot(along[0], vector[0]),
        dot(along[1], vector[0]) + dot(along[0], vector[1]),
        dot(along[2], vector[0]) + 2 * dot(along[1], vector[1]) + dot(along[0], vector[2]),
    )


@compiled
def _times(number: Any, vector: Any) -> Any:
    """A number times a vector, both with their first and second derivatives."""
    first = plus(scaled(vector[0], number[1]), vector[1], number[0])
    second = plus(
        plus(scaled(vector[0], number[2]), vector[1], 2 * number[1]), vector[2], number[0]
    )
    return scaled(vector[0], number[0]), first, second


@compiled
def _sum(one: Any, other: Any, factor: float) -> Any:
    return (
        plus(one[0], other[0], factor),
        plus(one[1], other[1], factor),
        plus(one[2], other[2], factor),
    )


@compiled
def _folded(drive: Any, pivot: Any, lug: Any, right: Any, up: Any) -> Any:
    """The knee of a four-bar from its pins and plane, all with their first and second derivatives."""
    vector = _sum(lug, pivot, -1.0)
    across, height = _knee(drive, _within(right, vector), _within(up, vector))
    return _sum(pivot, _sum(_times(across, right), _times(height, up), 1.0), 1.0)


BASE, END, FAR, PIVOT, RIGHT, UP, BARREL, ROD = range(
    8
)  # of a drive; END: rod end or knee; BARREL, ROD: inner ends
POINTS = 8


@compiled
def place_drive(
    drive: Any,
    joints: Any,
    rotation: Any,
    origin: Any,
    axis: Any,
    speed: Any,
    slope: Any,
    bias: Any,
    arm: Any,
) -> Any:
    """Length of a cylinder and its vector from base pin to rod end.

    Its moment arms (nq,) are written, slopes (POINTS, nq, 3) and biases (POINTS, 3) of its pins.
    """
    base, far = _place(drive.base, rotation, origin), _place(drive.far, rotation, origin)
    _, bias_base = _moved(joints, origin, axis, speed, drive.base.frame, base, True, slope[BASE])
    rate_far, bias_far = _moved(
        joints, origin, axis, speed, drive.far.frame, far, True, slope[FAR]
    )
    end, bias_end = far, bias_far
    if drive.kind == FOUR_BAR:
        frame = drive.pivot.frame
        pivot = _place(drive.pivot, rotation, origin)
        right, up = _direction(frame, drive.right, rotation), _direction(frame, drive.up, rotation)
        rate_pivot, bias_pivot = _moved(
            joints, origin, axis, speed, frame, pivot, True, slope[PIVOT]
        )
        rate_right, bias_right = _moved(
            joints, origin, axis, speed, frame, right, False, slope[RIGHT]
        )
        rate_up, bias_up = _moved(joints, origin, axis, speed, frame, up, False, slope[UP])
        knee = _folded(
            drive,
            (pivot, rate_pivot, bias_pivot),
            (far, rate_far, bias_far),
            (right, rate_right, bias_right),
            (up, rate_up, bias_up),
        )
        end, bias_end = knee[0], knee[2]
        for j in range(len(joints)):
            along_j = _folded(
                drive,
                (pivot, _vector(slope[PIVOT], j), ZERO),
                (far, _vector(slope[FAR], j), ZERO),
                (right, _vector(slope[RIGHT], j), ZERO),
                (up, _vector(slope[UP], j), ZERO),
            )
            _write(slope[END], j, along_j[1])
        _write(bias, PIVOT, bias_pivot)
    else:
        slope[END] = slope[FAR]
    _write(bias, BASE, bias_base)
    _write(bias, FAR, bias_far)
    _write(bias, END, bias_end)
    span = plus(end, base, -1.0)
    length = math.sqrt(dot(span, span))
    for j in range(len(joints)):
        arm[j] = dot(span, plus(_vector(slope[END], j), _vector(slope[BASE], j), -1.0)) / length
    return length, span


@compiled
def _write(rows: Any, index: int, vector: Any) -> None:
    rows[index, 0], rows[index, 1], rows[index, 2] = vector


@compiled
def add_bars(
    drive: Any, length: float, span: Any, speed: Any, slope: Any, bias: Any, mass: Any, force: Any
) -> None:
    """Add what barrel, rod, rocker and coupler of a placed cylinder give to M (nq, nq) and to h (nq,).

    Barrel and rod are as long as the closed cylinder: their inner ends stand at ± ℓ_closed S/ℓ
    from base pin and rod end, S from the one to the other.
    """
    rate = ZERO
    for j in range(len(speed)):
        moved = plus(_vector(slope[END], j), _vector(slope[BASE], j), -1.0)
        rate = plus(rate, moved, speed[j])
        along = _times(_share(drive, length, span, moved, ZERO), (span, moved, ZERO))
        _write(slope[BARREL], j, plus(_vector(slope[BASE], j), along[1], 1.0))
        _write(slope[ROD], j, plus(_vector(slope[END], j), along[1], -1.0))
    second = plus(_vector(bias, END), _vector(bias, BASE), -1.0)
    along = _times(_share(drive, length, span, rate, second), (span, rate, second))
    _write(bias, BARREL, plus(_vector(bias, BASE), along[2], 1.0))
    _write(bias, ROD, plus(_vector(bias, END), along[2], -1.0))
    _add_bar(drive.barrel_mass, BASE, BARREL, slope, bias, mass, force)
    _add_bar(drive.rod_mass, ROD, END, slope, bias, mass, force)
    if drive.kind == FOUR_BAR:
        _add_bar(drive.rocker_mass, PIVOT, END, slope, bias, mass, force)
        _add_bar(drive.coupler_mass, END, FAR, slope, bias, mass, force)


@compiled
def _share(drive: Any, length: float, span: Any, rate: Any, second: Any) -> Any:
    """ℓ_closed/ℓ with its first and second derivatives, of the pin-to-pin vector's."""
    first = dot(span, rate) / length
    curve = (dot(rate, rate) + dot(span, second) - first * first) / length
    share = drive.closed_length / length
    return share, -share * first / length, share * (2 * first * first / length - curve) / length


@compiled
def _add_bar(
    weight: float, one: int, other: int, slope: Any, bias: Any, mass: Any, force: Any
) -> None:
    """A uniform slender bar between two points X, Y: m/3 (XXᵀ + YYᵀ) + m/6 (XYᵀ + YXᵀ), and so the forces."""
    if weight == 0.0:
        return
    upwards = (0.0, 0.0, GRAVITY)
    pull_one, pull_other = (
        plus(_vector(bias, one), upwards, 1.0),
        plus(_vector(bias, other), upwards, 1.0),
    )
    first = plus(scaled(pull_one, weight / 3), pull_other, weight / 6)
    second = plus(scaled(pull_other, weight / 3), pull_one, weight / 6)
    for j in range(len(force)):
        x, y = _vector(slope[one], j), _vector(slope[other], j)
        force[j] += dot(x, first) + dot(y, second)
        near, far = (
            plus(scaled(x, weight / 3), y, weight / 6),
            plus(scaled(y, weight / 3), x, weight / 6),
        )
        for k in range(len(force)):
            mass[j, k] += dot(near, _vector(slope[one], k)) + dot(far, _vector(slope[other], k))
