"""Sets of pins proved to hold no better design than one at hand, by upper bounds.

A bound on the designs of a set holds for all of its subsets: their other pins stay where they are
within their boxes. So sets are looked at from the largest down, and a bound of one spares those of
many. It holds for all sizes, or all of a catalogue, with lengths on no grid (``bound``).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping

from armdesign.design.bound.certificate import certificates_within_bands
from armdesign.design.search.sequential_sdp import Search

Pins = tuple[str, ...]  # key paths of pins that move
Bounds = Mapping[Pins, float]  # what no design of a set reaches more than [Hz]


def bounds_of_others(
    pins: Pins,
    searches: Mapping[Pins, Search],
    best: Mapping[Pins, float],
    workers: int,
    known: Bounds | None = None,
) -> dict[Pins, float]:
    """Bounds [Hz] on the sets beside the best of as many pins, sought until they are no more.

    Args:
        pins: all that can move.
        searches: of sets, at their ends.
        best: of the best set of each number of pins what its design reaches, as the bound [Hz].
        workers: processes that share the bounds.
        known: bounds at hand, which are not sought again.
    """
    bounds = dict(known or {})
    for chosen, reached in sorted(best.items(), key=lambda one: -len(one[0])):
        left = [
            some
            for some in others(pins, chosen)
            if some in searches and some not in bounds and most_of(some, bounds) > reached
        ]
        found = certificates_within_bands([searches[some] for some in left], workers, reached)
        bounds |= {some: one.frequency for some, one in zip(left, found, strict=True) if one}
    return bounds


def others(pins: Pins, chosen: Pins) -> list[Pins]:
    """All other sets of as many pins."""
    return [some for some in itertools.combinations(pins, len(chosen)) if some != chosen]


def most_of(some: Pins, bounds: Bounds) -> float:
    """The least bound of all sets that hold some pins [Hz]; infinite without one."""
    return min((b for wider, b in bounds.items() if {*some} <= {*wider}), default=math.inf)
