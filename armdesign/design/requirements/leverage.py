"""Leverage of a cylinder by its pins: moment arms, digging torque, transmission angles."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from armdesign.design.requirements.candidate import Candidate, Reference, peak
from armdesign.design.requirements.record import Evaluation
from armdesign.design.requirements.stated import Stated, at_work, cylinders, number, stated
from armdesign.machine.file.requirements_schema import DiggingSection
from armdesign.machine.machine import Machine
from armdesign.units import deg

SHARE: float = DiggingSection.model_fields["share"].default


def _digging(machine: Machine, what: str, default: Any) -> Any:
    section = machine.section.requirements.digging
    return default if section is None else getattr(section, what)


@dataclass(frozen=True, kw_only=True)
class MomentArms:
    """Settings: moment arms, transmission angles, digging torque.

    Attributes:
        moment_arm_share: smallest moment arm over the joint range, at least.
        transmission: angle between rocker and coupler [rad], at least; or today's smallest, if
            that is lower.
        digging: names of the cylinders whose digging force counts, extending.
        digging_share: their digging torque, at least.
    """

    moment_arm_share: float = number("moment_arm_share")
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


def leverage(new: Candidate, reference: Reference) -> Iterator[Evaluation]:
    """Smallest moment arm over the joint range, and digging torque at the best pose.

    The bound states both again for one cylinder alone: ``bound/cylinder_constraints.py``;
    ``test_branching_against_dense_sampling`` ties them.
    """
    requirements, pressure = reference.requirements, new.machine.supply.pressure
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
            limit=requirements.moment_arm_share * float(today.min()),
            at_least=True,
            scale=float(today.min()),
            setting="moment_arm_share",
        )
        if name in requirements.digging:
            samples = np.arange(arm.shape[1])
            largest, largest_today = (peak(samples, a)[1] for a in (arm, today[None]))
            torque_today = pressure * float(reference.old.areas[0, i, 0] * largest_today[0])
            yield Evaluation(
                name=f"digging.{name}",
                words=f"digging torque of the {name} cylinder",
                unit="N m",
                value=pressure * new.areas[:, i, 0] * largest,
                limit=requirements.digging_share * torque_today,
                at_least=True,
                scale=torque_today,
                setting="digging.share",
            )


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
