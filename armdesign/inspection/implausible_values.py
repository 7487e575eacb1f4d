"""Numbers that are most likely in another unit than their key's or URDF's, and reversed axes.

Lengths are judged by other lengths of the same machine: a pin in metres lies a thousandth of its
link away from the joint. Pressures, oil and flow are judged by what machines have
(``likely_values.USUAL``), masses by other masses. A finding says the line of the file.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from armdesign.hydraulics.actuator import Cylinder
from armdesign.inspection.yardstick import Finding, Yardstick
from armdesign.machine.assembly_faults import TURN, cause_of, place_in_urdf
from armdesign.machine.file.likely_values import USUAL, is_usual_at, likely_units, rounded
from armdesign.machine.machine import Machine
from armdesign.mechanism.urdf_faults import line_of, numbers
from armdesign.units import deg, mm


def suspicions(machine: Machine, shares: Mapping[str, float]) -> list[Finding]:
    """Numbers most likely in another unit, and reversed axes, the URDF first; one of each part.

    Args:
        machine: that can be used.
        shares: by actuator, its largest static force over what the supply holds; without them
            fewer masses, pressures and bores are doubted.
    """
    yardstick = Yardstick(machine, shares)
    kinds = of_urdf, of_joints, of_places, of_cylinders
    findings = [finding for kind in kinds for finding in kind(yardstick)]
    # with other lengths the loads are others
    masses = () if findings else (of_masses,)
    for kind in (of_usual, *masses, of_motors, of_angles, of_flow):
        findings += kind(yardstick)
    return list({finding.part: finding for finding in reversed(findings)}.values())[::-1]


Range = tuple[float, float]

# a pin in metres lies at most NEAR of its link's size away, and a thousand times that is at least
# CLOSE of it
NEAR, CLOSE = 1.5e-3, 0.02
THIN = 1 / 400  # bore over the largest distance of the pins, if in metres
SLENDER: Range = (1 / 120, 1 / 2)  # plausible
OVERLOADED = 3.0  # static force over what the supply holds, for a bore in centimetres or inches
DEAD: Range = (0.02, 30.0)  # dead volume over swept volume: plausible
FAR_FROM_DEAD: Range = (2e-3, 40.0)  # implausible outside
FIRST = 2e-3  # static share of the only mass
VALVE = 1 / 50  # rated flow over the pump's: implausible below
VALVES: Range = (0.05, 5.0)  # plausible
PER_TURN: Range = (0.05, 500.0)  # trapped volume of a motor over its displacement
SLOW, QUICK = 300.0, 60.0  # [s] to fill all cylinders by a small pump; if its flow is in l/s
SMALL_PUMP = 30.0  # [l/min]
LIGHT, HEAVY = 1e-3, 100.0  # payload over the mass of all links
TIGHT = 6.3  # [deg] a range of pitch below which is one in radians


def of_usual(yardstick: Yardstick) -> Iterator[Finding]:
    """Numbers outside of what machines have that are inside it in another unit."""
    for path, value in yardstick.values.items():
        keys = tuple(path.split("."))
        if keys[-1] not in USUAL or isinstance(value, str) or not value:
            continue
        if not is_usual_at(keys)(value) and not _is_allowed_odd(yardstick, path, value):
            yield from yardstick.in_other_unit(path, is_usual_at(keys))


def _is_allowed_odd(yardstick: Yardstick, path: str, value: float) -> bool:
    """Whether a number outside of what machines have is right in some machines."""
    key = path.rpartition(".")[2]
    if key == "return_pressure_bar":
        return value < 100
    if key == "bulk_modulus_MPa":  # hoses are as soft as they are
        return value > 20 and not path.startswith("fluid.")
    if path == "supply.pressure_bar":  # a rig of low pressure that holds its loads
        return 5 < value < 100 and yardstick.largest_share <= 1
    if not key.endswith("flow_l_per_min") or _filling_time(yardstick) >= SLOW:
        return False  # else a small model's cylinders work with it: the pump's, or a valve's
    pump = yardstick.machine.section.supply.flow_l_per_min
    return key == "flow_l_per_min" or _within(value / pump, VALVES)


def of_masses(yardstick: Yardstick) -> Iterator[Finding]:
    """Payloads in t or g beside the links."""
    given = (mass for mass in yardstick.urdf.iter("mass") if mass.get("value") is not None)
    links = sum(float(numbers(mass, "value", "0")[0]) for mass in given)
    share = yardstick.largest_share
    for name, payload in yardstick.machine.section.payload.items():
        path, mass = f"payload.{name}.mass_kg", payload.mass_kg
        if not links:  # judged by what the supply holds
            if mass > 0 and 0 < share < FIRST:
                yield from yardstick.in_other_unit(
                    path,
                    lambda x, own=mass: 0.02 < share * x / own < 2,  # type: ignore[misc]
                    f"the supply holds {mass / share:.3g} kg",
                )
        elif 0 < mass / links < LIGHT or (mass / links > HEAVY and share > OVERLOADED):
            why = f"the links weigh {links:.4g} kg"
            yield from yardstick.in_other_unit(path, lambda x: 0.01 < x / links < 5, why)


def of_places(yardstick: Yardstick) -> Iterator[Finding]:
    """Pins, loads, tool, outlines and boxes in metres."""
    for path, value in yardstick.values.items():
        table, _, key = path.rpartition(".")
        if key in ("at_mm", "points_mm") and isinstance(value, list | tuple):  # not of a slide
            link = (
                yardstick.values.get(f"{table}.link") or table.rpartition(".")[2]
            )  # an outline's
            size = yardstick.size(link)
            points = value if key == "points_mm" else [value]
            far = max(math.hypot(*point) for point in points) * mm
            if 0 < far <= NEAR * size and far >= CLOSE * NEAR * size:
                words = f"{value} mm looks like metres (the link is {size:.3g} m long)"
                yield yardstick.finding(path, words, f"write {_thousandfold(value)}")
        elif key in ("reach_mm", "height_mm"):
            yield from _of_distance(yardstick, path, 1e-6, 5.0)
        elif key == "pin_box_mm" or ".pin_boxes_mm." in path:
            yield from _of_distance(yardstick, path, 1e-5, 0.5)


def _of_distance(
    yardstick: Yardstick, path: str, smallest: float, largest: float
) -> Iterator[Finding]:
    """A distance in metres: plausible up to a share ``largest`` of the machine's size."""
    value, whole = abs(yardstick.values[path]), yardstick.largest_size
    odd = smallest * whole < value * mm < mm * largest * whole and value < 20
    if odd and _is_far_too_small(yardstick, path, value):
        yield from yardstick.in_other_unit(path, lambda x: abs(x) * mm < largest * whole)


def _is_far_too_small(yardstick: Yardstick, path: str, value: float) -> bool:
    """Whether a box or reach [mm] is a thousandth of the usual; a height's reach counts."""
    if path.endswith("height_mm"):
        path = path.replace("height", "reach")
        value = float(yardstick.values.get(path, 1e9))
    return value * mm < yardstick.largest_size / (100 if path.endswith("reach_mm") else 5e3)


def of_cylinders(yardstick: Yardstick) -> Iterator[Finding]:
    """Diameters, walls and oil that do not go with the cylinder's own lengths."""
    for i, cylinder in enumerate(yardstick.machine.cylinders):
        path, span, factor = f"cylinder.{cylinder.name}.bore_mm", yardstick.span(i), 1.0
        plausible = _plausible_bore(cylinder, span, yardstick.shares.get(cylinder.name, 0.0))
        if other := likely_units(tuple(path.split(".")), cylinder.bore / mm, plausible):
            factor = other.values[0] * mm / cylinder.bore
            why = f"the pins are up to {span / mm:.4g} mm apart"
            yield from yardstick.in_other_unit(path, plausible, why)
        yield from _of_rod(yardstick, cylinder, factor * cylinder.bore)
        if cylinder.stroke > 0.02 * span:  # else the stroke is in another unit
            yield from _of_dead_volumes(yardstick, cylinder, factor)


def _plausible_bore(cylinder: Cylinder, span: float, share: float) -> Callable[[float], bool]:
    """Whether another bore [mm] is likelier than a thin one, or one too slim for its load."""
    bore = cylinder.bore
    thin, slim = bore < THIN * span, bore < span / 90 and share > OVERLOADED
    return lambda x: (
        (thin or (slim and share < (x * mm / bore) ** 2)) and _within(x * mm / span, SLENDER)
    )


def _of_rod(yardstick: Yardstick, cylinder: Cylinder, bore: float) -> Iterator[Finding]:
    """The rod and the wall beside the likely bore [m]."""
    path, why = f"cylinder.{cylinder.name}", f"the bore is {bore / mm:.4g} mm"
    if cylinder.rod < bore / 8:
        yield from yardstick.in_other_unit(
            f"{path}.rod_mm", lambda x: 0.4 < x * mm / bore < 0.9, why
        )
    wall = cylinder.barrel_wall
    if wall is not None and wall < bore / 300:
        yield from yardstick.in_other_unit(
            f"{path}.barrel_wall_mm", lambda x: 0.02 < x * mm / bore < 0.5, why
        )


def _of_dead_volumes(yardstick: Yardstick, cylinder: Cylinder, factor: float) -> Iterator[Finding]:
    """Dead volumes beside the swept ones, of a bore ``factor`` times as large as it stands."""
    sides = {
        "cap": (cylinder.bore_area, cylinder.cap_dead_volume),
        "annulus": (cylinder.annulus_area, cylinder.annulus_dead_volume),
    }
    for side, (area, volume) in sides.items():
        swept = area * factor**2 * cylinder.stroke
        if volume > 0 and not _within(volume / swept, FAR_FROM_DEAD):
            yield from yardstick.in_other_unit(
                f"cylinder.{cylinder.name}.dead_volume_l.{side}",
                lambda x, swept=swept: _within(x / 1e3 / swept, DEAD),  # type: ignore[misc]
                f"the piston sweeps {1e3 * swept:.3g} l",
            )


def of_motors(yardstick: Yardstick) -> Iterator[Finding]:
    """Trapped volumes beside the displacement."""
    for name, motor in yardstick.machine.section.motor.items():
        turn = motor.count * motor.displacement_cm3 / 1e3
        if not is_usual_at(("displacement_cm3",))(motor.displacement_cm3):
            continue
        for side in ("a", "b"):
            if not _within(getattr(motor.trapped_volume_l, side) / turn, PER_TURN):
                yield from yardstick.in_other_unit(
                    f"motor.{name}.trapped_volume_l.{side}",
                    lambda x, turn=turn: 0.2 < x / turn < 200,  # type: ignore[misc]
                    f"the motor takes {turn:.3g} l per turn",
                )


def of_angles(yardstick: Yardstick) -> Iterator[Finding]:
    """Pitches, transmission angles and poses in radians under keys in degrees."""
    section = yardstick.machine.section
    for name, payload in section.payload.items():
        ends = payload.pitch_deg or [0.0, 360.0]
        if max(map(abs, ends)) < TIGHT and ends[1] - ends[0] < TIGHT:
            low, high = (rounded(end / deg) for end in ends)
            words = f"[{ends[0]:g}, {ends[1]:g}] deg looks like radians"
            yield yardstick.finding(f"payload.{name}.pitch_deg", words, f"write [{low}, {high}]")
    if 0 < section.requirements.transmission_deg < 1.6:
        yield from yardstick.in_other_unit("requirements.transmission_deg", lambda x: 2 < x <= 90)
    for name, lift in section.requirements.lift.items():
        yield from _of_pose(yardstick, f"requirements.lift.{name}.joint_deg", lift.joint_deg)


def _of_pose(yardstick: Yardstick, path: str, joints: Mapping[str, float]) -> Iterator[Finding]:
    """Joints that stand out of their ranges in degrees, and all within them in radians."""
    ranges = dict(zip(yardstick.machine.joints, yardstick.machine.ranges, strict=True))
    pairs = [(value, ranges[name]) for name, value in joints.items() if name in ranges]

    def inside(unit: float) -> bool:
        return all(low - 0.01 <= value * unit <= high + 0.01 for value, (low, high) in pairs)

    if pairs and not inside(deg) and inside(1.0):
        radians = ", ".join(f"{name} = {rounded(value / deg)}" for name, value in joints.items())
        yield yardstick.finding(path, "looks like radians", f"write {{ {radians} }}")


def of_flow(yardstick: Yardstick) -> Iterator[Finding]:
    """A pump flow in l/s: a small pump that needs minutes to fill the cylinders."""
    pump, seconds = yardstick.machine.section.supply.flow_l_per_min, _filling_time(yardstick)
    is_small = is_usual_at(("flow_l_per_min",))(pump) and pump < SMALL_PUMP
    if is_small and SLOW < seconds < 60 * QUICK:
        words = f"{rounded(pump)} l/min looks like l/s ({seconds:.0f} s to fill the cylinders)"
        yield yardstick.finding("supply.flow_l_per_min", words, f"write {rounded(60 * pump)}")
    for path, value in yardstick.values.items():
        small = path.endswith(".rated_flow_l_per_min") and value < VALVE * pump
        if small and is_usual_at(tuple(path.split(".")))(value):
            yield from yardstick.in_other_unit(
                path, lambda x: _within(x / pump, VALVES), f"the pump gives {pump:g} l/min"
            )


def _filling_time(yardstick: Yardstick) -> float:
    """Time [s] in which the pump fills all cylinders."""
    volume = sum(c.bore_area * c.stroke for c in yardstick.machine.cylinders)
    return 60e3 * volume / yardstick.machine.section.supply.flow_l_per_min


def _within(value: float, ends: Range) -> bool:
    return ends[0] <= value <= ends[1]


def _thousandfold(value: Any) -> str:
    """A number, or lists of numbers, times 1000."""
    if isinstance(value, list):
        return "[" + ", ".join(map(_thousandfold, value)) + "]"
    return rounded(1e3 * value)


# -------------------------------------------------------------------------------------------- URDF


STOUT = 5.0  # radius of gyration over the size of a link


def of_urdf(yardstick: Yardstick) -> Iterator[Finding]:
    """Lengths in mm, angles in degrees, masses and inertias that do not go together."""
    section, urdf = yardstick.machine.section, yardstick.urdf
    if yardstick.in_millimetres:
        words = "its lengths look like millimetres beside the cylinders' lengths: divide them by"
        yield Finding(part=str(section.urdf), words=f"{words} 1000")
    for name, link in section.links.items():
        yield from _of_turn(yardstick, f"links.{name}.turn_deg", link.turn_deg or [])
    for element in () if section.links else (*urdf.findall("joint"), *urdf.findall("link")):
        for origin in element.iter("origin"):
            angles = numbers(origin, "rpy", "0 0 0")
            if np.any(np.abs(angles) > TURN):
                radians = " ".join(rounded(float(angle) * deg) for angle in angles)
                words = f'rpy="{origin.get("rpy")}" looks like degrees: write rpy="{radians}"'
                part = f"{element.tag} {element.get('name')}"
                yield Finding(part=part, words=f"{words} (line {line_of(origin)})")
    types = {joint.get("name"): joint.get("type") for joint in urdf.findall("joint")}
    for name, value in section.frozen.items():
        if types.get(name, "prismatic") != "prismatic" and abs(value) > TURN:
            words = f"{value:g} rad looks like degrees"
            yield yardstick.finding(f"frozen.{name}", words, f"write {rounded(value * deg)}")
    yield from _of_inertias(yardstick)


def _of_turn(yardstick: Yardstick, path: str, angles: list[float]) -> Iterator[Finding]:
    """Angles of a link's frame that are quarters of a turn in radians."""
    quarters = [angle / (math.pi / 2) for angle in angles if angle]
    if quarters and all(abs(quarter - round(quarter)) < 1e-3 for quarter in quarters):
        degrees = ", ".join(rounded(angle / deg) for angle in angles)
        yield yardstick.finding(path, f"{angles} looks like radians", f"write [{degrees}]")


def _of_inertias(yardstick: Yardstick) -> Iterator[Finding]:
    """Radii of gyration far beyond the size of their links."""
    for link in yardstick.urdf.findall("link"):
        mass, inertia = link.find("inertial/mass"), link.find("inertial/inertia")
        name = str(link.get("name"))
        size = yardstick.link_sizes.get(name, 0.0)
        if mass is None or inertia is None or not size:
            continue
        m = float(numbers(mass, "value", "0")[0])
        largest = max(float(numbers(inertia, key, "0")[0]) for key in ("ixx", "iyy", "izz"))
        radius = math.sqrt(largest / m) if m > 0 else 0.0
        if radius > STOUT * max(size, 0.2 * yardstick.largest_size):
            drawn = radius / 1e3 > 0.02 * size
            cause = "the inertia like kg mm²" if drawn else "the mass like t"
            fits = (
                f"an inertia of {largest:g} kg m² at {m:g} kg fits a body of"
                f" {2 * radius:.3g} m, but the link has {size:.3g} m"
            )
            if yardstick.machine.section.links:
                yield yardstick.finding(f"links.{name}.inertia_kg_m2", fits, cause)
            else:
                words = f"{fits}; {cause} (line {line_of(inertia)})"
                yield Finding(part=f"link {name}", words=words)


def of_joints(yardstick: Yardstick) -> Iterator[Finding]:
    """Reversed axes, limits in another unit, lengths with which strokes would fit the limits."""
    machine = yardstick.machine
    for j, joint in enumerate(machine.arm.joints):
        pairs = zip(machine.linkages, machine.cylinders, strict=True)
        own = [(linkage, cylinder) for linkage, cylinder in pairs if linkage.joints == (j,)]
        if not own:
            continue
        cause = cause_of(machine.arm, j, own, faulty=False) or yardstick.far_limits(joint)
        if cause is None or cause.path == "urdf":
            continue
        if cause.in_urdf:
            _, line = place_in_urdf(machine, j, cause)
            words = f"{cause.words}: {cause.remedy} (line {line})"
            yield Finding(part=f"joint {joint.name}", words=words)
        else:
            yield yardstick.finding(cause.path, cause.words, cause.remedy)
