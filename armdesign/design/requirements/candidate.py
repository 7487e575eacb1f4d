"""A design as the requirements see it, and what they refer to: today's machine.

A candidate's arrays have a variant on axis 0: one for a machine (``MachineCandidate``), one for
each of many sizes (``SizeCandidates``), or for the optimiser one per design variable, each with a
complex step along it (``program.gradient.SteppedDesign``). Every formula over them is
complex-safe, so the imaginary part of a stepped candidate is its exact derivative.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Protocol

import numpy as np

from armdesign.arrays import Array
from armdesign.hydraulics.actuator import areas_of
from armdesign.machine.lifting import unloaded
from armdesign.machine.machine import Machine
from armdesign.mechanism.arm import Arm
from armdesign.mechanism.joint_ranges import ENDED, over, sweep
from armdesign.mechanism.linkage.base import Linkage, moment_arms
from armdesign.mechanism.rigid_poses import RigidPoses

if TYPE_CHECKING:
    from armdesign.design.requirements.settings import Requirements

CHECKED_POSES = 181  # over a joint's range, at which a machine is judged and described


class Candidate(Protocol):
    """A design as the requirements see it."""

    @property
    def machine(self) -> Machine:
        """The machine from which the design takes counts, walls and supply."""

    @property
    def linkages(self) -> tuple[Linkage, ...]:
        """Every cylinder's pins and bars, without steps."""

    @property
    def areas(self) -> Array:
        """Bore and annulus area of all parallel actuators (b, nc, 2) [m², of a motor m³/rad]."""

    @property
    def closed(self) -> Array:
        """Closed lengths (b, nc) [m]; 0 of a motor."""

    @property
    def stroke(self) -> Array:
        """Strokes (b, nc) [m]; inf of a motor."""

    @property
    def sweeps(self) -> list[tuple[Array, Array] | None]:
        """Length and moment arm over each joint's range (b, k); None across several joints."""

    def place(self, i: int, name: str) -> Array | None:
        """A pin in its link (b, 3) or length of a bar (b, 1) [m]; None where there is none."""

    def transmission(self, i: int) -> Array:
        """Cosine of the angle between rocker and coupler over the range of the joint (b, k)."""

    def moment_arms(self, rigid: RigidPoses) -> Array:
        """∂ℓ/∂q at some poses (b, n, nc, nq)."""

    def span(self, i: int, rigid: RigidPoses) -> tuple[Array, Array]:
        """Base pin and rod end of a cylinder in the world (b, n, 3) [m]."""

    def bare_gravity(self, rigid: RigidPoses) -> Array:
        """Gravity torque without a load (b, n, nq) [N m], or (1, n, nq) for all."""


@dataclass(frozen=True, eq=False)
class Reference:
    """Reference of the requirements: today's machine, joint ranges at ``samples`` poses, limits.

    ``today`` has today's cylinders under the supply of the machine that is judged.
    """

    today: Machine
    requirements: Requirements
    samples: int

    @cached_property
    def old(self) -> MachineCandidate:
        """Today's machine as a candidate."""
        return MachineCandidate(self.today, self)

    @cached_property
    def spare(self) -> Array:
        """Shares of their strokes that cylinders keep free, as by ``spare_shares`` (nc, 2)."""
        return spare_shares(self.today, self.requirements.end_margin)


def spare_shares(today: Machine, end_margin: float) -> Array:
    """Share of its stroke that each cylinder keeps free at its joint's range ends (nc, 2).

    At the closed and the open one: what today's has left there, at most ``end_margin``. That is
    none where its stroke ends the range, but some where the joint's limit or the stroke of
    another cylinder does, beside it. None across several joints.
    """
    spare = np.zeros((len(today.cylinders), 2))
    for i, (linkage, cylinder) in enumerate(zip(today.linkages, today.cylinders, strict=True)):
        if len(linkage.joints) == 1:
            joint = linkage.joints[0]
            least, most = sorted(linkage.length(sweep(today.arm, joint, today.ranges[joint])))
            free = np.array([least - cylinder.closed_length, cylinder.open_length - most])
            shares = np.minimum(free / cylinder.stroke, end_margin)
            spare[i] = np.where(free < ENDED * cylinder.stroke, 0.0, shares)
    return spare


@lru_cache(maxsize=8)
def reference_of(today: Machine, requirements: Requirements, samples: int) -> Reference:
    """Today's machine as reference; remembered, because many designs are judged by it.

    Raises:
        ArmDesignError: a requirement that names what the machine does not have, or asks what
            cannot be.
    """
    requirements.refuse_unknown(today)
    return Reference(today, requirements, samples)


@dataclass(frozen=True, eq=False)
class MachineCandidate:
    """A machine as a candidate: one variant, in real numbers; joint ranges are today's."""

    machine: Machine
    reference: Reference

    @property
    def linkages(self) -> tuple[Linkage, ...]:
        """Every cylinder's pins and bars."""
        return self.machine.linkages

    @cached_property
    def areas(self) -> Array:
        """Bore and annulus of every actuator (1, nc, 2) [m²]."""
        return areas_of(self.machine.actuators)[None]

    @property
    def closed(self) -> Array:
        """Closed lengths (1, nc) [m]."""
        return self.machine.closed_lengths[None]

    @property
    def stroke(self) -> Array:
        """Strokes (1, nc) [m]."""
        return self.machine.strokes[None]

    @cached_property
    def sweeps(self) -> list[tuple[Array, Array] | None]:
        """Length and moment arm of each cylinder over today's range of its joint (1, k)."""
        return [
            _swept(k, *self._range(k)) if len(k.joints) == 1 else None
            for k in self.machine.linkages
        ]

    def _range(self, linkage: Linkage) -> tuple[Arm, tuple[float, ...], int]:
        """All that a sweep over today's range of a linkage's joint depends on: its key."""
        today = self.reference.today
        ends = tuple(today.ranges[linkage.joints[0]].tolist())
        return today.arm, ends, self.reference.samples

    def place(self, i: int, name: str) -> Array | None:
        """A pin of a cylinder's linkage in its link (1, 3) or length of a bar (1, 1) [m]."""
        place = self.machine.linkages[i].place(name)
        return None if place is None else np.array([place])

    def transmission(self, i: int) -> Array:
        """Cosine of the angle between rocker and coupler over today's range (1, k)."""
        linkage = self.machine.linkages[i]
        return _transmission(linkage, *self._range(linkage))

    def moment_arms(self, rigid: RigidPoses) -> Array:
        """∂ℓ/∂q at some poses (1, n, nc, nq)."""
        return moment_arms(self.machine.drives, rigid)[None]

    def span(self, i: int, rigid: RigidPoses) -> tuple[Array, Array]:
        """Base pin and rod end of a cylinder in the world (1, n, 3) [m]."""
        base, end = self.machine.linkages[i].ends(rigid)
        return base[None], end[None]

    def bare_gravity(self, rigid: RigidPoses) -> Array:
        """Gravity torque (1, n, nq) of links, cylinders and four-bars without a load [N m]."""
        return unloaded(self.machine, rigid)[None]


@dataclass(frozen=True, eq=False)
class SizeCandidates(MachineCandidate):
    """A machine with many ``sizes`` on its pins and strokes: a variant each (b, nc, 2) [m²]."""

    sizes: Array

    @property
    def areas(self) -> Array:
        """Bore and annulus of every actuator (b, nc, 2) [m²]."""
        return self.sizes

    def moment_arms(self, rigid: RigidPoses) -> Array:
        """∂ℓ/∂q at some poses (b, n, nc, nq)."""
        arms = super().moment_arms(rigid)
        return np.broadcast_to(arms, (len(self.sizes), *arms.shape[1:]))


@lru_cache(maxsize=64)
def _swept(
    linkage: Linkage, arm: Arm, ends: tuple[float, ...], samples: int
) -> tuple[Array, Array]:
    """Length and moment arm over its joint's range (1, k), remembered for many sizes."""
    joint = linkage.joints[0]
    actuation = linkage.actuation(sweep(arm, joint, over(np.array(ends), samples)))
    return actuation.length[None], actuation.moment_arm[None, :, joint]


@lru_cache(maxsize=64)
def _transmission(linkage: Linkage, arm: Arm, ends: tuple[float, ...], samples: int) -> Array:
    poses = sweep(arm, linkage.joints[0], over(np.array(ends), samples))
    return linkage.transmission(poses)[None]


def peak(values: Array, curve: Array) -> tuple[Array, Array]:
    """Place and size of the largest |curve| (b, k) over even values (k,), by a parabola."""
    k = int(np.abs(curve[0].real).argmax())
    middle = np.sign(curve[0, k].real) * curve[:, k]
    if k in (0, len(values) - 1):
        return np.full(len(curve), values[k]), middle
    before, after = (np.sign(curve[0, k].real) * curve[:, j] for j in (k - 1, k + 1))
    bend, slope = before - 2 * middle + after, (after - before) / 2
    if bend[0].real == 0:
        return np.full(len(curve), values[k]), middle
    return values[k] - slope / bend * (values[1] - values[0]), middle - slope**2 / bend / 2


def thrusts(new: Candidate, i: int) -> Array:
    """Available pressure × bore and annulus area of an actuator (b, 2) [N, N m]."""
    pressure = new.machine.actuators[i].available_pressure(new.machine.supply)
    return np.asarray(pressure * new.areas[:, i])


def diameters(new: Candidate, i: int) -> tuple[Array, Array]:
    """Bore and rod of one of the parallel cylinders (b,) [m]; there is a rod, if a thin one."""
    one = 4 / math.pi / new.machine.cylinders[i].count
    bore_area, rod_area = new.areas[:, i, 0], new.areas[:, i, 0] - new.areas[:, i, 1]
    thick = np.where(rod_area.real > 0, rod_area, 1e-6 * bore_area)
    return np.sqrt(one * bore_area), np.sqrt(one * thick)
