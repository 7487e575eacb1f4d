"""Lengths of a cylinder on a drawing's grid: what is built sweeps more oil than its pins ask for.

Where a cylinder's pins move, its closed length c and stroke S are whole steps, or today's, with
c ≤ ℓ_min and c + S ≥ ℓ_max. So S is at least ℓ_max less the largest such c, rounded up, and all of
it counts as oil and takes dead length. What it leaves beyond the joint's range only softens the
oil, so that stiffness is bounded by strokes that fit. Where one pin moves alone, b is its move,
and the pin lies on whole steps, or each coordinate where it is today.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from armdesign.arrays import Array, Flags
from armdesign.design.bound.cylinder_shape import Shape
from armdesign.design.bound.intervals import Interval
from armdesign.design.bound.shape_of_pins import coordinates
from armdesign.design.program.constraints import CONSTRAINT_TOLERANCE
from armdesign.design.program.problem import Problem
from armdesign.design.requirements.places import Outline, depth
from armdesign.units import mm

SAME = 1e-9  # of a step
NOTHING = 1e-12  # of b


@dataclass(frozen=True, eq=False, kw_only=True)
class DrawnLengths:
    """Grid of one cylinder's lengths, and the strokes that it may be built with.

    Attributes:
        length: step of closed lengths and pins [m].
        stroke: step of strokes [m].
        today: closed length and stroke of today [m], which pins that stay keep.
        place: today's b (2,).
        pin: coordinates (2,) of today's pin in its link [m], if one pin alone moves.
        shape: at even angles of the joint's range.
        outlines: that hold that pin.
        least, most: strokes that are built [m].
    """

    length: float
    stroke: float
    today: tuple[float, float]
    place: Array
    shape: Shape
    pin: Array | None = None
    outlines: tuple[Outline, ...] = ()
    least: float = 0.0
    most: float = math.inf

    @classmethod
    def of(cls, problem: Problem, i: int, shape: Shape | None) -> DrawnLengths | None:
        """Those of cylinder ``i`` of a shape at even angles of the joint's range.

        None where no pin of it moves, so that its lengths stay.
        """
        cylinder, grid = problem.machine.cylinders[i], problem.grid
        if i not in problem.vector.moving or shape is None or shape.fixed is not None:
            return None
        moved = {v.pin for v in problem.vector.variables if v.cylinder == i and v.pin}
        pin = problem.machine.linkages[i].pin(shape.pin)
        alone = pin is not None and moved == {shape.pin} and shape.pin_boxes is None
        outlines = (one for one in problem.requirements.outlines if pin and one.link == pin.link)
        return cls(
            length=grid.lengths * mm,
            stroke=grid.strokes * mm,
            today=(cylinder.closed_length, cylinder.stroke),
            place=coordinates(problem, i, shape, problem.vector.start)[:2],
            shape=shape,
            pin=np.array(pin.at)[[0, 2]] if alone and pin else None,
            outlines=tuple(outlines),
        )

    @property
    def allowance(self) -> float:
        """By which lengths may miss the joint's range [m]."""
        return CONSTRAINT_TOLERANCE * self.today[1]

    def stays(self, b: Interval) -> Flags:
        """Whether pins may stay where they are in boxes (2, m) of b."""
        place = self.place[:, None]
        near = (b.low <= place + NOTHING) & (b.high >= place - NOTHING)
        return np.asarray(near.all(axis=0))

    def closed(self, at_most: Array, stays: Flags) -> Array:
        """Largest closed lengths on the grid, or today's if pins may stay, up to some [m]."""
        most = at_most + self.allowance
        down, today = np.floor(most / self.length) * self.length, self.today[0]
        return np.where(stays & (down < today) & (today <= most), today, down)

    def built(self, stroke: Array, closed: Array, opened: Array, stays: Flags) -> Array:
        """Least strokes on the grid, or today's, for strokes, least and greatest lengths [m]."""
        least = np.maximum(stroke, opened - self.closed(closed, stays)) - self.allowance
        return np.maximum(self._at_least(least, stays), self.least)

    def _at_least(self, least: Array, stays: Flags) -> Array:
        """Least strokes on the grid, or today's if pins may stay, no less than some [m]."""
        up, today = np.ceil(least / self.stroke) * self.stroke, self.today[1]
        return np.where(stays & (least <= today) & (today < up), today, up)

    def fitting(self, at_most: Array) -> Array:
        """Largest strokes on the grid that are no more than some [m]."""
        down, today = np.floor(at_most / self.stroke + SAME) * self.stroke, self.today[1]
        return np.where((down < today) & (today <= at_most), today, down)

    def between(self, least: float, most: float) -> DrawnLengths:
        """The same with no other strokes than between two [m]."""
        low = float(self._at_least(np.array(max(self.least, least)), np.array(True)))
        high = float(self.fitting(np.array(min(self.most, most))))
        return replace(self, least=low, most=high)

    def held(self, low: Array, high: Array) -> Flags:
        """Whether outlines may hold a pin somewhere in boxes (m, 2) of b."""
        kept = np.ones(len(low), dtype=bool)
        if self.pin is None:
            return kept
        middle, reach = (low + high) / 2 + self.pin, np.hypot(*((high - low) / 2).T)
        for outline in self.outlines:
            within = depth(middle, np.array(outline.points)).min(axis=-1)
            kept &= within + reach >= outline.pin_radius - self.allowance
        return kept

    def peaks(self, b: Array) -> Array:
        """Largest moment arms (m,) over the joint's range at places b (m, 2) of a pin [m/rad].

        By a parabola, as the requirements take them, and more than other even angles lose.
        """
        arms = self.shape.enclose(b, b).wide.arm.low[2:]
        return largest(arms.T) * (1 + CONSTRAINT_TOLERANCE)

    def shrunk(self, low: Array, high: Array) -> tuple[Array, Array]:
        """Boxes (m, …) of b and more shrunk to the places that a pin may have in them.

        In an empty one an axis has its low end above its high end.
        """
        if self.pin is None:
            return low, high
        low, high = low.copy(), high.copy()
        for axis in (0, 1):
            a, b = low[:, axis], high[:, axis]
            up = np.ceil((a + self.pin[axis]) / self.length - SAME) * self.length - self.pin[axis]
            down = np.floor((b + self.pin[axis]) / self.length + SAME) * self.length
            down = down - self.pin[axis]
            stays = (a <= 0) & (b >= 0)
            low[:, axis] = np.where(stays & (up > 0), 0.0, up)
            high[:, axis] = np.where(stays & (down < 0), 0.0, down)
        return low, high

    def nearest(self, places: Array, low: Array, high: Array) -> Array:
        """Places (m, …) moved to the nearest that a pin may have between two b (2,)."""
        if self.pin is None:
            return places
        places = places.copy()
        first, last = self.shrunk(low[None, :2], high[None, :2])
        rounded = np.round((places[:, :2] + self.pin) / self.length) * self.length - self.pin
        places[:, :2] = np.clip(rounded, first, np.maximum(first, last))
        return places


def largest(values: Array) -> Array:
    """Largest of even values (m, n), by a parabola through the largest and its neighbours."""
    at, rows, last = values.argmax(axis=1), np.arange(len(values)), values.shape[1] - 1
    before, middle, after = (values[rows, np.clip(at + k, 0, last)] for k in (-1, 0, 1))
    bend, slope = before - 2 * middle + after, (after - before) / 2
    with np.errstate(divide="ignore", invalid="ignore"):
        above = np.where((at > 0) & (at < last) & (bend < 0), -(slope**2) / bend / 2, 0.0)
    return np.asarray(middle + above)
