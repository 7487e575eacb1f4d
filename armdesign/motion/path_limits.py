"""Limits of motion along a straight line of joint space: by the pump's flow and by pressure.

With q(σ) = q₀ + σ Δ, b = σ̇² and a = σ̈ a cylinder's piston moves at √b ℓ′, ℓ′ = R Δ, and its force

    F = F_g + a F_m + b F_c,   F_m of M Δ,   F_c of c(q, Δ)  (Coriolis and centrifugal)

is affine in (a, b). A valve open by x passes K x √Δp at both edges, so that at a steady speed

    extending   v²/x² (A1³/K1² + A2³/K2²) = A1 p_s − A2 p_r − F
    retracting  v²/x² (A1³/K1² + A2³/K2²) = F − A1 p_r + A2 p_s

(supply p_s, return p_r). x ≤ 1 bounds force and speed on one side. On the other side the oil that
the piston draws must not come from an empty chamber, nor that which it drives out press a relief
open: p1 ≥ p_r or p2 ≤ relief while extending, and the reverse. Every bound is affine in (a, b).
The pump gives Σ A_in |ℓ′| √b at most. Load-holding valves, leakage and friction are left out: that
the valves can follow is checked with all of them afterwards (``feed_forward``).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from armdesign.arrays import Array
from armdesign.errors import ArmDesignError
from armdesign.hydraulics.actuator import Actuator, areas_of
from armdesign.machine.machine import Machine
from armdesign.machine.poses import Poses, static_forces
from armdesign.simulation.plant.rigid_bodies import RigidBodies
from armdesign.units import bar

STANDS = 1e-9  # of the largest piston path: a piston that moves less stands


class PathLimits(NamedTuple):
    """Limits at the points of a line: largest b, and rows of A_a a + A_b b ≤ c."""

    most: Array  # of b (n,) [1/s²]
    a: Array  # factors of a (n, k)
    b: Array  # factors of b (n, k)
    bound: Array  # c (n, k)


def path_limits(
    machine: Machine, start: Array, end: Array, points: int, share: float
) -> PathLimits:
    """Limits at even points of the line between two poses.

    Args:
        machine: under its load.
        start: joint positions (nq,) [rad, m].
        end: joint positions (nq,) [rad, m].
        points: how many.
        share: of the pump's flow, and of the force that pressure leaves beyond what holds the
            load, that may be used.

    Raises:
        PoseError: a pose on the line cannot be taken.
        ArmDesignError: no piston moves, or the pump's pressure cannot move one.
    """
    sigma, along = np.linspace(0.0, 1.0, points)[:, None], end - start
    poses = machine.at(start + sigma * along)
    nq = len(machine.joints)
    travel, none = poses.moment_arms[..., :nq] @ along, 0 * along
    by_a = inertia_forces(machine, poses, none, along)
    by_b = inertia_forces(machine, poses, along, none)
    rows = [
        row
        for i, actuator in enumerate(machine.actuators)
        for row in _force_rows(
            machine, actuator, travel[:, i], np.stack([by_a, by_b, poses.cylinder_forces])[..., i]
        )
    ]
    a, b, bound = (np.stack(column, axis=1) for column in zip(*rows, strict=True))
    return PathLimits(_most(machine, travel, share), a, b, share * bound)


def inflow_areas(machine: Machine, speeds: Array) -> Array:
    """Area that takes oil from the supply while a piston moves with its speed (…, nc) [m²]."""
    bore, annulus = areas_of(machine.actuators).T
    return np.where(speeds > 0, bore, annulus)


def _most(machine: Machine, travel: Array, share: float) -> Array:
    """Largest b (n,) that the pump's flow, shared among all actuators, allows."""
    taken = (inflow_areas(machine, travel) * np.abs(travel)).sum(axis=1)
    if not taken.max() > 0:
        fault = "no piston moves between the poses"
        raise ArmDesignError(f"{machine.name}: move", fault, "give two poses that differ")
    with np.errstate(divide="ignore"):
        return np.asarray((share * machine.supply.flow / taken) ** 2)


def inertia_forces(machine: Machine, poses: Poses, velocity: Array, acceleration: Array) -> Array:
    """Forces on the pistons (n, nc) [N] that M q̈ + c(q, q̇) takes.

    Args:
        machine: under its load.
        poses: n of them.
        velocity: of the joints (n, nq), or (nq,) at all poses [rad/s, m/s].
        acceleration: the same [rad/s², m/s²].
    """
    nq = velocity.shape[-1]
    torque = (poses.mass_matrix[:, :nq, :nq] @ acceleration[..., None])[..., 0]
    torque += _velocity_torque(machine, poses, velocity)
    return static_forces(poses.moment_arms[..., :nq], torque, machine.bore_areas, nq)


def _velocity_torque(machine: Machine, poses: Poses, velocity: Array) -> Array:
    """Coriolis and centrifugal torques c(q, q̇) (n, nq) at speeds (n, nq), or (nq,) everywhere."""
    bodies, nq = RigidBodies(machine.loaded_arm), velocity.shape[-1]
    q = machine.arm.with_springs(poses.q)
    speeds = np.zeros(q.shape)
    speeds[:, :nq] = velocity
    return (bodies.resistance(q, speeds) - bodies.resistance(q, 0 * speeds))[:, :nq]


def _force_rows(
    machine: Machine, actuator: Actuator, travel: Array, forces: Array
) -> list[tuple[Array, Array, Array]]:
    """Rows of one actuator: its force by a, by b and static (3, n); ``travel``: ℓ′ (n,)."""
    by_a, by_b, static = forces
    valve = actuator.valve
    assert valve is not None
    into, out = valve.gains
    rows = []
    for way in (1, -1):
        areas = np.array([actuator.bore_area, actuator.annulus_area])[::way]
        moves = way * travel > STANDS * max(float(np.abs(travel).max()), 1e-12)
        gains = into[::way][0], out[::way][1]
        # of the side that takes oil and of the side that gives it, as if extending
        most, least = _steady_ends(machine, actuator, areas, gains)
        if np.any(moves & (way * static >= most)):
            pressure, name = machine.supply.pressure / bar, actuator.name
            fault = f"the pump's {pressure:.0f} bar cannot move {name} against its load"
            remedy = "give a lighter payload or other poses"
            raise ArmDesignError(f"{machine.name}: move", fault, remedy)
        loss = (areas**3 / np.square(gains)).sum() * travel**2
        load = way * static
        rows.append((way * by_a, way * by_b + loss, _where(moves, most - load)))
        rows.append((-way * by_a, -way * by_b, _where(moves, load - least)))
    return rows


def _steady_ends(
    machine: Machine, actuator: Actuator, areas: Array, gains: tuple[float, float]
) -> tuple[float, float]:
    """Largest force on a piston that moves, and the least one [N], in the way it moves."""
    supply = machine.supply
    pressure = supply.pressure * (1 - supply.cut_off * supply.flow_limited)
    most = areas[0] * pressure - areas[1] * supply.return_pressure
    drops = areas**2 / np.square(gains)  # of either edge, for W = v²/x²
    starves = (pressure - supply.return_pressure) / drops[0]
    relieves = (actuator.relief(supply) - supply.return_pressure) / drops[1]
    return most, most - min(starves, relieves) * float((areas * drops).sum())


def _where(moves: Array, room: Array) -> Array:
    """Room for force where the piston moves and its load leaves any; else no limit."""
    return np.where(moves & (room > 0), room, np.inf)
