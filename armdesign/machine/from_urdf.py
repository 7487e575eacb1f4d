"""A machine file for a URDF that already exists: its joints, and defaults for the rest."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, TypedDict

from armdesign.errors import MachineFileError
from armdesign.machine.file import machine_file
from armdesign.machine.file.section import NAME_LENGTH, NAME_PATTERN
from armdesign.machine.file.toml_writing import dump
from armdesign.mechanism.linkage.kinds import KINDS
from armdesign.mechanism.urdf_faults import MOVABLE, elements, parse
from armdesign.text_files import LARGEST_URDF

FLUID = {"bulk_modulus_MPa": 1200.0, "entrained_air_percent": 0.0, "density_kg_per_m3": 870.0}
BANDS = {"structure": [0.0, 1.0]}
OF_BANDS = "what is not known exactly: an estimate, replace it where something was measured"
SUPPLY = {"pressure_bar": 250.0, "return_pressure_bar": 5.0, "flow_l_per_min": 100.0}
ARGUMENTS = {  # of ``Machine.from_urdf`` by the table's key, in the order of the file
    "frozen": "frozen",
    "tool": "tool",
    "payload": "payloads",
    "fluid": "fluid",
    "supply": "supply",
    "cylinder": "cylinders",
    "motor": "motors",
    "spring": "springs",
    "requirements": "requirements",
    "bands": "bands",
}


class Tables(TypedDict, total=False):
    """Tables of a machine file that ``Machine.from_urdf`` takes beside those of cylinders."""

    frozen: Mapping[str, float] | None
    payloads: Mapping[str, Any] | None
    tool: Mapping[str, Any] | None
    fluid: Mapping[str, Any] | None
    supply: Mapping[str, Any] | None
    requirements: Mapping[str, Any] | None
    motors: Mapping[str, Any] | None
    springs: Mapping[str, Any] | None
    bands: Mapping[str, Any] | None


NO_TABLES = dict.fromkeys(Tables.__annotations__)


def read(urdf: str | Path) -> tuple[str, Path]:
    """Text of a URDF given as path or as text, and the path that stands for it.

    Raises:
        MachineFileError: it is neither, or cannot be read.
    """
    if isinstance(urdf, str) and "<" in urdf:
        return urdf, Path(f"{_usable_name(elements(urdf, 'urdf').get('name', ''))}.urdf")
    if not isinstance(urdf, str | Path):
        fault = f"type {type(urdf).__name__} is not allowed"
        raise MachineFileError("urdf", fault, "give a path or the URDF's text")
    path = Path(urdf)
    return machine_file.read_text(path, LARGEST_URDF), path


def machine_text(
    urdf_text: str,
    path: Path,
    name: str | None,
    joints: Iterable[str] | None,
    tables: Mapping[str, Any],
) -> str:
    """Text of the machine file.

    Args:
        urdf_text: the URDF.
        path: its path: its file name goes into the machine file.
        name: of the machine; None: the URDF's file name.
        joints: the coordinates; None: every movable joint that a cylinder spans or a motor turns,
            from the root outwards.
        tables: tables of the machine file by the names of arguments; None: the default.

    Raises:
        MachineFileError: no well-formed XML, or something that is no table.
    """
    keyed = {key: tables[argument] for key, argument in ARGUMENTS.items()}
    given = {key: value for key, value in keyed.items() if value is not None}
    for key, value in given.items():
        if not isinstance(value, Mapping):
            remedy = "expected {key: value} as in a machine file"
            fault = f"type {type(value).__name__} is not allowed"
            raise MachineFileError(ARGUMENTS[key], fault, remedy)
    robot = parse(urdf_text, path.name)
    if joints is None:
        joints = _driven(robot, given.get("cylinder", {}), given.get("motor", {}))
    joints = [str(joint) for joint in joints]
    data = {
        "name": _usable_name(path.stem) if name is None else name,
        "urdf": path.name,
        "joints": joints,
        **keyed,
        "tool": given.get("tool") or {"link": _outermost(robot, joints), "at_mm": [0.0, 0.0, 0.0]},
        "payload": given.get("payload") or {"empty": {"mass_kg": 0.0}},
        "fluid": {**FLUID, **given.get("fluid", {})},
        "supply": {**SUPPLY, **given.get("supply", {})},
        "bands": given.get("bands", BANDS),
    }
    present = {key: value for key, value in data.items() if value is not None}
    text = dump(present, f"made from {path.name}")
    return text if "bands" in given else text.replace("[bands]", f"[bands]  # {OF_BANDS}")


def _usable_name(words: str) -> str:
    name = re.sub(r"[^A-Za-z0-9_-]+", "_", words)[:NAME_LENGTH]
    return name if re.match(NAME_PATTERN, name) else "machine"


def _parents(robot: ET.Element) -> dict[str, tuple[ET.Element, str]]:
    """Joint above every link but the root, and the link that carries it."""
    parents = {}
    for joint in robot.findall("joint"):
        parent, child = joint.find("parent"), joint.find("child")
        if parent is not None and child is not None:
            parents[str(child.get("link"))] = (joint, str(parent.get("link")))
    return parents


def _above(link: str, parents: dict[str, tuple[ET.Element, str]]) -> list[ET.Element]:
    """Joints from a link to the root; a loop ends it, for the URDF's own check to refuse."""
    joints: list[ET.Element] = []
    while link in parents and parents[link][0] not in joints:
        joint, link = parents[link]
        joints.append(joint)
    return joints


def _driven(
    robot: ET.Element, cylinders: Mapping[str, Any], motors: Mapping[str, Any]
) -> list[str]:
    """Movable joints that cylinders or motors drive, from the root outwards; all if none is."""
    parents, between = _parents(robot), []
    for table in cylinders.values():
        first, *others = [_above(link, parents) for link in _links(table)] or [[]]
        for other in others:
            between += [one for one in (*first, *other) if (one in first) != (one in other)]
    tables = {name: table for name, table in motors.items() if isinstance(table, Mapping)}
    turned = [table.get("joint", name) for name, table in tables.items()]
    movable = [joint for joint in robot.findall("joint") if joint.get("type") in MOVABLE]
    chosen = [one for one in movable if one in between or one.get("name") in turned] or movable
    depth = {id(joint): len(_above(str(link), parents)) for link, (joint, _) in parents.items()}
    chosen.sort(key=lambda joint: depth.get(id(joint), 0))
    return [str(joint.get("name")) for joint in chosen]


def _links(table: Any) -> list[str]:
    """Links that a cylinder's pins are on, base first."""
    if not isinstance(table, Mapping):
        return []
    given = [table.get(key) for key in ("base", *(kind.key for kind in KINDS))]
    tables = [one for one in given if isinstance(one, Mapping)]
    pins = [pin for one in tables for pin in ([one] if "link" in one else one.values())]
    return [str(pin["link"]) for pin in pins if isinstance(pin, Mapping) and "link" in pin]


def _outermost(robot: ET.Element, joints: list[str]) -> str:
    """The link furthest from the root among those that the last joint moves."""
    parents, moved = _parents(robot), dict[str, int]()
    for link in parents:
        chain = [str(joint.get("name")) for joint in _above(link, parents)]
        moved |= {link: len(chain)} if joints and joints[-1] in chain else {}
    return max(moved, key=lambda link: moved[link], default="none")
