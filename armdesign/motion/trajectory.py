"""Trajectories: joints over time from pose to pose, each leg at rest at both ends, and shaped.

A shaper lets a mode ring against itself half a period later. But the period changes with the pose
while the arm moves, on a boom-up of an excavator by a third. So a part of a shaper that is made
for a mode at the end of the move shapes the course in the phase φ = ∫ f(σ)/f_end dt of that mode,
and its impulses are half a period apart wherever they come. What is left is of second order in
the change of frequency over a period, as amplitudes change, too (1/√ω, moment arms).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from armdesign.arrays import Array
from armdesign.errors import ArmDesignError
from armdesign.machine.machine import Machine
from armdesign.motion.feed_forward import spool_plan
from armdesign.motion.path_limits import path_limits
from armdesign.motion.shapers import Shaper
from armdesign.motion.time_law import TimeLaw, fastest

INTERVAL = 5e-3  # [s] of planned instants
POINTS = 101  # of a leg at which limits are looked at
SLOWER = 1.05  # step by which a leg that valves cannot follow is made slower
SLOWEST = 100.0  # by how much at most
FITS = 20  # times that a shaped leg is made slower, to keep the flow,
SLIGHT = 1e-3  # and the share of it that may be too much


class Leg(NamedTuple):
    """A straight line of joint space from rest to rest."""

    start: Array  # (nq,) [rad, m]
    end: Array  # (nq,) [rad, m]
    law: TimeLaw
    drawn: Array  # oil per σ̇ at even points of it, over the flow that it may use (n,) [s]

    def stretched(self, factor: float) -> Leg:
        """The leg with all times multiplied."""
        return self._replace(law=self.law.stretched(factor))


class Trajectory(NamedTuple):
    """Joints over time."""

    time: Array  # (n,) [s]
    q: Array  # (n, nq) [rad, m]
    velocity: Array  # (n, nq) [rad/s, m/s]

    @property
    def acceleration(self) -> Array:
        """(n, nq) [rad/s², m/s²]."""
        return np.asarray(np.gradient(self.velocity, self.time, axis=0))

    @property
    def duration(self) -> float:
        """From rest to rest [s]."""
        return float(self.time[-1])


def fastest_leg(machine: Machine, start: Array, end: Array, share: float) -> Leg:
    """The fastest leg within a share of flow and force that the valves can follow, too.

    Raises:
        PoseError: a pose on the way cannot be taken.
        ArmDesignError: the poses are one, or a valve cannot follow however slow it is.
    """
    part = f"{machine.name}: move"
    limits = path_limits(machine, start, end, POINTS, share)
    leg, factor = Leg(start, end, fastest(limits, part), limits.most**-0.5), 1.0
    while names := _cannot_follow(machine, leg.stretched(factor), share):
        factor *= SLOWER
        if factor > SLOWEST:
            fault = f"the valve of {' and '.join(names)} cannot pass its oil under the load there"
            raise ArmDesignError(part, fault, "choose other poses or a lighter payload")
    return leg.stretched(factor)


def _cannot_follow(machine: Machine, leg: Leg, share: float) -> tuple[str, ...]:
    """Actuators whose valve opens not far enough, or whose spool is too slow."""
    sparse = np.linspace(0.0, leg.law.duration, POINTS)
    sigma, speed, faster = (values[:, None] for values in leg.law.at(sparse))
    along = leg.end - leg.start
    plan = spool_plan(machine, leg.start + sigma * along, speed * along, faster * along)
    rates = np.abs(np.diff(plan.spools, axis=0)).max(axis=0) / (sparse[1] - sparse[0])
    slow = [
        actuator.name
        for actuator, rate in zip(machine.actuators, rates, strict=True)
        if actuator.valve is not None and rate > share * actuator.valve.fastest
    ]
    return (*plan.too_fast, *slow)


def trajectory(
    legs: Sequence[Leg], shaper: Shaper, paces: Sequence[Array] | Array | None = None
) -> Trajectory:
    """All legs one after the other, every one of them shaped and at rest at its end.

    Args:
        legs: straight lines of joint space.
        shaper: with which the course of each is convolved.
        paces: of each leg (parts, points), at even points of its line: frequency of the mode there
            over the one that a part of the shaper is made for. None: 1, the parts shape in time.
    """
    courses = [_shaped(leg.law, shaper, pace) for leg, pace in _paced(legs, shaper, paces)]
    begins = np.cumsum([0.0, *(course.time[-1] for course in courses)])
    time = _even(float(begins[-1]))
    q, velocity = np.tile(legs[0].start, (len(time), 1)), np.zeros((len(time), len(legs[0].start)))
    for leg, course, begin in zip(legs, courses, begins.tolist(), strict=False):
        along = leg.end - leg.start
        for values, given in ((q, course.sigma), (velocity, course.speed)):
            values += np.interp(time - begin, course.time, given)[:, None] * along
    return Trajectory(time, q, velocity)


def within_flow(
    legs: Sequence[Leg], shaper: Shaper, paces: Sequence[Array] | Array | None = None
) -> list[Leg]:
    """The legs, slower where a shaped course asks more of the pump than the share of its flow.

    Shaped, a speed is reached elsewhere on the line, where pistons may move more by it. Arguments
    as of ``trajectory``.
    """
    return [_within_flow(leg, shaper, pace) for leg, pace in _paced(legs, shaper, paces)]


def _within_flow(leg: Leg, shaper: Shaper, pace: Array) -> Leg:
    shares = np.linspace(0.0, 1.0, len(leg.drawn))
    for _ in range(FITS):
        course = _shaped(leg.law, shaper, pace)
        over = (course.speed * np.interp(course.sigma, shares, leg.drawn)).max()
        if over <= 1 + SLIGHT:
            break
        leg = leg.stretched(float(over))
    return leg


def _paced(
    legs: Sequence[Leg], shaper: Shaper, paces: Sequence[Array] | Array | None
) -> Iterator[tuple[Leg, Array]]:
    """Legs with their paces; without any the parts of the shaper shape in time."""
    if paces is None:
        paces = [np.ones((len(shaper.parts or (shaper,)), 2))] * len(legs)
    yield from zip(legs, paces, strict=True)


class _Course(NamedTuple):
    """Course of a leg in time."""

    time: Array  # (n,) [s]
    sigma: Array  # share of its line (n,)
    speed: Array  # σ̇ (n,) [1/s]


def _shaped(law: TimeLaw, shaper: Shaper, paces: Array) -> _Course:
    """A time law shaped by every part in the phase of its mode, by the lowest mode last."""
    time = _even(law.duration)
    sigma, speed = law.at(time)[:2]
    shares = np.linspace(0.0, 1.0, paces.shape[1])
    for part, pace in reversed(list(zip(shaper.parts or (shaper,), paces, strict=True))):
        faster = np.interp(sigma, shares, pace)
        phase = _integral(time, faster)  # [s] at the frequency that the part is made for
        later = _even(float(phase[-1]) + part.delay)
        sigma, speed = part.shaped(phase, np.stack([sigma, speed / faster], axis=1), later).T
        faster = np.interp(sigma, shares, pace)
        time, speed = _integral(later, 1 / faster), speed * faster
    return _Course(time, sigma, speed)


def _integral(time: Array, values: Array) -> Array:
    """Integral of values (n,) from the first instant on (n,)."""
    steps = np.diff(time) * (values[1:] + values[:-1]) / 2
    return np.concatenate([[0.0], np.cumsum(steps)])


def _even(duration: float) -> Array:
    return np.linspace(0.0, duration, max(math.ceil(duration / INTERVAL), 2) + 1)
