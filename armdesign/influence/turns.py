"""Turns of a worst pose by joints that change no frequency, such as a slew.

All turns are as low until a number tilts the slew: then the worst of them counts, another for a
tilt to the other side. Of frequencies f(φ, p), alike today at all turns φ, the lowest has the
derivatives min ∂f/∂p upwards and max ∂f/∂p downwards (Danskin 1967). In oil with air the lowest
may lie in a kink, where the tilt leaves the slew without load.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from armdesign.arrays import Array
from armdesign.influence.family import Family
from armdesign.influence.rivals import Rival
from armdesign.machine.machine import Machine
from armdesign.mechanism.joint_ranges import over

TURNS = 181  # over a joint's range
ZOOMS, FINER = 5, 10  # how often, and by how much finer, turns around the lowest are looked at
MOST = 8  # of the lowest
ALIKE = 1e-12  # frequencies this near, relative, are one


def at_worst_turn(machine: Machine, rival: Rival) -> tuple[float, Array]:
    """A rival's lowest frequency [Hz] over all turns of joints that had no effect, and the pose.

    It follows its ends; the pose (nq,) is the one from which it does.

    Args:
        machine: the machine as its file describes it.
        rival: of the machine as it is changed.
    """
    changed = rival.ends.machine

    def frequencies(q: Array) -> Array:
        values = rival.at(q).frequencies(Family.of(changed, {}, len(q)))
        return np.nan_to_num(values, nan=np.inf)

    at, lowest = rival.pose.q, float(frequencies(rival.pose.q[None])[0])
    for joint in sorted(machine.joints_without_effect - changed.joints_without_effect):
        value, q = _lowest(frequencies, at, joint, machine.ranges[joint])
        if value < lowest:
            at, lowest = q, value
    return lowest if np.isfinite(lowest) else np.nan, at


def _lowest(
    frequencies: Callable[[Array], Array], q: Array, joint: int, ends: Array
) -> tuple[float, Array]:
    """Lowest frequency [Hz] over the turns of one joint, and that pose (nq,)."""
    turns, apart = over(ends, TURNS), float(np.ptp(ends)) / (TURNS - 1)
    for zoom in range(ZOOMS + 1):
        poses = np.tile(q, (len(turns), 1))
        poses[:, joint] = turns
        values = frequencies(poses)
        least = int(values.argmin())
        if zoom == ZOOMS or values.max() - values[least] <= ALIKE * values[least]:
            break
        beside = np.pad(values, 1, constant_values=np.inf)
        dips = np.flatnonzero((values <= beside[:-2]) & (values <= beside[2:]))
        dips = dips[np.argsort(values[dips], kind="stable")[:MOST]]
        near = apart * np.linspace(-1, 1, 2 * FINER + 1)
        turns = np.unique(np.clip(np.add.outer(turns[dips], near), *ends))
        apart /= FINER
    return float(values[least]), poses[least]
