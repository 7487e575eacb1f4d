"""Everything that is wrong with a URDF, each fault by the name of its joint or link and none hiding another.

Reading raises the first, ``armdesign check`` shows all. What may merely follow from another fault
is held back: which link is the root says nothing while a joint's ends are wrong.
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from xml.parsers import expat

import numpy as np

from armdesign.arrays import Array
from armdesign.errors import MachineFileError, choose
from armdesign.units import deg

MOVABLE = ("revolute", "continuous", "prismatic")
LARGEST = 1e9  # no number of a machine in SI is beyond
KEPT = {
    "robot": ("link", "joint"),
    "link": ("inertial",),
    "joint": ("parent", "child", "origin", "axis", "limit", "mimic"),
}


class Located(ET.Element):
    """An element that knows its line in the URDF."""

    line: int | None = None


@dataclass(frozen=True)
class Where:
    """The joint or link that is looked at: what to call it in a message, and its element."""

    part: str
    element: ET.Element

    def fault(self, problem: str, remedy: str, at: ET.Element | None = None) -> MachineFileError:
        """A fault of it, in the line of ``at`` within it."""
        return MachineFileError(
            self.part, problem, remedy, line_of(self.element if at is None else at)
        )


def line_of(element: ET.Element) -> int | None:
    """Line of an element in its URDF."""
    return element.line if isinstance(element, Located) else None


def parse(text: str, source: str) -> ET.Element:
    """A URDF's elements that matter here, each with its line: joints, and links with their inertia.

    Raises:
        MachineFileError: no XML, no URDF, or one with macros.
    """
    try:
        parser = ET.XMLParser(target=ET.TreeBuilder(element_factory=Located))
        robot: ET.Element = ET.fromstring(text, parser=parser)
    except ET.ParseError as error:
        raise MachineFileError(
            source, f"not well-formed XML ({error})", "correct the URDF at that place"
        ) from None
    _tell_lines(robot, text)
    if robot.tag != "robot":
        tag = robot.tag.replace("{", "").replace("}", " ")  # a namespace is in braces
        raise MachineFileError(source, f"the XML root is <{tag}>, not <robot>", "give a URDF file")
    macro = next(
        (part.tag.rpartition("}")[2] for part in robot.iter() if "/xacro}" in str(part.tag)), None
    )
    if macro:
        raise MachineFileError(
            source, f"holds a macro (<xacro:{macro}>)", "expand it: xacro FILE > FILE.urdf"
        )
    robot.attrib = {"name": "arm"}
    for element in (robot, *robot.findall("link"), *robot.findall("joint")):
        for part in [*element]:
            if part.tag not in KEPT[element.tag]:
                element.remove(part)
    return robot


def _tell_lines(robot: ET.Element, text: str) -> None:
    """Give every element its line: those of a second pass over the text, in the order of the document."""
    lines: list[int] = []
    pass_over = expat.ParserCreate()
    pass_over.StartElementHandler = lambda *_: lines.append(pass_over.CurrentLineNumber)
    pass_over.Parse(text, True)
    for element, line in zip(robot.iter(), lines, strict=True):
        if isinstance(element, Located):
            element.line = line


def faults(
    text: str, joints: Sequence[str] | None, frozen: Mapping[str, float], source: str
) -> list[MachineFileError]:
    """Every fault of a URDF, as ``faults_of`` tells them; one alone if it cannot be parsed."""
    try:
        robot = parse(text, source)
    except MachineFileError as error:
        return [error]
    return list(faults_of(robot, joints, frozen, source))


def faults_of(
    robot: ET.Element, joints: Sequence[str] | None, frozen: Mapping[str, float], source: str
) -> Iterator[MachineFileError]:
    """What is wrong, from single names to the tree.

    Args:
        robot: the URDF, parsed.
        joints: names of the coordinates; None if that is not known.
        frozen: value of other joints [rad or m].
        source: file name for messages.
    """
    yield from _of_names(robot, source)
    present = [joint.get("name", "") for joint in robot.findall("joint")]
    movable = movable_joints(robot)
    for key, names in (("joints", joints or ()), ("frozen", frozen)):
        for name in (name for name in names if name not in present):
            problem = f"is not in the URDF (named in {key})"
            yield MachineFileError(f"{source}: joint {name}", problem, choose(name, movable))
    unsure = joints is None or not set(joints) <= set(
        present
    )  # which others move is not known then
    for where in _each(robot, "joint", source):
        joint = where.element
        name = joint.get("name", "")
        moves = (
            True if name in (joints or ()) else None if unsure and name not in frozen else False
        )
        yield from _of_joint(joint, where, moves, frozen.get(name))
    for where in _each(robot, "link", source):
        yield from _of_inertial(where.element, where)
    yield from _of_tree(robot, source)


def movable_joints(robot: ET.Element) -> list[str]:
    """Names of the joints that can be coordinates, in the order of the URDF."""
    return [
        joint.get("name", "") for joint in robot.findall("joint") if joint.get("type") in MOVABLE
    ]


def numbers(element: ET.Element | None, key: str, default: str) -> Array:
    """Numbers of an attribute; NaN if one of them is none."""
    text = default if element is None else element.get(key, default)
    try:
        return np.array([float(word) for word in text.split()])
    except ValueError:
        return np.array([math.nan])


def _each(robot: ET.Element, kind: str, source: str) -> Iterator[Where]:
    """Every joint or link."""
    for index, element in enumerate(robot.findall(kind), 1):
        yield Where(f"{source}: {kind} {element.get('name') or f'number {index}'}", element)


def _of_names(robot: ET.Element, source: str) -> Iterator[MachineFileError]:
    for kind in ("link", "joint"):
        lines = [line_of(element) for element in robot.findall(kind)]
        names = [element.get("name", "") for element in robot.findall(kind)]
        for index, name in enumerate(names):
            if not name:
                problem = f"a {kind} has no name (number {index + 1} of the file)"
                yield MachineFileError(source, problem, f'write <{kind} name="…">', lines[index])
            elif names.index(name) == index and (count := names.count(name)) > 1:
                words = {2: "two", 3: "three"}.get(count, str(count))
                second = lines[names.index(name, index + 1)]
                yield MachineFileError(
                    source, f'{words} {kind}s are named "{name}"', "rename one", second
                )


def _of_numbers(
    element: ET.Element | None, key: str, default: str, count: int, where: Where
) -> Iterator[MachineFileError]:
    values = numbers(element, key, default)
    if len(values) != count or not np.all(np.abs(values) <= LARGEST):
        text = default if element is None else element.get(key, default)
        problem = f'{key}="{text:.60}" is not {count} finite number(s) up to {LARGEST:g}'
        remedy = "correct the URDF"
        if meant := _without_commas(text, count):
            remedy = f'a decimal comma? write {key}="{meant}"'
        yield where.fault(problem, remedy, element)


def _without_commas(text: str, count: int) -> str:
    """The numbers that were meant by a text with decimal commas, or with commas between them.

    "" if none were.
    """
    for meant in (re.sub(r"(\d),(\d)", r"\1.\2", text).replace(",", " "), text.replace(",", " ")):
        values = numbers(ET.Element("meant", value=meant), "value", "")
        if "," in text and len(values) == count and np.all(np.isfinite(values)):
            return " ".join(meant.split())
    return ""


def _of_origin(element: ET.Element, where: Where) -> Iterator[MachineFileError]:
    for key in ("xyz", "rpy"):
        yield from _of_numbers(element.find("origin"), key, "0 0 0", 3, where)


def _of_joint(
    joint: ET.Element, where: Where, moves: bool | None, frozen: float | None
) -> Iterator[MachineFileError]:
    kind = joint.get("type")
    if kind not in (*MOVABLE, "fixed"):
        yield where.fault(
            f'type "{kind}" cannot be used', "use revolute, continuous, prismatic or fixed"
        )
    if joint.find("mimic") is not None:
        yield where.fault(
            "mimics another joint", "make it a joint of its own or fix it", joint.find("mimic")
        )
    yield from _of_origin(joint, where)
    if kind == "fixed" and moves:
        yield where.fault("is fixed and cannot be a coordinate", "take it out of joints")
    if kind == "fixed" and frozen is not None and not moves:
        yield where.fault("is fixed in the URDF and cannot be frozen", "take it out of frozen")
    if kind in MOVABLE:
        yield from _of_axis(joint, where)
    if kind in ("revolute", "prismatic"):
        yield from _of_limits(joint, where, moves, frozen or 0.0)


def _of_axis(joint: ET.Element, where: Where) -> Iterator[MachineFileError]:
    wrong = list(_of_numbers(joint.find("axis"), "xyz", "1 0 0", 3, where))
    if not wrong and float(np.linalg.norm(numbers(joint.find("axis"), "xyz", "1 0 0"))) < 1e-6:
        wrong = [
            where.fault(
                "the axis has no length",
                'give a direction such as xyz="0 -1 0"',
                joint.find("axis"),
            )
        ]
    yield from wrong


def _of_limits(
    joint: ET.Element, where: Where, moves: bool | None, frozen: float
) -> Iterator[MachineFileError]:
    """Limits of a joint that moves; of one that does not, only whether it stands between them."""
    limit = joint.find("limit")
    if limit is None:
        if moves:
            yield where.fault(
                "has no <limit>", 'add <limit lower="…" upper="…" effort="…" velocity="…"/>'
            )
        return
    wrong = [
        fault for key in ("lower", "upper") for fault in _of_numbers(limit, key, "0", 1, where)
    ]
    yield from wrong
    lower, upper = (
        (math.nan, math.nan)
        if wrong
        else (float(numbers(limit, key, "0")[0]) for key in ("lower", "upper"))
    )
    if moves and lower >= upper:
        yield where.fault(
            f"limits [{lower:g}, {upper:g}] are empty", "lower must be below upper", limit
        )
    if moves is False and not wrong and not lower <= frozen <= upper:
        problem = f"is frozen at {frozen:g}, outside its limits [{lower:g}, {upper:g}]"
        meant = frozen * deg  # of a joint that turns, in degrees
        degrees = (
            joint.get("type") == "revolute"
            and abs(frozen) > 2 * math.pi
            and lower <= meant <= upper
        )
        remedy = (
            f"it looks like degrees: write {meant:.6g} rad"
            if degrees
            else "give frozen another value"
        )
        yield where.fault(problem, remedy, limit)
    for key in ("effort", "velocity") if moves else ():
        wrong = list(_of_numbers(limit, key, "0", 1, where))
        yield from wrong
        if not wrong and (value := float(numbers(limit, key, "0")[0])) < 0:
            yield where.fault(
                f"{key} {value:g} is negative", f"give a limit with {key} ≥ 0", limit
            )


def _of_inertial(link: ET.Element, where: Where) -> Iterator[MachineFileError]:
    inertial = link.find("inertial")
    if inertial is None:
        return
    yield from _of_origin(inertial, where)
    mass, inertia = inertial.find("mass"), inertial.find("inertia")
    if mass is None or inertia is None:
        yield where.fault(
            "<inertial> lacks <mass> or <inertia>", "give both, or no <inertial>", inertial
        )
    if mass is not None:
        wrong = list(_of_numbers(mass, "value", "", 1, where))
        yield from wrong
        if not wrong and (value := float(numbers(mass, "value", "")[0])) < 0:
            yield where.fault(f"mass {value:g} kg is negative", "give a mass ≥ 0 kg", mass)
    if inertia is not None:
        yield from _of_inertia(inertia, where)


def _of_inertia(inertia: ET.Element, where: Where) -> Iterator[MachineFileError]:
    keys = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    wrong = [fault for key in keys for fault in _of_numbers(inertia, key, "", 1, where)]
    yield from wrong
    if wrong:
        return
    xx, yy, zz, xy, xz, yz = (float(numbers(inertia, key, "")[0]) for key in keys)
    principal = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    slack = 1e-6 * float(np.abs(principal).max()) + 1e-12
    if principal[0] < -slack or principal[2] > principal[0] + principal[1] + slack:
        yield where.fault(
            f"no body has principal inertias {principal[0]:g}, {principal[1]:g}, {principal[2]:g}"
            " kg m²",
            "each must be ≥ 0 and at most the sum of the other two",
            inertia,
        )


def _of_tree(robot: ET.Element, source: str) -> Iterator[MachineFileError]:
    links = [link.get("name", "") for link in robot.findall("link")]
    parents: dict[str, str] = {}
    whole = True
    for where in _each(robot, "joint", source):
        ends = {}
        for end in ("parent", "child"):
            found = where.element.find(end)
            link = None if found is None else found.get("link")
            if link is None:
                yield where.fault(f"has no {end}", f'add <{end} link="…"/>')
            elif link not in links:
                yield where.fault(
                    f'{end} link "{link}" does not exist', choose(link, links), found
                )
            else:
                ends[end] = link
        if ends.get("child") in parents:
            yield where.fault(
                f'link "{ends["child"]}" has two parents', "a URDF is a tree: one parent each"
            )
        elif len(ends) == 2:
            parents[ends["child"]] = ends["parent"]
            continue
        whole = False
    if whole:
        yield from _of_roots(list(dict.fromkeys(links)), parents, source)


def _of_roots(
    links: Sequence[str], parents: Mapping[str, str], source: str
) -> Iterator[MachineFileError]:
    """No link or several without a parent.

    Links that no root carries because they carry each other.
    """
    roots = [link for link in links if link not in parents]
    if len(roots) != 1:
        named = f" ({', '.join(roots)})" if roots else ""
        yield MachineFileError(
            source, f"{len(roots)} root links{named}", "one link must have no parent"
        )
    lost: dict[frozenset[str], list[str]] = {}
    for link in links:
        below = [link]
        while below[-1] in parents and parents[below[-1]] not in below:
            below.append(parents[below[-1]])
        if below[-1] in parents:  # its parent has been met: from there on it is a ring
            ring = frozenset(below[below.index(parents[below[-1]]) :])
            lost.setdefault(ring, []).append(link)
    for members in lost.values():
        words = f"links {', '.join(members)} are not connected to the root"
        yield MachineFileError(source, words, "a URDF is one tree: no link may carry itself")
