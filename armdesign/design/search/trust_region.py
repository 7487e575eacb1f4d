"""Trust region: steps of linearised programmes, in a box that grows and shrinks with success.

A step is taken if it gains a tenth of what it promises. The box then grows where the programme
foresaw well; it shrinks after a step that is refused, or where the solver gave up.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np

from armdesign.arrays import Array
from armdesign.errors import InfeasibleError

TAKEN, FORESEEN = 0.1, 0.6  # shares of what is promised: a step is taken, the box may grow
GROWTH, SHRINKAGE, LARGEST = 2.0, 0.35, 0.5


class Point(Protocol):
    """A design and what it is compared by, the larger the better."""

    @property
    def x(self) -> Array:
        """The design vector."""

    @property
    def merit(self) -> float:
        """The larger the better."""


P = TypeVar("P", bound=Point)
Box = tuple[Array, Array]  # least and largest change of every entry of x
# from a point, within a box, with the trials refused there: a trial and its promise; None to end
Proposer = Callable[[P, Box, Sequence[P]], tuple[P, float] | None]


@dataclass(frozen=True)
class TrustRegion:
    """First radius of steps, the radius below which they end, and their largest number."""

    radius: float
    smallest: float
    steps: int


def box_around(x: Array, bounds: tuple[Array, Array], radius: float) -> Box:
    """Changes of x up to a radius that keep it within bounds."""
    return np.maximum(bounds[0] - x, -radius), np.minimum(bounds[1] - x, radius)


def ascend(point: P, step: Proposer[P], bounds: tuple[Array, Array], region: TrustRegion) -> P:
    """The point that steps lead to, each within the trust region."""
    radius = region.radius
    refused: list[P] = []
    for _ in range(region.steps):
        try:
            proposal = step(point, box_around(point.x, bounds, radius), refused)
        except InfeasibleError:  # the solver gave up: a smaller box is an easier programme
            radius *= SHRINKAGE
        else:
            if proposal is None:
                break
            trial, promised = proposal
            gained = trial.merit - point.merit
            if gained > TAKEN * promised:
                point, refused = trial, []
                radius = min(radius * (GROWTH if gained > FORESEEN * promised else 1.0), LARGEST)
            else:
                refused.append(trial)
                radius *= SHRINKAGE
        if radius < region.smallest:
            break
    return point
