"""Load cases: a payload on a link, and the poses at which the link holds it."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from armdesign.arrays import Array
from armdesign.errors import ArmDesignError, choose
from armdesign.mechanism.arm import Arm, RigidPoses

PITCH_TOLERANCE = 1e-8  # [rad] a link tipped this far beyond its pitch limit still counts as on it


@dataclass(frozen=True, kw_only=True)
class LoadCase:
    """A point mass [kg] at a point ``at`` [m] of a link.

    ``pitch`` [rad] limits the poses at which the link holds it: the case exists at them alone.
    """

    name: str
    mass: float = 0.0
    link: str | None = None
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)
    pitch: tuple[float, float] | None = None

    def pitch_excess(self, arm: Arm, rigid: RigidPoses) -> Array:
        """Angle by which the link is tipped out of its pitch range (n,) [rad].

        Negative where the link holds the load, zero on a limit; −inf for a case without a pitch
        range.
        """
        if self.pitch is None or self.link is None:
            return np.full(len(rigid), -np.inf)
        low, high = self.pitch
        offset = arm.pitch(rigid, self.link) - (low + high) / 2
        return np.abs(np.arctan2(np.sin(offset), np.cos(offset))) - (high - low) / 2


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


def case_of_mass(mass: float, cases: Iterable[LoadCase], machine: str) -> LoadCase:
    """A load case of a mass [kg], placed as the first of some cases that has a place.

    Raises:
        ArmDesignError: no mass, or no case has a place.
    """
    part, first, *others = f"{machine}: payload", *cases
    if isinstance(mass, bool) or not isinstance(mass, int | float | np.number):
        fault = f"a {type(mass).__name__} is not allowed"
        raise ArmDesignError(part, fault, "give a name or a mass [kg]")
    if not (math.isfinite(mass) and mass >= 0):
        raise ArmDesignError(part, f"{mass:g} kg is not allowed", "give a mass in [0, ∞) kg")
    placed = next((case for case in (first, *others) if case.link is not None), None)
    if placed is None and mass > 0:
        fault = "no load case says where a mass sits"
        raise ArmDesignError(part, fault, "add link and at_mm to one")
    return dataclasses.replace(placed or first, name=f"{mass:g} kg", mass=float(mass))
