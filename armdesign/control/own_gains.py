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
at once. The path may be followed in parts, and the grid of frequencies grow between them.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from armdesign.arrays import Array
from armdesign.control.loop_sight import Seen, Sight

if TYPE_CHECKING:
    from armdesign.control.tuning import Task

SPARE = 1.001  # of the margin, for what lies between the frequencies of a grid
SHARES = (0.97, 0.9, 0.7, 0.5, 0.3, 0.1)  # of gains that leave loops stable, of which one may hold
WAY = (0.0, 0.3, 0.6, 0.9, 0.97, 1.0)  # shares of the way from there to a start
MOST = math.log(3.0)  # κ and η: beyond, a loop may be unstable above all frequencies of a grid
NEIGHBOURS = 4
PATH = 0.02, 0.01, 3e-3, 1e-4  # τ of log bandwidths, at the ends of its parts
FALL = 0.4  # of τ
STEPS, RACE = 50, 2  # of a path, and of a race
LONGEST, SHORTEST, ANEW = 0.5, 2e-3, 0.1  # steps of logarithms that are trusted
GOOD, POOR, SHORTER = 0.6, 0.3, 1 / 3  # shares of a promised gain, and how much less is trusted
SETTLED, TRUSTED = 1.0, 0.9  # gain of Φ and share of the longest step below which τ falls
RIDGE = 3.0  # factor on what bends Φ more where steps are too long
FAR = 3.0  # factor by which rooms that count are less than the room of open loops


class OwnGains:
    """Search of gains of their own at n poses.

    Args:
        task: the loops, on a grid of frequencies.
        part: of the path that is followed, its first and last τ.
    """

    def __init__(self, task: Task, part: tuple[float, float]) -> None:
        self._first, self._last = part
        units, limit = task.controller(*map(np.ones, task.shapes)), 1 / (SPARE * task.aim.margin)
        self._units = np.concatenate([units.position, units.pressure], axis=1)
        near = max(1 - 0.25 / limit**2, 1e-9) ** self._units.shape[1] / FAR
        self._sight = Sight.of(task.loops, units, limit, near)

    def found(self, within: Array, starts: Array, leaders: int = 1) -> Array:
        """Logarithms of κ and η (n, nq + nc) from the best of starts.

        If need be after a race of a few steps. −∞ where nothing is found.

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
        best_of_pose = np.full(within.shape, -np.inf)
        best_of_pose[poses[rows[order]]] = x[order]
        return best_of_pose

    def narrowest(self, x: Array) -> Array:
        """Bandwidth of the narrowest loop (n,) [rad/s] of gains with logarithms x."""
        seen = self._look(np.arange(len(x)), x, sloped=False)
        return np.asarray(np.exp(seen.logs.min(axis=1)))

    def _inside(self, x: Array) -> Array:
        """The largest shares of gains that hold, logarithms (n, nq + nc); NaN where none does."""
        held, rows = np.full(x.shape, np.nan), np.arange(len(x))
        for share in SHARES:
            less = x[rows] + math.log(share)
            holds = self._look(rows, less, sloped=False).holds
            held[rows[holds]] = less[holds]
            rows = rows[~holds]
        return held

    def _walk(self, poses: Array, begin: Array, end: Array) -> tuple[Array, Array]:
        """How far gains hold on the way from those that do (m, nq + nc); scores, −∞ for none."""
        x, scores, end = begin.copy(), np.full(len(begin), -np.inf), np.minimum(end, MOST)
        rows = np.flatnonzero(np.isfinite(begin + end).all(axis=1))
        for share in WAY:
            tried = begin[rows] + share * (end[rows] - begin[rows])
            seen = self._look(poses[rows], tried, sloped=False)
            rows, holding = rows[seen.holds], seen.at(seen.holds)
            x[rows], scores[rows] = tried[seen.holds], holding.score(self._last)
        return x, scores

    def _climb(self, poses: Array, x: Array, most: int) -> tuple[Array, Array]:
        """The best gains on the paths from x (m, nq + nc), in so many steps; scores (m,)."""
        m = len(poses)
        seen, steps = self._look(poses, x), 0
        top, best, x = x.copy(), seen.score(self._last), x.copy()
        tau, trust, rows = np.full(m, self._first), np.full(m, LONGEST), np.arange(m)
        while len(rows) and steps < most:
            slope, curvature = seen.model(tau[rows])
            step = _steps(slope, curvature, trust[rows])
            tried = np.minimum(x[rows] + step, MOST)
            other = self._look(poses[rows], tried, sloped=steps + 1 < most)
            gained = other.value(tau[rows]) - seen.value(tau[rows])
            up = gained > 0
            seen, x[rows[up]] = other.where(up, seen), tried[up]
            score = seen.score(self._last)
            higher = up & (score > best[rows])
            best[rows[higher]], top[rows[higher]] = score[higher], tried[higher]
            promised = ((slope - np.einsum("mij,mj->mi", curvature, step) / 2) * step).sum(axis=1)
            length = np.linalg.norm(step, axis=1)
            trust[rows] = _trusted(trust[rows], length, gained / promised)
            settled = up & (promised < SETTLED) & (length < TRUSTED * trust[rows])
            settled |= trust[rows] < SHORTEST
            tau[rows[settled]] *= FALL
            trust[rows[settled]] = np.maximum(trust[rows[settled]], ANEW)
            on, steps = tau[rows] >= self._last, steps + 1
            rows, seen = rows[on], seen.at(on)
        return top, best

    def _look(self, poses: Array, x: Array, *, sloped: bool = True) -> Seen:
        """What is seen of poses (m,) with gains of logarithms x (m, nq + nc); slopes if wanted."""
        return self._sight.seen(poses, self._units[poses] * np.exp(x), sloped=sloped)


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
