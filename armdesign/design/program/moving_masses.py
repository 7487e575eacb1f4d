"""Masses of cylinders and four-bars that move with the design: they follow sizes and pins.

Every bar keeps the steel of today's per length and section: a barrel weighs in proportion to its
bore area and the closed length (a wall that grows with the bore is what equal pressure asks), a
rod to its area and that length, rocker and coupler to their lengths. So for given pins inertia,
gravity and its slope are affine in the areas.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np

from armdesign.arrays import Array
from armdesign.hydraulics.actuator import Cylinder
from armdesign.machine.machine import Machine
from armdesign.mechanism.arm import RigidPoses
from armdesign.mechanism.linkage.base import Linkage
from armdesign.mechanism.point_masses import of_bar

InertiaAndGravity: TypeAlias = tuple[Array, Array, Array]  # M, g and ∂g/∂q


def masses(
    cylinder: Cylinder, linkage: Linkage, areas: Any, closed: Any, new: Linkage
) -> dict[str, Any]:
    """Mass of each bar that weighs [kg] with other sizes, all parallel cylinders together.

    Args:
        cylinder: today's.
        linkage: today's.
        areas: bore and annulus, all together (…, 2) [m²]; may be complex.
        closed: length [m].
        new: the linkage with the new four-bar.
    """
    longer, rod = closed / cylinder.closed_length, cylinder.bore_area - cylinder.annulus_area
    shares = {
        "barrel": areas[..., 0] / cylinder.bore_area * longer,
        "rod": (areas[..., 0] - areas[..., 1]) / rod * longer,
    }
    shares |= {bar: getattr(new, bar) / getattr(linkage, bar) for bar in linkage.bar_names}
    return {name: mass * shares[name] for name, mass in cylinder.moving_masses.items()}


def with_masses(cylinder: Cylinder, masses: Mapping[str, Any]) -> Cylinder:
    """A cylinder with bars of other masses [kg], all parallel cylinders together."""
    bars = tuple((bar, float(masses.get(bar, mass))) for bar, mass in cylinder.linkage_masses)
    own: dict[str, Any] = {
        f"{name}_mass": float(masses[name]) / cylinder.count
        for name in ("barrel", "rod")
        if name in masses
    }
    return replace(cylinder, linkage_masses=bars, **own)


def weighed(new: Machine, today: Machine) -> Machine:
    """A machine with the masses that its sizes and pins make of today's."""
    cylinders = []
    for c, linkage, old, before in zip(
        new.cylinders, new.linkages, today.cylinders, today.linkages, strict=True
    ):
        areas = np.array([c.bore_area, c.annulus_area])
        cylinders.append(with_masses(c, masses(old, before, areas, c.closed_length, linkage)))
    return replace(new, cylinders=tuple(cylinders))


@dataclass(frozen=True, eq=False)
class MovingMasses:
    """The bars of a machine that a design changes: for each of some cylinders, their names."""

    machine: Machine
    bars: Mapping[int, Sequence[str]]

    @property
    def without_bars(self) -> Machine:
        """The machine without these bars."""
        cylinders = list(self.machine.cylinders)
        for i, names in self.bars.items():
            cylinders[i] = with_masses(cylinders[i], dict.fromkeys(names, 0.0))
        return replace(self.machine, cylinders=tuple(cylinders))

    def rows(self, i: int) -> slice:
        """Places of the bars of cylinder ``i`` among all of them."""
        first = sum(len(names) for k, names in self.bars.items() if k < i)
        return slice(first, first + len(self.bars[i]))

    def masses(self, areas: Array, closed: Array, linkages: Sequence[Linkage]) -> Array:
        """Mass of each bar (…, k) [kg] by areas (…, nc, 2) [m²], closed lengths [m] and bars."""
        return np.concatenate(
            [self.masses_of(i, areas[..., i, :], closed[..., i], linkages[i]) for i in self.bars],
            axis=-1,
        )

    def masses_of(self, i: int, areas: Array, closed: Any, linkage: Linkage) -> Array:
        """Mass of each bar of one cylinder (…, k) [kg]."""
        each = masses(self.machine.cylinders[i], self.machine.linkages[i], areas, closed, linkage)
        like = areas[..., 0]  # whose shape and type rocker and coupler alone would not have
        return np.stack(
            np.broadcast_arrays(like, *(each[name] for name in self.bars[i])), axis=-1
        )[..., 1:]

    def units(
        self, linkages: Sequence[Linkage], closed: Array, rigid: RigidPoses
    ) -> InertiaAndGravity:
        """M, g and ∂g/∂q of a kilogram of each bar (k, n, …)."""
        parts = []
        for i in self.bars:  # each once wherever all that carries it stands alike
            few, back = rigid.distinct(*self._carrying(linkages[i]))
            units = self.units_of(i, linkages[i], closed[i], few)
            parts.append([unit[:, back] for unit in units])
        mass, gravity, slope = (np.concatenate(part) for part in zip(*parts, strict=True))
        return mass, gravity, slope

    def _carrying(self, linkage: Linkage) -> list[int]:
        """Joints between the root and the pins of a linkage."""
        arm = self.machine.arm
        paths = (arm.path(arm.root, pin.link) for pin in linkage.pins)
        between = {j for path in paths for j, _ in path}
        return sorted(j for j in between if j < len(self.machine.joints))  # springs do not move

    def units_of(
        self, i: int, linkage: Linkage, closed: Any, rigid: RigidPoses
    ) -> InertiaAndGravity:
        """M, g and ∂g/∂q of a kilogram of each bar of one cylinder (k, n, …)."""
        ends = linkage.bars(rigid, closed)
        parts = [of_bar(ends[name]) for name in self.bars[i]]
        mass, gravity, slope = (np.stack(part) for part in zip(*parts, strict=True))
        return mass, gravity, slope


def summed(masses: Array, units: InertiaAndGravity) -> InertiaAndGravity:
    """M, g and ∂g/∂q of bars (…, n, …) of masses (…, k), from terms of a kilogram of each."""
    mass, gravity, slope = (np.tensordot(masses, unit, axes=1) for unit in units)
    return mass, gravity, slope


def summed_by_row(masses: Array, units: InertiaAndGravity) -> InertiaAndGravity:
    """``summed`` where masses (n, k) differ row by row."""
    mass, gravity, slope = (np.einsum("nk,kn...->n...", masses, unit) for unit in units)
    return mass, gravity, slope
