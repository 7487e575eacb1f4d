"""Poses from measured columns: positions of joints, or pin-to-pin lengths of their cylinders.

``<joint>_deg``, of a slide ``<joint>_mm``, tells where a joint stands, or ``<cylinder>_length_mm``
of a cylinder that alone moves it: Newton's method on ℓ(q), whose slope is the moment arm.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from armdesign.arrays import Array
from armdesign.errors import ArmDesignError
from armdesign.machine.machine import Machine
from armdesign.mechanism.joint_ranges import over, sweep

SAMPLES = 64  # of a joint's range, from which Newton's method starts
STEPS = 4  # of Newton's method: from 1/63 of a range to rounding
READ_OUT = 0.5e-3  # [m] of a measured length beyond the stroke that counts as on its end
SLACK = 1e-6  # [°, mm] of a measured position beyond its range, by rounding
INCLINOMETERS = ("incl", "tilt_sensor", "_imu_")  # in names of columns
INCLINOMETER = (
    "an inclinometer on a moving machine feels acceleration as if it were tilt, on a measured"
    " crane nine times the true swing: take frequencies from pressures or rates, poses from"
    " pin-to-pin lengths or encoders"
)


@dataclass(frozen=True, kw_only=True)
class JointColumns:
    """Columns of which one tells where a joint stands.

    Attributes:
        joint: which joint, counted from 0.
        name: of the joint.
        unit: of its own column, ``deg`` or ``mm``.
        factor: this unit in SI.
        lengths: cylinders that alone move it, counted from 0, by the column of their length.
    """

    joint: int
    name: str
    unit: str
    factor: float
    lengths: Mapping[str, int]

    @property
    def own(self) -> str:
        """Column of its position."""
        return f"{self.name}_{self.unit}"

    @property
    def all(self) -> tuple[str, ...]:
        """Every column that may tell it, its own first."""
        return (self.own, *self.lengths)

    def outside(self, machine: Machine, position: float) -> str:
        """In words where a position [rad, m] is outside the joint's range; empty where not."""
        value, (low, high) = position / self.factor, machine.ranges[self.joint] / self.factor
        if low - SLACK <= value <= high + SLACK:
            return ""
        ends = f"[{low:g}, {high:g}] {self.unit}"
        return f"{value:g} {self.unit} is outside the joint's range {ends}"


def joint_columns(machine: Machine) -> list[JointColumns]:
    """Columns that tell where the joints of a machine stand, joint by joint."""
    pairs = list(zip(machine.cylinders, machine.linkages, strict=True))
    columns = []
    for j, joint in enumerate(machine.arm.joints):
        unit, factor = joint.file_unit
        alone = [i for i, (_, linkage) in enumerate(pairs) if linkage.joints == (j,)]
        lengths = {f"{pairs[i][0].name}_length_mm": i for i in alone}
        columns.append(
            JointColumns(joint=j, name=joint.name, unit=unit, factor=factor, lengths=lengths)
        )
    return columns


def inclined(column: str) -> bool:
    """Whether a column is an inclinometer's."""
    return any(word in column.lower() for word in INCLINOMETERS)


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
        raise ArmDesignError(
            ", ".join(filter(None, (parts[n], f"{own.name}_length_mm"))),
            f"{1e3 * lengths[n]:g} mm is outside the stroke"
            f" [{1e3 * own.closed_length:g}, {1e3 * own.open_length:g}] mm",
            "give the pin-to-pin length, or correct closed length and stroke",
        )
    joint = linkage.joints[0]
    values = over(machine.ranges[joint], SAMPLES)
    table = linkage.length(sweep(machine.arm, joint, values))
    order = np.argsort(table)
    positions = np.interp(lengths, table[order], values[order])
    for _ in range(STEPS):
        there = linkage.actuation(sweep(machine.arm, joint, positions))
        positions = positions + (lengths - there.length) / there.moment_arm[:, joint]
        positions = np.clip(positions, *machine.ranges[joint])
    return np.asarray(positions)
