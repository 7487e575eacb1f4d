"""Motors in the upper bound: no design changes them, so their stiffness is a constant."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from armdesign.arrays import Array
from armdesign.design.program.problem import Problem
from armdesign.machine.machine import Machine


def motor_joints(machine: Machine) -> Iterator[tuple[int, int]]:
    """Actuators that are motors and alone turn a joint, each with the joint."""
    first = len(machine.cylinders)
    for i, drive in enumerate(machine.drives[first:], first):
        (joint,) = drive.joints
        if sum(joint in other.joints for other in machine.drives) == 1:
            yield i, joint


def motor_stiffness(problem: Problem, unknown_load: bool) -> Array:
    """Stiffness of such motors at their joints, at all rows (n, k, k) [N m/rad].

    Oil with air counts as free of it where the static load is unknown: that is stiffer.
    """
    rows, corners = problem.dynamics.rows, problem.dynamics.corners
    stiffness, angles = np.zeros_like(rows.slope), problem.workspace.q[rows.pose]
    for i, joint in motor_joints(problem.machine):
        for end, machine in enumerate(corners.machines):
            own, motor = corners.end[rows.corner] == end, machine.actuators[i]
            fluid = replace(machine.fluid, air=0.0) if unknown_load else machine.fluid
            turned = angles[own, joint] - motor.closed_length
            stiffness[own, joint, joint] = motor.stiffness(
                turned, rows.gravity[own, joint], fluid, machine.supply
            )
    return stiffness
