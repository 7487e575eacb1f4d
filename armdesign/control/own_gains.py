"""Gains of their own with pressure feedback, searched by a compiled evolution strategy.

The search of a pose begins at the best of some starts and of what its neighbours have found, and
goes on by a (1+1)-CMA-ES (Igel, Suttorp, Hansen 2006): one random change of the logarithms of all
gains at a time, kept where the margin holds and the loops are faster, whose size and directions
follow those that were kept. A search finds no gains that are proven to be the largest: what it
finds is a lower bound. It draws the same random numbers at every pose and every call.

The bandwidth of a loop leaps where a dip of |T| reaches −3 dB. So that the search sees a dip come,
the narrowest bandwidth at a lower level counts a little too.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from armdesign.arrays import Array
from armdesign.control.loops import HALF, LoopArguments, close_loops, crossing
from armdesign.control.margins import exceeds
from armdesign.simulation.plant.compiled import compiled

if TYPE_CHECKING:
    from armdesign.control.controller import Controller
    from armdesign.control.tuning import Task

LEVELS = (HALF, 0.6)  # of |T| at which bandwidths count: −3 dB, and below it
LOWER = 0.3  # weight of the bandwidth at the lower level
MEAN = 0.1  # weight of the mean of all loops' bandwidths beside the narrowest
SPARE = 1.015  # of the margin, for what lies between the frequencies of a grid
SHARES = (1.0, 0.8, 0.6, 0.4)  # of a start's position gains, of which the first may hold
STEP, LEAST_STEP = 0.25, 1e-3  # at the start of a search and at its end, of logarithms
MOST = math.log(3.0)  # κ and η: beyond, a loop may be unstable above all frequencies of a grid
REMEMBERED = 6  # frequencies that missed the margin last: looked at first
NEIGHBOURS = 4
GOAL, SMOOTH = 2 / 11, 1 / 12  # share of successes that keeps the step; of the newest in the mean
OFTEN = 0.44  # share of successes from which a step is taken to be too small, not badly turned


class _Search(NamedTuple):
    """Loops whose gains are searched, and room for one frequency of them."""

    loops: LoopArguments
    omega: Array  # (n, f)
    units: Array  # gains of κ = 1 and η = 1 (n, nq + nc)
    limit: float  # of μ(½(S − T))
    last_missed: Array  # places of frequencies (REMEMBERED,)
    opened: Array
    S_c: Array
    closed: Array
    S: Array

    @classmethod
    def of(cls, task: Task) -> _Search:
        args = task.loops.arguments(task.controller(*map(np.ones, task.shapes)))
        gains, pressure = args.gains.copy(), args.pressure_gains.copy()
        nq, nc = gains.shape[1], pressure.shape[1]
        room = (np.empty((m, m), complex) for m in (nc, nc, nq, nq))
        limit, last_missed = 1 / (SPARE * task.aim.margin), np.zeros(REMEMBERED, dtype=int)
        args = args._replace(gains=gains, pressure_gains=pressure)
        both = np.concatenate([gains, pressure], axis=1)
        return cls(args, task.loops.omega, both, limit, last_missed, *room)


class OwnGains:
    """Gains of their own at n poses, as they are found.

    Attributes:
        x: logarithms of κ and η (n, nq + nc).
        scores: how wide the loops are (n,); −∞ where no gains are known.
    """

    def __init__(self, task: Task) -> None:
        self._search = _Search.of(task)
        n, gains = self._search.units.shape
        self.x, self.scores = np.zeros((n, gains)), np.full(n, -np.inf)

    def improve(self, rows: Array, starts: Array, near: Array, noise: Array) -> None:
        """Search at poses in turn, from the best of what is known there, next to it, or given.

        Args:
            rows: indices of the poses.
            starts: logarithms of gains that each pose tries (n, m, nq + nc).
            near: indices of the poses next to each (n, k).
            noise: random changes (tries, nq + nc).
        """
        _improve(self._search, rows, starts, near, noise, self.x, self.scores)

    def controller(self, task: Task) -> Controller:
        """The controllers found (n); gains 0 where none are."""
        gains = np.where(np.isfinite(self.scores)[:, None], np.exp(self.x), 0.0)
        nq = task.plant.joints
        return task.controller(gains[:, :nq], gains[:, nq:])


def neighbours(q: Array) -> Array:
    """The poses next to each pose (n, k), by shares of the ranges of all."""
    from scipy.spatial import KDTree

    k = min(NEIGHBOURS, len(q) - 1)
    if k == 0:
        return np.zeros((len(q), 0), dtype=int)
    even = q / np.where(np.ptp(q, axis=0) > 0, np.ptp(q, axis=0), 1.0)
    near = KDTree(even).query(even, np.arange(1, k + 2))[1]
    return np.ascontiguousarray(near[:, 1:])


@compiled
def _improve(
    search: _Search, rows: Array, starts: Array, near: Array, noise: Array, x: Array, scores: Array
) -> None:
    nq = search.loops.gains.shape[1]
    trial, best_start = np.empty(x.shape[1]), np.empty(x.shape[1])
    for pose in rows:
        search.last_missed[:] = 0
        best = scores[pose]
        _copy(x[pose], best_start)
        count = near.shape[1]
        for k in range(count + starts.shape[1]):
            if k < count and scores[near[pose, k]] == -np.inf:
                continue
            start = x[near[pose, k]] if k < count else starts[pose, k - count]
            for share in SHARES:
                for i in range(len(start)):
                    trial[i] = start[i] + (math.log(share) if i < nq else 0.0)
                score = _score_if_better(search, pose, trial, best)
                if score > best:
                    best = score
                    _copy(trial, best_start)
                    break
        if best > -np.inf:
            scores[pose] = _evolve(search, pose, best_start, best, noise)
            _copy(best_start, x[pose])


@compiled
def _evolve(search: _Search, pose: int, x: Array, best: float, noise: Array) -> float:
    """Score of the best logarithms of gains near x, which takes their place; (1+1)-CMA-ES."""
    n = len(x)
    damping, path_rate, rate = 1 + n / 2, 2 / (n + 2), 2 / (n**2 + 6)
    step, success, path, trial = STEP, GOAL, np.zeros(n), np.empty(n)
    covariance: Array = np.eye(n)
    turned: Array = np.eye(n)
    for number in range(len(noise)):
        change = turned @ noise[number]
        for i in range(n):
            trial[i] = x[i] + step * change[i]
        score = _score_if_better(search, pose, trial, best)
        success = (1 - SMOOTH) * success + (SMOOTH if score > best else 0.0)
        step *= math.exp((success - GOAL) / (1 - GOAL) / damping)
        if score > best:
            best = score
            _copy(trial, x)
            seldom = success < OFTEN
            for i in range(n):
                path[i] *= 1 - path_rate
                if seldom:
                    path[i] += math.sqrt(path_rate * (2 - path_rate)) * change[i]
            keep = 1 - rate + (0.0 if seldom else rate * path_rate * (2 - path_rate))
            for i in range(n):
                for j in range(n):
                    covariance[i, j] = keep * covariance[i, j] + rate * (path[i] * path[j])
            turned = np.linalg.cholesky(covariance)
        if step < LEAST_STEP:
            break
    return best


@compiled
def _score_if_better(search: _Search, pose: int, x: Array, best: float) -> float:
    """Score of gains of logarithms x, how wide the loops are, if above the best; else −∞.

    −∞ too where the margin does not hold.
    """
    if x.max() > MOST:
        return -np.inf
    _set_gains(search, pose, x)
    for turn in range(REMEMBERED):
        if _misses(search, pose, search.last_missed[turn]):
            _move_to_front(search.last_missed, turn)
            return -np.inf
    score, count = np.inf, search.omega.shape[1]
    last, crossings = np.ones(len(search.S)), np.zeros((len(LEVELS), len(search.S)))
    for f in range(count):
        if _misses(search, pose, f):
            search.last_missed[-1] = f
            _move_to_front(search.last_missed, REMEMBERED - 1)
            return -np.inf
        if score == np.inf:
            for i in range(len(search.S)):
                size = abs(0.5 - search.S[i, i])
                for level in range(len(LEVELS)):
                    if crossings[level, i] == 0.0 and size < LEVELS[level]:
                        omega, at = search.omega[pose], LEVELS[level]
                        crossings[level, i] = crossing(omega, f, last[i], size, at)
                last[i] = size
            if f == count - 1 or crossings.min() > 0.0:  # the rest is but for the margin
                score = _score(crossings, search.omega[pose, count - 1])
                if score <= best:
                    return -np.inf
    return score


@compiled
def _score(crossings: Array, highest: float) -> float:
    """How wide loops are that cross levels at frequencies (levels, nq); 0: above the highest."""
    count = crossings.shape[1]
    narrowest, lower, total = np.inf, np.inf, 0.0
    for i in range(count):
        log = math.log(crossings[0, i] if crossings[0, i] > 0 else highest)
        narrowest, total = min(narrowest, log), total + log
        lower = min(lower, math.log(crossings[1, i] if crossings[1, i] > 0 else highest))
    return narrowest + LOWER * lower + MEAN * total / count


@compiled
def _copy(values: Array, into: Array) -> None:
    """Write values (n,) into another array: where a slice is set, numba compiles far more."""
    for i in range(len(values)):
        into[i] = values[i]


@compiled
def _set_gains(search: _Search, pose: int, x: Array) -> None:
    nq = search.loops.gains.shape[1]
    for i in range(len(x)):
        gain = search.units[pose, i] * math.exp(x[i])
        if i < nq:
            search.loops.gains[pose, i] = gain
        else:
            search.loops.pressure_gains[pose, i - nq] = gain


@compiled
def _move_to_front(last_missed: Array, turn: int) -> None:
    """Move a frequency to the front of those that missed last."""
    for k in range(turn, 0, -1):
        last_missed[k], last_missed[k - 1] = last_missed[k - 1], last_missed[k]


@compiled
def _misses(search: _Search, pose: int, f: int) -> bool:
    """Whether the margin is missed at a frequency; S − ½ is in ``search.S`` where it holds."""
    close_loops(search.loops, pose, f, search.opened, search.S_c, search.closed, search.S)
    for i in range(len(search.S_c)):
        search.S_c[i, i] -= 0.5
    for i in range(len(search.S)):
        search.S[i, i] -= 0.5
    return exceeds(search.S_c, search.limit, search.opened) or exceeds(
        search.S, search.limit, search.closed
    )
