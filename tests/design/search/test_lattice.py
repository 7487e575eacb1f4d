"""Pins on whole millimetres, strokes on 5 mm: the mixed-integer programme against enumeration."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from armdesign.design.catalogue.sizes import BUILDABLE
from armdesign.design.program.design_vector import ChosenLengths
from armdesign.design.search.lattice import (
    PENALTY,
    PROMISED,
    STRICT,
    WORTH,
    Point,
    Promise,
    on_lattice,
)
from armdesign.design.search.sequential_sdp import Search
from tests.design.designs import problem_of

MOVING = ("cylinder.lift.base.at_mm", "cylinder.fold.base.at_mm", "cylinder.fold.rod_end.at_mm")


@pytest.mark.slow
def test_no_neighbour_on_the_grid_is_better() -> None:
    """All points of the grid around the optimum: two values of each coordinate and stroke.

    With the shortest closed lengths that these strokes open far enough, and some longer ones.
    """
    problem = replace(problem_of("double", MOVING, pin_box=0.4), grid=BUILDABLE)
    search = Search(problem=problem, x=problem.vector.start).run(trust=0.1, tolerance=1e-7)
    drawn = on_lattice(search)
    strict = replace(search, strictness=STRICT)
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
            for lengths in _lengths(search, x):
                merits.append(strict.of(problem.with_lengths(lengths), x).trial(x).merit)
    assert len(merits) >= 64
    chosen = _coordinates(drawn)
    moved = np.abs(drawn.x[moving]) > 0
    assert np.abs(chosen - np.rint(chosen))[moved].max() < 1e-6
    for closed, stroke in filter(None, drawn.problem.vector.chosen_lengths):
        assert closed * 1e3 == pytest.approx(round(closed * 1e3), abs=1e-9)
        assert stroke * 200 == pytest.approx(round(stroke * 200), abs=1e-9)
    merit = strict.of(drawn.problem, drawn.x).trial(drawn.x).merit
    assert merit >= max(merits) * (1 - 1e-6)


def test_where_any_design_will_do_it_lies_on_the_grid_and_meets_all() -> None:
    """Limits drawn in leave the room that whole steps need."""
    problem = replace(problem_of("double", MOVING, pin_box=0.4), grid=BUILDABLE).tightened(2e-3)
    search = Search(problem=problem, x=problem.vector.start).run(trust=0.1, tolerance=1e-3)
    drawn = on_lattice(search, any_will_do=True)
    assert drawn.limits.values.min() >= 0
    moved = np.abs(drawn.x[np.flatnonzero(problem.vector.is_coordinate)]) > 0
    assert moved.any()
    assert np.abs(_coordinates(drawn) - np.rint(_coordinates(drawn)))[moved].max() < 1e-6
    for closed, stroke in filter(None, drawn.problem.vector.chosen_lengths):
        assert closed * 1e3 == pytest.approx(round(closed * 1e3), abs=1e-9)
        assert stroke * 200 == pytest.approx(round(stroke * 200), abs=1e-9)


@pytest.mark.parametrize(
    ("won", "kept", "worth"),
    [
        (1.1 * WORTH, 0.0, True),
        (0.9 * WORTH, 0.0, False),
        (0.9 * WORTH, 1.1 * PROMISED, True),
        (0.9 * WORTH, 0.9 * PROMISED, False),
        (0.9 * PROMISED, 1.1 * PROMISED, False),
    ],
)
def test_a_round_is_worth_frequency_or_a_limit(won: float, kept: float, worth: bool) -> None:
    """``won`` of merit, ``kept`` of it by missing less; the merit of the best trial is known."""
    problem = replace(problem_of("double", MOVING, pin_box=0.4), grid=BUILDABLE)
    search = Search(problem=problem, x=problem.vector.start).look()
    best = Point.of(search)
    missed = np.maximum(-best.trial.limits.values, 0).sum() - kept / (PENALTY * STRICT)
    promise = Promise(np.zeros(3), best.merit + won, missed)
    assert promise.worth_a_round(best) == worth


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


def _lengths(search: Search, x: np.ndarray) -> Iterator[ChosenLengths]:
    """Strokes of 5 mm around the ones that the pins of x want, with closed lengths for each."""
    options = []
    for i, (closed, stroke) in enumerate(zip(*search.problem.vector.strokes(x), strict=True)):
        dead = search.problem.machine.cylinders[i].dead_length
        near = {math.floor(stroke * 200) / 200, math.ceil(stroke * 200) / 200}
        options.append(
            [
                (math.ceil(1e3 * max(closed + stroke - s, dead + s) - 1e-6) / 1e3 + more, s)
                for s in near
                for more in (0.0, 1e-3)
            ]
        )
    yield from itertools.product(*options)
