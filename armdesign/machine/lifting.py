"""Lifting: the mass at a point of a link that each actuator raises or holds.

One actuator raises, all others hold. Each has the supply's pressure, or its port relief's where
that is lower, against the return's. A share of it counts (ISO 10567: 87 %); beside the mass it
carries links, cylinders and four-bars. So

    mass = (share × holding force − force of the arm's own weight) / force per kilogram,

and the machine lifts the least mass of all its actuators, whichever of them raises.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armdesign.arrays import Array
from armdesign.hydraulics.actuator import areas_of, available_pressures
from armdesign.hydraulics.oil_spring import holding_force
from armdesign.machine.load_case import NO_LOAD
from armdesign.machine.machine import Machine
from armdesign.machine.poses import static_forces
from armdesign.mechanism.linkage.base import Pin
from armdesign.mechanism.rigid_poses import RigidPoses
from armdesign.units import GRAVITY

LEAST_FORCE = 1e-12  # [N/kg] below which a mass does not load an actuator


def liftable(
    machine: Machine, forces: Array, per_mass: Array, areas: Array, share: Array | float
) -> Array:
    """Mass [kg] at which each actuator (…, nc) uses up a share of what its pressure gives.

    Infinite for an actuator that the mass does not load, negative where its own arm is too heavy.
    Complex-safe.

    Args:
        machine: supply, and reliefs.
        forces: without the mass [N], pushing positive.
        per_mass: what a kilogram adds [N/kg].
        areas: bore and annulus (…, nc, 2) [m²].
        share: of its force, for all or for each (nc,).
    """
    pushes = per_mass.real > 0
    pressure = available_pressures(machine.actuators, machine.supply)
    back = machine.supply.return_pressure
    held = holding_force(areas[..., 0], areas[..., 1], pressure, back, pushes)
    loads = np.abs(per_mass.real) > LEAST_FORCE
    used = np.where(pushes, 1.0, -1.0)
    return np.where(
        loads, (share * held - used * forces) / np.where(loads, used * per_mass, 1.0), np.inf
    )


def liftable_masses(
    machine: Machine, rigid: RigidPoses, arms: Array, torque: Array, share: Array | float
) -> Array:
    """Mass (n, nc) [kg] that each actuator of a machine lifts.

    Args:
        machine: that lifts.
        rigid: its poses (n).
        arms: ``moment_arms`` of its drives there (n, nc, k) [m/rad].
        torque: ``torque_per_mass`` there (n, nq) [N m/kg, N/kg].
        share: of its force, for all or for each (nc,).
    """
    areas = areas_of(machine.actuators)
    bare, per_mass = (
        static_forces(arms, load, areas[:, 0], len(machine.joints))
        for load in (unloaded(machine, rigid), torque)
    )
    return liftable(machine, bare, per_mass, areas, share)


def torque_per_mass(machine: Machine, rigid: RigidPoses, point: Pin) -> Array:
    """Joint torque of a kilogram at a point (n, nq) [N m/kg, N/kg]."""
    joints = tuple(range(len(machine.joints)))
    motion = machine.arm.motion(rigid, point.link, np.array(point.at), machine.arm.root, joints)
    return np.asarray(GRAVITY * motion.first[:, :, 2])


def unloaded(machine: Machine, rigid: RigidPoses) -> Array:
    """Gravity torque (n, k) of links, cylinders and four-bars without a load [N m, N]."""
    return replace(machine, payload=NO_LOAD).loaded(rigid)[1]
