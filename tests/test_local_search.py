"""Local searches over shares against SciPy's, and what they do where a value is none."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from armdesign.arrays import Array
from armdesign.local_search import local_minimum, with_slopes

START = np.array([0.9, 0.8, 0.1])


def value(x: Array) -> tuple[float, Array]:
    """Rosenbrock's valley, in three dimensions, turned so that its floor leaves the box."""
    a, b = 1.4 - x[:2], 10 * (x[1:] - x[:2] ** 2)
    slopes = np.zeros(3)
    slopes[:2] -= 2 * a + 40 * b * x[:2]
    slopes[1:] += 20 * b
    return float(a @ a + b @ b), slopes


def on_plane(x: Array) -> tuple[Array, Array]:
    return np.array([x.sum() - 1.6]), np.ones((1, 3))


def in_ball(x: Array) -> Array:
    return 1.0 - (x**2).sum(axis=1, keepdims=True)


@pytest.mark.parametrize("limits", ["box", "plane", "ball", "both"])
def test_minima_are_those_of_scipy(limits: str) -> None:
    plane, ball = limits in ("plane", "both"), limits in ("ball", "both")
    ours = local_minimum(
        value, START, 1e-13, [with_slopes(in_ball)] * ball, [on_plane] * plane, most=500
    )
    conditions = [{"type": "eq", "fun": lambda x: on_plane(x)[0]}] * plane
    conditions += [{"type": "ineq", "fun": lambda x: in_ball(x[None])[0]}] * ball
    theirs = minimize(
        value, START, jac=True, bounds=[(0, 1)] * 3, constraints=conditions, tol=1e-13
    )
    assert theirs.success
    assert value(ours)[0] == pytest.approx(theirs.fun, rel=1e-6)
    assert ours == pytest.approx(theirs.x, abs=1e-4)


def test_a_search_among_values_that_are_none_ends() -> None:
    count = 0

    def none(x: Array) -> tuple[float, Array]:
        nonlocal count
        count += 1
        return float("nan"), np.full(3, np.nan)

    assert (local_minimum(none, START, 1e-10, most=30) == START).all()
    assert count <= 30


def test_an_error_in_the_value_is_not_kept() -> None:
    def interrupted(x: Array) -> tuple[float, Array]:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        local_minimum(interrupted, START, 1e-10)
