"""Controllers of all rows of a bandwidth map; the rows with the lowest bandwidth searched longest.

Gains of their own are searched at every pose from the common gains, then from what has been found
there and at the poses next to it, each time on the path's next part and a grid of frequencies that
has the resonances of the loops found. On the last part the grid grows at each pose until the loops
keep the margin between its frequencies too, and are as fast as they are on it. The row
with the least bandwidth is then searched from ``STARTS`` starts about all these, until the lowest
of the map is one that has been searched so ``SEARCHES`` times. It is still a lower bound, as any
search finds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from armdesign.arrays import Array
from armdesign.control.controller import Controller
from armdesign.control.map_parts import ControlOptions, MapPart
from armdesign.control.own_gains import PATH, OwnGains, neighbours
from armdesign.control.position_gains import individual
from armdesign.control.tuning import Task, Tuned, damped, keeping, proportional, safe
from armdesign.progress import counted
from armdesign.threads import in_threads

ALONE, BESIDE, LAST = pairwise(PATH)  # parts of the path: which starts there are, and the last
GROWTHS = 4  # of a grid on the last part, at most
AS_SEEN = 0.99  # of the bandwidth on a grid that loops have on a finer one, if it need not grow
LEADERS = 2  # of the starts of a row that are followed on the path's middle part
SEARCHES, STARTS = 2, 128  # of the lowest row, and the starts of each,
GROUPS = 16  # of these, the best of each of which is followed to the end
AROUND = 0.8  # spread of logarithms of gains from which they begin
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
        alone = individual(task, simple).or_wider(simple)
        common = damped(task).or_wider(simple)
        start, near = _logarithms(task, common), neighbours(task.plant.q)
        x = OwnGains(task, ALONE).found(start, start[:, None])
        starts = np.concatenate([x[:, None], x[near]], axis=1)
        own = searched(task, x, start, starts, LEADERS).or_wider(common)
        return cls(simple, alone, common, own.or_wider(alone), start, _logarithms(task, own))


def schemes(parts: Sequence[MapPart], options: ControlOptions) -> list[Schemes | None]:
    """Controllers at the poses of each part at which one can work; None where none can."""

    def found_at(part: MapPart) -> Schemes | None:
        return Schemes.of(part.task(options)) if len(part.works) else None

    found = list(counted(in_threads(found_at, parts), "part", len(parts)))
    pairs = [(part, each) for part, each in zip(parts, found, strict=True) if each]
    _raise_lowest([part for part, _ in pairs], [each for _, each in pairs], options)
    return found


def _raise_lowest(
    parts: Sequence[MapPart], found: Sequence[Schemes], options: ControlOptions
) -> None:
    """Search the lowest row longer, until the lowest of all has been searched so."""
    width = np.concatenate([each.own.figures.narrowest for each in found])
    start, x = (np.concatenate([getattr(each, name) for each in found]) for name in ("start", "x"))
    near = neighbours(np.concatenate([part.poses.q[part.works] for part in parts]))
    part_of = np.repeat(np.arange(len(parts)), [len(part.works) for part in parts])
    first = np.searchsorted(part_of, part_of)
    searches, random = np.zeros(len(width), dtype=int), np.random.default_rng(0)
    while searches[row := int(width.argmin())] < SEARCHES:
        each, one = found[part_of[row]], np.array([row - first[row]])
        task = parts[part_of[row]].task(options, one.repeat(GROUPS))
        around = np.concatenate([start[[row]], x[[row]], x[near[row]]])
        starts = np.resize(around, (GROUPS, STARTS // GROUPS, x.shape[1]))
        starts = starts + AROUND * random.standard_normal(starts.shape)
        known, within = (of[[row]].repeat(GROUPS, axis=0) for of in (x, start))
        again = searched(task, known, within, starts)
        best = np.array([again.figures.narrowest.argmax()])
        again, task = again[best], task[best]
        searches[row] += 1
        if again.figures.narrowest[0] > width[row]:
            width[row], x[row] = again.figures.narrowest[0], _logarithms(task, again)[0]
            each.own = each.own.replaced(one, again)


def searched(task: Task, x: Array, within: Array, starts: Array, leaders: int = 1) -> Tuned:
    """Controllers (n) with own gains, 0 where none are found.

    Args:
        task: their loops.
        x: logarithms of known gains (n, nq + nc): the grid has the frequencies that decide them.
        within: see ``OwnGains.found``.
        starts: see there.
        leaders: see there.
    """
    grown, left, found = task.grown(_with_gains(task, x)), np.arange(len(x)), task.resting
    x = OwnGains(grown, BESIDE).found(within, starts, leaders)
    for _ in range(GROWTHS):
        grown, width = grown.grown(_with_gains(grown, x[left])), np.zeros(len(x))
        search = OwnGains(grown, LAST)
        x[left] = search.found(x[left], x[left][:, None])
        holding, tuned = keeping(task, _with_gains(task, x), left)
        width[holding] = tuned.figures.narrowest
        found = found.replaced(holding, tuned.or_wider(found[holding]))
        on = width[left] < AS_SEEN * search.narrowest(x[left])
        left, grown = left[on], grown[on]
        if len(left) == 0:
            return found
    nothing = found.figures.narrowest == 0
    rest = safe(task[nothing], _with_gains(task, x)[nothing])
    return found.replaced(np.flatnonzero(nothing), rest)


def _with_gains(task: Task, x: Array) -> Controller:
    """The controllers of gains of logarithms x (n, nq + nc)."""
    return task.controller(*np.split(np.exp(x), [task.plant.joints], axis=1))


def _logarithms(task: Task, tuned: Tuned) -> Array:
    gains = np.concatenate(task.without_units(tuned.controller), axis=1)
    return np.log(np.maximum(gains, FAINT))
