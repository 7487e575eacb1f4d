"""Faults that only the assembled machine shows: a joint without drive, a four-bar, no range."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from armdesign.errors import MachineFileError
from armdesign.machine.poses import is_singular
from armdesign.machine.range_causes import Cause, Own, cause_of
from armdesign.mechanism.joint_ranges import joint_ranges
from armdesign.mechanism.urdf_faults import line_of, parse
from armdesign.units import deg, mm

if TYPE_CHECKING:
    from armdesign.machine.machine import Machine


def assembly_faults(machine: Machine) -> Iterator[MachineFileError]:
    """Every fault of the drives; where there is none, every fault of the joint ranges."""
    faults = list(_of_drives(machine))
    yield from faults or _of_ranges(machine)


def _of_drives(machine: Machine) -> Iterator[MachineFileError]:
    """Cylinders that span no joint, odd linkages, motors that turn nothing, undriven joints."""
    source, arm = machine.source.name, machine.arm
    for cylinder, linkage in zip(machine.cylinders, machine.linkages, strict=True):
        where = f"{source}: cylinder.{cylinder.name}"
        if not linkage.joints:
            remedy = "put its pins on links that move to each other"
            yield MachineFileError(where, "no joint lies between its pins", remedy)
        elif fault := linkage.fault(where):
            yield fault
    for motor in machine.motors:
        if not arm.joints[arm.names.index(motor.joint)].revolute:
            where = f"{source}: motor.{motor.name}"
            yield MachineFileError(where, f'"{motor.joint}" does not turn', "use a cylinder")
    yield from _of_springs(machine)
    driven = {j for drive in machine.drives for j in drive.joints}
    for j, joint in enumerate(arm.joints):
        if j not in driven:
            problem = f'no cylinder or motor moves "{joint.name}"'
            yield MachineFileError(f"{source}: joints", problem, "add one or freeze the joint")


def _of_springs(machine: Machine) -> Iterator[MachineFileError]:
    """Springs on joints of another kind, standing beyond their limits, or between pins."""
    source, arm = machine.source.name, machine.arm
    for index, spring in enumerate(machine.springs, len(arm.joints)):
        where, joint = f"{source}: spring.{spring.name}", arm.coordinates[index]
        for cylinder, linkage in zip(machine.cylinders, machine.linkages, strict=True):
            if index in linkage.joints:
                problem = f'"{joint.name}" lies between the pins of cylinder.{cylinder.name}'
                remedy = "a spring's joint is driven by nothing: choose another, or move the pins"
                yield MachineFileError(f"{where}.joint", problem, remedy)
        if joint.revolute != spring.revolute:
            moves, meant = ("turns", "N_m_per_rad") if joint.revolute else ("slides", "N_per_m")
            remedy = f"give stiffness_{meant}, and at_{'deg' if joint.revolute else 'mm'}"
            problem = f'"{joint.name}" {moves}'
            yield MachineFileError(f"{where}.{spring.stiffness_key}", problem, remedy)
        elif not joint.lower <= spring.at <= joint.upper:
            key, unit = ("at_deg", deg) if joint.revolute else ("at_mm", mm)
            low, high = joint.lower / unit, joint.upper / unit
            problem = f'{spring.at / unit:g} is outside the limits of "{joint.name}"'
            remedy = f"give {key} in [{low:g}, {high:g}], or widen the limits in the URDF"
            yield MachineFileError(f"{where}.{key}", problem, remedy)


def _of_ranges(machine: Machine) -> Iterator[MachineFileError]:
    """Joints without a range; else cylinders that leave a motion free amid all ranges."""
    source = machine.source.name
    try:
        middle = machine.ranges.mean(axis=1)[None]
    except MachineFileError:
        pairs = list(zip(machine.linkages, machine.cylinders, strict=True))
        for j in range(len(machine.joints)):
            own = [(linkage, cylinder) for linkage, cylinder in pairs if linkage.joints == (j,)]
            linkages, cylinders = tuple(k for k, _ in own), tuple(c for _, c in own)
            try:
                joint_ranges(machine.arm, linkages, cylinders, 0.0, source)
            except MachineFileError as error:
                yield from _with_cause(machine, j, own, error)
        return
    arms = machine.evaluate(machine.rigid_poses(middle)).moment_arms[..., : len(machine.joints)]
    if is_singular(arms)[0]:
        problem = "cylinders and motors leave a direction of motion free"
        yield MachineFileError(f"{source}: cylinder", problem, "check the pins")


def _with_cause(
    machine: Machine, j: int, own: Own, error: MachineFileError
) -> Iterator[MachineFileError]:
    """A joint without a range, with its likely cause; one in the URDF is a fault of its own."""
    cause = cause_of(machine.arm, j, own, faulty=True)
    if cause is None:
        yield error
    elif cause.in_urdf:
        part, line = place_in_urdf(machine, j, cause)
        yield MachineFileError(part, f"{cause.words}; now {error.problem}", cause.remedy, line)
        yield error
    else:
        source = f"{machine.source.name}: "
        problem = f"{cause.words}: {error.part.removeprefix(source)}: {error.problem}"
        yield MachineFileError(source + cause.path, problem, f"{cause.remedy}, or {error.remedy}")


def place_in_urdf(machine: Machine, j: int, cause: Cause) -> tuple[str, int | None]:
    """Part and line of a cause in the URDF: a joint's axis or limits, or the whole file."""
    source, name = machine.section.urdf, machine.joints[j]
    if cause.path == "urdf":
        return source, None
    joints = parse(machine.urdf_text, source).findall("joint")
    joint = next(element for element in joints if element.get("name") == name)
    element = joint.find({"axis": "axis", "limits": "limit"}[cause.path])
    return f"{source}: joint {name}", line_of(joint if element is None else element)
