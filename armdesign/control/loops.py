"""Loops in the frequency domain: of all controllers at once, opened and closed.

The loops are opened at two places, and margins hold at both: at the commands of the valves,
through which all that a controller asks for passes, and at the position errors, with the pressure
feedback closed:

    L_c = R K P + c H Y,     L_p = P (I + c H Y)⁻¹ R K

with P joint positions and Y load pressures by demanded piston speeds. One inverse is enough:

    (I + L_p)⁻¹ = I − P (I + L_c)⁻¹ R K
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import NamedTuple

import numpy as np

from armdesign.arrays import Array, ReadOnly
from armdesign.control.closed_loops import (
    HALF,
    ClosedLoops,
    LoopFigures,
    below_all,
    figures_of,
    in_order,
)
from armdesign.control.controller import Controller
from armdesign.control.lanes import LANES, add_scaled, fill, invert, write_product
from armdesign.control.loop_plant import LoopPlant
from armdesign.control.margins import Room
from armdesign.simulation.plant.compiled import within

# Frequencies below the modes and from there on, evenly on logarithmic scales; about each mode.
COARSE, FINE = (8, 42, 7), (12, 100, 11)
LEVEL = 1.0005 * HALF  # for a search, so that what dips between frequencies stays above −3 dB
ABOUT = 2.5  # half the width of the frequencies about a mode, in ζω
DELAYED, EACH = 48, 0.5  # frequencies from 0 on behind a delay, and its turn between two [rad]


@dataclass(frozen=True, eq=False)
class Loops(ReadOnly):
    """Responses of the plants of n poses on frequency grids of their own; see the module.

    Attributes:
        omega: frequencies, ascending (n, f) [rad/s].
        positions: P (n, nq, nc, f).
        pressures: Y (n, nc, nc, f) [bar].
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
        middle = 0.4 * plant.slowest
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
        n, nq, nc, f = self.positions.shape
        wanted = self.moment_arms * controller.position[:, None]
        opened = (wanted @ self.positions.reshape(n, nq, nc * f)).reshape(self.pressures.shape)
        fed = controller.pressure[:, :, None] * controller.filtered(self.omega)[:, None]
        opened += fed[:, :, None] * self.pressures
        opened[:, range(nc), range(nc)] += 1
        return np.moveaxis(opened, -1, 1)

    @cached_property
    def order(self) -> Array:
        """The order in which the frequencies of each pose are looked at (n, f)."""
        return np.tile(np.arange(self.omega.shape[1]), (len(self.omega), 1))

    def joined(self, others: Sequence[Loops]) -> Loops:
        """The loops of the same plants at these frequencies and at those of others."""
        parts = [self, *others]
        omega, positions = in_order([(each.omega, each.positions) for each in parts])
        pressures = in_order([(each.omega, each.pressures) for each in parts])[1]
        return Loops(omega, positions, pressures, self.moment_arms)

    def closed(self, controller: Controller) -> ClosedLoops:
        """The loops closed by controllers."""
        S_c = np.ascontiguousarray(np.moveaxis(np.linalg.inv(self.returned(controller)), 1, -1))
        moved = np.einsum("nqcf,ncdf->nqdf", self.positions, S_c)
        closed = np.swapaxes(self.moment_arms, 1, 2)[:, None] @ moved
        K, each = controller.position, range(closed.shape[1])
        S = np.eye(len(each))[:, :, None] - closed * K[:, None, :, None]
        asked = closed[:, each, each] * (K[:, :, None] + 1j * self.omega[:, None])
        return ClosedLoops(self.omega, S_c, S, asked)

    def figures(self, controller: Controller) -> LoopFigures:
        """Margins, bandwidths and peaks of the closed loops; 0 at poses without gains."""
        return figures_of([self.closed(controller)])

    def arguments(self, controller: Controller) -> LoopArguments:
        """These loops with copies of their controllers' gains, for compiled code."""
        return LoopArguments(
            self.positions,
            controller.filtered(self.omega)[:, None, None] * self.pressures,
            np.ascontiguousarray(self.moment_arms),
            np.array(controller.position, dtype=float, order="C"),
            np.array(controller.pressure, dtype=float, order="C"),
        )


class LoopArguments(NamedTuple):
    """Loops and their controllers, for compiled code."""

    positions: Array  # P (n, nq, nc, f)
    pressures: Array  # H Y (n, nc, nc, f)
    arms: Array  # R (n, nc, nq)
    gains: Array  # K (n, nq)
    pressure_gains: Array  # c (n, nc)


class LoopRoom(NamedTuple):
    """What is computed of closed loops at some frequencies, which compiled code may not make anew.

    The last axis of arrays is the lane, see ``lanes``.
    """

    which: Array  # indices of the frequencies (lanes,)
    positions: Array  # P (nq, nc, lanes)
    pressures: Array  # H Y (nc, nc, lanes)
    opened: Array  # I + L_c, which is spoilt (nc, nc, lanes)
    S_c: Array  # (I + L_c)⁻¹ (nc, nc, lanes)
    moved: Array  # P (I + L_c)⁻¹ (nq, nc, lanes)
    closed: Array  # P (I + L_c)⁻¹ R (nq, nq, lanes)
    S: Array  # (I + L_p)⁻¹ (nq, nq, lanes)
    factor: Array  # for inverses (lanes,)
    command: Room  # for S_c
    position: Room  # for S

    @classmethod
    def of(cls, loops: Loops) -> LoopRoom:
        """For some loops."""
        nq, nc = loops.positions.shape[1:3]
        shapes = (nq, nc), (nc, nc), (nc, nc), (nc, nc), (nq, nc), (nq, nq), (nq, nq), ()
        made = [np.empty((*shape, LANES), complex) for shape in shapes]
        return cls._make([np.zeros(LANES, int), *made, Room.of(nc), Room.of(nq)])


@within
def close_loops(loops: LoopArguments, pose: int, room: LoopRoom) -> None:
    """Close the loops of a pose at the frequencies of a room."""
    P, S_c, closed, S = room.positions, room.S_c, room.closed, room.S
    R, K = loops.arms[pose], loops.gains[pose]
    _take(loops.positions[pose], room.which, P)
    _take(loops.pressures[pose], room.which, room.pressures)
    _write_opened(R, K, loops.pressure_gains[pose], P, room.pressures, room.opened)
    invert(room.opened, S_c, room.factor)
    write_product(room.moved, P, S_c)
    for i in range(len(K)):
        for j in range(len(K)):
            fill(closed[i, j], 0.0)
            for m in range(len(R)):
                if R[m, j] != 0.0:
                    add_scaled(closed[i, j], R[m, j], room.moved[i, m])
            fill(S[i, j], 1.0 if i == j else 0.0)
            add_scaled(S[i, j], -K[j], closed[i, j])


@within
def _take(values: Array, which: Array, out: Array) -> None:
    """Copy matrices (m, n, f) at some frequencies (lanes,) to (m, n, lanes)."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            for lane in range(LANES):
                out[i, j, lane] = values[i, j, which[lane]]


@within
def _write_opened(R: Array, K: Array, c: Array, P: Array, Y: Array, out: Array) -> None:
    """Write I + L_c (nc, nc, lanes)."""
    for i in range(len(c)):
        for j in range(len(c)):
            opened = out[i, j]
            fill(opened, 1.0 if i == j else 0.0)
            add_scaled(opened, c[i], Y[i, j])
            for k in range(len(K)):
                if R[i, k] != 0.0:
                    add_scaled(opened, R[i, k] * K[k], P[k, j])


@within
def size_of(S: Array, i: int, lane: int) -> float:
    """|T| of a position loop in a lane, the others closed."""
    T = 1 - S[i, i, lane]
    return math.sqrt(T.real * T.real + T.imag * T.imag)  # three times as fast as abs


@within
def crossing(omega: Array, f: int, last: float, size: float) -> float:
    """Frequency at which a response falls to ``LEVEL`` [rad/s], of frequencies omega (f,).

    Its size is below it at the frequency f for the first time, ``last`` at the one before. Between
    them it is straight on logarithmic scales, which is near enough for a search.
    """
    if f == 0:
        return float(below_all(omega[0], size))
    share = math.log(last / LEVEL) / math.log(last / size)
    return float(omega[f - 1] * (omega[f] / omega[f - 1]) ** share)


@within
def halve(S: Array, half: float) -> None:
    """Make ½(S − T) = S − ½ of S (m, m, lanes); with −½ again S of it."""
    for i in range(len(S)):
        for lane in range(LANES):
            S[i, i, lane] -= half
