"""Masses of cylinders and four-bars that move with the design: they follow sizes and pins.

Every bar keeps the steel of today's per length and section: a barrel weighs in proportion to its
bore area and the closed length (a wall that grows with the bore is what equal pressure asks), a
rod to its area and that length, rocker and coupler to their lengths. So for given pins inertia,
gravity and its slope are affine in the areas.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np

from armdesign.arrays import Array
from armdesign.hydraulics.actuator import Cylinder
from armdesign.machine.machine import Machine
from armdesign.mechanism.arm import Arm
from armdesign.mechanism.carried_bars import FirstMoments, M, Moments, gravity, inertia_and_gravity
from armdesign.mechanism.linkage.base import Linkage
from armdesign.mechanism.rigid_poses import RigidPoses

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

    def masses_of(self, i: int, areas: Array, closed: Any, linkage: Linkage) -> Array:
        """Mass of each bar of one cylinder (…, k) [kg]."""
        each = masses(self.machine.cylinders[i], self.machine.linkages[i], areas, closed, linkage)
        like = areas[..., 0]  # whose shape and type rocker and coupler alone would not have
        return np.stack(
            np.broadcast_arrays(like, *(each[name] for name in self.bars[i])), axis=-1
        )[..., 1:]

    def inertia_and_gravity(
        self, rigid: RigidPoses, moments: Callable[[int, RigidPoses], Moments]
    ) -> InertiaAndGravity:
        """M, g and ∂g/∂q of all bars (…, n, …).

        ``moments`` are those of the bars of a cylinder at some positions of its own joints.
        """
        each = [
            (mass[..., back, :, :], torque[..., back, :], slope[..., back, :, :])
            for where, at, back in self._of_each(rigid, moments)
            for mass, torque, slope in [inertia_and_gravity(*where, at)]
        ]
        mass, torque, slope = (np.sum(parts, axis=0) for parts in zip(*each, strict=True))
        return mass, torque, slope

    def gravity(
        self, rigid: RigidPoses, moments: Callable[[int, RigidPoses], FirstMoments]
    ) -> Array:
        """The g (…, n, k) [N m] of ``inertia_and_gravity`` alone, from first moments."""
        each = self._of_each(rigid, moments)
        return np.sum([gravity(*where, at)[..., back, :] for where, at, back in each], axis=0)

    def _of_each(
        self, rigid: RigidPoses, moments: Callable[[int, RigidPoses], M]
    ) -> Iterator[tuple[tuple[Arm, str, Sequence[int], RigidPoses], M, Array | slice]]:
        """Of each cylinder its arm, observer, own joints and the poses that differ for its bars.

        Their moments there, and which of these poses every pose (n,) is.
        """
        for i in self.bars:
            linkage = self.machine.linkages[i]
            few, back = rigid.distinct(*self._carrying(linkage))
            own = [j for j in linkage.joints if j < len(self.machine.joints)]
            positions, place = few.distinct(*own) if own else (few, slice(None))
            where = self.machine.arm, linkage.observer, linkage.joints, few
            yield where, moments(i, positions).at(place), back

    def _carrying(self, linkage: Linkage) -> list[int]:
        """Joints between the root and the pins of a linkage, but for springs, which stand."""
        arm = self.machine.arm
        paths = (arm.path(arm.root, pin.link) for pin in linkage.pins)
        between = {j for path in paths for j, _ in path}
        return sorted(j for j in between if j < len(self.machine.joints))
