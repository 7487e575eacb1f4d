"""Joint positions from measured pin-to-pin lengths: Newton's method on ℓ(q).

Its slope is the moment arm.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armdesign.arrays import Array
from armdesign.errors import ArmDesignError
from armdesign.machine.machine import Machine
from armdesign.mechanism.joint_ranges import over, sweep

SAMPLES = 64  # of a joint's range, from which Newton's method starts
STEPS = 4  # of Newton's method: from 1/63 of a range to rounding
READ_OUT = 0.5e-3  # [m] of a measured length beyond the stroke that counts as on its end


def at_lengths(machine: Machine, cylinder: int, lengths: Array, parts: Sequence[str]) -> Array:
    """Positions (n,) [rad, m] of the joint that a cylinder alone moves, at pin-to-pin lengths.

    Args:
        machine: which machine.
        cylinder: which of its cylinders, counted from 0.
        lengths: (n,) [m].
        parts: where each length is from, for messages (n).

    Raises:
        ArmDesignError: a length outside the stroke.
    """
    own, linkage = machine.cylinders[cylinder], machine.linkages[cylinder]
    least, most = own.closed_length - READ_OUT, own.open_length + READ_OUT
    for n in np.flatnonzero(~((lengths >= least) & (lengths <= most))).tolist():
        stroke = f"[{1e3 * own.closed_length:g}, {1e3 * own.open_length:g}] mm"
        fault = f"{1e3 * lengths[n]:g} mm is outside the stroke {stroke}"
        remedy = "give the pin-to-pin length, or correct closed length and stroke"
        raise ArmDesignError(f"{parts[n]}, {own.name}_length_mm", fault, remedy)
    joint = linkage.joints[0]
    values = over(machine.ranges[joint], SAMPLES)
    table = linkage.length(sweep(machine.arm, joint, values))
    order = np.argsort(table)
    q = np.interp(lengths, table[order], values[order])
    for _ in range(STEPS):
        there = linkage.actuation(sweep(machine.arm, joint, q))
        q = q + (lengths - there.length) / there.moment_arm[:, joint]
        q = np.clip(q, *machine.ranges[joint])
    return np.asarray(q)
