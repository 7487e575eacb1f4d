"""The best sizes of a catalogue for given pins, and the proof that no combination is better.

Branch and bound: one cylinder after the other takes each of its sizes, branches whose separable
bound lies below what is reached are cut, and what is left is evaluated exactly.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from armdesign.arrays import Array
from armdesign.design.catalogue.separable import AllowedSizes
from armdesign.design.catalogue.separable_bound import ScaledPoses, scaled_poses, separable_bound
from armdesign.design.catalogue.sizes import Sizes
from armdesign.design.program.corners import Corners
from armdesign.design.search.semidefinite import contradicted
from armdesign.frequency.modes import hertz

# share below the bound that is looked at first, and times more each time
FIRST_DEPTH, DEEPER = 0.01, 3
LIMIT = 50_000  # combinations kept at a time
BATCH = 2_000  # combinations evaluated at a time
CHUNK = 100_000  # of their poses


@dataclass(frozen=True, eq=False, kw_only=True)
class SizeSelection:
    """The best combination found: bore and rod of every cylinder [m].

    Attributes:
        sizes: bore and rod of every cylinder [m].
        frequency: its worst frequency on the workspace's poses [Hz].
        bound: worst frequency that no combination exceeds [Hz]; equal to ``frequency`` where it is
            proved the best, infinite where nothing is proved.
        below: of what ``least`` chose: worst frequency that no combination exceeds which needs
            less [Hz]; it is proved the least where that is lower than the one asked for. None for
            the others.
    """

    sizes: Sizes
    frequency: float
    bound: float
    below: float | None = None


def select(allowed: AllowedSizes, corners: Corners | None = None) -> SizeSelection:
    """The sizes that raise the lowest frequency most, among all allowed combinations.

    Args:
        allowed: cylinders to choose from, on a machine whose pins, strokes and oil count.
        corners: of the bands at which frequencies count; None: all is exact.

    Raises:
        InfeasibleError: no combination meets the requirements.
    """
    judge = allowed.judge
    corners = corners or Corners(today=judge.today, workspace=judge.workspace)
    poses, reference = scaled_poses(judge.placed, corners)
    tree = BranchAndBound(allowed, poses, corners)
    best, bound, combination = tree.best()
    chosen = [sizes[o] for sizes, o in zip(allowed.cylinders, combination, strict=True)]
    return SizeSelection(
        sizes=tuple((c.bore, c.rod) for c in chosen),
        frequency=hertz(best * reference),
        bound=hertz(bound * reference),
    )


class BranchAndBound:
    """The search for the best combination, with the poses that have been lowest so far.

    Args:
        allowed: cylinders to choose from.
        poses: on which frequencies are judged.
        corners: of the bands, whose oil counts.
    """

    def __init__(self, allowed: AllowedSizes, poses: ScaledPoses, corners: Corners) -> None:
        self._allowed, self._poses, self._corners = allowed, poses, corners
        self.bound, rows = separable_bound(allowed, poses, corners)
        self._low = poses[rows]
        self._oil = self._low.oil(allowed.cylinders, corners)  # (sizes, low poses) of each

    def best(self) -> tuple[float, float, Array]:
        """Lowest λ of the best combination, the bound on all others, and its sizes (nc,).

        The bound is infinite where the best exceeds what the multipliers say of all.
        """
        reached, best, depth, tried = -math.inf, np.zeros(0, dtype=int), FIRST_DEPTH, math.inf
        largest = self.bound.largest
        while True:
            threshold = max(reached, largest - depth * max(abs(largest), 1.0))
            combinations, bounds, missed = self.above(threshold)
            fresh = bounds < tried
            reached, best = self._try(combinations[fresh], bounds[fresh], reached, best)
            if reached >= threshold or missed > reached or threshold < self.bound.least:
                break
            depth, tried = DEEPER * depth, threshold
        if len(best) == 0:
            count = math.prod(len(sizes) for sizes in self._allowed.cylinders)
            words = f"none of {count} combinations is allowed, as far as tried"
            raise self._allowed.refusal(words)
        refuted = contradicted(largest, reached)
        return reached, math.inf if refuted else max(reached, missed), best

    def above(self, threshold: float) -> tuple[Array, Array, float]:
        """Allowed combinations (k, nc) whose bound reaches a threshold, and their bounds.

        Last the bound of the best that was left out.
        """
        by_size, changes = self.bound.by_size, self._allowed.changes
        chosen, missed = np.zeros((1, 0), dtype=int), -math.inf
        bounds, slack = np.array([self.bound.constant]), self._allowed.slack[None]
        for i, (value, change) in enumerate(zip(by_size, changes, strict=True)):
            ahead = sum(float(later.max()) for later in by_size[i + 1 :])
            room = sum((later.max(axis=0) for later in changes[i + 1 :]), np.zeros(slack.shape[1]))
            total = bounds[:, None] + value
            fits = total + ahead >= threshold
            for k in range(slack.shape[1]):
                fits &= slack[:, None, k] + change[:, k] + room[k] >= 0
            before, size = np.nonzero(fits)
            if len(before) > LIMIT:
                order = np.argsort(-total[before, size])
                missed = max(missed, float(total[before, size][order[LIMIT]]) + ahead)
                before, size = before[order[:LIMIT]], size[order[:LIMIT]]
            chosen = np.column_stack([chosen[before], size])
            bounds, slack = total[before, size], slack[before] + change[size]
        return chosen, bounds, missed

    def evaluate(self, combination: Array) -> float:
        """Lowest λ of one combination over all poses; the lowest pose joins the low ones."""
        cylinders = [
            (sizes[o],) for sizes, o in zip(self._allowed.cylinders, combination, strict=True)
        ]
        oil = np.stack([k[0] for k in self._poses.oil(cylinders, self._corners)])
        lowest = self._poses.lowest_with(oil)
        row = np.array([int(lowest.argmin())])
        joining = self._poses[row]
        self._low = self._low.joined(joining)
        more = joining.oil(self._allowed.cylinders, self._corners)
        self._oil = [np.hstack(pair) for pair in zip(self._oil, more, strict=True)]
        return float(lowest[row[0]])

    def _try(
        self, combinations: Array, bounds: Array, reached: float, best: Array
    ) -> tuple[float, Array]:
        """The best of combinations, exact in order of bounds, or what was reached before."""
        order = np.argsort(-bounds, kind="stable")
        for start in range(0, len(order), BATCH):
            batch = order[start : start + BATCH]
            if bounds[batch[0]] < reached:
                break
            tried = combinations[batch]
            values = self._at_low_poses(tried)
            values[~self._allowed.meets(tried)] = -math.inf
            while values.max() > reached:
                first = int(values.argmax())
                value = self.evaluate(tried[first])
                if value > reached:
                    reached, best = value, tried[first]
                values = np.minimum(values, self._at_low_poses(tried, len(self._low) - 1))
                values[first] = -math.inf
        return reached, best

    def _at_low_poses(self, combinations: Array, first: int = 0) -> Array:
        """Lowest λ of combinations at the poses lowest so far, from the one numbered ``first``."""
        low = self._low[np.arange(first, len(self._low))]
        parts = []
        for part in np.array_split(combinations, max(1, len(combinations) * len(low) // CHUNK)):
            oil = np.stack([k[size, first:] for k, size in zip(self._oil, part.T, strict=True)])
            parts.append(low.lowest_with(oil).min(axis=1))
        return np.concatenate(parts)
