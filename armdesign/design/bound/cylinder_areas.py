"""Areas that one cylinder may have: any between two ends, or of the sizes of a catalogue."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armdesign.arrays import Array
from armdesign.design.catalogue.sizes import areas_of_sizes, offered
from armdesign.design.program.constraints import CONSTRAINT_TOLERANCE
from armdesign.design.program.problem import Problem
from armdesign.machine.file.schema import share_of


@dataclass(frozen=True, eq=False)
class CylinderAreas:
    """Bore and annulus areas of one cylinder; sides are cap and annulus.

    Attributes:
        ends: least and largest (2, 2: ends, sides) [m²].
        pairs: the only ones (p, 2) [m²], of a catalogue, or as today's where neither bore nor rod
            varies; None where any between the ends may be.
    """

    ends: Array
    pairs: Array | None = None

    @classmethod
    def of(cls, problem: Problem, i: int) -> CylinderAreas | None:
        """Those of cylinder ``i`` that its thrust allows, wider by ``CONSTRAINT_TOLERANCE``.

        None where it allows no size of the catalogue.
        """
        vector, cylinder, more = problem.vector, problem.machine.cylinders[i], CONSTRAINT_TOLERANCE
        today = vector.areas_today[i]
        share = share_of(problem.requirements.thrust_share, cylinder.name)
        most = np.array([share * today[0], np.inf])
        if any(vector.resized[i]) and not problem.grid.sizes:
            # an annulus may follow its bore
            low, high = (vector.areas(end)[i] for end in problem.bounds)
            return cls(np.stack([low / (1 + more), np.minimum(high, most) * (1 + more)]))
        sizes = offered(cylinder, problem.grid.sizes, *vector.resized[i])
        pairs = areas_of_sizes(cylinder, sizes)
        return cls.of_pairs(pairs[np.all(pairs <= most * (1 + more), axis=1)])

    @classmethod
    def of_pairs(cls, pairs: Array) -> CylinderAreas | None:
        """These pairs; None if there are none."""
        if len(pairs) == 0:
            return None
        return cls(np.stack([pairs.min(axis=0), pairs.max(axis=0)]), pairs)

    def nearest(self, areas: Array) -> Array:
        """The pair nearest to each of some areas (m, 2)."""
        assert self.pairs is not None
        return self.pairs[np.abs(self.pairs - areas[:, None]).sum(axis=2).argmin(axis=1)]

    def within(self, low: Array, high: Array) -> CylinderAreas | None:
        """The pairs between ends (2,); None if there are none."""
        assert self.pairs is not None
        inside = np.all((self.pairs >= low) & (self.pairs <= high), axis=1)
        return self.of_pairs(self.pairs[inside])
