"""Loops closed by their controllers, at some frequencies: margins, bandwidths and peaks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from armdesign.arrays import Array, Flags, Numbers, ReadOnly
from armdesign.control.margins import balanced, bound, largest_norms
from armdesign.simulation.plant.compiled import within

HALF = math.sqrt(0.5)  # −3 dB
MATRICES = 3  # that are balanced
TINY = 1e-100  # so that no response is divided by 0


@dataclass(frozen=True, eq=False)
class ClosedLoops(ReadOnly):
    """Closed loops of n poses, at frequencies of their own.

    Attributes:
        omega: frequencies, ascending (n, f) [rad/s].
        S_c: sensitivity at the commands (n, nc, nc, f).
        S: at the position errors (n, nq, nq, f).
        asked: responses of the loops to commands with feed-forward of the speed (n, nq, f).
    """

    omega: Array
    S_c: Array
    S: Array
    asked: Array

    @property
    def followed(self) -> Array:
        """T of each position loop (n, nq, f), the others closed."""
        each = range(self.S.shape[1])
        return np.asarray(1 - self.S[:, each, each])

    @cached_property
    def responses(self) -> Array:
        """T of each loop, and its response with feed-forward (n, 2 nq, f)."""
        return np.concatenate([self.followed, self.asked], axis=1)

    @cached_property
    def balanced(self) -> tuple[Array, ...]:
        """½(S − T) at the commands and at the position errors, and S there; see ``margins``."""
        halves = (each - 0.5 * np.eye(each.shape[1])[:, :, None] for each in (self.S_c, self.S))
        return tuple(balanced(each) for each in (*halves, self.S))

    @cached_property
    def sizes(self) -> Array:
        """Bounds of the norms of these three, and sizes of the responses (n, 3 + 2 nq, f)."""
        bounds = np.stack([bound(each) for each in self.balanced], axis=1)
        return np.concatenate([bounds, np.abs(self.responses)], axis=1)


class LoopFigures(NamedTuple):
    """Figures of closed loops at n poses."""

    command_margin: Array  # balanced disk margin at the commands of all valves (n,)
    position_margin: Array  # at all position errors (n,)
    loop_margins: Array  # of each position loop with the others closed (n, nq)
    bandwidth: Array  # of each loop, up to −3 dB (n, nq) [rad/s]
    command_bandwidth: Array  # the same of the command's response with feed-forward (n, nq)
    peak: Array  # of the sensitivity S of all loops (n,)

    @classmethod
    def none(cls, n: int, nq: int) -> LoopFigures:
        """Of n poses with nq loops that have no gains."""
        shapes = (n,), (n,), (n, nq), (n, nq), (n, nq), (n,)
        return cls(*map(np.zeros, shapes))

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


def figures_of(parts: Sequence[ClosedLoops]) -> LoopFigures:
    """Figures of loops (n), closed by the same controllers at the frequencies of several grids.

    0 at poses at which a loop has no gain.
    """
    command, position, peak = (_largest(parts, which) for which in range(MATRICES))
    omega, responses = in_order([(part.omega, part.responses) for part in parts])
    widths, nq = _bandwidths(omega, responses), parts[0].S.shape[1]
    own = np.abs(responses[:, :nq] - 0.5).max(axis=2)
    figures = 1 / command, 1 / position, 1 / own, widths[:, :nq], widths[:, nq:], peak
    closing = (responses[:, :nq] != 0).any(axis=2).all(axis=1)
    return LoopFigures(*((values.T * closing).T for values in figures))


def _largest(parts: Sequence[ClosedLoops], which: int) -> Array:
    """The largest norm (n,) of one of the matrices that are balanced, at all frequencies."""
    largest = np.zeros(len(parts[0].omega))
    for part in parts:
        largest = largest_norms(part.balanced[which], part.sizes[:, which], largest)
    return largest


def in_order(parts: Sequence[tuple[Array, Array]]) -> tuple[Array, Array]:
    """Frequencies (n, f) and values there (n, …, f) of several grids as one, ascending."""
    omega, values = (np.concatenate(of, axis=-1) for of in zip(*parts, strict=True))
    order = np.argsort(omega, axis=1, kind="stable")
    within = np.expand_dims(order, tuple(range(1, values.ndim - 1)))
    return np.take_along_axis(omega, order, 1), np.take_along_axis(values, within, -1)


def _bandwidths(omega: Array, responses: Array) -> Array:
    """Where responses (n, m, f) fall below −3 dB first (n, m) [rad/s].

    Between two frequencies their inverse is linear, as of a lag, however far these lie apart.
    """
    low = np.abs(responses) < HALF
    first = low.argmax(axis=2)[..., None]
    pair = np.maximum(first - [1, 0], 0)
    left, right = np.moveaxis(np.take_along_axis(omega[:, None], pair, 2), 2, 0)
    before, here = np.moveaxis(np.take_along_axis(responses, pair, 2), 2, 0)
    start, end = 1 / (before + TINY), 1 / (here + TINY)
    way = end - start  # |start + share · way|² = 2
    half, square = (start.conj() * way).real, np.abs(way) ** 2
    root = np.sqrt(np.maximum(half**2 + square * (2 - np.abs(start) ** 2), 0.0))
    between = left + (root - half) / np.maximum(square, TINY) * (right - left)
    below = below_all(right, np.minimum(np.abs(here), HALF))
    widths = np.where(first[..., 0] > 0, between, below)
    return np.where(low.any(axis=2), widths, omega[:, -1:])


@within
def below_all(omega: Numbers, size: Numbers) -> Numbers:
    """Frequency at −3 dB [rad/s] of a response of a size below it at the first frequency.

    Frequencies begin far below the modes, where it is a lag of first order.
    """
    return omega * size / np.sqrt(1 - size**2)
