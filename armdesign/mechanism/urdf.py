"""Reading a URDF: XML in, joints and links out.

Everything is checked, by name, before Pinocchio sees it (``urdf_faults``). What is not a
coordinate becomes fixed at its frozen value and continuous joints become revolute, so that every
joint left has one number.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass

import numpy as np

from armdesign.arrays import Array
from armdesign.mechanism.urdf_faults import faults_of, movable_joints, numbers, parse

_DEFAULTS = {  # numbers that Pinocchio reads, by element and attribute
    "origin": {"xyz": "0 0 0", "rpy": "0 0 0"},
    "axis": {"xyz": "1 0 0"},
    "limit": {"lower": "0", "upper": "0", "effort": "0", "velocity": "0"},
    "mass": {"value": ""},
    "inertia": dict.fromkeys(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), ""),
}


@dataclass(frozen=True)
class Joint:
    """One coordinate of the arm: ``parent`` is the index of the joint before it, −1 for the root."""

    name: str
    revolute: bool
    parent: int
    rotation: Array  # (3, 3) joint frame in the frame of the joint before it
    translation: Array  # (3,) [m]
    axis: Array  # (3,) unit vector in the joint frame
    lower: float  # [rad] or [m]
    upper: float

    @property
    def unit(self) -> str:
        """Unit of its position: "rad" or "m"."""
        return "rad" if self.revolute else "m"


@dataclass(frozen=True)
class Link:
    """A link rides on a joint (−1: the root): its frame in that joint's frame.

    ``frozen`` names the joints between root and link that could move but do not.
    """

    name: str
    joint: int
    rotation: Array
    translation: Array
    frozen: tuple[str, ...] = ()


def read_urdf(
    text: str, joints: list[str], frozen: dict[str, float], source: str
) -> tuple[str, tuple[Joint, ...], dict[str, Link]]:
    """Reduced URDF text, the joints in the order asked for, and every link (the root first).

    Args:
        text: the URDF.
        joints: names of the coordinates, in the order of q.
        frozen: value of other joints [rad or m]; 0 where none is given.
        source: file name for messages.

    Raises:
        MachineFileError: XML, link, joint or inertia that cannot be used.
    """
    robot = parse(text, source)
    for fault in faults_of(robot, joints, frozen, source):
        raise fault
    still = [name for name in movable_joints(robot) if name not in joints]
    for joint in robot.findall("joint"):
        name = str(joint.get("name"))
        if name in still:
            _fix(joint, frozen.get(name, 0.0))
        elif joint.get("type") != "fixed":
            _limit(joint)
    _write_plainly(robot)
    moving, links = _tree(robot, joints, still)
    return ET.tostring(robot, encoding="unicode"), moving, links


def rotations(axis: Array, angle: Array) -> Array:
    """Rotation matrices (n, 3, 3) about a unit axis (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    sine, versine = np.sin(angle)[:, None, None], (1 - np.cos(angle))[:, None, None]
    return np.asarray(np.eye(3) + sine * cross + versine * (cross @ cross))


def _origin(element: ET.Element) -> tuple[Array, Array]:
    origin = element.find("origin")
    roll, pitch, yaw = numbers(origin, "rpy", "0 0 0")
    turn = [rotations(np.eye(3)[i], np.array([a]))[0] for i, a in enumerate((roll, pitch, yaw))]
    return turn[2] @ turn[1] @ turn[0], numbers(origin, "xyz", "0 0 0")


def _axis(joint: ET.Element) -> Array:
    axis = numbers(joint.find("axis"), "xyz", "1 0 0")
    return axis / float(np.linalg.norm(axis))


def _bounds(joint: ET.Element) -> tuple[float, float]:
    limit = joint.find("limit")
    lower, upper = (float(numbers(limit, key, "0")[0]) for key in ("lower", "upper"))
    return lower, upper


def _limit(joint: ET.Element) -> None:
    """Give a continuous joint one turn."""
    if joint.get("type") == "continuous":
        joint.set("type", "revolute")
        for old in joint.findall("limit"):
            joint.remove(old)
        ET.SubElement(joint, "limit", lower=str(-math.pi), upper=str(math.pi))


def _fix(joint: ET.Element, value: float) -> None:
    """Make a joint fixed at a value [rad or m]."""
    rotation, translation = _origin(joint)
    if joint.get("type") == "prismatic":
        translation = translation + rotation @ _axis(joint) * value
    else:
        rotation = rotation @ rotations(_axis(joint), np.array([value]))[0]
    roll = math.atan2(rotation[2, 1], rotation[2, 2])
    pitch = math.atan2(-rotation[2, 0], math.hypot(rotation[0, 0], rotation[1, 0]))
    yaw = math.atan2(rotation[1, 0], rotation[0, 0])
    for tag in ("origin", "axis", "limit"):
        for element in joint.findall(tag):
            joint.remove(element)
    ET.SubElement(
        joint, "origin", xyz=_words(translation), rpy=_words(np.array([roll, pitch, yaw]))
    )
    joint.set("type", "fixed")


def _write_plainly(robot: ET.Element) -> None:
    """Numbers as Pinocchio's parser reads them: it drops a body whose numbers it cannot read."""
    for element in robot.iter():
        for key, default in _DEFAULTS.get(element.tag, {}).items():
            element.set(key, _words(numbers(element, key, default)))


def _words(values: Array) -> str:
    return " ".join(repr(float(x)) for x in values)


def _tree(
    robot: ET.Element, joints: list[str], still: list[str]
) -> tuple[tuple[Joint, ...], dict[str, Link]]:
    """Walk from the root: the moving joints in the order of q, and every link with the joint that carries it."""
    children: dict[str, list[tuple[ET.Element, str]]] = {
        str(link.get("name")): [] for link in robot.findall("link")
    }
    carried = set()
    for joint in robot.findall("joint"):
        parent, child = (
            element.get("link", "")
            for tag in ("parent", "child")
            for element in joint.findall(tag)[:1]
        )
        children[parent].append((joint, child))
        carried.add(child)
    moving: dict[str, Joint] = {}
    root = next(name for name in children if name not in carried)
    links = {root: Link(root, -1, np.eye(3), np.zeros(3))}
    waiting = [links[root]]
    while waiting:
        before = waiting.pop(0)
        for element, child in children[before.name]:
            rotation, translation = _origin(element)
            translation = before.translation + before.rotation @ translation
            rotation = before.rotation @ rotation
            name, index = str(element.get("name")), before.joint
            if element.get("type") != "fixed":
                revolute = element.get("type") == "revolute"
                ends = _bounds(element)
                moving[name] = Joint(
                    name, revolute, index, rotation, translation, _axis(element), *ends
                )
                index, rotation, translation = joints.index(name), np.eye(3), np.zeros(3)
            frozen = (*before.frozen, name) if name in still else before.frozen
            links[child] = Link(child, index, rotation, translation, frozen)
            waiting.append(links[child])
    return tuple(moving[name] for name in joints), links
