"""Strength and build of a cylinder: thrust, dead length, buckling of its rod, mass."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from armdesign.arrays import Array
from armdesign.design.requirements.candidate import Candidate, Reference, diameters, thrusts
from armdesign.design.requirements.record import Evaluation, names_begin_with
from armdesign.design.requirements.stated import Stated, check_word, number, shares, stated
from armdesign.hydraulics.cylinder_build import (
    STEEL_MODULUS,
    barrel_outer,
    estimated_mass,
    euler_safety,
    second_moment,
    stepped_load,
)
from armdesign.machine.file.schema import share_of

ROUNDING_LENGTH = 3e-4  # [m] that rounding to 0.1 mm may cost the dead length


@dataclass(frozen=True, kw_only=True)
class Thrust:
    """Settings: thrust.

    Attributes:
        thrust_share: available pressure × bore area of each cylinder over today's, at most.
    """

    thrust_share: float | Mapping[str, float] = shares("thrust_share")


@dataclass(frozen=True, kw_only=True)
class Buckling:
    """Settings: buckling.

    Attributes:
        buckling_share: Euler safety of each rod over today's, at least.
        buckling_factor: buckling load over the thrust of one cylinder, at least; None: no limit.
        buckling_column: what buckles then: "rod", all of the open cylinder as thick as the rod
            (Euler); "stepped", barrel and rod.
    """

    buckling_share: float | Mapping[str, float] = shares("buckling_share")
    buckling_factor: float | None = number("buckling_factor")
    buckling_column: Literal["rod", "stepped"] = stated(
        Stated(
            key="buckling_column",
            read=lambda machine: machine.section.requirements.buckling_column,
            check=lambda word: check_word("buckling_column", word, ("rod", "stepped")),
        )
    )


@names_begin_with("thrust", "dead_length", "buckling", "buckling_factor")
def strength(new: Candidate, reference: Reference) -> Iterator[Evaluation]:
    """Thrust, dead length and buckling of each cylinder.

    The bound states them again for one cylinder alone: ``bound/cylinder_constraints.py``;
    ``test_branching_against_dense_sampling`` ties them. Buckling has a convex relaxation in
    ``program/constraints.py``, tied by
    ``test_relaxed_constraints_hold_wherever_the_true_ones_do``.
    """
    requirements = reference.requirements
    for i, cylinder in enumerate(reference.today.cylinders):
        name, today = cylinder.name, float(thrusts(reference.old, i)[0, 0])
        yield Evaluation(
            name=f"thrust.{name}",
            words=f"thrust of the {name} cylinder",
            unit="N",
            value=thrusts(new, i)[:, 0],
            limit=share_of(requirements.thrust_share, name) * today,
            scale=today,
            setting=f"thrust_share.{name}",
        )
        yield Evaluation(
            name=f"dead_length.{name}",
            words=f"dead length of the {name} cylinder",
            unit="m",
            value=new.closed[:, i] - new.stroke[:, i],
            limit=cylinder.dead_length,
            at_least=True,
            slack_scale=cylinder.stroke,
            tightening_factor=0.0,
            rounding_loss=ROUNDING_LENGTH / cylinder.stroke,
        )
        if (share := share_of(requirements.buckling_share, name)) > 0:
            least = share * float(_buckling_safety(reference.old, i, "rod")[0])
            words = f"Euler buckling safety of the {name} rod"
            yield _buckling(f"buckling_share.{name}", words, new, reference, i, "rod", least)
        if requirements.buckling_factor is not None:
            column, least = requirements.buckling_column, requirements.buckling_factor
            part = "rod" if column == "rod" else "barrel and rod"
            words = f"safety of the {name} {part} against buckling"
            yield _buckling("buckling_factor", words, new, reference, i, column, least)


def _buckling(
    setting: str,
    words: str,
    new: Candidate,
    reference: Reference,
    i: int,
    column: str,
    least: float,
) -> Evaluation:
    """Buckling: as a lower limit of the rod's area, in which it is nearly linear.

    The load of a rod grows with the square of its area: it needs L √(c A1), see
    ``rod_area_factor``; less in a stepped column, by the root of what the barrel adds to the load.
    """
    cylinder, today = new.machine.cylinders[i], float(reference.old.areas[0, i, 0])
    safety = _buckling_safety(new, i, column)
    rod_area = new.areas[:, i, 0] - new.areas[:, i, 1]
    pressure = cylinder.available_pressure(new.machine.supply)
    factor = rod_area_factor(cylinder.count, pressure, least)
    needed = (new.closed[:, i] + new.stroke[:, i]) * np.sqrt(factor * new.areas[:, i, 0])
    if column == "stepped":
        needed = needed * np.sqrt(_buckling_safety(new, i, "rod") / safety)
    # below 1 the rod buckles under the thrust, as today's may already, of which a share is kept
    end = min(1.0, least) if least > 1 or setting == "buckling_factor" else 0.0
    return Evaluation(
        name=f"{setting.split('.')[0].removesuffix('_share')}.{reference.today.cylinders[i].name}",
        words=words,
        unit="",
        value=safety,
        limit=least,
        at_least=True,
        reformulated=(((rod_area - needed) / today)[:, None], (0.5 * needed / today)[:, None]),
        power=0.5,
        tightening_factor=4.0,
        curved=True,
        setting=setting,
        end=end,
    )


def _buckling_safety(new: Candidate, i: int, column: str) -> Array:
    """Buckling load of an open cylinder over its thrust (b,).

    As a column of barrel and rod each is half of it: the dead length is shared by both ends.
    """
    bore, rod = diameters(new, i)
    cylinder, supply = new.machine.cylinders[i], new.machine.supply
    length = new.closed[:, i] + new.stroke[:, i]
    pressure = cylinder.available_pressure(supply)
    if column == "rod":
        return np.asarray(euler_safety(bore, rod, length, pressure))
    thrust = pressure * math.pi / 4 * bore**2
    barrel = second_moment(barrel_outer(bore, cylinder.barrel_wall, supply.pressure), bore)
    return np.asarray(stepped_load(barrel, second_moment(rod), length / 2, length / 2) / thrust)


def rod_area_factor(cylinder_count: int, pressure: float, safety: float) -> float:
    """The c in rod area ≥ L √(c A1) for a safety π E (A1 − A2)²/(4 n L² p A1) of n cylinders."""
    return safety * 4 * cylinder_count * pressure / (math.pi * STEEL_MODULUS)


@dataclass(frozen=True, kw_only=True)
class CylinderMass:
    """Settings: mass.

    Attributes:
        cylinder_mass: estimated mass of all cylinders together [kg], at most; None: no such limit.
    """

    cylinder_mass: float | None = number("cylinder_mass_kg")


@names_begin_with("cylinder_mass")
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
    total, pressure = np.zeros(len(new.areas)), new.machine.supply.pressure
    for i, cylinder in enumerate(new.machine.cylinders):
        sizes = (*diameters(new, i), new.stroke[:, i])
        mass = estimated_mass(*sizes, cylinder.barrel_wall, pressure)
        total = total + cylinder.count * mass
    return total
