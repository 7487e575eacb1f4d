"""Cylinders and four-bars as bodies of their own, on joints that nothing drives.

A robot description knows rigid bodies and joints, not lengths between pins. So a barrel turns
about its base pin, a rod slides in it, a rocker turns about its pivot and a coupler about the
knee. The body before it carries each; ``closes`` is the link or body on whose pin it ends. All
joints are 0 at a reference pose.

In the plane of its link a barrel needs one hinge, about −y as the joints of the arm; where it
leaves the plane, another before it, about z.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from armdesign.arrays import Array
from armdesign.hydraulics.actuator import Cylinder
from armdesign.hydraulics.cylinder_build import barrel_outer
from armdesign.machine.poses import refuse_open
from armdesign.mechanism.linkage.base import Linkage, Pin
from armdesign.mechanism.linkage.kinds import KINDS
from armdesign.mechanism.rigid_poses import RigidPoses

if TYPE_CHECKING:
    from armdesign.machine.machine import Machine

APART = 1.5  # between the middles of parallel cylinders, over their diameter, as drawn
PARTS = ("swivel", "barrel", "rod", *(bar for kind in KINDS for bar, _ in kind.legs))
PLANE = 1e-9  # share of its length by which a cylinder may leave the plane of its link
PROBES, NEAR = 8, 1.0  # poses that tell whether it does, and how far off [rad, m]
ROD, BARREL, BAR = (0.75, 0.77, 0.80, 1), (0.25, 0.27, 0.30, 1), (0.45, 0.46, 0.48, 1)


@dataclass(frozen=True, kw_only=True, eq=False)
class CylinderBody:
    """A barrel, rod, rocker or coupler, or a swivel without extent before a barrel.

    Attributes:
        name: of the body and of its joint, such as ``boom_barrel``.
        parent: the link or body that carries it.
        kind: of its joint: continuous or prismatic.
        axis: of its joint.
        place: origin of its joint in the parent's frame [m].
        turn: roll, pitch, yaw of its frame there, joint at 0 [rad].
        limits: of a prismatic joint [m].
        span: from where to where it is drawn along x [m].
        diameter: its drawn diameter [m].
        offsets: where it is drawn along y [m], one for each parallel cylinder.
        colour: red, green, blue, opacity.
        mass: of all parallel ones, a slender bar along ``bar`` [kg]; 0: within the links.
        bar: where the bar begins and ends along x [m].
        closes: the link or body on whose pin it ends; None where others end it.
        end: that pin, in the body's own frame [m].
        pin: that pin in the frame of ``closes`` [m].
        positions: of its joint at the poses asked for (n,) [rad, m].
    """

    name: str
    parent: str
    kind: str
    axis: tuple[float, float, float]
    place: tuple[float, float, float]
    turn: tuple[float, float, float]
    limits: tuple[float, float] | None = None
    span: tuple[float, float] = (0.0, 0.0)
    diameter: float = 0.0
    offsets: tuple[float, ...] = ()
    colour: tuple[float, ...] = BARREL
    mass: float = 0.0
    bar: tuple[float, float] = (0.0, 0.0)
    closes: str | None = None
    end: tuple[float, float, float] = (0.0, 0.0, 0.0)
    pin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    positions: Array


@dataclass(frozen=True, eq=False)
class _Directions:
    """Angles and length of a line from a pin, in its link's frame (n + 1,), the reference last."""

    pan: Array
    raise_: Array
    length: Array

    @classmethod
    def in_plane(cls, linkage: Linkage, rigid: RigidPoses, link: str, ends: Array) -> _Directions:
        """In the x–z plane of the link, or as seen across it."""
        x, _, z = _in_frame(linkage, rigid, link, ends)
        return cls(np.zeros_like(x), np.arctan2(z, x), np.hypot(x, z))

    @classmethod
    def in_space(cls, linkage: Linkage, rigid: RigidPoses, link: str, ends: Array) -> _Directions:
        """First about z, then out of the x–y plane."""
        x, y, z = _in_frame(linkage, rigid, link, ends)
        flat = np.hypot(x, y)
        return cls(np.arctan2(y, x), np.arctan2(z, flat), np.hypot(flat, z))


def _in_frame(linkage: Linkage, rigid: RigidPoses, link: str, vector: Array) -> Array:
    """Vectors (n, 3) along the axes of a link (3, n)."""
    rotation = linkage.arm.link_rotation(rigid, link)
    return np.asarray((np.swapaxes(rotation, 1, 2) @ vector[:, :, None])[..., 0].T)


def reference(machine: Machine) -> Array:
    """The pose (nq,) at which all joints of cylinders are 0: the nearest to all joints at 0."""
    return np.asarray(np.clip(np.zeros(len(machine.joints)), *machine.ranges.T))


def _leaves_plane(machine: Machine, linkage: Linkage) -> bool:
    """Whether a cylinder leaves the x–z plane of its link at any pose, not at some alone.

    A place that is analytic in q and lies in a plane at a few poses at random always does.
    """
    middle = reference(machine)
    low, high = np.clip(machine.ranges.T, middle - NEAR, middle + NEAR)
    shares = np.random.default_rng(0).random((PROBES, len(middle)))
    rigid = machine.arm.kinematics(low + shares * (high - low))
    base, end = linkage.ends(rigid)
    across = np.abs(_in_frame(linkage, rigid, linkage.base.link, end - base)[1])
    return bool(np.any(across > PLANE * np.linalg.norm(end - base, axis=1)))


def cylinder_bodies(machine: Machine, q: Array, reference: Array) -> tuple[CylinderBody, ...]:
    """Bodies of all cylinders that can stand at q (n, nq), with the positions of their joints.

    Idle ones too: what is frozen here may move in another program.

    Args:
        machine: the machine.
        q: poses (n, nq) [rad, m].
        reference: the pose (nq,) at which all their joints are 0.

    Raises:
        PoseError: a four-bar does not close.
    """
    rigid = machine.arm.kinematics(np.concatenate([q, reference[None]]))
    refuse_open(machine, rigid)
    bodies: list[CylinderBody] = []
    idle = (pair for pair in machine.idle_cylinders if pair[1].closes(rigid).all())
    for cylinder, linkage in (*zip(machine.cylinders, machine.linkages, strict=True), *idle):
        name = _stem(machine, cylinder.name)
        bodies += _legs(name, cylinder, linkage, rigid)
        bodies += _cylinder(machine, name, cylinder, linkage, rigid)
    return tuple(bodies)


def _stem(machine: Machine, name: str) -> str:
    """Beginning of the names of a cylinder's bodies, which no link and joint has."""
    taken = {*machine.arm.links, *machine.arm.all_joints}
    while taken & {f"{name}_{part}" for part in PARTS}:
        name += "_"
    return name


def _rod_end(name: str, linkage: Linkage) -> tuple[str, tuple[float, float, float]]:
    """Link or body that the rod ends on, and the pin in its frame [m]."""
    if linkage.legs:
        bar, _ = linkage.legs[0]
        return f"{name}_{bar}", (getattr(linkage, bar), 0.0, 0.0)
    pin: Pin = linkage.rod_end_record()["far"]
    return pin.link, pin.at


def _cylinder(
    machine: Machine, name: str, cylinder: Cylinder, linkage: Linkage, rigid: RigidPoses
) -> Iterator[CylinderBody]:
    """Swivel if needed, barrel and rod."""
    base, end = linkage.ends(rigid)
    swivels = _leaves_plane(machine, linkage)
    directions = _Directions.in_space if swivels else _Directions.in_plane
    lines = directions(linkage, rigid, linkage.base.link, end - base)
    outer = float(barrel_outer(cylinder.bore, cylinder.barrel_wall, machine.supply.pressure))
    eye = max(min(0.8 * cylinder.bore, 0.3 * cylinder.dead_length), 0.0)
    middle = (cylinder.count - 1) / 2
    offsets = tuple(APART * outer * (k - middle) for k in range(cylinder.count))
    parent, place = linkage.base.link, linkage.base.at
    if swivels:
        pan = float(lines.pan[-1])
        yield CylinderBody(
            name=f"{name}_swivel",
            parent=parent,
            kind="continuous",
            axis=(0.0, 0.0, 1.0),
            place=place,
            turn=(0.0, 0.0, pan),
            bar=(0.0, cylinder.closed_length),
            positions=_turns(lines.pan),
        )
        parent, place = f"{name}_swivel", (0.0, 0.0, 0.0)
    yield CylinderBody(
        name=f"{name}_barrel",
        parent=parent,
        kind="continuous",
        axis=(0.0, -1.0, 0.0),
        place=place,
        turn=(0.0, -float(lines.raise_[-1]), 0.0),
        span=(eye, cylinder.closed_length - eye),
        diameter=outer,
        offsets=offsets,
        mass=cylinder.moving_masses.get("barrel", 0.0),
        bar=(0.0, cylinder.closed_length),
        positions=_turns(lines.raise_),
    )
    yield _rod(name, cylinder, linkage, lines.length, (eye, offsets))


def _rod(
    name: str,
    cylinder: Cylinder,
    linkage: Linkage,
    lengths: Array,
    drawn: tuple[float, tuple[float, ...]],
) -> CylinderBody:
    """The rod in its barrel; ``drawn``: the length of an eye, and offsets along y [m]."""
    (eye, offsets), first, closed = drawn, float(lengths[-1]), cylinder.closed_length
    target, pin = _rod_end(name, linkage)
    return CylinderBody(
        name=f"{name}_rod",
        parent=f"{name}_barrel",
        kind="prismatic",
        axis=(1.0, 0.0, 0.0),
        place=(first, 0.0, 0.0),
        turn=(0.0, 0.0, 0.0),
        limits=(closed - first, closed + cylinder.stroke - first),
        span=(eye - closed, 0.0),
        diameter=cylinder.rod,
        offsets=offsets,
        colour=ROD,
        mass=cylinder.moving_masses.get("rod", 0.0),
        bar=(-closed, 0.0),
        closes=target,
        pin=pin,
        positions=lengths[:-1] - first,
    )


def _legs(
    name: str, cylinder: Cylinder, linkage: Linkage, rigid: RigidPoses
) -> Iterator[CylinderBody]:
    """Bars that carry the rod end: the first turns about its pin, the others about the rod end.

    They lie in the x–z plane of the first one's link; the others end on their own pins.
    """
    if not linkage.legs:
        return
    (first, pivot), *others = ((bar, _pin(linkage, pin)) for bar, pin in linkage.legs)
    link, end = pivot.link, linkage.ends(rigid)[1]
    along = end - linkage.point(rigid, pivot)
    raised = _Directions.in_plane(linkage, rigid, link, along).raise_
    start, length = _Hinge(link, pivot.at), getattr(linkage, first)
    yield _leg(name, cylinder, (first, length), start, raised)
    for bar, pin in others:
        along = linkage.point(rigid, pin) - end
        bend = _Directions.in_plane(linkage, rigid, link, along).raise_ - raised
        joint, own = _Hinge(f"{name}_{first}", (length, 0.0, 0.0)), getattr(linkage, bar)
        body = _leg(name, cylinder, (bar, own), joint, bend)
        yield replace(body, closes=pin.link, end=(own, 0.0, 0.0), pin=pin.at)


class _Hinge(NamedTuple):
    """Place of a joint in the frame of the link or body that carries it [m]."""

    parent: str
    place: tuple[float, float, float]


def _leg(
    name: str, cylinder: Cylinder, bar: tuple[str, float], joint: _Hinge, angles: Array
) -> CylinderBody:
    """A bar by its name and length [m], turned by angles (n + 1,), the reference last."""
    part, length = bar
    return CylinderBody(
        name=f"{name}_{part}",
        parent=joint.parent,
        kind="continuous",
        axis=(0.0, -1.0, 0.0),
        place=joint.place,
        turn=(0.0, -float(angles[-1]), 0.0),
        span=(0.0, length),
        diameter=0.6 * cylinder.bore,
        offsets=(0.0,),
        colour=BAR,
        mass=cylinder.moving_masses.get(part, 0.0),
        bar=(0.0, length),
        positions=_turns(angles),
    )


def _pin(linkage: Linkage, name: str) -> Pin:
    pin: Pin = getattr(linkage, name)
    return pin


def _turns(angles: Array) -> Array:
    """Angles from the last one, which is the reference, within half a turn of it."""
    away = angles[:-1] - angles[-1]
    return np.asarray(np.arctan2(np.sin(away), np.cos(away)))
