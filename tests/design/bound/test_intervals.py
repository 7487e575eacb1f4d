"""Interval arithmetic holds what it says, against samples."""

from __future__ import annotations

import operator

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from armdesign.design.bound.intervals import Interval, interval
from tests.design.bound.shapes import shares

numbers = st.floats(-5, 5)


@given(*[numbers] * 4, shares, shares)
def test_arithmetic_holds_samples(
    a: float, b: float, c: float, d: float, u: float, v: float
) -> None:
    """Every result of numbers from two intervals lies in the interval of results; 1e-12:
    rounding.
    """
    x, y = (Interval(np.array([min(e)]), np.array([max(e)])) for e in ((a, b), (c, d)))
    p, q = x.low + u * (x.high - x.low), y.low + v * (y.high - y.low)

    def holds(whole: Interval, part: np.ndarray) -> bool:
        return bool(np.all((whole.low <= part + 1e-12) & (part <= whole.high + 1e-12)))

    for operation in (operator.add, operator.sub, operator.mul):
        assert holds(operation(x, y), operation(p, q))
        assert holds(operation(x, q), operation(p, q))
        assert holds(operation(x, interval(q)), operation(p, q))
        assert holds(operation(interval(p), y), operation(p, q))
    assert holds(2.0 - x, 2.0 - p)
    assert holds(x.square(), p**2)
    assert holds(x.above(0.5), np.maximum(p, 0.5))
    positive, number = x.square() + 0.1, p**2 + 0.1
    assert holds(positive.reciprocal(), 1 / number)
    assert holds(positive.sqrt(), np.sqrt(number))
    assert x.size >= abs(p) - 1e-12
