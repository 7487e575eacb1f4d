"""Controllers of all rows of a bandwidth map; the rows with the lowest bandwidth searched longest.

Gains of their own are searched at every pose from the common gains, then from what has been found
there and at the poses next to it, on a grid of frequencies that has the resonances of the loops
found. The row with the least bandwidth is then searched from ``STARTS`` starts about all
these, until the lowest of the map is one that has been searched so ``SEARCHES`` times. It is still
a lower bound, as any search finds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armdesign.arrays import Array
from armdesign.control.map_parts import ControlOptions, MapPart
from armdesign.control.own_gains import OwnGains, neighbours
from armdesign.control.position_gains import individual
from armdesign.control.refined_loops import refined
from armdesign.control.stability import stability
from armdesign.control.tuning import Task, Tuned, damped, proportional, safe

PASSES = 1  # over all poses, from what those next to each have found
SEARCHES, STARTS = 2, 128  # of the lowest row, and the starts of each
ROUNDS = 0, 1  # of halving where loops found decide: of all rows, and of the lowest row
LEADERS = 2, 16  # of the starts of all rows, and of the lowest row, that are followed to the end
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
        own = searched(task, start, start[:, None]).or_wider(common)
        for _ in range(PASSES):
            x = _logarithms(task, own)
            starts = np.concatenate([x[:, None], x[near]], axis=1)
            again = searched(_where_decided(task, own, ROUNDS[0]), start, starts, LEADERS[0])
            own = again.or_wider(own)
        return cls(simple, alone, common, own.or_wider(alone), start, _logarithms(task, own))


def schemes(parts: Sequence[MapPart], options: ControlOptions) -> list[Schemes | None]:
    """Controllers at the poses of each part at which one can work; None where none can."""
    found = [Schemes.of(part.task(options)) if len(part.works) else None for part in parts]
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
        task = parts[part_of[row]].task(options, one)
        around = np.concatenate([start[[row]], x[[row]], x[near[row]]])
        starts = np.resize(around, (STARTS, x.shape[1]))
        starts = starts + AROUND * random.standard_normal(starts.shape)
        again = searched(
            _where_decided(task, each.own[one], ROUNDS[1]), start[[row]], starts[None], LEADERS[1]
        )
        searches[row] += 1
        if again.figures.narrowest[0] > width[row]:
            width[row], x[row] = again.figures.narrowest[0], _logarithms(task, again)[0]
            each.own = each.own.replaced(one, again)


def searched(task: Task, within: Array, starts: Array, leaders: int = 1) -> Tuned:
    """Controllers (n) with own gains, see ``OwnGains.improve``; 0 where none are found."""
    found = OwnGains(task)
    found.improve(within, starts, leaders)
    return safe(task, found.controller(task))


def _where_decided(task: Task, tuned: Tuned, rounds: int) -> Task:
    """The task on a grid with the frequencies that decide for loops found on another.

    A search goes where a grid has none. With no rounds these are resonances alone.
    """
    ringing = stability(task.plant, tuned.controller).ringing
    grid = refined(task.plant, task.loops, tuned.controller, ringing, rounds)
    return replace(task, loops=grid.joined)


def _logarithms(task: Task, tuned: Tuned) -> Array:
    gains = np.concatenate(task.without_units(tuned.controller), axis=1)
    return np.log(np.maximum(gains, FAINT))
