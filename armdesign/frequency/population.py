"""The lowest frequency between the poses of a workspace, sought by a population of poses.

In oil with air the bulk modulus is least at rest pressure. So a cylinder is softest where its load
passes through zero, and the frequency has a kink there: a valley with a sharp floor, in which a
descent along gradients stalls. A population needs no gradient. Poses at random, some joints at
the ends of their ranges, stand beside known ones. Each round takes the lowest, kept apart from
each other, and tries others about them: joints moved at random, and steps along the line to
another pose nearby, which follows a valley (differential evolution: Storn and Price 1997). Steps
and distances shrink from round to round.

It proves nothing: a valley that no pose of the first round lies in may be missed.
"""

from __future__ import annotations

import numpy as np

from armdesign.arrays import Array
from armdesign.frequency.cases import CasePoses
from armdesign.frequency.modes import lowest_frequency
from armdesign.frequency.spread import joints_that_change_nothing

# for each joint that matters: poses at random, kept in a round, and tried about each of these
SPREAD, PARENTS, CHILDREN = 500, 12, 4
ROUNDS, SHRINK = 22, 0.7  # steps of the last round: 0.01 % of the joint ranges
STEP, APART = 0.2, 0.3  # of the first round, over the joint ranges
AT_END, STILL = 0.2, 0.4  # shares of joints at each end of their range, and not moved
NEIGHBOURS, OFF_LINE = 8, 0.1  # poses that give a line, and share of a random step beside it
RANKED = 4000  # lowest poses of a round, of which parents are chosen


def lowest_by_population(case: CasePoses, starts: Array) -> tuple[Array, float]:
    """The lowest pose (nq,) that a population finds from some poses (m, nq), and its value [Hz].

    Infinite if it finds none. Equal arguments give equal answers.
    """
    low, high = case.workspace.ranges.T
    span = np.where(high > low, high - low, 1.0)
    fixed = joints_that_change_nothing(case.machine)
    moving = np.array([j not in fixed for j in range(len(low))])
    count, random = int(moving.sum()), np.random.default_rng(0)

    def poses(shares: Array) -> Array:
        return np.clip(low + shares * span, low, high)

    known = (starts - low) / span
    shares = np.concatenate([known, at_random(known[0], moving, SPREAD * count, random)])
    values = _frequencies(case, poses(shares))
    for reach in SHRINK ** np.arange(ROUNDS):
        parents = lowest_apart(shares, values, APART * reach)[: PARENTS * count]
        shares, values = shares[parents], values[parents]
        tried = _about(shares, moving, CHILDREN * count, STEP * reach, random)
        shares = np.concatenate([shares, tried])
        values = np.concatenate([values, _frequencies(case, poses(tried))])
    best = int(values.argmin())
    return poses(shares[best]), float(values[best])


def _frequencies(case: CasePoses, q: Array) -> Array:
    """Lowest frequency at poses (n, nq) within the ranges: (n,) [Hz], inf where none exists.

    Nor where springs do not hold the machine, whose place on them is no number.
    """
    rigid, values = case.rigid_at(q), np.full(len(q), np.inf)
    exist = case.exists_at(rigid)
    if exist.any():
        with np.errstate(all="ignore"):
            found = lowest_frequency(case.machine.evaluate(rigid[exist]))
        values[exist] = np.where(np.isnan(found), np.inf, found)
    return values


def at_random(still: Array, moving: Array, count: int, random: np.random.Generator) -> Array:
    """Poses over the joint ranges (count, nq), many joints at an end, others as in ``still``."""
    shares, ends = random.random((2, count, len(still)))
    shares = np.where(ends < AT_END, 0.0, np.where(ends > 1 - AT_END, 1.0, shares))
    return np.where(moving, shares, still)


def lowest_apart(shares: Array, values: Array, apart: float) -> Array:
    """Indices of poses from the lowest up, of each box of the size ``apart`` the lowest alone."""
    ranked = np.argsort(values, kind="stable")[:RANKED]
    boxes = np.round(shares[ranked] / apart).astype(int)
    _, first = np.unique(boxes, axis=0, return_index=True)
    return np.asarray(ranked[np.sort(first)])


def _about(
    parents: Array, moving: Array, each: int, step: float, random: np.random.Generator
) -> Array:
    """Poses about parents (n, nq), ``each`` of them: half along a line to a parent nearby."""
    moved = np.repeat(parents, each, axis=0)
    steps = step * random.standard_normal(moved.shape)
    steps *= (random.random(moved.shape) >= STILL) & moving
    if len(parents) > 2:
        squares = ((parents[:, None] - parents[None]) ** 2).sum(axis=2)
        np.fill_diagonal(squares, np.inf)
        near = squares.argsort(axis=1)[:, : min(NEIGHBOURS, len(parents) - 1)]
        rows = np.flatnonzero(np.arange(len(moved)) % each < each // 2)
        own = rows // each
        other = near[own, random.integers(0, near.shape[1], len(own))]
        along = random.standard_normal((len(own), 1)) * (parents[other] - parents[own])
        steps[rows] = along + OFF_LINE * steps[rows]
    return np.clip(moved + steps, 0.0, 1.0)
