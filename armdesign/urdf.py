"""Reading a URDF: XML in, checked joints and links out.

Everything is checked here, by name, before Pinocchio sees it. What is not a coordinate becomes fixed at its frozen
value and continuous joints become revolute, so that every joint left has one number.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass

import numpy as np

from armdesign.arrays import Array
from armdesign.errors import MachineFileError

_MOVING = ("revolute", "continuous", "prismatic")


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


@dataclass(frozen=True)
class Link:
    """A link rides on a joint (−1: the root): its frame in that joint's frame."""

    name: str
    joint: int
    rotation: Array
    translation: Array


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
    robot = _parse(text, source)
    _bake(robot, joints, frozen, source)
    moving, links = _tree(robot, joints, source)
    return ET.tostring(robot, encoding="unicode"), moving, links


def problems(text: str, joints: list[str], frozen: dict[str, float], source: str) -> list[MachineFileError]:
    """Every fault of single joints and links; where there is none, the first of the tree that they make.

    Args:
        text: the URDF.
        joints: names of the coordinates.
        frozen: value of other joints [rad or m].
        source: file name for messages.
    """
    try:
        robot = _parse(text, source)
    except MachineFileError as error:
        return [error]
    found: list[MachineFileError] = []
    for joint in robot.findall("joint"):
        name = str(joint.get("name"))
        try:
            _bake_joint(joint, name in joints, frozen.get(name), f"{source}: joint {name}")
        except MachineFileError as error:
            found.append(error)
    for link in robot.findall("link"):
        try:
            _check_inertial(link, f"{source}: link {link.get('name')}")
        except MachineFileError as error:
            found.append(error)
    if not found:
        try:
            read_urdf(text, joints, frozen, source)
        except MachineFileError as error:
            found.append(error)
    return found


def rotations(axis: Array, angle: Array) -> Array:
    """Rotation matrices (n, 3, 3) about a unit axis (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    sine, versine = np.sin(angle)[:, None, None], (1 - np.cos(angle))[:, None, None]
    return np.asarray(np.eye(3) + sine * cross + versine * (cross @ cross))


def _parse(urdf: str, source: str) -> ET.Element:
    try:
        robot = ET.fromstring(urdf)
    except ET.ParseError as error:
        raise MachineFileError(source, f"not well-formed XML ({error})", "correct the URDF at that place") from None
    if robot.tag != "robot":
        tag = robot.tag.replace("{", "").replace("}", " ")  # a namespace is in braces
        raise MachineFileError(source, f"the XML root is <{tag}>, not <robot>", "give a URDF file")
    robot.attrib = {"name": "arm"}
    _keep_only(robot, "link", "joint")
    for link in robot.findall("link"):
        _keep_only(link, "inertial")
    for joint in robot.findall("joint"):
        _keep_only(joint, "parent", "child", "origin", "axis", "limit", "mimic")
    for kind in ("link", "joint"):
        seen: set[str] = set()
        for element in robot.findall(kind):
            name = element.get("name")
            if not name:
                raise MachineFileError(source, f"a {kind} has no name", f'write <{kind} name="…">')
            if name in seen:
                raise MachineFileError(source, f'two {kind}s are named "{name}"', "rename one")
            seen.add(name)
    return robot


def _keep_only(element: ET.Element, *tags: str) -> None:
    for part in [*element]:
        if part.tag not in tags:
            element.remove(part)


def _numbers(element: ET.Element | None, key: str, default: str, count: int, where: str) -> Array:
    """Numbers of an attribute, written back plainly: Pinocchio's parser drops a body whose numbers it cannot read."""
    text = default if element is None else element.get(key, default)
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        values = np.array([math.nan])
    if len(values) != count or not np.all(np.isfinite(values)) or np.any(np.abs(values) > 1e9):
        raise MachineFileError(where, f'{key}="{text}" is not {count} finite number(s)', "correct the URDF")
    if element is not None:
        element.set(key, " ".join(repr(float(x)) for x in values))
    return values


def _origin(element: ET.Element, where: str) -> tuple[Array, Array]:
    origin = element.find("origin")
    roll, pitch, yaw = _numbers(origin, "rpy", "0 0 0", 3, where)
    turn = [rotations(np.eye(3)[i], np.array([a]))[0] for i, a in enumerate((roll, pitch, yaw))]
    return turn[2] @ turn[1] @ turn[0], _numbers(origin, "xyz", "0 0 0", 3, where)


def _axis(joint: ET.Element, where: str) -> Array:
    axis = _numbers(joint.find("axis"), "xyz", "1 0 0", 3, where)
    norm = float(np.linalg.norm(axis))
    if norm < 1e-6:
        raise MachineFileError(where, "the axis has no length", 'give a direction such as xyz="0 -1 0"')
    return axis / norm


def _bake(robot: ET.Element, joints: list[str], frozen: dict[str, float], source: str) -> None:
    """Fix the frozen joints at their values, make continuous ones revolute, check what is left."""
    present = {str(joint.get("name")): joint for joint in robot.findall("joint")}
    for name in [*joints, *frozen]:
        if name not in present:
            raise MachineFileError(
                f"{source}: joint {name}",
                "is not in the URDF",
                f"choose from: {', '.join(present) or 'none'}",
            )
    for name, joint in present.items():
        _bake_joint(joint, name in joints, frozen.get(name), f"{source}: joint {name}")
    for link in robot.findall("link"):
        _check_inertial(link, f"{source}: link {link.get('name')}")


def _bake_joint(joint: ET.Element, moves: bool, frozen: float | None, where: str) -> None:
    kind = joint.get("type")
    if kind not in (*_MOVING, "fixed"):
        raise MachineFileError(where, f'type "{kind}" cannot be used', "use revolute, continuous, prismatic or fixed")
    if joint.find("mimic") is not None:
        raise MachineFileError(where, "mimics another joint", "make it a joint of its own or fix it")
    if moves:
        if kind == "fixed":
            raise MachineFileError(where, "is fixed and cannot be a coordinate", "take it out of joints")
        _check_limits(joint, where)
    elif kind != "fixed":
        _fix(joint, frozen or 0.0, where)
    elif frozen is not None:
        raise MachineFileError(where, "is fixed in the URDF and cannot be frozen", "take it out of frozen")


def _check_limits(joint: ET.Element, where: str) -> None:
    if joint.get("type") == "continuous":
        joint.set("type", "revolute")
        for old in joint.findall("limit"):
            joint.remove(old)
        ET.SubElement(joint, "limit", lower=str(-math.pi), upper=str(math.pi), effort="0", velocity="0")
    limit = joint.find("limit")
    if limit is None:
        raise MachineFileError(where, "has no <limit>", 'add <limit lower="…" upper="…" effort="…" velocity="…"/>')
    lower = float(_numbers(limit, "lower", "0", 1, where)[0])
    upper = float(_numbers(limit, "upper", "0", 1, where)[0])
    if not lower < upper:
        raise MachineFileError(where, f"limits [{lower:g}, {upper:g}] are empty", "lower must be below upper")
    for key in ("effort", "velocity"):
        value = float(_numbers(limit, key, "0", 1, where)[0])
        if value < 0:
            raise MachineFileError(where, f"{key} {value:g} is negative", f"give a limit with {key} ≥ 0")
        limit.set(key, str(value))


def _fix(joint: ET.Element, value: float, where: str) -> None:
    if joint.get("type") != "continuous" and (limit := joint.find("limit")) is not None:
        lower, upper = (float(_numbers(limit, key, "0", 1, where)[0]) for key in ("lower", "upper"))
        if not lower <= value <= upper:
            raise MachineFileError(
                where, f"is frozen at {value:g}, outside its limits [{lower:g}, {upper:g}]", "give frozen another value"
            )
    rotation, translation = _origin(joint, where)
    axis = _axis(joint, where)
    if joint.get("type") == "prismatic":
        translation = translation + rotation @ axis * value
    else:
        rotation = rotation @ rotations(axis, np.array([value]))[0]
    roll = math.atan2(rotation[2, 1], rotation[2, 2])
    pitch = math.atan2(-rotation[2, 0], math.hypot(rotation[0, 0], rotation[1, 0]))
    yaw = math.atan2(rotation[1, 0], rotation[0, 0])
    for tag in ("origin", "axis", "limit"):
        for element in joint.findall(tag):
            joint.remove(element)
    words = {"xyz": translation, "rpy": np.array([roll, pitch, yaw])}
    ET.SubElement(joint, "origin", {key: " ".join(repr(float(x)) for x in value) for key, value in words.items()})
    joint.set("type", "fixed")


def _check_inertial(link: ET.Element, where: str) -> None:
    inertial = link.find("inertial")
    if inertial is None:
        return
    _origin(inertial, where)
    if inertial.find("mass") is None or inertial.find("inertia") is None:
        raise MachineFileError(where, "<inertial> lacks <mass> or <inertia>", "give both, or no <inertial>")
    mass = float(_numbers(inertial.find("mass"), "value", "nan", 1, where)[0])
    if mass < 0:
        raise MachineFileError(where, f"mass {mass:g} kg is negative", "give a mass ≥ 0 kg")
    xx, yy, zz, xy, xz, yz = (
        float(_numbers(inertial.find("inertia"), key, "nan", 1, where)[0])
        for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    )
    principal = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    slack = 1e-6 * float(np.abs(principal).max()) + 1e-12
    if principal[0] < -slack or principal[2] > principal[0] + principal[1] + slack:
        raise MachineFileError(
            where,
            f"no body has principal inertias {principal[0]:g}, {principal[1]:g}, {principal[2]:g} kg m²",
            "each must be ≥ 0 and at most the sum of the other two",
        )


def _tree(robot: ET.Element, joints: list[str], source: str) -> tuple[tuple[Joint, ...], dict[str, Link]]:
    """Walk from the root: the moving joints in the order of q, and every link with the joint that carries it."""
    names = [str(link.get("name")) for link in robot.findall("link")]
    children: dict[str, list[ET.Element]] = {name: [] for name in names}
    parented: set[str] = set()
    for element in robot.findall("joint"):
        where = f"{source}: joint {element.get('name')}"
        ends = []
        for end in ("parent", "child"):
            found = element.find(end)
            link = None if found is None else found.get("link")
            if link is None:
                raise MachineFileError(where, f"has no {end}", f'add <{end} link="…"/>')
            if link not in children:
                raise MachineFileError(where, f'{end} link "{link}" does not exist', f"choose from: {', '.join(names)}")
            ends.append(str(link))
        if ends[1] in parented:
            raise MachineFileError(where, f'link "{ends[1]}" has two parents', "a URDF is a tree: one parent each")
        parented.add(ends[1])
        children[ends[0]].append(element)
    roots = [name for name in names if name not in parented]
    if len(roots) != 1:
        raise MachineFileError(source, f"{len(roots)} root links ({', '.join(roots)})", "one link must have no parent")
    moving: dict[str, Joint] = {}
    links = {roots[0]: Link(roots[0], -1, np.eye(3), np.zeros(3))}
    waiting = [roots[0]]
    while waiting:
        parent = links[waiting.pop(0)]
        for element in children[parent.name]:
            name, child = str(element.get("name")), str(element.find("child").get("link"))  # type: ignore[union-attr]
            where = f"{source}: joint {name}"
            rotation, translation = _origin(element, where)
            rotation, translation = (
                parent.rotation @ rotation,
                parent.translation + parent.rotation @ translation,
            )
            if element.get("type") == "fixed":
                links[child] = Link(child, parent.joint, rotation, translation)
            else:
                limit = element.find("limit")
                lower, upper = (float(_numbers(limit, key, "0", 1, where)[0]) for key in ("lower", "upper"))
                revolute = element.get("type") == "revolute"
                moving[name] = Joint(
                    name, revolute, parent.joint, rotation, translation, _axis(element, where), lower, upper
                )
                links[child] = Link(child, joints.index(name), np.eye(3), np.zeros(3))
            waiting.append(child)
    if len(links) < len(names):
        lost = ", ".join(name for name in names if name not in links)
        raise MachineFileError(source, f"links {lost} are not connected to the root", "a URDF is one tree")
    return tuple(moving[name] for name in joints), links
