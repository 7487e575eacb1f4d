"""Hydraulics, compiled: flows, chambers, friction, end stops and pump at one instant.

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

import numpy as np

from armdesign.errors import SimulationError
from armdesign.hydraulics.actuator import SIDES, Actuator
from armdesign.hydraulics.fluid import bulk_modulus
from armdesign.hydraulics.friction import Friction, friction_force
from armdesign.hydraulics.valve import RELIEF_SHARE, edge_opening, in_series, orifice_flow
from armdesign.machine.machine import Machine
from armdesign.simulation.plant.compiled import Record, Records, compiled, new_records, within
from armdesign.units import bar

VAPOUR_PRESSURE = -0.7 * bar  # gauge; a chamber of pure vapour then has −0.97 bar
VAPOUR_WIDTH = 0.02 * bar
STOP_SHARE = 1e-3  # of the stroke that supply pressure on the bore presses an end stop in
STOP_DAMPING = 12.0  # [s/m] of the end stops, a
# of a chamber's swept volume, when the piston is beyond its stop and there is no dead volume
LEAST_VOLUME_SHARE = 1e-3

_ACTUATOR = "count", "closed_length", "stroke", "compliance"
_VALVE = (
    "natural_frequency",
    "damping_ratio",
    "overlap",
    "leakage",
    "tank_leakage",
    "fastest",
    "gain",
)
_FRICTION = [field.name for field in fields(Friction)]
_PAIRS = "areas", "sweep", "volumes", "least", "hoses", "into", "out"  # of cap and annulus
_HOLDING = "setting", "pilot_ratio", "opening_range"
ACTUATOR = np.dtype(  # names and units as in Actuator, Valve, Friction and LoadHolding
    [
        *((name, "f8") for name in (*_ACTUATOR, "stop", "relief", *_VALVE, *_FRICTION)),
        *((name, "f8", 2) for name in _PAIRS),
        ("rubs", "?"),
        ("held", "i8"),  # side with a load-holding valve; −1: none
        *((name, "f8") for name in (*_HOLDING, "holding_gain")),
    ],
    align=True,
)
OUTPUT = np.dtype(  # of an actuator at an instant; pairs are of cap and annulus
    [
        ("extension", "f8"),  # of the piston, s [m]
        ("speed", "f8"),  # rate of the pin-to-pin length [m/s]
        # from supply, to return, by leakage into it, for compression [m³/s]
        *((name, "f8", 2) for name in ("supplied", "returned", "leaked", "compressed")),
        ("capacity", "f8", 2),  # C [m³/Pa]
        ("friction", "f8"),  # [N]
        ("pressed", "f8"),  # depression of an end stop [m]
        ("stop", "f8"),  # force of the end stops [N]
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


def actuators_of(machine: Machine) -> Records:
    """Cylinders, and motors after them, (nc,) as records ``ACTUATOR``.

    Raises:
        SimulationError: one has no valve.
    """
    refuse_without_valves(machine)
    records = new_records(len(machine.actuators), ACTUATOR)
    for row, actuator in zip(records, machine.actuators, strict=True):
        valve = actuator.valve
        assert valve is not None
        for name in _ACTUATOR:
            row[name] = getattr(actuator, name)
        for name in _VALVE:
            row[name] = getattr(valve, name)
        for name in _FRICTION:
            row[name] = getattr(actuator.friction, name)
        row["rubs"] = any(
            (actuator.friction.coulomb, actuator.friction.static, actuator.friction.viscous)
        )
        row["relief"] = actuator.relief(machine.supply)
        row["into"], row["out"] = valve.gains
        _set_chambers(row, actuator, machine)
        row["held"] = -1
        if actuator.load_holding is not None:
            _set_holding(row, actuator)
    return records


def _set_chambers(row: Record, actuator: Actuator, machine: Machine) -> None:
    areas = np.array([actuator.bore_area, -actuator.annulus_area])
    ends = math.isfinite(actuator.stroke)  # a motor has none, and its chambers keep their volumes
    swept = actuator.stroke if ends else 0.0
    row["areas"], row["sweep"] = areas, areas * ends
    row["least"] = LEAST_VOLUME_SHARE * swept * np.abs(areas)
    row["volumes"] = np.array([actuator.cap_dead_volume, actuator.annulus_dead_volume])  # at s = 0
    row["volumes"][1] += actuator.annulus_area * swept
    row["hoses"] = (
        np.array([actuator.cap_hose_volume, actuator.annulus_hose_volume]) / actuator.hose_modulus
    )
    thrust = max(machine.supply.pressure, float(row["relief"]) / RELIEF_SHARE) * actuator.bore_area
    row["stop"] = thrust / (STOP_SHARE * actuator.stroke)


def _set_holding(row: Record, actuator: Actuator) -> None:
    valve = actuator.load_holding
    assert valve is not None
    row["held"] = SIDES.index(valve.side)
    for name in _HOLDING:
        row[name] = getattr(valve, name)
    row["holding_gain"] = valve.rated_flow / math.sqrt(valve.rated_drop)


def refuse_without_valves(machine: Machine) -> None:
    """Raise SimulationError if a cylinder or motor has no valve."""
    for actuator in machine.actuators:
        if actuator.valve is None:
            fault = f"{actuator.kind} {actuator.name} has no valve"
            path = f"{actuator.kind}.{actuator.name}.valve"
            remedy = f"add {path}: rated_flow_l_per_min, rated_drop_bar and the spool's dynamics"
            raise SimulationError(machine.name, fault, remedy)


def system_of(machine: Machine) -> Records:
    """Oil and pump () as a record ``SYSTEM``."""
    record = new_records((), SYSTEM)
    record["bulk_modulus"], record["air"] = machine.fluid.bulk_modulus, machine.fluid.air
    for name in ("pressure", "return_pressure", "flow", "cut_off", "flow_limited"):
        record[name] = getattr(machine.supply, name)
    record["line_capacity"] = machine.supply.line_volume / machine.fluid.bulk_modulus
    return record


@within
def actuate(
    actuator: Record,
    system: Record,
    pins: tuple[float, float],
    pressures: tuple[float, float],
    spool: float,
    supply: float,
    output: Record,
) -> tuple[float, float, float]:
    """Force of an actuator on its pins [N] and the rates of its pressures [Pa/s].

    Args:
        actuator: record ``ACTUATOR``.
        system: record ``SYSTEM``.
        pins: distance [m] and its rate [m/s].
        pressures: of cap and annulus [Pa].
        spool: position −1…1.
        supply: pressure at the valve [Pa].
        output: record ``OUTPUT``, which is written.
    """
    (length, speed), (p1, p2) = pins, pressures
    a1, a2 = actuator.areas[0], actuator.areas[1]
    oil_force = a1 * p1 + a2 * p2
    free = length - actuator.closed_length + actuator.compliance * oil_force
    beyond = pressed(actuator, beyond_stop(actuator, free))
    place = free - actuator.compliance * actuator.stop * beyond
    s1, r1, l1 = port(actuator, system, 0, p1, p2, spool, supply)
    s2, r2, l2 = port(actuator, system, 1, p2, p1, spool, supply)
    c1 = capacity(actuator, system, 0, place, p1)
    c2 = capacity(actuator, system, 1, place, p2)
    q1, q2 = s1 - r1 + l1, s2 - r2 + l2
    stiffness = a1 * a1 / c1 + a2 * a2 / c2
    piston = piston_speed(actuator, beyond, speed, a1 * q1 / c1 + a2 * q2 / c2, stiffness)
    fill1, fill2 = q1 - a1 * piston, q2 - a2 * piston
    rub = friction(actuator, speed)
    stop = stop_force(actuator, beyond, speed) if beyond != 0.0 else 0.0
    output.extension, output.speed = place, speed
    output.supplied[0], output.returned[0], output.leaked[0] = s1, r1, l1
    output.supplied[1], output.returned[1], output.leaked[1] = s2, r2, l2
    output.compressed[0], output.compressed[1] = fill1, fill2
    output.capacity[0], output.capacity[1] = c1, c2
    output.friction, output.pressed, output.stop = rub, beyond, stop
    return oil_force - rub + stop, fill1 / c1, fill2 / c2


@within
def capacity(
    actuator: Record, system: Record, side: int, extension: float, pressure: float
) -> float:
    """Capacity C of a chamber and its hose [m³/Pa] at a piston position [m] and pressure [Pa]."""
    volume = max(actuator.volumes[side] + actuator.sweep[side] * extension, actuator.least[side])
    modulus = bulk_modulus(pressure, system.bulk_modulus, system.air)
    if pressure < VAPOUR_PRESSURE + 40 * VAPOUR_WIDTH:
        modulus = modulus / (1 + math.exp(min((VAPOUR_PRESSURE - pressure) / VAPOUR_WIDTH, 200.0)))
    return volume / modulus + actuator.hoses[side]


@within
def port(
    actuator: Record,
    system: Record,
    side: int,
    own: float,
    other: float,
    spool: float,
    supply: float,
) -> tuple[float, float, float]:
    """Flows of one chamber [m³/s]: from supply, to return, by leakage into it.

    What returns passes the valve or the port relief; leakage goes across the piston and to the
    tank. Pressures [Pa] are the chamber's own, the other chamber's and the supply's at the valve.
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


@within
def _held_open(actuator: Record, pressure: float, pilot: float, back: float) -> float:
    """Share 0…1 by which a load-holding valve is open; its check lets oil in."""
    if pressure < back:
        return 1.0
    beyond = (pressure + actuator.pilot_ratio * pilot - actuator.setting) / actuator.opening_range
    return min(max(beyond, 0.0), 1.0)


@within
def piston_speed(
    actuator: Record, beyond: float, pins: float, freed: float, stiffness: float
) -> float:
    """Speed ṡ of the piston [m/s] while its pins part at ℓ̇.

    Chambers and compliance make three linear equations in ṗ1, ṗ2 and ṡ:
    ṡ = (ℓ̇ + c (A1 Q1/C1 − A2 Q2/C2)) / (1 + c k), k = A1²/C1 + A2²/C2 plus the stiffness of an end
    stop that is pressed in.
    """
    against = stiffness + actuator.stop if beyond != 0.0 else stiffness
    return (pins + actuator.compliance * freed) / (1 + actuator.compliance * against)


@within
def friction(actuator: Record, speed: float) -> float:
    """Friction of all parallel cylinders [N] against the rate of their pin-to-pin length [m/s]."""
    if not actuator.rubs:
        return 0.0
    return actuator.count * friction_force(actuator, speed)  # type: ignore[arg-type]


@within
def beyond_stop(actuator: Record, extension: float) -> float:
    """Distance of a piston beyond a stop [m], negative beyond the inner one; 0 for a motor."""
    return (
        extension - min(max(extension, 0.0), actuator.stroke)
        if math.isfinite(actuator.stroke)
        else 0.0
    )


@within
def pressed(actuator: Record, beyond: float) -> float:
    """Depression of a stop [m] by a piston ``beyond`` it; the compliance in series gives way."""
    return beyond / (1 + actuator.compliance * actuator.stop)


@within
def stop_force(actuator: Record, beyond: float, speed: float) -> float:
    """Force of the end stops [N, + pushes out] at a pin-to-pin rate [m/s]; they never pull."""
    outwards = speed if beyond > 0 else -speed
    return -actuator.stop * beyond * max(1 + STOP_DAMPING * outwards, 0.0)


@compiled
def pump_flow(system: Record, pressure: float) -> float:
    """Flow of a flow-limited pump [m³/s] at its pressure [Pa]."""
    if pressure >= system.pressure:
        return 0.0
    return system.flow * min(
        (system.pressure - pressure) / (system.cut_off * system.pressure), 1.0
    )
