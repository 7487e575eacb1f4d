"""Stability of closed loops, and where they ring.

Without a delay by the poles. A delay has no finite state space; behind one the turns of

    d(jω) = det(I + L_c(jω))

about 0 are counted (Nyquist, Barkhausen, MacFarlane): open loops have no poles to the right but
those with which pressures creep, below all frequencies of the grid. At its ends all eigenvalues of
I + L_c lie right of the imaginary axis, position loops being lags at the lower and L_c small at
the higher one, so that d stands at the sum of their angles. The loops are stable if d has turned
from the one to the other sum and not by 2π more. Between frequencies at which d turns much, or
the delay where loops are loud, others are added in the middle: they are those at which the loops
ring.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armdesign.arrays import Array, Flags
from armdesign.control.controller import Controller, closed_loop
from armdesign.control.loop_plant import LoopPlant
from armdesign.control.loops import FINE, Loops

TURN = 0.6  # rad, of d or of a delay between two frequencies
LOUD = 0.3  # |d − 1| of loops whose phase matters
CLOSE = 1e-9  # [ω] frequencies that are not told apart: poles on the axis
AROUND = np.linspace(-1.5, 1.5, 7)  # frequencies about a pole, by half its width


class Stability(NamedTuple):
    """Whether the closed loops of n poses are stable, and frequencies (n, m) where they ring."""

    stable: Flags
    ringing: Array  # [rad/s]


def stable(plant: LoopPlant, controller: Controller) -> Flags:
    """Whether each closed loop is stable (n,), but for what creeps anyway."""
    if plant.delay:
        return stability(plant, controller).stable
    return _decays(plant, np.linalg.eigvals(closed_loop(plant, controller)[0]))


def stability(plant: LoopPlant, controller: Controller) -> Stability:
    """Whether each closed loop is stable, but for what creeps anyway, and where it rings most."""
    if not plant.delay:
        poles = np.linalg.eigvals(closed_loop(plant, controller)[0])
        return Stability(_decays(plant, poles), _about(plant, poles))
    loops = Loops.of(plant, FINE)
    turned, added = _turned(plant, controller, loops)
    returned = loops.returned(controller)
    ends = [np.angle(np.linalg.eigvals(returned[:, f])).sum(axis=1) for f in (0, -1)]
    return Stability(np.abs(turned - ends[1] + ends[0]) < math.pi, added)


def _decays(plant: LoopPlant, poles: Array) -> Flags:
    return np.asarray(poles.real.max(axis=1) < plant.fastest_creep)


def _about(plant: LoopPlant, poles: Array) -> Array:
    """Frequencies (n, m) at and about the poles that ring most."""
    low, high = plant.band
    ratio = -poles.real / (np.abs(poles) + 1e-9 * low[:, None])
    rows = np.argsort(ratio, axis=1)[:, : 4 * plant.frequencies.shape[1] : 2]  # one of each pair
    peaks, wide = (np.take_along_axis(of, rows, axis=1) for of in (np.abs(poles), ratio))
    wide = np.clip(np.abs(wide), 0.0, 0.5)[:, :, None] * AROUND
    about = (peaks[:, :, None] * (1 + wide)).reshape(len(plant), rows.shape[1] * len(AROUND))
    return np.asarray(np.clip(about, low[:, None], high[:, None]))


def _turned(plant: LoopPlant, controller: Controller, loops: Loops) -> tuple[Array, Array]:
    """Angle by which d turns (n,) [rad], and frequencies added on the way (n, m)."""
    determinants, n = np.linalg.det(loops.returned(controller)), len(plant)
    pose = np.repeat(np.arange(n), loops.omega.shape[1] - 1)
    left, right = loops.omega[:, :-1].ravel(), loops.omega[:, 1:].ravel()
    from_, to = determinants[:, :-1].ravel(), determinants[:, 1:].ravel()
    turned, added = np.zeros(n), [(pose[:0], left[:0])]
    while len(pose):
        step = np.angle(to / from_)
        loud = np.maximum(np.abs(from_ - 1), np.abs(to - 1)) > LOUD
        wide = (np.abs(step) > TURN) | (loud & ((right - left) * plant.delay > TURN))
        wide &= right - left > CLOSE * right
        np.add.at(turned, pose[~wide], step[~wide])
        pose, left, right, from_, to = (each[wide] for each in (pose, left, right, from_, to))
        middle = (left + right) / 2
        between = Loops.at(plant[pose], middle[:, None])
        here = np.linalg.det(between.returned(controller[pose]))[:, 0]
        added.append((pose, middle))
        pose = np.concatenate([pose, pose])
        left, right = np.concatenate([left, middle]), np.concatenate([middle, right])
        from_, to = np.concatenate([from_, here]), np.concatenate([here, to])
    poses, frequencies = (np.concatenate(parts) for parts in zip(*added, strict=True))
    return turned, _in_rows(poses, frequencies, loops.omega[:, -1])


def _in_rows(poses: Array, frequencies: Array, fill: Array) -> Array:
    """Frequencies of poses (n, m), filled up by one of each pose (n,)."""
    order = np.argsort(poses, kind="stable")
    counts = np.bincount(poses, minlength=len(fill))
    column = np.arange(len(poses)) - np.repeat(np.cumsum(counts) - counts, counts)
    rows = np.repeat(fill[:, None], counts.max(initial=0), axis=1)
    rows[poses[order], column] = frequencies[order]
    return rows
