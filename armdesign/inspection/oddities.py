"""Implausible results of a machine: numbers that a designer would question."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from armdesign.arrays import Array, weighted_share
from armdesign.errors import PoseError
from armdesign.frequency.bands import Bands
from armdesign.frequency.modes import lowest_frequency
from armdesign.hydraulics.actuator import SIDES
from armdesign.hydraulics.cylinder_build import euler_safety
from armdesign.inspection.yardstick import Finding
from armdesign.machine.dead_centres import OVERCOME, QUESTION, SMALL_MOMENT_ARM, dead_centre
from armdesign.machine.file.schema import share_of
from armdesign.machine.poses import STROKE_TOLERANCE, pose_text
from armdesign.machine.tipping import centre_ahead
from armdesign.units import Units, mm, share_text

if TYPE_CHECKING:
    from armdesign.inspection.inspection import Inspection, StaticLoad
    from armdesign.machine.machine import Machine

# head, piston, gland and two eyes of a real cylinder take at least about this, over its bore
DEAD_LENGTH_PER_BORE = 2.2
STROKE_USED = 0.6
RANGE_TOLERANCE = {"rad": 0.01, "m": 0.005}  # by which URDF limit and stroke may differ
PITCH_REACHED = 0.02  # [rad] by which a pitch range may be wider than the workspace
BULK_MODULUS = (400e6, 2200e6)  # [Pa] effective values that have been measured on machines
BAND_TOLERANCE = 0.01  # of a value at the end of its band
AHEAD, MOSTLY = math.cos(math.pi / 4), 0.5  # within 45° of where it heads; of the poses
SQUARE = 0.999  # least part along y of its pins' links of the axis of a cylinder's hinge
UNSTABLE_POSES = 50  # at most at which the cause is looked for
NO_FREQUENCIES = "no natural frequencies"
RODS_SAFETY = 1.0  # Euler load over the supply's thrust

# bands in shares of the file's own value
SHARES = "bulk_modulus", "dead_volume", "payload", "link_mass", "spring_stiffness"

Oddity = tuple[str, str]  # part, words


def oddities(inspection: Inspection, units: Units) -> list[Finding]:
    """Everything odd, cylinders first, then joints, load cases and the rest."""
    machine = inspection.machine
    odd: list[Oddity] = []
    for i in range(len(machine.cylinders)):
        odd += [*_of_cylinder(inspection, i, units), *_of_pins(machine, i)]
    odd += _of_reliefs(machine, units)
    for j in range(len(machine.joints)):
        odd += _of_joint(inspection, j, units)
    for case in machine.payloads:
        odd += _of_load_case(inspection, case.name, units)
    odd += [*_of_idle(machine, units), *_of_heading(inspection), *_of_stability(inspection, units)]
    odd += [*_of_oil_and_loads(inspection), *_of_bands(machine)]
    return [Finding(part=part, words=words) for part, words in odd]


def _of_cylinder(inspection: Inspection, i: int, units: Units) -> Iterator[Oddity]:
    machine, cylinder = inspection.machine, inspection.machine.cylinders[i]
    part, needed = f"cylinder.{cylinder.name}", DEAD_LENGTH_PER_BORE * cylinder.bore
    if cylinder.dead_length < needed:
        words = (
            f"closed length less stroke is {units.text(cylinder.dead_length, 'm')}; head, piston,"
            f" gland and two eyes of a real cylinder take about {DEAD_LENGTH_PER_BORE} × bore ="
            f" {units.text(needed, 'm')}"
        )
        yield f"{part}.closed_length_mm", words
    if (used := inspection.stroke_used(i)) < STROKE_USED:
        cause = "limits of its joint or other cylinders end the motion before it does"
        yield f"{part}.stroke_mm", f"only {100 * used:.0f} % of the stroke is used; {cause}"
    for lever in inspection.levers:
        if lever.cylinder != i or lever.follows:
            continue
        joint = machine.arm.joints[lever.joint]
        at = f"{joint.name} {units.text(lever.least_at, joint.unit)}"
        if lever.turns:
            yield part, f"its moment arm changes sign near {at}: at a dead centre it holds nothing"
        elif lever.least < SMALL_MOMENT_ARM * lever.most:
            share = f"{100 * lever.least / lever.most:.0f} % of its largest at {at}"
            below = f"(below {100 * SMALL_MOMENT_ARM:.0f} %): close to a dead centre"
            yield part, f"its moment arm falls to {share} {below}"
    bore, rod, length = cylinder.bore, cylinder.rod, cylinder.open_length
    pressure = cylinder.available_pressure(machine.supply)
    safety = euler_safety(bore, rod, length, pressure)
    if safety < RODS_SAFETY:
        at = "supply" if pressure == machine.supply.pressure else "its relief's"
        share = f"{100 * safety:.0f} % of the thrust at {at} pressure (Euler, pin to pin)"
        yield f"{part}.rod_mm", f"fully out the rod buckles at {share}"
    sides = {"cap": cylinder.cap_dead_volume, "annulus": cylinder.annulus_dead_volume}
    for side in [side for side, volume in sides.items() if volume == 0][:1]:
        spring = "the spring is infinitely stiff at the end of the stroke"
        words = f"0: ports and lines hold oil, and without it {spring}"
        yield f"{part}.dead_volume_l.{side}", words


def _of_pins(machine: Machine, i: int) -> Iterator[Oddity]:
    """Pins of a cylinder whose links are turned, so that x and z are not in the hinge's plane."""
    arm, linkage = machine.arm, machine.linkages[i]
    zero = arm.zero
    axes = [zero.axis[0, j] for j in linkage.joints if arm.coordinates[j].revolute]
    if not axes:
        return
    links = dict.fromkeys(pin.link for pin in linkage.pins)
    across = {link: arm.link_rotation(zero, link)[0][:, 1] for link in links}
    if turned := [link for link in links if abs(float(across[link] @ axes[0])) < SQUARE]:
        words = "designs and tolerances move pins along x and z of their link; those on"
        out = f"{', '.join(turned)} leave the plane in which the cylinder turns its joint"
        yield f"cylinder.{machine.cylinders[i].name}", f"{words} {out}"


def _of_reliefs(machine: Machine, units: Units) -> Iterator[Oddity]:
    """Port reliefs below the supply's pressure, which no chamber then reaches."""
    supply = machine.supply
    for actuator in machine.actuators:
        pressure = actuator.available_pressure(supply)
        if pressure < supply.pressure:
            opens = f"opens at {units.text(pressure, 'Pa')}, below the supply's"
            counts = "what it lifts, holds and pushes with counts at the relief's pressure"
            words = f"{opens} {units.text(supply.pressure, 'Pa')}: {counts}"
            yield f"{actuator.kind}.{actuator.name}.valve.relief_bar", words


def _of_joint(inspection: Inspection, j: int, units: Units) -> Iterator[Oddity]:
    machine, joint = inspection.machine, inspection.machine.arm.joints[j]
    low, high = machine.ranges[j]
    missing = max(low - joint.lower, joint.upper - high)
    if not joint.without_ends and missing > RANGE_TOLERANCE[joint.unit]:
        allowed = units.span(joint.lower, joint.upper, joint.unit)
        covered = units.span(low, high, joint.unit)
        words = f"its limits allow {allowed}, the strokes cover only {covered}"
        yield f"joint {joint.name}", words
    links = {name for name, link in machine.arm.links.items() if link.joint == j}
    if not links & set(inspection.masses):
        massive = "payload, tools and links further out alone"
        words = f"has no mass: what joint {joint.name} moves is {massive}"
        yield f"link {', '.join(sorted(links))}", words


def _of_load_case(inspection: Inspection, name: str, units: Units) -> Iterator[Oddity]:
    case = inspection.cases[name].machine.payload
    if inspection.share_held(name) == 0:
        words = "has that pitch at no pose of the workspace: the case never exists"
        yield ".".join(case.limit_location), f"link {case.link} {words}"
        return
    if case.limits:
        yield from _of_pitch(inspection, name, units)
    for load in inspection.loads:
        if load.payload == name:
            yield from _of_valve(inspection, load, units)
            yield from _of_pressure(inspection, load, units)
    yield from _of_modes(inspection, name)


def _of_pitch(inspection: Inspection, name: str, units: Units) -> Iterator[Oddity]:
    """A pitch range of which the workspace reaches only a part."""
    case = inspection.cases[name].machine.payload
    low, high = case.limits
    middle, half = (low + high) / 2, (high - low) / 2
    placed = inspection.machine.heading, inspection.workspace.rigid
    inside = case.from_middle(*placed)[case.exists(*placed)]
    if inside.min() > -half + PITCH_REACHED or inside.max() < half - PITCH_REACHED:
        reached = units.span(middle + inside.min(), middle + inside.max(), "rad")
        words = (
            f"of {units.span(low, high, 'rad')} the poses of the workspace reach only {reached}"
        )
        yield ".".join(case.limit_location), words


def _of_valve(inspection: Inspection, load: StaticLoad, units: Units) -> Iterator[Oddity]:
    """A relief, or a load-holding valve, that the load alone presses open."""
    actuator, supply = inspection.machine.actuators[load.cylinder], inspection.machine.supply
    part, holding = f"{actuator.kind}.{actuator.name}", actuator.load_holding
    relief = actuator.relief(supply)
    for side, chamber, largest in zip(SIDES, actuator.chambers, load.largest, strict=True):
        needs = f"under {load.payload} its {chamber} needs {units.text(largest, 'Pa')}"
        if largest > relief:
            way = f"opens at {units.text(relief, 'Pa')} and cannot hold that: the load gives way"
            yield f"{part}.valve.relief_bar", f"{needs} to stand still; its relief {way}"
        if holding is not None and holding.side == side and largest > holding.setting:
            setting = f"more than the setting of {units.text(holding.setting, 'Pa')}"
            way = "the load alone opens it, and is held by the spool, if at all"
            yield f"{part}.load_holding.setting_bar", f"{needs}, {setting}: {way}"


def _of_pressure(inspection: Inspection, load: StaticLoad, units: Units) -> Iterator[Oddity]:
    """A load near or beyond what the supply holds."""
    machine, actuator = inspection.machine, inspection.machine.actuators[load.cylinder]
    limit = share_of(machine.section.requirements.holding_share, actuator.name)
    chamber, pressure = actuator.chambers[not load.cap], units.text(load.pressure, "Pa")
    needs = f"under {load.payload} its {chamber} needs {pressure} to stand still"
    relieved = actuator.available_pressure(machine.supply) < machine.supply.pressure
    if relieved and load.share > 1:  # told of its relief
        return
    words = f"more than the supply's {units.text(machine.supply.pressure, 'Pa')} can hold"
    if load.share <= 1:
        whose = "its relief" if relieved else "supply pressure"
        share = f"{100 * load.share:.0f} % of what {whose} holds"
        words = f"{share} (requirement: {100 * limit:.0f} %)"
    if load.share > min(1, limit):
        yield f"{actuator.kind}.{actuator.name}", f"{needs}, {words}"


def _of_modes(inspection: Inspection, name: str) -> Iterator[Oddity]:
    """Poses without natural frequencies, or without stiffness."""
    case = inspection.cases[name]
    try:
        lowest = lowest_frequency(case.machine.at(case.rigid))
    except PoseError as error:
        yield f"payload.{name}", f"{NO_FREQUENCIES}: {error}"
        return
    if np.any(lowest == 0):
        unstable = weighted_share(lowest == 0, inspection.workspace.weights[case.exists])
        share = f"{share_text(unstable)} of the poses are unstable (0 Hz)"
        why = _why_unstable(case.machine, case.rigid.q[lowest == 0])
        yield f"payload.{name}", f"{share}: {why}"


def _why_unstable(machine: Machine, q: Array) -> str:
    """Why poses (n, nq) are unstable: dead centres, gravity, or both."""
    causes = dict.fromkeys(
        dead_centre(machine, pose) for pose in q[:: len(q) // UNSTABLE_POSES + 1]
    )
    whys = [f"{dead.fault}; {dead.remedy}" for dead in causes if dead]
    if None in causes:
        gravity = f"{OVERCOME}; {QUESTION}"
        whys.append(f"at others {gravity}" if whys else gravity)
    return "; ".join(whys)


def _of_idle(machine: Machine, units: Units) -> Iterator[Oddity]:
    """Values that are not used: of joints that are coordinates, of cylinders at rest."""
    for name in set(machine.section.frozen) & set(machine.section.joints):
        yield f"frozen.{name}", "is not used: the joint is a coordinate"
    for cylinder, linkage in machine.idle_cylinders:
        joints, part = machine.idle[cylinder.name], f"cylinder.{cylinder.name}"
        frozen = f"joint {joints[0]} is" if len(joints) == 1 else f"joints {', '.join(joints)} are"
        so = "so that it moves nothing and no requirement counts for it"
        heavy = f"; its masses are fixed to link {linkage.observer}" * bool(cylinder.moving_masses)
        yield part, f"idle: {frozen} frozen, {so}{heavy}"
        length, closed, open_ = linkage.idle_length(), cylinder.closed_length, cylinder.open_length
        if np.isnan(length):
            yield part, f"its {linkage.title} does not close where it is frozen"
        elif not closed - STROKE_TOLERANCE <= length <= open_ + STROKE_TOLERANCE:
            stroke = units.span(closed, open_, "m")
            yield part, f"where it is frozen it is {units.text(length, 'm')} long, not {stroke}"


def _of_heading(inspection: Inspection) -> Iterator[Oddity]:
    """A tool that is not where its arm points, at most of its poses: beside it, or behind."""
    machine, workspace = inspection.machine, inspection.workspace
    place = machine.arm.point(workspace.rigid, machine.tool.link, np.array(machine.tool.at))
    points, beside = machine.heading.at(workspace.q), np.zeros(len(place), bool)
    for axis in (machine.arm.slews.foot, np.zeros(2)):
        lever = place[:, :2] - axis
        beside |= np.einsum("ni,ni->n", lever, points) < AHEAD * np.hypot(*lever.T)
    if (share := weighted_share(beside, workspace.weights)) > MOSTLY:
        where = (
            "ahead of the slew axis and of the root's z axis, within 45° of where the arm points"
        )
        counted = "reach, lift charts, tipping lines and the default lift share count there alone"
        yield "tool", f"at {share_text(share)} of the poses is not {where}: {counted}"


def _of_stability(inspection: Inspection, units: Units) -> Iterator[Oddity]:
    """Tipping lines beyond which the unloaded machine's own centre of mass lies at some poses."""
    machine, stability = inspection.machine, inspection.machine.section.stability
    centre = centre_ahead(machine, inspection.workspace.rigid)
    if stability is None or centre is None:
        return
    x, y, _ = machine.heading.forward
    if y and stability.at_mm[1]:
        angle = units.text(math.atan2(y, x), "rad")
        where = f"where the arm points, {angle} from the root's x axis"
        words = f"counts ahead of the slew axis alone, {where}; what lies aside is left out"
        yield "stability.at_mm", words
    front, rear = stability.front_mm, stability.rear_mm
    lines = (("front", front, "ahead of", 1), ("rear", rear, "behind", -1))
    for edge, line, where, side in lines:
        beyond = side * centre - line * mm
        worst = int(beyond.argmax())
        if beyond[worst] > 0:
            share = 100 * weighted_share(beyond > 0, inspection.workspace.weights)
            at, past = (units.text(x, "m") for x in (side * centre[worst], beyond[worst]))
            pose = pose_text(machine, inspection.workspace.q[worst], units)
            yield (
                f"stability.{edge}_mm",
                f"unloaded it tips over its {edge} edge at {share:.0f} % of the poses: its centre"
                f" of mass is up to {at} {where} the slew axis, {past} beyond that edge,"
                f" at {pose}",
            )


def _of_oil_and_loads(inspection: Inspection) -> Iterator[Oddity]:
    modulus, (low, high) = inspection.machine.fluid.bulk_modulus, BULK_MODULUS
    if not low <= modulus <= high:
        band = f"[{low / 1e6:g}, {high / 1e6:g}] MPa"
        why = "the range of mineral oil in steel lines and hoses"
        yield "fluid.bulk_modulus_MPa", f"{modulus / 1e6:g} MPa is outside {band}, {why}"
    if all(case.mass == 0 for case in inspection.machine.payloads):
        yield "payload", "every load case is empty: the worst pose of work is not looked at"


def _of_bands(machine: Machine) -> Iterator[Oddity]:
    """Bands that the file's own value is not within."""
    bands, section = Bands.of(machine), machine.section.bands
    own = {f"{name}_share": (getattr(bands, name), 1.0) for name in SHARES}
    if bands.air:
        air = tuple(100 * end for end in bands.air)
        own["entrained_air_percent"] = (air, 100 * machine.fluid.air)
    for actuator in machine.actuators:
        if band := bands.structure_of(actuator.name):
            share = actuator.compliance / actuator.oil_compliance(machine.fluid, machine.supply)
            own[f"structures.{actuator.name}"] = band, share
    for key, ((low, high), value) in own.items():
        if not (1 - BAND_TOLERANCE) * low <= value <= (1 + BAND_TOLERANCE) * high:
            name = key.removeprefix("structures.")
            stated = key if name in section.structures or name == key else "structure"
            whose = f" of {name}" if name != key else ""
            yield (
                f"bands.{stated}",
                f"the file's own value{whose}, {value:.3g}, is not within [{low:.4g}, {high:.4g}]:"
                " what holds at the file's values is outside of what designs are made for",
            )
