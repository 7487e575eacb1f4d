"""Static feed-forward: spools that pass the oil of planned piston speeds under a steady load.

By the valve's characteristic under the static load of the pose and friction at the planned speed:
both edges of the open side, port reliefs, leakage, overlap, load-holding valves (``steady_flow``).
The pump's pressure is the one at which it gives the sum of the flows. Spools of pistons that stand
make up for leakage as at both ends. It says what valves can follow; ``compensation`` adds what
pressures do that swing.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from armdesign.arrays import Array
from armdesign.hydraulics.friction import friction_force
from armdesign.machine.machine import Machine
from armdesign.motion.path_limits import inflow_areas
from armdesign.simulation.plant.equilibrium import rest_states
from armdesign.simulation.plant.plant import Plant
from armdesign.simulation.plant.springs import settled
from armdesign.simulation.plant.steady_flow import Load, at_speed

SLOW = 1e-6  # [m/s] below which a piston stands
FULL = 1 - 1e-9  # of the spool's travel


class SpoolPlan(NamedTuple):
    """Spools of a plan, and what does not work."""

    spools: Array  # (n, nc)
    speeds: Array  # of the pistons (n, nc) [m/s]
    flow: Array  # of the pump (n,) [m³/s]
    too_fast: tuple[str, ...]  # actuators whose valve cannot pass the oil
    starving: tuple[str, ...]  # actuators whose load draws faster than its supply edge fills


def spool_plan(machine: Machine, q: Array, velocity: Array) -> SpoolPlan:
    """Spools for joint positions and speeds (n, nq) of a plan."""
    poses, plant = machine.evaluate(machine.rigid_poses(q)), Plant(settled(machine, q[0]))
    nq = len(machine.joints)
    speeds = np.einsum("ncj,nj->nc", poses.moment_arms[..., :nq], velocity)
    flow = (inflow_areas(machine, speeds) * np.abs(speeds)).sum(axis=1)
    pump, moves = machine.supply, np.abs(speeds) > SLOW
    used = np.minimum(flow / pump.flow, 1.0) * (pump.cut_off if pump.flow_limited else 0.0)
    rubs = [
        actuator.count * friction_force(actuator.friction, speeds[:, i])
        for i, actuator in enumerate(machine.actuators)
    ]
    load = Load(
        force=poses.cylinder_forces + np.stack(rubs, axis=1) * moves,
        closed=~moves,
        supply=(pump.pressure * (1 - used))[:, None],
    )
    actuators, system = plant.parameters.actuators[0], plant.parameters.systems[0]
    steady = at_speed(actuators, system, load, np.where(moves, speeds, 0.0))
    full = np.abs(steady.spool) > FULL
    names = [actuator.name for actuator in machine.actuators]
    faults = (
        tuple(name for name, of in zip(names, rows.T, strict=True) if of.any())
        for rows in (moves & full, moves & ~steady.balanced & ~full)
    )
    first, last = plant.split(rest_states(plant, poses[np.array([0, -1])]))[4]
    stands = first + np.linspace(0.0, 1.0, len(q))[:, None] * (last - first)
    return SpoolPlan(np.where(moves, steady.spool, stands), speeds, flow, *faults)
