"""Faults that the schema cannot state: keys that do not agree, names that do not exist."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from armdesign.errors import ArmDesignError, MachineFileError, choose
from armdesign.hydraulics.valve import RELIEF_SHARE
from armdesign.machine.file.column_names import is_column
from armdesign.machine.file.likely_values import is_usual_at, likely_units
from armdesign.machine.file.link_faults import link_faults
from armdesign.machine.file.numbers import chosen_numbers
from armdesign.machine.file.polygons import CROSSED, IN_ORDER, crosses_itself
from armdesign.machine.file.schema import (
    BY_ACTUATOR,
    DEFAULT,
    CylinderSection,
    MachineSection,
    PayloadSection,
    RequirementsSection,
    SupplySection,
    ValveSection,
)
from armdesign.machine.file.section import DEVICE, Section, plain
from armdesign.machine.parts import pin_sections
from armdesign.mechanism.linkage.kinds import KINDS

TINY = 1e-100  # numbers above zero, whose squares are above it too
Fault = tuple[str, str, str]  # key path, words, remedy


def contradictions(machine: MachineSection, source: str) -> Iterator[MachineFileError]:
    """Every fault of keys that do not agree with each other."""
    faults = _faults(machine)
    return (MachineFileError(f"{source}: {path}", fault, way) for path, fault, way in faults)


def _faults(machine: MachineSection) -> Iterator[Fault]:
    yield from _of_tiny(plain(machine), "")
    yield from _of_names(machine)
    yield from link_faults(machine)
    yield from _of_supply(machine.supply)
    for name, payload in machine.payload.items():
        yield from _of_payload(f"payload.{name}", payload)
    for name, cylinder in machine.cylinder.items():
        yield from _of_cylinder(f"cylinder.{name}", cylinder)
    for name, motor in machine.motor.items():
        path, friction = f"motor.{name}", motor.friction
        yield from _of_hoses(path, motor.hose, motor.trapped_volume_l)
        yield from _of_friction(path, friction.static_N_m, friction.coulomb_N_m, "N m")
    for kind, actuators in (("cylinder", machine.cylinder), ("motor", machine.motor)):
        for name, actuator in actuators.items():
            yield from _of_preload(f"{kind}.{name}.valve", actuator.valve, machine.supply)
    yield from _of_springs(machine)
    yield from _of_lift_chart(machine)
    yield from _of_bands(machine)
    yield from _of_tolerances(machine)
    yield from _of_requirements(machine)


def _of_tiny(node: Any, path: str) -> Iterator[Fault]:
    """Numbers that no machine has, and by which nothing can be divided."""
    if isinstance(node, dict | list):
        for key, item in node.items() if isinstance(node, dict) else enumerate(node):
            yield from _of_tiny(item, f"{path}.{key}" if path else str(key))
    elif isinstance(node, float) and 0 < abs(node) < TINY:
        yield path, f"{node!r} is not allowed", f"give {TINY:g} or more, or 0 where that may be"


def _of_names(machine: MachineSection) -> Iterator[Fault]:
    if len(set(machine.joints)) < len(machine.joints):
        yield "joints", "a joint is named twice", "name each joint once"
    for name in machine.joints:
        if is_column(name, machine.joints, (*machine.cylinder, *machine.motor)):
            yield "joints", f'"{name}" is a column of the CSV files', "rename the joint"
    for name in machine.motor:
        if name in machine.cylinder:
            remedy = "give each actuator a name of its own"
            yield f"motor.{name}", "is the name of a cylinder too", remedy
    if machine.urdf is not None and Path(machine.urdf).name in ("", ".."):
        yield "urdf", f'"{machine.urdf}" is not a file name', "name the URDF"
    for key, name in (("name", machine.name), ("urdf", machine.urdf or "")):
        if DEVICE.fullmatch(Path(name).name):
            yield key, f'"{name}" is a device of Windows, not a file', "give another name"


def _of_lift_chart(machine: MachineSection) -> Iterator[Fault]:
    """Joints that bring the point to its place are coordinates, each named once."""
    joints = machine.lift_chart.joints or [] if machine.lift_chart else []
    for name in joints:
        if name not in machine.joints:
            yield "lift_chart.joints", f'no joint "{name}"', choose(name, machine.joints)
    if len(set(joints)) < len(joints):
        yield "lift_chart.joints", "a joint is named twice", "name each joint once"


def _of_bands(machine: MachineSection) -> Iterator[Fault]:
    """Bands run from their lower to their upper end, and bands of structures name actuators."""
    several, actuators = machine.bands.structures, (*machine.cylinder, *machine.motor)
    bands = {key: band for key, band in machine.bands if key != "structures"}
    for key, band in (bands | {f"structures.{name}": several[name] for name in several}).items():
        if band and not band[0] <= band[1]:
            fault = f"[{band[0]:g}, {band[1]:g}] is in the wrong order"
            yield f"bands.{key}", fault, "give [lower, upper]"
    for name in several:
        if name not in actuators:
            fault = f'no actuator "{name}"'
            yield f"bands.structures.{name}", fault, choose(name, actuators)


def _of_tolerances(machine: MachineSection) -> Iterator[Fault]:
    """Tolerances of single numbers are of numbers that there are."""
    for path in machine.tolerances.keys:
        part = f"tolerances.keys.{path}"
        try:
            chosen_numbers(machine, path, part)
        except ArmDesignError as error:
            yield part, error.fault, error.remedy


def _of_springs(machine: MachineSection) -> Iterator[Fault]:
    """A spring has a joint of its own, and numbers of one that turns or of one that slides."""
    springs = machine.spring
    for name, spring in springs.items():
        path, joint = f"spring.{name}", spring.joint
        turns, slides = spring.stiffness_N_m_per_rad, spring.stiffness_N_per_m
        if (turns is None) == (slides is None):
            words = "neither" if turns is None else "both"
            fault = f"{words} stiffness_N_m_per_rad {'nor' if turns is None else 'and'}"
            remedy = "give the first for a joint that turns, the second for one that slides"
            yield path, f"{fault} stiffness_N_per_m given", remedy
        elif spring.at_mm is not None and slides is None:
            yield f"{path}.at_mm", "is of a joint that slides", "give at_deg"
        elif spring.at_deg is not None and turns is None:
            yield f"{path}.at_deg", "is of a joint that turns", "give at_mm"
        if name in machine.cylinder or name in machine.motor:
            yield path, "is the name of an actuator too", "give the spring a name of its own"
        if used := _use_of(machine, joint):
            yield f"{path}.joint", *used
        if other := next((k for k, s in springs.items() if s.joint == joint and k < name), None):
            yield f"{path}.joint", f'"{joint}" carries spring.{other} too', "choose another joint"


def _use_of(machine: MachineSection, joint: str) -> tuple[str, str] | None:
    """Why a joint can carry no spring, and what to do, in one line; None where it can."""
    for motor, table in machine.motor.items():
        if joint == (table.joint or motor):
            remedy = "choose another joint, or give the motor compliance_rad_per_N_m"
            return f'"{joint}" is driven by motor.{motor}', remedy
    if joint in machine.joints:
        remedy = "take it out of joints, or choose another joint"
        return f'"{joint}" is one of joints, which poses move', remedy
    if joint in machine.frozen:
        return f'"{joint}" is frozen too', "take it out of frozen"
    return None


def _of_supply(supply: SupplySection) -> Iterator[Fault]:
    back = supply.return_pressure_bar
    if back >= supply.pressure_bar:
        keys, remedy = ("supply", "return_pressure_bar"), "give a lower return pressure"
        unit = likely_units(keys, back, is_usual_at(keys))
        if unit and back > 100:
            remedy = f"it looks like {unit.unit}: {unit.remedy}, or {remedy}"
        fault = f"{back:g} bar is not below the supply's {supply.pressure_bar:g} bar"
        yield "supply.return_pressure_bar", fault, remedy


def _of_payload(path: str, payload: PayloadSection) -> Iterator[Fault]:
    if payload.mass_kg > 0 and (payload.link is None or payload.at_mm is None):
        key = "link" if payload.link is None else "at_mm"
        yield f"{path}.{key}", "missing: a mass must sit somewhere", f"add {key}"
    if payload.pitch_deg is not None:
        low, high = payload.pitch_deg
        if not low < high or high - low > 360:
            fault = f"[{low:g}, {high:g}] deg is empty"
            yield f"{path}.pitch_deg", fault, "give [lower, upper] within one turn"
        if payload.link is None:
            yield f"{path}.link", "missing: pitch_deg needs a link", "add link"


def _of_cylinder(path: str, cylinder: CylinderSection) -> Iterator[Fault]:
    bore, rod, closed = cylinder.bore_mm, cylinder.rod_mm, cylinder.closed_length_mm
    slender, keys = bore < closed / 40, ("cylinder", path, "bore_mm")  # as no barrel is
    unit = likely_units(keys, bore, lambda x: slender and 0.3 * x <= rod <= 0.9 * x)
    remedy = f"give a rod in (0, {bore:g}) mm"
    if rod >= bore and unit:
        fault = f"{bore:g} mm looks like {unit.unit}: the rod of {rod:g} mm does not fit it"
        yield f"{path}.bore_mm", fault, f"{unit.remedy}, or {remedy}"
    elif rod >= bore:
        yield f"{path}.rod_mm", f"{rod:g} mm does not fit the bore", remedy
    kinds = [kind.key for kind in KINDS]
    given = [key for key in kinds if getattr(cylinder, key) is not None]
    if len(given) != 1:
        words = f"both {' and '.join(given)}" if given else f"neither {' nor '.join(kinds)}"
        yield f"{path}.{kinds[0]}", f"{words} given", "give exactly one of them"
    friction = cylinder.friction
    yield from _of_hoses(path, cylinder.hose, cylinder.dead_volume_l)
    yield from _of_friction(path, friction.static_N, friction.coulomb_N, "N")


def _of_hoses(path: str, hose: Section, volumes: Section) -> Iterator[Fault]:
    """Hoses hold a share of the oil that the piston does not sweep, not more."""
    for side in type(volumes).model_fields:
        inside, whole = getattr(hose, f"{side}_l"), getattr(volumes, side)
        if inside > whole:
            remedy = f"give a volume in [0, {whole:g}] l"
            yield f"{path}.hose.{side}_l", f"{inside:g} l exceeds the dead volume", remedy


def _of_friction(path: str, static: float, coulomb: float, unit: str) -> Iterator[Fault]:
    if static and static < coulomb:
        key = f"{path}.friction.static_{unit.replace(' ', '_')}"
        fault = f"{static:g} {unit} is below the Coulomb friction"
        yield key, fault, f"give 0 or at least {coulomb:g} {unit}"


def _of_preload(path: str, valve: ValveSection | None, supply: SupplySection) -> Iterator[Fault]:
    """A shut chamber keeps no less than return pressure, and no more than its relief holds."""
    if valve is None or valve.preload_bar is None:
        return
    back, own = supply.return_pressure_bar, valve.relief_bar
    relief = round(RELIEF_SHARE * supply.pressure_bar, 6) if own is None else own
    if not back <= valve.preload_bar < relief:
        low, high = "return pressure", "1.1 × supply pressure" if own is None else "relief_bar"
        remedy = f"give a pressure in [{back:g}, {relief:g}) bar, from {low} to below {high}"
        yield f"{path}.preload_bar", f"{valve.preload_bar:g} bar is not allowed", remedy


def _of_requirements(machine: MachineSection) -> Iterator[Fault]:
    for name, lift in machine.requirements.lift.items():
        if (lift.reach_mm is None) != (lift.height_mm is None):
            key = "reach_mm" if lift.reach_mm is None else "height_mm"
            path = f"requirements.lift.{name}.{key}"
            yield path, "missing: a place has both", f"add {key}"
    for kind, tables in (
        ("outline", machine.requirements.outline),
        ("clearance", machine.requirements.clearance),
    ):
        for name, table in tables.items():
            if crosses_itself(table.points_mm):
                yield f"requirements.{kind}.{name}.points_mm", CROSSED, IN_ORDER
    for path, kind, names in _names_in(machine.requirements):
        known = {
            "cylinder": machine.cylinder,
            "actuator": [*machine.cylinder, *machine.motor],
            "joint": machine.joints,
        }[kind]
        for name in names:
            if name not in known:
                fault = f'no {kind} "{name}"'
                yield f"requirements.{path}", fault, choose(name, known)


def _names_in(requirements: RequirementsSection) -> Iterator[tuple[str, str, Iterable[str]]]:
    """Key path, kind and names of all actuators and joints that requirements name."""
    for key in BY_ACTUATOR:
        if isinstance(shares := getattr(requirements, key), Mapping):
            yield key, "actuator", [name for name in shares if name != DEFAULT]
    if requirements.digging:
        yield "digging.cylinders", "cylinder", requirements.digging.cylinders
    yield "digging_kN", "cylinder", requirements.digging_kN
    yield "pin_boxes_mm", "cylinder", requirements.pin_boxes_mm
    for name, speed in requirements.speed.items():
        for key in ("joint_deg_per_s", "joint_mm_per_s", "cylinder_mm_per_s"):
            yield f"speed.{name}.{key}", key.partition("_")[0], getattr(speed, key)
    for name, lift in requirements.lift.items():
        for key in ("joint_deg", "joint_mm"):
            yield f"lift.{name}.{key}", "joint", getattr(lift, key)
    for name, clearance in requirements.clearance.items():
        yield f"clearance.{name}.cylinders", "cylinder", clearance.cylinders


def unknown_links(
    section: MachineSection, links: Collection[str], source: str
) -> list[MachineFileError]:
    """A fault for every link that the URDF or ``[links]`` does not have."""
    place = "the URDF" if section.urdf else "[links]"
    return [
        MachineFileError(f"{source}: {path}", f'no link "{link}" in {place}', choose(link, links))
        for path, link in _links(section)
        if link is not None and link not in links
    ]


def _links(section: MachineSection) -> Iterator[tuple[str, str | None]]:
    """Every link that a machine file names, with its key path."""
    requirements = section.requirements
    for link in requirements.outline:
        yield "requirements.outline", link
    for name, case in section.payload.items():
        yield f"payload.{name}.link", case.link
    yield "tool.link", section.tool.link
    if section.lift_chart is not None:
        yield "lift_chart.link", section.lift_chart.link
    for name, lift in requirements.lift.items():
        yield f"requirements.lift.{name}.link", lift.link
    for name, clearance in requirements.clearance.items():
        yield f"requirements.clearance.{name}.link", clearance.link
    for name, cylinder in section.cylinder.items():
        for key, pin in pin_sections(cylinder).items():
            yield f"cylinder.{name}.{key}.link", pin.link


def unknown_joints(
    section: MachineSection, joints: Collection[str], movable: Collection[str], source: str
) -> list[MachineFileError]:
    """A fault for every motor on a joint that the URDF or ``[links]`` does not have."""
    place = "the URDF" if section.urdf else "[links]"
    named = {f"{source}: motor.{name}.joint": m.joint or name for name, m in section.motor.items()}
    return [
        MachineFileError(path, f'no joint "{joint}" in {place}', choose(joint, movable))
        for path, joint in named.items()
        if joint not in joints
    ]
