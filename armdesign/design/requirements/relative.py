"""What each requirement means for a design: written once, for the check of a machine and for the optimiser.

Every formula is complex-safe, so the imaginary part of a complex-stepped candidate is its exact
derivative.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from armdesign.arrays import Array
from armdesign.design.requirements.absolute import explicit
from armdesign.design.requirements.candidate import (
    Built,
    Candidate,
    Condition,
    Frame,
    bounded,
    diameters,
    peak,
)
from armdesign.hydraulics.barrel import barrel_outer
from armdesign.hydraulics.buckling import STEEL_MODULUS, euler_load, second_moment, stepped_load
from armdesign.hydraulics.chamber_pressures import holding_force

ROUNDING_LENGTH = 3e-4  # [m] that rounding to 0.1 mm may cost the dead length


def conditions(new: Candidate, frame: Frame) -> Iterator[Condition]:
    """Every requirement that a design can miss, but for static forces over the workspace: ``static_loads_held``."""
    yield from _oil(new, frame)
    yield from _strength(new, frame)
    yield from _moment_arms(new, frame)
    yield from _transmissions(new, frame)
    yield from explicit(new, frame)


def _oil(new: Candidate, frame: Frame) -> Iterator[Condition]:
    """Swept volumes of both sides, summed and of each cylinder."""
    requirements, old, count = frame.requirements, frame.old, len(frame.today.cylinders)
    for side, label in enumerate(("cap", "annulus")):
        volume, today = (c.areas[:, :count, side] * c.stroke[:, :count] for c in (new, old))
        total = float(today.sum())
        limit = requirements.oil_total_share * total
        yield bounded(
            f"oil.{label}.total", f"oil of all {label} sides", "m³", volume.sum(axis=1), limit, scale=total,
            setting="oil_total_share",
        )  # fmt: skip
        for i, cylinder in enumerate(frame.today.cylinders):
            own, words = float(today[0, i]), f"oil of the {cylinder.name} cylinder's {label} side"
            limit = requirements.oil_each_share * own
            yield bounded(
                f"oil.{label}.{cylinder.name}",
                words,
                "m³",
                volume[:, i],
                limit,
                scale=own,
                setting="oil_each_share",
            )


def _strength(new: Candidate, frame: Frame) -> Iterator[Condition]:
    """Thrust, dead length and buckling of each cylinder."""
    requirements, pressure = frame.requirements, new.machine.supply.pressure
    for i, cylinder in enumerate(frame.today.cylinders):
        name, today = cylinder.name, float(frame.old.areas[0, i, 0])
        thrust = pressure * new.areas[:, i, 0]
        limit = requirements.thrust_share * pressure * today
        yield bounded(
            f"thrust.{name}", f"thrust of the {name} cylinder", "N", thrust, limit, scale=pressure * today,
            setting="thrust_share",
        )  # fmt: skip
        dead = new.closed[:, i] - new.stroke[:, i]
        yield bounded(
            f"dead_length.{name}", f"closed length less stroke, {name}", "m", dead, cylinder.dead_length,
            at_least=True, slack_scale=cylinder.stroke, care=0.0, rounding=ROUNDING_LENGTH / cylinder.stroke,
        )  # fmt: skip
        if requirements.buckling_share > 0:
            least = requirements.buckling_share * float(
                _buckling_safety(frame.old, i, pressure, "rod")[0]
            )
            words = f"Euler safety of the {name} rod"
            yield _buckling(f"buckling.{name}", words, new, i, pressure, "rod", least, today)
        if requirements.buckling_factor is not None:
            column, least = requirements.buckling_column, requirements.buckling_factor
            words = (
                f"safety of the {name} {'rod' if column == 'rod' else 'barrel and rod'} against"
                " buckling"
            )
            yield _buckling(
                f"buckling_factor.{name}", words, new, i, pressure, column, least, today
            )


def _buckling_safety(new: Candidate, i: int, pressure: float, column: str) -> Array:
    """Buckling load of an open cylinder over its thrust (b,).

    As a column of barrel and rod each is half of it: the dead length is shared by both ends.
    """
    bore, rod = diameters(new, i)
    length = new.closed[:, i] + new.stroke[:, i]
    thrust = pressure * math.pi / 4 * bore**2
    if column == "rod":
        return np.asarray(euler_load(second_moment(rod), length) / thrust)
    outer = barrel_outer(bore, new.machine.cylinders[i].barrel_wall, pressure)
    return np.asarray(
        stepped_load(second_moment(outer, bore), second_moment(rod), length / 2, length / 2)
        / thrust
    )


def _buckling(
    name: str,
    words: str,
    new: Candidate,
    i: int,
    pressure: float,
    column: str,
    least: float,
    today: float,
) -> Condition:
    """Buckling: as a lower limit of the rod's area, in which it is nearly linear.

    The load of a rod grows with the square of its area: it needs L √(c A1), see
    ``rod_area_factor``; less in a stepped column, by the root of what the barrel adds to the load.
    """
    safety = _buckling_safety(new, i, pressure, column)
    rod_area = new.areas[:, i, 0] - new.areas[:, i, 1]
    factor = rod_area_factor(new.machine.cylinders[i].count, pressure, least)
    needed = (new.closed[:, i] + new.stroke[:, i]) * np.sqrt(factor * new.areas[:, i, 0])
    if column == "stepped":
        needed = needed * np.sqrt(_buckling_safety(new, i, pressure, "rod") / safety)
    return bounded(
        name, words, "", safety, least, at_least=True,
        room=((rod_area - needed) / today)[:, None], easing=(0.5 * needed / today)[:, None], care=4.0,
        setting="buckling_factor" if name.startswith("buckling_factor.") else "buckling_share",
    )  # fmt: skip


def rod_area_factor(cylinder_count: int, pressure: float, safety: float) -> float:
    """C in rod area ≥ L √(c A1), which gives a safety: π E (A1 − A2)²/(4 n L² p A1) of all n cylinders."""
    return safety * 4 * cylinder_count * pressure / (math.pi * STEEL_MODULUS)


def _moment_arms(new: Candidate, frame: Frame) -> Iterator[Condition]:
    """Smallest moment arm over the joint range; digging torque at the best pose."""
    requirements, pressure = frame.requirements, new.machine.supply.pressure
    for i, (cylinder, now, before) in enumerate(
        zip(frame.today.cylinders, new.sweeps, frame.old.sweeps, strict=True)
    ):
        if now is None or before is None:
            continue
        name, sign = cylinder.name, np.sign(before[1][0, 0])
        arm, today = sign * now[1], sign * before[1][0]
        yield bounded(
            f"moment_arm.{name}", f"smallest moment arm of the {name} cylinder", "m/rad", arm,
            requirements.moment_arm_share * float(today.min()), at_least=True, scale=float(today.min()),
            setting="moment_arm_share",
        )  # fmt: skip
        if name in requirements.digging:
            samples = np.arange(arm.shape[1])
            most, once = (peak(samples, some)[1] for some in (arm, today[None]))
            own = pressure * float(frame.old.areas[0, i, 0] * once[0])
            torque = pressure * new.areas[:, i, 0] * most
            words, limit = (
                f"digging torque of the {name} cylinder",
                requirements.digging_share * own,
            )
            yield bounded(
                f"digging.{name}",
                words,
                "N m",
                torque,
                limit,
                at_least=True,
                scale=own,
                setting="digging.share",
            )


def _transmissions(new: Candidate, frame: Frame) -> Iterator[Condition]:
    """Angle between rocker and coupler of every four-bar, by its cosine.

    Near the limit cos(least) − cos(angle) ≈ sin(least) (angle − least).
    """
    for i, (cylinder, linkage) in enumerate(
        zip(frame.today.cylinders, frame.today.linkages, strict=True)
    ):
        if not linkage.transmission_words or len(linkage.joints) != 1:
            continue
        cosine, today = new.transmission(i), np.abs(frame.old.transmission(i)).max()
        least = min(frame.requirements.transmission, math.acos(min(float(today), 1.0)))
        yield bounded(
            f"transmission.{cylinder.name}", f"{linkage.transmission_words}, {cylinder.name}", "rad",
            np.arccos(np.minimum(np.abs(cosine.real), 1.0)), least, at_least=True,
            room=(math.cos(least) - cosine * np.sign(cosine.real)) / (math.sin(least) * least or 1.0),
            easing=np.ones(1), setting="transmission_deg",
        )  # fmt: skip


def static_loads_held(new: Candidate, frame: Frame, forces: Array) -> Iterator[Condition]:
    """Static forces (b, k, nc) [N, + pushes] within a share of what the supply holds.

    The share used is infinite where the supply holds nothing: pulling on a rod so thick that the
    return pressure on the bore outdoes the supply's on the annulus.
    """
    share, supply = frame.requirements.holding_share, new.machine.supply
    for i, actuator in enumerate(frame.today.actuators):
        pushes = forces[0, :, i].real > 0
        held = holding_force(new.areas[:, i, None, 0], new.areas[:, i, None, 1], supply, pushes)
        used = forces[:, :, i] * np.where(pushes, 1.0, -1.0)
        holds, loaded = held.real > 0, used.real > 0
        ratio = np.where(holds, used / np.where(holds, held, 1.0), np.where(loaded, np.inf, 0.0))
        scale = supply.pressure * float(frame.old.areas[0, i, 0])
        words = f"static load of the {actuator.name} {actuator.kind} over what the supply gives"
        yield bounded(
            f"holding.{actuator.name}", words, "", ratio, share,
            room=(share * held - used) / scale, easing=share * held / scale, setting="holding_share",
        )  # fmt: skip


def guaranteed(new: Built, frame: Frame, box: float) -> Iterator[Condition]:
    """What the optimiser keeps by how it makes designs, and a machine may miss: strokes and pin boxes."""
    for i, cylinder in enumerate(frame.today.cylinders):
        name, swept, linkage = cylinder.name, new.sweeps[i], new.machine.linkages[i]
        if swept is not None:
            length, words = swept[0], f"stroke covers {frame.today.joints[linkage.joints[0]]}"
            open_length = new.closed[:, i] + new.stroke[:, i]
            for end, value, limit, at_least in (
                ("open", open_length, float(length.max()), True),
                ("closed", new.closed[:, i], float(length.min()), False),
            ):
                yield bounded(
                    f"range.{end}.{name}",
                    words,
                    "m",
                    value,
                    limit,
                    at_least=at_least,
                    slack_scale=cylinder.stroke,
                )
        for place in linkage.places:
            here, before = new.place(i, place), frame.old.place(i, place)
            if here is not None and before is not None:
                own = frame.requirements.box_of(name, place, box)
                moved = np.abs(here - before).max(axis=1)
                words = f"change of the {name} {place}'s length"
                if place in linkage.pin_names:
                    words = f"move of the {name} cylinder's {place.replace('_', '-')} pin"
                yield bounded(
                    f"pin_box.{name}.{place}", words, "m", moved, own, slack_scale=own or 1.0
                )
