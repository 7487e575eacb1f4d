"""Linkages whose moment arms differ in shape: starts from which a search finds other optima.

Optima of four-bars are separate where the way from one to the other leads through a small moment
arm: an arm that falls over the joint's range does not turn into one with a hump. So it is shapes,
r(q) over its mean, that starts have to cover, not the box of pins and bars, in most of which the
arm has a dead centre or nearly so.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from armdesign.arrays import Array
from armdesign.design.program.problem import Problem

LINKAGES = 2048  # linkages drawn in their box
AT_A_TIME = 256  # of them, which stay in a cache
LEAST = 0.5  # of today's smallest arm, of linkages that count
PLACES = 10  # steps between poses of the joint's range where shapes are compared
ALIKE = 0.02  # root mean square of r/mean by which shapes differ that lead to one optimum


def linkages_of_every_shape(
    problem: Problem, i: int, count: int, random: np.random.Generator
) -> list[Array]:
    """Designs x, today's but for the linkage of cylinder ``i``, of at most ``count`` shapes.

    Shapes of drawn linkages are compared by ln(r/mean); each is the one farthest from all before
    it, the first of them from today's. Fewer, or none, where not so many linkages close and keep
    half of today's smallest arm.
    """
    entries = np.array(list(problem.vector.moves(i)))
    low, high = (end[entries] for end in problem.bounds)
    drawn = np.tile(problem.vector.start, (LINKAGES, 1))
    drawn[:, entries] = random.uniform(low, high, (LINKAGES, len(entries)))
    parts = np.array_split(drawn, LINKAGES // AT_A_TIME)
    arms = np.concatenate([_moment_arms(problem, i, part) for part in parts])
    today = problem.vector.arms_today[i]
    least = LEAST * np.abs(today).min()
    enough = np.all(arms / np.sign(today) >= least, axis=1)  # NaN: does not close
    designs = np.vstack([problem.vector.start, drawn[enough]])
    arms = np.vstack([today, arms[enough]])
    shape = _shapes(arms)
    chosen, distance = [0], np.full(len(shape), np.inf)
    while len(chosen) <= min(count, len(shape) - 1):
        distance = np.minimum(distance, np.linalg.norm(shape - shape[chosen[-1]], axis=1))
        chosen.append(int(distance.argmax()))
    return [designs[k] for k in chosen[1:]]


def of_other_shapes(problem: Problem, designs: Sequence[Array]) -> list[int]:
    """Which designs x have a moment arm of another shape than all of those before them.

    All, where every cylinder that moves lies across several joints.
    """
    vector, rows = problem.vector, np.array(designs)
    compared = [i for i in vector.moving if vector.range_poses[i] is not None]
    if not compared:
        return list(range(len(rows)))
    shapes = np.stack([_shapes(_moment_arms(problem, i, rows)) for i in compared], axis=1)
    chosen: list[int] = []
    for k, shape in enumerate(shapes):
        apart = np.sqrt(np.mean((shapes[chosen] - shape) ** 2, axis=2)).max(axis=1)
        if np.all(apart > ALIKE):
            chosen.append(k)
    return chosen


def _shapes(arms: Array) -> Array:
    """ln(r/mean) at some poses of the ranges (m, n) of moment arms at all of them (m, k)."""
    logarithm = np.log(np.abs(arms[:, :: max(1, arms.shape[1] // PLACES)]))
    return np.asarray(logarithm - logarithm.mean(axis=1, keepdims=True))


@np.errstate(invalid="ignore", divide="ignore")
def _moment_arms(problem: Problem, i: int, designs: Array) -> Array:
    """Moment arms (m, k) over the joint's range [m/rad] of designs (m, nx).

    NaN where the linkage does not close.
    """
    vector, linkage = problem.vector, problem.machine.linkages[i]
    poses = vector.range_poses[i]
    assert poses is not None
    rows, moves = np.repeat(designs, len(poses), axis=0), vector.moves(i)
    places: dict[str, list[Any]] = {
        name: [*(linkage.place(name) or ())] for name, _ in moves.values()
    }
    for entry, (name, axis) in moves.items():
        places[name][axis] = places[name][axis] + rows[:, entry] * vector.pin_box
    span = linkage.with_places(places).span(poses[np.tile(np.arange(len(poses)), len(designs))])
    return span.dot(span).sqrt().first[:, 0].reshape(len(designs), -1)
