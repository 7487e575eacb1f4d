"""Modes as motion: how a machine swings in a mode, and how its picture then moves.

A mode has no amplitude of its own. It is drawn so that of all points of the machine the one that
moves furthest goes a twentieth of the machine's size, whatever the tool does. Joints swing, so
that bodies stay rigid: q + (swung − q) sin(ωt).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from armdesign.arrays import Array, ReadOnly
from armdesign.drawing.outlines import DrawnBody
from armdesign.drawing.plane import PicturePlane

if TYPE_CHECKING:
    from armdesign.machine.machine import Machine

SHARE = 1 / 20  # of a machine's size: way of the point that moves furthest, to first order


@dataclass(frozen=True, eq=False, kw_only=True)
class Swing(ReadOnly):
    """A mode as motion at n poses, one way; arrays are read-only.

    Attributes:
        steps: of all coordinates (n, k) [rad, m], springs last.
        tool: half the distance of the tool's two ends (n,) [m].
    """

    steps: Array
    tool: Array


@dataclass(frozen=True, eq=False, kw_only=True)
class Swings:
    """How far a machine is drawn to swing.

    Attributes:
        machine: the machine.
        bodies: outlines of its links.
        size: of what is drawn [m].
    """

    machine: Machine
    bodies: tuple[DrawnBody, ...]
    size: float

    def of(self, q: Array, mode: Array) -> Swing:
        """The swing at joint positions q (n, nq) in a mode (n, k), as ``Modes.shapes`` has."""
        arm = self.machine.arm
        poses, joints = arm.kinematics(arm.with_springs(q)), tuple(range(len(arm.coordinates)))

        def moved(link: str, at: Array) -> Array:
            slopes = arm.motion(poses, link, at, arm.root, joints).first
            return np.asarray(np.einsum("nki,nk->ni", slopes, mode))

        furthest = np.zeros(len(q))
        for link, at in self._points():
            furthest = np.maximum(furthest, np.linalg.norm(moved(link, at), axis=1))
        for link, axes, corners in self._plates:
            foot = moved(link, np.zeros(3))
            along = np.stack([moved(link, axis) - foot for axis in axes])
            ways = foot[:, None] + np.einsum("mp,pni->nmi", corners, along)
            furthest = np.maximum(furthest, np.linalg.norm(ways, axis=2).max(axis=1))
        steps = mode * (SHARE * self.size / np.where(furthest > 0, furthest, 1.0))[:, None]
        tip = self.machine.tool.link, np.array(self.machine.tool.at)
        ends = [arm.point(arm.kinematics(poses.q + side * steps), *tip) for side in (-1, 1)]
        return Swing(steps=steps, tool=np.linalg.norm(ends[1] - ends[0], axis=1) / 2)

    def _points(self) -> Iterator[tuple[str, Array]]:
        """Tool, pins and loads, each with its link."""
        yield self.machine.tool.link, np.array(self.machine.tool.at)
        for linkage in self.machine.linkages:
            yield from ((pin.link, np.array(pin.at)) for pin in linkage.pins)
        for load in self.machine.payloads:
            if load.link is not None and load.mass > 0:
                yield load.link, np.array(load.at)

    @cached_property
    def _plates(self) -> list[tuple[str, Array, Array]]:
        """Axes (2, 3) of each moving body's plate, and the corners (m, 2) of its outlines' box."""
        plane = PicturePlane(self.machine.heading)
        boxes = list[tuple[str, Array, Array]]()
        for body in self.bodies[1:]:
            if body.polygons:
                every = np.concatenate(body.polygons)
                (x0, y0), (x1, y1) = every.min(axis=0), every.max(axis=0)
                box = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
                boxes.append((body.link, plane.plate(body.link), box))
        return boxes


@dataclass(frozen=True, eq=False, kw_only=True)
class PictureJoints(ReadOnly):
    """Joints as a picture shows them at n poses: hinges turn bodies in it, slides shift them.

    A body is moved by its joint and all that carry it, as a rigid plate. Of joints that turn
    bodies out of the picture only the part in it is seen; slewing is left out, and what carries
    the slew is seen as the arm is.

    Attributes:
        carriers: index of the body that carries each coordinate's (k).
        hinges: whether each is a hinge (k).
        places: of hinges, directions of slides, in the picture (n, k, 2).
        turns: angle to the left in the picture by a step of each hinge (n, k); 1 of slides.
    """

    carriers: tuple[int, ...]
    hinges: tuple[bool, ...]
    places: Array
    turns: Array


def picture_joints(machine: Machine, q: Array) -> PictureJoints:
    """The joints of a machine's picture at q (n, nq) [rad, m]."""
    arm = machine.arm
    plane = PicturePlane(machine.heading)
    poses = plane.poses(q)
    hinges = np.array([joint.revolute for joint in arm.coordinates])
    axes = plane.axes_at(poses, machine.tool.link)
    across = np.cross(axes[..., 1, :], axes[..., 0, :])[..., None]
    turns = np.where(hinges, -(poses.axis @ across)[..., 0], 1.0)
    turns[:, list(arm.slews.axes)] = 0.0
    feet = plane.seen(poses, machine.tool.link, poses.translation)
    return PictureJoints(
        carriers=tuple(joint.parent + 1 for joint in arm.coordinates),
        hinges=tuple(hinges.tolist()),
        places=np.where(hinges[:, None], feet, poses.axis @ np.swapaxes(axes, -1, -2)),
        turns=turns,
    )
