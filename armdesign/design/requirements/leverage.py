"""Leverage of a cylinder by its pins: moment arms, transmission angles, digging forces."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from armdesign.arrays import Array
from armdesign.design.requirements.candidate import Candidate, Reference, peak, thrusts
from armdesign.design.requirements.record import Evaluation, names_begin_with
from armdesign.design.requirements.stated import (
    Stated,
    at_work,
    cylinders,
    fault_of,
    number,
    numbers_by_cylinder,
    shares,
    stated,
)
from armdesign.machine.assembly_faults import NO_DIGGING
from armdesign.machine.file.schema import DiggingSection, share_of
from armdesign.machine.machine import Machine
from armdesign.mechanism.joint_ranges import over
from armdesign.units import deg, kN

SHARE: float = DiggingSection.model_fields["share"].default


def _digging(machine: Machine, what: str, default: Any) -> Any:
    section = machine.section.requirements.digging
    return default if section is None else getattr(section, what)


@dataclass(frozen=True, kw_only=True)
class MomentArms:
    """Settings: moment arms, transmission angles, digging torque.

    Attributes:
        moment_arm_share: smallest moment arm over the joint range, over today's, at least.
        transmission: angle between rocker and coupler [rad], at least; or today's smallest, if
            that is lower.
        digging: names of the cylinders whose digging force counts, extending.
        digging_share: their digging torque over today's, at least; without effect up to
            ``torque_share``.
    """

    moment_arm_share: float | Mapping[str, float] = shares("moment_arm_share")
    transmission: float = number("transmission_deg", deg)
    digging: tuple[str, ...] = stated(
        Stated(
            key="digging",
            read=lambda m: tuple(c for c in _digging(m, "cylinders", ()) if at_work(m, c)),
            names=lambda v, m: iter([("digging", "cylinder", v, cylinders(m))]),
        ),
        default=(),
    )
    digging_share: float = stated(
        Stated(key="digging.share", read=lambda m: _digging(m, "share", SHARE)), default=SHARE
    )


@names_begin_with("moment_arm", "digging")
def leverage(new: Candidate, reference: Reference) -> Iterator[Evaluation]:
    """Smallest moment arm over the joint range, and digging torque at the best pose.

    The latter only where the share of the largest torque (``torque.py``) asks for less.

    The bound states both again for one cylinder alone: ``bound/cylinder_constraints.py``;
    ``test_branching_against_dense_sampling`` ties them.
    """
    requirements = reference.requirements
    sweeps = zip(reference.today.cylinders, new.sweeps, reference.old.sweeps, strict=True)
    for i, (cylinder, now, before) in enumerate(sweeps):
        if now is None or before is None:
            continue
        name, sign = cylinder.name, np.sign(before[1][0, 0])
        arm, today = sign * now[1], sign * before[1][0]
        yield Evaluation(
            name=f"moment_arm.{name}",
            words=f"smallest moment arm of the {name} cylinder",
            unit="m/rad",
            value=arm,
            limit=share_of(requirements.moment_arm_share, name) * float(today.min()),
            at_least=True,
            scale=float(today.min()),
            setting=f"moment_arm_share.{name}",
        )
        stated_by_torque = share_of(requirements.torque_share, name) >= requirements.digging_share
        if name in requirements.digging and not stated_by_torque:
            samples = np.arange(arm.shape[1])
            largest, largest_today = (peak(samples, a)[1] for a in (arm, today[None]))
            torque_today = float(thrusts(reference.old, i)[0, 0] * largest_today[0])
            yield Evaluation(
                name=f"digging.{name}",
                words=f"digging torque of the {name} cylinder",
                unit="N m",
                value=thrusts(new, i)[:, 0] * largest,
                limit=requirements.digging_share * torque_today,
                at_least=True,
                scale=torque_today,
                setting="digging.share",
            )


@names_begin_with("transmission")
def transmissions(new: Candidate, reference: Reference) -> Iterator[Evaluation]:
    """Angle between rocker and coupler of every four-bar, by its cosine.

    Near the limit cos(least) − cos(angle) ≈ sin(least) (angle − least).
    """
    pairs = zip(reference.today.cylinders, reference.today.linkages, strict=True)
    for i, (cylinder, linkage) in enumerate(pairs):
        if not linkage.transmission_words or len(linkage.joints) != 1:
            continue
        cosine, today = new.transmission(i), np.abs(reference.old.transmission(i)).max()
        least = min(reference.requirements.transmission, math.acos(min(float(today), 1.0)))
        scale = math.sin(least) * least or 1.0
        constraint = (math.cos(least) - cosine * np.sign(cosine.real)) / scale
        yield Evaluation(
            name=f"transmission.{cylinder.name}",
            words=f"{linkage.transmission_words}, {cylinder.name}",
            unit="rad",
            value=np.arccos(np.minimum(np.abs(cosine.real), 1.0)),
            limit=least,
            at_least=True,
            reformulated=(constraint, np.ones(1)),
            setting="transmission_deg",
            stated=least / deg,  # today's where that is lower than the setting
        )


@dataclass(frozen=True, kw_only=True)
class DiggingForce:
    """Settings: digging forces.

    Attributes:
        digging_force: force of cylinders at the tool [N], at least: one alone, extending, supply
            pressure, best angle (ISO 6015).
    """

    digging_force: Mapping[str, float] = numbers_by_cylinder("digging_kN", kN, "digging_force")


@names_begin_with("digging_force")
def digging_force(new: Candidate, reference: Reference) -> Iterator[Evaluation]:
    """Force at the tool of every cylinder of which one is asked."""
    limits = reference.requirements.digging_force
    forces = digging_forces(new, reference) if limits else {}
    for name, limit in limits.items():
        if name not in forces:
            path, section = f"digging_kN.{name}", reference.today.section.requirements
            in_file, fault = name in section.digging_kN, NO_DIGGING.format(name)
            raise fault_of(reference.today, path, in_file, fault, "leave it out")
        yield Evaluation(
            name=f"digging_force.{name}",
            words=f"digging force of the {name} cylinder",
            unit="N",
            value=forces[name],
            limit=limit,
            at_least=True,
            setting=f"digging_kN.{name}",
        )


def digging_forces(new: Candidate, reference: Reference) -> dict[str, Array]:
    """Force of each cylinder alone at the tool (b,) [N]: extending, at its best angle (ISO 6015).

    The force is tangential to the tool's arc about the joint that the cylinder turns; joints
    further out stand where their own cylinders dig best, of several the strongest, those without
    at the middle of their ranges. Cylinders that turn no single joint between root and tool are
    left out.
    """
    arm, ranges = reference.today.arm, reference.today.ranges
    # by joint: its cylinders with their best positions and torques there, the strongest first
    known: dict[int, list[tuple[str, Array, Array]]] = {}
    for i, (cylinder, swept) in enumerate(zip(reference.today.cylinders, new.sweeps, strict=True)):
        joint = reference.today.linkages[i].joints[0]
        if swept is None or not arm.joints[joint].revolute:
            continue
        where, most = peak(over(ranges[joint], reference.samples), swept[1])
        torque = thrusts(new, i)[:, 0] * most
        known.setdefault(joint, []).append((cylinder.name, where, torque))
    for several in known.values():
        several.sort(key=lambda one: float(-one[2][0].real))
    best = {joint: several[0][1] for joint, several in known.items()}
    q = ranges.mean(axis=1)
    for joint, where in best.items():
        q[joint] = where[0].real
    poses, tool = arm.kinematics(q[None]), reference.today.tool
    chain, forces = arm.chain(tool.link), {}
    motion = arm.motion(poses, tool.link, np.array(tool.at), arm.root, tuple(range(len(q))))
    for joint in (j for j in chain if j in best):
        axis, lever = poses.axis[0, joint], motion.value[0] - poses.translation[0, joint]
        lever = lever - axis * (axis @ lever)
        distance = float(np.linalg.norm(lever))
        if distance > 0:
            turned = sum(
                (best[k] - q[k]) * float(motion.first[0, k] @ lever)
                for k in _beyond(chain, joint, best)
            )
            for name, _, torque in known[joint]:
                forces[name] = torque / (distance + turned / distance)
    return forces


def _beyond(chain: tuple[int, ...], joint: int, known: dict[int, Any]) -> list[int]:
    """Joints further out than one, of those known."""
    return [k for k in chain[chain.index(joint) + 1 :] if k in known]
