"""Reading a URDF: XML in, joints and links out.

Everything is checked, by name, before Pinocchio sees it (``urdf_faults``). What is not a
coordinate becomes fixed at its frozen value and continuous joints become revolute, so that every
joint left has one number.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from armdesign.arrays import Array, ReadOnly
from armdesign.mechanism.spring import Spring
from armdesign.mechanism.urdf_faults import faults_of, movable_joints, numbers, parse
from armdesign.units import deg, mm

_DEFAULTS = {  # numbers that Pinocchio reads, by element and attribute
    "origin": {"xyz": "0 0 0", "rpy": "0 0 0"},
    "axis": {"xyz": "1 0 0"},
    "limit": {"lower": "0", "upper": "0", "effort": "0", "velocity": "0"},
    "mass": {"value": ""},
    "inertia": dict.fromkeys(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), ""),
}


@dataclass(frozen=True)
class Joint(ReadOnly):
    """One coordinate of the arm."""

    name: str
    revolute: bool  # else prismatic
    parent: int  # index of the joint before it; −1: the root
    rotation: Array  # (3, 3) joint frame in the frame of the joint before it
    translation: Array  # (3,) [m]
    axis: Array  # (3,) unit vector in the joint frame
    lower: float  # [rad] or [m]
    upper: float

    @property
    def unit(self) -> str:
        """Unit of its position: "rad" or "m"."""
        return "rad" if self.revolute else "m"

    @property
    def file_unit(self) -> tuple[str, float]:
        """Unit of its position in files, "deg" or "mm", and what one is [rad, m]."""
        return ("deg", deg) if self.revolute else ("mm", mm)

    @property
    def endless(self) -> bool:
        """Whether it may turn all around: what lies beyond its limits is a pose within them."""
        return self.revolute and self.upper - self.lower > 2 * math.pi - 1e-6

    @property
    def without_ends(self) -> bool:
        """Whether it has just one turn, as a continuous joint: it never comes to an end of it."""
        return self.endless and self.upper - self.lower < 2 * math.pi + 1e-6

    @cached_property
    def _turning(self) -> Array:
        return turning(self.axis, self.rotation)

    def turned_by(self, q: Array) -> Array:
        """Its frame in the frame of the joint before it (n, 3, 3) at positions (n,) [rad, m]."""
        return rotated(self._turning, q if self.revolute else np.zeros(len(q)))


@dataclass(frozen=True)
class Frozen(ReadOnly):
    """A joint that could move but does not, in the frame of the joint that carries it."""

    name: str
    revolute: bool  # else prismatic
    at: float  # [rad] or [m]
    axis: Array  # (3,) unit vector
    place: Array = field(default_factory=lambda: np.zeros(3))  # a point of its axis [m]


@dataclass(frozen=True)
class Link(ReadOnly):
    """A link: the joint that carries it, and its frame in the frame of that joint."""

    name: str
    joint: int  # −1: the root
    rotation: Array  # (3, 3)
    translation: Array  # (3,) [m]
    frozen: tuple[Frozen, ...] = ()  # between root and link, from the root out


def read_urdf(
    text: str,
    joints: Sequence[str],
    frozen: Mapping[str, float],
    source: str,
    springs: Sequence[Spring] = (),
    checked: bool = False,
) -> tuple[str, tuple[Joint, ...], dict[str, Link]]:
    """Reduced URDF text, the coordinates' joints, springs last, and every link, the root first.

    Args:
        text: the URDF.
        joints: names of the joints of poses, in the order of q.
        frozen: value of other joints [rad or m]; 0 where none is given.
        source: file name for messages.
        springs: passive joints, coordinates after the others.
        checked: whether it is known to have no fault.

    Raises:
        MachineFileError: XML, link, joint or inertia that cannot be used.
    """
    robot = parse(text, source)
    for fault in () if checked else faults_of(robot, joints, frozen, source, springs):
        raise fault
    joints = [*joints, *(spring.joint for spring in springs)]
    movable, standing = set(movable_joints(robot)).difference(joints), dict[str, Frozen]()
    for joint in robot.findall("joint"):
        name = str(joint.get("name"))
        if name in movable:
            revolute, at = joint.get("type") != "prismatic", frozen.get(name, 0.0)
            standing[name] = Frozen(name, revolute, at, _axis(joint))
            _fix(joint, at)
        elif joint.get("type") == "continuous":
            _give_one_turn(joint)
    _write_plainly(robot)
    moving, links = _tree(robot, joints, standing)
    return ET.tostring(robot, encoding="unicode"), moving, links


def rotations(axis: Array, angle: Array) -> Array:
    """Rotation matrices (n, 3, 3) about a unit axis."""
    return rotated(turning(axis, np.eye(3)), angle)


def turning(axis: Array, before: Array) -> Array:
    """Parts (3, 9) of rotations about a unit axis, after ``before`` (3, 3): 1, K and K²."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.stack([before, before @ cross, before @ cross @ cross]).reshape(3, 9)


def rotated(parts: Array, angle: Array) -> Array:
    """Rotation matrices (n, 3, 3): 1 + K sin φ + K² (1 − cos φ) by angles (n,), parts (3, 9)."""
    n = len(angle)
    factors = np.zeros((max(n, 2), 3), np.result_type(angle, float))  # BLAS rounds one row apart
    factors[:n, 0], factors[:n, 1], factors[:n, 2] = 1.0, np.sin(angle), 1 - np.cos(angle)
    return np.asarray(factors @ parts)[:n].reshape(-1, 3, 3)


def roll_pitch_yaw(rotation: Array) -> Array:
    """Angles (3,) [rad] about x, then y, then z, of a rotation matrix (3, 3), as in ``rpy``."""
    roll = math.atan2(rotation[2, 1], rotation[2, 2])
    pitch = math.atan2(-rotation[2, 0], math.hypot(rotation[0, 0], rotation[1, 0]))
    yaw = math.atan2(rotation[1, 0], rotation[0, 0])
    return np.array([roll, pitch, yaw])


def of_roll_pitch_yaw(roll: float, pitch: float, yaw: float) -> Array:
    """Rotation matrix (3, 3) of angles [rad] about x, then y, then z, as in ``rpy``."""
    a, b, c = math.cos(roll), math.cos(pitch), math.cos(yaw)
    d, e, f = math.sin(roll), math.sin(pitch), math.sin(yaw)
    return np.array(
        [
            [b * c, d * e * c - a * f, a * e * c + d * f],
            [b * f, d * e * f + a * c, a * e * f - d * c],
            [-e, d * b, a * b],
        ]
    )


def turned(rotation: Array, vector: Array) -> Array:
    """A vector (3,), or one for each row (n, 3), turned by rotation matrices (n, 3, 3): (n, 3)."""
    if vector.ndim > 1:
        return np.asarray((rotation @ vector[:, :, None])[..., 0])
    return np.asarray(rotation.reshape(-1, 3) @ vector).reshape(-1, 3)


def origin(element: ET.Element) -> tuple[Array, Array]:
    """Rotation (3, 3) and translation (3,) [m] of an element's frame."""
    origin = element.find("origin")
    turn = of_roll_pitch_yaw(*numbers(origin, "rpy", "0 0 0"))
    return turn, numbers(origin, "xyz", "0 0 0")


def _axis(joint: ET.Element) -> Array:
    axis = numbers(joint.find("axis"), "xyz", "1 0 0")
    return axis / float(np.linalg.norm(axis))


def _bounds(joint: ET.Element) -> tuple[float, float]:
    limit = joint.find("limit")
    lower, upper = (float(numbers(limit, key, "0")[0]) for key in ("lower", "upper"))
    return lower, upper


def _give_one_turn(joint: ET.Element) -> None:
    """Make a continuous joint a revolute one with limits of one turn."""
    joint.set("type", "revolute")
    for old in joint.findall("limit"):
        joint.remove(old)
    ET.SubElement(joint, "limit", lower=str(-math.pi), upper=str(math.pi))


def _fix(joint: ET.Element, value: float) -> None:
    """Make a joint fixed at a value [rad or m]."""
    rotation, translation = origin(joint)
    if joint.get("type") == "prismatic":
        translation = translation + rotation @ _axis(joint) * value
    else:
        rotation = rotation @ rotations(_axis(joint), np.array([value]))[0]
    for tag in ("origin", "axis", "limit"):
        for element in joint.findall(tag):
            joint.remove(element)
    turn = attribute(roll_pitch_yaw(rotation))
    ET.SubElement(joint, "origin", xyz=attribute(translation), rpy=turn)
    joint.set("type", "fixed")


def _write_plainly(robot: ET.Element) -> None:
    """Numbers as Pinocchio's parser reads them: it drops a body whose numbers it cannot read."""
    for element in robot.iter():
        for key, default in _DEFAULTS.get(element.tag, {}).items():
            element.set(key, attribute(numbers(element, key, default)))


def attribute(values: Iterable[float]) -> str:
    """Numbers as attributes have them, exact."""
    return " ".join(repr(float(x)) for x in values)


def _tree(
    robot: ET.Element, joints: list[str], standing: Mapping[str, Frozen]
) -> tuple[tuple[Joint, ...], dict[str, Link]]:
    """The moving joints in the order of q, and every link, on a walk from the root outwards."""
    names = [str(link.get("name")) for link in robot.findall("link")]
    children: dict[str, list[tuple[ET.Element, str]]] = {name: [] for name in names}
    carried = set()
    for joint in robot.findall("joint"):
        ends = (joint.find(tag) for tag in ("parent", "child"))
        parent, child = ("" if end is None else end.get("link", "") for end in ends)
        children[parent].append((joint, child))
        carried.add(child)
    moving: dict[str, Joint] = {}
    root = next(name for name in children if name not in carried)
    links = {root: Link(root, -1, np.eye(3), np.zeros(3))}
    waiting = [links[root]]
    while waiting:
        before = waiting.pop(0)
        for element, child in children[before.name]:
            rotation, translation = origin(element)
            translation = before.translation + before.rotation @ translation
            rotation = before.rotation @ rotation
            name, index, frozen = str(element.get("name")), before.joint, before.frozen
            if name in standing:
                axis = rotation @ standing[name].axis
                frozen = (*frozen, replace(standing[name], axis=axis, place=translation))
            if element.get("type") != "fixed":
                frame = (rotation, translation, _axis(element))
                revolute = element.get("type") == "revolute"
                moving[name] = Joint(name, revolute, index, *frame, *_bounds(element))
                index, rotation, translation = joints.index(name), np.eye(3), np.zeros(3)
            links[child] = Link(child, index, rotation, translation, frozen)
            waiting.append(links[child])
    return tuple(moving[name] for name in joints), links
