"""Distances to outlines: by hand, against dense sampling, derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from armdesign.design.requirements.places import clearance, depth

SQUARE = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])
BENT = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 1.0], [1.0, 1.0], [1.0, 3.0], [0.0, 3.0]])  # an L


def test_depth_by_hand() -> None:
    """In a square: the distances to its four sides; beyond it: minus that to the nearest, also
    beyond a corner.
    """
    assert_allclose(depth(np.array([0.5, 0.8]), SQUARE), [0.8, 1.5, 1.2, 0.5])
    assert_allclose(depth(np.array([2.3, 1.0]), SQUARE), [-0.3] * 4)
    assert_allclose(depth(np.array([2.3, 2.4]), SQUARE), [-0.5] * 4)
    assert depth(np.array([0.5, 0.5]), BENT).min() == 0.5
    assert depth(np.array([1.5, 1.5]), BENT).max() < 0  # in the notch of the L: outside


@pytest.mark.parametrize("reverse", [False, True])
def test_direction_of_the_outline_does_not_matter(reverse: bool) -> None:
    polygon = BENT[::-1] if reverse else BENT
    points = np.random.default_rng(0).uniform(-1, 4, (200, 2))
    assert_allclose(depth(points, polygon).min(axis=1), depth(points, BENT).min(axis=1))


def test_clearance_by_hand() -> None:
    start, end = np.array([-1.0, 3.0]), np.array([3.0, 3.0])
    assert clearance(start, end, SQUARE) == pytest.approx(1.0)  # along a side
    assert clearance(np.array([3.0, -1.0]), np.array([3.0, 5.0]), SQUARE) == pytest.approx(1.0)
    assert clearance(np.array([2.0, 3.0]), np.array([3.0, 2.0]), SQUARE) == pytest.approx(
        np.sqrt(0.5)
    )  # a corner
    # wholly inside
    assert clearance(np.array([1.0, 1.0]), np.array([1.0, 1.5]), SQUARE) == pytest.approx(-0.5)
    # an end inside
    assert clearance(np.array([1.0, 1.7]), np.array([1.0, 9.0]), SQUARE) == pytest.approx(-0.3)


def test_clearance_against_dense_sampling() -> None:
    """Of 2 000 points of the bar from the polygon's edges, where they do not meet; sign: one is
    inside.
    """
    random = np.random.default_rng(1)
    apart = 0
    for _ in range(60):
        start, end = random.uniform(-2, 5, (2, 2))
        line = start + np.linspace(0, 1, 2000)[:, None] * (end - start)
        outward = -depth(line, BENT).min(axis=1)
        distance = float(clearance(start, end, BENT))
        assert (distance < 0) == (outward.min() < 0)
        if distance > 0:
            apart += 1
            assert distance == pytest.approx(outward.min(), abs=2e-3)
    assert 10 < apart < 55


def test_complex_step_is_the_derivative() -> None:
    """Away from changes of the nearest edge."""
    for start, end in (
        ([-1.0, 0.4], [0.3, 4.1]),
        ([1.4, 1.6], [2.2, 2.5]),
        ([0.2, 0.3], [0.5, 0.6]),
    ):
        at = np.array([start, end])
        for k in np.ndindex(2, 2):
            step = np.zeros((2, 2))
            step[k] = 1e-6
            central = (clearance(*(at + step), BENT) - clearance(*(at - step), BENT)) / 2e-6
            stepped = at + 1j * 1e-24 * step
            assert clearance(*stepped, BENT).imag / 1e-30 == pytest.approx(
                float(central), abs=1e-8
            )
