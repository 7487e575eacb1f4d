"""Intervals whose ends are computed by a library's arithmetic of balls: Arb, in python-flint."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import flint
import numpy as np

from armdesign.arrays import Array
from armdesign.design.bound.intervals import Interval, Outward, interval

BITS = 120  # so that what the library does not know is far below the last bit of a float


class ByLibrary(Outward):
    """Ends of Arb's balls, as the floats outside of them."""

    def __add__(self, other: Any) -> Interval:
        return _ends(lambda a, b: a + b, self, interval(other))

    def __mul__(self, other: Any) -> Interval:
        return _ends(lambda a, b: a * b, self, interval(other))

    __radd__ = __add__
    __rmul__ = __mul__

    def __rsub__(self, other: Any) -> Interval:
        return -self + other

    def reciprocal(self) -> Interval:
        return _ends(lambda a: 1 / a, self)

    def square(self) -> Interval:
        least = np.maximum(np.maximum(self.low, -self.high), 0.0)
        return _ends(lambda a: a * a, ByLibrary(least, self.size))

    def sqrt(self) -> Interval:
        return _ends(lambda a: a.sqrt(), self.above(0.0))


def _ends(operation: Callable[..., flint.arb], *given: Interval) -> Interval:
    """Least and greatest of an operation at the ends of what is given: at all pairs of two."""

    def of(*ends: float) -> tuple[float, float]:
        with flint.ctx.workprec(BITS):
            pairs = [[flint.arb(end) for end in ends[k : k + 2]] for k in range(0, len(ends), 2)]
            first, *second = pairs
            balls = (
                [operation(a, b) for a in first for b in second[0]]
                if second
                else [operation(a) for a in first]
            )
            return min(_below(b) for b in balls), max(_above(b) for b in balls)

    ends = [end for one in given for end in (one.low, one.high)]
    low, high = np.frompyfunc(of, len(ends), 2)(*ends)
    return ByLibrary(_floats(low), _floats(high))


def _floats(values: Any) -> Array:
    return np.asarray(values, dtype=float)


def _below(ball: flint.arb) -> float:
    """A float that is no more than anything in a ball."""
    if not ball.is_finite():
        return -np.inf
    near = float(ball.lower())
    return near if flint.arb(near) <= ball.lower() else float(np.nextafter(near, -np.inf))


def _above(ball: flint.arb) -> float:
    return -_below(-ball)
