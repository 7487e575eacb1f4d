"""Springs of a plant, compiled: torques of the passive joints on which structure yields.

τ = τ₀ − κ (z − z₀) − d ż with the preload τ₀ that gravity needs at z₀ at the pose and load from
which a run starts, and the damping d that a joint alone has there: they stay while the arm moves.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from armdesign.arrays import Array
from armdesign.machine.machine import Machine
from armdesign.simulation.plant.compiled import Records, new_records, within

SPRING = np.dtype([(name, "f8") for name in ("at", "stiffness", "preload", "damping")], align=True)


def settled(machine: Machine, q: ArrayLike) -> Machine:
    """The machine with its springs at rest at a pose (nq,) under the load case at work.

    Raises:
        PoseError: the pose cannot be taken.
    """
    if not machine.springs:
        return machine
    poses, nq = machine.at(q), len(machine.joints)
    terms = (
        poses.gravity_torque[0, nq:],
        poses.mass_matrix[0].diagonal()[nq:],
        poses.stiffness_matrix[0].diagonal()[nq:],
    )
    springs = tuple(
        spring.settled(*(float(term[j]) for term in terms))
        for j, spring in enumerate(machine.springs)
    )
    return replace(machine, springs=springs)


def springs_of(machine: Machine) -> Records:
    """Springs (ns,) of a settled machine as records ``SPRING``."""
    records = new_records(len(machine.springs), SPRING)
    for row, spring in zip(records, machine.springs, strict=True):
        if spring.preload is None:
            raise ValueError(f"spring {spring.name} is not settled")
        row["at"], row["stiffness"] = spring.at, spring.stiffness
        row["preload"], row["damping"] = spring.preload, spring.damping
    return records


@within
def add_springs(springs: Records, state: Array, torque: Array, power: Array) -> float:
    """Add torques of springs and what they dissipate; energy ½ κ (z − z₀)² − τ₀ (z − z₀) [J].

    Args:
        springs: records ``SPRING`` (ns,).
        state: positions of all k coordinates, springs last, then their speeds.
        torque: on all coordinates (k,); written.
        power: supplied, into oil, dissipated (3,) [W]; written.
    """
    energy, k = 0.0, len(torque)
    for j in range(len(springs)):
        spring, own = springs[j], k - len(springs) + j
        moved, rate = state[own] - spring.at, state[k + own]
        elastic = spring.preload - spring.stiffness * moved
        torque[own] += elastic - spring.damping * rate
        power[2] += spring.damping * rate**2
        energy -= (spring.preload + elastic) / 2 * moved
    return energy
