"""One cylinder's share of the upper bound: its own pins and areas, chosen as well as its own requirements let it.

With swept volumes v = A S of both sides the share is

    Σ_j w_j k_j r_j² − G_j τ_j − μ·v,    k r² = β (v1² ρ²/(v1 σ + D1) + v2² ρ²/(v2 (1 − σ) + D2)),

w ≥ 0 and D dead volumes. For a given shape it is convex in v, so its maximum lies at a vertex of any polygon around the
allowed (v1, v2). Over a box of shapes it is enclosed twice, naturally and in the mean value form, and the boxes are
branched, many at a time, until none can exceed the best design found by more than a tolerance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

import numpy as np

from armdesign.arrays import Array, Flags
from armdesign.design.intervals import Interval
from armdesign.design.own_limits import OwnLimits
from armdesign.design.shapes import Enclosure, Natural, Shape

BATCH = 1500  # boxes branched at a time
TRIALS = 200  # middles of boxes tried as designs
TINY = 1e-12  # [m³] of oil
FIRST = (8, 8, 2)  # boxes to begin with, along b and scale


@dataclass(frozen=True, eq=False, kw_only=True)
class Boxes:
    """Boxes (m, 3) of b and scale: upper bound, the swept volumes (m, 2) that it is for, what each axis adds to it."""

    low: Array
    high: Array
    bound: Array
    volume: Array
    added: Array
    source: Array  # (m,) index among the boxes that were asked for

    def __getitem__(self, rows: Array) -> Boxes:
        return Boxes(**{f.name: getattr(self, f.name)[rows] for f in fields(self)})


@dataclass(frozen=True, eq=False, kw_only=True)
class Share:
    """The function to be maximised: weights at the shape's angles, prices of the swept volumes."""

    shape: Shape
    limits: OwnLimits
    weight: Array  # (n,) w β ≥ 0
    bend: Array  # (n,) G
    price: Array  # (2,) μ
    dead: Array  # (2,) D [m³]

    def upper(self, low: Array, high: Array) -> Boxes:
        """Upper bounds over boxes (m, 3); boxes in which nothing is allowed are left out."""
        kept, scale, vertices = self.limits.allowed(low, high)
        low, high = low[kept], high[kept]
        e = self.shape.enclose(low[:, :2], high[:, :2])
        bound, spread, known = self.enclosed(e, vertices)
        rows, best = np.arange(len(low)), bound.argmax(axis=1)
        return Boxes(
            low=np.column_stack([low[:, :2], scale.low]),
            high=np.column_stack([high[:, :2], scale.high]),
            bound=bound[rows, best],
            volume=vertices[rows, best],
            added=self._added(e, scale, spread[rows, best], vertices[rows, best], known[rows, best]),
            source=kept,
        )

    def enclosed(self, e: Enclosure, volume: Array) -> tuple[Array, Array, Flags]:
        """Upper bounds (m, 5) at swept volumes (m, 5, 2); what b adds to the mean value form; whether it holds."""
        slopes, known = self._slopes(e, volume)
        spread = slopes * e.reach[:, None]
        mean_value = np.where(known, self._value(e.centre, volume) + spread.sum(axis=2), np.inf)
        return np.minimum(self._natural(e, volume), mean_value), spread, known

    def _added(self, e: Enclosure, scale: Interval, spread: Array, volume: Array, known: Flags) -> Array:
        """What each axis of a box adds to its bound (m, 3), roughly; b and scale also by what the limits leave to v."""
        worth = np.abs(self._value(e.centre, volume[:, None])[:, 0] + volume @ self.price)
        by_stroke = worth[:, None] * e.wide.stroke_slope.size * e.reach / e.stroke.low[:, None]
        by_scale = 0.25 * worth * (scale.high / scale.low - 1)
        added = np.column_stack([spread + by_stroke, by_scale])
        return np.where(known[:, None], added, np.column_stack([e.reach, np.zeros(len(worth))]))

    def _natural(self, e: Enclosure, volume: Array) -> Array:
        """Upper bound (m, 5) at swept volumes (m, 5, 2), everything at its end."""
        empty, full = np.maximum(e.place.low, 0.0), np.minimum(e.place.high, 1.0)
        return self._sum(empty, full, e.rate.square().high, np.where(self.bend > 0, e.bend.low, e.bend.high), volume)

    def _value(self, centre: Natural, volume: Array) -> Array:
        """The share (m, 5) at the centres of boxes."""
        place = centre.place.low
        return self._sum(place, place, centre.rate.low**2, centre.bend.low, volume)

    def _sum(self, first: Array, last: Array, square: Array, bend: Array, volume: Array) -> Array:
        """Σ w k r² − G τ − μ·v with the piston at ``first`` for the cap and at ``last`` for the annulus side."""
        filled = first[:, None] * volume[..., :1] + self.dead[0], (1 - last)[:, None] * volume[..., 1:] + self.dead[1]
        with np.errstate(divide="ignore", invalid="ignore"):
            oil = volume[..., :1] ** 2 / filled[0] + volume[..., 1:] ** 2 / filled[1]
            oil = np.einsum("mvn,mn->mv", oil, self.weight * square)
        return np.asarray(oil - (bend @ self.bend)[:, None] - volume @ self.price)

    def _slopes(self, e: Enclosure, volume: Array) -> tuple[Array, Flags]:
        """Largest absolute derivatives by b (m, 5, 2) over the boxes, at swept volumes (m, 5, 2); where they hold."""
        place, rate = e.place[:, None], e.rate[:, None]
        springs, changes, known = [], [], e.wide.whole[:, None]
        for v, share, dead in ((volume[..., :1], place, self.dead[0]), (volume[..., 1:], 1 - place, self.dead[1])):
            filled = share * v + dead
            known = known & np.all(filled.low[..., 2:] > dead / 2, axis=2)  # also for a piston beyond its ends
            emptiness = filled.above(dead / 2 + TINY).reciprocal()
            springs.append(emptiness * v**2)
            changes.append((emptiness * v).square() * v)
        by_rate = rate * (springs[0] + springs[1]) * (2 * self.weight)
        by_place = rate.square() * (changes[1] - changes[0]) * self.weight
        bend = (e.wide.bend_slope * self.bend[:, None]).sum(axis=1)
        found = []
        for k in (0, 1):
            oil = by_rate * e.wide.rate_slope[:, None, :, k] + by_place * e.wide.place_slope[:, None, :, k]
            found.append((oil.sum(axis=2) - bend[:, None, k]).size)
        return np.stack(found, axis=2), known


@dataclass(frozen=True, eq=False, kw_only=True)
class Maximum:
    """The most that a share can be: ``upper`` holds for sure, ``value`` is reached by ``design`` with ``volume``."""

    upper: float
    value: float
    design: Array  # (3,) b and scale
    volume: Array  # (2,) [m³]
    boxes: int  # looked at


def maximum(share: Share, tolerance: float, most_boxes: int) -> Maximum:
    """Branch and bound until upper − value ≤ tolerance or so many boxes have been looked at."""
    low, high = first_boxes(share.shape)
    boxes, looked, settled = share.upper(low, high), len(low), -math.inf
    best = Maximum(upper=math.inf, value=-math.inf, design=np.zeros(3), volume=np.zeros(2), boxes=0)
    while True:
        best = _better(share, best, boxes)
        hopeful = boxes.bound > best.value + tolerance
        settled = max(settled, float(boxes.bound[~hopeful].max(initial=-math.inf)))
        boxes = boxes[hopeful]
        if len(boxes.bound) == 0 or looked >= most_boxes:
            break
        order = np.argsort(-boxes.bound)
        parents, waiting = boxes[order[:BATCH]], boxes[order[BATCH:]]
        children = share.upper(*_halves(parents))
        looked += 2 * len(parents.bound)
        inherited = np.tile(parents.bound, 2)[children.source]
        boxes = _together(waiting, replace(children, bound=np.minimum(children.bound, inherited)))
    upper = max(settled, float(boxes.bound.max(initial=-math.inf)), best.value)
    return replace(best, upper=upper, boxes=looked)


def first_boxes(shape: Shape) -> tuple[Array, Array]:
    """The region of a shape cut evenly: corners (m, 3) of boxes of b and scale."""
    cuts = zip(*shape.region, FIRST, strict=True)
    edges = [np.linspace(a, b, n + 1) if b > a else np.array([a, b]) for a, b, n in cuts]
    grids = [np.meshgrid(*[e[part] for e in edges], indexing="ij") for part in (slice(None, -1), slice(1, None))]
    low, high = (np.stack([g.ravel() for g in grid], axis=1) for grid in grids)
    return low, high


def _halves(boxes: Boxes) -> tuple[Array, Array]:
    """Both halves of every box, cut across the axis that adds most to its bound."""
    rows = np.arange(len(boxes.bound))
    axis = np.where(boxes.high > boxes.low, boxes.added, -1.0).argmax(axis=1)
    first_high, second_low = boxes.high.copy(), boxes.low.copy()
    first_high[rows, axis] = second_low[rows, axis] = (boxes.low[rows, axis] + boxes.high[rows, axis]) / 2
    return np.concatenate([boxes.low, second_low]), np.concatenate([first_high, boxes.high])


def _together(some: Boxes, more: Boxes) -> Boxes:
    return Boxes(**{f.name: np.concatenate([getattr(some, f.name), getattr(more, f.name)]) for f in fields(Boxes)})


def _better(share: Share, best: Maximum, boxes: Boxes) -> Maximum:
    """The best of the boxes' middles, if better: a box of no width is one design."""
    promising = np.argsort(-boxes.bound)[:TRIALS]
    promising = promising[boxes.bound[promising] > best.value]
    middle = (boxes.low[promising] + boxes.high[promising]) / 2
    designs = share.upper(middle, middle)
    if len(designs.bound) == 0 or designs.bound.max() <= best.value:
        return best
    k = int(designs.bound.argmax())
    return replace(best, value=float(designs.bound[k]), design=designs.low[k], volume=designs.volume[k])
