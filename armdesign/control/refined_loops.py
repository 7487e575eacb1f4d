"""Loops on grids that are refined where figures are decided.

A grid has no frequency exactly where a margin is least or a response falls to −3 dB, and a
response may dip below −3 dB between two frequencies and rise again: its bandwidth ends there.
So gaps of the grid beside the largest ½(S − T) and S, beside the smallest of each response, and
about its first crossing of −3 dB are halved, again and again.
"""

from __future__ import annotations

import numpy as np

from armdesign.arrays import Array
from armdesign.control.controller import Controller
from armdesign.control.loop_plant import LoopPlant
from armdesign.control.loops import HALF, Loops, in_order
from armdesign.control.margins import balanced
from armdesign.control.stability import stability

PEAKS, DIPS = 3, 2  # of each matrix, and of each response
SIZES = 3  # of matrices, before those of responses
ROUNDS = 3  # of halving


def refined(plant: LoopPlant, loops: Loops, controller: Controller, rounds: int = ROUNDS) -> Loops:
    """The loops with further frequencies where figures of their controllers are decided.

    Args:
        plant: of n poses.
        loops: of them, on any grid.
        controller: of them.
        rounds: of halving.
    """
    added = [Loops.at(plant, stability(plant, controller).ringing)]
    omega, values = loops.omega, _values(loops, controller)
    for _ in range(rounds + 1):
        last = added[-1]
        more = _values(last, controller)
        omega, values = in_order([omega, last.omega], [values, more])
        if len(added) <= rounds:
            added.append(Loops.at(plant, _middles(omega, values)))
    return loops.joined(added)


def _values(loops: Loops, controller: Controller) -> Array:
    """Sizes of ½(S − T) at both openings and of S, and −1 × of responses (n, f, …)."""
    S_c, S, closed = loops.closed(controller)
    matrices = *(each - 0.5 * np.eye(each.shape[-1]) for each in (S_c, S)), S
    sizes = [np.linalg.norm(balanced(each), axis=(-2, -1))[..., None] for each in matrices]
    sizes += [-np.abs(each) for each in loops.responses(controller, S, closed)]
    return np.concatenate(sizes, axis=2)


def _middles(omega: Array, values: Array) -> Array:
    """Middles (n, m) [rad/s] of gaps of the grid (n, f) in which figures are decided."""
    values = np.moveaxis(values, 2, 0)
    parts = [_beside(size, PEAKS) for size in values[:SIZES]]
    for response in values[SIZES:]:
        first = (response > -HALF).argmax(axis=1)[:, None]
        parts.append(first - 1)
        before = (np.arange(omega.shape[1]) < first) | (first == 0)
        parts.append(_beside(np.where(before, response, -np.inf), DIPS))
    wanted = np.zeros(omega.shape, dtype=bool)
    gaps = np.concatenate(parts, axis=1).clip(0, omega.shape[1] - 2)
    np.put_along_axis(wanted, gaps, True, axis=1)
    most = wanted.sum(axis=1).max()  # of each pose as many, with others where it has fewer
    gaps = np.argsort(~wanted[:, :-1], axis=1, kind="stable")[:, :most]
    left, right = (np.take_along_axis(omega, gaps + side, axis=1) for side in (0, 1))
    return np.asarray(np.sqrt(left * right))


def _beside(values: Array, count: int) -> Array:
    """Gaps (n, 2 count) on both sides of the highest local maxima of values (n, f)."""
    inner = values[:, 1:-1]
    local = (inner >= values[:, :-2]) & (inner >= values[:, 2:])
    heights = np.where(local, inner, -np.inf)
    before = np.argpartition(-heights, count, axis=1)[:, :count]
    return np.concatenate([before, before + 1], axis=1)
