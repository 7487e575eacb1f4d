"""Products of many small matrices, which BLAS multiplies one after the other."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

import armdesign as ad
from armdesign.arrays import congruent, product


@pytest.mark.parametrize("imaginary", [0.0, 1.0])
@pytest.mark.parametrize("shapes", [((7, 2, 3), (7, 3, 4)), ((7, 1, 3), (5, 7, 3, 1))])
def test_products_are_those_of_blas(
    shapes: tuple[tuple[int, ...], tuple[int, ...]], imaginary: float
) -> None:
    draw = np.random.default_rng(3).normal
    a, b = (draw(size=shape) + imaginary * 1j * draw(size=shape) for shape in shapes)
    np.testing.assert_allclose(product(a, b), a @ b, rtol=1e-13, atol=1e-14)


def test_a_congruence_turns_both_sides() -> None:
    draw = np.random.default_rng(4).normal
    turn, matrix = draw(size=(6, 2, 3)), draw(size=(6, 3, 3))
    expected = turn @ matrix @ np.swapaxes(turn, 1, 2)
    np.testing.assert_allclose(congruent(turn, matrix), expected, rtol=1e-13, atol=1e-14)


def test_copies_are_read_only_too() -> None:
    """What another process sends, and what is copied; caches, too."""
    machine = ad.load("paper_1dof")
    poses = machine.rigid_poses(np.array([[0.0], [0.1]]))
    assert poses.repeated(2)
    for other in (pickle.loads(pickle.dumps(poses)), copy.deepcopy(poses), copy.copy(poses)):
        np.testing.assert_array_equal(other.mass_matrix, poses.mass_matrix)
        with pytest.raises(ValueError, match="read-only"):
            other.mass_matrix[0] = 1.0
        with pytest.raises(ValueError, match="read-only"):
            other.repeated(2).q[0] = 1.0
