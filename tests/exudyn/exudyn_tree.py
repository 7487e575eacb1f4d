"""A URDF and the pins of a machine file as a kinematic tree: the geometry of the independent
check.

Written against the files' own texts, without the package's arm and linkages. Every moving joint
turns or slides its link along that link's z axis, fixed and frozen joints weld; the bars of
four-bars and the cylinders' own halves, where they weigh, are more links.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field

import numpy as np

from armdesign import Machine
from armdesign.hydraulics.actuator import Cylinder
from armdesign.mechanism.linkage.base import Linkage, Pin
from armdesign.mechanism.linkage.direct import Direct
from armdesign.mechanism.linkage.four_bar import FourBar

Array = np.ndarray
GROUND = -1
ACROSS = np.array([0.0, -1.0, 0.0])  # the axis about which bars turn, in the world


def rotation_about(axis: Array, angle: float) -> Array:
    """Rotation matrix of an angle [rad] about a unit vector (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross


def z_onto(axis: Array) -> Array:
    """A rotation matrix that turns the z axis onto a unit vector."""
    side = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    side /= np.linalg.norm(side)
    return np.column_stack([side, np.cross(axis, side), axis])


@dataclass(frozen=True)
class Placement:
    """A frame in another: x_other = rotation x + offset."""

    rotation: Array = field(default_factory=lambda: np.eye(3))
    offset: Array = field(default_factory=lambda: np.zeros(3))

    def __matmul__(self, inner: Placement) -> Placement:
        return Placement(self.rotation @ inner.rotation, self.point(inner.offset))

    def point(self, at: Array) -> Array:
        return self.rotation @ np.asarray(at) + self.offset

    def inverse(self) -> Placement:
        return Placement(self.rotation.T, -self.rotation.T @ self.offset)


def shift(offset: Array) -> Placement:
    return Placement(offset=np.asarray(offset))


@dataclass
class Body:
    """A link of the tree and everything rigid on it: mass, centre of mass, inertia about that, in
    the link's frame.
    """

    kind: str
    parent: int
    joint: Placement
    mass: float = 0.0
    com: Array = field(default_factory=lambda: np.zeros(3))
    inertia: Array = field(default_factory=lambda: np.zeros((3, 3)))

    def add(self, mass: float, com: Array, inertia: Array) -> None:
        """Put one more mass on the link (parallel axes)."""
        total = self.mass + mass
        if total == 0:
            return
        middle = (self.mass * self.com + mass * com) / total
        self.inertia = self.inertia + inertia
        for m, at in ((self.mass, self.com - middle), (mass, com - middle)):
            self.inertia = self.inertia + m * (at @ at * np.eye(3) - np.outer(at, at))
        self.mass, self.com = total, middle

    def add_bar(self, mass: float, start: Array, end: Array) -> None:
        """Put a uniform slender bar on the link."""
        along = end - start
        self.add(
            mass,
            (start + end) / 2,
            mass / 12 * (along @ along * np.eye(3) - np.outer(along, along)),
        )


Seat = tuple[int, Array]  # a link of the tree and a point in it [m]


class Tree:
    """A URDF at a pose as links of a kinematic tree, with the machine's moving bars as further
    links.

    Every joint turns or slides its link along that link's z axis; the joints of the bars stand at
    0 in the pose. Bars move in the world's x–z plane. ``rod_ends`` are the seats that the
    cylinders push; ``loops`` must be kept together, ``struts`` at a distance [m].
    """

    def __init__(self, machine: Machine, q: Array) -> None:
        self.machine = machine
        self._q = dict(zip(machine.joints, q, strict=True))
        self._q |= {spring.joint: spring.at for spring in machine.springs}
        self.bodies: list[Body] = []
        self.names: list[str] = []
        # URDF link → link of the tree and its place there
        self.places: dict[str, tuple[int, Placement]] = {}
        self.loops: list[tuple[Seat, Seat]] = []
        self.struts: list[tuple[Seat, Seat, float]] = []
        robot = ET.fromstring(machine.urdf_text)
        joints = robot.findall("joint")
        children = {joint.find("child").get("link") for joint in joints}
        links = {link.get("name"): link for link in robot.findall("link")}
        root = next(name for name in links if name not in children)
        self._place(root, links, joints, GROUND, Placement())
        payload = machine.payload
        if payload.mass > 0:
            carrier, at = self.seat(Pin(link=payload.link, at=payload.at))
            self.bodies[carrier].add(payload.mass, at, np.zeros((3, 3)))
        self.rod_ends = [
            self._rod_end(*pair) for pair in zip(machine.cylinders, machine.linkages, strict=True)
        ]

    def _place(self, name: str, links: dict, joints: list, carrier: int, place: Placement) -> None:
        self.places[name] = (carrier, place)
        inertial = links[name].find("inertial")
        if inertial is not None and carrier != GROUND:
            self.bodies[carrier].add(*_mass_properties(inertial, place))
        for joint in joints:
            if joint.find("parent").get("link") == name:
                self._place(
                    joint.find("child").get("link"),
                    links,
                    joints,
                    *self._behind(joint, carrier, place),
                )

    def _behind(self, joint: ET.Element, carrier: int, place: Placement) -> tuple[int, Placement]:
        """Where the child link of a joint finds itself."""
        origin, axis = place @ _origin(joint), _axis(joint)
        name, slides = joint.get("name"), joint.get("type") == "prismatic"
        if name in self._q:
            return self._hang(name, "PrismaticZ" if slides else "RevoluteZ", carrier, origin, axis)
        value = 0.0 if joint.get("type") == "fixed" else self.machine.section.frozen.get(name, 0.0)
        return carrier, origin @ (
            shift(value * axis) if slides else Placement(rotation_about(axis, value))
        )

    def _hang(
        self, name: str, kind: str, carrier: int, origin: Placement, axis: Array
    ) -> tuple[int, Placement]:
        """Add a link that moves along or about an axis of its joint frame; where that frame is in
        it.
        """
        align = Placement(z_onto(axis))
        self.names.append(name)
        self.bodies.append(Body(kind, carrier, origin @ align))
        return len(self.bodies) - 1, Placement(align.rotation.T)

    def seat(self, pin: Pin) -> Seat:
        """Where a pin sits: the link of the tree and the point in it."""
        carrier, place = self.places[pin.link]
        return carrier, place.point(pin.at)

    def _frame(self, carrier: int) -> Placement:
        """A link of the tree in the world."""
        if carrier == GROUND:
            return Placement()
        body, value = self.bodies[carrier], self._q.get(self.names[carrier], 0.0)
        axis = np.eye(3)[2]
        moved = (
            Placement(rotation_about(axis, value))
            if body.kind == "RevoluteZ"
            else shift(value * axis)
        )
        return self._frame(body.parent) @ body.joint @ moved

    def _world(self, seat: Seat) -> Array:
        return self._frame(seat[0]).point(seat[1])

    def _rod_end(self, cylinder: Cylinder, linkage: Linkage) -> Seat:
        """What the cylinder pushes; the bars between its pins are hung."""
        base = self.seat(linkage.base)
        if isinstance(linkage, FourBar):
            end = self._knee(linkage, cylinder)
        else:
            assert isinstance(linkage, Direct)
            end = self.seat(linkage.rod_end)
        masses = cylinder.moving_masses
        if "barrel" in masses:
            way = self._world(end) - self._world(base)
            closed = cylinder.closed_length * way / np.linalg.norm(way)
            barrel, along = self._bar("barrel", base, closed, masses["barrel"])
            far = along / np.linalg.norm(along)
            rod, turned = self._hang(
                "rod", "PrismaticZ", barrel, shift(np.linalg.norm(way) * far), far
            )
            self.bodies[rod].add_bar(masses["rod"], np.zeros(3), -turned.point(along))
            self.loops.append(((rod, np.zeros(3)), end))
        return end

    def _knee(self, bars: FourBar, cylinder: Cylinder) -> Seat:
        pivot, lug = self.seat(bars.pivot), self.seat(bars.lug)
        side = self._world(lug) - self._world(pivot)
        rocker = _third_corner(side, bars.rocker, bars.coupler, bars.side)
        knee = self._bar("rocker", pivot, rocker, cylinder.masses["rocker"])
        if (coupler := cylinder.masses["coupler"]) > 0:
            self.loops.append((self._bar("coupler", knee, side - rocker, coupler), lug))
        else:
            self.struts.append((knee, lug, bars.coupler))
        return knee

    def _bar(self, name: str, start: Seat, way: Array, mass: float) -> Seat:
        """Hang a bar by a hinge at its start; ``way`` leads to its end in the world.

        The seat of its end.
        """
        into = self._frame(start[0]).rotation.T
        link, turned = self._hang(name, "RevoluteZ", start[0], shift(start[1]), into @ ACROSS)
        end = turned.point(into @ way)
        self.bodies[link].add_bar(mass, np.zeros(3), end)
        return link, end


def _third_corner(side: Array, near: float, far: float, left: int) -> Array:
    """Third corner of a triangle in the x–z plane on a side from the origin, at two distances from
    its ends.
    """
    length = np.linalg.norm(side)
    along = side / length
    foot = (length**2 + near**2 - far**2) / (2 * length)
    across = np.array([-along[2], 0, along[0]])
    return foot * along + left * math.sqrt(near**2 - foot**2) * across


def _floats(element: ET.Element | None, key: str, default: str) -> Array:
    return np.array(
        [float(x) for x in (default if element is None else element.get(key, default)).split()]
    )


def _axis(joint: ET.Element) -> Array:
    axis = _floats(joint.find("axis"), "xyz", "1 0 0")
    return axis / np.linalg.norm(axis)


def _origin(element: ET.Element) -> Placement:
    origin = element.find("origin")
    roll, pitch, yaw = _floats(origin, "rpy", "0 0 0")
    turns = [
        rotation_about(np.eye(3)[axis], angle) for axis, angle in ((2, yaw), (1, pitch), (0, roll))
    ]
    return Placement(turns[0] @ turns[1] @ turns[2], _floats(origin, "xyz", "0 0 0"))


def _mass_properties(inertial: ET.Element, place: Placement) -> tuple[float, Array, Array]:
    frame, entries = place @ _origin(inertial), inertial.find("inertia")
    xx, xy, xz, yy, yz, zz = (
        float(entries.get(key)) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    )
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    mass = float(inertial.find("mass").get("value"))
    return mass, frame.offset, frame.rotation @ tensor @ frame.rotation.T
