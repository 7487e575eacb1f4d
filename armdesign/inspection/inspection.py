"""What a machine file amounts to and what looks odd in it.

``inspect`` looks at a machine as a designer would: ranges, reach, moment arms, pressures. Oddities
are no errors: they are numbers worth a second look. What makes a file unusable is in ``problems``.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armdesign.arrays import Array, weighted_share
from armdesign.errors import PoseError
from armdesign.frequency.cases import CasePoses, load_cases
from armdesign.frequency.modes import natural_modes
from armdesign.frequency.workspace import Workspace
from armdesign.hydraulics.actuator import Actuator, Cylinder
from armdesign.hydraulics.buckling import euler_safety
from armdesign.hydraulics.chamber_pressures import holding_force
from armdesign.inspection.plausibility import Finding, suspicions
from armdesign.machine.machine import Machine
from armdesign.mechanism.arm import RigidPoses
from armdesign.mechanism.joint_ranges import over, sweep
from armdesign.mechanism.urdf import Joint
from armdesign.units import WORKSHOP, Units

SWEEP = 361  # poses over a joint's range at which moment arms are looked at
DEAD_LENGTH_PER_BORE = (
    2.2  # head, piston, gland and two eyes of a real cylinder take at least about this
)
SMALL_MOMENT_ARM = 0.15  # of the largest
STROKE_USED = 0.6
RANGE_TOLERANCE = {
    True: 0.01,
    False: 0.005,
}  # [rad], [m] by which URDF limit and stroke may differ (revolute?)
BULK_MODULUS = (400e6, 2200e6)  # [Pa] effective values that have been measured on machines
RODS_SAFETY = 1.0  # Euler load over the supply's thrust


@dataclass(frozen=True, kw_only=True)
class Lever:
    """Moment arm of a cylinder about one joint: least and largest size [m/rad] and the joint positions there."""

    cylinder: int
    joint: int
    least: float
    least_at: float
    most: float
    most_at: float


@dataclass(frozen=True, kw_only=True)
class Load:
    """Static pressure [Pa] of an actuator's loaded chamber at its largest load under a load case.

    The other chamber is at return pressure, or at the preload of its valve: a simulation starts
    so. ``share`` is the static force over the force of supply against return pressure (inf where
    that holds nothing), ``cap`` whether the cap side holds; ``most`` [Pa] are the largest
    pressures of cap and annulus over all poses.
    """

    cylinder: int
    payload: str
    pressure: float
    share: float
    cap: bool
    most: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Inspection:
    """A machine over its workspace, in the numbers that a designer looks at first."""

    machine: Machine
    workspace: Workspace

    @cached_property
    def masses(self) -> dict[str, float]:
        """Mass of every link that has one [kg], frozen ones included."""
        found = {}
        for link in ET.fromstring(self.machine.urdf_text).findall("link"):
            mass = link.find("inertial/mass")
            if mass is not None and float(mass.get("value", "0")) > 0:
                found[str(link.get("name"))] = float(mass.get("value", "0"))
        return found

    @cached_property
    def tool(self) -> Array:
        """Reach (forward positive) and height of the tool (n, 2) [m] in the root link's frame."""
        machine = self.machine
        at = machine.arm.point(self.workspace.rigid, machine.tool.link, np.array(machine.tool.at))
        return np.stack([machine.arm.reach(self.workspace.q, at), at[:, 2]], axis=1)

    def ended_by(self, joint: int, end: int) -> str:
        """What ends a joint's range at its lower (0) or upper (1) end: a stroke, the URDF, nothing but a full turn."""
        machine = self.machine
        pose = sweep(machine.arm, joint, machine.ranges[joint, end : end + 1])
        for cylinder, linkage in zip(machine.cylinders, machine.linkages, strict=True):
            if linkage.joints == (joint,):
                length, near = float(linkage.length(pose)[0]), 2e-3 * cylinder.stroke
                if abs(length - cylinder.closed_length) < near:
                    return f"{cylinder.name} in"
                if abs(length - cylinder.open_length) < near:
                    return f"{cylinder.name} out"
        return "one turn" if _whole_turn(machine.arm.joints[joint]) else "URDF limit"

    def poses_of(self, cylinder: int) -> RigidPoses:
        """Poses at which a cylinder is looked at: along its joint's range, or the workspace if it spans several."""
        machine, joints = self.machine, self.machine.linkages[cylinder].joints
        if len(joints) == 1:
            return sweep(machine.arm, joints[0], over(machine.ranges[joints[0]], SWEEP))
        return self.workspace.rigid

    @cached_property
    def levers(self) -> list[Lever]:
        """Moment arms of every cylinder about every joint that it spans."""
        found = []
        for i, linkage in enumerate(self.machine.linkages):
            poses = self.poses_of(i)
            for j in linkage.joints:
                arm = np.abs(linkage.actuation(poses).moment_arm[:, j])
                low, high = int(arm.argmin()), int(arm.argmax())
                found.append(
                    Lever(
                        cylinder=i,
                        joint=j,
                        least=float(arm[low]),
                        least_at=float(poses.q[low, j]),
                        most=float(arm[high]),
                        most_at=float(poses.q[high, j]),
                    )
                )
        return found

    def stroke_used(self, cylinder: int) -> float:
        """Share of its stroke that a cylinder passes over the joint ranges."""
        length = self.machine.linkages[cylinder].length(self.poses_of(cylinder))
        return float(np.ptp(length) / self.machine.cylinders[cylinder].stroke)

    def share_held(self, payload: str) -> float:
        """Share of joint space within the workspace in which a load case exists."""
        return weighted_share(self.cases[payload].exists, self.workspace.weights)

    @cached_property
    def cases(self) -> dict[str, CasePoses]:
        """Every load case by its name, with the poses at which it exists."""
        return {case.name: case for case in load_cases(self.machine, self.workspace)}

    @cached_property
    def loads(self) -> list[Load]:
        """Largest static load of every cylinder and motor under every load case."""
        found = []
        for name, case in self.cases.items():
            forces = case.evaluate().cylinder_forces
            if len(forces):
                found += [
                    self._load(i, name, forces[:, i]) for i in range(len(self.machine.actuators))
                ]
        return found

    def _load(self, i: int, payload: str, forces: Array) -> Load:
        cylinder, supply = self.machine.actuators[i], self.machine.supply
        held = holding_force(cylinder.bore_area, cylinder.annulus_area, supply, forces >= 0)
        share = np.divide(
            np.abs(forces), held, out=np.where(forces == 0, 0.0, np.inf), where=held > 0
        )
        worst = int(share.argmax())
        cap, annulus = cylinder.static_pressures(forces, supply)
        return Load(
            cylinder=i,
            payload=payload,
            pressure=float(max(cap[worst], annulus[worst])),
            share=float(share[worst]),
            cap=bool(cap[worst] > annulus[worst]),
            most=(float(cap.max()), float(annulus.max())),
        )

    @cached_property
    def suspicions(self) -> list[Finding]:
        """What is most likely in another unit, or about a reversed axis: all other numbers may follow from it."""
        shares: dict[str, float] = {}
        for load in self.loads:
            name = self.machine.actuators[load.cylinder].name
            shares[name] = max(shares.get(name, 0.0), load.share)
        return suspicions(self.machine, shares)

    def findings(self, units: Units = WORKSHOP) -> list[Finding]:
        """What looks odd, in the units asked for: first what may be in another unit, then what may follow from it."""
        found = [*self.suspicions]
        for i in range(len(self.machine.cylinders)):
            found += self._odd_cylinder(i, units)
        for j in range(len(self.machine.joints)):
            found += self._odd_joint(j, units)
        for payload in self.machine.payloads:
            found += self._odd_payload(payload.name, units)
        return [*found, *self._odd_rest(units)]

    # ------------------------------------------------------------------------------------ oddities

    def _odd_cylinder(self, i: int, units: Units) -> Iterator[Finding]:
        machine, cylinder = self.machine, self.machine.cylinders[i]
        part = f"cylinder.{cylinder.name}"
        needed = DEAD_LENGTH_PER_BORE * cylinder.bore
        if cylinder.dead_length < needed:
            yield Finding(
                part=f"{part}.closed_length_mm",
                words=(
                    f"closed length less stroke is {units.text(cylinder.dead_length, 'm')}; head,"
                    " piston, gland and two eyes of a real cylinder take about"
                    f" {DEAD_LENGTH_PER_BORE} × bore = {units.text(needed, 'm')}"
                ),
            )
        used = self.stroke_used(i)
        if used < STROKE_USED:
            yield Finding(
                part=f"{part}.stroke_mm",
                words=(
                    f"only {100 * used:.0f} % of the stroke is used; limits of the URDF or other"
                    " cylinders end the motion before it does"
                ),
            )
        for lever in self.levers:
            if lever.cylinder == i and lever.least < SMALL_MOMENT_ARM * lever.most:
                joint = machine.arm.joints[lever.joint]
                where = units.text(lever.least_at, "rad" if joint.revolute else "m")
                yield Finding(
                    part=part,
                    words=(
                        f"its moment arm falls to {100 * lever.least / lever.most:.0f} % of its"
                        f" largest at {joint.name} {where} (below {100 * SMALL_MOMENT_ARM:.0f} %):"
                        " close to a dead centre"
                    ),
                )
        safety = euler_safety(
            cylinder.bore, cylinder.rod, cylinder.open_length, machine.supply.pressure
        )
        if safety < RODS_SAFETY:
            yield Finding(
                part=f"{part}.rod_mm",
                words=(
                    f"fully out the rod buckles at {100 * safety:.0f} % of the thrust at supply"
                    " pressure (Euler, pin to pin)"
                ),
            )
        yield from _odd_volumes(part, cylinder)

    def _odd_joint(self, j: int, units: Units) -> Iterator[Finding]:
        machine, joint = self.machine, self.machine.arm.joints[j]
        unit = "rad" if joint.revolute else "m"
        (low, high), (lower, upper) = machine.ranges[j], (joint.lower, joint.upper)
        tolerance = RANGE_TOLERANCE[joint.revolute]
        if not _whole_turn(joint) and (low - lower > tolerance or upper - high > tolerance):
            yield Finding(
                part=f"joint {joint.name}",
                words=(
                    f"the URDF allows {units.span(lower, upper, unit)}, the strokes cover only "
                    f"{units.span(low, high, unit)}"
                ),
            )
        own = {name for name, link in machine.arm.links.items() if link.joint == j}
        if not own & set(self.masses):
            yield Finding(
                part=f"link {', '.join(sorted(own))}",
                words=(
                    f"has no mass: what joint {joint.name} moves is payload, tools and links"
                    " further out alone"
                ),
            )

    def _odd_payload(self, name: str, units: Units) -> Iterator[Finding]:
        payload = self.cases[name].machine.payload
        part, supply = f"payload.{name}", self.machine.supply
        if self.share_held(name) == 0:
            yield Finding(
                part=f"{part}.pitch_deg",
                words=(
                    f"link {payload.link} has that pitch at no pose of the workspace: the case"
                    " never exists"
                ),
            )
            return
        if payload.pitch and payload.link:
            yield from self._odd_pitch(name, units)
        for load in (load for load in self.loads if load.payload == name):
            actuator = self.machine.actuators[load.cylinder]
            yield from self._odd_valves(actuator, load, units)
            limit = self.machine.section.requirements.holding_share
            side = "cap" if load.cap else "rod"
            words = (
                f"under {name} the {side} side needs {units.text(load.pressure, 'Pa')} to stand"
                " still"
            )
            if load.share > 1:
                words += f", more than the supply's {units.text(supply.pressure, 'Pa')} can hold"
            elif load.share > limit:
                words += (
                    f", {100 * load.share:.0f} % of what supply pressure holds (requirement:"
                    f" {100 * limit:.0f} %)"
                )
            else:
                continue
            yield Finding(part=f"{actuator.kind}.{actuator.name}", words=words)
        yield from self._odd_modes(name)

    def _odd_valves(self, actuator: Actuator, load: Load, units: Units) -> Iterator[Finding]:
        """A relief, or a load-holding valve, that the load alone presses open."""
        part, supply = f"{actuator.kind}.{actuator.name}", self.machine.supply
        for side, most in zip(("cap", "annulus"), load.most, strict=True):
            needs = (
                f"under {load.payload} the {side.replace('annulus', 'rod')} side needs"
                f" {units.text(most, 'Pa')}"
            )
            if most > actuator.relief(supply):
                opens = units.text(actuator.relief(supply), "Pa")
                words = (
                    f"{needs} to stand still; its relief opens at {opens} and cannot hold that:"
                    " the load gives way"
                )
                yield Finding(part=f"{part}.valve.relief_bar", words=words)
            holding = actuator.load_holding
            if holding is not None and holding.side == side and most > holding.setting:
                words = (
                    f"{needs}, more than the setting of {units.text(holding.setting, 'Pa')}: the"
                    " load alone opens "
                )
                words += "it, and is held by the spool, if at all"
                yield Finding(part=f"{part}.load_holding.setting_bar", words=words)

    def _odd_pitch(self, name: str, units: Units) -> Iterator[Finding]:
        payload = self.cases[name].machine.payload
        assert payload.pitch is not None
        assert payload.link is not None
        low, high = payload.pitch
        middle, half = (low + high) / 2, (high - low) / 2
        offset = self.machine.arm.pitch(self.workspace.rigid, payload.link) - middle
        offset = np.arctan2(np.sin(offset), np.cos(offset))
        inside = offset[np.abs(offset) <= half + 1e-8]
        if inside.min() > -half + 0.02 or inside.max() < half - 0.02:
            yield Finding(
                part=f"payload.{name}.pitch_deg",
                words=(
                    f"of {units.span(low, high, 'rad')} the workspace reaches only "
                    f"{units.span(middle + inside.min(), middle + inside.max(), 'rad')}"
                ),
            )

    def _odd_modes(self, name: str) -> Iterator[Finding]:
        case = self.cases[name]
        try:
            lowest = natural_modes(case.machine.at(case.rigid)).frequencies[:, 0]
        except PoseError as error:
            yield Finding(part=f"payload.{name}", words=f"no natural frequencies: {error}")
            return
        if np.any(lowest == 0):
            unstable = weighted_share(lowest == 0, self.workspace.weights[case.exists])
            yield Finding(
                part=f"payload.{name}",
                words=(
                    f"{100 * unstable:.1f} % of the poses are unstable (0 Hz): gravity overcomes "
                    "the trapped oil; is the bulk modulus or the payload right?"
                ),
            )

    def _odd_rest(self, units: Units) -> Iterator[Finding]:
        section = self.machine.section
        for name in set(section.frozen) & set(section.joints):
            yield Finding(part=f"frozen.{name}", words="is not used: the joint is a coordinate")
        for name in section.cylinder:
            if joints := self.machine.idle.get(name):
                still = (
                    f"joint {joints[0]} is"
                    if len(joints) == 1
                    else f"joints {', '.join(joints)} are"
                )
                words = (
                    f"idle: {still} frozen, so that it moves nothing and no requirement counts"
                    " for it"
                )
                yield Finding(part=f"cylinder.{name}", words=words)
        fluid, (low, high) = self.machine.fluid, BULK_MODULUS
        if not low <= fluid.bulk_modulus <= high:
            yield Finding(
                part="fluid.bulk_modulus_MPa",
                words=(
                    f"{fluid.bulk_modulus / 1e6:g} MPa is outside [{low / 1e6:g}, {high / 1e6:g}]"
                    " MPa, the range of mineral oil in steel lines and hoses"
                ),
            )
        if all(case.mass == 0 for case in self.machine.payloads):
            yield Finding(
                part="payload",
                words="every load case is empty: the worst pose of work is not looked at",
            )


def _whole_turn(joint: Joint) -> bool:
    return joint.revolute and joint.upper - joint.lower > 2 * np.pi - 1e-6


def _odd_volumes(part: str, cylinder: Cylinder) -> Iterator[Finding]:
    sides = {"cap": cylinder.cap_dead_volume, "annulus": cylinder.annulus_dead_volume}
    none = [side for side, volume in sides.items() if volume == 0]
    if none:
        yield Finding(
            part=f"{part}.dead_volume_l.{none[0]}",
            words=(
                "0: ports and lines hold oil, and without it the spring is infinitely stiff at the"
                " end of the stroke"
            ),
        )


def inspect(machine: Machine, workspace: Workspace) -> Inspection:
    """Look at a machine over its workspace."""
    return Inspection(machine, workspace)
