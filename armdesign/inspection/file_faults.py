"""Every fault that makes a machine file unusable: of the file, its URDF, and their machine."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from armdesign.errors import ArmDesignError, MachineFileError
from armdesign.frequency.frequency_band import refuse_toppling_within
from armdesign.frequency.workspace import Workspace
from armdesign.machine.assembly_faults import assembly_faults
from armdesign.machine.file import machine_file
from armdesign.machine.file.contradictions import unknown_joints, unknown_links
from armdesign.machine.file.schema import MachineSection
from armdesign.machine.file.toml_reading import KeyLines, tell_line
from armdesign.machine.file.toml_writing import dump
from armdesign.machine.from_urdf import FLUID, SUPPLY
from armdesign.machine.links import urdf_of
from armdesign.machine.loading import find
from armdesign.machine.machine import Machine
from armdesign.machine.parts import linkage, springs_of
from armdesign.mechanism import urdf_faults
from armdesign.mechanism.arm import Arm


def faults(path_or_name: str | Path, *, allow_outside: bool = False) -> list[ArmDesignError]:
    """Every fault that makes a machine file unusable; empty if it can be used.

    Schema, keys that contradict each other, faults of the URDF, links and joints that it does not
    have, then faults that only the assembled machine shows: ranges, dead centres, four-bars that
    do not close. Each is looked for as far as possible beside the others.

    Args:
        path_or_name: as of ``load``.
        allow_outside: as of ``load``.
    """
    try:
        path = find(path_or_name)
        text = machine_file.read_text(path)
    except ArmDesignError as error:
        return [error]
    all_faults = _all(path, text, allow_outside)
    key_lines = KeyLines(text)
    for fault in all_faults:
        tell_line(fault, key_lines, path.name)
    return list({str(fault): fault for fault in all_faults}.values())


def _all(path: Path, text: str, allow_outside: bool) -> list[ArmDesignError]:
    """Every fault, in the order in which they are looked for."""
    section, in_file, wrong = machine_file.faults(text, path.name)
    all_faults: list[ArmDesignError] = [*in_file]
    odd = {fault.part.removeprefix(f"{path.name}: ") for fault in in_file}
    heads = {key.split(".")[0] for key in wrong | odd}
    if section is None or {"urdf", "links"} & heads:
        return all_faults
    if section.links and {"joints", "frozen", "spring"} & heads:
        return all_faults
    section = _without_springs(section, wrong)
    try:
        urdf_text = machine_file.read_urdf(path, section, allow_outside)
    except ArmDesignError as error:
        return [*all_faults, error]
    joints = None if any(key.split(".")[0] == "joints" for key in wrong) else section.joints
    if section.links:
        urdf_text = urdf_of(section.links)
    in_urdf = _in_urdf(section, urdf_text, joints)
    all_faults += [*_unknown_names(section, urdf_text, path.name, wrong), *in_urdf]
    if joints is None or "joints" in odd:
        return all_faults
    geometry = _without_masses(urdf_text) if in_urdf else urdf_text
    if in_urdf and _in_urdf(section, geometry, joints):
        return all_faults
    try:
        if not all_faults:
            machine = Machine.unchecked(text, urdf_text, path, section=section)
            all_faults += assembly_faults(machine)
        if all_faults:
            stand_ins = {".".join(key.split(".")[1:2]) for key in wrong}
            blamed = _blamed(all_faults) | stand_ins
            return [*all_faults, *_faults_of_other_cylinders(section, geometry, path, blamed)]
        if machine.springs:
            refuse_toppling_within(machine, Workspace.grid(machine))
    except ArmDesignError as error:
        all_faults.append(error)
    return all_faults


def _in_urdf(
    section: MachineSection, urdf_text: str, joints: Sequence[str] | None
) -> list[MachineFileError]:
    """Every fault of the URDF; none where there are ``[links]``, whose faults are the file's."""
    if section.urdf is None:
        return []
    springs = springs_of(section)
    return urdf_faults.faults(urdf_text, joints, section.frozen, section.urdf, springs)


def _without_springs(section: MachineSection, wrong: Iterable[str]) -> MachineSection:
    """The file without springs about which there is a fault: their joints stand still."""
    faulty = {path.split(".")[1] for path in wrong if path.startswith("spring.")}
    sound = {name: table for name, table in section.spring.items() if name not in faulty}
    return section.model_copy(update={"spring": sound})


def _unknown_names(
    section: MachineSection, urdf_text: str, source: str, wrong: set[str]
) -> list[MachineFileError]:
    """Links and motors' joints that the URDF lacks, no stand-ins; none if it has none."""
    try:
        robot = urdf_faults.parse(urdf_text, source)
    except MachineFileError:
        return []
    kinds, movable = ("link", "joint"), urdf_faults.movable_joints(robot)
    links, joints = ([str(part.get("name")) for part in robot.findall(kind)] for kind in kinds)
    stand_ins = wrong | {f"{key}.{kind}" for key in wrong for kind in kinds}
    faults = unknown_links(section, links, source) if links else []
    faults += unknown_joints(section, joints, movable, source) if joints else []
    return [fault for fault in faults if fault.part.removeprefix(f"{source}: ") not in stand_ins]


def _without_masses(urdf_text: str) -> str:
    """A URDF of the same geometry, for faults of pins and ranges beside faults of masses."""
    try:
        robot = urdf_faults.parse(urdf_text, "")
    except MachineFileError:
        return urdf_text
    for link in robot.findall("link"):
        for inertial in link.findall("inertial"):
            link.remove(inertial)
    return ET.tostring(robot, encoding="unicode")


def _blamed(faults: Iterable[ArmDesignError]) -> set[str]:
    """Names of the cylinders and springs that faults are about."""
    matches = (re.search(r": (?:cylinder|spring)\.([^.]+)", fault.part) for fault in faults)
    return {match[1] for match in matches if match}


def _faults_of_other_cylinders(
    section: MachineSection, urdf_text: str, path: Path, blamed: set[str]
) -> Iterator[MachineFileError]:
    """Faults of the cylinders that are not blamed; joints that only others move stand still."""
    sound_springs = _without_springs(section, {f"spring.{name}" for name in blamed})
    frozen = section.frozen | {one.joint: one.at for one in springs_of(sound_springs)}
    arm = Arm(urdf_text, section.joints, frozen, section.urdf or "", of_links=not section.urdf)
    while sound := {name: table for name, table in section.cylinder.items() if name not in blamed}:
        moved = {j for table in sound.values() for j in linkage(table, arm).joints}
        unmoved = {
            joint.name: (joint.lower + joint.upper) / 2
            for j, joint in enumerate(arm.joints)
            if moved and j not in moved
        }
        others = {name: at for name, at in frozen.items() if name not in section.joints}
        tables = {name: table.model_dump(exclude_none=True) for name, table in sound.items()}
        data = {
            "name": section.name,
            "urdf": section.urdf or "links",
            "joints": [name for name in section.joints if name not in unmoved],
            "frozen": others | unmoved,
            "tool": {"link": next(iter(arm.links)), "at_mm": [0.0, 0.0, 0.0]},
            "payload": {"empty": {"mass_kg": 0.0}},
            "fluid": FLUID,
            "supply": SUPPLY,
            "cylinder": tables,
        }
        machine = Machine.unchecked(dump(data, "what is sound"), urdf_text, path)
        faults = [fault for fault in assembly_faults(machine) if _blamed([fault])]
        yield from faults
        if not faults:
            return
        blamed = blamed | _blamed(faults)
