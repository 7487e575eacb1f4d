"""Gains of their own with pressure feedback, searched by a compiled interior-point method.

The search of a pose begins at the best of some starts and of what its neighbours have found, and
climbs by Newton steps, of the logarithms x of all gains, on

    Φ(x) = F(x)/τ + Σ_ω log det(I − Y Yᴴ/limit²) + the same at the position errors,

where F is how fast the loops are and the rest goes to −∞ where the margin is lost (a barrier; Y
the balanced ½(S − T), see ``margins``). As τ falls, x follows a path between all limits to where
the loops are fastest (Boyd, Vandenberghe 2004, chapter 11). The path ends at gains that no others
near them exceed: what is found is a lower bound.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from armdesign.arrays import Array
from armdesign.control.loops import HALF, LoopArguments, LoopRoom, close_loops, crossing, halve
from armdesign.control.margins import log_room
from armdesign.simulation.plant.compiled import borrowing

if TYPE_CHECKING:
    from armdesign.control.controller import Controller
    from armdesign.control.tuning import Task

MEAN = 0.1  # weight of the mean of all loops' bandwidths beside the narrowest
SPARE = 1.015  # of the margin, for what lies between the frequencies of a grid
SHARES = (0.98, 0.9, 0.7, 0.5, 0.3)  # of a start's gains, of which the first may hold
MOST = math.log(3.0)  # κ and η: beyond, a loop may be unstable above all frequencies of a grid
NEIGHBOURS = 4
FIRST, LAST, FALL = 0.02, 1e-3, 0.4  # τ of the path, of log bandwidths, and its falls
STEPS = 40  # of a path
LONGEST, SHORTEST, ANEW = 0.5, 2e-3, 0.1  # steps of logarithms: trusted first and at the least
GOOD, POOR, SHORTER = 0.6, 0.3, 1 / 3  # share of a promised gain, and how much less is trusted
SETTLED = 1.0  # gain of Φ below which τ falls
RIDGE = 1e-3  # of curvature, and where steps are too long
DIFFERENCE = 1e-5  # of a logarithm, for slopes
FAR = 1.0  # by which logarithms of room are less at frequencies that count in slopes


class _Seen(NamedTuple):
    """What is seen of the loops at some gains."""

    rooms: Array  # logarithms of the room at each frequency, of both openings (f,)
    sizes: Array  # |T| of each loop (f, nq)
    crossed: Array  # index of the first frequency below −3 dB (nq,); f: none
    logs: Array  # of bandwidths (nq,)

    @classmethod
    def of(cls, count: int, nq: int) -> _Seen:
        arrays = np.zeros(count), np.zeros((count, nq)), np.zeros(nq, dtype=int), np.zeros(nq)
        return cls(*arrays)


class _Model(NamedTuple):
    """Φ about some gains, to second order, and steps from there."""

    rooms: Array  # slopes of ``_Seen.rooms`` (f, n)
    logs: Array  # and of ``_Seen.logs`` (nq, n)
    weights: Array  # of the loops in F (nq,)
    mean: Array  # slope of F (n,)
    slope: Array  # of Φ (n,)
    curvature: Array  # of −Φ (n, n)
    lower: Array  # Cholesky factor of the curvature and a ridge (n, n)
    step: Array  # (n,)

    @classmethod
    def of(cls, count: int, nq: int, n: int) -> _Model:
        shapes = (count, n), (nq, n), nq, n, n, (n, n), (n, n), n
        return cls(*(np.zeros(shape) for shape in shapes))


class _Search(NamedTuple):
    """Loops whose gains are searched, and room for the search of one pose."""

    loops: LoopArguments
    omega: Array  # (n, f)
    units: Array  # gains of κ = 1 and η = 1 (n, nq + nc)
    limit: float  # of μ(½(S − T))
    room: LoopRoom
    seen: _Seen
    other: _Seen
    model: _Model
    trial: Array  # logarithms of gains (nq + nc,)
    start: Array
    top: Array

    @classmethod
    def of(cls, task: Task) -> _Search:
        args = task.loops.arguments(task.controller(*map(np.ones, task.shapes)))
        gains, pressure = args.gains.copy(), args.pressure_gains.copy()
        args = args._replace(gains=gains, pressure_gains=pressure)
        both = np.concatenate([gains, pressure], axis=1)
        count, nq, n = task.loops.omega.shape[1], gains.shape[1], both.shape[1]
        limit, seen = 1 / (SPARE * task.aim.margin), (_Seen.of(count, nq) for _ in range(2))
        room, model = LoopRoom.of(task.loops), _Model.of(count, nq, n)
        gains_of = (np.zeros(n) for _ in range(3))
        return cls(args, task.loops.omega, both, limit, room, *seen, model, *gains_of)


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

    def improve(self, rows: Array, starts: Array, near: Array) -> None:
        """Search at poses in turn, from the best of what is known next to each, or given.

        Args:
            rows: indices of the poses.
            starts: logarithms of gains that each pose tries (n, m, nq + nc).
            near: indices of the poses next to each (n, k).
        """
        _improve(self._search, rows, starts, near, self.x, self.scores)

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


@borrowing
def _improve(
    search: _Search, rows: Array, starts: Array, near: Array, x: Array, scores: Array
) -> None:
    count = near.shape[1]
    for pose in rows:
        best = -np.inf
        for k in range(count + starts.shape[1]):
            if k >= count:
                best = _start(search, pose, starts[pose, k - count], best)
            elif scores[near[pose, k]] > -np.inf:
                best = _start(search, pose, x[near[pose, k]], best)
        if best > -np.inf:
            score = _climb(search, pose)
            if score > scores[pose]:
                scores[pose] = score
                _copy(search.top, x[pose])


@borrowing
def _start(search: _Search, pose: int, x: Array, best: float) -> float:
    """The score of the largest share of gains that keeps the margin, or the best if larger.

    A larger score's gains are written into ``search.start``.
    """
    for share in SHARES:
        for i in range(len(x)):
            search.trial[i] = x[i] + math.log(share)
        if _look(search, pose, search.trial, search.seen):
            score = _score(search.seen, LAST)
            if score > best:
                _copy(search.trial, search.start)
                return score
            break
    return best


@borrowing
def _climb(search: _Search, pose: int) -> float:
    """Score of the best gains on the path from the start, which are written into the top."""
    seen, other, model, x = search.seen, search.other, search.model, search.start
    best, tau, trust = -np.inf, FIRST, LONGEST
    _look(search, pose, x, seen)
    for _ in range(STEPS):
        _write_slopes(search, pose, seen, other)
        _write_model(model, seen, tau)
        length = _write_step(model, trust)
        for i in range(len(x)):
            search.trial[i] = min(x[i] + model.step[i], MOST)
        gained, promised = -np.inf, _promised(model)
        if _look(search, pose, search.trial, other):
            gained = _value(other, tau) - _value(seen, tau)
        if gained > 0.0:
            seen, other = other, seen
            _copy(search.trial, x)
            if _score(seen, LAST) > best:
                best = _score(seen, LAST)
                _copy(x, search.top)
        if gained > GOOD * promised:
            trust = min(2 * trust, LONGEST)
        elif gained < POOR * promised:
            trust = SHORTER * length
        if trust < SHORTEST or (gained > 0.0 and promised < SETTLED and length < 0.9 * trust):
            tau, trust = tau * FALL, max(trust, ANEW)
            if tau < LAST:
                break
    return best


@borrowing
def _score(seen: _Seen, tau: float) -> float:
    """F: logarithm of the narrowest bandwidth, softened by τ, and a share of the mean of all."""
    least, total, softened = np.inf, 0.0, 0.0
    for log in seen.logs:
        least, total = min(least, log), total + log
    for log in seen.logs:
        softened += math.exp((least - log) / tau)
    return least - tau * math.log(softened) + MEAN * total / len(seen.logs)


@borrowing
def _value(seen: _Seen, tau: float) -> float:
    """Φ."""
    value = _score(seen, tau) / tau
    for room in seen.rooms:
        value += room
    return value


@borrowing
def _write_slopes(search: _Search, pose: int, seen: _Seen, other: _Seen) -> None:
    """Write slopes at the start of what is seen there, of what counts, by first differences."""
    x, trial, model, count = search.start, search.trial, search.model, len(seen.rooms)
    most = -np.inf
    for room in seen.rooms:
        most = max(most, room)
    _copy(x, trial)
    for k in range(len(x)):
        trial[k] = x[k] + DIFFERENCE
        _set_gains(search, pose, trial)
        trial[k] = x[k]
        for f in range(count):
            model.rooms[f, k] = 0.0
            if seen.rooms[f] < most - FAR:
                risen = max(_see(search, pose, f, other) - seen.rooms[f], -1.0)
                model.rooms[f, k] = risen / DIFFERENCE
        for i in range(len(seen.logs)):
            model.logs[i, k] = 0.0
            f = seen.crossed[i]
            if f < count:
                _see(search, pose, f, other)
                _see(search, pose, max(f - 1, 0), other)
                risen = _log_crossing(search, pose, other, f, i) - seen.logs[i]
                model.logs[i, k] = risen / DIFFERENCE


@borrowing
def _write_model(model: _Model, seen: _Seen, tau: float) -> None:
    """Write the slope of Φ and its curvature, of which no second differences are known."""
    count, (nq, n) = len(model.rooms), model.logs.shape
    least, total, weights, mean = np.inf, 0.0, model.weights, model.mean
    for log in seen.logs:
        least = min(least, log)
    for i in range(nq):
        weights[i] = math.exp((least - seen.logs[i]) / tau)
        total += weights[i]
    for k in range(n):
        mean[k], even = 0.0, 0.0
        for i in range(nq):
            mean[k] += weights[i] / total * model.logs[i, k]
            even += MEAN / nq * model.logs[i, k]
        model.slope[k] = (mean[k] + even) / tau
        for f in range(count):
            model.slope[k] += model.rooms[f, k]
    for k in range(n):
        for j in range(n):
            bent = 0.0
            for i in range(nq):
                of_loop = (model.logs[i, k] - mean[k]) * (model.logs[i, j] - mean[j])
                bent += weights[i] / total / tau**2 * of_loop
            for f in range(count):
                bent += model.rooms[f, k] * model.rooms[f, j]
            model.curvature[k, j] = bent + (0.1 if j == k else 0.0)


@borrowing
def _write_step(model: _Model, trust: float) -> float:
    """Write the best step of a model that is no longer than trusted; its length."""
    n, length, ridge = len(model.step), np.inf, 0.0
    for k in range(n):
        ridge += model.slope[k] ** 2
    ridge = RIDGE * math.sqrt(ridge) / trust
    while length > trust:
        _solve(model, ridge)
        length = 0.0
        for k in range(n):
            length += model.step[k] ** 2
        length = math.sqrt(length)
        ridge *= 3
    return length


@borrowing
def _promised(model: _Model) -> float:
    """By how much a step raises Φ in the model."""
    total = 0.0
    for k in range(len(model.step)):
        total += model.slope[k] * model.step[k]
        for j in range(len(model.step)):
            total -= 0.5 * model.step[k] * model.curvature[k, j] * model.step[j]
    return total


@borrowing
def _solve(model: _Model, ridge: float) -> None:
    """Write the step of a model whose curvature is raised by a ridge; by Cholesky."""
    lower, step, n = model.lower, model.step, len(model.step)
    for i in range(n):
        step[i] = model.slope[i]
        for j in range(i + 1):
            lower[i, j] = model.curvature[i, j] + (ridge if i == j else 0.0)
            for k in range(j):
                lower[i, j] -= lower[i, k] * lower[j, k]
            lower[i, j] = lower[i, j] / lower[j, j] if j < i else math.sqrt(lower[i, i])
        for k in range(i):
            step[i] -= lower[i, k] * step[k]
        step[i] /= lower[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            step[i] -= lower[k, i] * step[k]
        step[i] /= lower[i, i]


@borrowing
def _look(search: _Search, pose: int, x: Array, seen: _Seen) -> bool:
    """Whether the margin holds with gains of logarithms x; if so ``seen`` is of them."""
    _set_gains(search, pose, x)
    count = len(seen.rooms)
    for f in range(count):
        seen.rooms[f] = _see(search, pose, f, seen)
        if seen.rooms[f] == -np.inf:
            return False
    for i in range(len(seen.logs)):
        f = 0
        while f < count and seen.sizes[f, i] >= HALF:
            f += 1
        seen.crossed[i] = f
        seen.logs[i] = math.log(search.omega[pose, count - 1])
        if f < count:
            seen.logs[i] = _log_crossing(search, pose, seen, f, i)
    return True


@borrowing
def _see(search: _Search, pose: int, f: int, seen: _Seen) -> float:
    """Logarithm of the room at a frequency, where |T| of each loop is written."""
    room = search.room
    close_loops(search.loops, pose, f, room)
    for i in range(len(room.S)):
        seen.sizes[f, i] = abs(1 - room.S[i, i])
    halve(room)
    command = log_room(room.S_c, search.limit, room.command)
    return command + log_room(room.S, search.limit, room.position)


@borrowing
def _log_crossing(search: _Search, pose: int, seen: _Seen, f: int, i: int) -> float:
    """Logarithm of the bandwidth of loop i, which crosses −3 dB below the frequency f."""
    last = seen.sizes[f - 1, i] if f > 0 else 1.0
    return math.log(crossing(search.omega[pose], f, last, seen.sizes[f, i], HALF))


@borrowing
def _copy(values: Array, into: Array) -> None:
    """Write values (n,) into another array."""
    for i in range(len(values)):
        into[i] = values[i]


@borrowing
def _set_gains(search: _Search, pose: int, x: Array) -> None:
    nq = search.loops.gains.shape[1]
    for i in range(len(x)):
        gain = search.units[pose, i] * math.exp(x[i])
        if i < nq:
            search.loops.gains[pose, i] = gain
        else:
            search.loops.pressure_gains[pose, i - nq] = gain
