"""Numbers of a machine that can be used but are most likely in another unit than their key's, or about a reversed axis.

Lengths are judged against other lengths of the same machine, so that a small model and a mining
shovel are as plausible as a crawler excavator: a pin in metres lies a thousandth of its link away
from the joint. Pressures, oil and flow are judged by what machines have (``likely.USUAL``), masses
by other masses. A finding says the line of the file.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from armdesign.hydraulics.actuator import Cylinder
from armdesign.machine import machine_file
from armdesign.machine.assembly_faults import place_in_urdf
from armdesign.machine.key_paths import unit_of
from armdesign.machine.likely_values import USUAL, Meant, meant, rounded, usual
from armdesign.machine.machine import Machine
from armdesign.machine.range_causes import LARGEST_ARM, TURN, Cause, cause_of
from armdesign.mechanism.joint_ranges import over, sweep
from armdesign.mechanism.linkage.base import Linkage
from armdesign.mechanism.urdf import Joint
from armdesign.mechanism.urdf_faults import line_of, numbers, parse
from armdesign.units import deg, mm

NEAR, CLOSE = (
    1.5e-3,
    0.02,
)  # of its link: how far a pin in metres lies at most; a thousand times that is at least this
THIN, SLENDER = (
    1 / 400,
    (1 / 120, 1 / 2),
)  # bore over the largest distance of the pins: in metres; plausible
OVERLOADED = 3.0  # static force over what the supply holds, for a bore in centimetres or inches
LEAF = 2.5  # length of an outermost link over the distance of its centre of mass
DEAD, FAR_FROM_DEAD = (0.02, 30.0), (2e-3, 40.0)  # dead volume over swept volume: plausible; not
FIRST, VALVE = (
    2e-3,
    (1 / 50, (0.05, 5.0)),
)  # static share of the only mass; rated flow over the pump's
PER_TURN = (0.05, 500.0)  # trapped volume of a motor over its displacement
FILLING = (
    300.0,
    60.0,
)  # [s] to fill all cylinders: longer than the first with a small pump, in l/s below the second
SMALL_PUMP = 30.0  # [l/min]
LIGHT, HEAVY = 1e-3, 100.0  # payload over the mass of all links
TIGHT = 6.3  # [deg] a range of pitch below which is one in radians
STOUT = 5.0  # radius of gyration over the size of a link


@dataclass(frozen=True, kw_only=True)
class Finding:
    """Something worth a second look: the key path or part, and what about it."""

    part: str
    words: str


def suspicions(machine: Machine, shares: Mapping[str, float]) -> list[Finding]:
    """Numbers that are most likely in another unit, and reversed axes, those of the URDF first.

    Args:
        machine: that can be used.
        shares: by cylinder, its largest static force over what the supply holds.
    """
    looked_at = _Suspicions(machine, shares)
    lengths = [
        *looked_at.of_urdf(),
        *looked_at.of_joints(),
        *looked_at.of_places(),
        *looked_at.of_cylinders(),
    ]
    found = [
        *lengths,
        *looked_at.of_usual(),
        *([] if lengths else looked_at.of_masses()),  # with other lengths its loads are others
        *looked_at.of_motors(),
        *looked_at.of_angles(),
        *looked_at.of_flow(),
    ]
    return list({finding.part: finding for finding in reversed(found)}.values())[::-1]


@dataclass(frozen=True, eq=False)
class _Suspicions:
    """A machine and what its numbers are judged by."""

    machine: Machine
    shares: Mapping[str, float]

    # --------------------------------------------------------------------------- what is judged by

    @cached_property
    def _urdf(self) -> ET.Element:
        return parse(self.machine.urdf_text, self.machine.section.urdf)

    @cached_property
    def _values(self) -> dict[str, Any]:
        """Every value of the file by its key path."""
        return machine_file.flat(self.machine.section)

    @cached_property
    def _in_millimetres(self) -> bool:
        """Whether the URDF's lengths look like millimetres beside the cylinders'."""
        far = max(
            (float(np.linalg.norm(joint.translation)) for joint in self.machine.arm.joints),
            default=0.0,
        )
        com = max((float(np.linalg.norm(at)) for at in self._centres.values()), default=0.0)
        return max(far, com) > LARGEST_ARM and max(far, com) > 100 * self._longest

    @cached_property
    def _longest(self) -> float:
        """Longest cylinder [m]."""
        return max((cylinder.open_length for cylinder in self.machine.cylinders), default=0.0)

    @cached_property
    def _centres(self) -> dict[str, Any]:
        """Centre of mass of every link that has one, in its frame [m as the URDF has it]."""
        found = {}
        for link in self._urdf.findall("link"):
            inertial = link.find("inertial")
            if inertial is not None:
                found[str(link.get("name"))] = numbers(inertial.find("origin"), "xyz", "0 0 0")
        return found

    @cached_property
    def _sizes(self) -> dict[str, float]:
        """Size of every link [m]: the farthest of its centre of mass and the joints that it carries.

        One that carries no joint is ``LEAF`` times as long as its centre of mass is far.
        """
        unit, carrying = mm if self._in_millimetres else 1.0, set()
        found = {link: float(np.linalg.norm(at)) for link, at in self._centres.items()}
        for joint in self._urdf.findall("joint"):
            parent = joint.find("parent")
            name = "" if parent is None else str(parent.get("link"))
            at = float(np.linalg.norm(numbers(joint.find("origin"), "xyz", "0 0 0")))
            found[name] = max(found.get(name, 0.0), at)
            carrying.add(name)
        ends = {link: LEAF if link not in carrying else 1.0 for link in found}
        return {link: unit * size * ends[link] for link, size in found.items()}

    @cached_property
    def _whole(self) -> float:
        """Size of the largest link [m], or of the longest cylinder where no link has one."""
        return max(self._sizes.values(), default=0.0) or LEAF * self._longest

    def _size(self, link: str | None) -> float:
        size = self._sizes.get(link or "", 0.0)
        return size if size > 0.05 * self._whole else self._whole

    def _span(self, i: int) -> float:
        """Largest distance of a cylinder's pins [m] within its joint's limits.

        Its open length if they are no help.
        """
        linkage, cylinder = self.machine.linkages[i], self.machine.cylinders[i]
        if len(linkage.joints) != 1 or self._far(self.machine.arm.joints[linkage.joints[0]]):
            return cylinder.open_length
        joint = linkage.joints[0]
        with np.errstate(invalid="ignore"):
            lengths = linkage.length(
                sweep(self.machine.arm, joint, over(self.machine.arm.limits[joint], 31))
            )
        return float(np.nanmax(lengths, initial=cylinder.closed_length))

    def _finding(self, path: str, words: str, remedy: str) -> Finding:
        line = self.machine.line_of(path)
        return Finding(part=path, words=f"{words}: {remedy}" + (f" (line {line})" if line else ""))

    def _unit(self, path: str, unit: str, found: Meant, why: str = "") -> Finding:
        value = rounded(float(self._values[path]))
        return self._finding(
            path, f"{value} {unit} looks like {found.unit}{why and f' ({why})'}", found.remedy
        )

    # ------------------------------------------------------------------------------------ the URDF

    def of_urdf(self) -> Iterator[Finding]:
        """Lengths in mm, angles in degrees, masses and inertias that do not go together."""
        machine, source = self.machine, self.machine.section.urdf
        if self._in_millimetres:
            words = (
                "its lengths look like millimetres beside those of the cylinders: divide them by"
                " 1000"
            )
            yield Finding(part=source, words=words)
        for element in (*self._urdf.findall("joint"), *self._urdf.findall("link")):
            part = f"{element.tag} {element.get('name')}"
            for origin in element.iter("origin"):
                turned = numbers(origin, "rpy", "0 0 0")
                if np.any(np.abs(turned) > TURN):
                    meant = " ".join(rounded(float(x) * deg) for x in turned)
                    words = f'rpy="{origin.get("rpy")}" looks like degrees: write rpy="{meant}"'
                    yield Finding(part=part, words=f"{words} (line {line_of(origin)})")
        for name, value in machine.section.frozen.items():
            joint = next(
                (at for at in self._urdf.findall("joint") if at.get("name") == name), None
            )
            if joint is not None and joint.get("type") != "prismatic" and abs(value) > TURN:
                words = f"{value:g} rad looks like degrees"
                yield self._finding(f"frozen.{name}", words, f"write {rounded(value * deg)}")
        yield from self._of_inertias()

    def _of_inertias(self) -> Iterator[Finding]:
        """Radii of gyration far beyond the size of their links."""
        for link in self._urdf.findall("link"):
            mass, inertia = link.find("inertial/mass"), link.find("inertial/inertia")
            name = str(link.get("name"))
            if mass is None or inertia is None or not (size := self._sizes.get(name, 0.0)):
                continue
            m = float(numbers(mass, "value", "0")[0])
            largest = max(float(numbers(inertia, key, "0")[0]) for key in ("ixx", "iyy", "izz"))
            if m > 0 and (radius := math.sqrt(largest / m)) > STOUT * max(size, 0.2 * self._whole):
                cause = (
                    "the inertia like kg mm²" if radius / 1e3 > 0.02 * size else "the mass like t"
                )
                words = (
                    f"an inertia of {largest:g} kg m² of {m:g} kg is that of a body of"
                    f" {2 * radius:.3g} m beside a link"
                )
                line = line_of(inertia)
                yield Finding(
                    part=f"link {name}", words=f"{words} of {size:.3g} m; {cause} (line {line})"
                )

    def of_joints(self) -> Iterator[Finding]:
        """Reversed axes, limits in degrees or millimetres, lengths with which the strokes would fit the limits."""
        machine = self.machine
        for j, joint in enumerate(machine.arm.joints):
            own = [
                (k, c)
                for k, c in zip(machine.linkages, machine.cylinders, strict=True)
                if k.joints == (j,)
            ]
            cause = (
                (cause_of(machine.arm, j, own, faulty=False) or self._far(joint)) if own else None
            )
            if cause is not None and cause.path != "urdf" and cause.in_urdf:
                _, line = place_in_urdf(machine, j, cause)
                words = f"{cause.words}: {cause.remedy} (line {line})"
                yield Finding(part=f"joint {joint.name}", words=words)
            elif cause is not None and not cause.in_urdf:
                yield self._finding(cause.path, cause.words, cause.remedy)

    def _far(self, joint: Joint) -> Cause | None:
        """Limits farther apart than any cylinder moves a joint."""
        if joint.revolute:
            most, unit, factor, words = (
                TURN,
                "rad",
                deg,
                "degrees, as no cylinder turns a joint so far",
            )
        else:
            most, unit, factor, words = 30 * self._longest, "m", mm, "millimetres"
        if max(abs(joint.lower), abs(joint.upper)) <= most:
            return None
        words = f"limits [{joint.lower:g}, {joint.upper:g}] {unit} look like {words}"
        remedy = (
            f'write lower="{rounded(joint.lower * factor)}"'
            f' upper="{rounded(joint.upper * factor)}"'
        )
        return Cause(path="limits", words=words, remedy=remedy)

    # --------------------------------------------------------------------------------- the numbers

    def of_usual(self) -> Iterator[Finding]:
        """Numbers outside of what machines have that are inside it in another unit."""
        overloaded = max(self.shares.values(), default=0.0) > 1
        for path, value in self._values.items():
            keys = tuple(path.split("."))
            if keys[-1] not in USUAL or isinstance(value, str) or not value or usual(keys)(value):
                continue
            if keys[-1] == "return_pressure_bar" and value < 100:
                continue
            if (
                keys[-1] == "bulk_modulus_MPa" and keys[0] != "fluid" and value > 20
            ):  # hoses are as soft as they are
                continue
            if path == "supply.pressure_bar" and 5 < value < 100 and not overloaded:
                continue  # a rig of low pressure that holds its loads
            if keys[-1].endswith("flow_l_per_min") and self._quick(keys[-1], value):
                continue  # a small model
            if found := meant(keys, value, usual(keys)):
                yield self._unit(path, unit_of(keys).strip(), found)

    def of_masses(self) -> Iterator[Finding]:
        """Payloads in t or g beside the links."""
        links = sum(
            float(numbers(mass, "value", "0")[0])
            for mass in self._urdf.iter("mass")
            if mass.get("value") is not None
        )
        for name, payload in self.machine.section.payload.items():
            path = f"payload.{name}.mass_kg"
            if not links:
                yield from self._of_only_mass(path, payload.mass_kg)
                continue
            ratio = payload.mass_kg / links
            if 0 < ratio < LIGHT or (
                ratio > HEAVY and max(self.shares.values(), default=0.0) > OVERLOADED
            ):
                found = meant(
                    ("payload", name, "mass_kg"), payload.mass_kg, lambda x: 0.01 < x / links < 5
                )
                if found:
                    yield self._unit(path, "kg", found, f"the links weigh {links:.4g} kg")

    def _of_only_mass(self, path: str, mass: float) -> Iterator[Finding]:
        """A payload of massless links: judged by what the supply holds."""
        share = max(self.shares.values(), default=0.0)
        if mass > 0 and 0 < share < FIRST:
            keys = tuple(path.split("."))
            if found := meant(keys, mass, lambda x: 0.02 < share * x / mass < 2):
                yield self._unit(path, "kg", found, f"the supply holds {mass / share:.3g} kg")

    def of_places(self) -> Iterator[Finding]:
        """Pins, loads, tool, outlines and boxes in metres."""
        for path, value in self._values.items():
            key = path.rpartition(".")[2]
            table = path.rpartition(".")[0]
            if key in ("at_mm", "points_mm"):
                size = self._size(self._values.get(f"{table}.link") or path.split(".")[2])
                far = (
                    max(math.hypot(*point) for point in (value if key == "points_mm" else [value]))
                    * mm
                )
                if 0 < far <= NEAR * size and far >= CLOSE * NEAR * size:
                    new = "[" + ", ".join(map(_thousandfold, value)) + "]"
                    words = f"{value} mm looks like metres (the link is {size:.3g} m long)"
                    yield self._finding(path, words, f"write {new}")
            elif (
                key == "pin_box_mm" or ".pin_boxes_mm." in path or key in ("reach_mm", "height_mm")
            ):
                smallest = 1e-6 if key in ("reach_mm", "height_mm") else 1e-5
                size = self._whole * (5.0 if smallest == 1e-6 else 0.5)
                if smallest * self._whole < abs(value) * mm < mm * size and abs(value) < 20:
                    box = ("requirements", "pin_box_mm")
                    found = meant(box, value, lambda x, s=size: abs(x) * mm < s)  # type: ignore[misc]
                    if found and self._far_too_small(path, abs(value)):
                        yield self._unit(path, "mm", found)

    def _far_too_small(self, path: str, value: float) -> bool:
        """Whether a box or a reach [mm] is a thousandth of what machines have.

        A height may be anything.
        """
        if path.endswith("height_mm"):
            return self._far_too_small(
                "reach_mm", float(self._values.get(path.replace("height", "reach"), 1e9))
            )
        return value * mm < (
            self._whole / 5e3 if not path.endswith("reach_mm") else self._whole / 100
        )

    def of_cylinders(self) -> Iterator[Finding]:
        """Diameters, walls and oil that do not go with the cylinder's own lengths."""
        for i, (cylinder, linkage) in enumerate(
            zip(self.machine.cylinders, self.machine.linkages, strict=True)
        ):
            yield from self._of_cylinder(i, cylinder, linkage)

    def _of_cylinder(self, i: int, cylinder: Cylinder, linkage: Linkage) -> Iterator[Finding]:
        path, span = f"cylinder.{cylinder.name}", self._span(i)
        bore = cylinder.bore
        factor = 1.0
        if bore < THIN * span:
            found = meant(
                (*path.split("."), "bore_mm"), bore / mm, lambda x: _within(x * mm / span, SLENDER)
            )
        else:
            share = self.shares.get(cylinder.name, 0.0)
            slim = bore < span / 90 and share > OVERLOADED
            found = meant(
                (*path.split("."), "bore_mm"),
                bore / mm,
                lambda x: (
                    slim and share < (x * mm / bore) ** 2 and _within(x * mm / span, SLENDER)
                ),
            )
        if found:
            factor = found.values[0] * mm / bore
            yield self._unit(
                f"{path}.bore_mm", "mm", found, f"the pins are up to {span / mm:.4g} mm apart"
            )
        yield from self._of_rod(path, cylinder, factor)
        sides = {"cap": cylinder.bore_area, "annulus": cylinder.annulus_area}
        for side, area in sides.items():
            swept, volume = (
                area * factor**2 * cylinder.stroke,
                getattr(cylinder, f"{side}_dead_volume"),
            )
            moves = cylinder.stroke > 0.02 * span  # else the stroke is in another unit
            if volume > 0 and moves and not _within(volume / swept, FAR_FROM_DEAD):
                keys = (*path.split("."), "dead_volume_l", side)
                found = meant(keys, 1e3 * volume, lambda x, s=swept: _within(x / 1e3 / s, DEAD))  # type: ignore[misc]
                if found:
                    yield self._unit(
                        ".".join(keys), "l", found, f"the piston sweeps {1e3 * swept:.3g} l"
                    )

    def _of_rod(self, path: str, cylinder: Cylinder, factor: float) -> Iterator[Finding]:
        """The rod and the wall beside the bore, which is ``factor`` times as large as it stands."""
        bore = factor * cylinder.bore
        if cylinder.rod < bore / 8:
            keys = (*path.split("."), "rod_mm")
            if found := meant(keys, cylinder.rod / mm, lambda x: 0.4 < x * mm / bore < 0.9):
                yield self._unit(f"{path}.rod_mm", "mm", found, f"the bore is {bore / mm:.4g} mm")
        wall = cylinder.barrel_wall
        if wall is not None and wall < bore / 300:
            keys = (*path.split("."), "barrel_wall_mm")
            if found := meant(keys, wall / mm, lambda x: 0.02 < x * mm / bore < 0.5):
                yield self._unit(
                    f"{path}.barrel_wall_mm", "mm", found, f"the bore is {bore / mm:.4g} mm"
                )

    def of_motors(self) -> Iterator[Finding]:
        """Trapped volumes beside the displacement."""
        for name, motor in self.machine.section.motor.items():
            for side in ("a", "b"):
                volume, turn = (
                    getattr(motor.trapped_volume_l, side),
                    motor.count * motor.displacement_cm3 / 1e3,
                )
                keys = ("motor", name, "trapped_volume_l", side)
                known = usual(("displacement_cm3",))(motor.displacement_cm3) and not _within(
                    volume / turn, PER_TURN
                )
                found = meant(keys, volume, lambda x, t=turn: 0.2 < x / t < 200)  # type: ignore[misc]
                if known and found:
                    yield self._unit(
                        ".".join(keys), "l", found, f"the motor takes {turn:.3g} l per turn"
                    )

    def of_angles(self) -> Iterator[Finding]:
        """Pitches, transmission angles and poses in radians under keys in degrees."""
        for name, payload in self.machine.section.payload.items():
            ends = payload.pitch_deg or [0.0, 360.0]
            if max(map(abs, ends)) < TIGHT and ends[1] - ends[0] < TIGHT:
                low, high = (rounded(end / deg) for end in ends)
                words = f"[{ends[0]:g}, {ends[1]:g}] deg looks like radians"
                yield self._finding(f"payload.{name}.pitch_deg", words, f"write [{low}, {high}]")
        asked = self.machine.section.requirements
        if 0 < asked.transmission_deg < 1.6:
            path = "requirements.transmission_deg"
            if found := meant(
                ("requirements", "transmission_deg"), asked.transmission_deg, lambda x: 2 < x <= 90
            ):
                yield self._unit(path, "deg", found)
        for name, lift in asked.lift.items():
            yield from self._of_pose(f"requirements.lift.{name}.joint_deg", lift.joint_deg)

    def _of_pose(self, path: str, joints: Mapping[str, float]) -> Iterator[Finding]:
        """Joints that stand out of their ranges in degrees, and all within them in radians."""
        ranges = {name: self.machine.ranges[j] for j, name in enumerate(self.machine.joints)}
        pairs = [(value, ranges[name]) for name, value in joints.items() if name in ranges]
        outside = any(not low - 0.01 <= value * deg <= high + 0.01 for value, (low, high) in pairs)
        if (
            pairs
            and outside
            and all(low - 0.01 <= value <= high + 0.01 for value, (low, high) in pairs)
        ):
            new = ", ".join(f"{name} = {rounded(value / deg)}" for name, value in joints.items())
            yield self._finding(path, "looks like radians", f"write {{ {new} }}")

    def _filling(self, flow: float) -> float:
        """Time [s] in which a flow [l/min] fills all cylinders."""
        return 60e3 * sum(c.bore_area * c.stroke for c in self.machine.cylinders) / flow

    def _quick(self, key: str, flow: float) -> bool:
        """Whether a flow [l/min] is one with which these cylinders work: the pump's, or a valve's beside the pump's."""
        pump = self.machine.section.supply.flow_l_per_min
        return self._filling(pump) < FILLING[0] and (
            key == "flow_l_per_min" or _within(flow / pump, VALVE[1])
        )

    def of_flow(self) -> Iterator[Finding]:
        """A pump flow in l/s: a small pump that needs minutes to fill the cylinders."""
        supply, seconds = (
            self.machine.section.supply,
            self._filling(self.machine.section.supply.flow_l_per_min),
        )
        small = (
            usual(("flow_l_per_min",))(supply.flow_l_per_min)
            and supply.flow_l_per_min < SMALL_PUMP
        )
        if small and FILLING[0] < seconds < 60 * FILLING[1]:
            found = Meant(("l/s",), (60 * supply.flow_l_per_min,))
            yield self._unit(
                "supply.flow_l_per_min", "l/min", found, f"{seconds:.0f} s to fill the cylinders"
            )
        for path, value in self._values.items():
            if path.endswith(".rated_flow_l_per_min") and value < VALVE[0] * supply.flow_l_per_min:
                keys, pump = tuple(path.split(".")), supply.flow_l_per_min
                found_flow = meant(keys, value, lambda x: _within(x / pump, VALVE[1]))  # noqa: B023
                if found_flow and usual(keys)(value):
                    yield self._unit(path, "l/min", found_flow, f"the pump gives {pump:g} l/min")


def _within(value: float, ends: tuple[float, float]) -> bool:
    return ends[0] <= value <= ends[1]


def _thousandfold(value: Any) -> str:
    if isinstance(value, list):
        return "[" + ", ".join(map(_thousandfold, value)) + "]"
    return rounded(1e3 * value)
