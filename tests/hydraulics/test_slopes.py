"""Derivatives of the laws of valve and oil, by complex steps of the laws themselves."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from armdesign.arrays import Array
from armdesign.hydraulics.fluid import bulk_modulus, bulk_modulus_slope
from armdesign.hydraulics.valve import (
    edge_opening,
    edge_opening_slope,
    in_series,
    in_series_slopes,
    orifice_flow,
    orifice_slope,
)

STEP = 1e-30


def stepped(law: Callable[[Array], Array], x: Array) -> Array:
    return np.asarray(np.imag(law(x + 1j * STEP)) / STEP)


@pytest.mark.parametrize("air", [0.0, 0.002, 0.05])
def test_bulk_modulus(air: float) -> None:
    pressure = np.array([-0.98e5, -0.5e5, 0.0, 5e5, 50e5, 350e5])
    expected = stepped(lambda p: bulk_modulus(p, 1.2e9, air) + 0 * p, pressure)
    slope = bulk_modulus_slope(pressure, 1.2e9, air)
    np.testing.assert_allclose(slope, expected, rtol=1e-12)
    assert bulk_modulus_slope(-2e5, 1.2e9, air) == 0.0


def test_orifice() -> None:
    drop = np.array([-300e5, -1e5, -1e3, 0.0, 10.0, 0.5e5, 200e5])
    expected = stepped(lambda p: orifice_flow(1.0, p), drop)
    np.testing.assert_allclose(orifice_slope(drop), expected, rtol=1e-12)


def test_orifices_in_series() -> None:
    one, other = np.meshgrid([0.0, 1e-7, 3e-6], [1e-9, 2e-7, 5e-6])
    by_one, by_other = in_series_slopes(one, other)
    expected = stepped(lambda g: in_series(g, other), one)  # of two terms that nearly cancel
    np.testing.assert_allclose(by_one, expected, rtol=1e-12, atol=1e-15)
    expected = stepped(lambda g: in_series(one, g), other)
    np.testing.assert_allclose(by_other, expected, rtol=1e-12, atol=1e-15)
    assert in_series_slopes(1e-7, 0.0)[1] == 0.0


@pytest.mark.parametrize("overlap", [-0.1, 0.0, 0.2])
def test_edge(overlap: float) -> None:
    """Outside the corners exact, at a corner the mean of both sides."""
    spool = np.array([-0.7, -0.05, 0.1, 0.5, 0.99])
    expected = stepped(lambda x: edge_opening(x, overlap), spool)
    np.testing.assert_allclose(edge_opening_slope(spool, overlap), expected, rtol=1e-12)
    for corner in (overlap, 1.0):
        assert edge_opening_slope(corner, overlap) == pytest.approx(0.5 / (1 - overlap))
