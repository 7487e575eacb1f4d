"""A design as the requirements see it, what they refer to, and what one of them is.

A candidate's arrays have a variant on axis 0: one for a machine (``Built``), or for the optimiser
one per design variable, each with a complex step along it (``limits.Stepped``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Protocol

import numpy as np

from armdesign.arrays import Array
from armdesign.design.requirements.lifting import LiftPose, lift_pose, unloaded
from armdesign.design.requirements.settings import Requirements
from armdesign.machine.machine import Machine
from armdesign.mechanism.arm import Arm, RigidPoses
from armdesign.mechanism.joint_ranges import over, sweep
from armdesign.mechanism.linkage.base import Linkage


@dataclass(frozen=True, eq=False, kw_only=True)
class Condition:
    """One requirement on b variants of a design at k places.

    Attributes:
        name: of the requirement.
        words: what it is about.
        unit: SI, of value and limit.
        value: what the design has (b, k).
        limit: what it may have.
        at_least: whether the limit is a lower one.
        slack_scale: what a slack is a share of; None: the limit.
        room: as the optimiser sees it (b, k), dimensionless, ≥ 0 where met.
        easing: room per 100 % of the limit (b, k), or the same for all.
        care: how many times its share rounding may cost of the limit.
        rounding: room that rounding of pins to the grid may cost besides.
        setting: key under ``[requirements]`` that states the limit; empty where none does.
    """

    name: str
    words: str
    unit: str
    value: Array
    limit: float
    at_least: bool
    slack_scale: float | None
    room: Array
    easing: Array | float
    care: float = 1.0
    rounding: float = 0.0
    setting: str = ""

    @property
    def slack(self) -> Array:
        """Room (b, k) as a share of the limit, or of ``slack_scale``; ≥ 0 where met."""
        room = self.value.real - self.limit if self.at_least else self.limit - self.value.real
        slack = room / (self.slack_scale or abs(self.limit) or 1.0)
        slack[np.abs(slack) < 1e-12] = 0.0  # nothing but the rounding of the arithmetic is left
        return np.asarray(slack)


def bounded(
    name: str,
    words: str,
    unit: str,
    value: Array,
    limit: float,
    *,
    at_least: bool = False,
    scale: float | None = None,
    slack_scale: float | None = None,
    room: Array | None = None,
    easing: Array | None = None,
    care: float = 1.0,
    rounding: float = 0.0,
    setting: str = "",
) -> Condition:
    """A condition whose room is the distance to the limit over ``scale`` (its size if None)."""
    value = value[:, None] if value.ndim == 1 else value
    scale = scale or slack_scale or abs(limit) or 1.0
    if room is None:
        room = (value - limit if at_least else limit - value) / scale
    return Condition(
        name=name,
        words=words,
        unit=unit,
        value=value,
        limit=limit,
        at_least=at_least,
        slack_scale=slack_scale,
        room=room,
        easing=abs(limit) / scale if easing is None else easing,
        care=care,
        rounding=rounding,
        setting=setting,
    )


class Candidate(Protocol):
    """A design as the requirements see it."""

    @property
    def machine(self) -> Machine:
        """What the design leaves as it is: counts, walls, supply."""

    @property
    def areas(self) -> Array:
        """Bore and annulus areas of every actuator, all parallel cylinders together (b, nc, 2) [m²]."""

    @property
    def closed(self) -> Array:
        """Closed lengths (b, nc) [m]; 0 of a motor."""

    @property
    def stroke(self) -> Array:
        """Strokes (b, nc) [m]; inf of a motor."""

    @property
    def sweeps(self) -> list[tuple[Array, Array] | None]:
        """Length and moment arm of each cylinder over the range of its joint (b, k).

        None across several joints.
        """

    def place(self, i: int, name: str) -> Array | None:
        """A pin of a cylinder's linkage in its link (b, 3) or length of a bar (b, 1) [m].

        None where there is none.
        """

    def transmission(self, i: int) -> Array:
        """Cosine of the angle between rocker and coupler over the range of the joint (b, k)."""

    def moment_arms(self, rigid: RigidPoses) -> Array:
        """∂ℓ/∂q at some poses (b, n, nc, nq)."""

    def span(self, i: int, rigid: RigidPoses) -> tuple[Array, Array]:
        """Base pin and rod end of a cylinder in the world (b, n, 3) [m]."""

    def bare_gravity(self, rigid: RigidPoses) -> Array:
        """Gravity torque (b, n, nq) of links, cylinders and four-bars without a load [N m].

        Or (1, n, nq) for all.
        """


@dataclass(frozen=True, eq=False)
class Frame:
    """What the requirements refer to: today's machine, its joint ranges at ``samples`` poses, the limits.

    ``today`` has today's cylinders under the supply of the machine that is judged.
    """

    today: Machine
    requirements: Requirements
    samples: int

    @cached_property
    def old(self) -> Built:
        """Today's machine as a candidate."""
        return Built(self.today, self)

    @cached_property
    def lifts(self) -> list[LiftPose]:
        """Every lift at its pose."""
        return [
            lift_pose(self.today, lift, self.requirements.holding_share)
            for lift in self.requirements.lifts
        ]


@lru_cache(maxsize=8)
def frame_of(today: Machine, requirements: Requirements, samples: int) -> Frame:
    """The frame of today's machine; remembered, because many designs are judged in it.

    Raises:
        ArmDesignError: a requirement that names what the machine does not have, or asks what
            cannot be.
    """
    requirements.refuse_unknown(today)
    return Frame(today, requirements, samples)


@dataclass(frozen=True, eq=False)
class Built:
    """A machine as a candidate: one variant, in real numbers."""

    machine: Machine
    frame: Frame

    @cached_property
    def areas(self) -> Array:
        """See ``Candidate``."""
        return np.array([[[f.bore_area, f.annulus_area] for f in self.machine.actuators]])

    @cached_property
    def closed(self) -> Array:
        """See ``Candidate``."""
        return np.array([[f.closed_length for f in self.machine.actuators]])

    @cached_property
    def stroke(self) -> Array:
        """See ``Candidate``."""
        return np.array([[f.stroke for f in self.machine.actuators]])

    @cached_property
    def sweeps(self) -> list[tuple[Array, Array] | None]:
        """See ``Candidate``; over today's joint ranges."""
        today = self.frame.today
        found: list[tuple[Array, Array] | None] = []
        for linkage in self.machine.linkages:
            ends = tuple(float(end) for end in today.ranges[linkage.joints[0]])
            one = len(linkage.joints) == 1
            found.append(_swept(linkage, today.arm, ends, self.frame.samples) if one else None)
        return found

    def place(self, i: int, name: str) -> Array | None:
        """See ``Candidate``."""
        place = self.machine.linkages[i].place(name)
        return None if place is None else np.array([place])

    def transmission(self, i: int) -> Array:
        """See ``Candidate``."""
        linkage, today = self.machine.linkages[i], self.frame.today
        return _transmission(
            linkage, today.arm, tuple(today.ranges[linkage.joints[0]].tolist()), self.frame.samples
        )

    def moment_arms(self, rigid: RigidPoses) -> Array:
        """See ``Candidate``."""
        return np.stack(
            [drive.actuation(rigid).moment_arm for drive in self.machine.drives], axis=1
        )[None]

    def span(self, i: int, rigid: RigidPoses) -> tuple[Array, Array]:
        """See ``Candidate``."""
        base, end = self.machine.linkages[i].ends(rigid)
        return base[None], end[None]

    def bare_gravity(self, rigid: RigidPoses) -> Array:
        """See ``Candidate``."""
        return unloaded(self.machine, rigid)[None]


@dataclass(frozen=True, eq=False)
class Resized(Built):
    """A machine with many sizes on its pins and strokes: a variant for each of ``sizes``, areas (b, nc, 2) [m²]."""

    sizes: Array

    @property
    def areas(self) -> Array:
        """See ``Candidate``."""
        return self.sizes

    def moment_arms(self, rigid: RigidPoses) -> Array:
        """See ``Candidate``."""
        arms = super().moment_arms(rigid)
        return np.broadcast_to(arms, (len(self.sizes), *arms.shape[1:]))


@lru_cache(maxsize=64)
def _swept(
    linkage: Linkage, arm: Arm, ends: tuple[float, ...], samples: int
) -> tuple[Array, Array]:
    """Length and moment arm over its joint's range (1, k).

    Remembered: many sizes are tried on the same pins.
    """
    joint = linkage.joints[0]
    actuation = linkage.actuation(sweep(arm, joint, over(np.array(ends), samples)))
    return actuation.length[None], actuation.moment_arm[None, :, joint]


@lru_cache(maxsize=64)
def _transmission(linkage: Linkage, arm: Arm, ends: tuple[float, ...], samples: int) -> Array:
    poses = sweep(arm, linkage.joints[0], over(np.array(ends), samples))
    return linkage.transmission(poses)[0][None]


def peak(values: Array, curve: Array) -> tuple[Array, Array]:
    """Where |curve| (b, k) is largest over even values (k,), and how large: by the parabola through three samples."""
    k = int(np.abs(curve[0].real).argmax())
    middle = np.sign(curve[0, k].real) * curve[:, k]
    if k in (0, len(values) - 1):
        return np.full(len(curve), values[k]), middle
    before, after = (np.sign(curve[0, k].real) * curve[:, j] for j in (k - 1, k + 1))
    bend, slope = before - 2 * middle + after, (after - before) / 2
    if bend[0].real == 0:
        return np.full(len(curve), values[k]), middle
    return values[k] - slope / bend * (values[1] - values[0]), middle - slope**2 / bend / 2


def diameters(new: Candidate, i: int) -> tuple[Array, Array]:
    """Bore and rod of one of the parallel cylinders (b,) [m].

    A rod there always is, if a thin one.
    """
    one = 4 / math.pi / new.machine.cylinders[i].count
    bore_area, rod_area = new.areas[:, i, 0], new.areas[:, i, 0] - new.areas[:, i, 1]
    return np.sqrt(one * bore_area), np.sqrt(
        one * np.where(rod_area.real > 0, rod_area, 1e-6 * bore_area)
    )
