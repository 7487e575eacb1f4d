"""Sets of pins proved to hold no better design than one at hand, by upper bounds.

A bound on the designs of a set holds for all of its subsets: their other pins stay where they are
within their boxes. So sets are looked at from the largest down, and a bound of one spares those of
many. It holds for all sizes with lengths on no grid, or for all of a catalogue with lengths on the
drawing's (``drawn_lengths``). Where both pins of a cylinder move, its places are still on no grid:
then a set that can be built as well as the best may stay open, and its bound only says by how much
at most it may be better.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping

from armdesign.design.bound.certificate import certificates_within_bands
from armdesign.design.search.sequential_sdp import Search

Pins = tuple[str, ...]  # key paths of pins that move
Bounds = Mapping[Pins, float]  # what no design of a set reaches more than [Hz]
TOGETHER = 2  # sets, at least, whose bounds are sought at a time
NEAR = 0.005  # share above what is known of a set, where a bound that rules nothing out ends


def bounds_of_others(
    pins: Pins,
    searches: Mapping[Pins, Search],
    best: Mapping[Pins, float],
    workers: int,
    own: Mapping[Pins, float],
    drawn: bool,
    known: Bounds | None = None,
) -> dict[Pins, float]:
    """Bounds [Hz] on the sets beside the best of as many pins, sought until they are no more.

    Args:
        pins: all that can move.
        searches: of sets, at their ends.
        best: of the best set of each number of pins what its design reaches, as the bound [Hz].
        workers: processes that share the bounds.
        own: of sets with a design what it reaches [Hz]: as built where it is ``drawn``, else
            before its lengths are rounded.
        drawn: whether designs have sizes of a catalogue and lengths on the drawing's grid.
        known: bounds at hand, which are not sought again.
    """
    bounds = dict(known or {})
    largest_first = sorted(best.items(), key=lambda one: -len(one[0]))
    waiting = [
        (some, reached)
        for chosen, reached in largest_first
        for some in others(pins, chosen)
        if some in searches and some not in bounds
    ]
    while left := [
        (some, reached) for some, reached in waiting if most_of(some, bounds) > reached
    ]:
        as_many = [one for one in left if len(one[0]) == len(left[0][0])]
        looked_at = as_many if len(as_many) >= TOGETHER else left[:TOGETHER]
        wanted = [_wanted(own.get(some, 0.0), reached) for some, reached in looked_at]
        some_searches = [searches[some] for some, _ in looked_at]
        found = certificates_within_bands(some_searches, workers, wanted, drawn)
        bounds |= {
            some: one.above(own.get(some, 0.0)).frequency
            for (some, _), one in zip(looked_at, found, strict=True)
            if one
        }
        waiting = [one for one in left if one not in looked_at]
    return bounds


def _wanted(own: float, reached: float) -> float:
    """Where the bound on a set ends [Hz], of which a design of its own reaches so much."""
    return reached if own <= reached else own * (1 + NEAR)


def others(pins: Pins, chosen: Pins) -> list[Pins]:
    """All other sets of as many pins."""
    return [some for some in itertools.combinations(pins, len(chosen)) if some != chosen]


def most_of(some: Pins, bounds: Bounds) -> float:
    """The least bound of all sets that hold some pins [Hz]; infinite without one."""
    return min((b for wider, b in bounds.items() if {*some} <= {*wider}), default=math.inf)
