"""Derivatives of the plant's hydraulics, batched: what ``hydraulics`` computes, with its slopes.

Each actuator's force and pressure rates depend on six numbers of its own: pin-to-pin length and
its rate, pressures of cap and annulus, spool position, and the supply's pressure. Derivatives by
them, ``NUMBERS``, are the last axis. At a corner of a law (an edge that just closes, a relief that
just opens) the derivative is the mean of both sides, as a central difference has it. Dry friction
has none at rest and is left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from armdesign.arrays import Array
from armdesign.hydraulics.fluid import bulk_modulus, bulk_modulus_slope
from armdesign.hydraulics.valve import (
    edge_opening,
    edge_opening_slope,
    in_series,
    in_series_slopes,
    orifice_flow,
    orifice_slope,
)
from armdesign.simulation.plant.compiled import Record, Records
from armdesign.simulation.plant.hydraulics import STOP_DAMPING, VAPOUR_PRESSURE, VAPOUR_WIDTH

LENGTH, RATE, CAP, ANNULUS, SPOOL, SUPPLY = range(6)
NUMBERS = 6


@dataclass(frozen=True, eq=False)
class Slope:
    """Values (n, nc) and their derivatives (n, nc, NUMBERS)."""

    value: Array
    by: Array

    def __add__(self, other: Slope) -> Slope:
        return Slope(self.value + other.value, self.by + other.by)

    def __sub__(self, other: Slope) -> Slope:
        return Slope(self.value - other.value, self.by - other.by)

    def __mul__(self, other: Slope | Array | float) -> Slope:
        if not isinstance(other, Slope):
            return Slope(self.value * other, self.by * np.asarray(other)[..., None])
        by = self.by * other.value[..., None] + self.value[..., None] * other.by
        return Slope(self.value * other.value, by)

    def through(self, value: Array, slope: Array) -> Slope:
        """f(self) from f and f′ at its values."""
        return Slope(value, np.asarray(slope)[..., None] * self.by)

    def over(self, other: Slope) -> Slope:
        """Quotient."""
        return self * other.through(1 / other.value, -1 / other.value**2)


class Instant(NamedTuple):
    """Actuators at one instant of n cases, each value with its derivatives."""

    force: Slope  # on the pins [N]
    rates: tuple[Slope, Slope]  # of the pressures of cap and annulus [Pa/s]
    extension: Slope  # of the piston [m]
    speed: Slope  # of the piston [m/s]
    supplied: Slope  # from the supply [m³/s]
    capacities: Array  # C of cap and annulus (n, 2, nc) [m³/Pa]


def actuate(actuators: Records, system: Record, numbers: Array) -> Instant:
    """Forces and rates of actuators with their slopes, without dry friction.

    Args:
        actuators: records ``ACTUATOR`` (nc,).
        system: record ``SYSTEM``.
        numbers: length, its rate, pressures, spool, supply pressure (n, nc, NUMBERS).
    """
    length, rate, *pressures, _, _ = own = independent(numbers)
    areas, c = actuators["areas"].T, actuators["compliance"]
    oil_force = pressures[0] * areas[0] + pressures[1] * areas[1]
    free = length + oil_force * c
    free = Slope(free.value - actuators["closed_length"], free.by)
    beyond = _beyond_stop(actuators, free)
    place = free - beyond * (c * actuators["stop"])
    gains, supplied = zip(*(port(actuators, system, i, own) for i in (0, 1)), strict=True)
    capacities = [_capacity(actuators, system, i, place, pressures[i]) for i in (0, 1)]
    ratios = [gain.over(capacity) for gain, capacity in zip(gains, capacities, strict=True)]
    ones = np.ones_like(length.value)
    pressed = np.where(beyond.value != 0, actuators["stop"], 0.0)
    against = Slope(pressed, np.zeros_like(length.by))
    for area, capacity in zip(areas, capacities, strict=True):
        against += capacity.through(area**2 / capacity.value, -((area / capacity.value) ** 2))
    freed = ratios[0] * areas[0] + ratios[1] * areas[1]
    yields = Slope(ones + c * against.value, c[:, None] * against.by)
    piston = (rate + freed * c).over(yields)
    filled = [gain - piston * area for gain, area in zip(gains, areas, strict=True)]
    rates = [fill.over(capacity) for fill, capacity in zip(filled, capacities, strict=True)]
    rubbed = rate * (actuators["count"] * actuators["viscous"])
    return Instant(
        force=oil_force - rubbed + _stop_force(actuators, beyond, rate),
        rates=(rates[0], rates[1]),
        extension=place,
        speed=piston,
        supplied=supplied[0] + supplied[1],
        capacities=np.stack([one.value for one in capacities], axis=1),
    )


def independent(numbers: Array) -> list[Slope]:
    """The numbers of actuators (n, nc, NUMBERS), each with the slope 1 by itself."""
    ones = np.ones(numbers.shape[:2])
    return [Slope(numbers[..., j], ones[..., None] * np.eye(NUMBERS)[j]) for j in range(NUMBERS)]


def port(
    actuators: Records, system: Record, side: int, numbers: list[Slope]
) -> tuple[Slope, Slope]:
    """Oil that a chamber gains while its piston stands, and what comes from the supply [m³/s].

    Args:
        actuators: see ``actuate``.
        system: see ``actuate``.
        side: 0 cap, 1 annulus.
        numbers: the actuators' own, each with its slopes.
    """
    own, other = numbers[CAP + side], numbers[ANNULUS - side]
    supply, back = numbers[SUPPLY], system["return_pressure"]
    towards = numbers[SPOOL] * (1.0 if side == 0 else -1.0)
    held = actuators["held"] == side
    into = _edge(towards, actuators["overlap"]) * actuators["into"][:, side]
    out = _edge(towards * -1.0, actuators["overlap"]) * actuators["out"][:, side]
    out = _behind_holding(actuators, held, out, own, other, back)
    supplied = into * _root(supply - own)
    inwards = np.where(held, np.heaviside(supplied.value, 0.5), 1.0)
    supplied = supplied.through(
        np.where(held, np.maximum(supplied.value, 0.0), supplied.value), inwards
    )
    above = Slope(own.value - back, own.by)
    returned = out * _root(above)
    beyond = Slope(own.value - actuators["relief"], own.by)
    relieved = _root(beyond) * (actuators["gain"] * np.heaviside(beyond.value, 0.5))
    leaked = (other - own) * actuators["leakage"] - above * actuators["tank_leakage"]
    return supplied - returned - relieved + leaked, supplied


def _edge(towards: Slope, overlap: Array) -> Slope:
    """Opening of an edge."""
    value = towards.value
    return towards.through(edge_opening(value, overlap), edge_opening_slope(value, overlap))


def _root(drop: Slope) -> Slope:
    """Flow of an orifice with a gain of 1 [√Pa]."""
    return drop.through(orifice_flow(1.0, drop.value), orifice_slope(drop.value))


def _behind_holding(
    actuators: Records, held: Array, out: Slope, own: Slope, other: Slope, back: float
) -> Slope:
    """Gain of an edge to the return, in series with a load-holding valve where there is one."""
    if not held.any():
        return out
    span = np.where(held, actuators["opening_range"], 1.0)
    lifted = own + other * actuators["pilot_ratio"]
    share = (lifted.value - actuators["setting"]) / span
    free = own.value < back  # its check lets oil in
    inside = np.where(free, 0.0, np.heaviside(share, 0.5) * np.heaviside(1 - share, 0.5) / span)
    opened = lifted.through(np.where(free, 1.0, np.clip(share, 0.0, 1.0)), inside)
    gain = opened * actuators["holding_gain"]
    by_out, by_gain = in_series_slopes(out.value, gain.value)
    by = by_out[..., None] * out.by + by_gain[..., None] * gain.by
    both = Slope(in_series(out.value, gain.value), by)
    return Slope(np.where(held, both.value, out.value), np.where(held[:, None], both.by, out.by))


def _capacity(
    actuators: Records, system: Record, side: int, extension: Slope, pressure: Slope
) -> Slope:
    """Capacity C = V/β + V_hose/β_hose of a chamber; V grows without bound as vapour fills it."""
    least, sweep = actuators["least"][:, side], actuators["sweep"][:, side]
    plain = actuators["volumes"][:, side] + sweep * extension.value
    volume = extension.through(np.maximum(plain, least), sweep * np.heaviside(plain - least, 0.5))
    p, oil = pressure.value, (system["bulk_modulus"], system["air"])
    modulus = bulk_modulus(p, *oil)
    vapour = np.exp(np.clip((VAPOUR_PRESSURE - p) / VAPOUR_WIDTH, -200.0, 200.0))
    vapour = np.where(p < VAPOUR_PRESSURE + 40 * VAPOUR_WIDTH, vapour, 0.0)
    softness = (1 + vapour) / modulus
    slope = -vapour / VAPOUR_WIDTH / modulus - softness * bulk_modulus_slope(p, *oil) / modulus
    capacity = volume * pressure.through(softness, slope)
    return Slope(capacity.value + actuators["hoses"][:, side], capacity.by)


def _beyond_stop(actuators: Records, extension: Slope) -> Slope:
    """Depression of an end stop [m], negative of the inner one; 0 for a motor."""
    stroke, s = actuators["stroke"], extension.value
    ends = np.isfinite(stroke)
    outside = np.where(ends, s - np.clip(s, 0.0, stroke), 0.0)
    past = np.where(ends, np.heaviside(-s, 0.5) + np.heaviside(s - stroke, 0.5), 0.0)
    stiff = 1 + actuators["compliance"] * actuators["stop"]
    return extension.through(outside / stiff, past / stiff)


def _stop_force(actuators: Records, beyond: Slope, rate: Slope) -> Slope:
    """Force of the end stops [N, + pushes out] of Hunt and Crossley."""
    outwards = np.where(beyond.value > 0, 1.0, -1.0)
    damped = 1 + STOP_DAMPING * outwards * rate.value
    slope = STOP_DAMPING * outwards * np.heaviside(damped, 0.5)
    return beyond * rate.through(np.maximum(damped, 0.0), slope) * (-actuators["stop"])


def pump(system: Record, pressure: Array) -> tuple[Array, Array]:
    """Flow of a flow-limited pump [m³/s] and its derivative by the pressure [Pa]."""
    ramp = system["cut_off"] * system["pressure"]
    share = (system["pressure"] - pressure) / ramp
    within = np.heaviside(share, 0.5) * np.heaviside(1 - share, 0.5)
    return system["flow"] * np.clip(share, 0.0, 1.0), -system["flow"] / ramp * within
