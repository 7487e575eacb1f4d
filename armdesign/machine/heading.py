"""Where an arm points: reach along that direction, what is ahead of the slew axis, pitches.

An arm points along the vertical plane in which it moves: square to those of its hinges that are
not upright, the more the farther from them the tool is, else along its first slide that is level,
else towards its tool. Of both ways along it, the tool lies on the one ahead, seen from the slew
axis, or from the first joint without slews, with all joints at the middle of their ranges; near to
that axis, where neither way is its own, it is the way that a positive angle of the hinge raises,
or in which the slide goes out. Frozen joints count, springs do not, nor how the file turns the
machine about the vertical. Slews turn this direction.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from armdesign.arrays import Array, ReadOnly
from armdesign.mechanism.arm import Arm
from armdesign.mechanism.jets import VectorJet
from armdesign.mechanism.rigid_poses import RigidPoses
from armdesign.mechanism.slews import carriers, seen_from_root

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

    def pitch(self, poses: RigidPoses, link: str) -> Array:
        """Pitch of a link's x axis up from forward (n,) [rad], square to its y axis."""
        x, y = np.moveaxis(self.arm.link_rotation(poses, link)[:, :, :2], (2, 1), (0, 1))
        onward = x[0] * y[1] - x[1] * y[0]  # of x, along the level direction square to y
        return np.arctan2(x[2], self._side(link) * onward)

    def pitch_slopes(self, poses: RigidPoses, link: str, joints: tuple[int, ...]) -> Array:
        """Slopes (n, k) by k joints of the pitch of a link."""
        x, y = (
            self.arm.direction(poses, link, one, self.arm.root, joints) for one in np.eye(3)[:2]
        )
        (x0, x1, up), (y0, y1, _) = x.value.T[..., None], y.value.T[..., None]
        (dx0, dx1, rise), (dy0, dy1, _) = np.moveaxis(x.first, 2, 0), np.moveaxis(y.first, 2, 0)
        onward = x0 * y1 - x1 * y0
        further = dx0 * y1 + x0 * dy1 - dx1 * y0 - x1 * dy0
        slopes = (onward * rise - up * further) / (onward**2 + up**2)
        return np.asarray(self._side(link) * slopes)

    def _side(self, link: str) -> float:
        """1 if a link's y axis points to the left while all joints are at 0, −1 if to the right.

        A frame that is rolled about its x axis has the same pitch.
        """
        left = np.cross(self.arm.slews.axis, self.forward)
        y = self.arm.link_rotation(self.arm.zero, link)[0, :, 1]
        return -1.0 if float(y @ left) < -LEVEL else 1.0

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
    q = np.stack([np.zeros(len(arm.joints)), machine.known_ranges.mean(axis=1)])
    z = np.array(arm.with_springs(q), dtype=float)
    z[:, list(slews.axes)] = 0.0
    poses = [arm.kinematics(one[None]) for one in z]
    zero, middle = (list(_joints(machine, pose)) for pose in poses)
    tool = arm.point(poses[1], machine.tool.link, np.array(machine.tool.at))[0]
    start = middle[0].place if middle and not slews else np.append(slews.foot, 0.0)
    forward, lever = (
        _moved_along(slews.axis, zero, [at.lever(tool) for at in middle]),
        tool - start,
    )
    if forward is None:
        beside = _square(lever, slews.axis)
        aside = np.linalg.norm(beside) > NEAR * np.linalg.norm(lever)
        forward = beside if aside else _square(np.array([1.0, 0.0, 0.0]), slews.axis)
    elif float(lever @ forward) < -NEAR * np.linalg.norm(lever):
        forward = -forward
    plain = np.where(np.abs(forward) < ROUNDING * np.linalg.norm(forward), 0.0, forward)
    return Heading(arm=arm, forward=plain / np.linalg.norm(plain))


def _square(vector: Array, axis: Array) -> Array:
    """The part (3,) of a vector that is square to a unit axis."""
    return np.asarray(vector - float(vector @ axis) * axis)


@dataclass(frozen=True, eq=False)
class _PlacedJoint:
    """A joint that moves the tool, or could if it were not frozen, at one pose."""

    revolute: bool
    axis: Array  # (3,) unit vector
    place: Array  # (3,) [m] a point of its axis

    def lever(self, point: Array) -> float:
        """Distance [m] of a point from its axis."""
        return float(np.linalg.norm(np.cross(self.axis, point - self.place)))


def _joints(machine: Machine, pose: RigidPoses) -> Iterator[_PlacedJoint]:
    """Joints between root and tool at one pose, from the root out; springs are none."""
    arm, link = machine.arm, machine.arm.links[machine.tool.link]
    carrier = carriers([*arm.links.values()])
    rotation, place, axis = pose.rotation[0], pose.translation[0], pose.axis[0]
    for index in (-1, *arm.chain(machine.tool.link)):
        if 0 <= index < len(arm.joints):
            yield _PlacedJoint(arm.coordinates[index].revolute, axis[index], place[index])
        for one in link.frozen:
            if carrier[one.name] == index:
                there = seen_from_root((index, one), rotation, place)
                yield _PlacedJoint(one.revolute, there.axis, there.place)


def _moved_along(
    upward: Array, joints: Sequence[_PlacedJoint], levers: Sequence[float]
) -> Array | None:
    """Unit direction (3,) along which joints move a tool; None where all are upright.

    Hinges count by the tool's distance from them; of those that say so, the first. A positive
    angle of it raises what points there.
    """
    hinges = list(_level_axes(upward, joints, revolute=True))
    if not hinges:
        return next((axis for _, axis in _level_axes(upward, joints, revolute=False)), None)
    alike = [sum(levers[j] * abs(float(one @ other)) for j, other in hinges) for _, one in hinges]
    chosen = int(np.argmax(np.round(np.array(alike) / max(*alike, 1e-300), 6)))
    return np.asarray(np.cross(upward, hinges[chosen][1]))


def _level_axes(
    upward: Array, joints: Sequence[_PlacedJoint], *, revolute: bool
) -> Iterator[tuple[int, Array]]:
    """Hinges or slides that are not upright, by index: their directions (3,) square to upward."""
    for j, joint in enumerate(joints):
        level = _square(joint.axis, upward)
        if joint.revolute == revolute and np.linalg.norm(level) > LEVEL:
            yield j, level / np.linalg.norm(level)
