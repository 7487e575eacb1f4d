"""Loops in the frequency domain: margins and responses of all controllers at once, compiled.

The loops are opened at two places, and margins hold at both: at the commands of the valves,
through which all that a controller asks for passes, and at the position errors, with the pressure
feedback closed:

    L_c = R K P + c H Y,     L_p = P (I + c H Y)⁻¹ R K

with P joint positions and Y load pressures by demanded piston speeds. One inverse is enough:

    (I + L_p)⁻¹ = I − P (I + L_c)⁻¹ R K
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from functools import cached_property
from typing import NamedTuple

import numpy as np

from armdesign.arrays import Array, Flags, ReadOnly
from armdesign.control.controller import Controller
from armdesign.control.loop_plant import LoopPlant
from armdesign.control.margins import Room, exceeds, invert, largest_norm
from armdesign.simulation.plant.compiled import borrowing, within

HALF = math.sqrt(0.5)  # −3 dB
# Frequencies below the modes and from there on, evenly on logarithmic scales; about each mode.
COARSE, FINE = (8, 42, 7), (12, 100, 11)
ABOUT = 2.5  # half the width of the frequencies about a mode, in ζω
DELAYED, EACH = 48, 0.5  # frequencies from 0 on behind a delay, and its turn between two [rad]


@dataclass(frozen=True, eq=False)
class Loops(ReadOnly):
    """Responses of the plants of n poses on frequency grids of their own; see the module.

    Attributes:
        omega: frequencies, ascending (n, f) [rad/s].
        positions: P (n, f, nq, nc).
        pressures: Y (n, f, nc, nc) [bar].
        moment_arms: R (n, nc, nq).
    """

    omega: Array
    positions: Array
    pressures: Array
    moment_arms: Array

    def __getitem__(self, rows: slice | Array) -> Loops:
        """The loops of some of the poses (slice, mask or indices)."""
        return Loops(*(getattr(self, field.name)[rows] for field in fields(self)))

    @classmethod
    def of(
        cls, plant: LoopPlant, counts: tuple[int, int, int] = COARSE, more: Array | None = None
    ) -> Loops:
        """The loops of plants, with frequencies on and about all modes.

        Args:
            plant: of n poses.
            counts: frequencies below the modes, among them, and about each one.
            more: further frequencies (n, m) [rad/s].
        """
        below, among, near = counts
        omega, ratio = 2 * math.pi * plant.frequencies, plant.damping
        low, high = plant.band
        middle = 0.4 * omega[:, 0]
        scales = [
            np.geomspace(low, middle, below, endpoint=False, axis=1),
            np.geomspace(middle, high, among, axis=1),
        ]
        if plant.delay and below:
            turns = EACH * np.arange(1, DELAYED + 1)
            scales.append(np.minimum(turns / plant.delay, high[:, None]))
        even = np.linspace(-1, 1, near)
        steps = ABOUT * even * np.abs(even)  # closest together at the peak
        width = np.minimum(ratio, 0.9 / ABOUT)
        about = omega[:, :, None] * (1 + width[:, :, None] * steps)
        parts = [*scales, about.reshape(len(plant), omega.shape[1] * near)]
        if more is not None:
            parts.append(more)
        return cls.at(plant, np.sort(np.concatenate(parts, axis=1), axis=1))

    @classmethod
    def at(cls, plant: LoopPlant, omega: Array) -> Loops:
        """The loops of plants at frequencies (n, f), ascending [rad/s]."""
        return cls(omega, *plant.response(omega), plant.moment_arms)

    def returned(self, controller: Controller) -> Array:
        """I + L_c (n, f, nc, nc): what a command meets that goes once around."""
        fed = controller.filtered(self.omega)[:, :, None] * controller.pressure[:, None]
        opened = self._wanted(controller) @ self.positions + fed[..., None] * self.pressures
        return np.asarray(np.eye(opened.shape[-1]) + opened)

    def followed(self, controller: Controller) -> Array:
        """T of each position loop (n, f, nq), the others closed."""
        moved = np.linalg.solve(self.returned(controller), self._wanted(controller) + 0j)
        return np.asarray(np.einsum("nfqc,nfcq->nfq", self.positions, moved))

    def _wanted(self, controller: Controller) -> Array:
        """R K (n, 1, nc, nq)."""
        return (self.moment_arms * controller.position[:, None])[:, None]

    def holds(self, controller: Controller, margin: float, rows: Array) -> Flags:
        """Whether all loops together keep a balanced disk margin at some of the poses (m,).

        Args:
            controller: of all poses.
            margin: the balanced disk margin α.
            rows: indices of the poses (m,).
        """
        keeps = np.empty(len(rows), dtype=bool)
        loops, room = self.arguments(controller), LoopRoom.of(self)
        _write_holds(loops, 1 / margin, rows, self._worst, room, keeps)
        return keeps

    @cached_property
    def _worst(self) -> Array:
        """The frequency of each pose that missed a margin last (n,): looked at first."""
        return np.zeros(len(self.omega), dtype=int)

    def figures(self, controller: Controller) -> LoopFigures:
        """Margins, bandwidths and peaks of the closed loops; 0 at poses without gains."""
        n, nq = len(self.omega), self.positions.shape[2]
        shapes = n, n, (n, nq), (n, nq), (n, nq), n
        figures = LoopFigures._make(np.zeros(shape) for shape in shapes)
        nc, count = self.positions.shape[3], len(self.omega.T)
        S_c, S = (np.empty((count, m, m), complex) for m in (nc, nq))
        _write_figures(
            self.arguments(controller),
            self.omega,
            LoopRoom.of(self),
            S_c,
            S,
            np.empty((2, nq)),
            figures,
        )
        closed = controller.position.all(axis=1)
        return LoopFigures(*((values.T * closed).T for values in figures))

    def arguments(self, controller: Controller) -> LoopArguments:
        """These loops with their controllers, for compiled code."""
        return LoopArguments(
            self.positions,
            self.pressures,
            self.moment_arms,
            np.ascontiguousarray(controller.position, dtype=float),
            np.ascontiguousarray(controller.pressure, dtype=float),
            controller.filtered(self.omega),
        )


class LoopFigures(NamedTuple):
    """Figures of closed loops at n poses."""

    command_margin: Array  # balanced disk margin at the commands of all valves (n,)
    position_margin: Array  # at all position errors (n,)
    loop_margins: Array  # of each position loop with the others closed (n, nq)
    bandwidth: Array  # of each loop, up to −3 dB (n, nq) [rad/s]
    command_bandwidth: Array  # the same of the command's response with feed-forward (n, nq)
    peak: Array  # of the sensitivity S of all loops (n,)

    def where(self, flags: Flags, other: LoopFigures) -> LoopFigures:
        """These figures at flagged poses (n,), at the rest the figures of other controllers."""
        pairs = zip(self, other, strict=True)
        return LoopFigures(*(np.where(flags, one.T, two.T).T for one, two in pairs))

    @property
    def narrowest(self) -> Array:
        """Bandwidth of the narrowest loop (n,) [rad/s]."""
        return np.asarray(self.bandwidth.min(axis=1))

    @property
    def margin(self) -> Array:
        """Balanced disk margin of all loops together (n,)."""
        return np.minimum(self.command_margin, self.position_margin)


class LoopArguments(NamedTuple):
    """Loops and their controllers, for compiled code."""

    positions: Array
    pressures: Array
    arms: Array
    gains: Array  # K (n, nq)
    pressure_gains: Array  # c (n, nc)
    filters: Array  # H (n, f)


class LoopRoom(NamedTuple):
    """What is computed of closed loops at one frequency, which compiled code may not make anew."""

    opened: Array  # I + L_c, which is spoilt (nc, nc)
    S_c: Array  # (I + L_c)⁻¹ (nc, nc)
    closed: Array  # P (I + L_c)⁻¹ R (nq, nq)
    S: Array  # (I + L_p)⁻¹ (nq, nq)
    command: Room  # for S_c
    position: Room  # for S

    @classmethod
    def of(cls, loops: Loops) -> LoopRoom:
        """For some loops."""
        nq, nc = loops.positions.shape[2:]
        opened, S_c, closed, S = (np.empty((m, m), complex) for m in (nc, nc, nq, nq))
        return cls(opened, S_c, closed, S, Room.of(nc), Room.of(nq))


@within
def close_loops(loops: LoopArguments, pose: int, f: int, room: LoopRoom) -> None:
    """Close the loops of a pose at its frequency f."""
    opened, S_c, closed, S = room.opened, room.S_c, room.closed, room.S
    nq, nc = loops.positions.shape[2], loops.positions.shape[3]
    P, Y, R = loops.positions[pose, f], loops.pressures[pose, f], loops.arms[pose]
    H, c, K = loops.filters[pose, f], loops.pressure_gains[pose], loops.gains[pose]
    for i in range(nc):
        for j in range(nc):
            opened[i, j] = c[i] * H * Y[i, j] + (1.0 if i == j else 0.0)
            for k in range(nq):
                opened[i, j] += R[i, k] * K[k] * P[k, j]
    invert(opened, S_c)
    for i in range(nq):
        closed[i] = 0.0
        for m in range(nc):
            total = 0j
            for k in range(nc):
                total += P[i, k] * S_c[k, m]
            for j in range(nq):
                closed[i, j] += total * R[m, j]
        for j in range(nq):
            S[i, j] = (1.0 if i == j else 0.0) - closed[i, j] * K[j]


@within
def crossing(omega: Array, f: int, last: float, size: float) -> float:
    """Frequency at which a response falls to −3 dB [rad/s], of frequencies omega (f,).

    Its size is below it at the frequency f for the first time, ``last`` at the one before.
    Below all frequencies, which begin far below the modes, it is a lag of first order.
    """
    if f == 0:
        return float(omega[0] * size / math.sqrt(1 - size**2))
    share = math.log(last / HALF) / math.log(last / size)
    return float(omega[f - 1] * (omega[f] / omega[f - 1]) ** share)


@within
def halve(room: LoopRoom) -> None:
    """Make ½(S − T) = S − ½ of S at both openings."""
    for i in range(len(room.S_c)):
        room.S_c[i, i] -= 0.5
    for i in range(len(room.S)):
        room.S[i, i] -= 0.5


@borrowing
def _write_holds(
    loops: LoopArguments, limit: float, rows: Array, worst: Array, room: LoopRoom, keeps: Flags
) -> None:
    for row in range(len(rows)):
        keeps[row] = True
        first = worst[rows[row]]
        for turn in range(loops.positions.shape[1]):
            f = first if turn == 0 else turn - 1 if turn <= first else turn
            close_loops(loops, rows[row], f, room)
            halve(room)
            command = exceeds(room.S_c, limit, room.command)
            if command or exceeds(room.S, limit, room.position):
                keeps[row], worst[rows[row]] = False, f
                break


@borrowing
def _write_figures(
    loops: LoopArguments,
    omega: Array,
    room: LoopRoom,
    S_c: Array,
    S: Array,
    last: Array,
    figures: LoopFigures,
) -> None:
    count, nq = S.shape[:2]
    for pose in range(len(omega)):
        for i in range(nq):
            last[0, i] = last[1, i] = 1.0
            figures.bandwidth[pose, i] = figures.command_bandwidth[pose, i] = 0.0
            figures.loop_margins[pose, i] = np.inf
        for f in range(count):
            close_loops(loops, pose, f, room)
            for i in range(nq):
                track = room.closed[i, i] * (loops.gains[pose, i] + 1j * omega[pose, f])
                followed = abs(1 - room.S[i, i])
                _cross(omega[pose], f, followed, last[0], figures.bandwidth[pose], i)
                widths = figures.command_bandwidth[pose]
                _cross(omega[pose], f, abs(track), last[1], widths, i)
                both = abs(room.S[i, i] - 0.5)
                figures.loop_margins[pose, i] = min(figures.loop_margins[pose, i], 1 / both)
            _keep(room.S, S, f)
            halve(room)
            _keep(room.S_c, S_c, f)
        figures.peak[pose] = largest_norm(S, room.position)
        figures.command_margin[pose] = 1 / largest_norm(S_c, room.command)
        for f in range(count):
            for i in range(nq):
                S[f, i, i] -= 0.5
        figures.position_margin[pose] = 1 / largest_norm(S, room.position)
        for i in range(nq):
            for widths in (figures.bandwidth[pose], figures.command_bandwidth[pose]):
                if widths[i] == 0.0:
                    widths[i] = omega[pose, count - 1]


@within
def _keep(matrix: Array, matrices: Array, f: int) -> None:
    """Write a matrix (m, m) among those of all frequencies (f, m, m)."""
    for i in range(len(matrix)):
        for j in range(len(matrix)):
            matrices[f, i, j] = matrix[i, j]


@within
def _cross(omega: Array, f: int, size: float, last: Array, widths: Array, i: int) -> None:
    """Write where the response of loop i, of this size at frequency f, falls below −3 dB first."""
    if widths[i] == 0.0 and size < HALF:
        widths[i] = crossing(omega, f, last[i], size)
    last[i] = size
