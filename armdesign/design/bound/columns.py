"""Columns: designs of single cylinders that each move one joint."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armdesign.arrays import Array
from armdesign.design.bound.cylinder_constraints import CylinderConstraints, cylinder_constraints
from armdesign.design.bound.cylinder_shape import Shape
from armdesign.design.bound.cylinder_spring import Air
from armdesign.design.bound.intervals import Interval, interval
from armdesign.design.bound.mass_enclosure import BarEnclosure
from armdesign.design.bound.shape_of_pins import coordinates, shape_of
from armdesign.design.program.problem import Problem
from armdesign.machine.machine import Machine

SAMPLES = 4000  # designs drawn at first,
KEPT = 400  # and allowed ones of these at most
NEAR, SPREAD = 80, 0.03  # designs around a good one, within a share of the region
LEAST = 1e-6  # [m] between strokes of a drawing
COLUMNS = ("drive", "place", "volume", "oil")


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
        """Lowest and highest b, scale, and swept volumes, or areas of a catalogue (5,)."""
        low, high = self.shape.region
        return np.append(low, self.limits.others[0]), np.append(high, self.limits.others[1])

    def within(self, low: Array, high: Array) -> JointDrive:
        """The drive with its designs in a part (5,) of the region."""
        scale = float(low[2]), float(high[2])
        shape = replace(self.shape, low=low[:2], high=high[:2], scale=scale)
        return replace(self, shape=shape, limits=self.limits.within(low, high))

    def place(self, problem: Problem, x: Array) -> Array:
        """Place (5,) in the region of the design x."""
        i = self.cylinder
        areas = problem.vector.areas(x)[i]
        if self.limits.areas.pairs is None:
            others = areas * problem.vector.strokes(x)[1][i]
        else:
            (others,) = self.limits.areas.nearest(areas[None])
        return np.append(coordinates(problem, i, self.shape, x), others)

    def volume(self, place: Array) -> Array:
        """Swept volumes (m, 2) [m³] at places (m, 5) of the region."""
        if self.limits.areas.pairs is None:
            return place[:, 3:]
        stroke = self.shape.enclose(place[:, :2], place[:, :2]).stroke.low
        return place[:, 3:] * (stroke * place[:, 2])[:, None]

    def oil(self, place: Array) -> Array:
        """Swept volumes (m, 2) as built [m³] at places (m, 5) of the region."""
        if self.limits.drawn is None:
            return self.volume(place)
        e, scale = self.shape.enclose(place[:, :2], place[:, :2]), interval(place[:, 2])
        return place[:, 3:] * self.limits.built(e.stroke.low * scale.low, e, scale)[:, None]

    def drawn(self, places: Array) -> Array:
        """Places (m, …) of the region moved to the nearest on the drawing's grid, if any."""
        if self.limits.drawn is None:
            return places
        return self.limits.drawn.nearest(places, *self.shape.region)

    def of_strokes(self, least: float, most: float) -> JointDrive:
        """The drive with its designs that are built with strokes between two [m]."""
        assert self.limits.drawn is not None
        drawn = self.limits.drawn.between(least, most)
        return replace(self, limits=replace(self.limits, drawn=drawn))

    def boxes(self, designs: Array, random: np.random.Generator) -> Array:
        """Boxes of no width of b and scale (m, 3): with any volumes, or any pair of areas each."""
        pairs = self.limits.areas.pairs
        if pairs is None:
            return designs
        return np.column_stack([self.drawn(designs), random.choice(pairs, len(designs))])

    def air(self, machine: Machine, gravity: Interval) -> Air | None:
        """Softening of its oil by air under torques (n,) [N m]; None without air."""
        if machine.fluid.air == 0:
            return None
        # reliefs make it but less
        back = machine.cylinders[self.cylinder].preload(machine.supply.return_pressure)
        return Air(fluid=machine.fluid, back=back, torque=gravity * self.shape.sign)

    def torque(self, whole: Interval) -> Interval:
        """Its own part of torques that all partners hold together."""
        if self.partners == 1:
            return whole
        return Interval(np.minimum(whole.low, 0.0), np.maximum(whole.high, 0.0))


def joint_drives(
    problem: Problem, bars: Sequence[BarEnclosure] = (), drawn: bool = False
) -> tuple[JointDrive, ...]:
    """Cylinders of joints that no other actuator moves but such cylinders.

    Each moves one joint and varies in a way that ``shape_of_pins`` knows, its lengths on the
    drawing's grid where they are ``drawn``.
    """
    drives = [
        drive
        for i in range(len(problem.machine.cylinders))
        if (drive := _joint_drive(problem, i, bars, drawn))
    ]
    counts = Counter(drive.joint for drive in drives)
    return tuple(drive for drive in drives if counts[drive.joint] == drive.partners)


def _joint_drive(
    problem: Problem, i: int, bars: Sequence[BarEnclosure], drawn: bool
) -> JointDrive | None:
    machine, linkage = problem.machine, problem.machine.linkages[i]
    partners = sum(linkage.joints[0] in drive.joints for drive in machine.drives)
    limits = cylinder_constraints(problem, i, bars, partners == 1, drawn)
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
    place: Array  # in its region (c, 5): b, scale, and swept volumes or areas
    volume: Array  # swept volumes (c, 2) [m³]
    oil: Array  # the same as built

    def __getitem__(self, rows: Array) -> Columns:
        return Columns(**{name: getattr(self, name)[rows] for name in COLUMNS})

    def __len__(self) -> int:
        return len(self.drive)

    def within(self, k: int, drive: JointDrive) -> Columns:
        """These without the columns of drive ``k`` that lie outside ``drive``'s region."""
        low, high = drive.region
        inside = np.all((self.place >= low) & (self.place <= high), axis=1)
        if drawn := drive.limits.drawn:
            built = self.oil[:, 0] / self.place[:, 3]
            inside &= (built > drawn.least - LEAST) & (built < drawn.most + LEAST)
        return self[(self.drive != k) | inside]


def column(k: int, drive: JointDrive, place: Array) -> Columns:
    """One design (5,) of drive ``k``."""
    places = place[None]
    return Columns(
        drive=np.array([k]), place=places, volume=drive.volume(places), oil=drive.oil(places)
    )


def known_columns(
    drive: JointDrive, k: int, problem: Problem, designs: Sequence[Array]
) -> Columns:
    """Columns of drive ``k`` in designs x of a problem, with the nearest sizes of a catalogue.

    Only those that are allowed, if there are any.
    """
    places = np.stack([drive.place(problem, x) for x in designs])
    if drive.limits.areas.pairs is not None:
        places = drive.drawn(places)
        kept = drive.limits.allowed(places, places).kept
        places = places[kept] if len(kept) > 0 else places[:1]
    return joined(*(column(k, drive, place) for place in places))


def joined(*parts: Columns) -> Columns:
    """Several sets of columns as one."""
    return Columns(**{n: np.concatenate([getattr(part, n) for part in parts]) for n in COLUMNS})


def allowed_columns(drive: JointDrive, k: int, boxes: Array) -> Columns:
    """Columns of boxes of no width (m, 3 or 5) that are allowed.

    Each with some choices of swept volumes, where its box has none.
    """
    allowed = drive.limits.allowed(boxes, boxes)
    kept, volume = allowed.kept[:KEPT], allowed.volume[:KEPT]
    if drive.limits.areas.pairs is not None:
        volume, place = volume[:, 0], boxes[kept]
        oil = volume if allowed.oil is None else allowed.oil[:KEPT]
        return Columns(drive=np.full(len(kept), k), place=place, volume=volume, oil=oil)
    count = volume.shape[1]
    design, volume = np.repeat(boxes[kept], count, axis=0), volume.reshape(-1, 2)
    place = np.column_stack([design, volume])
    return Columns(drive=np.full(len(place), k), place=place, volume=volume, oil=volume)


def random_columns(drive: JointDrive, k: int, random: np.random.Generator) -> Columns:
    """Columns drawn all over the region."""
    drawn = random.uniform(*drive.shape.region, (SAMPLES, 3))
    return allowed_columns(drive, k, drive.boxes(drawn, random))


def allowed_first(drive: JointDrive, known: Columns, *others: Columns) -> Columns:
    """Known columns where they are allowed on the drawing's grid; else one of some others.

    One that is not allowed would stay the best of all, since no branching finds it.
    """
    if drive.limits.drawn is None or len(drive.limits.allowed(known.place, known.place).kept) > 0:
        return known
    return next((some[np.array([0])] for some in others if len(some) > 0), known)


def columns_around(
    drive: JointDrive, k: int, place: Array, random: np.random.Generator
) -> Columns:
    """Columns at and around one design (5,)."""
    low, high = drive.shape.region
    steps = random.normal(size=(NEAR, 3)) * random.uniform(0, SPREAD, (NEAR, 1)) * (high - low)
    near = np.clip(place[:3] + np.vstack([np.zeros(3), steps]), low, high)
    boxes = drive.boxes(near, random)
    boxes[::2, 3:] = place[3 : boxes.shape[1]]
    return allowed_columns(drive, k, boxes)
