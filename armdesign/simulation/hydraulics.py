"""Cylinders, motors, valves and pump of stacked machines: flows, chambers and forces, elementwise.

    C1 ṗ1 = Q1 − A1 ṡ,   C2 ṗ2 = Q2 + A2 ṡ       chambers; Q1, Q2 flow into them, leakage counted

The capacity C = V/β(p) + V_hose/β_hose grows without bound near a vacuum: there vapour fills the chamber. Port reliefs
open above their pressure. A stop is a stiff spring that damps by Hunt and Crossley's law (1975), k δ (1 + a δ̇), so that
its force begins at 0.

Axis 0 is the case, the last one the cylinder or motor, of which read angle for length and torque for force. What a
cylinder has twice lies between: the side, 0 cap and 1 annulus.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from operator import attrgetter
from typing import Any, TypeVar

import numpy as np

from armdesign.arrays import Array
from armdesign.cylinder import Actuator, Fluid, Supply, kind
from armdesign.errors import SimulationError
from armdesign.fluid import bulk_modulus
from armdesign.machine import Machine
from armdesign.units import bar
from armdesign.valve import Friction, Valve, edge_opening, friction_force, in_series, orifice_flow

RELIEF_SHARE = 1.1  # of the supply pressure, where port reliefs open
VAPOUR_PRESSURE, VAPOUR_WIDTH = -0.7 * bar, 0.02 * bar  # gauge; a chamber of pure vapour then has −0.97 bar
STOP_SHARE = 1e-3  # of the stroke that supply pressure on the bore presses an end stop in
STOP_DAMPING = 12.0  # [s/m] of the end stops, a
LEAST_VOLUME_SHARE = 1e-3  # of a chamber's swept volume, when the piston is beyond its stop and there is no dead volume
T = TypeVar("T", Valve, Friction, Fluid, Supply)


@dataclass(frozen=True, eq=False)
class Flows:
    """Flows [m³/s] of n cases: of the oil, each (n, 2, nc)."""

    from_supply: Array
    to_return: Array  # through the valve and the port reliefs
    leakage: Array  # into each chamber: across the piston and to the tank

    @property
    def net(self) -> Array:
        """Into each chamber."""
        return self.from_supply - self.to_return + self.leakage


@dataclass(frozen=True, eq=False)
class Rates:
    """What n cases of nc cylinders do at one instant.

    Attributes:
        force: on the pins (n, nc) [N, + pushes].
        pressure_rates: (n, 2, nc) [Pa/s].
        flows: of the oil.
        oil_power: that compresses oil and hoses, Σ p C ṗ (n,) [W].
        rubbed_off: power that friction and stops dissipate (n,) [W].
    """

    force: Array
    pressure_rates: Array
    flows: Flows
    oil_power: Array
    rubbed_off: Array


class Hydraulics:
    """Cylinders, and motors after them, with their valves at work.

    Args:
        machines: one per case, or one for all; each with the same numbers of cylinders and motors.

    Raises:
        SimulationError: a cylinder has no valve.
    """

    def __init__(self, machines: Sequence[Machine]) -> None:
        rows = [[_with_valve(machine, f) for f in machine.functions] for machine in machines]

        def table(value: Callable[[Any], float]) -> Array:
            return np.array([[float(value(c)) for c in row] for row in rows])

        self.valve = stacked([[c.valve for c in row] for row in rows])
        self.friction = stacked([[c.friction for c in row] for row in rows])
        self.fluid = stacked([[machine.fluid] for machine in machines])
        self.supply = stacked([[machine.supply] for machine in machines])
        self.count, self.closed, self.stroke = (table(attrgetter(n)) for n in ("count", "closed_length", "stroke"))
        self.compliance = table(lambda c: c.compliance)
        areas = [table(lambda c: c.bore_area), table(lambda c: c.annulus_area)]
        self.areas = np.stack([areas[0], -areas[1]], axis=1)  # signed: F = Σ A p, V̇ = A ṡ
        dead = np.stack([table(lambda c: c.cap_dead_volume), table(lambda c: c.annulus_dead_volume)], axis=1)
        ends = np.isfinite(self.stroke)  # a motor has none, and its chambers keep their volumes
        swept = np.where(ends, self.stroke, 0.0)
        self._sweep = self.areas * ends[:, None]
        self._volumes = dead + np.stack([0 * swept, areas[1] * swept], axis=1)  # at s = 0
        self._least = LEAST_VOLUME_SHARE * swept[:, None] * np.abs(self.areas)
        hoses = [table(lambda c: c.cap_hose_volume), table(lambda c: c.annulus_hose_volume)]
        self._hoses = np.stack(hoses, axis=1) / table(lambda c: c.hose_modulus)[:, None]
        self.relief = np.array(
            [[_relief(machine, c) for c in row] for machine, row in zip(machines, rows, strict=True)]
        )
        thrust = np.maximum(self.supply.pressure, self.relief / RELIEF_SHARE) * areas[0]
        self._stop = thrust / (STOP_SHARE * self.stroke)
        self._edges(table)
        self._holding = [c for row in rows for c in row if c.load_holding is not None] != []
        if self._holding:
            self._hold(rows)

    def _edges(self, table: Callable[[Callable[[Any], float]], Array]) -> None:
        names = ("supply_to_cap", "supply_to_annulus", "cap_to_return", "annulus_to_return")
        gains = [table(attrgetter("valve.gain")) * table(attrgetter(f"valve.edges.{name}")) for name in names]
        self._into, self._out = np.stack(gains[:2], axis=1), np.stack(gains[2:], axis=1)
        self._relief_gain = table(lambda c: c.valve.gain)[:, None]
        self._overlap = self.valve.overlap[:, None]
        self._direction = np.array([1.0, -1.0])[:, None]
        self._leaks = bool(np.any(self.valve.leakage) or np.any(self.valve.tank_leakage))
        self._has_air, self._gives = bool(np.any(self.fluid.air)), bool(np.any(self.compliance))
        dry = self.friction
        self._rubs = bool(np.any(dry.coulomb) or np.any(dry.static) or np.any(dry.viscous))

    def _hold(self, rows: Sequence[Sequence[Actuator]]) -> None:
        """Numbers (k, 2, nc) of the load-holding valves; where there is none, one that is always open."""
        numbers = np.zeros((4, len(rows), 2, len(rows[0])))
        numbers[:] = np.array([-math.inf, 0.0, 1.0, math.inf])[:, None, None, None]
        for i, row in enumerate(rows):
            for j, cylinder in enumerate(row):
                if (held := cylinder.load_holding) is not None:
                    gain = held.rated_flow / math.sqrt(held.rated_drop)
                    side = ("cap", "annulus").index(held.side)
                    numbers[:, i, side, j] = held.setting, held.pilot_ratio, held.opening_range, gain
        self._held = np.isfinite(numbers[0])
        self._setting, self._pilot_ratio, self._opening_range, self._holding_gain = numbers

    # ------------------------------------------------------------------------------------------------- elements

    def extension(self, length: Array, pressures: Array) -> Array:
        """Piston positions s (n, nc) [m] at pin-to-pin lengths [m] and pressures (n, 2, nc) [Pa]."""
        extension = length - self.closed
        return extension + self.compliance * (self.areas * pressures).sum(axis=1) if self._gives else extension

    def capacities(self, extension: Array, pressures: Array) -> Array:
        """C (n, 2, nc) [m³/Pa] at piston positions [m] and pressures [Pa]: oil, its air and vapour, hoses."""
        volumes = np.maximum(self._volumes + self._sweep * extension[:, None], self._least)
        return volumes / self._modulus(pressures) + self._hoses

    def _modulus(self, pressures: Array) -> Array:
        oil, air = self.fluid.bulk_modulus[:, None], self.fluid.air[:, None]
        modulus = bulk_modulus(pressures, oil, air) if self._has_air else oil
        if pressures.min() > VAPOUR_PRESSURE + 40 * VAPOUR_WIDTH:
            return modulus
        return np.asarray(modulus / (1 + np.exp(np.minimum((VAPOUR_PRESSURE - pressures) / VAPOUR_WIDTH, 200.0))))

    def flows(self, pressures: Array, spool: Array, supply: Array) -> Flows:
        """Flows at pressures (n, 2, nc) [Pa], spool positions (n, nc) and supply pressures (n, 1) [Pa]."""
        back, limit = self.supply.return_pressure[:, None], self.relief[:, None]
        opens = edge_opening(spool[:, None] * self._direction, self._overlap)
        into, out = self._into * opens, self._out * opens[:, ::-1]
        if self._holding:
            out = in_series(out, self._holding_gain * self._held_open(pressures, back))
        from_supply = orifice_flow(into, supply[:, None] - pressures)
        to_return = orifice_flow(out, pressures - back)
        if self._holding:
            from_supply = np.where(self._held, np.maximum(from_supply, 0.0), from_supply)
        if (pressures > limit).any():
            to_return = to_return + orifice_flow(self._relief_gain, np.maximum(pressures - limit, 0.0))
        return Flows(from_supply, to_return, self._leakage(pressures, back))

    def _held_open(self, pressures: Array, back: Array) -> Array:
        """Share 0…1 by which the load-holding valves are open; their checks let oil in."""
        pilot = pressures[:, ::-1]
        beyond = (pressures + self._pilot_ratio * pilot - self._setting) / self._opening_range
        return np.where(pressures < back, 1.0, np.minimum(np.maximum(beyond, 0.0), 1.0))

    def _leakage(self, pressures: Array, back: Array) -> Array:
        if not self._leaks:
            return np.zeros_like(pressures)
        across = self.valve.leakage[:, None] * (pressures[:, ::-1] - pressures)
        return np.asarray(across - self.valve.tank_leakage[:, None] * (pressures - back))

    def rates(self, extension: Array, speed: Array, pressures: Array, spool: Array, supply: Array) -> Rates:
        """Forces and pressure rates when the pins part at speeds ℓ̇ (n, nc) [m/s].

        The chambers and the series compliance make three linear equations in ṗ1, ṗ2 and ṡ; ṡ is solved first:
        ṡ = (ℓ̇ + c (A1 Q1/C1 − A2 Q2/C2)) / (1 + c k), k = A1²/C1 + A2²/C2.
        """
        capacity, pins = self.capacities(extension, pressures), speed
        flows = self.flows(pressures, spool, supply)
        net = flows.net
        if self._gives:
            freed = (self.areas * net / capacity).sum(axis=1)
            stiffness = (self.areas * self.areas / capacity).sum(axis=1)
            speed = (speed + self.compliance * freed) / (1 + self.compliance * stiffness)
        filling = net - self.areas * speed[:, None]
        force, lost = (self.areas * pressures).sum(axis=1), np.zeros(len(pressures))
        if self._rubs:
            friction = self.count * friction_force(self.friction, speed)
            force, lost = force - friction, (friction * pins).sum(axis=1)
        if (beyond := self.beyond(extension)).any():
            stop = self._stop_force(beyond, speed)
            force, lost = force + stop, lost - (stop * pins + self._stop * beyond * speed).sum(axis=1)
        oil_power = (pressures * filling).sum(axis=(1, 2))
        return Rates(force, filling / capacity, flows, oil_power, lost)

    def _stop_force(self, beyond: Array, speed: Array) -> Array:
        """Force of the end stops on the pistons (n, nc) [N, + pushes out]; they never pull."""
        return np.asarray(-self._stop * beyond * np.maximum(1 + STOP_DAMPING * speed * np.sign(beyond), 0.0))

    def beyond(self, extension: Array) -> Array:
        """How far pistons are beyond a stop (n, nc) [m]: negative beyond the inner one, 0 between them."""
        return np.asarray(extension - np.minimum(np.maximum(extension, 0.0), self.stroke))

    def springs(self, extension: Array, pressures: Array) -> Array:
        """Energy (n,) [J] in the end stops and the series compliances: ½ k δ² + ½ c F²."""
        force = (self.areas * pressures).sum(axis=1)
        return (self._stop * self.beyond(extension) ** 2 + self.compliance * force**2).sum(axis=1) / 2

    def free_speed(self, extension: Array, pressures: Array, flows: Array) -> Array:
        """Speed (n, nc) [m/s] that flows into cap and annulus (n, 2, nc) give a piston whose force does not change.

        v = (A1 Q1/C1 − A2 Q2/C2)/(A1²/C1 + A2²/C2).
        """
        capacity = self.capacities(extension, pressures)
        return np.asarray((self.areas * flows / capacity).sum(axis=1) / (self.areas**2 / capacity).sum(axis=1))

    # ------------------------------------------------------------------------------------------------------ pump

    def pump_flow(self, supply: Array, taken: Array) -> Array:
        """Flow of the pumps (n, 1) [m³/s] at their pressures (n, 1) [Pa] while the functions take ``taken`` (n, 1)."""
        pump = self.supply
        share = (pump.pressure - supply) / (pump.cut_off * pump.pressure)
        return np.where(pump.flow_limited, pump.flow * np.minimum(np.maximum(share, 0.0), 1.0), taken)

    @property
    def line_capacity(self) -> Array:
        """C of the line behind a flow-limited pump (k, 1) [m³/Pa]."""
        return np.asarray(self.supply.line_volume / self.fluid.bulk_modulus)


def stacked(rows: Sequence[Sequence[Any]]) -> Any:
    """Data of the same kind side by side: its class again, with arrays (k, nc) for numbers."""
    first = rows[0][0]
    values = {field.name: getattr(first, field.name) for field in fields(first)}
    for name in values:
        table = [[getattr(item, name) for item in row] for row in rows]
        if all(isinstance(value, int | float) for row in table for value in row):
            values[name] = np.array(table, dtype=float)
    return type(first)(**values)


def _with_valve(machine: Machine, function: Actuator) -> Any:
    if function.valve is None:
        part = f"{machine.name}: {kind(function)}.{function.name}.valve"
        raise SimulationError(part, "missing", "add rated_flow_l_per_min, rated_drop_bar and the spool's dynamics")
    return function


def _relief(machine: Machine, cylinder: Any) -> float:
    relief = cylinder.valve.relief
    return RELIEF_SHARE * machine.supply.pressure if relief is None else float(relief)
