"""Requirements in absolute terms: speeds, lifts, digging forces, places of pins, clearances, mass.

Written once for check and optimiser, see ``conditions.py``.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import numpy as np

from armdesign.arrays import Array
from armdesign.design.requirements.candidate import (
    Candidate,
    Condition,
    Frame,
    bounded,
    diameters,
    peak,
)
from armdesign.design.requirements.lifting import LiftPose, liftable
from armdesign.design.requirements.polygons import clearance, depth
from armdesign.design.requirements.settings import Clearance, Speed
from armdesign.errors import ArmDesignError
from armdesign.hydraulics.barrel import barrel_outer
from armdesign.hydraulics.cylinder_mass import estimated_mass
from armdesign.machine.machine import Machine
from armdesign.machine.poses import static_forces
from armdesign.mechanism.arm import RigidPoses
from armdesign.mechanism.joint_ranges import over

MESH = {
    1: 121,
    2: 25,
    3: 11,
}  # values of each joint between a barrel and the link it keeps clear of, by their number
NEAREST = 12  # poses of least clearance that count
ROUNDING = 7.1e-5  # [m] that a pin on the 0.1 mm grid may lie beside its place


def explicit(new: Candidate, frame: Frame) -> Iterator[Condition]:
    """Every requirement in absolute terms, but for buckling."""
    yield from (_speed(new, frame, speed) for speed in frame.requirements.speeds)
    yield from (_lift(new, frame, lift) for lift in frame.lifts)
    yield from _digging_force(new, frame)
    yield from _outlines(new, frame)
    yield from _clearances(new, frame)
    if frame.requirements.cylinder_mass is not None:
        yield _mass(new, frame.requirements.cylinder_mass)


def flows(new: Candidate, frame: Frame, speed: Speed) -> Array:
    """Flow that the actuators of a motion draw together (b,) [m³/s]: bore sides extending, annulus sides retracting.

    Over a joint's range the mean is the swept volume over the time; at every pose it is A |r| q̇
    where |r| is largest.

    Raises:
        ArmDesignError: a joint that a cylinder across several joints moves.
    """
    total = np.zeros(len(new.areas))
    for i, cylinder in enumerate(frame.today.cylinders):
        rates: list[Any] = (
            [speed.cylinders[cylinder.name]] if cylinder.name in speed.cylinders else []
        )
        linkage, swept = frame.today.linkages[i], new.sweeps[i]
        for joint, rate in speed.joints.items():
            j = frame.today.joints.index(joint)
            if j not in linkage.joints:
                continue
            if swept is None:
                raise ArmDesignError(
                    f"requirements.speed.{speed.name}",
                    f'the {cylinder.name} cylinder moves "{joint}" and other joints',
                    "ask for the speed of the cylinder instead",
                )
            length, arm = swept
            if speed.at == "mean":
                rates.append(rate * (length[:, -1] - length[:, 0]) / np.ptp(frame.today.ranges[j]))
            else:
                worst = np.abs(arm[0].real).argmax()
                rates.append(rate * arm[:, worst])
        for rate in rates:
            extends = np.real(np.ravel(rate)[0]) > 0
            total = (
                total
                + np.where(extends, rate, -np.asarray(rate)) * new.areas[:, i, 0 if extends else 1]
            )
    return total


def _speed(new: Candidate, frame: Frame, speed: Speed) -> Condition:
    return bounded(
        f"speed.{speed.name}", f"flow of the motion {speed.name}", "m³/s", flows(new, frame, speed),
        new.machine.supply.flow, setting=f"speed.{speed.name}",
    )  # fmt: skip


def _lift(new: Candidate, frame: Frame, at: LiftPose) -> Condition:
    """Mass that each cylinder could hold, as the optimiser sees it by the forces at the mass that is asked."""
    share, supply = frame.requirements.holding_share, new.machine.supply
    arms = new.moment_arms(at.rigid)
    bare, per_mass = (
        static_forces(arms, load, new.areas[:, None, :, 0])[:, 0]
        for load in (new.bare_gravity(at.rigid), at.torque[None])
    )
    mass = liftable(new.machine, bare, per_mass, new.areas, share)
    loaded = np.isfinite(mass[0].real)
    steepness = per_mass * np.sign(per_mass[0].real) / (supply.pressure * frame.old.areas[0, :, 0])
    steepness = np.where(loaded, steepness, 0.0)
    room = np.where(loaded, (np.where(loaded, mass, 0.0) - at.lift.mass) * steepness, 1.0)
    return bounded(
        f"lift.{at.lift.name}", f"mass that the lift {at.lift.name} could be", "kg", mass, at.lift.mass,
        at_least=True, room=room, easing=at.lift.mass * steepness,
        setting=f"lift.{at.lift.name}.mass_kg",
    )  # fmt: skip


def digging_forces(new: Candidate, frame: Frame) -> dict[str, Array]:
    """Force of each cylinder at the tool (b,) [N]: it alone, extending, supply pressure, best angle (ISO 6015).

    The force is tangential to the tool's arc about the joint that the cylinder turns; joints
    further out stand where their own cylinders dig best. Cylinders that turn no single joint
    between root and tool are left out.
    """
    arm, ranges = frame.today.arm, frame.today.ranges
    best: dict[
        int, tuple[str, Array, Array]
    ] = {}  # by joint: cylinder, its best position, torque there
    for i, (cylinder, swept) in enumerate(zip(frame.today.cylinders, new.sweeps, strict=True)):
        joint = frame.today.linkages[i].joints[0]
        if swept is None or not arm.joints[joint].revolute:
            continue
        where, most = peak(over(ranges[joint], frame.samples), swept[1])
        best[joint] = cylinder.name, where, new.machine.supply.pressure * new.areas[:, i, 0] * most
    q = arm.limits.mean(axis=1)
    for joint, (_, where, _) in best.items():
        q[joint] = where[0].real
    poses, tool = arm.kinematics(q[None]), frame.today.tool
    chain, found = arm.chain(tool.link), {}
    motion = arm.motion(poses, tool.link, np.array(tool.at), arm.root, tuple(range(len(q))))
    for joint in (j for j in chain if j in best):
        axis, lever = poses.axis[0, joint], motion.value[0] - poses.translation[0, joint]
        lever = lever - axis * (axis @ lever)
        distance = float(np.linalg.norm(lever))
        if distance > 0:
            turned = sum(
                (best[k][1] - q[k]) * float(motion.first[0, k] @ lever)
                for k in _beyond(chain, joint, best)
            )
            name, _, torque = best[joint]
            found[name] = torque / (distance + turned / distance)
    return found


def _beyond(chain: tuple[int, ...], joint: int, known: dict[int, Any]) -> list[int]:
    """Joints further out than one, of those known."""
    return [k for k in chain[chain.index(joint) + 1 :] if k in known]


def _digging_force(new: Candidate, frame: Frame) -> Iterator[Condition]:
    asked = frame.requirements.digging_force
    found = digging_forces(new, frame) if asked else {}
    for name, limit in asked.items():
        if name not in found:
            raise ArmDesignError(
                "requirements.digging_force",
                f"the {name} cylinder turns no single joint between root and tool",
                "leave it out",
            )
        yield bounded(f"digging_force.{name}", f"digging force of the {name} cylinder", "N", found[name], limit,
                       at_least=True, setting=f"digging_kN.{name}")  # fmt: skip


def _outlines(new: Candidate, frame: Frame) -> Iterator[Condition]:
    """Every pin on an outlined link, as far within the outline as its radius."""
    for outline in frame.requirements.outlines:
        polygon = np.array(outline.points)
        size = float(np.ptp(polygon, axis=0).max()) or 1.0
        for i, linkage in enumerate(frame.today.linkages):
            for name in linkage.pin_names:
                pin, place = linkage.pin(name), new.place(i, name)
                if pin is None or place is None or pin.link != outline.link:
                    continue
                whose = frame.today.cylinders[i].name
                words = f"{name} pin of the {whose} cylinder within the {outline.link}'s outline"
                yield bounded(
                    f"outline.{whose}.{name}", words, "m", depth(place[:, [0, 2]], polygon), outline.pin_radius,
                    at_least=True, slack_scale=size, rounding=ROUNDING / size,
                    setting=f"outline.{outline.link}.pin_radius_mm",
                )  # fmt: skip


@lru_cache(maxsize=64)
def _poses_between(today: Machine, part: Clearance, i: int) -> RigidPoses:
    """Poses over the ranges of all joints between a cylinder and the link that it keeps clear of."""
    arm, linkage = today.arm, today.linkages[i]
    between = sorted({*linkage.joints, *(j for j, _ in arm.path(linkage.base.link, part.link))})
    count = MESH.get(len(between), 5)
    axes = [over(today.ranges[j], count) for j in between]
    q = np.tile(today.ranges.mean(axis=1), (count ** len(between), 1))
    q[:, between] = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(between))
    return arm.kinematics(q)


def _clearances(new: Candidate, frame: Frame) -> Iterator[Condition]:
    """Barrels from parts of links, over the ranges of the joints between them: the poses of least clearance.

    A barrel is a bar of its outer diameter from the base pin, half as long as the open cylinder,
    as for buckling.
    """
    arm, pressure = frame.today.arm, new.machine.supply.pressure
    for part in frame.requirements.clearances:
        polygon = np.array(part.points)
        for name in part.cylinders:
            i = [c.name for c in frame.today.cylinders].index(name)
            poses = _poses_between(frame.today, part, i)
            base, end = new.span(i, poses)
            along = end - base
            length = np.sqrt((along**2).sum(axis=-1))[..., None]
            tip = (
                base + along / length * ((new.closed[:, i] + new.stroke[:, i]) / 2)[:, None, None]
            )
            turn, origin = (
                arm.link_rotation(poses, part.link),
                arm.point(poses, part.link, np.zeros(3)),
            )
            bar = [np.einsum("bni,nij->bnj", p - origin, turn)[..., [0, 2]] for p in (base, tip)]
            radius = (
                barrel_outer(diameters(new, i)[0], new.machine.cylinders[i].barrel_wall, pressure)
                / 2
            )
            free = clearance(bar[0], bar[1], polygon) - radius[:, None]
            nearest = np.argsort(free[0].real)[:NEAREST]
            yield bounded(
                f"clearance.{part.name}.{name}", f"clearance of the {name} barrel, {part.name}", "m",
                free[:, nearest], part.distance, at_least=True, slack_scale=frame.today.cylinders[i].stroke,
                rounding=2 * ROUNDING / frame.today.cylinders[i].stroke, setting=f"clearance.{part.name}.distance_mm",
            )  # fmt: skip


def _mass(new: Candidate, limit: float) -> Condition:
    words = "estimated mass of all cylinders"
    return bounded(
        "cylinder_mass", words, "kg", estimated_masses(new), limit, setting="cylinder_mass_kg"
    )


def estimated_masses(new: Candidate) -> Array:
    """Estimated mass of all cylinders together (b,) [kg]."""
    total = np.zeros(len(new.areas))
    for i, cylinder in enumerate(new.machine.cylinders):
        bore, rod = diameters(new, i)
        total = total + cylinder.count * estimated_mass(
            bore, rod, new.stroke[:, i], new.machine.supply.pressure
        )
    return total
