"""Shapes of the cylinders of a design problem: those that are known, and a design's place in one.

Known are cylinders that move one joint alone and vary at most by base and rod pins: on a revolute
joint in the plane of the pins, along a slide, or through a four-bar of given bars.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armdesign.arrays import Array
from armdesign.design.bound.cylinder_shape import Shape
from armdesign.design.bound.pin_triangles import TriangleBoxes
from armdesign.design.program.gradient import STEP
from armdesign.design.program.problem import Problem
from armdesign.mechanism.joint_ranges import sweep
from armdesign.mechanism.linkage.base import Linkage
from armdesign.mechanism.rigid_poses import RigidPoses

STRAIGHT = 1e-9  # how far from plane an arm may be


def shape_of(problem: Problem, i: int, angles: Array) -> Shape | None:
    """Shape of cylinder ``i`` at angles of its joint (n,), which follow the angles of its ends.

    None where none is known.
    """
    linkage, moves = problem.machine.linkages[i], _moves(problem, i)
    if len(linkage.joints) != 1 or moves is None:
        return None
    joint = linkage.joints[0]
    sign = float(np.sign(problem.vector.arms_today[i][0]))
    ends = problem.machine.ranges[joint][:: int(sign)]
    poses = sweep(problem.machine.arm, joint, np.concatenate([ends, angles]))
    if not moves:
        today = problem.machine.cylinders[i]
        stays = _about(linkage, poses, "base", np.zeros((2, 2)), sign)
        return replace(stays, fixed=(today.closed_length, today.stroke))
    shape = _of_moves(linkage, poses, moves, sign)
    spare = problem.vector.spare[i]
    return shape and replace(shape, spare=(float(spare[0]), float(spare[1])))


def _of_moves(
    linkage: Linkage, poses: RigidPoses, moves: dict[str, Array], sign: float
) -> Shape | None:
    """The shape where pins move, of all strokes that end with the range."""
    revolute = linkage.arm.joints[linkage.joints[0]].revolute
    if not revolute or "rod_end" not in moves:
        return _shifted(linkage, poses, moves, sign)
    if "base" not in moves:
        return _about(linkage, poses, "rod_end", moves["rod_end"], sign)
    return _turned(linkage, poses, moves, sign)


def _moves(problem: Problem, i: int) -> dict[str, Array] | None:
    """Reach of each pin, down and up (2, 2: x and z) [m]; None if another part varies too."""
    reaches: dict[str, Array] = {}
    for v in problem.vector.variables:
        if v.cylinder != i or v.pin is None:
            continue
        if v.pin not in ("base", "rod_end") or v.axis not in (0, 2):
            return None
        reach = reaches.setdefault(v.pin, np.zeros((2, 2)))
        reach[:, v.axis // 2] = np.array([-1.0, 1.0]) * problem.vector.pin_box
    return reaches


def _about(linkage: Linkage, poses: RigidPoses, pin: str, reach: Array, sign: float) -> Shape:
    """The shape by moves b [m] of one pin within ``reach`` (2, 2); the other one stays."""
    joint = linkage.joints[0]
    stepped = linkage.stepped_actuation(poses, [(pin, 0), (pin, 2)], STEP)
    length, arm, curve = (
        stepped.length,
        stepped.moment_arm[:, joint],
        stepped.moment_arm_derivative[:, joint, joint],
    )
    terms = np.stack([length**2 / 2, length * arm, length * curve + arm**2], axis=1)
    constant = terms[: len(poses)].real
    slope = np.moveaxis(terms.imag.reshape(2, -1, 3), 0, -1) / STEP
    low, high = reach
    return Shape(
        constant=constant, slope=slope, sign=sign, low=low, high=high, scale=(1.0, 1.0), pin=pin
    )


def _shifted(
    linkage: Linkage, poses: RigidPoses, moves: dict[str, Array], sign: float
) -> Shape | None:
    """The shape of a four-bar or slide: a rod pin's move is a base pin's backwards."""
    reach = moves.get("base", np.zeros((2, 2)))
    if "rod_end" in moves:
        turn = _turn(linkage, poses)
        if turn is None or np.ptp(turn, axis=0).max() > STRAIGHT:
            return None
        corners = (
            np.array([[x, z] for x in moves["rod_end"][:, 0] for z in moves["rod_end"][:, 1]])
            @ turn[0].T
        )
        reach = reach - np.stack([corners.max(axis=0), corners.min(axis=0)])
    return _about(linkage, poses, "base", reach, sign)


def _turned(
    linkage: Linkage, poses: RigidPoses, moves: dict[str, Array], sign: float
) -> Shape | None:
    """The shape of a direct cylinder on a revolute joint, in units of the rod pin's distance."""
    turn = _turn(linkage, poses)
    rod_end, arm, joint = linkage.pin("rod_end"), linkage.arm, linkage.joints[0]
    if turn is None or rod_end is None:
        return None
    places = _from_joint(linkage, poses)
    if abs(places["base"][1] - places["rod_end"][1]) > STRAIGHT:
        return None
    unmoved = np.zeros((2, 2))
    base, end = (places[pin][[0, 2]] + moves.get(pin, unmoved) for pin in ("base", "rod_end"))
    boxes = TriangleBoxes(base=base, rod_end=end)
    low, high, scale = boxes.region()
    unit = arm.direction(
        poses, rod_end.link, np.array([1.0, 0.0, 0.0]), linkage.base.link, (joint,)
    )
    frame = arm.link_rotation(poses, linkage.base.link)[:, :, [0, 2]]
    parts = [
        np.einsum("ni,nik->nk", p, frame)
        for p in (unit.value, unit.first[:, 0], unit.second[:, 0, 0])
    ]
    constant = np.tile([0.5, 0.0, 0.0], (len(poses), 1))
    slope = -np.stack(parts, axis=1)
    return Shape(
        constant=constant, slope=slope, sign=sign, low=low, high=high, scale=scale, pin_boxes=boxes
    )


def _from_joint(linkage: Linkage, poses: RigidPoses) -> dict[str, Array]:
    """Base and rod pin (3,) [m] as seen from their joint, each in the axes of its link."""
    arm, levers = linkage.arm, {}
    for pin in ("base", "rod_end"):
        place = getattr(linkage, pin)
        lever = (
            arm.point(poses[:1], place.link, np.array(place.at))[0]
            - poses.translation[0, linkage.joints[0]]
        )
        levers[pin] = arm.link_rotation(poses[:1], place.link)[0].T @ lever
    return levers


def coordinates(problem: Problem, i: int, shape: Shape, x: Array) -> Array:
    """The base's place b and the scale (3,) of cylinder ``i`` of the design x."""
    linkage, today = problem.vector.linkages(x)[i], problem.machine.linkages[i]
    poses = sweep(linkage.arm, linkage.joints[0], problem.machine.ranges[linkage.joints[0]])
    if shape.pin_boxes is not None:
        places = _from_joint(linkage, poses)
        base, end = (complex(places[pin][0], places[pin][2]) for pin in ("base", "rod_end"))
        return np.array([(base / end).real, (base / end).imag, abs(end)])
    here, before = (np.array(k.place(shape.pin)) for k in (linkage, today))
    move = (here - before)[[0, 2]]
    turn = _turn(linkage, poses) if shape.pin == "base" else None
    if turn is not None:
        new, old = (np.array(k.place("rod_end")) for k in (linkage, today))
        move = move - turn[0] @ (new - old)[[0, 2]]
    return np.append(move, 1.0)


def _turn(linkage: Linkage, poses: RigidPoses) -> Array | None:
    """Rotation of the rod end's link in the base's (n, 2, 2), x and z; None if not in a plane."""
    rod_end = linkage.pin("rod_end")
    if rod_end is None:
        return None
    frames = [linkage.arm.link_rotation(poses, link) for link in (linkage.base.link, rod_end.link)]
    turn = np.swapaxes(frames[0], 1, 2) @ frames[1]
    if np.abs(turn[:, 1] - [0.0, 1.0, 0.0]).max() > STRAIGHT:
        return None
    return np.asarray(turn[:, [0, 2]][:, :, [0, 2]])
