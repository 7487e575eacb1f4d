"""Load cases: a payload on a link, and the poses at which the link holds it."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from armdesign.arrays import Array, Flags
from armdesign.errors import ArmDesignError, choose
from armdesign.machine.heading import Heading
from armdesign.mechanism.rigid_poses import RigidPoses

PITCH_TOLERANCE = 1e-8  # [rad] a link tipped this far beyond its pitch limit still counts as on it


@dataclass(frozen=True, kw_only=True)
class LoadCase:
    """A point mass [kg] at a point ``at`` [m] of a link.

    ``pitch`` [rad] limits the poses at which the link holds it: the case exists at them alone.
    Which poses these are, and what ends them, is asked of ``limits`` and the methods alone. One
    that is not in the file sits where the file's case of the name ``like`` does.
    """

    name: str
    mass: float = 0.0
    link: str | None = None
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)
    pitch: tuple[float, float] | None = None
    like: str = ""

    def with_mass(self, mass: float) -> LoadCase:
        """Another mass [kg] in its place; no mass cannot fall out, so that it is at every pose."""
        pitch, like = self.pitch if mass else None, self.like or self.name
        return dataclasses.replace(self, name=f"{mass:g} kg", mass=mass, pitch=pitch, like=like)

    @property
    def limits(self) -> tuple[float, ...]:
        """Lower and upper limit of ``limited_angle`` [rad]; none if it exists at every pose."""
        return () if self.pitch is None or self.link is None else self.pitch

    @property
    def limit_location(self) -> tuple[str, str, str]:
        """Where the machine file gives the limits."""
        return "payload", self.like or self.name, "pitch_deg"

    def limited_angle(self, heading: Heading, rigid: RigidPoses) -> Array:
        """Angle of which limits end the poses of the load case: pitch of its link (n,) [rad]."""
        return heading.pitch(rigid, str(self.link))

    def from_middle(self, heading: Heading, rigid: RigidPoses) -> Array:
        """Limited angle from the middle of its limits, within half a turn (n,) [rad]."""
        return self.offset(self.limited_angle(heading, rigid))

    def offset(self, angle: Array) -> Array:
        """A limited angle (n,) from the middle of its limits, within half a turn [rad]."""
        low, high = self.limits
        turn = angle - (low + high) / 2
        return np.asarray(np.arctan2(np.sin(turn), np.cos(turn)))

    def room(self, heading: Heading, rigid: RigidPoses, *, upper: bool) -> Array:
        """Angle left to the upper limit or the lower one (n,) [rad]."""
        low, high = self.limits
        offset = self.from_middle(heading, rigid)
        return np.asarray((high - low) / 2 - (offset if upper else -offset))

    def pitch_excess(self, heading: Heading, rigid: RigidPoses) -> Array:
        """Angle by which the link is tipped out of its pitch range (n,) [rad].

        Negative where the link holds the load, zero on a limit; −inf for a case without a pitch
        range.
        """
        if not self.limits:
            return np.full(len(rigid), -np.inf)
        return self.excess(self.limited_angle(heading, rigid))

    def excess(self, angle: Array) -> Array:
        """What a limited angle (n,) is beyond its limits [rad]; negative within them."""
        low, high = self.limits
        return np.asarray(np.abs(self.offset(angle)) - (high - low) / 2)

    def exists(self, heading: Heading, rigid: RigidPoses) -> Flags:
        """Whether the load case exists at each pose (n,)."""
        return np.asarray(self.pitch_excess(heading, rigid) <= PITCH_TOLERANCE)


NO_LOAD = LoadCase(name="nothing")


def case_named(name: str, cases: Iterable[LoadCase], machine: str) -> LoadCase:
    """The load case of a name.

    Raises:
        ArmDesignError: there is none.
    """
    named = {case.name: case for case in cases}
    if name not in named:
        part, remedy = f"{machine}: payload {name}", choose(name, named)
        raise ArmDesignError(part, "no such load case", remedy)
    return named[name]


def place_of(case: LoadCase, of_file: Iterable[LoadCase]) -> LoadCase:
    """The file's load case whose place one has that is not in the file; else the case itself."""
    return next((one for one in of_file if one.name == case.like), case)


def placed_again(case: LoadCase, of_file: Iterable[LoadCase]) -> LoadCase:
    """A load case that is not in the file, where the file now has its place."""
    place = place_of(case, of_file)
    return case if place is case else place.with_mass(case.mass)


def case_of_mass(mass: float, cases: Iterable[LoadCase], machine: str) -> LoadCase:
    """A load case of a mass [kg], placed as the first of some cases that has a place.

    Held in that case's pitch range, but for no mass, which cannot fall out.

    Raises:
        ArmDesignError: no mass, or no case has a place.
    """
    part, first, *others = f"{machine}: payload", *cases
    if isinstance(mass, bool) or not isinstance(mass, int | float | np.number):
        fault = f"type {type(mass).__name__} is not allowed"
        raise ArmDesignError(part, fault, "give a name or a mass [kg]")
    try:
        mass = float(mass)
    except OverflowError:  # a whole number of hundreds of digits
        mass = math.inf
    if not 0 <= mass < math.inf:
        raise ArmDesignError(part, f"{mass:g} kg is not allowed", "give a mass in [0, ∞) kg")
    placed = next((case for case in (first, *others) if case.link is not None), None)
    if placed is None and mass > 0:
        fault = "no load case says where a mass sits"
        raise ArmDesignError(part, fault, "add link and at_mm to one")
    return (placed or first).with_mass(mass)
