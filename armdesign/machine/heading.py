"""Where an arm points: reach along that direction, and what is ahead of the slew axis.

An arm points along the vertical plane in which it moves: square to most of its hinges that are not
upright, else along its first slide that is level, else towards its tool. Of both ways along it,
the tool lies on the one ahead, seen from the slew axis, or from the first joint without slews,
with all joints at the middle of their ranges; near to that axis, where neither way is its own, it
is the way that a positive angle of the hinge raises, or in which the slide goes out. How the file
turns the machine about the vertical does not count. Slews turn this direction.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from armdesign.arrays import Array, ReadOnly
from armdesign.errors import MachineFileError
from armdesign.mechanism.arm import Arm
from armdesign.mechanism.jets import VectorJet
from armdesign.mechanism.rigid_poses import RigidPoses

if TYPE_CHECKING:
    from armdesign.machine.machine import Machine

LEVEL = 0.5  # least part of an axis square to the slew axis, of a joint that says where arms point
NEAR = 0.05  # of its distance, how far ahead or behind a tool is so near that it says no way
ROUNDING = 1e-9  # of a direction's parts: below it they are none


@dataclass(frozen=True, eq=False, kw_only=True)
class Heading(ReadOnly):
    """Where an arm points at its poses.

    Attributes:
        arm: the arm.
        forward: unit direction (3,), square to the slew axis, in which it points while slews are
            at 0.
    """

    arm: Arm
    forward: Array

    def at(self, q: Array) -> Array:
        """Level direction (n, 2) in which the arm points at q (n, nq), or with springs (n, k)."""
        slews, z = self.arm.slews, self.arm.with_springs(q)
        turned = slews.turned(self.forward, z if slews.axes else z[:1])[:, :2]
        level = turned / np.linalg.norm(turned, axis=1, keepdims=True)
        return np.broadcast_to(level, (len(z), 2))

    def ahead(self, q: Array, place: Array) -> Array:
        """Level distance of places (n, 3) ahead of the slew axis on the ground (n,) [m]."""
        return np.einsum("ni,ni->n", place[:, :2] - self.arm.slews.foot, self.at(q))

    def reach(self, q: Array, place: Array) -> Array:
        """Level distance of places (n, 3) from the root's z axis (n,) [m]; negative behind it."""
        ahead = np.einsum("ni,ni->n", place[:, :2], self.at(q))
        return np.asarray(np.copysign(np.hypot(place[:, 0], place[:, 1]), ahead))

    def reach_and_height(self, q: Array, place: VectorJet) -> tuple[Array, Array]:
        """Reach and height (n, 2) [m] of places seen from the root, and ∂/∂q of both (n, 2, k)."""
        radius = self.reach(q, place.value)
        outward = place.value[:, :2] / np.where(radius == 0, np.inf, radius)[:, None]
        ahead = (place.first[:, :, :2] @ outward[:, :, None])[..., 0]
        slopes = np.stack([ahead, place.first[:, :, 2]], axis=1)
        return np.stack([radius, place.value[:, 2]], axis=1), slopes


def heading_of(machine: Machine) -> Heading:
    """Where the arm of a machine points, by its joints, their ranges and its tool."""
    arm, slews = machine.arm, machine.arm.slews
    q = np.stack([np.zeros(len(arm.joints)), known_ranges(machine).mean(axis=1)])
    z = np.array(arm.with_springs(q), dtype=float)
    z[:, list(slews.axes)] = 0.0
    zero, middle = (arm.kinematics(one[None]) for one in z)
    lever = _tool_seen_from_first_axis(machine, middle)
    forward = _moved_along(arm, zero)
    if forward is None:
        beside = _square(lever, slews.axis)
        aside = np.linalg.norm(beside) > NEAR * np.linalg.norm(lever)
        forward = beside if aside else _square(np.array([1.0, 0.0, 0.0]), slews.axis)
    elif float(lever @ forward) < -NEAR * np.linalg.norm(lever):
        forward = -forward
    plain = np.where(np.abs(forward) < ROUNDING * np.linalg.norm(forward), 0.0, forward)
    return Heading(arm=arm, forward=plain / np.linalg.norm(plain))


def known_ranges(machine: Machine) -> Array:
    """Joint ranges (nq, 2) [rad, m]; the URDF's limits of a machine that cannot be assembled."""
    try:
        return machine.ranges
    except MachineFileError:
        return machine.arm.limits


def _square(vector: Array, axis: Array) -> Array:
    """The part (3,) of a vector that is square to a unit axis."""
    return np.asarray(vector - float(vector @ axis) * axis)


def _tool_seen_from_first_axis(machine: Machine, pose: RigidPoses) -> Array:
    """Place of the tool (3,) [m] at one pose, from the slew axis or else from the first joint."""
    arm, tool = machine.arm, machine.tool
    start = np.append(arm.slews.foot, 0.0)
    chain = arm.chain(tool.link)
    if chain and not arm.slews:
        start = pose.translation[0, chain[0]]
    return np.asarray(arm.point(pose, tool.link, np.array(tool.at))[0] - start)


def _moved_along(arm: Arm, zero: RigidPoses) -> Array | None:
    """Unit direction (3,) along which an arm moves, by its axes at a pose; None of slews alone.

    A positive angle of the hinge that says it raises what points there.
    """
    hinges, slides = (list(_level_axes(arm, zero, revolute)) for revolute in (True, False))
    if hinges:
        alike = [sum(abs(float(one @ other)) for other in hinges) for one in hinges]
        return np.asarray(np.cross(arm.slews.axis, hinges[int(np.argmax(np.round(alike, 6)))]))
    return slides[0] if slides else None


def _level_axes(arm: Arm, zero: RigidPoses, revolute: bool) -> Iterator[Array]:
    """Directions (3,), square to the slew axis, of hinges or slides that are not upright."""
    for joint, axis in zip(arm.coordinates, zero.axis[0], strict=True):
        level = _square(axis, arm.slews.axis)
        if joint.revolute == revolute and np.linalg.norm(level) > LEVEL:
            yield level / np.linalg.norm(level)
