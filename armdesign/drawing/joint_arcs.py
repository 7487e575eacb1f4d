"""Ranges of joints as lines: where a mark on what a joint moves goes while it moves all its range.

The mark of a hinge lies on the way from it to the next joint or the tool, so that the line is an
arc about the hinge; a slide's is the point where it carries the next joint or the tool. A line
stays in the plate of the body before its joint.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from armdesign.arrays import Array
from armdesign.drawing.outlines import DrawnBody
from armdesign.drawing.plane import PicturePlane
from armdesign.errors import ArmDesignError

if TYPE_CHECKING:
    from armdesign.machine.machine import Machine

SAMPLES = 33  # of a range
RADIUS = 0.3  # of the distance to the next joint or the tool
VISIBLE = 0.5  # least part across the picture of a hinge's axis, largest of a slide's


@dataclass(frozen=True, eq=False, kw_only=True)
class JointArc:
    """The range of a joint as a line of its mark.

    Attributes:
        joint: its name.
        revolute: else a slide.
        body: index of the body before the joint, in whose plate the line is.
        points: from the lower to the upper end (m, 2) [m].
        lower: end of the range [rad, m].
        upper: end of the range [rad, m].
    """

    joint: str
    revolute: bool
    body: int
    points: Array
    lower: float
    upper: float


def joint_arcs(
    machine: Machine, plane: PicturePlane, bodies: tuple[DrawnBody, ...]
) -> tuple[JointArc, ...]:
    """Arcs of all joints of poses that move in the picture."""
    arm, arcs = machine.arm, []
    for j, (joint, (lower, upper)) in enumerate(
        zip(arm.joints, machine.known_ranges.tolist(), strict=True)
    ):
        if not in_picture(machine, plane, j):
            continue
        q = np.zeros((SAMPLES, len(arm.joints)))
        q[:, j] = np.linspace(lower, upper, SAMPLES)
        marks = plane.poses(q)
        own, before = bodies[j + 1].link, bodies[joint.parent + 1].link
        place = arm.point(marks, own, _mark(machine, plane, j, own))
        local = arm.in_link(plane.zero, before, place)
        arcs.append(
            JointArc(
                joint=joint.name,
                revolute=joint.revolute,
                body=joint.parent + 1,
                points=local @ plane.plate(before).T,
                lower=lower,
                upper=upper,
            )
        )
    return tuple(arcs)


def in_picture(machine: Machine, plane: PicturePlane, j: int) -> bool:
    """Whether a joint moves what it carries in the picture, not across it."""
    axis = plane.zero.axis[0, j]
    across = abs(float(axis @ plane.across))
    hinge = machine.arm.coordinates[j].revolute
    return j not in machine.arm.slews and (across >= VISIBLE) == hinge


def refuse_other_joints(machine: Machine, other: Machine) -> None:
    """Refuse a machine that cannot take the poses of another.

    Raises:
        ArmDesignError: it has other joints.
    """
    if other.joints != machine.joints:
        fault = f"has other joints ({', '.join(other.joints)})"
        raise ArmDesignError(other.name, fault, f"give one with {', '.join(machine.joints)}")


def middle_pose(machine: Machine) -> Array:
    """The middle of all joint ranges (nq,) [rad, m]."""
    return np.asarray(machine.known_ranges.mean(axis=1))


def _mark(machine: Machine, plane: PicturePlane, j: int, link: str) -> Array:
    """The mark (3,) [m] in the frame of the body's first link."""
    arm, zero, tool = machine.arm, plane.zero, machine.tool
    following = [i for i in arm.chain(tool.link) if arm.coordinates[i].parent == j]
    if following:
        target = zero.translation[0, following[0]]
    elif arm.links[tool.link].joint == j:
        target = arm.point(zero, tool.link, np.array(tool.at))[0]
    else:
        children = [i for i, joint in enumerate(arm.coordinates) if joint.parent == j]
        target = zero.translation[0, children[0]] if children else zero.translation[0, j]
    hinge = zero.translation[0, j]
    if arm.coordinates[j].revolute:
        target = hinge + RADIUS * (target - hinge)
    foot = arm.point(zero, link, np.zeros(3))[0]
    return np.asarray((target - foot) @ arm.link_rotation(zero, link)[0])
