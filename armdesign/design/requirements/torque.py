"""Torque of every actuator about its joint, extending and retracting, over the joint's range.

Available pressure (the supply's, or a lower relief's) × bore area × |moment arm| extending, ×
annulus area retracting; the area of a motor is its displacement at the joint [m³/rad]. A joint
that slides has a force in its place. An actuator across several joints has a torque about each,
the others in the middle of their ranges.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from armdesign.arrays import Array
from armdesign.design.requirements.candidate import Candidate, Reference, peak, thrusts
from armdesign.design.requirements.record import Evaluation, names_begin_with
from armdesign.design.requirements.stated import shares
from armdesign.machine.file.schema import share_of
from armdesign.machine.machine import Machine
from armdesign.mechanism.joint_ranges import over
from armdesign.mechanism.rigid_poses import RigidPoses

DIRECTIONS = "extending", "retracting"


@dataclass(frozen=True, kw_only=True)
class Torques:
    """Settings: torques.

    Attributes:
        torque_share: largest torque of each actuator in each direction over today's, at least; 0:
            no such limit.
        end_torque_share: its torque in each direction at both ends of the range over today's, at
            least; 0: no such limit.
    """

    torque_share: float | Mapping[str, float] = shares("torque_share")
    end_torque_share: float | Mapping[str, float] = shares("end_torque_share")


@dataclass(frozen=True, eq=False)
class Leverage:
    """Size of the moment arm (b, k) [m/rad] of an actuator about a joint over today's range."""

    actuator: int
    joint: int
    arm: Array

    def torque(self, new: Candidate) -> Array:
        """Torque (b, 2, k) [N m, N] extending and retracting."""
        return np.asarray(thrusts(new, self.actuator)[:, :, None] * self.arm[:, None, :])

    def largest(self, new: Candidate) -> Array:
        """Largest torque over the range (b, 2) [N m, N], by a parabola."""
        most = peak(np.arange(self.arm.shape[1]), self.arm)[1]
        return np.asarray(thrusts(new, self.actuator) * most[:, None])


def leverages(new: Candidate, reference: Reference) -> Iterator[Leverage]:
    """Every actuator about every joint that it moves."""
    today = reference.today
    for i, drive in enumerate(today.drives):
        for joint in drive.joints:
            swept = new.sweeps[i] if i < len(today.linkages) else None
            if swept is not None:
                arm = swept[1]
            else:
                arm = new.moment_arms(_over_range(today, joint, reference.samples))[:, :, i, joint]
            yield Leverage(i, joint, arm * np.where(arm.real < 0, -1.0, 1.0))


@lru_cache(maxsize=16)
def _over_range(today: Machine, joint: int, samples: int) -> RigidPoses:
    """Poses over the range of a joint, the others in the middle of theirs."""
    q = np.tile(today.ranges.mean(axis=1), (samples, 1))
    q[:, joint] = over(today.ranges[joint], samples)
    return today.arm.kinematics(q)


@names_begin_with("torque", "end_torque")
def torques(new: Candidate, reference: Reference) -> Iterator[Evaluation]:
    """Largest torque of every actuator, and its torque at both ends of the range, both ways."""
    requirements, today = reference.requirements, reference.today
    if requirements.torque_share == 0 == requirements.end_torque_share:
        return
    pairs = zip(leverages(new, reference), leverages(reference.old, reference), strict=True)
    for now, before in pairs:
        actuator, joint = today.actuators[now.actuator], today.arm.joints[now.joint]
        several = len(today.drives[now.actuator].joints) > 1
        name = f"{actuator.name}.{joint.name}" if several else actuator.name
        words = f"{actuator.name} {actuator.kind}" + several * f" about {joint.name}"
        share = share_of(requirements.torque_share, actuator.name)
        at_ends = share_of(requirements.end_torque_share, actuator.name)
        largest, largest_today = now.largest(new), before.largest(reference.old)[0]
        ends = [c.torque(r)[:, :, [0, -1]] for c, r in ((now, new), (before, reference.old))]
        for side, direction in enumerate(DIRECTIONS):
            if share > 0:
                most = float(largest_today[side])
                yield Evaluation(
                    name=f"torque.{direction}.{name}",
                    words=f"largest torque of the {words}, {direction}",
                    unit="N m" if joint.revolute else "N",
                    value=largest[:, side],
                    limit=share * most,
                    at_least=True,
                    scale=most,
                    setting=f"torque_share.{actuator.name}",
                )
            known = ends[1][0, side] > 0  # none is left to keep at a dead centre
            if at_ends > 0 and known.any():
                yield Evaluation(
                    name=f"end_torque.{direction}.{name}",
                    words=f"torque of the {words}, {direction}, at an end over today's there",
                    unit="",
                    value=ends[0][:, side, known] / ends[1][:, side, known],
                    limit=at_ends,
                    at_least=True,
                    scale=1.0,
                    setting=f"end_torque_share.{actuator.name}",
                )
