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
from armdesign.design.bound.regions import ENOUGH
from armdesign.design.search.sequential_sdp import Search
from armdesign.frequency.modes import hertz

Pins = tuple[str, ...]  # key paths of pins that move


def proved_sets(
    pins: Pins, searches: Mapping[Pins, Search], best: Mapping[Pins, float], workers: int
) -> dict[Pins, int]:
    """How many other sets of as many pins hold nothing better than the best design of each set.

    A bound is sought only where it may be low enough: as near to what the set's own search reached
    as those of larger sets came, or ``ENOUGH``.

    Args:
        pins: all that can move.
        searches: of sets, at their ends.
        best: of the best set of each number of pins what its design reaches, as the bound [Hz].
        workers: processes that share the bounds.
    """
    bounds: dict[Pins, float] = {}  # [Hz]
    gaps: dict[Pins, float] = {}
    proved: dict[Pins, int] = {}
    for chosen, reached in sorted(best.items(), key=lambda one: -len(one[0])):
        others = [some for some in itertools.combinations(pins, len(chosen)) if some != chosen]
        left = [some for some in others if not _bounded(some, bounds, reached)]
        tried = [
            some
            for some in left
            if some in searches and hertz(searches[some].squared) * _gap(some, gaps) <= reached
        ]
        known = certificates_within_bands([searches[some] for some in tried], workers)
        bounds |= {s: bound.frequency for s, bound in zip(tried, known, strict=True) if bound}
        gaps |= {s: bounds.get(s, math.inf) / hertz(searches[s].squared) for s in tried}
        proved[chosen] = sum(_bounded(some, bounds, reached) for some in others)
    return proved


def _bounded(some: Pins, bounds: Mapping[Pins, float], reached: float) -> bool:
    """Whether a bound of a set that holds all of some pins is no more than what is reached."""
    return any(bound <= reached and {*some} <= {*wider} for wider, bound in bounds.items())


def _gap(some: Pins, gaps: Mapping[Pins, float]) -> float:
    """A bound over what a search reached, at best: of larger sets, or where bounds end."""
    return min((gap for wider, gap in gaps.items() if {*some} < {*wider}), default=1 + ENOUGH)
