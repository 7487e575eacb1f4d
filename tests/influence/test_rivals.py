"""Rivals of the worst pose: all that a coarse grid must find."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import minimum_filter

import armdesign as ad
from armdesign.frequency.modes import lowest_frequency
from armdesign.influence.rivals import rivals
from tests.design.designs import MACHINES


@pytest.mark.parametrize("air", [0.0, 2.0], ids=["plain", "air"])
def test_a_coarse_grid_finds_the_minima_of_a_fine_one(air: float) -> None:
    """Of a grid of 21 points per joint each that is lowest among its neighbours, by counting; one
    3 % above the worst was missed from 4 points, and in oil with air one 12 % above.
    """
    machine = MACHINES["odd"]().replace({"fluid.entrained_air_percent": air})
    machine = machine.with_payload("load")
    found = rivals(machine, ad.Workspace.grid(machine, points=4), within=0.16)
    fine = ad.Workspace.grid(machine, points=21)
    assert len(fine) == 21**3
    frequency = lowest_frequency(machine.at(fine.q)).reshape(21, 21, 21)
    lowest = np.flatnonzero(
        (frequency == minimum_filter(frequency, 3, mode="nearest"))
        & (frequency < 1.15 * frequency.min())
    )
    assert len(lowest) > 1
    for q, least in zip(fine.q[lowest], frequency.ravel()[lowest], strict=True):
        near = [
            one.frequency
            for one in found
            if np.all(np.abs(one.pose.q - q) <= 1.5 * np.ptp(fine.ranges, axis=1) / 20)
        ]
        assert min(near) <= least * (1 + 1e-9), q
