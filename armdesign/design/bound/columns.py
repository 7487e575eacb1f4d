"""Columns: designs of single cylinders that drive a joint alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armdesign.arrays import Array
from armdesign.design.bound.cylinder_constraints import CylinderConstraints, cylinder_constraints
from armdesign.design.bound.cylinder_shape import Shape, shape_of
from armdesign.design.bound.mass_enclosure import BarEnclosure
from armdesign.design.program.problem import Problem

KEPT = 400  # allowed designs at most of those that are drawn
NEAR, SPREAD = 80, 0.03  # designs around a good one, within a share of the region


@dataclass(frozen=True, eq=False, kw_only=True)
class SoleDrive:
    """A cylinder with the joint that it alone drives, and its shape at the workspace's angles."""

    cylinder: int
    joint: int
    shape: Shape
    angle: Array  # (rows,) index into the shape's angles
    limits: CylinderConstraints
    dead: Array  # (2,) dead volumes of oil [m³]
    hoses: Array  # (2,) what hoses add, as oil without air [m³]
    compliance: float  # of structure in series [m/N]


def sole_drives(problem: Problem, bars: Sequence[BarEnclosure] = ()) -> tuple[SoleDrive, ...]:
    """Cylinders that drive one joint alone and vary in a way that ``cylinder_shape`` knows."""
    machine, drives = problem.machine, []
    for i, (linkage, cylinder) in enumerate(zip(machine.linkages, machine.cylinders, strict=True)):
        others = [other for other in machine.drives if other is not linkage]
        if any({*linkage.joints} & {*other.joints} for other in others):
            continue
        limits = cylinder_constraints(problem, i, bars)
        if limits is None:
            continue
        joint, rows = linkage.joints[0], problem.dynamics.rows
        angles, index = np.unique(problem.workspace.q[rows.pose, joint], return_inverse=True)
        shape = shape_of(problem, i, angles)
        assert shape is not None
        hoses = np.array([cylinder.cap_hose_volume, cylinder.annulus_hose_volume])
        drive = SoleDrive(
            cylinder=i,
            joint=joint,
            shape=shape,
            angle=index,
            limits=limits,
            dead=np.array([cylinder.cap_dead_volume, cylinder.annulus_dead_volume]),
            hoses=hoses / cylinder.hose_modulus * machine.fluid.bulk_modulus,
            compliance=cylinder.compliance,
        )
        drives.append(drive)
    return tuple(drives)


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


def joined(some: Columns, more: Columns) -> Columns:
    """Two sets of columns as one."""
    return Columns(
        drive=np.concatenate([some.drive, more.drive]),
        design=np.concatenate([some.design, more.design]),
        volume=np.concatenate([some.volume, more.volume]),
    )


def allowed_columns(drive: SoleDrive, k: int, designs: Array) -> Columns:
    """Columns of the designs (m, 3) that are allowed, each with some choices of swept volumes."""
    kept, _, volume = drive.limits.allowed(designs, designs)
    kept, volume = kept[:KEPT], volume[:KEPT]
    choices = volume.shape[1]
    return Columns(
        drive=np.full(choices * len(kept), k),
        design=np.repeat(designs[kept], choices, axis=0),
        volume=volume.reshape(-1, 2),
    )


def columns_around(
    some: tuple[SoleDrive, ...], designs: Array, random: np.random.Generator
) -> Columns:
    """Columns at and around one design (nd, 3) of each drive."""
    pool = Columns(drive=np.empty(0, dtype=int), design=np.empty((0, 3)), volume=np.empty((0, 2)))
    for k, drive in enumerate(some):
        low, high = drive.shape.region
        steps = random.normal(size=(NEAR, 3)) * random.uniform(0, SPREAD, (NEAR, 1)) * (high - low)
        near = np.clip(designs[k] + np.vstack([np.zeros(3), steps]), low, high)
        pool = joined(pool, allowed_columns(drive, k, near))
    return pool
