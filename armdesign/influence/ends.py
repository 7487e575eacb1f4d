"""Ends of the poses: end stops, limits of joints and pitch; how a worst pose follows them.

A worst pose at an end stop moves with every number that moves the stop. With c(q, p) ≥ 0 the room
left to the ends, f the frequency and p a number, the worst frequency f* changes by

    df*/dp = ∂f/∂p − Σ λ ∂c/∂p,   ∂f/∂q = Σ λ ∂c/∂q,   λ ≥ 0

(multipliers λ; Fiacco 1983): a pose in the middle of all ranges may stay where it is.

In oil with air an actuator is softest where its load leaves both chambers at the lower pressure:
the frequency has a kink there, and a worst pose in it stays in it. From the side on which the
pose stands, the kink is an end as others are.

Assumed is that kinks of several actuators part as the pose moves. Where one motion loads two
actuators at once, as an arm level at a return pressure of 0 leaves both without load, a number
that parts the kinks leaves the worst pose in one of them, and the multipliers do not tell which:
the derivative may be that of the other. A search near it finds the lower.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from armdesign.arrays import Array, Flags
from armdesign.frequency.workspace import Workspace
from armdesign.influence.family import Family
from armdesign.machine.file.key_paths import Location
from armdesign.machine.machine import Machine
from armdesign.machine.poses import Poses

REACHED = 1e-6  # room that is none: share of the stroke, of the joint's range, rad
IN_KINK = 1e-5  # the same of a load, over the largest: as near as a kink is found
KINK_NEAR = 1e-3  # and over what the load changes by along the joints' ranges
PULL = 1e-6  # multiplier, over the largest, that is none
STEP, BESIDE = 1e-4, 1e-6  # of differences by q, over the joint's range; beside a kink
NEWTON, CLOSE = 30, 1e-13  # steps by which a pose follows its ends, and when they are none


@dataclass(frozen=True)
class End:
    """An end of the poses.

    Attributes:
        kind: of a cylinder's stroke, of a joint in the URDF, of a load case's pitch, of the side
            of a kink by an actuator's load.
        index: of the cylinder, joint or actuator.
        upper: whether it is the upper end; of a load whether it is pushed from there on.
        words: what it is.
    """

    kind: Literal["stroke", "joint", "pitch", "load"]
    index: int
    upper: bool
    words: str


@dataclass(frozen=True, eq=False)
class Ends:
    """The ends that a pose touches, under one load case, and how hard they hold it.

    Attributes:
        machine: the machine with the load case at work.
        end_margin: share of the stroke that poses leave free.
        ends: the ends (m).
        multipliers: λ (m,) [Hz per unit of room].
    """

    machine: Machine
    end_margin: float
    ends: tuple[End, ...]
    multipliers: Array

    def some(self, chosen: Flags) -> Ends:
        """Some of the ends."""
        kept = tuple(end for end, keep in zip(self.ends, chosen, strict=True) if keep)
        return replace(self, ends=kept)

    def room(self, family: Family, q: Array) -> Array:
        """Room left to each end (n, m) at poses (n, nq) of a family's members."""
        if not self.ends:
            return np.zeros((len(q), 0))
        strokes = {end.index for end in self.ends if end.kind == "stroke"}
        extensions = family.extensions(q, strokes)
        return np.stack([self._room(end, family, extensions, q) for end in self.ends], axis=1)

    def _room(self, end: End, family: Family, extensions: Mapping[int, Array], q: Array) -> Array:
        if end.kind == "stroke":
            out = extensions[end.index]
            return np.asarray((1 - out if end.upper else out) - self.end_margin)
        if end.kind == "joint":
            limits = self.machine.arm.limits[end.index]
            away = limits[1] - q[:, end.index] if end.upper else q[:, end.index] - limits[0]
            return np.asarray(away / np.ptp(limits))
        if end.kind == "load":
            above = _loads(self.machine, family.at(q, self.machine.payload.name))[:, end.index]
            return above if end.upper else -above
        case, rigid = self.machine.payload, self.machine.arm.kinematics(q)
        return case.room(self.machine.heading, rigid, upper=end.upper)

    def slopes(self, family: Family, q: Array) -> Array:
        """∂(room)/∂q (n, m, nq) by differences of fourth order."""
        return differences(
            lambda at: self.room(family, at), q, np.ptp(self.machine.ranges, axis=1)
        )

    def follow(self, family: Family, q: Array) -> Array:
        """Poses (n, nq) of a family's members that touch the same ends as one pose (nq,).

        The nearest such poses, by Newton's method with the slopes of the machine itself at the
        pose, or at the first where each member has its own (n, nq).
        """
        at = np.array(np.broadcast_to(q, (family.count, q.shape[-1])))
        if not self.ends:
            return at
        own = Family.of(family.machine, {}, 1)
        inverse = np.linalg.pinv(self.slopes(own, np.atleast_2d(q)[:1])[0])
        for _ in range(NEWTON):
            step = self.room(family, at) @ inverse.T
            at = at - step
            if not np.abs(np.nan_to_num(step)).max() > CLOSE:
                break
        return at

    def by_other_keys(self, location: Location) -> Array:
        """∂(room)/∂p (m,) by numbers that only end poses: end margin, pitch of the load case."""
        slopes = np.zeros(len(self.ends))
        for k, end in enumerate(self.ends):
            if end.kind == "stroke" and location == ("requirements", "end_margin"):
                slopes[k] = -1.0
            own = self.machine.payload.limit_location
            if end.kind == "pitch" and location[:3] == own and location[3] == int(end.upper):
                slopes[k] = np.deg2rad(1.0 if end.upper else -1.0)
        return slopes


def differences(
    function: Callable[[Array], Array], q: Array, spans: Array, share: float = STEP
) -> Array:
    """∂/∂q (n, …, nq) of a function (n, …) of poses (n, nq), central, of fourth order.

    By steps of a share of the spans (nq,).
    """
    columns = []
    for joint, span in enumerate(spans):
        step = np.zeros(q.shape[1])
        step[joint] = share * span
        near, far = (function(q + k * step) - function(q - k * step) for k in (1, 2))
        columns.append((8 * near - far) / (12 * step[joint]))
    return np.stack(columns, axis=-1)


def ends_at(
    machine: Machine, workspace: Workspace, q: Array, frequency: Callable[[Array], Array]
) -> Ends:
    """The ends that hold a worst pose (nq,) of the load case at work.

    Args:
        machine: with the load case at work.
        workspace: whose worst pose it is.
        q: the pose.
        frequency: lowest frequency (n,) [Hz] of the machine at poses (n, nq), in stroke or not.
    """
    own = Family.of(machine, {}, 1)
    ends = Ends(machine, workspace.end_margin, all_ends(machine), np.zeros(0))
    ends = ends.some(ends.room(own, q[None])[0] < REACHED)
    ends = replace(ends, ends=(*ends.ends, *_kinks(machine, own, q)))
    multipliers = _multipliers(ends, own, q, frequency)
    holding = multipliers > PULL * multipliers.max(initial=0.0)
    return replace(ends.some(holding), multipliers=multipliers[holding])


def _multipliers(
    touched: Ends, own: Family, q: Array, frequency: Callable[[Array], Array]
) -> Array:
    """λ ≥ 0 of ∂f/∂q = Σ λ ∂c/∂q (m,), least squares; beside kinks, on their side."""
    from scipy.optimize import nnls

    if not touched.ends:
        return np.zeros(0)
    slopes, spans = touched.slopes(own, q[None])[0], np.ptp(touched.machine.ranges, axis=1)
    at, share = q, STEP
    if loads := [k for k, end in enumerate(touched.ends) if end.kind == "load"]:
        share = BESIDE
        at = q + np.linalg.pinv(slopes[loads]) @ (4 * share * np.abs(slopes[loads]) @ spans)
    gradient = differences(frequency, at[None], spans, share)[0]
    if not (np.isfinite(gradient).all() and np.isfinite(slopes).all()):
        return np.zeros(len(touched.ends))  # a linkage opens there: the pose stays
    multipliers, _ = nnls(slopes.T, gradient)
    return np.asarray(multipliers)


def _kinks(machine: Machine, own: Family, q: Array) -> list[End]:
    """Actuators that a pose (nq,) loads so that the frequency has a kink there.

    Not those whose load is as small at all poses, as where no weight is on them: no pose follows
    it.
    """
    if not machine.fluid.aerated:
        return []
    above = _loads(machine, machine.at(q[None]))[0]
    kinks = tuple(
        End("load", i, bool(load >= 0), f"no load on {machine.actuators[i].name}")
        for i, load in enumerate(above)
        if abs(load) < IN_KINK
    )
    slopes = Ends(machine, 0.0, kinks, np.zeros(0)).slopes(own, q[None])[0]
    reach = np.abs(slopes) @ np.ptp(machine.ranges, axis=1)
    return [
        kink
        for kink, most in zip(kinks, reach, strict=True)
        if most > IN_KINK and abs(above[kink.index]) < KINK_NEAR * most
    ]


def _loads(machine: Machine, poses: Poses) -> Array:
    """Static forces above those with both chambers at the lower pressure (n, nc).

    Over the largest that the machine's supply gives its actuators.
    """
    family, loads = poses.machine, []
    for i, (actuator, own) in enumerate(zip(family.actuators, machine.actuators, strict=True)):
        force = poses.cylinder_forces[:, i]
        low = np.minimum(*actuator.static_pressures(force, family.supply))
        balanced = low * (actuator.bore_area - actuator.annulus_area)
        loads.append((force - balanced) / (machine.supply.pressure * own.bore_area))
    return np.stack(loads, axis=1)


def endless(machine: Machine) -> Flags:
    """Joints that may turn all around (nq,)."""
    return np.array([joint.endless for joint in machine.arm.joints])


def all_ends(machine: Machine) -> tuple[End, ...]:
    """Every end that a pose may touch and not go beyond."""
    ends = []
    for i, cylinder in enumerate(machine.cylinders):
        for upper, words in ((False, "in"), (True, "out")):
            ends.append(End("stroke", i, upper, f"{cylinder.name} {words}"))
    for j in np.flatnonzero(~endless(machine)).tolist():
        joint = machine.arm.joints[j]
        for upper, words in ((False, "lower"), (True, "upper")):
            ends.append(End("joint", j, upper, f"{words} limit of {joint.name}"))
    if machine.payload.limits:
        for upper, words in ((False, "lower"), (True, "upper")):
            ends.append(End("pitch", 0, upper, f"{words} pitch of {machine.payload.link}"))
    return tuple(ends)
