"""Shapes of cylinders hold what they say, against samples."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings

from armdesign.design.bound.shape_of_pins import coordinates
from armdesign.mechanism.joint_ranges import sweep
from tests.design.bound.shapes import (
    CYLINDERS,
    ROUNDING,
    box_around,
    box_shares,
    cylinder,
    designs,
    some_design,
)


@pytest.mark.slow
@pytest.mark.parametrize("name", CYLINDERS)
@settings(max_examples=80)
@given(seed=designs, width=box_shares, place=box_shares)
def test_shapes_hold_lengths_arms_and_bends(
    name: str, seed: int, width: list[float], place: list[float]
) -> None:
    """ℓ, r and H by ``Linkage.actuation`` at random pins lie within the enclosures of boxes around
    them.
    """
    problem, i, angles, shape = cylinder(name)
    x = some_design(problem, seed)
    joint = problem.machine.linkages[i].joints[0]
    exact = problem.vector.linkages(x)[i].actuation(sweep(problem.machine.arm, joint, angles))
    length, arm = exact.length, exact.moment_arm[:, joint]
    if (arm * shape.sign).min() < 1e-3:
        return  # not a cylinder that works
    at = coordinates(problem, i, shape, x)
    assert np.all(at >= shape.region[0] - ROUNDING)
    assert np.all(at <= shape.region[1] + ROUNDING)
    low, high = box_around(at, shape, np.array(width) * 0.2, np.array(place))
    e, scale = shape.enclose(low[:, :2], high[:, :2]), at[2]
    closed, stroke = (float(lengths[i]) for lengths in problem.vector.strokes(x))
    for part, value in (
        (e.wide.arm[2:, 0], np.abs(arm) / scale),
        (e.wide.closed, np.array([closed / scale])),
        (e.wide.open, np.array([(closed + stroke) / scale])),
        (e.stroke, np.array([stroke / scale])),
        (e.place[2:, 0], (length - closed) / stroke),
        (e.rate[2:, 0], np.abs(arm) / stroke),
        (e.bend[2:, 0], exact.moment_arm_derivative[:, joint, joint] / arm),
    ):
        slack = ROUNDING * np.maximum(1.0, np.abs(value))
        assert np.all(part.low <= value + slack)
        assert np.all(part.high >= value - slack)
