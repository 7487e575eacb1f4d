"""Small matrices at several frequencies at once, against numpy."""

from __future__ import annotations

import numpy as np
import pytest

from armdesign.control import lanes
from armdesign.control.lanes import LANES
from armdesign.simulation.plant.compiled import borrowing

invert = borrowing(lanes.invert)


@pytest.mark.parametrize("size", [1, 2, 3, 4, 5])
def test_inverses_are_numpys(size: int) -> None:
    """Also where some of the matrices begin with zeros, so that their rows have to change."""
    random, shape = np.random.default_rng(size), (LANES, size, size)
    some = random.normal(size=shape) + 1j * random.normal(size=shape)
    if size > 1:
        some[::3, 0, 0] = some[::2, 1, 1] = 0.0
    matrix = np.ascontiguousarray(some.transpose(1, 2, 0))
    inverse = np.empty_like(matrix)
    invert(matrix, inverse, np.empty(LANES, complex))
    np.testing.assert_allclose(inverse.transpose(2, 0, 1), np.linalg.inv(some), atol=1e-10)
