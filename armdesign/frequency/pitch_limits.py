"""Poses exactly on the pitch limits of load cases, where the worst poses often lie.

A load case with a pitch range exists only while its link's pitch lies in the range; its limits cut
the joint box along surfaces.
"""

from __future__ import annotations

import numpy as np

from armdesign.arrays import Array, chunks
from armdesign.machine.load_case import LoadCase
from armdesign.machine.machine import Machine

SMALLEST_SLOPE = 0.1  # of the pitch by the joint, below which the joint cannot set it


def tipping_joints(machine: Machine, payload: LoadCase) -> list[int]:
    """Revolute joints that tip the link of a load case with pitch limits, root first."""
    chain = machine.arm.chain(payload.link) if payload.link and payload.pitch else ()
    joints, slewing = machine.arm.joints, machine.arm.slewing
    return [j for j in chain if j < len(joints) and joints[j].revolute and j not in slewing]


def turned_onto_pitch_limits(
    machine: Machine, payload: LoadCase, q: Array, joint: int, ranges: Array
) -> Array:
    """Poses (n, nq) with ``joint`` turned onto each pitch limit, the other joints as they are.

    Poses that would need the joint beyond its range (nq, 2) are left out. The corners, where a
    pitch limit meets the ends of all other joints, are among them if q has these ends.
    """
    turned = [np.empty((0, len(ranges)))]
    for limit in payload.pitch or ():
        for rows in chunks(len(q)):
            _, on_limit = onto_pitch_limit(machine, payload, q[rows], joint, limit)
            inside = (on_limit[:, joint] >= ranges[joint, 0]) & (
                on_limit[:, joint] <= ranges[joint, 1]
            )
            turned.append(on_limit[inside])
    return np.concatenate(turned)


def onto_pitch_limit(
    machine: Machine, payload: LoadCase, q: Array, joint: int, limit: float
) -> tuple[Array, Array]:
    """Poses with ``joint`` turned until the link's pitch is ``limit`` [rad] (Newton).

    Which of the poses (n, nq) can be turned so (m,), and these poses (m, nq).
    """
    assert payload.link is not None
    q = q.copy()
    step = np.zeros(q.shape[1])
    step[joint] = 0.1
    turns = np.ones(len(q), dtype=bool)
    for _ in range(8):
        pitch = machine.arm.pitch(machine.arm.kinematics(q), payload.link)
        error = wrapped(limit - pitch)
        if np.abs(error[turns]).max(initial=0.0) < 1e-13:
            break
        ahead = machine.arm.pitch(machine.arm.kinematics(q + step), payload.link)
        slope = wrapped(ahead - pitch) / step[joint]
        turns = np.abs(slope) > SMALLEST_SLOPE
        q[:, joint] += error / np.where(turns, slope, np.inf)
    turned = np.flatnonzero(np.abs(error) < 1e-10)
    return turned, q[turned]


def wrapped(angle: Array) -> Array:
    """Angles brought into (−π, π]."""
    return np.asarray(np.arctan2(np.sin(angle), np.cos(angle)))
