"""What is seen of loops at some gains, compiled: rooms to a limit, bandwidths, and their slopes.

The room is log det(I − Y Yᴴ/limit²), Y the balanced ½(S − T), see ``margins``; of it counts what
it is less than ``near``. Slopes are exact, see ``loop_slopes``. Nothing more is looked at once a
limit is exceeded, so that whether margins hold is seen by the same code.

Frequencies are looked at in blocks, see ``lanes``: first those at which the room counted when the
pose was looked at last, or a limit was exceeded; so other blocks need no rooms or no slopes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armdesign.arrays import Array, Flags
from armdesign.control.controller import Controller
from armdesign.control.lanes import LANES
from armdesign.control.loop_slopes import (
    SlopeRoom,
    clear_slopes,
    crossing_slopes,
    write_gain_slopes,
    write_room_slope,
    write_size_slope,
)
from armdesign.control.loops import (
    LEVEL,
    LoopArguments,
    LoopRoom,
    Loops,
    close_loops,
    crossing,
    halve,
    size_of,
)
from armdesign.control.margins import write_room, write_squared_norm
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
    ranks: Array  # of frequencies: 0 where the room counts, 1 where it might have, 2 (f,)
    norms: Array  # squared norms of ½(S − T) at both openings (2, lanes)
    sizes: Array  # |T| of each loop at the frequencies about −3 dB (2 nq,)
    by_sizes: Array  # slopes of their logarithms (2 nq, nq + nc)

    @classmethod
    def of(cls, loops: Loops) -> _Room:
        """For some loops."""
        nq, nc = loops.positions.shape[1:3]
        shapes = (2, LANES), 2 * nq, (2 * nq, nq + nc)
        rooms = LoopRoom.of(loops), SlopeRoom.of(loops)
        indices = np.empty(nq, int), np.empty(loops.omega.shape[1], int)
        return cls(*rooms, *indices, *(np.empty(shape) for shape in shapes))


class Sight(NamedTuple):
    """Loops that are looked at, for compiled code."""

    loops: LoopArguments  # whose gains are written
    omega: Array  # (n, f) [rad/s]
    limit: float  # of μ
    near: float  # room det(I − Y Yᴴ/limit²) of both openings above which it does not count
    order: Array  # of the frequencies of each pose, as they are looked at (n, f)
    room: _Room

    @classmethod
    def of(cls, loops: Loops, controller: Controller, limit: float, near: float) -> Sight:
        """Of loops with controllers of one filter, whatever their gains."""
        arguments = loops.arguments(controller)
        return cls(arguments, loops.omega, limit, near, loops.order, _Room.of(loops))

    def seen(self, poses: Array, gains: Array, *, sloped: bool = True) -> Seen:
        """What is seen of poses (m,) with gains K and c (m, nq + nc); slopes if wanted, else 0."""
        seen = Seen.empty(len(poses), self.loops.gains.shape[1], gains.shape[1])
        _write_seen(self, poses, gains, sloped, seen)
        return seen


def margins_hold(loops: Loops, controller: Controller, margin: float, rows: Array) -> Flags:
    """Whether all loops together keep a balanced disk margin at some of the poses (m,).

    Args:
        loops: of all poses.
        controller: of all poses.
        margin: the balanced disk margin α.
        rows: indices of the poses (m,).
    """
    return _seen(loops, controller, margin, rows).holds


def narrowest(loops: Loops, controller: Controller, margin: float, rows: Array) -> Array:
    """Bandwidth of the narrowest loop (m,) [rad/s], 0 where the margin is missed.

    Arguments as of ``margins_hold``.
    """
    seen = _seen(loops, controller, margin, rows)
    return np.where(seen.holds, np.exp(seen.logs.min(axis=1)), 0.0)


def _seen(loops: Loops, controller: Controller, margin: float, rows: Array) -> Seen:
    gains = np.concatenate([controller.position, controller.pressure], axis=1)
    sight = Sight.of(loops, controller, 1 / margin, LOST)
    return sight.seen(rows, gains[rows], sloped=False)


@borrowing
def _write_seen(sight: Sight, poses: Array, gains: Array, sloped: bool, seen: Seen) -> None:
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
        for start in range(0, count, LANES):
            if _look_at_block(sight, pose, start, seen, row) and sloped:
                _add_slopes(sight, pose, min(LANES, count - start), seen, row)
            if seen.rooms[row] == -math.inf:
                break
        if seen.rooms[row] > -math.inf:
            _sort(sight.order[pose], room.ranks)
            _look_at_crossings(loops, pose, count, sloped, room)
            logs, by_logs = seen.logs[row], seen.by_logs[row]
            _write_logs(sight.omega[pose], room.crossed, room.sizes, room.by_sizes, logs, by_logs)


@within
def _look_at_block(sight: Sight, pose: int, start: int, seen: Seen, row: int) -> bool:
    """Add the rooms of as many frequencies as there are lanes: whether their slopes count."""
    room, count = sight.room, sight.omega.shape[1]
    loop, lanes = room.loop, min(LANES, count - start)
    for lane in range(LANES):
        loop.which[lane] = sight.order[pose, min(start + lane, count - 1)]
    close_loops(sight.loops, pose, loop)
    for i in range(len(room.crossed)):
        for lane in range(lanes):
            if loop.which[lane] < room.crossed[i] and size_of(loop.S, i, lane) < LEVEL:
                room.crossed[i] = loop.which[lane]
    halve(loop.S_c, 0.5)
    halve(loop.S, 0.5)
    write_squared_norm(loop.S_c, room.norms[0])
    write_squared_norm(loop.S, room.norms[1])
    if not _any_near(room.norms, sight.limit, sight.near, loop.which[:lanes], room.ranks):
        return False
    write_room(loop.S_c, sight.limit, loop.command)
    write_room(loop.S, sight.limit, loop.position)
    left, order = loop.command.left, sight.order[pose]
    less = _less_than(sight.near, left, loop.position.left, order, start, room.ranks)
    seen.rooms[row] += less
    return -math.inf < less < 0.0


@within
def _any_near(norms: Array, limit: float, near: float, which: Array, ranks: Array) -> bool:
    """Whether the room may be less than ``near`` in any lane: det(I − Y Yᴴ) ≥ 1 − tr Y Yᴴ."""
    any_near = False
    for lane in range(len(which)):
        command = 1 - norms[0, lane] / limit**2
        position = 1 - norms[1, lane] / limit**2
        far = command > 0 and command * position > near
        ranks[which[lane]] = 2 if far else 1
        any_near |= not far
    return any_near


@within
def _less_than(
    near: float, command: Array, position: Array, order: Array, start: int, ranks: Array
) -> float:
    """How much less than ``near`` rooms of a block are, logarithms summed; −∞: one is missed."""
    less = 0.0
    for lane in range(min(LANES, len(order) - start)):
        left, f = command[lane] * position[lane], order[start + lane]
        if not left > 0.0:
            order[start + lane], order[0] = order[0], f
            return -math.inf
        if left < near:
            less += math.log(left / near)
            ranks[f] = 0
    return less


@within
def _sort(order: Array, ranks: Array) -> None:
    """Sort frequencies by rank, so that few blocks hold those that count."""
    place = 0
    for rank in range(3):
        for f in range(len(order)):
            if ranks[f] == rank:
                order[place] = f
                place += 1


@within
def _add_slopes(sight: Sight, pose: int, lanes: int, seen: Seen, row: int) -> None:
    """Add slopes of the rooms that are less than ``near``, and how they bend down."""
    loop, slopes, by_gains = sight.room.loop, sight.room.slopes, sight.room.slopes.by_gains
    write_room_slope(loop.command, slopes, slopes.command)
    write_room_slope(loop.position, slopes, slopes.position)
    halve(loop.S_c, -0.5)
    halve(loop.S, -0.5)
    write_gain_slopes(sight.loops, pose, loop, slopes)
    for lane in range(lanes):
        if loop.command.left[lane] * loop.position.left[lane] < sight.near:
            for i in range(len(by_gains)):
                slope = by_gains[i, lane]
                seen.slopes[row, i] += slope
                for j in range(len(by_gains)):
                    seen.bent[row, i, j] += slope * by_gains[j, lane]


@within
def _look_at_crossings(
    loops: LoopArguments, pose: int, count: int, sloped: bool, room: _Room
) -> None:
    """Write |T| of loops at the two frequencies about −3 dB of each, and slopes of its logarithm.

    Whatever where there are none.
    """
    loop, slopes, wanted = room.loop, room.slopes, len(room.sizes)
    for start in range(0, wanted, LANES):
        lanes = min(LANES, wanted - start)
        for lane in range(lanes):
            f = room.crossed[(start + lane) // 2] - 1 + lane % 2
            loop.which[lane] = min(max(f, 0), count - 1)
        close_loops(loops, pose, loop)
        for lane in range(lanes):
            room.sizes[start + lane] = size_of(loop.S, (start + lane) // 2, lane)
        if not sloped:
            continue
        clear_slopes(slopes)
        for lane in range(lanes):
            write_size_slope(loop.S, (start + lane) // 2, lane, slopes)
        write_gain_slopes(loops, pose, loop, slopes)
        for lane in range(lanes):
            for i in range(len(slopes.by_gains)):
                room.by_sizes[start + lane, i] = slopes.by_gains[i, lane]


@within
def _write_logs(
    omega: Array, crossed: Array, sizes: Array, by_sizes: Array, logs: Array, by_logs: Array
) -> None:
    """Write logarithms of bandwidths, and their slopes."""
    for i in range(len(crossed)):
        f = crossed[i]
        if f == len(omega):
            logs[i] = math.log(omega[f - 1])
            continue
        last, size = sizes[2 * i], sizes[2 * i + 1]
        logs[i] = math.log(crossing(omega, f, last, size))
        by_last, by_size = crossing_slopes(omega, f, last, size)
        for k in range(by_sizes.shape[1]):
            by_logs[i, k] = by_size * by_sizes[2 * i + 1, k]
            if f > 0:
                by_logs[i, k] += by_last * by_sizes[2 * i, k]
