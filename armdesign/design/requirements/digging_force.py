"""Digging forces: of each cylinder alone at the tool (ISO 6015)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from armdesign.arrays import Array
from armdesign.design.requirements.candidate import Candidate, Reference, peak
from armdesign.design.requirements.record import Evaluation
from armdesign.design.requirements.stated import numbers_by_cylinder
from armdesign.errors import ArmDesignError
from armdesign.mechanism.joint_ranges import over
from armdesign.units import kN


@dataclass(frozen=True, kw_only=True)
class DiggingForce:
    """Settings: digging forces.

    Attributes:
        digging_force: force of cylinders at the tool [N], at least: one alone, extending, supply
            pressure, best angle (ISO 6015).
    """

    digging_force: Mapping[str, float] = numbers_by_cylinder("digging_kN", kN, "digging_force")


def digging_force(new: Candidate, reference: Reference) -> Iterator[Evaluation]:
    """Force at the tool of every cylinder of which one is asked."""
    limits = reference.requirements.digging_force
    forces = digging_forces(new, reference) if limits else {}
    for name, limit in limits.items():
        if name not in forces:
            raise ArmDesignError(
                "requirements.digging_force",
                f"the {name} cylinder turns no single joint between root and tool",
                "leave it out",
            )
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
    further out stand where their own cylinders dig best. Cylinders that turn no single joint
    between root and tool are left out.
    """
    arm, ranges = reference.today.arm, reference.today.ranges
    # by joint: cylinder, its best position, torque there
    best: dict[int, tuple[str, Array, Array]] = {}
    for i, (cylinder, swept) in enumerate(zip(reference.today.cylinders, new.sweeps, strict=True)):
        joint = reference.today.linkages[i].joints[0]
        if swept is None or not arm.joints[joint].revolute:
            continue
        where, most = peak(over(ranges[joint], reference.samples), swept[1])
        best[joint] = cylinder.name, where, new.machine.supply.pressure * new.areas[:, i, 0] * most
    q = arm.limits.mean(axis=1)
    for joint, (_, where, _) in best.items():
        q[joint] = where[0].real
    poses, tool = arm.kinematics(q[None]), reference.today.tool
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
