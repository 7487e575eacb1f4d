"""Joint ranges: what the strokes allow, cut by the URDF's limits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TypeAlias

import numpy as np

from armdesign.arrays import Array, Flags
from armdesign.errors import MachineFileError
from armdesign.hydraulics.actuator import Cylinder
from armdesign.mechanism.arm import Arm
from armdesign.mechanism.linkage.base import Linkage
from armdesign.mechanism.rigid_poses import RigidPoses
from armdesign.units import WORKSHOP

SAMPLES = 721  # of a joint's limits, at which its range is searched
ENDED = 2e-3  # of its stroke: a cylinder so near to its end ends a range, beside rounded limits
TOUCHES = 1e-9  # [m] from an end of its stroke: a cylinder nowhere farther inside cannot move
DEAD_CENTRE = 1e-6  # [m/rad] moment arm below which a cylinder is at its dead centre
Pair: TypeAlias = tuple[Linkage, Cylinder]


def joint_ranges(
    arm: Arm,
    linkages: tuple[Linkage, ...],
    cylinders: tuple[Cylinder, ...],
    end_margin: float,
    source: str,
) -> Array:
    """Ranges (nq, 2) [rad, m] in which cylinders keep ``end_margin`` of their stroke free.

    A cylinder across several joints couples their ranges: it is left to ``Machine.margins``. Ends
    are exact, and the array is read-only.

    Raises:
        MachineFileError: no such range, or within it a dead centre or a linkage that opens.
    """
    ranges = arm.limits.copy()
    for j in range(len(arm.joints)):
        pairs = (pair for pair in zip(linkages, cylinders, strict=True) if pair[0].joints == (j,))
        if of_joint := tuple(pairs):
            ranges[j] = _ends(arm, j, of_joint, end_margin, source)
    ranges.setflags(write=False)
    return ranges


def over(ends: Array, count: int) -> Array:
    """``count`` even values from one end of a range to the other, both included."""
    return np.linspace(float(ends[0]), float(ends[1]), count)


def sweep(arm: Arm, joint: int, values: Array) -> RigidPoses:
    """Placements with one joint at ``values`` (n,), the others at the middle of their limits."""
    q = np.tile(arm.limits.mean(axis=1), (len(values), 1))
    q[:, joint] = values
    return arm.kinematics(q)


def working_lengths(cylinder: Cylinder, end_margin: float) -> tuple[float, float]:
    """Least and greatest length [m] that leave a share of the stroke free."""
    margin = end_margin * cylinder.stroke
    return cylinder.closed_length + margin, cylinder.open_length - margin


def never_within(lengths: Array, cylinder: Cylinder, end_margin: float) -> tuple[str, str]:
    """Fault and remedy of a cylinder whose pins are never as far apart as its stroke allows."""
    low, high = working_lengths(cylinder, end_margin)
    fault = (
        f"the pins are {np.nanmin(lengths):.4f} to {np.nanmax(lengths):.4f} m apart, never within"
        f" [{low:.4f}, {high:.4f}] m"
    )
    remedy = "change closed_length_mm, stroke_mm, the pins"
    if not end_margin:
        return fault, remedy
    kept = f" ({100 * end_margin:g} % of the stroke kept free at both ends)"
    return fault + kept, f"{remedy} or end_margin"


@lru_cache(maxsize=64)
def _ends(
    arm: Arm, joint: int, pairs: tuple[Pair, ...], end_margin: float, source: str
) -> tuple[float, float]:
    """Both ends of the range of a joint that some cylinders move, kept for its next machines.

    Load cases and designs of a machine share its arm, and most of them these cylinders and pins.
    """
    return _JointRange(arm, joint, pairs, end_margin, source).ends()


@dataclass(frozen=True, eq=False)
class _JointRange:
    """Search for the range of one joint, which some cylinders move."""

    arm: Arm
    joint: int
    pairs: tuple[Pair, ...]
    end_margin: float
    source: str

    def ends(self) -> tuple[float, float]:
        """Both ends [rad, m].

        Raises:
            MachineFileError: there is no range, or the joint cannot be moved through it.
        """
        values = self._samples()
        poses = self._at(values)
        with np.errstate(invalid="ignore"):
            slack = self._slack(values)
            closes = [linkage.closes(poses) for linkage, _ in self.pairs]
        self._refuse_never_closed(values, closes)
        if not (slack > TOUCHES).any():
            raise self._never_in_stroke(poses)
        first, last = _longest_run(slack >= 0, values)
        self._refuse_opening(values, closes, (first - 1, last + 1))
        low, high = values[first], values[last]
        if first > 0:
            low = _root(self._slack, values[first - 1], low)
        if last < len(values) - 1:
            high = _root(self._slack, values[last + 1], high)
        self._refuse_dead_centre(np.array([low, high]))
        return float(low), float(high)

    def _at(self, values: Array) -> RigidPoses:
        return sweep(self.arm, self.joint, values)

    @cached_property
    def _name(self) -> str:
        return self.arm.joints[self.joint].name

    @cached_property
    def _unit(self) -> str:
        return self.arm.joints[self.joint].unit

    def _slack(self, values: Array) -> Array:
        """Distance [m] to the nearest end of any stroke; NaN where a linkage does not close."""
        poses, rows = self._at(values), []
        for linkage, cylinder in self.pairs:
            length, (low, high) = linkage.length(poses), working_lengths(cylinder, self.end_margin)
            rows += [length - low, high - length]
        return np.asarray(np.min(rows, axis=0))

    def _samples(self) -> Array:
        """Even values over the joint's limits, and the middle of each stroke, however short."""
        values = over(self.arm.limits[self.joint], SAMPLES)
        poses = self._at(values)
        for linkage, cylinder in self.pairs:
            middle = cylinder.closed_length + cylinder.stroke / 2

            def beyond(x: float, linkage: Linkage = linkage, middle: float = middle) -> float:
                return float(linkage.length(self._at(np.array([x])))[0]) - middle

            sides = np.sign(linkage.length(poses) - middle)
            for k in np.flatnonzero(sides[:-1] * sides[1:] < 0):
                values = np.append(values, _zero(beyond, values[k], values[k + 1]))
        return np.unique(values)

    def _refuse_never_closed(self, values: Array, closes: list[Flags]) -> None:
        for (linkage, cylinder), closed in zip(self.pairs, closes, strict=True):
            if not closed.any():
                limits = WORKSHOP.span(values[0], values[-1], self._unit)
                fault = f'does not close at any "{self._name}" in {limits}'
                raise self._fault(f"{cylinder.name}.{linkage.key}", fault, linkage.closing_words)

    def _refuse_opening(self, values: Array, closes: list[Flags], beyond: tuple[int, int]) -> None:
        """Raise if a linkage opens right beyond the range, where no stroke ends it."""
        for k in beyond:
            for (linkage, cylinder), closed in zip(self.pairs, closes, strict=True):
                if 0 <= k < len(values) and not closed[k]:
                    bars = ", ".join(f"{bar}_mm" for bar in linkage.bar_names)
                    remedy = f"change {bars} or the pins, or tighten the joint's limits"
                    where = f'"{self._name}" = {WORKSHOP.text(values[k], self._unit)}'
                    fault = f"opens at {where}, before stroke or joint limit ends the motion"
                    raise self._fault(f"{cylinder.name}.{linkage.key}", fault, remedy)

    def _never_in_stroke(self, poses: RigidPoses) -> MachineFileError:
        """The fault of cylinders for which no position of the joint is within their strokes."""
        for linkage, cylinder in self.pairs:
            length = linkage.length(poses)
            low, high = working_lengths(cylinder, self.end_margin)
            if not np.any((length > low + TOUCHES) & (length < high - TOUCHES)):
                fault, remedy = never_within(length, cylinder, self.end_margin)
                fault = f'over joint "{self._name}" {fault}'
                return self._fault(f"{cylinder.name}.stroke_mm", fault, remedy)
        names = [cylinder.name for _, cylinder in self.pairs]
        fault = f'at no "{self._name}" are the cylinders {", ".join(names)} in stroke together'
        remedy = "change closed_length_mm, stroke_mm or the pins of one of them"
        return self._fault(f"{names[0]}.stroke_mm", fault, remedy)

    def _fault(self, key: str, fault: str, remedy: str) -> MachineFileError:
        return MachineFileError(f"{self.source}: cylinder.{key}", fault, remedy)

    def _refuse_dead_centre(self, ends: Array) -> None:
        values = over(ends, SAMPLES)
        poses = self._at(values)
        for linkage, cylinder in self.pairs:
            moment_arm = linkage.actuation(poses).moment_arm[:, self.joint]
            least = int(np.argmin(np.abs(moment_arm)))
            crosses = np.any(np.sign(moment_arm) != np.sign(moment_arm[0]))
            if crosses or np.abs(moment_arm[least]) < DEAD_CENTRE:
                where = f'"{self._name}" = {WORKSHOP.text(values[least], self._unit)}'
                fault = f"is at its dead centre at {where}: no moment arm (singular pose)"
                tighten = "tighten the joint's limits so that the range stays on one side"
                raise self._fault(cylinder.name, fault, f"move its pins or {tighten}")


def _zero(function: Callable[[float], float], a: float, b: float) -> float:
    from scipy.optimize import brentq

    return float(brentq(function, a, b, xtol=1e-14))


def _longest_run(mask: Flags, values: Array) -> tuple[int, int]:
    """Ends of the longest run of true; of runs as long but for a sample, nearest to zero."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    starts, ends = edges[::2], edges[1::2] - 1
    long = np.flatnonzero(ends - starts >= (ends - starts).max() - 1)
    distance = [np.abs(values[starts[k] : ends[k] + 1]).min() for k in long]
    chosen = long[int(np.argmin(distance))]
    return int(starts[chosen]), int(ends[chosen])


def _root(slack: Callable[[Array], Array], outside: float, inside: float) -> float:
    """The inner side of where the slack vanishes between a value outside and one inside.

    Zero stays zero: the number next to it is 5e-324, which moves no pin.
    """
    root = _zero(lambda x: float(slack(np.array([x]))[0]), outside, inside)
    on_inner_side = root == 0 or slack(np.array([root]))[0] >= 0
    return root if on_inner_side else float(np.nextafter(root, inside))
