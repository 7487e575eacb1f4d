"""Steady flow through valves: the pressures and speed at which an actuator moves under a force.

At constant pressures p1, p2 and speed v of the piston

    Q1(p1, p2) = A1 v,   Q2(p2, p1) = −A2 v,   A1 p1 − A2 p2 = F

with the ports' own law (edges, leakage, reliefs, load-holding valve). Along the line of constant
force A2 Q1 + A1 Q2 falls as both pressures rise, so that a spool position has one speed, which
rises with it. Elementwise over n cases and nc actuators.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from armdesign.arrays import Array, Flags
from armdesign.simulation.plant import slopes
from armdesign.simulation.plant.compiled import Record, Records
from armdesign.simulation.plant.hydraulics import VAPOUR_PRESSURE, VAPOUR_WIDTH
from armdesign.units import bar

ROUNDS = 80
EXACT = 1e-12  # of the interval in which a root is sought
NEGLIGIBLE = 1e-8  # of what an edge of rated size passes under a bar
LOWEST = VAPOUR_PRESSURE + 10 * VAPOUR_WIDTH  # below, vapour fills a chamber
FACTOR = 1e3  # by which openings may differ that hold a load under one supply and another
HIGHEST = 3.0  # pressures that are looked at, over the larger of supply and relief


class Load(NamedTuple):
    """Loads of the actuators in motion."""

    force: Array  # of the oil, A1 p1 − A2 p2 (n, nc) [N]
    closed: Flags  # (n, nc): tight valves that stay shut, where any numbers do
    supply: Array  # pressure at the valves (n, 1) [Pa]


class SteadyFlow(NamedTuple):
    """Actuators in steady motion, each entry (n, nc)."""

    cap: Array  # pressure [Pa]
    annulus: Array  # pressure [Pa]
    spool: Array
    speed: Array  # of the piston [m/s]
    by_force: Array  # ∂speed/∂F [m/s/N]
    by_spool: Array  # ∂speed/∂x [m/s]
    by_supply: Array  # ∂speed/∂p_s [m/s/Pa]
    supplied: Array  # from the supply [m³/s]
    supplied_by_spool: Array  # [m³/s]
    supplied_by_supply: Array  # [m³/s/Pa]
    balanced: Flags  # whether both chambers are; else vapour or reliefs are in the way


def under_spool(actuators: Records, system: Record, load: Load, spool: Array) -> SteadyFlow:
    """Steady motion at spool positions (n, nc).

    Args:
        actuators: records ``ACTUATOR`` (nc,).
        system: record ``SYSTEM``.
        load: what the actuators move against.
        spool: positions (n, nc).
    """
    line = _Line(actuators, system, load, spool)
    cap = falling_root(line.imbalance, *line.ends())
    gained, taken, both = line.ports(cap)
    steep = line.along(both)
    steep = np.where(steep < 0, steep, -np.inf)
    to_spool, to_supply = (-both.by[..., k] / steep for k in (slopes.SPOOL, slopes.SUPPLY))
    to_force = both.by[..., slopes.ANNULUS] / line.a2 / steep
    rises, drains = line.along(gained), line.along(taken)
    by_force = rises * to_force - gained.by[..., slopes.ANNULUS] / line.a2
    limit = NEGLIGIBLE * actuators["gain"] * np.sqrt(bar) * (line.a1 + line.a2)
    return SteadyFlow(
        cap=cap,
        annulus=line.annulus(cap),
        spool=spool,
        speed=gained.value / line.a1,
        by_force=by_force / line.a1,
        by_spool=(rises * to_spool + gained.by[..., slopes.SPOOL]) / line.a1,
        by_supply=(rises * to_supply + gained.by[..., slopes.SUPPLY]) / line.a1,
        supplied=taken.value,
        supplied_by_spool=drains * to_spool + taken.by[..., slopes.SPOOL],
        supplied_by_supply=drains * to_supply + taken.by[..., slopes.SUPPLY],
        balanced=np.abs(both.value) < limit,
    )


def at_speed(
    actuators: Records, system: Record, load: Load, speed: Array, near: Array | float = np.nan
) -> SteadyFlow:
    """Steady motion at speeds of the pistons (n, nc) [m/s]; slopes by the supply are at the speed.

    Where no spool position in reach gives the speed it is not ``balanced``. A lapped valve of
    which the piston leaks may have two at rest, one of them within its lap: then the one that
    counts is ``near`` some position (n, nc), under another supply; NaN elsewhere.
    """
    dead = np.maximum(actuators["overlap"], 0.0)
    one_way = (actuators["overlap"] >= 0) & ~load.closed
    low = np.where(load.closed, 0.0, np.where((speed > 0) & one_way, dead, -1.0))
    high = np.where(load.closed, 0.0, np.where((speed < 0) & one_way, -dead, 1.0))
    known = one_way & np.isfinite(near)
    low, high = (
        np.where(known, one, two)
        for one, two in zip(_around(np.asarray(near), dead), (low, high), strict=True)
    )

    def excess(spool: Array) -> tuple[Array, Array]:
        flow = under_spool(actuators, system, load, spool)
        return speed - flow.speed, -flow.by_spool

    flow = under_spool(actuators, system, load, falling_root(excess, low, high))
    limit = NEGLIGIBLE * actuators["gain"] * np.sqrt(bar) / actuators["areas"][:, 0]
    moves = np.where(flow.by_spool > 0, flow.by_spool, np.inf)
    opens = -flow.by_supply / moves
    return flow._replace(
        balanced=flow.balanced & (np.abs(flow.speed - speed) < limit),
        supplied_by_supply=flow.supplied_by_supply + flow.supplied_by_spool * opens,
    )


def _around(near: Array, dead: Array) -> tuple[Array, Array]:
    """The positions beside some (n, nc) that are as much open but for a factor, or as they are."""
    opened = np.maximum(np.abs(near) - dead, 0.0)
    ends = np.minimum(dead + opened / FACTOR, 1.0), np.minimum(dead + opened * FACTOR, 1.0)
    less, more = (np.where(opened > 0, np.sign(near) * end, near) for end in ends)
    return np.minimum(less, more), np.maximum(less, more)


class _Line:
    """Pressures of constant force, by the cap's pressure."""

    def __init__(self, actuators: Records, system: Record, load: Load, spool: Array) -> None:
        self.a1, self.a2 = actuators["areas"][:, 0], -actuators["areas"][:, 1]
        self._actuators, self._system, self._load, self._spool = actuators, system, load, spool

    def ends(self) -> tuple[Array, Array]:
        """Pressures of the cap between which either chamber is above vapour and within reach."""
        force, a1, a2 = self._load.force, self.a1, self.a2
        most = HIGHEST * np.maximum(self._actuators["relief"], self._system["pressure"])
        low = np.maximum(LOWEST, (force + a2 * LOWEST) / a1)
        high = np.minimum(most, (force + a2 * most) / a1)
        return low, np.where(self._load.closed, low, np.maximum(high, low))

    def annulus(self, cap: Array) -> Array:
        """Pressure of the annulus."""
        return np.asarray((self.a1 * cap - self._load.force) / self.a2)

    def ports(self, cap: Array) -> tuple[slopes.Slope, slopes.Slope, slopes.Slope]:
        """Flow into the cap, flow from the supply, and A2 Q1 + A1 Q2."""
        return self._flows(slopes.independent(self._numbers(cap)))

    def _numbers(self, cap: Array) -> Array:
        """Numbers of the ports (n, nc, NUMBERS); lengths and their rates do not count."""
        zero, line = np.zeros_like(cap), np.broadcast_to(self._load.supply, cap.shape)
        return np.stack([zero, zero, cap, self.annulus(cap), self._spool, line], axis=-1)

    def _flows(
        self, numbers: list[slopes.Slope]
    ) -> tuple[slopes.Slope, slopes.Slope, slopes.Slope]:
        (q1, s1), (q2, s2) = (
            slopes.port(self._actuators, self._system, side, numbers) for side in (0, 1)
        )
        return q1, s1 + s2, q1 * self.a2 + q2 * self.a1

    def imbalance(self, cap: Array) -> tuple[Array, Array]:
        """A2 Q1 + A1 Q2 and its slope along the line, the only derivative that is followed."""
        rise = np.zeros((slopes.NUMBERS, *cap.shape, 1))
        rise[slopes.CAP], rise[slopes.ANNULUS] = 1.0, (self.a1 / self.a2)[:, None]
        own = np.moveaxis(self._numbers(cap), -1, 0)
        _, _, both = self._flows([slopes.Slope(*pair) for pair in zip(own, rise, strict=True)])
        return both.value, both.by[..., 0]

    def along(self, slope: slopes.Slope) -> Array:
        """Derivative by the pressure of the cap along the line."""
        return np.asarray(
            slope.by[..., slopes.CAP] + slope.by[..., slopes.ANNULUS] * (self.a1 / self.a2)
        )


def falling_root(f: Callable[[Array], tuple[Array, Array]], low: Array, high: Array) -> Array:
    """Root of a falling function, elementwise, by Newton's method within a bracket.

    f gives value and slope. Where it has no root in [low, high] the nearer end.
    """
    x = (low + high) / 2
    width = np.maximum(high - low, np.finfo(float).tiny)
    last, begin, end, done = width.copy(), low, high, np.zeros(x.shape, dtype=bool)
    for _ in range(ROUNDS):
        value, slope = f(x)
        begin, end = np.where(value > 0, x, begin), np.where(value > 0, end, x)
        with np.errstate(divide="ignore", invalid="ignore"):
            newton = x - value / slope
        good = (newton >= begin) & (newton <= end) & (np.abs(newton - x) < last / 2)
        following = np.where(good, newton, (begin + end) / 2)
        following = np.where(done | (value == 0), x, following)
        last = np.abs(following - x)
        x, done = following, last <= EXACT * width
        if done.all():
            break
    return x
