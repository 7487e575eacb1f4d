"""Ends of joint ranges against another method's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

from armdesign.mechanism.joint_ranges import sweep, working_lengths
from tests import machines

MARGIN = 0.1  # of the strokes, so that they end the ranges, not the limits


@pytest.mark.parametrize(
    "name", ["excavator_20t", "mini_excavator_2t", "loader_crane", "heavy_bars"]
)
def test_ends_that_strokes_make_are_brents(name: str) -> None:
    """Where a stroke ends a range; and there no stroke is exceeded, not by the last digit."""
    machine, found = machines.named(name), 0
    for linkage, cylinder in zip(machine.linkages, machine.cylinders, strict=True):
        if len(linkage.joints) > 1:
            continue
        joint = linkage.joints[0]

        def length(x: float, linkage: object = linkage, joint: int = joint) -> float:
            return float(linkage.length(sweep(machine.arm, joint, np.array([x])))[0])

        shortest, longest = working_lengths(cylinder, MARGIN)
        for end in machine.range_within(MARGIN)[joint]:
            assert shortest <= length(end) <= longest
            for stop in (shortest, longest):
                if abs(length(end) - stop) < 1e-9:
                    beside = end + 1e-4 * np.array([-1, 1])
                    theirs = brentq(lambda x, stop=stop: length(x) - stop, *beside, xtol=1e-14)
                    assert end == pytest.approx(theirs, abs=2e-14)
                    found += 1
    assert found >= 1
