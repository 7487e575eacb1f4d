"""Cylinders, motors, valves and pump at work, compiled: flows, chambers and forces of one actuator at one instant.

    C1 ṗ1 = Q1 − A1 ṡ,   C2 ṗ2 = Q2 + A2 ṡ       chambers; Q1, Q2 flow into them, leakage counted

The capacity C = V/β(p) + V_hose/β_hose grows without bound near a vacuum: there vapour fills the
chamber. Port reliefs open above their pressure. A stop is a stiff spring that damps by Hunt and
Crossley's law (1975), k δ (1 + a δ̇), so that its force begins at 0.

Of a motor read angle for length and torque for force. What an actuator has twice has the side as
index, 0 cap and 1 annulus; the areas are signed, A1 and −A2, so that F = Σ A p and V̇ = A ṡ.
"""

from __future__ import annotations

import math
from dataclasses import fields
from typing import Any

import numpy as np

from armdesign.arrays import Array
from armdesign.errors import SimulationError
from armdesign.hydraulics.actuator import Actuator
from armdesign.hydraulics.fluid import bulk_modulus
from armdesign.hydraulics.friction import Friction, friction_force
from armdesign.hydraulics.valve import RELIEF_SHARE, Valve, edge_opening, in_series, orifice_flow
from armdesign.machine.machine import Machine
from armdesign.simulation.plant.compiled import compiled
from armdesign.units import bar

VAPOUR_PRESSURE, VAPOUR_WIDTH = (
    -0.7 * bar,
    0.02 * bar,
)  # gauge; a chamber of pure vapour then has −0.97 bar
STOP_SHARE = 1e-3  # of the stroke that supply pressure on the bore presses an end stop in
STOP_DAMPING = 12.0  # [s/m] of the end stops, a
# of a chamber's swept volume, when the piston is beyond its stop and there is no dead volume
LEAST_VOLUME_SHARE = 1e-3

_VALVE = (
    "natural_frequency",
    "damping_ratio",
    "overlap",
    "leakage",
    "tank_leakage",
    "fastest",
    "gain",
)
FUNCTION = np.dtype(  # names and units are those of Actuator, Valve, Friction and LoadHolding
    [
        *(
            (name, "f8")
            for name in (
                "count",
                "closed_length",
                "stroke",
                "compliance",
                "stop",
                "relief",
                *_VALVE,
            )
        ),
        *((field.name, "f8") for field in fields(Friction)),
        *(
            (name, "f8", 2)
            for name in ("areas", "sweep", "volumes", "least", "hoses", "into", "out")
        ),
        ("rubs", "?"),
        ("held", "i8"),  # side with a load-holding valve; −1: none
        *((name, "f8") for name in ("setting", "pilot_ratio", "opening_range", "holding_gain")),
    ],
    align=True,
)
SYSTEM = np.dtype(  # oil and pump of a machine
    [
        *(
            (name, "f8")
            for name in ("bulk_modulus", "air", "pressure", "return_pressure", "flow", "cut_off")
        ),
        ("flow_limited", "?"),
        ("line_capacity", "f8"),  # C of the line behind a flow-limited pump [m³/Pa]
    ],
    align=True,
)


def actuators_of(machine: Machine) -> Array:
    """Cylinders, and motors after them, (nc,) as records ``FUNCTION``.

    Raises:
        SimulationError: one has no valve.
    """
    made = np.zeros(len(machine.actuators), FUNCTION)
    for row, actuator in zip(made, machine.actuators, strict=True):
        valve = _valve_of(machine, actuator)
        for name in ("count", "closed_length", "stroke", "compliance"):
            row[name] = getattr(actuator, name)
        for name in _VALVE:
            row[name] = getattr(valve, name)
        for field in fields(Friction):
            row[field.name] = getattr(actuator.friction, field.name)
        row["rubs"] = any(
            (actuator.friction.coulomb, actuator.friction.static, actuator.friction.viscous)
        )
        row["relief"] = actuator.relief(machine.supply)
        edges = valve.edges
        row["into"] = np.array([edges.supply_to_cap, edges.supply_to_annulus]) * valve.gain
        row["out"] = np.array([edges.cap_to_return, edges.annulus_to_return]) * valve.gain
        _set_chambers(row, actuator, machine)
        row["held"] = -1
        if actuator.load_holding is not None:
            _set_holding(row, actuator)
    return made


def _set_chambers(row: Any, actuator: Actuator, machine: Machine) -> None:
    areas = np.array([actuator.bore_area, -actuator.annulus_area])
    ends = math.isfinite(actuator.stroke)  # a motor has none, and its chambers keep their volumes
    swept = actuator.stroke if ends else 0.0
    row["areas"], row["sweep"], row["least"] = (
        areas,
        areas * ends,
        LEAST_VOLUME_SHARE * swept * np.abs(areas),
    )
    row["volumes"] = np.array([actuator.cap_dead_volume, actuator.annulus_dead_volume])  # at s = 0
    row["volumes"][1] += actuator.annulus_area * swept
    row["hoses"] = (
        np.array([actuator.cap_hose_volume, actuator.annulus_hose_volume]) / actuator.hose_modulus
    )
    thrust = max(machine.supply.pressure, float(row["relief"]) / RELIEF_SHARE) * actuator.bore_area
    row["stop"] = thrust / (STOP_SHARE * actuator.stroke)


def _set_holding(row: Any, actuator: Actuator) -> None:
    valve = actuator.load_holding
    assert valve is not None
    row["held"] = ("cap", "annulus").index(valve.side)
    for name in ("setting", "pilot_ratio", "opening_range"):
        row[name] = getattr(valve, name)
    row["holding_gain"] = valve.rated_flow / math.sqrt(valve.rated_drop)


def _valve_of(machine: Machine, actuator: Actuator) -> Valve:
    if actuator.valve is None:
        part = f"{machine.name}: {actuator.kind}.{actuator.name}.valve"
        raise SimulationError(
            part, "missing", "add rated_flow_l_per_min, rated_drop_bar and the spool's dynamics"
        )
    return actuator.valve


def system_of(machine: Machine) -> Array:
    """Oil and pump () as a record ``SYSTEM``."""
    made = np.zeros((), SYSTEM)
    made["bulk_modulus"], made["air"] = machine.fluid.bulk_modulus, machine.fluid.air
    for name in ("pressure", "return_pressure", "flow", "cut_off", "flow_limited"):
        made[name] = getattr(machine.supply, name)
    made["line_capacity"] = machine.supply.line_volume / machine.fluid.bulk_modulus
    return made


@compiled
def capacity(actuator: Any, system: Any, side: int, extension: float, pressure: float) -> float:
    """C [m³/Pa] of a chamber at a piston position [m] and pressure [Pa]: oil, its air and vapour, hoses."""
    volume = max(actuator.volumes[side] + actuator.sweep[side] * extension, actuator.least[side])
    modulus = bulk_modulus(pressure, system.bulk_modulus, system.air)
    if pressure < VAPOUR_PRESSURE + 40 * VAPOUR_WIDTH:
        modulus = modulus / (1 + math.exp(min((VAPOUR_PRESSURE - pressure) / VAPOUR_WIDTH, 200.0)))
    return volume / modulus + actuator.hoses[side]


@compiled
def port(
    actuator: Any, system: Any, side: int, own: float, other: float, spool: float, supply: float
) -> Any:
    """Flows [m³/s] of one chamber at its and the other's pressure [Pa]: from supply, to return, by leakage into it.

    What returns passes the valve or the port relief; leakage goes across the piston and to the
    tank.
    """
    back = system.return_pressure
    towards = spool if side == 0 else -spool
    into = actuator.into[side] * edge_opening(towards, actuator.overlap)
    out = actuator.out[side] * edge_opening(-towards, actuator.overlap)
    if actuator.held == side:
        out = in_series(out, actuator.holding_gain * _held_open(actuator, own, other, back))
    from_supply, to_return = orifice_flow(into, supply - own), orifice_flow(out, own - back)
    if actuator.held == side:
        from_supply = max(from_supply, 0.0)
    if own > actuator.relief:
        to_return += orifice_flow(actuator.gain, own - actuator.relief)
    leakage = actuator.leakage * (other - own) - actuator.tank_leakage * (own - back)
    return from_supply, to_return, leakage


@compiled
def _held_open(actuator: Any, pressure: float, pilot: float, back: float) -> float:
    """Share 0…1 by which a load-holding valve is open; its check lets oil in."""
    if pressure < back:
        return 1.0
    beyond = (pressure + actuator.pilot_ratio * pilot - actuator.setting) / actuator.opening_range
    return min(max(beyond, 0.0), 1.0)


@compiled
def piston_speed(
    actuator: Any, beyond: float, pins: float, freed: float, stiffness: float
) -> float:
    """ṡ [m/s] while the pins part at ℓ̇: the chambers and the compliance make three linear equations in ṗ1, ṗ2 and ṡ.

    ṡ = (ℓ̇ + c (A1 Q1/C1 − A2 Q2/C2)) / (1 + c k), k = A1²/C1 + A2²/C2, and an end stop's where
    one is pressed in.
    """
    against = stiffness + actuator.stop if beyond != 0.0 else stiffness
    return (pins + actuator.compliance * freed) / (1 + actuator.compliance * against)


@compiled
def friction(actuator: Any, speed: float) -> float:
    """Friction of all parallel cylinders [N] against the rate of their pin-to-pin length [m/s]."""
    return actuator.count * friction_force(actuator, speed) if actuator.rubs else 0.0


@compiled
def beyond_stop(actuator: Any, extension: float) -> float:
    """How far a piston is beyond a stop [m]: negative beyond the inner one, 0 between them and for a motor."""
    return (
        extension - min(max(extension, 0.0), actuator.stroke)
        if math.isfinite(actuator.stroke)
        else 0.0
    )


@compiled
def pressed(actuator: Any, beyond: float) -> float:
    """How far a piston presses a stop in [m] that would be ``beyond`` without it: the series compliance gives way."""
    return beyond / (1 + actuator.compliance * actuator.stop)


@compiled
def stop_force(actuator: Any, beyond: float, speed: float) -> float:
    """Force of the end stops [N, + pushes out] at a rate of the pin-to-pin length [m/s].

    They never pull.
    """
    outwards = speed if beyond > 0 else -speed
    return -actuator.stop * beyond * max(1 + STOP_DAMPING * outwards, 0.0)


@compiled
def pump_flow(system: Any, pressure: float) -> float:
    """Flow of a flow-limited pump [m³/s] at its pressure [Pa]."""
    if pressure >= system.pressure:
        return 0.0
    return system.flow * min(
        (system.pressure - pressure) / (system.cut_off * system.pressure), 1.0
    )
