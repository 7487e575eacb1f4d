"""Static feed-forward: spools that pass the oil of planned piston speeds under a steady load.

By the valve's characteristic under the static load of the pose and friction at the planned speed:
both edges of the open side, port reliefs, leakage, overlap, load-holding valves (``steady_flow``).
The pump's pressure is the one at which it gives the sum of the flows. Spools of pistons that stand
make up for leakage as at both ends. It says what valves can follow, and how wide the planned
inertia has them open at most; ``compensation`` adds what pressures do that swing.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from armdesign.arrays import Array
from armdesign.hydraulics.friction import friction_force
from armdesign.machine.machine import Machine
from armdesign.machine.poses import Poses
from armdesign.motion.path_limits import inertia_forces, inflow_areas
from armdesign.simulation.plant.equilibrium import rest_states
from armdesign.simulation.plant.plant import Plant
from armdesign.simulation.plant.springs import settled
from armdesign.simulation.plant.steady_flow import Load, SteadyFlow, at_speed

SLOW = 1e-6  # [m/s] below which a piston stands
FULL = 1 - 1e-9  # of the spool's travel


class SpoolPlan(NamedTuple):
    """Spools of a plan, and what does not work."""

    spools: Array  # (n, nc)
    widest: Array  # the same, or those of the load with inertia where they are open wider (n, nc)
    speeds: Array  # of the pistons (n, nc) [m/s]
    flow: Array  # of the pump (n,) [m³/s]
    too_fast: tuple[str, ...]  # actuators whose valve cannot pass the oil
    starving: tuple[str, ...]  # actuators whose load draws faster than its supply edge fills


def spool_plan(
    machine: Machine, q: Array, velocity: Array, acceleration: Array | None = None
) -> SpoolPlan:
    """Spools for joint positions, speeds and accelerations (n, nq) of a plan; None: steady."""
    poses, plant = machine.evaluate(machine.rigid_poses(q)), Plant(settled(machine, q[0]))
    speeds = np.einsum("ncj,nj->nc", poses.moment_arms[..., : len(machine.joints)], velocity)
    flow, moves = flow_taken(machine, speeds), np.abs(speeds) > SLOW
    steady = steady_motion(plant, poses, speeds)
    widest = steady.spool
    if acceleration is not None:
        inertia = inertia_forces(machine, poses, velocity, acceleration)
        moved = steady_motion(plant, poses, speeds, inertia).spool
        widest = np.where(np.abs(moved) > np.abs(widest), moved, widest)
    full = np.abs(widest) > FULL
    names = [actuator.name for actuator in machine.actuators]
    faults = (
        tuple(name for name, of in zip(names, rows.T, strict=True) if of.any())
        for rows in (moves & full, moves & ~steady.balanced & ~full)
    )
    first, last = plant.split(rest_states(plant, poses[np.array([0, -1])]))[4]
    stands = first + np.linspace(0.0, 1.0, len(q))[:, None] * (last - first)
    spools, widest = (np.where(moves, of, stands) for of in (steady.spool, widest))
    return SpoolPlan(spools, widest, speeds, flow, *faults)


def steady_motion(
    plant: Plant, poses: Poses, speeds: Array, further: Array | float = 0.0
) -> SteadyFlow:
    """Steady flow through valves while pistons move at speeds (n, nc) [m/s] under static loads.

    And under ``further`` forces (n, nc) [N], + pushes.
    """
    machine, moves = plant.machine, np.abs(speeds) > SLOW
    pump = machine.supply
    used = np.minimum(flow_taken(machine, speeds) / pump.flow, 1.0)
    line = pump.pressure * (1 - used * (pump.cut_off if pump.flow_limited else 0.0))
    rubs = [
        actuator.count * friction_force(actuator.friction, speeds[:, i])
        for i, actuator in enumerate(machine.actuators)
    ]
    load = Load(
        force=poses.cylinder_forces + further + np.stack(rubs, axis=1) * moves,
        closed=~moves,
        supply=line[:, None],
    )
    actuators, system = plant.parameters.actuators[0], plant.parameters.systems[0]
    return at_speed(actuators, system, load, np.where(moves, speeds, 0.0))


def flow_taken(machine: Machine, speeds: Array) -> Array:
    """Flow (n,) [m³/s] that pistons take from the supply at speeds (n, nc) [m/s]."""
    return np.asarray((inflow_areas(machine, speeds) * np.abs(speeds)).sum(axis=1))
