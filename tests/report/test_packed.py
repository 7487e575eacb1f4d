"""Numbers of pages: as close as 16 bits allow, or with the digits that are printed elsewhere."""

from __future__ import annotations

import base64

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armdesign.arrays import Array
from armdesign.report.packed import Packed, packed, rounded


def read(table: Packed) -> Array:
    """As the page's script reads it."""
    numbers = np.frombuffer(base64.b64decode(table.base64), f"<i{table.bits // 8}")
    return np.asarray(numbers.reshape(-1, len(table.scale)) * np.array(table.scale))


numbers = st.floats(min_value=-2e5, max_value=2e5)


@given(st.lists(numbers, min_size=1, max_size=9), st.integers(0, 4))
def test_what_is_rounded_prints_as_everywhere(values: list[float], decimals: int) -> None:
    shown = read(rounded(np.array(values)[:, None], [decimals]))[:, 0]
    as_printed = [f"{round(value, decimals) + 0.0:.{decimals}f}" for value in values]
    assert [f"{value:.{decimals}f}" for value in shown] == as_printed


@pytest.mark.parametrize("value", [0.35, 1.15, 2.675, 1.005, -0.04])
def test_ties_round_as_they_are_printed(value: float) -> None:
    """0.35 is stored a little below, times 10 it is 3.5: numpy's rounding makes it 0.4."""
    shown = read(rounded(np.array([[value]]), [1]))[0, 0]
    assert f"{shown:.1f}" == f"{round(value, 1) + 0.0:.1f}"


def test_numbers_of_16_bits_are_near() -> None:
    values = np.random.default_rng(0).normal(size=(50, 3)) * [1e-3, 1.0, 1e4]
    away = np.abs(read(packed(values)) - values).max(axis=0)
    assert np.all(away <= np.abs(values).max(axis=0) / 65533)


def test_what_is_not_finite_is_nothing_and_what_is_too_large_is_coarse() -> None:
    assert read(rounded(np.array([[np.inf], [np.nan], [1.0]]), [3])).tolist() == [[0], [0], [1]]
    large = read(rounded(np.array([[1e12], [-1e12]]), [3]))
    assert large == pytest.approx(np.array([[1e12], [-1e12]]))
