"""Controllers of all rows of a bandwidth map; the rows with the lowest bandwidth searched longest.

Gains of their own are searched at every pose from the common gains and from what the poses next to
it have found. The rows with the least bandwidth are then searched again and again, until the
lowest has had ``STARTS`` searches more: the worst of the map no longer rests on the luck of one.
It is still a lower bound, as any search finds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armdesign.arrays import Array
from armdesign.control.map_parts import ControlOptions, MapPart
from armdesign.control.own_gains import OwnGains, neighbours
from armdesign.control.position_gains import individual
from armdesign.control.tuning import Task, Tuned, damped, proportional, safe

PASSES = 2  # over all poses, from what those next to each have found
STARTS, TOGETHER = 32, 8  # searches of the lowest rows, and how many rows at once
AROUND = 0.6  # spread of logarithms of gains from which they begin
FAINT = 1e-3  # κ and η from which a search begins where there are none


@dataclass
class Schemes:
    """Controllers of n poses: proportional, individual, damped and own."""

    proportional: Tuned
    individual: Tuned
    damped: Tuned
    own: Tuned
    start: Array  # logarithms of common gains (n, nq + nc)
    x: Array  # the same of own gains

    @classmethod
    def of(cls, task: Task) -> Schemes:
        """Of a task, each pose searched from common gains, then from its neighbours'."""
        simple = proportional(task)
        alone = individual(task, simple)
        common = damped(task).or_wider(simple)
        start = _logarithms(task, common)
        found, near = OwnGains(task), neighbours(task.plant.q)
        found.improve(start[:, None])
        for _ in range(PASSES):
            known = np.where(np.isfinite(found.scores)[:, None], found.x, np.nan)
            found.improve(known[near])
        own = safe(task, found.controller(task)).or_wider(common).or_wider(alone)
        return cls(simple, alone, common, own, start, _logarithms(task, own))


def schemes(parts: Sequence[MapPart], options: ControlOptions) -> list[Schemes | None]:
    """Controllers at the poses of each part at which one can work; None where none can."""
    found = [Schemes.of(part.task(options)) if len(part.works) else None for part in parts]
    pairs = [(part, each) for part, each in zip(parts, found, strict=True) if each]
    _raise_lowest([part for part, _ in pairs], [each for _, each in pairs], options)
    return found


def _raise_lowest(
    parts: Sequence[MapPart], found: Sequence[Schemes], options: ControlOptions
) -> None:
    """Search the lowest rows again, until the lowest of all has been searched enough."""
    width = np.concatenate([each.own.figures.narrowest for each in found])
    start, x = (np.concatenate([getattr(each, name) for each in found]) for name in ("start", "x"))
    near = neighbours(np.concatenate([part.poses.q[part.works] for part in parts]))
    ends = np.cumsum([0, *(len(part.works) for part in parts)])
    searched, random = np.zeros(len(width), dtype=int), np.random.default_rng(0)
    while len(rows := _next(width, searched)):
        spread = AROUND * random.standard_normal(x.shape)
        for part, each, first in zip(parts, found, ends, strict=False):
            some = rows[(rows >= first) & (rows < first + len(part.works))]
            if len(some):
                # In turn from common gains, and from the best known there and next to it.
                around = np.concatenate([x[some, None], x[near[some]]], axis=1)
                fresh = (searched[some] % 2 == 0)[:, None, None]
                starts = np.where(fresh, start[some, None], around)
                again, logs = _again(part.task(options, some - first), starts + spread[some, None])
                better = again.figures.narrowest > width[some]
                width[some[better]] = again.figures.narrowest[better]
                x[some[better]] = logs[better]
                each.own = each.own.replaced(some[better] - first, again[better])
        searched[rows] += 1


def _again(task: Task, starts: Array) -> tuple[Tuned, Array]:
    """Controllers (n) of one more search at each pose, and logarithms of their gains."""
    found = OwnGains(task)
    found.improve(starts)
    tuned = safe(task, found.controller(task))
    return tuned, _logarithms(task, tuned)


def _next(width: Array, searched: Array) -> Array:
    """The rows to search next: the lowest, but for those above one that was searched enough."""
    enough = searched >= STARTS
    bound = width[enough & (width > 0)].min(initial=np.inf)
    rows = np.flatnonzero(~enough & (width < bound))
    return rows[np.argsort(width[rows], kind="stable")[:TOGETHER]]


def _logarithms(task: Task, tuned: Tuned) -> Array:
    gains = np.concatenate(task.without_units(tuned.controller), axis=1)
    return np.log(np.maximum(gains, FAINT))
