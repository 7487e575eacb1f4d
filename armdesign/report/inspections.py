"""Sheets of an inspected machine file: its properties and implausible values."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from armdesign.design.catalogue.sizes import refuse_shared_joints, sizes_and_grid
from armdesign.design.requirements.candidate import CHECKED_POSES, reference_of
from armdesign.design.requirements.holding import lift_pose
from armdesign.design.requirements.places import HELD, clearances, pins_outside
from armdesign.design.requirements.settings import Requirements
from armdesign.errors import ArmDesignError
from armdesign.inspection.oddities import NO_FREQUENCIES
from armdesign.report.lift_charts import lift_charts, lift_sheet
from armdesign.report.performance import performance_sheet
from armdesign.report.sheet import Sheet, dimensions
from armdesign.units import WORKSHOP, Units

if TYPE_CHECKING:
    from armdesign.inspection.inspection import Inspection
    from armdesign.machine.machine import Machine


def lift_faults(machine: Machine) -> Iterator[ArmDesignError]:
    """Every lift of the file at which its machine cannot stand, so that designs are refused."""
    requirements = Requirements.of(machine)
    for lift in requirements.lifts:
        try:
            lift_pose(machine, lift, requirements.holding_share)
        except ArmDesignError as error:
            yield error


def check_sheets(inspection: Inspection, units: Units = WORKSHOP) -> list[Sheet]:
    """Properties of a machine, and implausible values: first where others may follow from them."""
    implausible = [_implausible(inspection, units)]
    sheets = [
        _summary(inspection, units),
        _masses(inspection, units),
        _joints(inspection, units),
        _cylinders(inspection, units),
        *([_motors(inspection, units)] if inspection.machine.motors else []),
        *([_springs(inspection, units)] if inspection.machine.springs else []),
        _levers(inspection, units),
        performance_sheet({"value": inspection.machine}, units),
        _static_loads(inspection, units),
        lift_sheet(lift_charts({inspection.machine.name: inspection.machine}), units),
    ]
    return [*implausible, *sheets] if inspection.suspicions else [*sheets, *implausible]


def _summary(inspection: Inspection, units: Units) -> Sheet:
    machine, tool = inspection.machine, inspection.tool
    (near, low), (far, high) = tool.min(axis=0), tool.max(axis=0)
    supply, fluid = machine.supply, machine.fluid
    frozen = [name for name in machine.section.frozen if name not in machine.joints]
    air = f", {100 * fluid.air:g} % air" if fluid.air else ""
    joints = ", ".join(machine.joints) + (f"; frozen: {', '.join(frozen)}" if frozen else "")
    reach = f"reach {near:.2f} to {far:.2f} m, height {low:.2f} to {high:.2f} m"
    pressures = (units.text(p, "Pa") for p in (supply.pressure, supply.return_pressure))
    oil = f"bulk modulus {fluid.bulk_modulus / 1e6:g} MPa{air}, density {fluid.density:g} kg/m³"
    rows = (
        ("joints", joints),
        ("tool", f"on {machine.tool.link}; {reach}"),
        ("supply", f"{', return '.join(pressures)}, {units.text(supply.flow, 'm³/s')}"),
        ("oil", oil),
    )
    title = f"{machine.section.title or machine.name} ({machine.source.name})"
    return Sheet(title=title, rows=rows)


def _masses(inspection: Inspection, units: Units) -> Sheet:
    machine, rows = inspection.machine, []

    def carrier(link: str) -> str:
        joint = machine.arm.links[link].joint
        return machine.arm.coordinates[joint].name if joint >= 0 else "fixed"

    for link, mass in inspection.masses.items():
        rows.append((f"link {link}", mass, carrier(link)))
    cylinders = [(cylinder, "") for cylinder in machine.cylinders]
    cylinders += [(cylinder, carrier(k.observer)) for cylinder, k in machine.idle_cylinders]
    for cylinder, where in cylinders:
        rows += [
            (f"{cylinder.name} {bar}", mass, where) for bar, mass in cylinder.moving_masses.items()
        ]
    for payload in machine.payloads:
        where = f"on {payload.link}" if payload.link else ""
        if payload.limits:
            held = 100 * inspection.share_held(payload.name)
            low, high = payload.limits
            where += f", pitch {units.span(low, high, 'rad')}: {held:.0f} % of the poses"
        rows.append((f"payload {payload.name}", payload.mass, where))
    bare = [cylinder.name for cylinder, _ in cylinders if not cylinder.moving_masses]
    note = f"no mass given for cylinder{'s' * (len(bare) > 1)} {', '.join(bare)}" * bool(bare)
    heads = ("part", "mass [kg]", "where")
    parts, masses, carriers = zip(*rows, strict=True)
    shown = zip(parts, units.numbers(masses, "kg", 1), carriers, strict=True)
    return Sheet(title="Masses", columns=heads, rows=tuple(shown), note=note)


def _joints(inspection: Inspection, units: Units) -> Sheet:
    machine, rows = inspection.machine, []
    for j, joint in enumerate(machine.arm.joints):
        unit = joint.unit
        low, high = machine.ranges[j]
        ends = [inspection.ended_by(j, end) for end in (0, 1)]
        rows.append((joint.name, units.text(low, unit), ends[0], units.text(high, unit), ends[1]))
    return Sheet(
        title="Joint ranges",
        columns=("joint", "from", "ended by", "to", "ended by"),
        rows=tuple(rows),
        note="in, out: end stop of that cylinder",
    )


def _cylinders(inspection: Inspection, units: Units) -> Sheet:
    rows = []
    for i, cylinder in enumerate(inspection.machine.cylinders):
        dead, used = units.number(cylinder.dead_length, "m"), 100 * inspection.stroke_used(i)
        rows.append((cylinder.name, *dimensions(cylinder, units), dead, f"{used:.0f} %"))
    return Sheet(
        title=f"Cylinders [{units.name('m')}]",
        columns=("cylinder", "bore", "rod", "stroke", "closed", "dead length", "stroke used"),
        rows=tuple(rows),
        note="dead length: closed length less stroke",
    )


def _motors(inspection: Inspection, units: Units) -> Sheet:
    machine, rows = inspection.machine, []
    for motor in machine.motors:
        speed = machine.supply.flow / motor.bore_area
        dead = (motor.cap_dead_volume, motor.annulus_dead_volume)
        sides = (units.text(volume, "m³") for volume in dead)
        most = (
            units.text(motor.bore_area * motor.available_pressure(machine.supply), "N m"),
            units.text(speed, "rad/s"),
        )
        rows.append((motor.name, motor.joint, f"{motor.gear_ratio:g}", *sides, *most))
    heads = ("motor", "joint", "gear ratio", "oil volume a", "oil volume b")
    most_heads = ("torque at supply", "speed at full flow")
    return Sheet(title="Motors", columns=(*heads, *most_heads), rows=tuple(rows))


def _springs(inspection: Inspection, units: Units) -> Sheet:
    rows = []
    for spring, least in zip(inspection.machine.springs, inspection.least_stiffness, strict=True):
        numbers = (f"{number:.4g}" for number in (spring.stiffness, least))
        at = units.text(spring.at, "rad" if spring.revolute else "m")
        unit, damping = spring.stiffness_unit, f"{spring.damping_ratio:g}"
        rows.append((spring.name, spring.joint, *numbers, unit, at, damping))
    return Sheet(
        title="Springs: structure that yields",
        columns=("spring", "joint", "stiffness", "least", "unit", "at rest at", "damping ratio"),
        rows=tuple(rows),
        note="least: what gravity needs over the workspace, the other springs as they are",
    )


def _levers(inspection: Inspection, units: Units) -> Sheet:
    machine, rows = inspection.machine, []
    for lever in inspection.levers:
        joint = machine.arm.joints[lever.joint]
        unit, even = ("m/rad" if joint.revolute else "m/m"), lever.most - lever.least < 1e-9
        cells = []
        least = 0.0 if lever.turns else lever.least
        for arm, at in ((least, lever.least_at), (lever.most, lever.most_at)):
            where = "everywhere" if even else units.text(at, joint.unit)
            cells += [units.number(arm, unit), where]
        rows.append((machine.cylinders[lever.cylinder].name, joint.name, *cells))
    per = f"[{units.name('m/rad')}]"
    slides = any(not machine.arm.joints[lever.joint].revolute for lever in inspection.levers)
    notes = ["of a sliding joint: cylinder travel per joint travel"] if slides else []
    notes += ["0: changes sign near there"] if any(one.turns for one in inspection.levers) else []
    return Sheet(
        title="Moment arms",
        columns=("cylinder", "about joint", f"least {per}", "at", f"largest {per}", "at"),
        rows=tuple(rows),
        note="; ".join(notes),
    )


def _static_loads(inspection: Inspection, units: Units) -> Sheet:
    rows = []
    for load in inspection.loads:
        actuator = inspection.machine.actuators[load.cylinder]
        name, side = actuator.name, actuator.chambers[not load.cap]
        share = f"{100 * load.share:.0f} %" if load.share < 10 else "> 1000 %"
        rows.append((name, load.payload, side, units.number(load.pressure, "Pa"), share))
    valves = ((one.name, one.valve) for one in inspection.machine.actuators)
    leaking = ", ".join(name for name, valve in valves if valve and valve.leaks)
    but = f" (not of {leaking}: flow at rest through the valve makes others)" if leaking else ""
    return Sheet(
        title="Largest static loads over the workspace",
        columns=("cylinder", "payload", "side", f"pressure [{units.name('Pa')}]", "of capacity"),
        rows=tuple(rows),
        note=(
            "pressure of the loaded chamber behind a shut valve, with the other at return pressure"
            f" or the valve's preload_bar, as at the start of a simulation{but}; of capacity:"
            " static force over the force of supply (or a lower relief) against return pressure"
        ),
    )


def _implausible(inspection: Inspection, units: Units) -> Sheet:
    rows = tuple((finding.part, finding.words) for finding in inspection.findings(units))
    machine = inspection.machine
    requirements = Requirements.of(machine)
    for fault in pins_outside(machine, requirements.outlines):
        part = fault.part.removeprefix(f"{machine.source.name}: ")
        rows += ((part, f"{fault.fault}: {fault.remedy}; until then designs are refused"),)
    rows += tuple(_without_catalogue(machine))
    rows += tuple(_too_near(machine, requirements, units))
    note = "not errors: the file can be used, but check these numbers" if rows else ""
    if any(words.startswith(NO_FREQUENCIES) for _, words in rows):
        note = "map, design and all other commands that need natural frequencies refuse the file"
    return Sheet(
        title="Implausible values" if rows else "No implausible values", rows=rows, note=note
    )


def _without_catalogue(machine: Machine) -> Iterator[tuple[str, str]]:
    """A catalogue of the file from which this machine's sizes cannot be chosen."""
    if sizes_and_grid(machine, None)[0] is None:
        return
    try:
        refuse_shared_joints(machine)
    except ArmDesignError as error:
        words = f"{error.fault}: {error.remedy}; until then designs are refused"
        yield "requirements.catalogue", words


def _too_near(
    machine: Machine, requirements: Requirements, units: Units
) -> Iterator[tuple[str, str]]:
    """Barrels nearer to a part today than ``[requirements.clearance]`` allows."""
    if not requirements.clearances:
        return
    reference = reference_of(machine, requirements, CHECKED_POSES)
    for each in clearances(reference.old, reference):
        least = float(each.value.real.min())
        if least < each.limit - HELD:
            today = f"{units.text(least, 'm')} today, at least {units.text(each.limit, 'm')} asked"
            inside = " (negative: into it)" * (least < 0)
            words = f"{each.words}: {today}{inside}; a design must move its pins away"
            yield f"requirements.{each.setting}", words
