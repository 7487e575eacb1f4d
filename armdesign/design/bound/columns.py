"""Columns: designs of single cylinders that each move one joint."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armdesign.arrays import Array
from armdesign.design.bound.cylinder_constraints import CylinderConstraints, cylinder_constraints
from armdesign.design.bound.cylinder_shape import Shape, shape_of
from armdesign.design.bound.intervals import Interval
from armdesign.design.bound.mass_enclosure import BarEnclosure
from armdesign.design.program.problem import Problem

KEPT = 400  # allowed designs at most of those that are drawn
NEAR, SPREAD = 80, 0.03  # designs around a good one, within a share of the region


@dataclass(frozen=True, eq=False, kw_only=True)
class JointDrive:
    """A cylinder with the one joint that it moves, and its shape at the workspace's angles.

    ``partners`` are the cylinders that move that joint, this one too. How they share its load
    depends on all their designs.
    """

    cylinder: int
    joint: int
    shape: Shape
    angle: Array  # (rows,) index into the shape's angles
    limits: CylinderConstraints
    dead: Array  # (2,) dead volumes of oil [m³]
    hoses: Array  # (2,) what hoses add, as oil without air [m³]
    compliance: Array  # of structure in series at each corner of the bands [m/N]
    partners: int

    @property
    def region(self) -> tuple[Array, Array]:
        """Lowest and highest b, scale and swept volumes (5,)."""
        low, high = self.shape.region
        return np.append(low, self.limits.volume[0]), np.append(high, self.limits.volume[1])

    def within(self, low: Array, high: Array) -> JointDrive:
        """The drive with its designs in a part (5,) of the region."""
        scale = float(low[2]), float(high[2])
        shape = replace(self.shape, low=low[:2], high=high[:2], scale=scale)
        limits = replace(self.limits, volume=np.stack([low[3:], high[3:]]))
        return replace(self, shape=shape, limits=limits)

    def torque(self, whole: Interval) -> Interval:
        """Its own part of torques that all partners hold together."""
        if self.partners == 1:
            return whole
        return Interval(np.minimum(whole.low, 0.0), np.maximum(whole.high, 0.0))


def joint_drives(problem: Problem, bars: Sequence[BarEnclosure] = ()) -> tuple[JointDrive, ...]:
    """Cylinders of joints that no other actuator moves but such cylinders.

    Each moves one joint and varies in a way that ``cylinder_shape`` knows.
    """
    drives = [
        drive
        for i in range(len(problem.machine.cylinders))
        if (drive := _joint_drive(problem, i, bars))
    ]
    counts = Counter(drive.joint for drive in drives)
    return tuple(drive for drive in drives if counts[drive.joint] == drive.partners)


def _joint_drive(problem: Problem, i: int, bars: Sequence[BarEnclosure]) -> JointDrive | None:
    machine, linkage = problem.machine, problem.machine.linkages[i]
    partners = sum(linkage.joints[0] in drive.joints for drive in machine.drives)
    limits = cylinder_constraints(problem, i, bars, alone=partners == 1)
    if limits is None:
        return None
    cylinder, joint, corners = machine.cylinders[i], linkage.joints[0], problem.dynamics.corners
    own = problem.workspace.q[problem.dynamics.rows.pose, joint]
    angles, index = np.unique(own, return_inverse=True)
    shape = shape_of(problem, i, angles)
    assert shape is not None
    hoses = np.array([cylinder.cap_hose_volume, cylinder.annulus_hose_volume])
    return JointDrive(
        cylinder=i,
        joint=joint,
        shape=shape,
        angle=index,
        limits=limits,
        dead=np.array([cylinder.cap_dead_volume, cylinder.annulus_dead_volume]),
        hoses=hoses / cylinder.hose_modulus * machine.fluid.bulk_modulus,
        compliance=np.array(
            [corners.machines[end].cylinders[i].compliance for end in corners.end]
        ),
        partners=partners,
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class Columns:
    """Designs of single cylinders."""

    drive: Array  # index of the drive (c,)
    design: Array  # b and scale (c, 3)
    volume: Array  # swept volumes (c, 2) [m³]

    def __getitem__(self, rows: Array) -> Columns:
        return Columns(drive=self.drive[rows], design=self.design[rows], volume=self.volume[rows])

    def __len__(self) -> int:
        return len(self.drive)

    @property
    def place(self) -> Array:
        """Points in the drives' regions (c, 5)."""
        return np.column_stack([self.design, self.volume])

    def within(self, k: int, drive: JointDrive) -> Columns:
        """These without the columns of drive ``k`` that lie outside ``drive``'s region."""
        low, high = drive.region
        inside = np.all((self.place >= low) & (self.place <= high), axis=1)
        return self[(self.drive != k) | inside]


def column(k: int, design: Array, volume: Array) -> Columns:
    """One design (3,) of drive ``k`` with swept volumes (2,)."""
    return Columns(drive=np.array([k]), design=design[None], volume=volume[None])


def joined(*parts: Columns) -> Columns:
    """Several sets of columns as one."""
    names = ("drive", "design", "volume")
    return Columns(**{n: np.concatenate([getattr(part, n) for part in parts]) for n in names})


def allowed_columns(drive: JointDrive, k: int, designs: Array) -> Columns:
    """Columns of the designs (m, 3) that are allowed, each with some choices of swept volumes."""
    kept, _, volume = drive.limits.allowed(designs, designs)
    kept, volume = kept[:KEPT], volume[:KEPT]
    count = volume.shape[1]
    return Columns(
        drive=np.full(count * len(kept), k),
        design=np.repeat(designs[kept], count, axis=0),
        volume=volume.reshape(-1, 2),
    )


def columns_around(
    drive: JointDrive, k: int, design: Array, random: np.random.Generator
) -> Columns:
    """Columns at and around one design (3,)."""
    low, high = drive.shape.region
    steps = random.normal(size=(NEAR, 3)) * random.uniform(0, SPREAD, (NEAR, 1)) * (high - low)
    near = np.clip(design + np.vstack([np.zeros(3), steps]), low, high)
    return allowed_columns(drive, k, near)
