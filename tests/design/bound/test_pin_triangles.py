"""Triangles of joint and pins, against samples."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings

from armdesign.design.bound.intervals import Interval
from armdesign.design.bound.shape_of_pins import coordinates
from tests.design.bound.shapes import (
    ROUNDING,
    box_around,
    box_shares,
    cylinder,
    designs,
    some_design,
)


@pytest.mark.parametrize("name", ["boom", "stick", "lift"])
@settings(max_examples=80)
@given(seed=designs, width=box_shares, place=box_shares)
def test_no_triangle_of_pins_in_their_boxes_is_refused(
    name: str, seed: int, width: list[float], place: list[float]
) -> None:
    """Also those with pins at corners: the scale of the design is among those left of any box
    around it.
    """
    problem, i, _, shape = cylinder(name)
    at = coordinates(problem, i, shape, some_design(problem, seed))
    low, high = box_around(at, shape, np.array(width) * 0.3, np.array(place))
    assert shape.pin_boxes is not None
    left = shape.pin_boxes.scales(low[:, :2], high[:, :2], Interval(low[:, 2], high[:, 2]))
    assert left.low[0] <= at[2] + ROUNDING
    assert left.high[0] >= at[2] - ROUNDING


@pytest.mark.parametrize("name", ["boom", "stick", "lift"])
def test_triangles_are_refused_only_where_no_turn_fits_both_pins(name: str) -> None:
    """Points all over the region, as boxes of no width, against turning each triangle about its
    joint in fine steps.
    """
    shape = cylinder(name)[3]
    assert shape.pin_boxes is not None
    points = np.random.default_rng(3).uniform(*shape.region, (300, 3))
    left = shape.pin_boxes.scales(
        points[:, :2], points[:, :2], Interval(points[:, 2], points[:, 2])
    )
    turns = np.exp(1j * np.linspace(-np.pi, np.pi, 20_001))
    fits = left.low <= left.high
    assert 0 < fits.sum() < len(points)
    for at, fit in zip(points, fits, strict=True):
        out = np.zeros(len(turns))
        base = at[2] * complex(*at[:2]) * turns
        for pin, (low, high) in (
            (at[2] * turns, shape.pin_boxes.rod_end),
            (base, shape.pin_boxes.base),
        ):
            for part, a, b in ((pin.real, low[0], high[0]), (pin.imag, low[1], high[1])):
                out = np.maximum(out, np.maximum(a - part, part - b))
        assert out.min() < 2e-3 if fit else out.min() > 0  # [m]: a step of the turns
