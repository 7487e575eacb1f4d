"""Damping of the modes: what the machine file gives, or a stated ratio in place of all of it.

What damps at rest is leakage, viscous friction and an opened valve. A stated ratio ζ, as it was
measured on a crane, replaces them by modal damping of every mode: with shapes V, VᵀMV = I, the
accelerations get −V diag(2ζω) Vᵀ M q̇. No bandwidth is worth anything that rests on no damping.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from armdesign.arrays import Array
from armdesign.errors import ArmDesignError
from armdesign.frequency.modes import Modes
from armdesign.machine.actuators import F, with_each
from armdesign.machine.machine import Machine
from armdesign.machine.poses import Poses, pose_text

LEAST = 1e-4  # ζ of the least damped mode that a bandwidth may rest on


def checked_damping(ratio: float | None) -> float | None:
    """A stated damping ratio, if it is one.

    Raises:
        ArmDesignError: it is none between ``LEAST`` and 1.
    """
    if ratio is not None and not LEAST <= ratio < 1:
        fault = f"{ratio:g} is not in [{LEAST:g}, 1)"
        raise ArmDesignError("damping", fault, "give a ratio as 0.02, or none for the file's")
    return ratio


def controllable(machine: Machine, stated: bool) -> Machine:
    """The machine as a controller meets it.

    The controller leaps over the overlap of a spool. Where damping is ``stated`` nothing else
    damps: leakage, underlap and viscous friction are left out.
    """

    def cleared(actuator: F) -> F:
        valve, friction = actuator.valve, actuator.friction
        if valve is not None:
            valve = valve.without_overlap
        if stated:
            friction = replace(friction, viscous=0.0)
            if valve is not None:
                valve = replace(valve, overlap=0.0, leakage=0.0, tank_leakage=0.0)
        return replace(actuator, valve=valve, friction=friction)

    springs = tuple(replace(one, damping_ratio=0.0) for one in machine.springs)
    changed = with_each(machine, cleared)
    return replace(changed, springs=springs) if stated else changed


def modal_damping(poses: Poses, modes: Modes, ratio: float) -> Array:
    """M⁻¹D (n, k, k) [1/s] that gives every mode the damping ratio: V diag(2ζω) VᵀM."""
    omega = 2 * math.pi * modes.frequencies
    turned = np.swapaxes(modes.shapes, 1, 2) @ poses.mass_matrix
    return np.asarray((modes.shapes * (2 * ratio * omega)[:, None, :]) @ turned)


def refuse_undamped(machine: Machine, ratios: Array, q: Array) -> None:
    """Raise where a mode is hardly damped: no bandwidth may rest on that.

    Args:
        machine: with its load case at work.
        ratios: damping ratios (n, k).
        q: joint positions (n, nq) [rad, m].

    Raises:
        ArmDesignError: names the least damped mode and its pose.
    """
    if len(ratios) == 0 or ratios.min() >= LEAST:
        return
    pose, mode = np.unravel_index(ratios.argmin(), ratios.shape)
    where = pose_text(machine, q[pose])
    ratio = max(float(ratios[pose, mode]), 0.0) + 0.0
    fault = (
        f"mode {mode + 1} has a damping ratio of {ratio:.2g} at {where},"
        f" payload {machine.payload.name}: no bandwidth can rest on that"
    )
    remedy = (
        "state it, as --damping 0.02 (in Python and studies damping = 0.02; a measured crane), or"
        " give viscous friction or leakage"
    )
    raise ArmDesignError(f"{machine.name}: damping", fault, remedy)
