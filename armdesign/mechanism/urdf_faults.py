"""Faults of a URDF, each by the name of its joint or link, none hiding another.

Reading raises the first, ``armdesign check`` shows all. What may merely follow from another fault
is held back: which link is the root says nothing while a joint's ends are wrong.
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from xml.parsers import expat

import numpy as np

from armdesign.arrays import Array
from armdesign.errors import MachineFileError, choose
from armdesign.mechanism.spring import Spring
from armdesign.units import deg

MOVABLE = ("revolute", "continuous", "prismatic")
LARGEST = 1e9  # no number of a machine in SI is beyond
KEPT = {
    "robot": ("link", "joint"),
    "link": ("inertial",),
    "inertial": ("origin", "mass", "inertia"),
    "joint": ("parent", "child", "origin", "axis", "limit", "mimic"),
}
MOST, DEEPEST = 5_000, 500  # links, joints, visuals; joints in a row: Pinocchio recurses
MOST_ELEMENTS, NESTED = 100_000, 50  # of XML, and within each other: a URDF has six
MOST_ATTRIBUTES = 100  # of one: a URDF has six
FEWER = "leave out what is not of the arm"
MOST_FAULTS = 200  # that are told at once


class Located(ET.Element):
    """An element that knows its line in the URDF."""

    line: int | None = None


@dataclass(frozen=True)
class UrdfPart:
    """A joint or link: its name in messages, and its element."""

    name: str
    element: ET.Element

    def fault(self, fault: str, remedy: str, at: ET.Element | None = None) -> MachineFileError:
        """A fault in the line of ``at``, an element within the part; None: the part itself."""
        line = line_of(self.element if at is None else at)
        return MachineFileError(self.name, fault, remedy, line)


def line_of(element: ET.Element) -> int | None:
    """Line of an element in its URDF."""
    return element.line if isinstance(element, Located) else None


def parse(text: str, source: str) -> ET.Element:
    """The elements of a URDF that count, each with its line: joints, and links with inertia.

    Raises:
        MachineFileError: no XML, no URDF, or one with macros.
    """
    robot = elements(text, source)
    if robot.tag != "robot":
        tag = robot.tag.replace("{", "").replace("}", " ")  # a namespace is in braces
        raise MachineFileError(source, f"the XML root is <{tag}>, not <robot>", "give a URDF file")
    for part in robot.iter():
        if "/xacro}" in str(part.tag):
            fault = f"holds a macro (<xacro:{part.tag.rpartition('}')[2]}>)"
            raise MachineFileError(source, fault, "expand it: xacro FILE > FILE.urdf")
    for place in ("link", "joint", "link/visual"):
        if (count := len(robot.findall(place))) > MOST:
            kinds = f"{place.rpartition('/')[2]}s"
            raise MachineFileError(source, f"has {count} {kinds}, more than {MOST}", FEWER)
    robot.attrib = {"name": "arm"}
    for element in [*robot.iter()]:
        element[:] = [part for part in element if part.tag in KEPT.get(element.tag, ())]
    return robot


def elements(text: str, source: str) -> ET.Element:
    """All elements of a URDF, each with its line.

    Raises:
        MachineFileError: no XML, or more of it than a URDF has.
    """
    try:
        lines = _lines(text, source)
        parser = ET.XMLParser(target=ET.TreeBuilder(element_factory=Located))
        robot: ET.Element = ET.fromstring(text, parser=parser)
    except (expat.ExpatError, ET.ParseError) as error:
        fault = f"not well-formed XML ({error})"
        raise MachineFileError(source, fault, "correct the URDF at that place") from None
    for element, line in zip(robot.iter(), lines, strict=True):
        if isinstance(element, Located):
            element.line = line
    return robot


def _lines(text: str, source: str) -> list[int]:
    """Line of every element, which only a pass of its own over the text can tell."""
    lines: list[int] = []
    inside = 0

    def opened(name: str, attributes: Mapping[str, str]) -> None:
        nonlocal inside
        inside += 1
        lines.append(parser.CurrentLineNumber)
        if inside > NESTED:
            fault = f"has more than {NESTED} elements within each other"
            raise MachineFileError(source, fault, FEWER, lines[-1])
        if len(lines) > MOST_ELEMENTS:
            raise MachineFileError(source, f"has more than {MOST_ELEMENTS} elements", FEWER)
        if len(attributes) > MOST_ATTRIBUTES:
            fault = f"has an element {name} with more than {MOST_ATTRIBUTES} attributes"
            raise MachineFileError(source, fault, FEWER, lines[-1])

    def closed(_: object) -> None:
        nonlocal inside
        inside -= 1

    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = opened, closed
    parser.Parse(text, True)
    return lines


def faults(
    text: str,
    joints: Sequence[str] | None,
    frozen: Mapping[str, float],
    source: str,
    springs: Sequence[Spring] = (),
) -> list[MachineFileError]:
    """Faults of a URDF's text, the first 200; one alone if it cannot be parsed."""
    try:
        robot = parse(text, source)
    except MachineFileError as error:
        return [error]
    return list(islice(faults_of(robot, joints, frozen, source, springs), MOST_FAULTS))


def faults_of(
    robot: ET.Element,
    joints: Sequence[str] | None,
    frozen: Mapping[str, float],
    source: str,
    springs: Sequence[Spring] = (),
) -> Iterator[MachineFileError]:
    """Faults of a parsed URDF, from single names to the tree.

    Args:
        robot: the URDF, parsed.
        joints: names of the joints of poses; None if that is not known.
        frozen: value of other joints [rad or m].
        source: file name for messages.
        springs: passive joints, coordinates too.
    """
    yield from _of_names(robot, source)
    present = {joint.get("name", "") for joint in robot.findall("joint")}
    movable = movable_joints(robot)
    named = {f"joints.{index}": name for index, name in enumerate(joints or ())}
    named |= {f"frozen.{name}": name for name in frozen}
    named |= {f"spring.{spring.name}.joint": spring.joint for spring in springs}
    for key, name in named.items():
        if name not in present:
            fault = f"is not in the URDF (named in {key.split('.')[0]})"
            part = f"{source}: joint {name}"
            yield MachineFileError(part, fault, choose(name, movable), key=key)
    # with a coordinate that is not known, it is not known which other joints move
    coordinates = {*(joints or ()), *(spring.joint for spring in springs)}
    unsure = joints is None or not coordinates <= present
    for joint in _parts(robot, "joint", source):
        name = joint.element.get("name", "")
        moves: bool | None = name in coordinates
        if not moves and unsure and name not in frozen:
            moves = None
        yield from _of_joint(joint, moves, frozen.get(name))
    for link in _parts(robot, "link", source):
        yield from _of_inertial(link)
    yield from _of_tree(robot, source)


def movable_joints(robot: ET.Element) -> list[str]:
    """Names of the joints that can be coordinates, in the order of the URDF."""
    movable = (joint for joint in robot.findall("joint") if joint.get("type") in MOVABLE)
    return [joint.get("name", "") for joint in movable]


def numbers(element: ET.Element | None, key: str, default: str) -> Array:
    """Numbers of an attribute; NaN if one of them is none."""
    text = default if element is None else element.get(key, default)
    try:
        return np.array([float(word) for word in text.split()])
    except ValueError:
        return np.array([math.nan])


def _parts(robot: ET.Element, kind: str, source: str) -> Iterator[UrdfPart]:
    """Every joint or link."""
    for index, element in enumerate(robot.findall(kind), 1):
        yield UrdfPart(f"{source}: {kind} {element.get('name') or f'number {index}'}", element)


def _of_names(robot: ET.Element, source: str) -> Iterator[MachineFileError]:
    for kind in ("link", "joint"):
        lines = [line_of(element) for element in robot.findall(kind)]
        indices: dict[str, list[int]] = {}
        for index, element in enumerate(robot.findall(kind)):
            indices.setdefault(element.get("name", ""), []).append(index)
        for index in indices.pop("", ()):
            fault = f"a {kind} has no name (number {index + 1} of the file)"
            yield MachineFileError(source, fault, f'write <{kind} name="…">', lines[index])
        for name, (_, *others) in indices.items():
            if others:
                words = {1: "two", 2: "three"}.get(len(others), str(len(others) + 1))
                fault = f'{words} {kind}s are named "{name}"'
                yield MachineFileError(source, fault, "rename one", lines[others[0]])


def _of_numbers(
    element: ET.Element | None, key: str, default: str, count: int, part: UrdfPart
) -> Iterator[MachineFileError]:
    values = numbers(element, key, default)
    if len(values) != count or not np.all(np.abs(values) <= LARGEST):
        text = default if element is None else element.get(key, default)
        fault = f'{key}="{text:.60}" is not {count} finite number(s) up to {LARGEST:g}'
        remedy = "correct the URDF"
        if meant := _without_commas(text, count):
            remedy = f'a decimal comma? write {key}="{meant}"'
        yield part.fault(fault, remedy, element)


def _without_commas(text: str, count: int) -> str:
    """Numbers with decimal commas, or with commas between them, as a URDF has them; "" if none."""
    for meant in (re.sub(r"(\d),(\d)", r"\1.\2", text).replace(",", " "), text.replace(",", " ")):
        values = numbers(ET.Element("meant", value=meant), "value", "")
        if "," in text and len(values) == count and np.all(np.isfinite(values)):
            return " ".join(meant.split())
    return ""


def _of_children(element: ET.Element, part: UrdfPart) -> Iterator[MachineFileError]:
    """Elements that a part or its inertial has more than once: only the first would count."""
    for tag in KEPT[element.tag]:
        for again in element.findall(tag)[1:2]:
            within = "" if element is part.element else f" in its <{element.tag}>"
            fault = f"has more than one <{tag}>{within}"
            yield part.fault(fault, "keep the one that is meant", again)


def _of_origin(element: ET.Element, part: UrdfPart) -> Iterator[MachineFileError]:
    for key in ("xyz", "rpy"):
        yield from _of_numbers(element.find("origin"), key, "0 0 0", 3, part)


def _of_joint(
    joint: UrdfPart, moves: bool | None, frozen: float | None
) -> Iterator[MachineFileError]:
    """Faults of a joint; ``moves`` is None where it is not known whether it is a coordinate."""
    kind, mimic = joint.element.get("type"), joint.element.find("mimic")
    if kind not in (*MOVABLE, "fixed"):
        fault = f'type "{kind}" cannot be used'
        yield joint.fault(fault, "use revolute, continuous, prismatic or fixed")
    if mimic is not None:
        yield joint.fault("mimics another joint", "make it a joint of its own or fix it", mimic)
    yield from _of_children(joint.element, joint)
    yield from _of_origin(joint.element, joint)
    if kind == "fixed" and moves:
        remedy = "take it out of joints or spring, or give it another type"
        yield joint.fault("is fixed and cannot be a coordinate", remedy)
    if kind == "fixed" and frozen is not None and not moves:
        yield joint.fault("is fixed in the URDF and cannot be frozen", "take it out of frozen")
    if kind in MOVABLE:
        yield from _of_axis(joint)
    limit = joint.element.find("limit")
    if kind in ("revolute", "prismatic") and limit is not None:
        yield from _of_limits(joint, limit, moves, frozen or 0.0)
    elif kind in ("revolute", "prismatic") and moves:
        remedy = 'add <limit lower="…" upper="…" effort="…" velocity="…"/>'
        yield joint.fault("has no <limit>", remedy)


def _of_axis(joint: UrdfPart) -> Iterator[MachineFileError]:
    axis = joint.element.find("axis")
    wrong = list(_of_numbers(axis, "xyz", "1 0 0", 3, joint))
    yield from wrong
    if not wrong and float(np.linalg.norm(numbers(axis, "xyz", "1 0 0"))) < 1e-6:
        remedy = 'give a direction such as xyz="0 -1 0"'
        yield joint.fault("the axis has no length", remedy, axis)


def _of_limits(
    joint: UrdfPart, limit: ET.Element, moves: bool | None, frozen: float
) -> Iterator[MachineFileError]:
    """Limits of a joint that moves; of one that does not, only whether it stands between them."""
    ends = ("lower", "upper")
    wrong = [fault for key in ends for fault in _of_numbers(limit, key, "0", 1, joint)]
    yield from wrong
    lower, upper = (math.nan if wrong else float(numbers(limit, key, "0")[0]) for key in ends)
    if lower > upper or (moves and lower == upper):
        fault = f"limits [{lower:g}, {upper:g}] are empty"
        yield joint.fault(fault, "lower must be below upper", limit)
    elif moves is False and not wrong and not lower <= frozen <= upper:
        fault = f"is frozen at {frozen:g}, outside its limits [{lower:g}, {upper:g}]"
        remedy, turns = "give frozen another value", joint.element.get("type") == "revolute"
        if turns and abs(frozen) > 2 * math.pi and lower <= frozen * deg <= upper:
            remedy = f"it looks like degrees: write {frozen * deg:.6g} rad"
        yield joint.fault(fault, remedy, limit)
    for key in ("effort", "velocity") if moves else ():
        wrong = list(_of_numbers(limit, key, "0", 1, joint))
        yield from wrong
        if not wrong and (value := float(numbers(limit, key, "0")[0])) < 0:
            remedy = f"give a limit with {key} ≥ 0"
            yield joint.fault(f"{key} {value:g} is negative", remedy, limit)


def _of_inertial(link: UrdfPart) -> Iterator[MachineFileError]:
    yield from _of_children(link.element, link)
    inertial = link.element.find("inertial")
    if inertial is None:
        return
    yield from _of_children(inertial, link)
    yield from _of_origin(inertial, link)
    mass, inertia = inertial.find("mass"), inertial.find("inertia")
    if mass is None or inertia is None:
        fault = "<inertial> lacks <mass> or <inertia>"
        yield link.fault(fault, "give both, or no <inertial>", inertial)
    if mass is not None:
        wrong = list(_of_numbers(mass, "value", "", 1, link))
        yield from wrong
        if not wrong and (value := float(numbers(mass, "value", "")[0])) < 0:
            yield link.fault(f"mass {value:g} kg is negative", "give a mass ≥ 0 kg", mass)
    if inertia is not None:
        yield from _of_inertia(inertia, link)


def _of_inertia(inertia: ET.Element, link: UrdfPart) -> Iterator[MachineFileError]:
    keys = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    wrong = [fault for key in keys for fault in _of_numbers(inertia, key, "", 1, link)]
    yield from wrong
    if wrong:
        return
    if wrong_inertia := fault_of_inertia([float(numbers(inertia, key, "")[0]) for key in keys]):
        yield link.fault(*wrong_inertia, inertia)


def fault_of_inertia(inertia: Sequence[float]) -> tuple[str, str] | None:
    """Fault and remedy of an inertia xx, yy, zz, xy, xz, yz [kg m²] that no body has."""
    xx, yy, zz, xy, xz, yz = inertia
    principal = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    slack = 1e-6 * float(np.abs(principal).max()) + 1e-12
    if principal[0] >= -slack and principal[2] <= principal[0] + principal[1] + slack:
        return None
    values = ", ".join(f"{value:g}" for value in principal)
    fault = f"no body has principal inertias {values} kg m²"
    return fault, "each must be ≥ 0 and at most the sum of the other two"


def _of_tree(robot: ET.Element, source: str) -> Iterator[MachineFileError]:
    """Joints that do not join two links, then what keeps the links from being one tree."""
    links = dict.fromkeys(link.get("name", "") for link in robot.findall("link"))
    parents: dict[str, str] = {}
    whole = True
    for joint in _parts(robot, "joint", source):
        ends = {}
        for end in ("parent", "child"):
            element = joint.element.find(end)
            link = None if element is None else element.get("link")
            if link is None:
                yield joint.fault(f"has no {end}", f'add <{end} link="…"/>')
            elif link not in links:
                fault = f'{end} link "{link}" does not exist'
                yield joint.fault(fault, choose(link, links), element)
            else:
                ends[end] = link
        if ends.get("child") in parents:
            fault = f'link "{ends["child"]}" has two parents'
            yield joint.fault(fault, "a URDF is a tree: one parent each")
        elif len(ends) == 2:
            parents[ends["child"]] = ends["parent"]
            continue
        whole = False
    if whole:
        yield from _of_roots(links, parents, source)


def _of_roots(
    links: Collection[str], parents: Mapping[str, str], source: str
) -> Iterator[MachineFileError]:
    """No or several roots, and links that no root carries because they carry each other."""
    if wrong := fault_of_roots(links, parents):
        yield MachineFileError(source, *wrong)
    lost = rings(links, parents)
    for ring in lost:
        fault = f"links {', '.join(ring)} are not connected to the root"
        yield MachineFileError(source, fault, "a URDF is one tree: no link may carry itself")
    if not lost and (depth := _depth(links, parents)) > DEEPEST:
        fault = f"{depth} joints are one behind the other, more than {DEEPEST}"
        yield MachineFileError(source, fault, "join links that do not move to each other")


def fault_of_roots(links: Collection[str], parents: Mapping[str, str]) -> tuple[str, str] | None:
    """Fault and remedy where not one link alone has no parent."""
    roots = [link for link in links if link not in parents]
    if len(roots) == 1:
        return None
    names = f" ({', '.join(roots)})" if roots else ""
    return f"{len(roots)} root links{names}", "one link must have no parent"


def rings(links: Collection[str], parents: Mapping[str, str]) -> list[list[str]]:
    """Links that carry each other in a ring, with those beyond it, for each ring."""
    ends: dict[str, str] = {}  # root, or one link of the ring, that a link leads up to
    lost: dict[str, list[str]] = {}  # by that link of their ring
    for first in links:
        link, upwards = first, dict[str, None]()
        while link not in ends and link not in upwards and link in parents:
            upwards[link] = None
            link = parents[link]
        ends |= dict.fromkeys([*upwards, link], ends.get(link, link))
    for link in links:
        if ends[link] in parents:
            lost.setdefault(ends[link], []).append(link)
    return list(lost.values())


def _depth(links: Iterable[str], parents: Mapping[str, str]) -> int:
    """Largest number of joints between a link and its root, without rings."""
    depths: dict[str, int] = {}
    for link in links:
        upwards = []
        while link in parents and link not in depths:
            upwards.append(link)
            link = parents[link]
        start = depths.get(link, 0) + 1
        depths |= {one: start + k for k, one in enumerate(reversed(upwards))}
    return max(depths.values(), default=0)
