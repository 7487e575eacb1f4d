"""Interval arithmetic on arrays: what a formula can be while its arguments lie between ends.

Ends of ``Interval`` are rounded to nearest, which is fast: searches use it. Ends of ``Outward``
are rounded outward: proofs use it. Both go through the same formulas; an operation with one
``Outward`` gives one.

Where both ends are one array the interval is a point: what is made of points is computed once.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from armdesign.arrays import Array

STEP, LEAST = np.finfo(float).eps, np.finfo(float).tiny


@dataclass(frozen=True, eq=False)
class Interval:
    """All numbers from ``low`` to ``high``, elementwise."""

    low: Array
    high: Array

    __array_ufunc__ = None  # so that array * interval is ours

    @classmethod
    def rounded(cls, low: Array, high: Array) -> Interval:
        """The interval of ends that one operation has rounded to nearest."""
        return cls(low, high)

    @classmethod
    def like(cls, value: Array) -> Interval:
        """Numbers that are exact, as an interval of this kind."""
        return cls(value, value)

    @classmethod
    def near(cls, value: Array) -> Interval:
        """What one operation on points has rounded to nearest."""
        return cls.rounded(value, value)

    @property
    def is_point(self) -> bool:
        """Whether both ends are one array."""
        return self.low is self.high

    @cached_property
    def is_positive(self) -> bool:
        """Whether it is nowhere negative."""
        return bool(self.low.min(initial=0.0) >= 0)

    def _with(self, other: Interval) -> type[Interval]:
        """The kind of what is made of both."""
        return type(other) if isinstance(other, type(self)) else type(self)

    def __add__(self, other: Any) -> Interval:
        other = interval(other)
        if self.is_point and other.is_point:
            return self._with(other).near(self.low + other.low)
        return self._with(other).rounded(self.low + other.low, self.high + other.high)

    def __neg__(self) -> Interval:
        return self.like(-self.low) if self.is_point else type(self)(-self.high, -self.low)

    def __sub__(self, other: Any) -> Interval:
        return self + -interval(other)

    def __rsub__(self, other: Any) -> Interval:
        return interval(other) - self

    def __mul__(self, other: Any) -> Interval:
        if not isinstance(other, Interval):
            if self.is_point:
                return self.near(self.low * other)
            ends = self.low * other, self.high * other
            if isinstance(other, float | int):
                return self.rounded(*(ends if other >= 0 else ends[::-1]))
            return self.rounded(np.minimum(*ends), np.maximum(*ends))
        if self.is_point and other.is_point:
            return self._with(other).near(self.low * other.low)
        if other.is_point:
            return self._by(other)
        if self.is_point:
            return other._by(self)
        if other.is_positive:
            return other._times(self)
        if self.is_positive:
            return self._times(other)
        a, b = self.low * other.low, self.low * other.high
        c, d = self.high * other.low, self.high * other.high
        return self._with(other).rounded(
            np.minimum(np.minimum(a, b), np.minimum(c, d)),
            np.maximum(np.maximum(a, b), np.maximum(c, d)),
        )

    def _by(self, point: Interval) -> Interval:
        """The product with a point."""
        ends = self.low * point.low, self.high * point.low
        return self._with(point).rounded(np.minimum(*ends), np.maximum(*ends))

    def _times(self, other: Interval) -> Interval:
        """The product where this one is nowhere negative: what is most of the work."""
        if other.is_positive:
            return self._with(other).rounded(self.low * other.low, self.high * other.high)
        return self._with(other).rounded(
            np.minimum(self.low * other.low, self.high * other.low),
            np.maximum(self.low * other.high, self.high * other.high),
        )

    __radd__ = __add__
    __rmul__ = __mul__

    def reciprocal(self) -> Interval:
        """1/x of positive numbers."""
        if self.is_point:
            return self.near(1 / self.low)
        return self.rounded(1 / self.high, 1 / self.low)

    def square(self) -> Interval:
        """x², tighter than x·x."""
        if self.is_point:
            return self.near(self.low**2)
        size = np.maximum(np.abs(self.low), np.abs(self.high))
        least = np.maximum(np.maximum(self.low, -self.high), 0.0)
        return self.rounded(least**2, size**2)

    def sqrt(self) -> Interval:
        """√x, of what is not negative."""
        if self.is_point:
            return self.near(np.sqrt(np.maximum(self.low, 0.0)))
        ends = (np.sqrt(np.maximum(end, 0.0)) for end in (self.low, self.high))
        return self.rounded(*ends)

    def sum(self, axis: int) -> Interval:
        """Sum along an axis."""
        if self.is_point:
            return self.like(total(self.low, axis))
        return type(self)(total(self.low, axis), total(self.high, axis))

    def spread(self, reach: Array, axis: int) -> Array:
        """The most that a function of these slopes changes over so far, along an axis."""
        return total(self.size * reach, axis)

    def within(self, other: Interval) -> Interval:
        """Numbers in both intervals: for two enclosures of one number."""
        ends = np.maximum(self.low, other.low), np.minimum(self.high, other.high)
        return self._with(other)(*ends)

    def above(self, least: Array | float) -> Interval:
        """The part not below ``least`` > −∞, for a number known to lie there."""
        if self.is_point:
            return self.like(np.maximum(self.low, least))
        return type(self)(np.maximum(self.low, least), np.maximum(self.high, least))

    @property
    def size(self) -> Array:
        """Largest absolute value."""
        ends = np.abs(self.low), np.abs(self.high)
        return np.asarray(ends[0] if self.is_point else np.maximum(*ends))

    def each(self, change: Callable[[Array], Array]) -> Interval:
        """Both ends changed alike, by what keeps their order."""
        if self.is_point:
            return self.like(change(self.low))
        return type(self)(change(self.low), change(self.high))

    def __getitem__(self, index: Any) -> Interval:
        return self.each(lambda end: end[index])


class Outward(Interval):
    """The same with ends rounded outward, so that they hold for real numbers.

    IEEE 754 rounds the ends of each sum, product, quotient and root to the nearest number: what is
    exact is less than ``STEP`` of it away, or than the least normal number.
    """

    @classmethod
    def rounded(cls, low: Array, high: Array) -> Interval:
        """The interval with its ends moved outward by more than they have been rounded."""
        lost = _lost(low)
        return cls(low - lost, high + (lost if high is low else _lost(high)))

    def sum(self, axis: int) -> Interval:
        """Sum along an axis, one after the other."""
        low, high = (end.swapaxes(0, axis) for end in (self.low, self.high))
        first, *more = (type(self)(*ends) for ends in zip(low, high, strict=True))
        return sum(more, first)

    def spread(self, reach: Array, axis: int) -> Array:
        """The most that a function of these slopes changes over so far, along an axis."""
        return (self.like(self.size) * reach).sum(axis).high


def _lost(values: Array) -> Array:
    """More than rounding to nearest has lost."""
    lost = np.abs(values)
    lost *= STEP
    lost += LEAST
    return lost


def total(values: Array, axis: int) -> Array:
    """Sum along an axis; of two numbers along the first faster than numpy's own."""
    if axis == 0 and len(values) == 2:
        return np.asarray(values[0] + values[1])
    return np.asarray(values.sum(axis=axis))


def interval(value: Any) -> Interval:
    """An interval as it is; a number or array as one of no width."""
    return value if isinstance(value, Interval) else Interval.like(np.asarray(value))
