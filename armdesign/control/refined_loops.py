"""Loops on grids that are refined where figures are decided.

A grid has no frequency exactly where a margin is least or a response falls to −3 dB, and a
response may dip below −3 dB between two frequencies and rise again: its bandwidth ends there.
So gaps of the grid beside the largest ½(S − T) and S, beside the smallest of each response, and
about its first crossing of −3 dB are halved, again and again.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from armdesign.arrays import Array
from armdesign.control.closed_loops import (
    HALF,
    MATRICES,
    ClosedLoops,
    LoopFigures,
    figures_of,
    in_order,
)
from armdesign.control.controller import Controller
from armdesign.control.loop_plant import LoopPlant
from armdesign.control.loops import Loops

PEAKS, DIPS = 3, 2  # of each matrix, and of each response
ROUNDS = 3  # of halving


class RefinedLoops(NamedTuple):
    """Loops on a grid and at the frequencies that are added, and these closed."""

    loops: list[Loops]
    closed: list[ClosedLoops]

    @property
    def joined(self) -> Loops:
        """The loops at all frequencies."""
        return self.loops[0].joined(self.loops[1:])

    @property
    def figures(self) -> LoopFigures:
        """Figures of all closed loops."""
        return figures_of(self.closed)


def refined(
    plant: LoopPlant, loops: Loops, controller: Controller, ringing: Array, rounds: int = ROUNDS
) -> RefinedLoops:
    """The loops with further frequencies where figures of their controllers are decided.

    Args:
        plant: of n poses.
        loops: of them, on any grid.
        controller: of them.
        ringing: frequencies (n, m) at which the closed loops ring [rad/s], see ``stability``.
        rounds: of halving.
    """
    parts = [loops, Loops.at(plant, ringing)]
    closed = [part.closed(controller) for part in parts]
    for _ in range(rounds):
        parts.append(Loops.at(plant, _middles(closed)))
        closed.append(parts[-1].closed(controller))
    return RefinedLoops(parts, closed)


def _middles(closed: list[ClosedLoops]) -> Array:
    """Middles (n, m) [rad/s] of gaps of the grid in which figures are decided."""
    omega, sizes = in_order([(part.omega, part.sizes) for part in closed])
    bounds, levels = np.split(sizes, [MATRICES], axis=1)
    first = (levels < HALF).argmax(axis=2)[..., None]
    before = (np.arange(omega.shape[1]) < first) | (first == 0)
    dips = np.where(before, -levels, -np.inf)
    parts = _beside(bounds, PEAKS), _beside(dips, DIPS), first - 1
    gaps = np.concatenate([part.reshape(len(omega), -1) for part in parts], axis=1)
    wanted = np.zeros(omega.shape, dtype=bool)
    np.put_along_axis(wanted, gaps.clip(0, omega.shape[1] - 2), True, axis=1)
    most = wanted.sum(axis=1).max()  # of each pose as many, with others where it has fewer
    gaps = np.argsort(~wanted[:, :-1], axis=1, kind="stable")[:, :most]
    left, right = (np.take_along_axis(omega, gaps + side, axis=1) for side in (0, 1))
    return np.asarray(np.sqrt(left * right))


def _beside(values: Array, count: int) -> Array:
    """Gaps (n, m, 2 count) on both sides of the highest local maxima of values (n, m, f)."""
    inner = values[..., 1:-1]
    local = (inner >= values[..., :-2]) & (inner >= values[..., 2:])
    heights = np.where(local, inner, -np.inf)
    before = np.argpartition(-heights, count, axis=-1)[..., :count]
    return np.concatenate([before, before + 1], axis=-1)
