"""Linkages of every shape of moment arm."""

from __future__ import annotations

import numpy as np
import pytest

from armdesign import Workspace
from armdesign.design.program.problem import Problem
from armdesign.design.search.arm_shapes import (
    _moment_arms,
    linkages_of_every_shape,
    of_other_shapes,
)
from armdesign.design.search.multistart import formulate
from tests.machines import named

BUCKET = 2


def mini_with_linkages() -> Problem:
    machine = named("mini_excavator_2t")
    return formulate(machine, Workspace.grid(machine, 3), None, ("linkages",))


def bucket_arm(problem: Problem, x: np.ndarray) -> np.ndarray:
    """Moment arm of the bucket cylinder over its joint's range."""
    linkage = problem.vector.linkages(x)[BUCKET]
    poses = problem.vector.range_poses[BUCKET]
    assert poses is not None
    return linkage.actuation(poses).moment_arm[:, linkage.joints[0]]


def shapes_of(arms: list[np.ndarray]) -> np.ndarray:
    shapes = np.log(np.abs(np.array(arms)))
    return shapes - shapes.mean(axis=1, keepdims=True)


@pytest.mark.slow
def test_every_shape_of_random_linkages_has_one_like_it() -> None:
    """24 chosen linkages are nearer to the shapes of all others than 24 random ones are.

    Random ones are drawn by themselves; all close and keep half of today's smallest arm.
    """
    problem = mini_with_linkages()
    vector, (low, high) = problem.vector, problem.bounds
    entries, today = list(vector.moves(BUCKET)), vector.arms_today[BUCKET]
    least, sign = 0.5 * np.abs(today).min(), np.sign(today[0])
    chosen = linkages_of_every_shape(problem, BUCKET, 24, np.random.default_rng(0))
    for x in chosen:
        assert vector.closes(x)
        np.testing.assert_array_equal(np.delete(x, entries), np.delete(vector.start, entries))
        assert (bucket_arm(problem, x) * sign).min() >= least
    rng, others = np.random.default_rng(5), []
    for _ in range(1500):
        x = vector.start.copy()
        x[entries] = rng.uniform(low[entries], high[entries])
        if vector.closes(x) and (bucket_arm(problem, x) * sign).min() >= least:
            others.append(bucket_arm(problem, x))
    assert len(others) > 50
    drawn = shapes_of(others)

    def farthest(from_shapes: np.ndarray) -> float:
        apart = np.linalg.norm(drawn[24:, None] - from_shapes[None], axis=2)
        return float(apart.min(axis=1).max())

    chosen_shapes = shapes_of([bucket_arm(problem, x) for x in chosen])
    assert farthest(chosen_shapes) < farthest(drawn[:24])


@pytest.mark.slow
def test_the_same_shapes_whenever_asked() -> None:
    once, again = (
        linkages_of_every_shape(mini_with_linkages(), BUCKET, 5, np.random.default_rng(0))
        for _ in range(2)
    )
    np.testing.assert_array_equal(once, again)


def test_of_designs_whose_arms_have_one_shape_the_first_remains() -> None:
    """Shapes differ by root mean squares above 2 % of any cylinder's arm over its mean."""
    problem = mini_with_linkages()
    start, boom = problem.vector.start, list(problem.vector.moves(0))
    others = linkages_of_every_shape(problem, BUCKET, 3, np.random.default_rng(0))
    assert of_other_shapes(problem, [start, start, *others, others[1]]) == [0, 2, 3, 4]
    linkage, poses = problem.vector.linkages(start)[0], problem.vector.range_poses[0]
    assert poses is not None
    known = linkage.actuation(poses).moment_arm[:, 0]
    for way, remain in ((0.01, [0]), (0.3, [0, 1])):
        moved = start.copy()
        moved[boom] += way
        arm = problem.vector.linkages(moved)[0].actuation(poses).moment_arm[:, 0]
        apart = np.ptp(shapes_of([known, arm]), axis=0)
        assert (float(np.sqrt(np.mean(apart**2))) > 0.02) == (len(remain) > 1)
        assert of_other_shapes(problem, [start, moved]) == remain


def test_arms_of_many_linkages_are_those_of_each() -> None:
    """All at once as one after the other; those that do not close are not numbers in both."""
    problem = mini_with_linkages()
    entries = list(problem.vector.moves(BUCKET))
    designs = np.tile(problem.vector.start, (30, 1))
    designs[:, entries] += np.random.default_rng(3).uniform(-1, 1, (30, len(entries)))
    arms = _moment_arms(problem, BUCKET, designs)
    with np.errstate(invalid="ignore", divide="ignore"):
        each = [bucket_arm(problem, x) for x in designs]
    assert np.isnan(arms).any()
    assert np.isfinite(arms).any()
    np.testing.assert_allclose(arms, each, rtol=1e-12, atol=1e-15)  # of 0.2 m, as rounded
