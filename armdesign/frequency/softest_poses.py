"""Poses in which oil with air is softest: the chambers of an actuator are at equal pressure.

Air makes oil the softer the lower its pressure. The chamber without load stands at the preload,
and the other falls to it as the force does to preload × (A1 − A2); beyond, they change places. So
frequencies have narrow valleys along these poses, of which a joint grid has hardly any.
"""

from __future__ import annotations

import numpy as np

from armdesign.arrays import Array, chunks
from armdesign.hydraulics.actuator import Actuator
from armdesign.hydraulics.fluid import Supply
from armdesign.machine.machine import Machine

STEP = 1e-3  # of a joint's range, of differences
STEPS = 2  # of Newton's


def softest_poses(machine: Machine, ranges: Array, q: Array, most: float = 1.0) -> Array:
    """Poses near some (n, nq), by Newton steps along the slopes of each actuator's force.

    From where that is a number there and next to it: not where a four-bar is open.

    Args:
        machine: with the load case at work.
        ranges: of the joints (nq, 2) [rad, m]; no pose lies outside.
        q: from where (n, nq).
        most: how far from there, of each joint's range.
    """
    low, high = ranges.T
    found = [q[:0]]
    for i, actuator in enumerate(machine.actuators) if len(q) else ():
        force_there, at, begun = _force_at_equal_pressures(actuator, machine.supply), q, q
        for _ in range(STEPS):
            force, slopes = _force_and_slopes(machine, ranges, at, i)
            known = np.isfinite(force) & np.isfinite(slopes).all(axis=1)
            at, begun, force, slopes = at[known], begun[known], force[known], slopes[known]
            size = np.maximum((slopes**2).sum(axis=1), 1e-9)
            shares = ((force_there - force) / size)[:, None] * slopes
            at = np.clip(at + shares * (high - low), low, high)
        found.append(at[(np.abs(at - begun) <= most * (high - low)).all(axis=1)])
    return np.concatenate(found)


def _force_at_equal_pressures(actuator: Actuator, supply: Supply) -> float:
    """Static force [N] under which neither chamber is loaded more than the other."""
    lowest = max(actuator.preload(supply.return_pressure), supply.return_pressure)
    return lowest * (actuator.bore_area - actuator.annulus_area)


def _force_and_slopes(machine: Machine, ranges: Array, q: Array, i: int) -> tuple[Array, Array]:
    """Static force of an actuator (n,) [N], and its slopes by shares of joint ranges (n, nq).

    NaN where a four-bar is open.
    """
    low, high = ranges.T
    inward = np.where(q + STEP * (high - low) > high, -1.0, 1.0)
    aside = np.eye(len(low))[:, None] * (STEP * (high - low) * inward)
    poses = np.concatenate([q[None], q + aside]).reshape(-1, len(low))
    parts = (
        machine.evaluate(machine.rigid_poses(poses[rows])).cylinder_forces[:, i]
        for rows in chunks(len(poses))
    )
    force = np.concatenate(list(parts)).reshape(len(low) + 1, len(q))
    with np.errstate(invalid="ignore"):
        return force[0], ((force[1:] - force[0]) / STEP).T * inward
