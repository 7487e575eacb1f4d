"""Compass search: the worst pose of every member of a family near to its machine's worst pose.

A number that changes by much may move the worst pose off its end stop, or a stop away from it.
Every member tries all directions at once: a joint alone, two against each other, along which a
link keeps its pitch, and some by chance, without which it would stay in a kink (Audet and Dennis
2006). It goes to the lowest place in stroke, with longer steps after a success and shorter ones
after none (Kolda, Lewis and Torczon 2003). One that begins out of stroke goes back into it first.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armdesign.arrays import Array, chunks
from armdesign.frequency.modes import lowest_frequency
from armdesign.influence.ends import Ends, all_ends, endless
from armdesign.influence.family import Family

FIRST, LAST = 0.02, 2e-5  # steps, over the joint's range
ROUNDS = 60  # at most
RANDOM, STILL = 8, 0.3  # directions by chance in each round, and share of joints that stay in them
ALLOWED = 1e-9  # room that a pose may lack
OUTSIDE = 1e6  # [Hz] above all frequencies: a pose out of stroke, the more the more it lacks


def lowest_near(family: Family, ends: Ends, q: Array) -> tuple[Array, Array]:
    """Lowest frequency (n,) [Hz] of every member near a worst pose (nq,), and where (n, nq).

    Each member may have a pose of its own (n, nq).
    NaN where no pose near that one, or near the one that follows its ends, is in stroke.
    """
    search = _Compass(family, _all(ends))
    best_q = ends.follow(family, q)
    limits = np.where(endless(ends.machine), [[-np.inf], [np.inf]], ends.machine.arm.limits.T)
    best_q = np.clip(best_q, *limits)
    best = search.frequencies(best_q, np.arange(family.count))
    start = np.broadcast_to(q, best_q.shape)
    other = search.frequencies(start, np.arange(family.count))
    best_q = np.where((other < best)[:, None], start, best_q)
    best = np.minimum(best, other)
    steps, random = np.full(family.count, FIRST), np.random.default_rng(0)
    for _ in range(ROUNDS):
        compass = search.directions(random)
        rows = np.flatnonzero((steps > LAST) & np.isfinite(best))
        if len(rows) == 0:
            break
        tried = best_q[rows, None] + steps[rows, None, None] * compass
        members = np.repeat(rows, len(compass))
        values = search.frequencies(tried.reshape(-1, q.shape[-1]), members)
        values = values.reshape(len(rows), -1)
        chosen = values.argmin(axis=1)
        lower = values[np.arange(len(rows)), chosen] < best[rows]
        better = rows[lower]
        best_q[better] = tried[lower, chosen[lower]]
        best[better] = values[lower, chosen[lower]]
        steps[rows] *= np.where(lower, 1.5, 0.4)
    return np.where(best < OUTSIDE, best, np.nan), best_q


def lowest_at(family: Family, ends: Ends, q: Array) -> Array:
    """Lowest frequency (n, m) [Hz] of every member at every pose (m, nq); see ``_Compass``."""
    search = _Compass(family, _all(ends))
    rows = np.arange(family.count * len(q))
    parts = (rows[some] for some in chunks(len(rows)))
    values = [search.frequencies(q[part % len(q)], part // len(q)) for part in parts]
    return np.concatenate(values).reshape(family.count, len(q))


def _all(ends: Ends) -> Ends:
    """Every end that a pose of the same machine may touch."""
    return replace(ends, ends=all_ends(ends.machine))


class _Compass:
    """Frequencies of members at poses, and the directions that are tried."""

    def __init__(self, family: Family, ends: Ends) -> None:
        self._family, self._ends = family, ends
        self._span = span = np.ptp(ends.machine.ranges, axis=1)
        unit = np.eye(len(span))
        pairs = [(i, j) for i in range(len(span)) for j in range(i)]
        against = [min(span[i], span[j]) * (unit[i] - unit[j]) for i, j in pairs]
        self._fixed = np.concatenate([np.diag(span), np.reshape(against, (-1, len(span)))])

    def directions(self, random: np.random.Generator) -> Array:
        """All directions of a round (d, nq), of length one over the joints' ranges."""
        chance = random.standard_normal((RANDOM, len(self._span)))
        unmoved = random.random(chance.shape) < STILL
        unmoved[unmoved.all(axis=1)] = False
        chance[unmoved] = 0.0
        chance /= np.linalg.norm(chance, axis=1)[:, None]
        ways = np.concatenate([self._fixed, chance * self._span])
        return np.concatenate([ways, -ways])

    def frequencies(self, q: Array, members: Array) -> Array:
        """Lowest frequency (m,) [Hz] of some members (m,) at poses (m, nq).

        Out of stroke above all others; inf where a linkage is open.
        """
        family = self._family.some(members)
        with np.errstate(invalid="ignore"):
            room = self._ends.room(family, q)
            inside = np.all(room >= -ALLOWED, axis=1)
            lack = np.where(np.isnan(room), np.inf, np.maximum(-room, 0.0)).sum(axis=1)
        values = OUTSIDE * (1 + lack)
        if inside.any():
            kept = self._family.some(members[inside])
            values[inside] = lowest_frequency(kept.at(q[inside], self._ends.machine.payload.name))
        return values
