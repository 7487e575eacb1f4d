"""Gains of their own with pressure feedback, searched by an interior-point method.

The search of a pose begins at common gains, or at what its neighbours have found, and climbs by
Newton steps, of the logarithms x of all gains, on

    Φ(x) = F(x)/τ + Σ_ω log det(I − Y Yᴴ/limit²) + the same at the position errors,

where F is how fast the loops are and the rest, ``room``, goes to −∞ where the margin is lost (a
barrier; Y the balanced ½(S − T), see ``margins``). As τ falls, x follows a path between all limits
to where the loops are fastest (Boyd, Vandenberghe 2004, chapter 11), up to gains that none near
them exceed. Others far away may be better: what is found is a lower bound. All poses climb
at once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from armdesign.arrays import Array, Flags
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
LONGEST, SHORTEST, ANEW = 0.5, 2e-3, 0.1  # steps of logarithms that are trusted
GOOD, POOR, SHORTER = 0.6, 0.3, 1 / 3  # shares of a promised gain, and how much less is trusted
SETTLED, TRUSTED = 1.0, 0.9  # gain of Φ and share of the longest step below which τ falls
RIDGE, LEAST = 3.0, 0.1  # factor on what bends Φ more where steps are too long, and its least
DIFFERENCE = 1e-5  # of a logarithm, for slopes
FAR = 2.0  # by which logarithms of room are less at frequencies that count in slopes


@dataclass(frozen=True, eq=False)
class _Seen:
    """What is seen of the loops of m poses at some gains."""

    rooms: Array  # logarithms of the room at each frequency, of both openings (m, f)
    sizes: Array  # |T| of each loop (m, f, nq)
    crossed: Array  # first frequency at which it is below −3 dB (m, nq); f: at none
    logs: Array  # of bandwidths (m, nq)

    @property
    def holds(self) -> Flags:
        """Where the margin holds (m,)."""
        return np.asarray(self.rooms.min(axis=1) > -np.inf)

    def score(self, tau: Array | float) -> Array:
        """F: the narrowest log bandwidth, softened by τ, and a share of the mean of all (m,)."""
        least = self.logs.min(axis=1)
        with np.errstate(under="ignore"):
            wider = np.exp((least[:, None] - self.logs) / np.reshape(tau, (-1, 1)))
        return np.asarray(least - tau * np.log(wider.sum(axis=1)) + MEAN * self.logs.mean(axis=1))

    def value(self, tau: Array) -> Array:
        """Φ (m,)."""
        return np.asarray(self.score(tau) / tau + self.rooms.sum(axis=1))

    def __getitem__(self, rows: Array) -> _Seen:
        return _Seen(*(of[rows] for of in (self.rooms, self.sizes, self.crossed, self.logs)))

    def where(self, flags: Flags, other: _Seen) -> _Seen:
        """This at flagged poses (m,), the other at the rest."""
        names = ("rooms", "sizes", "crossed", "logs")
        pairs = ((getattr(self, name), getattr(other, name)) for name in names)
        return _Seen(*(np.where(flags, mine.T, theirs.T).T for mine, theirs in pairs))


class OwnGains:
    """Gains of their own at n poses, as they are found.

    Attributes:
        x: logarithms of κ and η (n, nq + nc).
        scores: how wide the loops are (n,); −∞ where no gains are known.
    """

    def __init__(self, task: Task) -> None:
        args = task.loops.arguments(task.controller(*map(np.ones, task.shapes)))
        self._units = np.concatenate([args.gains, args.pressure_gains], axis=1)
        self._loops = args._replace(
            gains=args.gains.copy(), pressure_gains=args.pressure_gains.copy()
        )
        self._omega, self._room = task.loops.omega, LoopRoom.of(task.loops)
        self._limit = 1 / (SPARE * task.aim.margin)
        self.x, self.scores = np.zeros(self._units.shape), np.full(len(self._units), -np.inf)

    def improve(self, starts: Array) -> None:
        """Search at all poses, from the best of starts: logarithms of gains (n, m, nq + nc)."""
        n = len(starts)
        start, best = np.zeros(self.x.shape), np.full(n, -np.inf)
        for given in np.moveaxis(starts, 1, 0):
            rows = np.flatnonzero(np.isfinite(given).all(axis=1))
            for share in SHARES:
                x = given[rows] + math.log(share)
                seen = self._look(rows, x)
                better = seen.holds & (seen.score(LAST) > best[rows])
                start[rows[better]], best[rows[better]] = x[better], seen.score(LAST)[better]
                rows = rows[~seen.holds]
        rows = np.flatnonzero(np.isfinite(best))
        x, scores = self._climb(rows, start[rows])
        better = scores > self.scores[rows]
        self.x[rows[better]], self.scores[rows[better]] = x[better], scores[better]

    def controller(self, task: Task) -> Controller:
        """The controllers found (n); gains 0 where none are."""
        gains = np.where(np.isfinite(self.scores)[:, None], np.exp(self.x), 0.0)
        nq = task.plant.joints
        return task.controller(gains[:, :nq], gains[:, nq:])

    def _climb(self, poses: Array, x: Array) -> tuple[Array, Array]:
        """The best gains on the paths from x (m, nq + nc), and their scores (m,)."""
        m = len(poses)
        top, best, x = x.copy(), np.full(m, -np.inf), x.copy()
        tau, trust, rows = np.full(m, FIRST), np.full(m, LONGEST), np.arange(m)
        seen, steps = self._look(poses, x), 0
        while len(rows) and steps < STEPS:
            slope, curvature = self._model(poses[rows], x[rows], seen, tau[rows])
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
            rows, seen = rows[on], seen[on]
        return top, best

    def _model(self, poses: Array, x: Array, seen: _Seen, tau: Array) -> tuple[Array, Array]:
        """Slope of Φ at x (m, n), and how it bends down (m, n, n); from first differences."""
        (m, n), (f, nq) = x.shape, seen.sizes.shape[1:]
        asked = seen.rooms < seen.rooms.max(axis=1, keepdims=True) - FAR
        crossed, each = np.minimum(seen.crossed, f - 1), np.arange(m)[:, None]
        asked[each, crossed] = asked[each, np.maximum(crossed - 1, 0)] = True
        more = np.repeat(x, n, axis=0) + DIFFERENCE * np.tile(np.eye(n), (m, 1))
        again = np.repeat(np.arange(m), n)
        rooms, sizes = seen.rooms[again], seen.sizes[again]
        self._write(poses[again], more, asked[again], rooms, sizes)
        logs = self._log_bandwidths(poses[again], sizes, seen.crossed[again])
        by_rooms = (rooms - seen.rooms[again]).clip(-1.0).reshape(m, n, f) / DIFFERENCE
        by_logs = (logs - seen.logs[again]).reshape(m, n, nq) / DIFFERENCE
        with np.errstate(under="ignore"):
            weights = np.exp((seen.logs.min(axis=1)[:, None] - seen.logs) / tau[:, None])
        weights /= weights.sum(axis=1, keepdims=True)
        mean = np.einsum("mi,mki->mk", weights, by_logs)
        slope = (mean + MEAN * by_logs.mean(axis=2)) / tau[:, None] + by_rooms.sum(axis=2)
        beside = (by_logs - mean[:, :, None]) * np.sqrt(weights)[:, None] / tau[:, None, None]
        bent = by_rooms @ np.swapaxes(by_rooms, 1, 2) + beside @ np.swapaxes(beside, 1, 2)
        return slope, bent + LEAST * np.eye(n)

    def _look(self, poses: Array, x: Array) -> _Seen:
        """What is seen of poses (m,) with gains of logarithms x (m, nq + nc)."""
        m, (f, nq) = len(poses), self._loops.positions.shape[1:3]
        rooms, sizes = np.zeros((m, f)), np.ones((m, f, nq))
        self._write(poses, x, np.ones((m, f), dtype=bool), rooms, sizes)
        below = sizes < HALF
        crossed = np.where(below.any(axis=1), below.argmax(axis=1), f)
        return _Seen(rooms, sizes, crossed, self._log_bandwidths(poses, sizes, crossed))

    def _write(self, poses: Array, x: Array, asked: Flags, rooms: Array, sizes: Array) -> None:
        gains = self._units[poses] * np.exp(x)
        _write_seen(self._loops, poses, gains, asked, self._limit, self._room, rooms, sizes)

    def _log_bandwidths(self, poses: Array, sizes: Array, crossed: Array) -> Array:
        """Logarithms of bandwidths (m, nq) of loops that cross −3 dB at given frequencies."""
        logs = np.empty(crossed.shape)
        _write_logs(self._omega, poses, sizes, crossed, logs)
        return logs


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
def _write_seen(
    loops: LoopArguments,
    poses: Array,
    gains: Array,
    asked: Flags,
    limit: float,
    room: LoopRoom,
    rooms: Array,
    sizes: Array,
) -> None:
    """Write room (m, f) and |T| (m, f, nq) at the frequencies that are asked for.

    After the first at which the margin is missed no others are looked at.
    """
    nq = len(room.S)
    for row in range(len(poses)):
        pose = poses[row]
        for i in range(gains.shape[1]):
            if i < nq:
                loops.gains[pose, i] = gains[row, i]
            else:
                loops.pressure_gains[pose, i - nq] = gains[row, i]
        for f in range(rooms.shape[1]):
            if asked[row, f]:
                close_loops(loops, pose, f, room)
                for i in range(nq):
                    sizes[row, f, i] = abs(1 - room.S[i, i])
                halve(room)
                rooms[row, f] = log_room(room.S_c, limit, room.command)
                rooms[row, f] += log_room(room.S, limit, room.position)
                if rooms[row, f] == -math.inf:
                    break


@borrowing
def _write_logs(omega: Array, poses: Array, sizes: Array, crossed: Array, logs: Array) -> None:
    """Write logarithms of bandwidths (m, nq) of loops that cross −3 dB at given frequencies."""
    count = omega.shape[1]
    for row in range(len(poses)):
        for i in range(logs.shape[1]):
            f, width = crossed[row, i], omega[poses[row], count - 1]
            if f < count:
                last = sizes[row, f - 1, i] if f > 0 else 1.0
                width = crossing(omega[poses[row]], f, last, sizes[row, f, i])
            logs[row, i] = math.log(width)
