"""Speeds of joints and cylinders that the pump's flow must allow."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from armdesign.arrays import Array
from armdesign.design.requirements.candidate import Candidate, Reference
from armdesign.design.requirements.record import Evaluation, names_begin_with
from armdesign.design.requirements.stated import (
    Frozen,
    Names,
    Stated,
    at_work,
    by_joint,
    check_word,
    cylinders,
    stated,
)
from armdesign.errors import ArmDesignError
from armdesign.machine.machine import Machine
from armdesign.mechanism.linkage.gear import Gear
from armdesign.units import mm


@dataclass(frozen=True, kw_only=True)
class Speed(Frozen):
    """Actuators that move together at pump flow, at least this fast.

    Attributes:
        name: of the motion.
        joints: speed of joints [rad/s, m/s]; positive in the joint's own direction, negative
            against it.
        cylinders: speed of cylinders [m/s]; positive extends.
        at: "mean": over the joint's range, so that the whole range takes range/speed, the stroke
            time that data sheets and cycle times speak of; "every": at every pose of the range.
    """

    name: str
    joints: Mapping[str, float] = field(default_factory=dict)
    cylinders: Mapping[str, float] = field(default_factory=dict)
    at: Literal["mean", "every"] = "mean"

    def times(self, factor: float) -> Speed:
        """The same motion at a multiple of its speed."""
        joints, cylinders = (
            {k: factor * v for k, v in part.items()} for part in (self.joints, self.cylinders)
        )
        return replace(self, joints=joints, cylinders=cylinders)


def _read(machine: Machine) -> tuple[Speed, ...]:
    speeds = (
        Speed(
            name=name,
            joints=by_joint(
                machine, f"speed.{name}", section.joint_deg_per_s, section.joint_mm_per_s
            ),
            cylinders={
                cylinder: value * mm
                for cylinder, value in section.cylinder_mm_per_s.items()
                if at_work(machine, cylinder)
            },
            at=section.at,
        )
        for name, section in machine.section.requirements.speed.items()
    )
    return tuple(speed for speed in speeds if speed.joints or speed.cylinders)


def _names(speeds: tuple[Speed, ...], machine: Machine) -> Names:
    for speed in speeds:
        yield f"speed.{speed.name}", "joint", speed.joints, machine.joints
        yield f"speed.{speed.name}", "cylinder", speed.cylinders, cylinders(machine)


def _check(speeds: tuple[Speed, ...]) -> None:
    for speed in speeds:
        check_word(f"speed.{speed.name}.at", speed.at, ("mean", "every"))


@dataclass(frozen=True, kw_only=True)
class Speeds:
    """Settings: motions at pump flow.

    Attributes:
        speeds: motions at pump flow.
    """

    speeds: tuple[Speed, ...] = stated(
        Stated(
            key="speed",
            read=_read,
            number_of=lambda speeds, name: 1.0,
            changed=lambda speeds, name, factor: tuple(
                s.times(factor) if s.name == name else s for s in speeds
            ),
            names=_names,
            check=_check,
        ),
        default=(),
    )


@names_begin_with("speed")
def speeds(new: Candidate, reference: Reference) -> Iterator[Evaluation]:
    """Flow of every motion within the pump's."""
    for speed in reference.requirements.speeds:
        yield Evaluation(
            name=f"speed.{speed.name}",
            words=f"flow of the motion {speed.name}",
            unit="m³/s",
            value=flow(new, reference, speed),
            limit=new.machine.supply.flow,
            setting=f"speed.{speed.name}",
            inverse=True,
        )


def flow(new: Candidate, reference: Reference, speed: Speed) -> Array:
    """Flow that the actuators of a motion draw together (b,) [m³/s].

    Bore sides extending, annulus sides retracting, and motors, whose area is that of a radian.
    Over a joint's range the mean is the swept volume over the time; at every pose it is A |r| q̇
    where |r| is largest.

    Raises:
        ArmDesignError: a joint that a cylinder across several joints moves.
    """
    total = np.zeros(len(new.areas))
    for i in range(len(reference.today.actuators)):
        for rate in _rates(new, reference, speed, i):
            extends = np.real(np.ravel(rate)[0]) > 0
            area = new.areas[:, i, 0 if extends else 1]
            total = total + np.where(extends, rate, -np.asarray(rate)) * area
    return total


def _rates(new: Candidate, reference: Reference, speed: Speed, i: int) -> Iterator[float | Array]:
    """Speeds (b,) [m/s, of a motor rad/s] at which a motion moves one actuator, + extending."""
    today = reference.today
    name, drive = today.actuators[i].name, today.drives[i]
    if name in speed.cylinders:
        yield speed.cylinders[name]
    for joint, rate in speed.joints.items():
        j = today.joints.index(joint)
        if j not in drive.joints:
            continue
        if isinstance(drive, Gear):
            yield rate
            continue
        swept = new.sweeps[i]
        if swept is None:
            raise ArmDesignError(
                f"requirements.speed.{speed.name}",
                f'the {name} cylinder moves "{joint}" and other joints',
                "ask for the speed of the cylinder instead",
            )
        length, arm = swept
        if speed.at == "mean":
            yield rate * (length[:, -1] - length[:, 0]) / np.ptp(today.ranges[j])
        else:
            yield rate * arm[:, np.abs(arm[0].real).argmax()]
