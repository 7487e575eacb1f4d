"""The certificate of the bound of areas, in fractions: what floats would lose is in it."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest

from armdesign.design.search.semidefinite import (
    ProgrammeStep,
    bound_of_moving_mass,
    certificate,
    dual_bound,
    exact_certificate,
)

NONE = np.zeros(1)


def step_of(weights: np.ndarray, multipliers: np.ndarray = NONE) -> ProgrammeStep:
    return ProgrammeStep(
        change=NONE, value=math.nan, violation=0.0, multipliers=multipliers,
        low_multipliers=NONE, high_multipliers=NONE, weights=weights,
    )  # fmt: skip


def test_weights_meet_their_conditions_to_the_last_bit() -> None:
    """Of rank one, as a solver leaves them: floats miss Z ⪰ 0 or tr Z = 1 by their rounding."""
    random, missed = np.random.default_rng(2), 0
    for _ in range(20):
        root = random.normal(size=(5, 2, 1))
        step = step_of(root @ np.swapaxes(root, 1, 2) - 1e-12 * np.eye(2))
        exact = exact_certificate(step)
        assert exact[:, 0, 0].sum() + exact[:, 1, 1].sum() == 1
        for z in exact:
            assert z[0, 1] == z[1, 0]
            assert z[0, 0] >= 0
            assert z[0, 0] * z[1, 1] >= z[0, 1] ** 2
        floats = np.frompyfunc(Fraction, 1, 1)(certificate(step))
        missed += any(z[0, 0] * z[1, 1] < z[0, 1] * z[1, 0] for z in floats)
    assert missed > 10


def test_nothing_cancels() -> None:
    """By hand: 1e16 + 1 − 1e16 is 1, of which floats keep nothing."""
    value = np.array([1e16, 1.0, -1e16])
    step = step_of(np.ones((1, 1, 1)), np.ones(3))
    base, slopes = np.full((1, 1, 1), 0.5), np.full((1, 1, 1, 1), 1.0)
    bound = dual_bound(step, base, slopes, value, np.zeros((3, 1)), NONE, np.array([0.25]))
    assert Fraction(bound) > Fraction(7, 4)
    assert bound == pytest.approx(1.75, rel=1e-15)


def test_masses_are_rounded_up() -> None:
    """By hand: 1 + (2 − 1)/3."""
    step = step_of(np.ones((1, 1, 1)))
    bound = bound_of_moving_mass(2.0, 1.0, exact_certificate(step), np.full((1, 1, 1), 3.0))
    assert Fraction(bound) > Fraction(4, 3)
    assert bound == pytest.approx(4 / 3, rel=1e-15)
