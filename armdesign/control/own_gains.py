"""Gains of their own with pressure feedback, searched by an interior-point method.

The search of a pose begins at common gains, or at what its neighbours have found or near it, as
far as the margin holds on the way there, and climbs by Newton steps, of the logarithms x of all
gains, on

    Φ(x) = F(x)/τ + Σ_ω log det(I − Y Yᴴ/limit²) + the same at the position errors,

where F is how fast the loops are and the rest, ``room``, goes to −∞ where the margin is lost (a
barrier; Y the balanced ½(S − T), see ``margins``), less what it would be at frequencies with
ample room. Slopes are exact, see ``loop_slopes``. As τ falls, x follows a path between all limits
to where the loops are fastest (Boyd, Vandenberghe 2004, chapter 11), up to gains that none near
them exceed. Others far away may be better: what is found is a lower bound. All poses climb
at once.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from armdesign.arrays import Array, Flags
from armdesign.control.loop_slopes import (
    SlopeRoom,
    crossing_slopes,
    write_gain_slopes,
    write_room_slope,
    write_size_slope,
)
from armdesign.control.loops import (
    HALF,
    LoopArguments,
    LoopRoom,
    Loops,
    close_loops,
    crossing,
    halve,
    size_of,
)
from armdesign.control.margins import log_room, squared_norm
from armdesign.simulation.plant.compiled import borrowing, within

if TYPE_CHECKING:
    from armdesign.control.controller import Controller
    from armdesign.control.tuning import Task

MEAN = 0.1  # weight of the mean of all loops' bandwidths beside the narrowest
SPARE = 1.015  # of the margin, for what lies between the frequencies of a grid
SHARES = (0.9, 0.7, 0.5, 0.3, 0.1)  # of gains that leave loops stable, of which one may hold
WAY = (0.0, 0.3, 0.6, 0.9, 1.0)  # shares of the way from there to a start
MOST = math.log(3.0)  # κ and η: beyond, a loop may be unstable above all frequencies of a grid
NEIGHBOURS = 4
FIRST, LAST, FALL = 0.02, 1e-3, 0.4  # τ of the path, of log bandwidths, and its falls
STEPS, RACE = 50, 5  # of a path, and of a race
LONGEST, SHORTEST, ANEW = 0.5, 2e-3, 0.1  # steps of logarithms that are trusted
GOOD, POOR, SHORTER = 0.6, 0.3, 1 / 3  # shares of a promised gain, and how much less is trusted
SETTLED, TRUSTED = 1.0, 0.9  # gain of Φ and share of the longest step below which τ falls
RIDGE, LEAST = 3.0, 0.1  # factor on what bends Φ more where steps are too long, and its least
FAR = 3.0  # factor by which rooms that count are less than the room of open loops


class _Seen(NamedTuple):
    """What is seen of the loops of m poses at some gains, of which there are k at each."""

    rooms: Array  # logarithms of the room at all frequencies and both openings, summed (m,)
    slopes: Array  # of these (m, k)
    bent: Array  # how they bend down (m, k, k)
    logs: Array  # of bandwidths (m, nq)
    by_logs: Array  # slopes of these (m, nq, k)

    @classmethod
    def empty(cls, m: int, nq: int, k: int) -> _Seen:
        """Of m poses, not yet looked at."""
        shapes = (m,), (m, k), (m, k, k), (m, nq), (m, nq, k)
        return cls(*(np.zeros(shape) for shape in shapes))

    @property
    def holds(self) -> Flags:
        """Where the margin holds (m,)."""
        return np.asarray(self.rooms > -np.inf)

    def score(self, tau: Array | float) -> Array:
        """F: the narrowest log bandwidth, softened by τ, and a share of the mean of all (m,)."""
        least = self.logs.min(axis=1)
        with np.errstate(under="ignore"):
            wider = np.exp((least[:, None] - self.logs) / np.reshape(tau, (-1, 1)))
        return np.asarray(least - tau * np.log(wider.sum(axis=1)) + MEAN * self.logs.mean(axis=1))

    def value(self, tau: Array) -> Array:
        """Φ (m,)."""
        return np.asarray(self.score(tau) / tau + self.rooms)

    def at(self, rows: Array) -> _Seen:
        """At some of the poses (mask or indices)."""
        return _Seen(*(of[rows] for of in self))

    def where(self, flags: Flags, other: _Seen) -> _Seen:
        """This at flagged poses (m,), the other at the rest."""
        pairs = zip(self, other, strict=True)
        return _Seen(*(np.where(flags, mine.T, theirs.T).T for mine, theirs in pairs))

    def model(self, tau: Array) -> tuple[Array, Array]:
        """Slope of Φ (m, k), and how it bends down (m, k, k)."""
        with np.errstate(under="ignore"):
            weights = np.exp((self.logs.min(axis=1)[:, None] - self.logs) / tau[:, None])
        weights /= weights.sum(axis=1, keepdims=True)
        mean = np.einsum("mi,mik->mk", weights, self.by_logs)
        slope = (mean + MEAN * self.by_logs.mean(axis=1)) / tau[:, None] + self.slopes
        beside = (self.by_logs - mean[:, None]) * np.sqrt(weights)[:, :, None] / tau[:, None, None]
        bent = self.bent + np.swapaxes(beside, 1, 2) @ beside
        return slope, bent + LEAST * np.eye(slope.shape[1])


class _Search(NamedTuple):
    """Loops whose gains are searched, for compiled code."""

    loops: LoopArguments
    omega: Array  # (n, f) [rad/s]
    limit: float  # of μ
    near: float  # room det(I − Y Yᴴ/limit²) of both openings above which it does not count
    worst: Array  # the frequency of each pose that missed the margin last (n,): looked at first


class _Room(NamedTuple):
    """Room for what is seen of one pose, which compiled code may not make anew."""

    loop: LoopRoom
    slopes: SlopeRoom
    crossed: Array  # first frequency at which a loop is below −3 dB (nq,); f: at none
    by_gains: Array  # slopes (nq + nc,)
    sizes: Array  # |T| of each loop at the frequencies about −3 dB (2 nq,)
    by_sizes: Array  # slopes of their logarithms (2 nq, nq + nc)

    @classmethod
    def of(cls, loops: Loops) -> _Room:
        """For some loops."""
        nq, nc = loops.positions.shape[2:]
        shapes = nq + nc, 2 * nq, (2 * nq, nq + nc)
        rooms = LoopRoom.of(loops), SlopeRoom.of(loops)
        return cls(*rooms, np.empty(nq, int), *(np.empty(shape) for shape in shapes))


class OwnGains:
    """Gains of their own at n poses, as they are found.

    Attributes:
        x: logarithms of κ and η (n, nq + nc).
        scores: how wide the loops are (n,); −∞ where no gains are known.
    """

    def __init__(self, task: Task) -> None:
        self._loops = loops = task.loops.arguments(task.controller(*map(np.ones, task.shapes)))
        self._units = np.concatenate([loops.gains, loops.pressure_gains], axis=1)
        self._room, limit = _Room.of(task.loops), 1 / (SPARE * task.aim.margin)
        near = max(1 - 0.25 / limit**2, 1e-9) ** self._units.shape[1] / FAR
        worst = np.zeros(len(self._units), dtype=int)
        self._search = _Search(self._loops, task.loops.omega, limit, near, worst)
        self.x, self.scores = np.zeros(self._units.shape), np.full(len(self._units), -np.inf)

    def improve(self, within: Array, starts: Array, leaders: int = 1) -> None:
        """Search at all poses from the best of starts, if need be after a race of a few steps.

        Args:
            within: logarithms of gains that leave the loops stable (n, nq + nc). A start is
                reached from a share of these on a way on which the margin holds, so that the
                loops stay stable.
            starts: logarithms of gains (n, m, nq + nc).
            leaders: how many of the m starts of a pose go on to the end.
        """
        n, m, k = starts.shape
        poses = np.repeat(np.arange(n), m)
        x, scores = self._walk(poses, self._inside(within)[poses], starts.reshape(n * m, k))
        if m > leaders:
            rows = np.flatnonzero(np.isfinite(scores))
            x[rows], scores[rows] = self._climb(poses[rows], x[rows], RACE)
        best = np.argsort(-scores.reshape(n, m), axis=1, kind="stable")[:, :leaders]
        rows = (best + m * np.arange(n)[:, None]).ravel()
        rows = rows[np.isfinite(scores[rows])]
        x, scores = self._climb(poses[rows], x[rows], STEPS)
        order = np.argsort(scores, kind="stable")  # the best of a pose is written last
        self.x[poses[rows[order]]], self.scores[poses[rows[order]]] = x[order], scores[order]

    def _inside(self, x: Array) -> Array:
        """The largest shares of gains that hold, logarithms (n, nq + nc); NaN where none does."""
        held, rows = np.full(x.shape, np.nan), np.arange(len(x))
        for share in SHARES:
            less = x[rows] + math.log(share)
            holds = self._look(rows, less).holds
            held[rows[holds]] = less[holds]
            rows = rows[~holds]
        return held

    def _walk(self, poses: Array, begin: Array, end: Array) -> tuple[Array, Array]:
        """How far gains hold on the way from those that do (m, nq + nc); scores, −∞ for none."""
        x, scores, end = begin.copy(), np.full(len(begin), -np.inf), np.minimum(end, MOST)
        rows = np.flatnonzero(np.isfinite(begin + end).all(axis=1))
        for share in WAY:
            tried = begin[rows] + share * (end[rows] - begin[rows])
            seen = self._look(poses[rows], tried)
            rows, holding = rows[seen.holds], seen.at(seen.holds)
            x[rows], scores[rows] = tried[seen.holds], holding.score(LAST)
        return x, scores

    def controller(self, task: Task) -> Controller:
        """The controllers found (n); gains 0 where none are."""
        gains = np.where(np.isfinite(self.scores)[:, None], np.exp(self.x), 0.0)
        nq = task.plant.joints
        return task.controller(gains[:, :nq], gains[:, nq:])

    def _climb(self, poses: Array, x: Array, most: int) -> tuple[Array, Array]:
        """The best gains on the paths from x (m, nq + nc), in so many steps; scores (m,)."""
        m = len(poses)
        seen, steps = self._look(poses, x), 0
        top, best, x = x.copy(), seen.score(LAST), x.copy()
        tau, trust, rows = np.full(m, FIRST), np.full(m, LONGEST), np.arange(m)
        while len(rows) and steps < most:
            slope, curvature = seen.model(tau[rows])
            step = _steps(slope, curvature, trust[rows])
            tried = np.minimum(x[rows] + step, MOST)
            other = self._look(poses[rows], tried)
            gained = other.value(tau[rows]) - seen.value(tau[rows])
            up = gained > 0
            seen, x[rows[up]] = other.where(up, seen), tried[up]
            score = seen.score(LAST)
            higher = up & (score > best[rows])
            best[rows[higher]], top[rows[higher]] = score[higher], tried[higher]
            promised = ((slope - np.einsum("mij,mj->mi", curvature, step) / 2) * step).sum(axis=1)
            length = np.linalg.norm(step, axis=1)
            trust[rows] = _trusted(trust[rows], length, gained / promised)
            settled = up & (promised < SETTLED) & (length < TRUSTED * trust[rows])
            settled |= trust[rows] < SHORTEST
            tau[rows[settled]] *= FALL
            trust[rows[settled]] = np.maximum(trust[rows[settled]], ANEW)
            on, steps = tau[rows] >= LAST, steps + 1
            rows, seen = rows[on], seen.at(on)
        return top, best

    def _look(self, poses: Array, x: Array) -> _Seen:
        """What is seen of poses (m,) with gains of logarithms x (m, nq + nc)."""
        seen = _Seen.empty(len(poses), self._loops.gains.shape[1], x.shape[1])
        gains = self._units[poses] * np.exp(x)
        _write_seen(self._search, poses, gains, self._room, seen)
        return seen


def neighbours(q: Array) -> Array:
    """The poses next to each pose (n, k), by shares of the ranges of all."""
    from scipy.spatial import KDTree

    k = min(NEIGHBOURS, len(q) - 1)
    if k == 0:
        return np.zeros((len(q), 0), dtype=int)
    even = q / np.where(np.ptp(q, axis=0) > 0, np.ptp(q, axis=0), 1.0)
    near = KDTree(even).query(even, np.arange(1, k + 2))[1]
    return np.ascontiguousarray(near[:, 1:])


def _trusted(trust: Array, length: Array, kept: Array) -> Array:
    """Longest steps (m,), after steps of a length that kept a share of what they promised."""
    longer = np.where(kept > GOOD, np.minimum(2 * trust, LONGEST), trust)
    return np.asarray(np.where(kept < POOR, SHORTER * length, longer))


def _steps(slope: Array, curvature: Array, trust: Array) -> Array:
    """The best steps of models (m, n), no longer than trusted (m,)."""
    bent, axes = np.linalg.eigh(curvature)
    along = np.einsum("mji,mj->mi", axes, slope)
    ridge = np.zeros(len(slope))
    least = 1e-3 * np.linalg.norm(slope, axis=1) / trust
    while True:
        step = along / (bent + ridge[:, None])
        long = np.linalg.norm(step, axis=1) > trust
        if not long.any():
            return np.asarray(np.einsum("mji,mi->mj", axes, step))
        ridge[long] = np.maximum(RIDGE * ridge[long], least[long])


@borrowing
def _write_seen(search: _Search, poses: Array, gains: Array, room: _Room, seen: _Seen) -> None:
    """Write what is seen of gains (m, nq + nc); nothing more once the margin is missed."""
    loops, count, nq = search.loops, search.omega.shape[1], len(room.crossed)
    for row in range(len(poses)):
        pose = poses[row]
        for i in range(gains.shape[1]):
            if i < nq:
                room.crossed[i], loops.gains[pose, i] = count, gains[row, i]
            else:
                loops.pressure_gains[pose, i - nq] = gains[row, i]
        first = search.worst[pose]
        for turn in range(count + 2 * nq):
            f = _frequency(turn, count, first, room.crossed)
            if f < 0:
                continue
            close_loops(loops, pose, f, room.loop)
            if turn < count:
                counts = _add_room(search, f, room, seen, row)
            else:
                counts = _write_size(turn - count, room)
            if seen.rooms[row] == -math.inf:
                search.worst[pose] = f
                break
            if counts:
                write_gain_slopes(loops, pose, f, room.loop, room.slopes, room.by_gains)
                _keep_slopes(turn - count, room, seen, row)
        if seen.rooms[row] > -math.inf:
            _write_logs(search.omega[pose], room, seen, row)


@within
def _frequency(turn: int, count: int, first: int, crossed: Array) -> int:
    """All in turn, the ``first`` before; then two about −3 dB of each loop; −1 for none."""
    if turn < count:
        return first if turn == 0 else turn - 1 if turn <= first else turn
    f = crossed[(turn - count) // 2]
    return -1 if f == count else int(f - 1 + (turn - count) % 2)


@within
def _add_room(search: _Search, f: int, room: _Room, seen: _Seen, row: int) -> bool:
    """Add how much less than ``near`` the room at a frequency is; whether it is less."""
    loop, limit, value = room.loop, search.limit, -math.log(search.near)
    for i in range(len(room.crossed)):
        if f < room.crossed[i] and size_of(loop, i) < HALF:
            room.crossed[i] = f
    halve(loop, 0.5)
    least = 1 - squared_norm(loop.S_c) / limit**2, 1 - squared_norm(loop.S) / limit**2
    if least[0] > 0 and least[0] * least[1] > search.near:  # det(I − Y Yᴴ) ≥ 1 − tr Y Yᴴ
        return False
    for opening in range(2):
        matrix, own = (loop.S_c, loop.command) if opening == 0 else (loop.S, loop.position)
        value += log_room(matrix, limit, own)
    if value < 0.0:
        seen.rooms[row] += value
    if not -math.inf < value < 0.0:
        return False
    for opening in range(2):
        own, slope = loop.command, room.slopes.command
        if opening == 1:
            own, slope = loop.position, room.slopes.position
        write_room_slope(own, room.slopes.shifts, slope)
    halve(loop, -0.5)
    return True


@within
def _write_size(which: int, room: _Room) -> bool:
    """Write |T| of a loop at one of the two frequencies about −3 dB, and what it changes with."""
    room.sizes[which] = size_of(room.loop, which // 2)
    write_size_slope(room.loop, which // 2, room.slopes)
    return True


@within
def _keep_slopes(which: int, room: _Room, seen: _Seen, row: int) -> None:
    """Add slopes of the room, or keep those of one of the sizes about −3 dB."""
    by_gains = room.by_gains
    for i in range(len(by_gains)):
        if which >= 0:
            room.by_sizes[which, i] = by_gains[i]
        else:
            seen.slopes[row, i] += by_gains[i]
            for j in range(len(by_gains)):
                seen.bent[row, i, j] += by_gains[i] * by_gains[j]


@within
def _write_logs(omega: Array, room: _Room, seen: _Seen, row: int) -> None:
    """Write logarithms of bandwidths, and their slopes."""
    for i in range(len(room.crossed)):
        f = room.crossed[i]
        if f == len(omega):
            seen.logs[row, i] = math.log(omega[f - 1])
            continue
        last, size = room.sizes[2 * i], room.sizes[2 * i + 1]
        seen.logs[row, i] = math.log(crossing(omega, f, last, size))
        by_last, by_size = crossing_slopes(omega, f, last, size)
        for k in range(room.by_sizes.shape[1]):
            seen.by_logs[row, i, k] = by_size * room.by_sizes[2 * i + 1, k]
            if f > 0:
                seen.by_logs[row, i, k] += by_last * room.by_sizes[2 * i, k]
