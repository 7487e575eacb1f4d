"""The compiled search for poles: what it leaves, and where it ends, by numpy and scipy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

from armdesign.arrays import Array
from armdesign.simulation.identification.pole_search import Problem, best_poles, left_over
from armdesign.simulation.identification.residual_terms import real

K, ROUNDS = 30, 50
TRUE = np.array([[0.9, 0.04], [1.2, 0.1]])


def problem(noise: float, each: int, most: float = 1.5) -> Problem:
    """Two modes under noise, with a whitening matrix of its own."""
    random = np.random.default_rng(1)
    omega = np.linspace(0.6, 1.6, K)
    inputs = random.normal(size=(K, each)) + 1j * random.normal(size=(K, each))
    numerators = random.normal(size=(2, each))
    spectrum = sum(
        (fraction(omega, *pole)[:, None] * inputs) @ own
        for pole, own in zip(TRUE, numerators, strict=True)
    )
    spread = random.normal(size=(2 * K, 5))
    white = np.eye(2 * K) - 0.1 * spread @ spread.T / K
    values = real(np.asarray(spectrum)) + noise * random.normal(size=2 * K)
    bounds = np.array([[0.5, -0.3]] * 2), np.array([[1.7, most]] * 2)
    return Problem(omega, real(inputs), white, white @ values, *bounds)


def fraction(omega: Array, natural: float, damping: float) -> Array:
    return np.asarray(1 / (natural**2 - omega**2 + 2j * damping * natural * omega))


def remainder(given: Problem, poles: Array) -> Array:
    """What the best numerators leave, by numpy."""
    inputs = given.inputs[:K] + 1j * given.inputs[K:]
    columns = np.hstack([fraction(given.omega, *pole)[:, None] * inputs for pole in poles])
    rows = given.white @ real(columns)
    return np.asarray(given.observed - rows @ np.linalg.lstsq(rows, given.observed, rcond=None)[0])


@pytest.mark.parametrize("each", [2, 4])
def test_what_poles_leave(each: int) -> None:
    """As numpy's least squares have it."""
    given = problem(0.1, each)
    for poles in (TRUE, TRUE + np.array([[0.1, 0.2], [-0.05, 0.05]])):
        assert left_over(given, poles) == pytest.approx(
            float(np.sum(remainder(given, poles) ** 2)), rel=1e-10
        )


@pytest.mark.parametrize("each", [2, 4])
def test_true_poles_without_noise(each: int) -> None:
    found = best_poles(problem(0.0, each), TRUE + np.array([[0.05, 0.05], [-0.05, 0.03]]), ROUNDS)
    np.testing.assert_allclose(found, TRUE, atol=1e-4)


@pytest.mark.parametrize(("most", "more"), [(1.5, 1e-6), (0.06, 0.01)])
def test_least_of_all_poles_within_bounds(most: float, more: float) -> None:
    """Scipy's trust region finds nothing better, and 1 % at a bound, where the search ends early.

    Its steps are cut off at a bound, with what the other poles make up for still in them.
    """
    given = problem(0.1, 2, most)
    found = best_poles(given, TRUE, ROUNDS)
    assert np.all((found >= given.least) & (found <= given.most))
    best = least_squares(
        lambda x: remainder(given, x.reshape(2, 2)),
        np.clip(TRUE, given.least + 1e-3, given.most - 1e-3).ravel(),
        bounds=(given.least.ravel(), given.most.ravel()),
        xtol=1e-12,
        ftol=1e-12,
    )
    assert left_over(given, found) <= 2 * best.cost * (1 + more)


def test_start_outside_of_the_bounds_and_no_rounds() -> None:
    given = problem(0.1, 2)
    found = best_poles(given, np.array([[0.1, 0.04], [9.0, 3.0]]), 0)
    np.testing.assert_array_equal(found, [[0.5, 0.04], [1.7, 1.5]])
