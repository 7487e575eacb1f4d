"""Pins on whole millimetres: the mixed-integer programme against enumeration."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from armdesign.design.catalogue.sizes import BUILDABLE
from armdesign.design.search.pin_grid import with_pins_on_grid
from armdesign.design.search.sequential_sdp import Search
from tests.design.designs import problem_of

MOVING = ("cylinder.lift.base.at_mm", "cylinder.fold.base.at_mm", "cylinder.fold.rod_end.at_mm")


@pytest.mark.slow
def test_no_neighbour_on_the_grid_is_better() -> None:
    """All points of the grid around the optimum, two values of each coordinate."""
    problem = replace(problem_of("double", MOVING, pin_box=0.4), grid=BUILDABLE)
    search = Search(problem=problem, x=problem.vector.start).run(trust=0.1, tolerance=1e-7)
    on_grid = with_pins_on_grid(search)
    at = _coordinates(search)
    around = [sorted({np.floor(value), np.ceil(value)}) for value in at]
    assert sum(len(values) > 1 for values in around) >= 4
    unit = problem.vector.pin_box * 1e3
    moving = np.flatnonzero(problem.vector.is_coordinate)
    merits = []
    for whole in itertools.product(*around):
        x = search.x.copy()
        x[moving] += (np.array(whole) - at) / unit
        if np.all((x >= problem.bounds[0]) & (x <= problem.bounds[1])):
            merits.append(search.trial(x).merit)
    assert len(merits) >= 8
    chosen = _coordinates(on_grid)
    moved = np.abs(on_grid.x[moving]) > 0
    assert np.abs(chosen - np.rint(chosen))[moved].max() < 1e-6
    assert on_grid.merit >= max(merits) * (1 - 1e-6)
    assert on_grid.merit == pytest.approx(on_grid.look().merit, rel=1e-6)


def _coordinates(search: Search) -> np.ndarray:
    """Coordinates of the pins that may move [mm]."""
    vector = search.problem.vector
    today = [
        (vector.machine.linkages[v.cylinder].place(v.pin) or ())[v.axis]
        for v in vector.variables
        if v.pin is not None
    ]
    moved = search.x[vector.is_coordinate] * vector.pin_box
    return (np.array(today) + moved) * 1e3
