"""Requirements: what a new design must keep of today's machine, and the check of a machine against them.

The check uses two machines as their files describe them and nothing of the optimiser, so it also judges its answer.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from armdesign.arm import Arm
from armdesign.arrays import Array
from armdesign.cylinder import Cylinder, estimated_mass, euler_safety, holding_force
from armdesign.errors import ArmDesignError
from armdesign.linkage import Linkage
from armdesign.machine import Machine
from armdesign.ranges import over, sweep
from armdesign.units import deg, mm
from armdesign.workspace import Workspace

SWEEP = 181  # poses over a joint's range at which moment arms and transmission angles are looked at


@dataclass(frozen=True, kw_only=True)
class Requirements:
    """Limits of a new design, shares of what today's machine has.

    Attributes:
        end_margin: share of the stroke that every cylinder keeps free at both ends, in today's workspace.
        holding_share: static force over what supply against return pressure gives, at most.
        oil_total_share: swept volume summed over the cylinders, bore sides and annulus sides, at most.
        oil_each_share: swept volume of each cylinder and side, at most.
        thrust_share: supply pressure × bore area of each cylinder, at most.
        moment_arm_share: smallest moment arm over the joint range, at least.
        transmission: angle between rocker and coupler [rad], at least; or today's smallest, if that is lower.
        digging: names of the cylinders whose digging force counts, extending.
        digging_share: their digging force, at least.
        pin_box: how far each pin coordinate may move in its link [m]; None: 2.5 % of the largest distance from the
            first joint to the tool.
        cylinder_mass: estimated mass of all cylinders together [kg], at most; None: no such limit.
    """

    end_margin: float = 0.02
    holding_share: float = 0.87
    oil_total_share: float = 1.0
    oil_each_share: float = 1.1
    thrust_share: float = 1.1
    moment_arm_share: float = 0.8
    transmission: float = 20 * deg
    digging: tuple[str, ...] = ()
    digging_share: float = 0.95
    pin_box: float | None = None
    cylinder_mass: float | None = None

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if name == "digging" or (name in ("pin_box", "cylinder_mass") and value is None):
                continue
            if not (np.isfinite(value) and value >= 0):
                raise ArmDesignError(f"requirements.{name}", f"{value!r} is not allowed", "give a number ≥ 0")

    @classmethod
    def of(cls, machine: Machine) -> Requirements:
        """The requirements that the machine's file states."""
        section = machine.section.requirements
        return cls(
            end_margin=section.end_margin,
            holding_share=section.holding_share,
            oil_total_share=section.oil_total_share,
            oil_each_share=section.oil_each_share,
            thrust_share=section.thrust_share,
            moment_arm_share=section.moment_arm_share,
            transmission=section.transmission_deg * deg,
            digging=tuple(section.digging.cylinders) if section.digging else (),
            digging_share=section.digging.share if section.digging else 0.95,
            pin_box=None if section.pin_box_mm is None else section.pin_box_mm * mm,
        )

    def box(self, machine: Machine, workspace: Workspace) -> float:
        """How far each pin coordinate may move [m]."""
        if self.pin_box is not None:
            return self.pin_box
        tool = machine.arm.point(workspace.rigid, machine.tool.link, np.array(machine.tool.at))
        return float(0.025 * np.linalg.norm(tool - workspace.rigid.translation[:, 0], axis=1).max())


@dataclass(frozen=True, kw_only=True)
class Check:
    """One requirement, judged: ``value`` against ``limit`` in ``unit``; ``slack`` ≥ 0 where it is met.

    The slack is the distance to the limit over the limit (over the pin box, the stroke or today's value where the
    limit is a length that may be zero). ``words`` say what it is about.
    """

    name: str
    value: float
    limit: float
    unit: str
    slack: float
    words: str


def _at_most(name: str, value: float, limit: float, unit: str, words: str, scale: float | None = None) -> Check:
    slack = _slack(limit - value, scale or limit or 1.0)
    return Check(name=name, value=value, limit=limit, unit=unit, slack=slack, words=words)


def _at_least(name: str, value: float, limit: float, unit: str, words: str, scale: float | None = None) -> Check:
    slack = _slack(value - limit, scale or limit or 1.0)
    return Check(name=name, value=value, limit=limit, unit=unit, slack=slack, words=words)


def _slack(room: float, scale: float) -> float:
    """Room over scale; exactly on the limit where only the rounding of the arithmetic is left."""
    slack = room / scale
    return 0.0 if abs(slack) < 1e-12 else slack


def check(
    machine: Machine,
    today: Machine,
    workspace: Workspace,
    requirements: Requirements,
    loads: tuple[Array, Array] | None = None,
) -> tuple[Check, ...]:
    """Judge a machine by every requirement, relative to today's machine on today's workspace.

    Args:
        machine: the new machine.
        today: the machine that the limits refer to.
        workspace: today's workspace.
        requirements: the limits.
        loads: ``static_loads`` of the machine on the workspace, if known.
    """
    checks = [
        *_oil(machine, today, requirements),
        *_holding(machine, loads or static_loads(machine, workspace), requirements),
    ]
    pairs = zip(machine.cylinders, today.cylinders, machine.linkages, today.linkages, strict=True)
    for new, old, linkage, old_linkage in pairs:
        checks += _cylinder(new, old, requirements, machine)
        checks += _geometry(new, old, linkage, old_linkage, today, requirements)
        checks += _box(new, linkage, old_linkage, requirements.box(today, workspace))
    if requirements.cylinder_mass is not None:
        mass, words = cylinder_mass(machine), "estimated mass of all cylinders"
        checks.append(_at_most("cylinder_mass", mass, requirements.cylinder_mass, "kg", words))
    return tuple(checks)


def cylinder_mass(machine: Machine) -> float:
    """Estimated mass of all cylinders together [kg]."""
    pressure = machine.supply.pressure
    return float(sum(c.count * estimated_mass(c.bore, c.rod, c.stroke, pressure) for c in machine.cylinders))


def _oil(machine: Machine, today: Machine, requirements: Requirements) -> list[Check]:
    checks = []
    for side, area in (("cap", "bore_area"), ("annulus", "annulus_area")):
        volumes = [[getattr(c, area) * c.stroke for c in m.cylinders] for m in (machine, today)]
        limit = requirements.oil_total_share * sum(volumes[1])
        checks.append(_at_most(f"oil.{side}.total", sum(volumes[0]), limit, "m³", f"oil of all {side} sides"))
        for cylinder, new, old in zip(machine.cylinders, *volumes, strict=True):
            limit = requirements.oil_each_share * old
            words = f"oil of the {cylinder.name} cylinder's {side} side"
            checks.append(_at_most(f"oil.{side}.{cylinder.name}", new, limit, "m³", words))
    return checks


def static_loads(machine: Machine, workspace: Workspace) -> tuple[Array, Array]:
    """Largest push and largest pull that each cylinder must hold, all poses and load cases (nc,) [N, ≥ 0]."""
    push = pull = np.zeros(len(machine.cylinders))
    for payload in machine.payloads:
        case = machine.with_payload(payload.name)
        forces = case.evaluate(workspace.rigid[case.holds(workspace.rigid)]).cylinder_forces
        push = np.maximum(push, forces.max(axis=0, initial=0.0))
        pull = np.maximum(pull, -forces.min(axis=0, initial=0.0))
    return push, pull


def digging_forces(machine: Machine) -> dict[str, float]:
    """Largest force of each cylinder at the tool [N]: it alone, extending, supply pressure, best pose (ISO 6015).

    The force is tangential to the tool's arc about the joint that the cylinder turns; joints further out stand where
    their own cylinders dig best. Cylinders that turn no single joint between root and tool are left out.
    """
    arm = machine.arm
    best = arm.limits.mean(axis=1)
    torque: dict[int, tuple[str, float]] = {}
    for cylinder, linkage in zip(machine.cylinders, machine.linkages, strict=True):
        if len(linkage.joints) == 1 and arm.joints[linkage.joints[0]].revolute:
            joint = linkage.joints[0]
            poses = sweep(arm, joint, over(machine.ranges[joint], 4 * SWEEP))
            moment_arm = np.abs(linkage.actuation(poses).moment_arm[:, joint])
            best[joint] = poses.q[moment_arm.argmax(), joint]
            torque[joint] = (cylinder.name, machine.supply.pressure * cylinder.bore_area * float(moment_arm.max()))
    poses = arm.kinematics(best[None])
    tool = arm.point(poses, machine.tool.link, np.array(machine.tool.at))[0]
    forces = {}
    for joint in set(torque) & set(arm.chain(machine.tool.link)):
        axis, lever = poses.axis[0, joint], tool - poses.translation[0, joint]
        distance = float(np.linalg.norm(lever - axis * (axis @ lever)))
        if distance > 0:
            forces[torque[joint][0]] = torque[joint][1] / distance
    return forces


def _holding(machine: Machine, loads: tuple[Array, Array], requirements: Requirements) -> list[Check]:
    checks = []
    for cylinder, push, pull in zip(machine.cylinders, *loads, strict=True):
        held = [holding_force(cylinder.bore_area, cylinder.annulus_area, machine.supply, way) for way in (True, False)]
        use = max(float(push / held[0]), float(pull / held[1]))
        words = f"static load of the {cylinder.name} cylinder"
        checks.append(_at_most(f"holding.{cylinder.name}", use, requirements.holding_share, "", words))
    return checks


def _cylinder(new: Cylinder, old: Cylinder, requirements: Requirements, machine: Machine) -> list[Check]:
    pressure, name = machine.supply.pressure, new.name
    safety = [euler_safety(c.bore, c.rod, c.open_length, pressure) for c in (new, old)]
    thrust = [pressure * c.bore_area for c in (new, old)]
    limit = requirements.thrust_share * thrust[1]
    return [
        _at_most(f"thrust.{name}", thrust[0], limit, "N", f"thrust of the {name} cylinder"),
        _at_least(f"buckling.{name}", safety[0], safety[1], "", f"Euler safety of the {name} rod"),
        _at_least(
            f"dead_length.{name}",
            new.dead_length,
            old.dead_length,
            "m",
            f"closed length less stroke, {name}",
            old.stroke,
        ),
    ]


def _geometry(
    new: Cylinder, old: Cylinder, linkage: Linkage, old_linkage: Linkage, today: Machine, requirements: Requirements
) -> list[Check]:
    """Stroke, moment arm, digging and transmission of a cylinder over the range of its joint."""
    if len(linkage.joints) != 1:
        return []
    joint = linkage.joints[0]
    ends = (float(today.ranges[joint, 0]), float(today.ranges[joint, 1]))
    swept = [_swept(k, today.arm, ends) for k in (linkage, old_linkage)]
    length = swept[0][0]
    name, where = new.name, today.arm.joints[joint].name
    arms = [arm for _, arm, _ in swept]
    checks = [
        _at_least(f"range.open.{name}", new.open_length, length.max(), "m", f"stroke covers {where}", old.stroke),
        _at_most(f"range.closed.{name}", new.closed_length, length.min(), "m", f"stroke covers {where}", old.stroke),
        _at_least(
            f"moment_arm.{name}", arms[0].min(), requirements.moment_arm_share * arms[1].min(), "m/rad",
            f"smallest moment arm of the {name} cylinder",
        ),
    ]  # fmt: skip
    if name in requirements.digging:
        torque = [today.supply.pressure * c.bore_area * a.max() for c, a in ((new, arms[0]), (old, arms[1]))]
        limit = requirements.digging_share * torque[1]
        checks.append(_at_least(f"digging.{name}", torque[0], limit, "N m", f"digging torque of the {name} cylinder"))
    if linkage.four_bar is not None:
        angle = [angle for _, _, angle in swept]
        limit = min(requirements.transmission, angle[1])
        checks.append(_at_least(f"transmission.{name}", angle[0], limit, "rad", f"rocker–coupler angle, {name}"))
    return checks


@lru_cache(maxsize=64)
def _swept(linkage: Linkage, arm: Arm, ends: tuple[float, float]) -> tuple[Array, Array, float]:
    """Length, size of the moment arm and smallest transmission angle (π/2 without a four-bar) over its joint's range.

    Remembered, because many sizes are tried on the same pins.
    """
    joint = linkage.joints[0]
    poses = sweep(arm, joint, over(np.array(ends), SWEEP))
    actuation = linkage.actuation(poses)
    angle = float(linkage.transmission_angle(poses).min()) if linkage.four_bar else math.pi / 2
    return actuation.length, np.abs(actuation.moment_arm[:, joint]), angle


def _box(new: Cylinder, linkage: Linkage, old: Linkage, box: float) -> list[Check]:
    checks = []
    for pin in ("base", "rod_end"):
        here, before = getattr(linkage, pin), getattr(old, pin)
        if here is None:
            continue
        moved = float(np.abs(np.subtract(here.at, before.at)).max())
        name = f"pin_box.{new.name}.{pin}"
        checks.append(_at_most(name, moved, box, "m", f"move of the {new.name} cylinder's {pin} pin", box or 1.0))
    return checks
