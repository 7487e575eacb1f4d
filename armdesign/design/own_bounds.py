"""What own masses can do at some poses, whatever the design: inertia, gravity and its slope enclosed by intervals.

A barrel lies from the base pin along the unit vector u to the rod end, a rod ends there: P = B + t c u. With d the
span, ∂u = (∂d − u ∂ℓ)/ℓ and the next derivative likewise, all in intervals over small boxes of both pins, of which the
union counts. Masses are m = (m0/(A0 c0)) A c with closed length c, see ``own_masses``.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armdesign.arm import RigidPoses
from armdesign.arrays import Array
from armdesign.design.intervals import Interval, interval
from armdesign.design.limits import SLACK
from armdesign.design.problem import Problem
from armdesign.jets import VectorJet
from armdesign.ranges import sweep
from armdesign.units import GRAVITY

CUTS = 2  # of every pin coordinate into small boxes
POINTS = ((0.0, 1 / 6), (0.5, 2 / 3), (1.0, 1 / 6))  # of a uniform bar (Simpson), see ``arm.points_of_bar``


@dataclass(frozen=True, eq=False)
class Motion:
    """A point over a box: place (n, 3), derivatives by the joints (n, k, 3) and (n, k, k, 3)."""

    value: Interval
    first: Interval
    second: Interval

    @classmethod
    def of(cls, jet: VectorJet) -> Motion:
        """A point that is known."""
        return cls(interval(jet.value), interval(jet.first), interval(jet.second))

    def __add__(self, other: Motion) -> Motion:
        return Motion(self.value + other.value, self.first + other.first, self.second + other.second)

    def __sub__(self, other: Motion) -> Motion:
        return Motion(self.value - other.value, self.first - other.first, self.second - other.second)

    def __mul__(self, factor: Interval | float) -> Motion:
        return Motion(self.value * factor, self.first * factor, self.second * factor)

    @property
    def length(self) -> Interval:
        """Of the vector to the point."""
        return self.value.square().sum(axis=-1).sqrt()

    @property
    def unit(self) -> Motion:
        """The vector's direction."""
        inverse = self.length.reciprocal()
        u = (self.value * inverse[:, None]).within(Interval(np.array(-1.0), np.array(1.0)))
        slope = (u[:, None] * self.first).sum(axis=-1)
        first = (self.first - u[:, None] * slope[..., None]) * inverse[:, None, None]
        bend = _products(self.first) + (self.value[:, None, None] * self.second).sum(axis=-1)
        bend = (bend - slope[:, :, None] * slope[:, None]) * inverse[:, None, None]
        second = self.second - first[:, :, None] * slope[:, None, :, None] - first[:, None] * slope[:, :, None, None]
        return Motion(u, first, (second - u[:, None, None] * bend[..., None]) * inverse[:, None, None, None])


@dataclass(frozen=True, eq=False)
class Jets:
    """Base pin and rod end seen from the root, and how they move by each coordinate of a pin that moves."""

    base: VectorJet
    rod_end: VectorJet
    steps: Mapping[str, Sequence[VectorJet]]

    def _over(self, name: str, jet: VectorJet, pins: Mapping[str, Interval]) -> Motion:
        point = Motion.of(jet)
        for k, step in enumerate(self.steps.get(name, ())):
            by = pins[name][k]
            if by.high > by.low:
                point = point + Motion.of(step) * by
        return point

    def span(self, pins: Mapping[str, Interval]) -> Motion:
        """The way from base pin to rod end over a box of pins."""
        return self._over("rod_end", self.rod_end, pins) - self._over("base", self.base, pins)

    def bars(self, pins: Mapping[str, Interval], closed: Interval) -> list[tuple[Motion, Motion]]:
        """Barrel and rod over a box: from which pin each starts, and the way to its other end."""
        way = self.span(pins).unit * closed
        base, rod_end = self._over("base", self.base, pins), self._over("rod_end", self.rod_end, pins)
        return [(base, way), (rod_end, way * -1.0)]


@dataclass(frozen=True, eq=False, kw_only=True)
class Barred:
    """Barrel and rod of a cylinder over all designs.

    Attributes:
        cylinder: its index.
        per_area: mass per bore area and length of the barrel, per rod area and length of the rod [kg/m³]; 0 where
            they weigh nothing.
        area: least and largest bore and annulus areas (2, 2: ends, sides) [m²].
        boxes: small boxes of its pins, each with the closed length [m] over it.
    """

    problem: Problem
    cylinder: int
    per_area: tuple[float, float]
    area: Array
    boxes: tuple[tuple[dict[str, Interval], Interval], ...]

    @cached_property
    def _sections(self) -> tuple[Interval, Interval]:
        """Bore and rod area (of the design, all parallel cylinders together) [m²]."""
        (low, high) = self.area
        rod = Interval(np.maximum(low[0] - high[1], 0.0), np.maximum(high[0] - low[1], 0.0))
        return Interval(low[0], high[0]), rod

    def gravity(self, rigid: RigidPoses) -> Interval:
        """Gravity torques (n, nq) [N m] of both bars."""
        jets, found = _jets(self.problem, self.cylinder, rigid), []
        for pins, closed in self.boxes:
            total = interval(0.0)
            for (pin, way), per_area, section in zip(
                jets.bars(pins, closed), self.per_area, self._sections, strict=True
            ):
                middle = (pin.first + way.first * 0.5)[..., 2]
                total = total + middle * (closed * section * (per_area * GRAVITY))
            found.append(total)
        return Interval(np.min([f.low for f in found], axis=0), np.max([f.high for f in found], axis=0))

    def worth(self, rigid: RigidPoses, weights: Array, squared: float) -> tuple[float, float]:
        """The most that Σ ⟨weights (n, nq, nq), ∂g/∂q − ω² M⟩ can be, per bore area of barrels and rod area of rods."""
        jets = _jets(self.problem, self.cylinder, rigid)
        found = [self._worth(jets.bars(*box), box[1], weights, squared) for box in self.boxes]
        return max(f[0] for f in found), max(f[1] for f in found)

    def _worth(
        self, bars: list[tuple[Motion, Motion]], closed: Interval, weights: Array, squared: float
    ) -> list[float]:
        found = []
        for (pin, way), per_area in zip(bars, self.per_area, strict=True):
            total = (pin.second + way.second * 0.5)[..., 2] * (weights * GRAVITY)
            for along, share in POINTS:
                total = total - _products(pin.first + way.first * along) * (weights * (share * squared))
            found.append(float((closed * interval(total.high.sum()) * per_area).high))
        return found

    def most(self, worth: tuple[float, float]) -> float:
        """The most that a ``worth`` comes to with any areas."""
        return float(sum((section * value).high for section, value in zip(self._sections, worth, strict=True)))


def barred(problem: Problem) -> list[Barred] | None:
    """The cylinders whose bars hang on x; None where a four-bar that weighs moves."""
    own, found = problem.own, []
    for i, names in own.bars.items() if own else ():
        places = {place for place, _ in problem.moves(i).values()}
        if not places <= {"base", "rod_end"}:
            return None
        today = problem.machine.cylinders[i]
        sections = {"barrel": today.bore_area, "rod": today.bore_area - today.annulus_area}
        weigh = {name: today.moving_masses[name] / (sections[name] * today.closed_length) for name in names}
        low, high = (problem.areas(end)[i] for end in problem.bounds)
        most = problem.requirements.thrust_share * (1 + SLACK) * problem.areas_today[i, 0]
        found.append(
            Barred(
                problem=problem,
                cylinder=i,
                per_area=(weigh.get("barrel", 0.0), weigh.get("rod", 0.0)),
                area=np.stack([low, np.minimum(high, [most, np.inf])]),
                boxes=tuple(_boxes(problem, i)),
            )
        )
    return found


def _boxes(problem: Problem, i: int) -> list[tuple[dict[str, Interval], Interval]]:
    """Small boxes of a cylinder's pins [m], and closed lengths over them: those at that end of the joint's range."""
    linkage, today = problem.machine.linkages[i], problem.machine.cylinders[i]
    low, high = problem.bounds
    moves = problem.moves(i)
    edges = [np.linspace(low[v], high[v], CUTS + 1) * problem.box for v in moves]
    found = []
    for chosen in itertools.product(range(CUTS), repeat=len(moves)):
        pins: dict[str, Interval] = {}
        for (place, axis), edge, k in zip(moves.values(), edges, chosen, strict=True):
            at = pins.setdefault(place, Interval(*(np.zeros(3) for _ in range(2))))
            at.low[axis], at.high[axis] = edge[k], edge[k + 1]
        closed = interval(today.closed_length)
        if moves:
            joint = linkage.joints[0]
            end = problem.machine.ranges[joint][0 if problem.arms_today[i][0] > 0 else 1]
            rigid = sweep(linkage.arm, joint, np.array([end]))
            jets = _jets(problem, i, rigid)
            closed = jets.span(pins).length[0]
        found.append((pins, closed))
    return found


def _jets(problem: Problem, i: int, rigid: RigidPoses) -> Jets:
    linkage, joints = problem.machine.linkages[i], tuple(range(len(problem.machine.joints)))
    ends, steps = linkage.bars(rigid, 1.0), {}
    for place in {place for place, _ in problem.moves(i).values()}:
        pin = linkage.pin(place)
        assert pin is not None
        steps[place] = [linkage.arm.direction(rigid, pin.link, axis, linkage.arm.root, joints) for axis in np.eye(3)]
    return Jets(ends["barrel"][0], ends["rod"][1], steps)


def _products(first: Interval) -> Interval:
    """P_j·P_k (n, k, k)."""
    mixed = (first[:, :, None] * first[:, None, :]).sum(axis=-1)
    own, k = first.square().sum(axis=-1), np.arange(first.low.shape[1])
    mixed.low[:, k, k], mixed.high[:, k, k] = own.low, own.high
    return mixed
