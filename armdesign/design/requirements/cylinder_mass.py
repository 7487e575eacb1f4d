"""Mass of all cylinders together, estimated from their sizes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from armdesign.arrays import Array
from armdesign.design.requirements.candidate import Candidate, Reference, diameters
from armdesign.design.requirements.record import Evaluation
from armdesign.design.requirements.stated import number
from armdesign.hydraulics.cylinder_mass import estimated_mass


@dataclass(frozen=True, kw_only=True)
class CylinderMass:
    """Settings: mass.

    Attributes:
        cylinder_mass: estimated mass of all cylinders together [kg], at most; None: no such limit.
    """

    cylinder_mass: float | None = number("cylinder_mass_kg")


def cylinder_mass(new: Candidate, reference: Reference) -> Iterator[Evaluation]:
    """Estimated mass of all cylinders, where it is limited."""
    if reference.requirements.cylinder_mass is not None:
        yield Evaluation(
            name="cylinder_mass",
            words="estimated mass of all cylinders",
            unit="kg",
            value=estimated_masses(new),
            limit=reference.requirements.cylinder_mass,
            setting="cylinder_mass_kg",
        )


def estimated_masses(new: Candidate) -> Array:
    """Estimated mass of all cylinders together (b,) [kg]."""
    total = np.zeros(len(new.areas))
    for i, cylinder in enumerate(new.machine.cylinders):
        mass = estimated_mass(*diameters(new, i), new.stroke[:, i], new.machine.supply.pressure)
        total = total + cylinder.count * mass
    return total
