"""What is seen of loops at some gains, compiled: rooms to a limit, bandwidths, and their slopes.

The room is log det(I − Y Yᴴ/limit²), Y the balanced ½(S − T), see ``margins``; of it counts what
it is less than ``near``. Slopes are exact, see ``loop_slopes``. Nothing more is looked at once a
limit is exceeded, so that whether margins hold is seen by the same code.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armdesign.arrays import Array, Flags
from armdesign.control.controller import Controller
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

MEAN = 0.1  # weight of the mean of all loops' bandwidths beside the narrowest
LEAST = 0.1  # that Φ bends down, see ``own_gains``
LOST = 1e-300  # room so small that only a margin that is lost has less: no other counts


class Seen(NamedTuple):
    """What is seen of the loops of m poses at some gains, of which there are k at each."""

    rooms: Array  # logarithms of the room at all frequencies and both openings, summed (m,)
    slopes: Array  # of these (m, k)
    bent: Array  # how they bend down (m, k, k)
    logs: Array  # of bandwidths (m, nq)
    by_logs: Array  # slopes of these (m, nq, k)

    @classmethod
    def empty(cls, m: int, nq: int, k: int) -> Seen:
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

    def at(self, rows: Array) -> Seen:
        """At some of the poses (mask or indices)."""
        return Seen(*(of[rows] for of in self))

    def where(self, flags: Flags, other: Seen) -> Seen:
        """This at flagged poses (m,), the other at the rest."""
        pairs = zip(self, other, strict=True)
        return Seen(*(np.where(flags, mine.T, theirs.T).T for mine, theirs in pairs))

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


class Sight(NamedTuple):
    """Loops that are looked at, for compiled code."""

    loops: LoopArguments  # whose gains are written
    omega: Array  # (n, f) [rad/s]
    limit: float  # of μ
    near: float  # room det(I − Y Yᴴ/limit²) of both openings above which it does not count
    worst: Array  # the frequency of each pose that missed the margin last (n,): looked at first
    room: _Room

    @classmethod
    def of(
        cls, loops: Loops, controller: Controller, limit: float, near: float, worst: Array
    ) -> Sight:
        """Of loops with controllers of one filter, whatever their gains."""
        arguments = loops.arguments(controller)
        return cls(arguments, loops.omega, limit, near, worst, _Room.of(loops))

    def seen(self, poses: Array, gains: Array) -> Seen:
        """What is seen of poses (m,) with gains K and c (m, nq + nc)."""
        seen = Seen.empty(len(poses), self.loops.gains.shape[1], gains.shape[1])
        _write_seen(self, poses, gains, seen)
        return seen


def margins_hold(loops: Loops, controller: Controller, margin: float, rows: Array) -> Flags:
    """Whether all loops together keep a balanced disk margin at some of the poses (m,).

    Args:
        loops: of all poses.
        controller: of all poses.
        margin: the balanced disk margin α.
        rows: indices of the poses (m,).
    """
    gains = np.concatenate([controller.position, controller.pressure], axis=1)
    sight = Sight.of(loops, controller, 1 / margin, LOST, loops.worst)
    return sight.seen(rows, gains[rows]).holds


@borrowing
def _write_seen(sight: Sight, poses: Array, gains: Array, seen: Seen) -> None:
    """Write what is seen of gains (m, nq + nc); nothing more once the margin is missed."""
    loops, room, count = sight.loops, sight.room, sight.omega.shape[1]
    nq = len(room.crossed)
    for row in range(len(poses)):
        pose = poses[row]
        for i in range(gains.shape[1]):
            if i < nq:
                room.crossed[i], loops.gains[pose, i] = count, gains[row, i]
            else:
                loops.pressure_gains[pose, i - nq] = gains[row, i]
        first = sight.worst[pose]
        for turn in range(count + 2 * nq):
            f = _frequency(turn, count, first, room.crossed)
            if f < 0:
                continue
            close_loops(loops, pose, f, room.loop)
            if turn < count:
                counts = _add_room(room, f, sight.limit, sight.near, seen, row)
            else:
                counts = _write_size(turn - count, room.loop.S, room.sizes, room.slopes)
            if seen.rooms[row] == -math.inf:
                sight.worst[pose] = f
                break
            if counts:
                write_gain_slopes(loops, pose, f, room.loop, room.slopes, room.by_gains)
                _keep_slopes(turn - count, room.by_gains, room.by_sizes, seen, row)
        if seen.rooms[row] > -math.inf:
            _write_logs(sight.omega[pose], room, seen, row)


@within
def _frequency(turn: int, count: int, first: int, crossed: Array) -> int:
    """All in turn, the ``first`` before; then two about −3 dB of each loop; −1 for none."""
    if turn < count:
        return first if turn == 0 else turn - 1 if turn <= first else turn
    f = crossed[(turn - count) // 2]
    return -1 if f == count else int(f - 1 + (turn - count) % 2)


@within
def _add_room(room: _Room, f: int, limit: float, near: float, seen: Seen, row: int) -> bool:
    """Add how much less than ``near`` the room at a frequency is; whether it is less."""
    loop, value = room.loop, -math.log(near)
    S_c, S = loop.S_c, loop.S
    for i in range(len(room.crossed)):
        if f < room.crossed[i] and size_of(S, i) < HALF:
            room.crossed[i] = f
    halve(S_c, 0.5)
    halve(S, 0.5)
    least = 1 - squared_norm(S_c) / limit**2, 1 - squared_norm(S) / limit**2
    if least[0] > 0 and least[0] * least[1] > near:  # det(I − Y Yᴴ) ≥ 1 − tr Y Yᴴ
        return False
    for opening in range(2):
        matrix, own = (S_c, loop.command) if opening == 0 else (S, loop.position)
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
    halve(S_c, -0.5)
    halve(S, -0.5)
    return True


@within
def _write_size(which: int, S: Array, sizes: Array, slopes: SlopeRoom) -> bool:
    """Write |T| of a loop at one of the two frequencies about −3 dB, and what it changes with."""
    sizes[which] = size_of(S, which // 2)
    write_size_slope(S, which // 2, slopes)
    return True


@within
def _keep_slopes(which: int, by_gains: Array, by_sizes: Array, seen: Seen, row: int) -> None:
    """Add slopes of the room, or keep those of one of the sizes about −3 dB."""
    for i in range(len(by_gains)):
        if which >= 0:
            by_sizes[which, i] = by_gains[i]
        else:
            seen.slopes[row, i] += by_gains[i]
            for j in range(len(by_gains)):
                seen.bent[row, i, j] += by_gains[i] * by_gains[j]


@within
def _write_logs(omega: Array, room: _Room, seen: Seen, row: int) -> None:
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
