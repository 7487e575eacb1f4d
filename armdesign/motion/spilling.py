"""Poses at which the load spills, refused with the nearest that holds it, as commands take it."""

from __future__ import annotations

import numpy as np

from armdesign.arrays import Array
from armdesign.errors import PoseError
from armdesign.frequency.spread import onto_pitch_limit, tipping_joints
from armdesign.machine.machine import Machine
from armdesign.machine.poses import refuse_unheld
from armdesign.units import deg, mm

GRID = 0.1 * deg  # on which a joint is turned


def refuse_spilling(machine: Machine, q: Array) -> None:
    """Raise for the first pose (n, nq) that does not hold the load case at work.

    Raises:
        PoseError: such a pose; names the nearest that does.
    """
    try:
        refuse_unheld(machine, q)
    except PoseError as error:
        nearest = nearest_held(machine, q[~machine.holds(q)][0])
        if nearest is None:
            raise
        words = ",".join(
            f"{joint.name}={value / (deg if joint.revolute else mm):g}"
            for joint, value in zip(machine.arm.joints, nearest, strict=True)
        )
        turning = all(joint.revolute for joint in machine.arm.joints)
        remedy = f"the nearest that does is {words} ({'deg' if turning else 'deg, mm'})"
        raise PoseError(error.part, error.fault, remedy) from None


def nearest_held(machine: Machine, q: Array) -> Array | None:
    """Pose (nq,) that holds the load and to which joints turn least from one that does not (nq,).

    The outermost joint turns first, as far as it must or can, then the next; None where all do not
    do.
    """
    ways = (_turned(machine, q, limit) for limit in machine.payload.limits)
    held = [pose for pose in ways if pose is not None]
    return min(held, key=lambda pose: float(np.abs(pose - q).sum()), default=None)


def _turned(machine: Machine, q: Array, limit: float) -> Array | None:
    """The pose with joints turned until the load's link is at a pitch limit [rad]."""
    for joint in reversed(tipping_joints(machine, machine.payload)):
        turned = onto_pitch_limit(machine, machine.payload, q[None], joint, limit)[1]
        if len(turned) == 0:
            continue
        low, high = machine.ranges[joint]
        steps = np.clip(turned[0, joint], low, high) / GRID
        near = np.array([np.round(steps), np.floor(steps), np.ceil(steps)])
        tried = np.tile(q, (len(near), 1))
        tried[:, joint] = GRID * np.clip(near, np.ceil(low / GRID), np.floor(high / GRID))
        holds = machine.holds(tried)
        if holds.any():
            return np.asarray(tried[holds.argmax()])
        q = tried[0]
    return None
