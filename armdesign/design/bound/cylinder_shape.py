"""The shape of a cylinder's moment arm, for all pins of a region at once.

Let u = ℓ²/2. Seen from the base's link u, u' = ℓ r and u'' = ℓ H + r² are affine in where the base
pin is, but for the square in u. A direct cylinder on a revolute joint looks the same when its rod
pin turns with it: in units of the rod pin's distance from the joint the rod end runs on a unit
circle, and the four pin coordinates make three numbers, the base's place b in those units and the
scale. Where the rod pin moves alone it is b, seen from its link. So in all cases, times scale²,

    u = c0 + s0·b + ½ b·b,   u' = c1 + s1·b,   u'' = c2 + s2·b.

Stiffness needs less still: with swept volumes v = A S in place of areas, only the piston's place σ
= s/S, its rate ρ = r/S and the bend τ = H/r = u''/u' − u'/(2u), none of which knows the scale.

Enclosures are the natural interval extension cut with the mean value form f(c) ± Σ max|∂f/∂b_k|
δ_k (Moore, Kearfott and Cloud, Introduction to Interval Analysis, 2009, ch. 5 and 6), whose excess
falls with the square of the box.

Boxes are the last axis of all that is enclosed, after b's coordinates and angles: there are many
more of them, so that numpy's innermost loops are long.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from armdesign.arrays import Array, Flags
from armdesign.design.bound.intervals import Interval, interval
from armdesign.design.bound.pin_triangles import TriangleBoxes

# of stroke and of |ℓ r|, in units of the scale: both are positive for a cylinder that works
LEAST = 1e-9
FIRST = (8, 8, 2)  # cells of a region along b and scale


@dataclass(frozen=True, eq=False, kw_only=True)
class Shape:
    """Coefficients c (n, 3) and s (n, 3, 2) at n angles, and the region of b and scale.

    The first two angles are of the closed and the open cylinder. ``sign`` is the sign of the
    moment arm. ``fixed`` are closed length and stroke where no pin moves: today's, which may
    exceed what the joint's range needs. ``spare`` are the shares of the stroke that stay free at
    the first two angles where a pin moves. ``pin_boxes`` say which b and scale belong together;
    None if all of the region do: b is then the move of ``pin``.
    """

    constant: Array
    slope: Array
    sign: float
    low: Array  # (2,)
    high: Array
    scale: tuple[float, float]
    fixed: tuple[float, float] | None = None
    spare: tuple[float, float] = (0.0, 0.0)
    pin_boxes: TriangleBoxes | None = None
    pin: str = "base"

    @property
    def per_travel(self) -> float:
        """Stroke over the travel between the first two angles."""
        return 1 / (1 - sum(self.spare))

    @property
    def region(self) -> tuple[Array, Array]:
        """Lowest and highest b and scale (3,)."""
        return np.append(self.low, self.scale[0]), np.append(self.high, self.scale[1])

    def cut(self, counts: tuple[int, int, int] = FIRST) -> tuple[Array, Array]:
        """The region cut evenly: corners (m, 3) of cells of b and scale."""
        cuts = zip(*self.region, counts, strict=True)
        edges = [np.linspace(a, b, n + 1) if b > a else np.array([a, b]) for a, b, n in cuts]
        grids = [
            np.meshgrid(*[e[part] for e in edges], indexing="ij")
            for part in (slice(None, -1), slice(1, None))
        ]
        low, high = (np.stack([g.ravel() for g in grid], axis=1) for grid in grids)
        return low, high

    def at(self, angles: Array) -> Shape:
        """The shape at its two ends and at some of the angles after them, by their indices."""
        chosen = np.concatenate([[0, 1], angles + 2]).astype(int)
        return replace(self, constant=self.constant[chosen], slope=self.slope[chosen])

    def enclose(self, low: Array, high: Array) -> Enclosure:
        """Over boxes of b with corners ``low`` and ``high`` (m, 2).

        Exact for boxes of no width.
        """
        low, high = np.ascontiguousarray(low.T), np.ascontiguousarray(high.T)
        if np.array_equal(low, high):
            points = Natural(self, interval(low))
            return Enclosure(points, points, np.zeros_like(low))
        middle = (low + high) / 2
        return Enclosure(
            Natural(self, Interval(low, high)), Natural(self, interval(middle)), (high - low) / 2
        )


@dataclass(frozen=True, eq=False)
class Natural:
    """Enclosure of a shape over boxes ``b`` (2, m) at n angles, by interval arithmetic alone.

    place σ, rate |ρ|, bend τ and arm |r| (n, m) with their slopes by b (2, n, m); lengths, stroke
    (m,), its slope (2, m). What no working cylinder can be (an arm of the other sign, a negative
    stroke) is cut off; slopes then hold only between working cylinders, which is not enough for a
    mean value form: see ``whole``.
    """

    shape: Shape
    b: Interval

    @cached_property
    def _slopes(self) -> Array:
        """Slopes s of u, |u'| and u'' (3, 2, n, 1)."""
        slopes = np.ascontiguousarray(self.shape.slope.transpose(1, 2, 0))[..., None]
        slopes[1] *= self.shape.sign
        return slopes

    @cached_property
    def _constants(self) -> Array:
        """Constants c of u, |u'| and u'' (3, n, 1)."""
        constants = np.ascontiguousarray(self.shape.constant.T)[..., None]
        constants[1] *= self.shape.sign
        return constants

    @cached_property
    def _lever(self) -> Interval:
        return self.b[:, None] + self._slopes[0]

    @cached_property
    def _uncut(self) -> tuple[Interval, Interval]:
        """u, and u' with the sign that makes it positive."""
        start = self.b.like(self._slopes[0])
        flat = start.square().sum(axis=0) * -0.5 + self._constants[0]
        first = (self.b[:, None] * self._slopes[1]).sum(axis=0) + self._constants[1]
        return self._lever.square().sum(axis=0) * 0.5 + flat, first

    @cached_property
    def whole(self) -> Flags:
        """Whether nothing had to be cut off (m,)."""
        u, first = self._uncut
        ends = self._swept
        return np.asarray(
            np.all((u.low >= LEAST) & (first.low >= LEAST), axis=0) & (ends.low >= LEAST)
        )

    @cached_property
    def _half_square(self) -> Interval:
        return self._uncut[0].above(LEAST)

    @cached_property
    def _first(self) -> Interval:
        """|u'|: the arm vanishes nowhere in the range."""
        return self._uncut[1].above(LEAST)

    @cached_property
    def _ratio(self) -> Interval:
        """u''/|u'|."""
        second = (self.b[:, None] * self._slopes[2]).sum(axis=0) + self._constants[2]
        return second * self._per_first

    @cached_property
    def _length(self) -> Interval:
        return (self._half_square * 2).sqrt()

    @cached_property
    def _per_half_square(self) -> Interval:
        return self._half_square.reciprocal()

    @cached_property
    def _per_first(self) -> Interval:
        return self._first.reciprocal()

    @cached_property
    def _per_length(self) -> Interval:
        return self._length.reciprocal()

    @cached_property
    def _along(self) -> Interval:
        """∂ℓ/∂b, a unit vector."""
        unit = self._lever * self._per_length
        return unit.within(Interval(np.array(-1.0), np.array(1.0)))

    @cached_property
    def arm(self) -> Interval:
        """Moment arm |r| (n, m)."""
        return self._first * self._per_length

    @cached_property
    def closed(self) -> Interval:
        """Least length (m,)."""
        return (
            self._length[0] - self.stroke * self.shape.spare[0]
            if self.shape.fixed is None
            else self.b.like(np.full(self.b.low.shape[1], self.shape.fixed[0]))
        )

    @cached_property
    def open(self) -> Interval:
        """Greatest length (m,)."""
        if self.shape.fixed is None:
            return self._length[1] + self.stroke * self.shape.spare[1]
        return self.closed + self.shape.fixed[1]

    @cached_property
    def _swept(self) -> Interval:
        """The stroke but for what may be cut off (m,)."""
        if self.shape.fixed is None:
            return (self._length[1] - self._length[0]) * self.shape.per_travel
        return self.open - self.closed

    @cached_property
    def stroke(self) -> Interval:
        """Stroke S (m,)."""
        return self._swept.above(LEAST)

    @cached_property
    def _per_stroke(self) -> Interval:
        return self.stroke.reciprocal()

    @cached_property
    def stroke_slope(self) -> Interval:
        """∂S/∂b (2, m)."""
        return (
            (self._along[:, 1] - self._along[:, 0]) * self.shape.per_travel
            if self.shape.fixed is None
            else self._along[:, 0] * 0.0
        )

    @cached_property
    def place(self) -> Interval:
        """Piston's place σ = s/S (n, m)."""
        fixed = self.shape.fixed is not None
        start, place = (self.closed, 0.0) if fixed else (self._length[0], self.shape.spare[0])
        return (self._length - start) * self._per_stroke + place

    @cached_property
    def place_slope(self) -> Interval:
        """∂σ/∂b (2, n, m)."""
        start = self._along[:, :1] if self.shape.fixed is None else 0.0
        along = self.place - (self.shape.spare[0] if self.shape.fixed is None else 0.0)
        change = self._along - start - along * self.stroke_slope[:, None]
        return change * self._per_stroke

    @cached_property
    def rate(self) -> Interval:
        """Its rate |ρ| = |r|/S (n, m)."""
        return self.arm * self._per_stroke

    @cached_property
    def arm_slope(self) -> Interval:
        """∂|r|/∂b (2, n, m)."""
        change = self._slopes[1] - self._along * self.arm
        return change * self._per_length

    @cached_property
    def rate_slope(self) -> Interval:
        """∂|ρ|/∂b (2, n, m)."""
        change = self.arm_slope - self.rate * self.stroke_slope[:, None]
        return change * self._per_stroke

    @cached_property
    def bend(self) -> Interval:
        """Bend τ = H/r (n, m)."""
        return self._signed(self._ratio - self._first * self._per_half_square * 0.5)

    @cached_property
    def bend_slope(self) -> Interval:
        """∂τ/∂b (2, n, m)."""
        first, by_u = self._slopes[1], self._per_half_square
        of_ratio = (self._slopes[2] - self._ratio * first) * self._per_first
        return self._signed(of_ratio - (first - self._lever * self._first * by_u) * by_u * 0.5)

    def _signed(self, bend: Interval) -> Interval:
        """What changes its sign with the moment arm, from what it is beside the arm's size."""
        return bend if self.shape.sign > 0 else -bend


@dataclass(frozen=True, eq=False)
class Enclosure:
    """Enclosure of a shape over boxes: ``wide`` cut with the mean value form about ``centre``.

    Only where the box is whole: else the way from the centre may lead through what was cut off.
    """

    wide: Natural
    centre: Natural
    reach: Array

    @property
    def is_point(self) -> bool:
        """Whether the boxes have no width, so that nothing is cut."""
        return self.centre is self.wide

    @cached_property
    def place(self) -> Interval:
        """Piston's place σ = s/S (n, m)."""
        return self._cut("place")

    @cached_property
    def rate(self) -> Interval:
        """Its rate |ρ| = |r|/S (n, m)."""
        return self._cut("rate")

    @cached_property
    def bend(self) -> Interval:
        """Bend τ = H/r (n, m)."""
        return self._cut("bend")

    @cached_property
    def arm(self) -> Interval:
        """Moment arm |r| (n, m)."""
        return self._cut("arm")

    @cached_property
    def rate_above_nothing(self) -> Interval:
        """The rate (n, m) where it divides."""
        return self.rate.above(LEAST)

    @cached_property
    def stroke(self) -> Interval:
        """Stroke S (m,)."""
        return self._cut("stroke")

    def _cut(self, name: str) -> Interval:
        if self.is_point:
            points: Interval = getattr(self.wide, name)
            return points
        slope: Interval = getattr(self.wide, f"{name}_slope")
        reach = self.reach if slope.low.ndim == 2 else self.reach[:, None]  # at every angle
        spread = np.where(self.wide.whole, slope.spread(reach, 0), np.inf)
        cut: Interval = getattr(self.wide, name).within(
            _around(getattr(self.centre, name), spread)
        )
        return cut


def _around(centre: Interval, spread: Array) -> Interval:
    return centre + Interval(-spread, spread)
