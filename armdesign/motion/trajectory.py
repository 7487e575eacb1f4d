"""Trajectories: joints over time from pose to pose, each leg at rest at both ends, and shaped."""

from __future__ import annotations

import math
from collections.abc import Sequence
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


class Leg(NamedTuple):
    """A straight line of joint space from rest to rest."""

    start: Array  # (nq,) [rad, m]
    end: Array  # (nq,) [rad, m]
    law: TimeLaw

    def stretched(self, factor: float) -> Leg:
        """The leg with all times multiplied."""
        return self._replace(law=self.law.stretched(factor))


class Trajectory(NamedTuple):
    """Joints over time."""

    time: Array  # (n,) [s]
    q: Array  # (n, nq) [rad, m]
    velocity: Array  # (n, nq) [rad/s, m/s]

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
    law = fastest(path_limits(machine, start, end, POINTS, share), part)
    leg, factor = Leg(start, end, law), 1.0
    while names := _cannot_follow(machine, leg.stretched(factor), share):
        factor *= SLOWER
        if factor > SLOWEST:
            fault = f"the valve of {' and '.join(names)} cannot pass its oil under the load there"
            raise ArmDesignError(part, fault, "choose other poses or a lighter payload")
    return leg.stretched(factor)


def _cannot_follow(machine: Machine, leg: Leg, share: float) -> tuple[str, ...]:
    """Actuators whose valve opens not far enough, or whose spool is too slow."""
    sparse = np.linspace(0.0, leg.law.duration, POINTS)
    sigma, speed, _ = (values[:, None] for values in leg.law.at(sparse))
    along = leg.end - leg.start
    plan = spool_plan(machine, leg.start + sigma * along, speed * along)
    rates = np.abs(np.diff(plan.spools, axis=0)).max(axis=0) / (sparse[1] - sparse[0])
    slow = [
        actuator.name
        for actuator, rate in zip(machine.actuators, rates, strict=True)
        if actuator.valve is not None and rate > share * actuator.valve.fastest
    ]
    return (*plan.too_fast, *slow)


def trajectory(legs: Sequence[Leg], shaper: Shaper) -> Trajectory:
    """All legs one after the other, every one of them shaped and at rest at its end."""
    durations = [leg.law.duration + shaper.delay for leg in legs]
    begins = np.cumsum([0.0, *durations[:-1]])
    time = _even(sum(durations))
    q, velocity = np.tile(legs[0].start, (len(time), 1)), np.zeros((len(time), len(legs[0].start)))
    for leg, begin in zip(legs, begins.tolist(), strict=True):
        given, along = _even(leg.law.duration), leg.end - leg.start
        law = np.stack(leg.law.at(given)[:2], axis=1)
        sigma, speed = shaper.shaped(given, law, time - begin).T
        q += sigma[:, None] * along
        velocity += speed[:, None] * along
    return Trajectory(time, q, velocity)


def _even(duration: float) -> Array:
    return np.linspace(0.0, duration, max(math.ceil(duration / INTERVAL), 2) + 1)
