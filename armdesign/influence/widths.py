"""Widths of ``[tolerances]``: which numbers of single machines differ, and by how much."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from armdesign.arrays import Array
from armdesign.errors import ArmDesignError
from armdesign.influence.family import Family, can_matter, moves_the_arm
from armdesign.machine.file.key_paths import Location
from armdesign.machine.file.numbers import Number, chosen_numbers, numbers_of
from armdesign.machine.machine import Machine

BARS = ("rocker_mm", "coupler_mm")
MASSES = ("barrel_kg", "rod_kg", "rocker_kg", "coupler_kg")
VOLUMES = ("dead_volume_l", "trapped_volume_l")
DEVIATIONS = 2.0  # of a normal distribution that make its width


@dataclass(frozen=True, kw_only=True)
class Width:
    """A number that differs from machine to machine, either way by at most ``half``.

    Attributes:
        name: its key path; ``link mass <joint>`` of what a joint moves before the next.
        number: of the machine file; None for the mass of links, which the URDF states.
        body: index of the coordinate whose mass it is.
        half: half width, in the number's unit, of a mass of links a share.
    """

    name: str
    number: Number | None
    body: int = -1
    half: float

    @property
    def value(self) -> float:
        """The value of the file; 1 for the mass of links."""
        return 1.0 if self.number is None else self.number.value

    @property
    def limits(self) -> tuple[float, float]:
        """Least and largest value that a machine may have."""
        low, high = self.value - self.half, self.value + self.half
        if self.number is None:
            return low, high
        return max(low, self.number.low), min(high, self.number.high)

    def values(self, places: Array, normal: bool) -> Array:
        """Values (n,) at places (n,) of a sequence within [0, 1)."""
        low, high = self.limits
        if not normal:
            return np.asarray(low + places * (high - low))
        from scipy.stats import norm

        spread = norm.ppf(np.clip(places, 1e-9, 1 - 1e-9)) * self.half / DEVIATIONS
        least = -math.inf if self.number is None else self.number.low
        return np.asarray(np.maximum(self.value + spread, least))


def widths_of(machine: Machine) -> tuple[Width, ...]:
    """The numbers that the file's ``[tolerances]`` lets differ and that can matter.

    Raises:
        ArmDesignError: it states no width, or one of a number that no batch of machines can vary.
    """
    section, source = machine.section.tolerances, machine.source.name
    stated = [key for key, value in section if key not in ("distribution", "least_hz") and value]
    if not stated:
        raise ArmDesignError(
            f"{source}: tolerances",
            "states no width",
            "add some to [tolerances], such as pin_mm = 0.5 or payload_percent = 5",
        )
    halves = _by_group(machine)
    for path, half in section.keys.items():
        part = f"{source}: tolerances.keys.{path}"
        for number in chosen_numbers(machine.section, path, part):
            _refuse_fixed(number.location, part)
            halves[number.path] = half
    known = numbers_of(machine.section)
    widths = [Width(name=path, number=known[path], half=half) for path, half in halves.items()]
    kept = [w for w in widths if w.half > 0 and w.number and can_matter(w.number.location)]
    kept += _of_links(machine)
    if not kept:
        raise ArmDesignError(
            f"{source}: tolerances",
            f"{', '.join(stated)} give no number a width: a share of zero is none",
            "give the width of a number that is not zero, or keys",
        )
    return tuple(kept)


def _refuse_fixed(location: Location, part: str) -> None:
    """Raise for numbers with which links or ends of the poses move."""
    if moves_the_arm(location) or "pitch_deg" in location or location[0] == "requirements":
        raise ArmDesignError(
            part, "has no tolerance: all machines have the same links and poses", "leave it out"
        )


def _by_group(machine: Machine) -> dict[str, float]:
    """Half widths by key path, in the unit of the key."""
    halves = {}
    for path, number in numbers_of(machine.section).items():
        for half in _half(machine, number):
            halves[path] = half
    return halves


def _half(machine: Machine, number: Number) -> Iterator[float]:
    """Half width of a number by the group that it belongs to, if it has one."""
    section, at, value = machine.section.tolerances, number.location, abs(number.value)
    head, last = at[0], at[-1]
    shares = {
        "payload_percent": head == "payload" and last == "mass_kg",
        "cylinder_mass_percent": head == "cylinder" and last in MASSES,
        "bulk_modulus_percent": at == ("fluid", "bulk_modulus_MPa"),
        "dead_volume_percent": any(key in at for key in VOLUMES),
        "compliance_percent": str(last).startswith("compliance_"),
        "spring_stiffness_percent": head == "spring" and str(last).startswith("stiffness_"),
    }
    absolute = {
        "pin_mm": head == "cylinder" and at[-2] == "at_mm" and last in (0, 2),
        "bar_mm": head == "cylinder" and last in BARS,
        "entrained_air_percent": at == ("fluid", "entrained_air_percent"),
    }
    for key, belongs in (shares | absolute).items():
        width = getattr(section, key)
        if belongs and width is not None:
            yield width if key in absolute else width / 100 * value


def _of_links(machine: Machine) -> list[Width]:
    """Mass and inertia of what each coordinate moves before the next."""
    percent = machine.section.tolerances.link_mass_percent
    masses = machine.arm.bodies(machine.arm.kinematics(machine.ranges.mean(axis=1)[None]))[0]
    return [
        Width(name=f"link mass {joint.name}", number=None, body=k, half=percent / 100)
        for k, (joint, mass) in enumerate(zip(machine.arm.coordinates, masses, strict=True))
        if percent is not None and mass > 0
    ]


def family_of(machine: Machine, widths: tuple[Width, ...], values: Array) -> Family:
    """The family whose members (n) have these values (n, w) of the numbers with widths."""
    count = len(values)
    shares = np.ones((count, len(machine.arm.coordinates)))
    numbers = {}
    for width, column in zip(widths, values.T, strict=True):
        if width.number is None:
            shares[:, width.body] = column
        else:
            numbers[width.number.location] = column
    with_links = any(width.number is None for width in widths)
    return Family.of(machine, numbers, count, shares if with_links else None)


def at_ends(widths: Sequence[Width]) -> Array:
    """Values (2 w, w) of machines as drawn but for one number each: all lower ends, then upper."""
    drawn, limits = (
        np.array([getattr(one, name) for one in widths]) for name in ("value", "limits")
    )
    own = np.eye(len(widths), dtype=bool)
    return np.concatenate([np.where(own, end, drawn) for end in limits.T])
