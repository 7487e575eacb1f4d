"""Slopes of rooms and bandwidths by all gains, against differences; starts on ways that hold."""

from __future__ import annotations

import numpy as np
import pytest

from armdesign.arrays import Array
from armdesign.control.lanes import LANES
from armdesign.control.loop_slopes import SlopeRoom, crossing_slopes, write_room_slope
from armdesign.control.loops import Loops, crossing
from armdesign.control.map_parts import ControlOptions
from armdesign.control.margins import Room, write_room
from armdesign.control.own_gains import PATH, OwnGains
from armdesign.control.stability import stable
from armdesign.control.tuning import Task, damped
from tests.control.machines import many_plants

STEP = 1e-6  # of logarithms of gains, and of elements of matrices


def searched() -> tuple[Task, OwnGains, Array]:
    """The task of 50 poses, its search, and logarithms of their common gains."""
    plant = many_plants()
    task = Task(plant, Loops.of(plant), ControlOptions().aim)
    gains = np.concatenate(task.without_units(damped(task).controller), axis=1)
    return task, OwnGains(task, (PATH[0], PATH[-1])), np.log(gains)


@pytest.mark.parametrize("size", [1, 2, 3, 4])
def test_slope_of_the_room_below_a_limit(size: int) -> None:
    """By central differences along random directions, of matrices near to balanced ones.

    Where D is far from 1 a balancing of four sweeps is not quite done, and neither is its slope.
    """
    random, shape = np.random.default_rng(size), (size, size, LANES)
    X, E = (random.normal(size=shape) + 1j * random.normal(size=shape) for _ in range(2))
    X /= np.linalg.norm(X, 2, axis=(0, 1))
    square = np.ones((1, 1, size, size))
    slopes = SlopeRoom.of(Loops(np.ones((1, 1)), square, square, square[0]))
    room, slope = Room.of(size), np.empty(shape, complex)
    write_room(X, 1.3, room)
    write_room_slope(room, slopes, slope)
    logs = []
    for sign in (1, -1):
        write_room(X + sign * STEP * E, 1.3, room)
        logs.append(np.log(room.left))
    expected = (logs[0] - logs[1]) / (2 * STEP)
    found = (slope * E).sum(axis=(0, 1)).real
    np.testing.assert_allclose(found, expected, rtol=1e-3, atol=1e-2)


def test_slopes_of_all_that_is_seen_by_all_gains() -> None:
    """By central differences, with the rooms of all frequencies."""
    _, search, x = searched()
    search._sight = search._sight._replace(near=1e9)
    x += 0.1 * np.random.default_rng(0).standard_normal(x.shape) - 0.2
    rows = np.flatnonzero(search._look(np.arange(len(x)), x).holds)
    assert len(rows) > 30
    seen = search._look(rows, x[rows])
    for k, step in enumerate(STEP * np.eye(x.shape[1])):
        high, low = (search._look(rows, x[rows] + sign * step) for sign in (1, -1))
        rooms, logs = (high.rooms - low.rooms) / (2 * STEP), (high.logs - low.logs) / (2 * STEP)
        np.testing.assert_allclose(seen.slopes[:, k], rooms, rtol=1e-5, atol=1e-4)
        np.testing.assert_allclose(seen.by_logs[:, :, k], logs, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("f", [0, 1])
def test_slopes_of_the_frequency_at_3_db(f: int) -> None:
    omega, sizes = np.array([2.0, 3.0]), np.array([0.9, 0.6])
    for which, slope in enumerate(crossing_slopes(omega, f, *sizes)):
        step = np.where(np.arange(2) == which, STEP, 0.0)
        high, low = (crossing(omega, f, *(sizes * np.exp(sign * step))) for sign in (1, -1))
        assert slope == pytest.approx(np.log(high / low) / (2 * STEP), abs=1e-8)


def test_starts_leave_loops_stable() -> None:
    """From gains far away, of which many are beyond a band of instability and keep a margin."""
    task, search, x = searched()
    rows, nq = np.arange(len(x)), task.plant.joints
    far = x + 1.5 * np.random.default_rng(0).standard_normal(x.shape)

    def stays(y: Array) -> Array:
        return stable(task.plant, task.controller(np.exp(y[:, :nq]), np.exp(y[:, nq:])))

    begun, scores = search._walk(rows, search._inside(x), far)
    assert np.isfinite(scores).all()
    assert stays(begun).all()
    assert (search._look(rows, far).holds & ~stays(far)).any()
