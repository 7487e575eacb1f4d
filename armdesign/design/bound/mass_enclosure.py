"""Inertia, gravity and its slope of own masses, whatever the design, in intervals.

A barrel lies from the base pin along the unit vector u to the rod end, a rod ends there: P = B + t
c u. With d the span, ∂u = (∂d − u ∂ℓ)/ℓ and the next derivative likewise, all in intervals over
small boxes of both pins, of which the union counts. Masses are m = (m0/(A0 c0)) A c with closed
length c, see ``moving_masses``.

Where a four-bar moves, its knee is anywhere within the rocker's length of the pivot, fixed to the
pivot's link: that is so for all joints but its cylinder's own, which the bound holds then
(``columns.joint_drives``): nothing depends on that one.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armdesign.arrays import Array
from armdesign.design.bound.cylinder_areas import CylinderAreas
from armdesign.design.bound.intervals import Interval, interval
from armdesign.design.program.problem import Problem
from armdesign.mechanism.jets import VectorJet
from armdesign.mechanism.joint_ranges import sweep
from armdesign.mechanism.linkage.base import Linkage, Pin
from armdesign.mechanism.rigid_poses import RigidPoses
from armdesign.units import GRAVITY

TINY = 1e-6  # [m]
CUTS = 2  # of every pin coordinate into small boxes
# of a uniform bar (Simpson), see ``point_masses.points_of_bar``
POINTS = (0.0, 1 / 6), (0.5, 2 / 3), (1.0, 1 / 6)


@dataclass(frozen=True, eq=False)
class PointEnclosure:
    """A point over a box: place (n, 3), derivatives by the joints (n, k, 3) and (n, k, k, 3)."""

    value: Interval
    first: Interval
    second: Interval

    @classmethod
    def of(cls, jet: VectorJet) -> PointEnclosure:
        """A point that is known."""
        return cls(interval(jet.value), interval(jet.first), interval(jet.second))

    def __add__(self, other: PointEnclosure) -> PointEnclosure:
        return PointEnclosure(
            self.value + other.value, self.first + other.first, self.second + other.second
        )

    def __sub__(self, other: PointEnclosure) -> PointEnclosure:
        return PointEnclosure(
            self.value - other.value, self.first - other.first, self.second - other.second
        )

    def __mul__(self, factor: Interval | float) -> PointEnclosure:
        return PointEnclosure(self.value * factor, self.first * factor, self.second * factor)

    @property
    def length(self) -> Interval:
        """Of the vector to the point."""
        return self.value.square().sum(axis=-1).sqrt()

    @property
    def unit(self) -> PointEnclosure:
        """The vector's direction."""
        inverse = self.length.reciprocal()
        u = (self.value * inverse[:, None]).within(Interval(np.array(-1.0), np.array(1.0)))
        slope = (u[:, None] * self.first).sum(axis=-1)
        first = (self.first - u[:, None] * slope[..., None]) * inverse[:, None, None]
        bend = _products(self.first) + (self.value[:, None, None] * self.second).sum(axis=-1)
        bend = (bend - slope[:, :, None] * slope[:, None]) * inverse[:, None, None]
        second = (
            self.second
            - first[:, :, None] * slope[:, None, :, None]
            - first[:, None] * slope[:, :, None, None]
        )
        return PointEnclosure(
            u, first, (second - u[:, None, None] * bend[..., None]) * inverse[:, None, None, None]
        )


@dataclass(frozen=True, eq=False)
class PinMotions:
    """Pins seen from the root, by name, and how each that moves does so by its coordinates.

    Of a linkage that moves, the rod end is the pin of the first leg (a four-bar's pivot), from
    which the rod end (its knee) lies somewhere.
    """

    pins: Mapping[str, VectorJet]
    steps: Mapping[str, Sequence[VectorJet]]
    legs: tuple[str, ...] = ()  # pins of the bars that move

    def _over(self, name: str, pins: Mapping[str, Interval]) -> PointEnclosure:
        point = PointEnclosure.of(self.pins[name])
        for k, step in enumerate(self.steps.get(name, ())):
            by = pins[name][k]
            if by.high > by.low:
                point = point + PointEnclosure.of(step) * by
        return point

    def span(self, pins: Mapping[str, Interval]) -> PointEnclosure:
        """The way from base pin to rod end over a box of pins."""
        return self._over("rod_end", pins) - self._over("base", pins)

    def bars(self, cell: PinCell) -> list[tuple[PointEnclosure, PointEnclosure]]:
        """Barrel, rod and moving legs over a cell: where each starts, and the way to its end."""
        base, rod_end = self._over("base", cell.pins), self._over("rod_end", cell.pins)
        if cell.way is None:
            way = (rod_end - base).unit * cell.closed
        else:
            first, *more = [
                PointEnclosure.of(step) * cell.way[k]
                for k, step in enumerate(self.steps["rod_end"])
            ]
            way = sum(more, first)
        starts = [self._over(pin, cell.pins) for pin in self.legs]
        legs = [(start, rod_end - start) for start in starts]
        return [(base, way), (rod_end, way * -1.0), *legs]


@dataclass(frozen=True, eq=False)
class PinCell:
    """Moves of pins [m] by name, and the closed length.

    And of a linkage that moves: its legs' lengths, and the barrel as a vector in the link of the
    first leg's pin [m].
    """

    pins: Mapping[str, Interval]
    closed: Interval
    bars: tuple[Interval, ...] = ()
    way: Interval | None = None

    @property
    def lengths(self) -> tuple[Interval, ...]:
        """Of the bars, in the order of ``PinMotions.bars``."""
        return (self.closed, self.closed, *self.bars)


@dataclass(frozen=True, eq=False, kw_only=True)
class BarEnclosure:
    """Barrel and rod of a cylinder over all designs, and the legs of its linkage where they move.

    Attributes:
        cylinder: its index.
        per_area: of barrel and rod, mass per length and bore or rod area [kg/m³]; of legs, mass
            per length [kg/m]; 0 where one weighs nothing.
        area: least and largest bore and annulus areas (2, 2: ends, sides) [m²].
        cells: small boxes of its pins.
    """

    problem: Problem
    cylinder: int
    per_area: tuple[float, ...]
    area: Array
    cells: tuple[PinCell, ...]

    @cached_property
    def _sections(self) -> tuple[Interval, ...]:
        """Bore and rod area, all parallel cylinders together [m²], and 1 of every other bar."""
        low, high = self.area
        rod = Interval(np.maximum(low[0] - high[1], 0.0), np.maximum(high[0] - low[1], 0.0))
        return (Interval(low[0], high[0]), rod, *(interval(1.0) for _ in self.per_area[2:]))

    def gravity(self, rigid: RigidPoses) -> Interval:
        """Gravity torques (n, k) [N m] of all bars; unknown on a moving linkage's joint."""
        motions, totals = _pin_motions(self.problem, self.cylinder, rigid), []
        for cell in self.cells:
            total = interval(0.0)
            for (pin, way), length, per_area, section in zip(
                motions.bars(cell), cell.lengths, self.per_area, self._sections, strict=True
            ):
                middle = (pin.first + way.first * 0.5)[..., 2]
                total = total + middle * (length * section * (per_area * GRAVITY))
            totals.append(total)
        return Interval(
            np.min([f.low for f in totals], axis=0), np.max([f.high for f in totals], axis=0)
        )

    def most_added(self, rigid: RigidPoses, weights: Array, squared: float) -> tuple[float, ...]:
        """The most that Σ ⟨weights (n, k, k), ∂g/∂q − ω² M⟩ can be.

        Of barrel and rod per area, of others in all.

        Weights are zero for the joint of a linkage that moves.
        """
        motions = _pin_motions(self.problem, self.cylinder, rigid)
        most = [
            self._most_added(motions.bars(cell), cell.lengths, weights, squared)
            for cell in self.cells
        ]
        return tuple(np.max(most, axis=0).tolist())

    def _most_added(
        self,
        bars: list[tuple[PointEnclosure, PointEnclosure]],
        lengths: Sequence[Interval],
        weights: Array,
        squared: float,
    ) -> list[float]:
        largest = []
        for (pin, way), length, per_area in zip(bars, lengths, self.per_area, strict=True):
            total = (pin.second + way.second * 0.5)[..., 2] * (weights * GRAVITY)
            for along, share in POINTS:
                total = total - _products(pin.first + way.first * along) * (
                    weights * (share * squared)
                )
            largest.append(float((length * interval(total.high.sum()) * per_area).high))
        return largest

    def with_any_areas(self, added: Sequence[float]) -> float:
        """The most that bars add with any areas."""
        return float(
            sum(
                (section * value).high
                for section, value in zip(self._sections, added, strict=True)
            )
        )


def bar_enclosures(problem: Problem) -> list[BarEnclosure] | None:
    """The cylinders whose bars depend on x.

    None where a linkage moves that has no legs, or the first of them not on the base pin's link.
    """
    masses, enclosures = problem.vector.moving_masses, []
    for i, names in masses.bars.items() if masses else ():
        today, linkage = problem.machine.cylinders[i], problem.machine.linkages[i]
        sections = {
            "barrel": today.bore_area * today.closed_length,
            "rod": (today.bore_area - today.annulus_area) * today.closed_length,
        }
        if problem.vector.moved_within(i):
            if not linkage.legs or _hub(linkage).link != linkage.base.link:
                return None
            sections |= {bar: getattr(linkage, bar) for bar, _ in linkage.legs}
        weigh = {name: today.moving_masses[name] / sections[name] for name in names}
        areas = CylinderAreas.of(problem, i)
        if areas is None:
            return None
        enclosures.append(
            BarEnclosure(
                problem=problem,
                cylinder=i,
                per_area=tuple(weigh.get(name, 0.0) for name in sections),
                area=areas.ends,
                cells=tuple(_cells(problem, i)),
            )
        )
    return enclosures


def _hub(linkage: Linkage) -> Pin:
    """The pin of the first leg: the rod end lies within that leg's length of it."""
    pin: Pin = getattr(linkage, linkage.legs[0][1])
    return pin


def _cells(problem: Problem, i: int) -> list[PinCell]:
    """Small cells of a cylinder's pins, and the closed lengths over them.

    A linkage that moves stays whole: the first leg around its pin says where the rod end is.
    """
    linkage, today = problem.machine.linkages[i], problem.machine.cylinders[i]
    vector = problem.vector
    low, high = problem.bounds
    moves = vector.moves(i)
    cut = [CUTS if place in ("base", "rod_end") else 1 for place, _ in moves.values()]
    edges = [
        np.linspace(low[v], high[v], n + 1) * vector.pin_box
        for v, n in zip(moves, cut, strict=True)
    ]
    cells = []
    for chosen in itertools.product(*(range(n) for n in cut)):
        pins: dict[str, Interval] = {}
        for (place, axis), edge, k in zip(moves.values(), edges, chosen, strict=True):
            at = pins.setdefault(place, Interval(*(np.zeros(3) for _ in range(2))))
            at.low[axis], at.high[axis] = edge[k], edge[k + 1]
        if vector.moved_within(i):
            cells.append(_around(linkage, pins, vector.beyond(i)))
            continue
        closed = interval(today.closed_length)
        if moves:
            joint = linkage.joints[0]
            sign = int(np.sign(vector.arms_today[i][0]))
            rigid = sweep(linkage.arm, joint, problem.machine.ranges[joint][::sign])
            length, beyond = _pin_motions(problem, i, rigid).span(pins).length, vector.beyond(i)
            closed = length[0] * (1 + beyond) - length[1] * beyond
        cells.append(PinCell(pins, closed))
    return cells


def _around(linkage: Linkage, pins: dict[str, Interval], beyond: float) -> PinCell:
    """A box with the rod end anywhere within the first leg's length of its pin, at every pose.

    Closed lengths are as much less as a share ``beyond`` of the travel.
    """
    unmoved = interval(np.zeros(3))
    legs = tuple(
        (pins.get(bar, unmoved)[0] + getattr(linkage, bar)).above(0.0) for bar, _ in linkage.legs
    )
    hub, reach = linkage.legs[0][1], legs[0].high
    rod_end = pins.get(hub, unmoved) + Interval(np.full(3, -reach), np.full(3, reach))
    span = (
        rod_end
        - pins.get("base", unmoved)
        + (np.array(_hub(linkage).at) - np.array(linkage.base.at))
    )
    length = span.square().sum(axis=0).sqrt()
    unit = span * length.above(TINY).reciprocal()
    closed = (length - Interval(np.array(0.0), beyond * (length.high - length.low))).above(0.0)
    way = unit.within(Interval(np.full(3, -1.0), np.full(3, 1.0))) * closed
    return PinCell({**pins, "rod_end": rod_end}, closed, legs, way)


def _pin_motions(problem: Problem, i: int, rigid: RigidPoses) -> PinMotions:
    linkage, joints = (
        problem.machine.linkages[i],
        tuple(range(len(problem.machine.arm.coordinates))),
    )
    ends = linkage.bars(rigid, 1.0)
    pins = {"base": ends["barrel"][0], "rod_end": ends["rod"][1]}
    held = {place: linkage.pin(place) for place, _ in problem.vector.moves(i).values()}
    legs = linkage.legs if problem.vector.moved_within(i) else ()
    if legs:
        pins |= {pin: ends[bar][0] for bar, pin in legs}
        pins["rod_end"], held["rod_end"] = pins[legs[0][1]], _hub(linkage)
    steps = {
        place: [
            linkage.arm.direction(rigid, pin.link, axis, linkage.arm.root, joints)
            for axis in np.eye(3)
        ]
        for place, pin in held.items()
        if pin is not None
    }
    return PinMotions(pins, steps, tuple(pin for _, pin in legs))


def _products(first: Interval) -> Interval:
    """P_j·P_k (n, k, k)."""
    mixed = (first[:, :, None] * first[:, None, :]).sum(axis=-1)
    own, k = first.square().sum(axis=-1), np.arange(first.low.shape[1])
    mixed.low[:, k, k], mixed.high[:, k, k] = own.low, own.high
    return mixed
