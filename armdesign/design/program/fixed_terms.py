"""Terms of L⁻¹K L⁻ᵀ, with M = L Lᵀ, that a design leaves alone, for all rows of a problem."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armdesign.arrays import Array, congruent
from armdesign.design.program.lowest_eigenvalues import lowest, lowest_of_triangles, triangles


@dataclass(frozen=True, eq=False)
class FixedPins:
    """All rows of a problem in which only areas vary and static forces do not depend on them.

    Lengths and static forces (n, nc); the moment arms L⁻¹r (n, nc, nq) and L⁻¹K L⁻ᵀ without oil
    (n, nq, nq).
    """

    length: Array
    forces: Array
    scaled_arm: Array
    scaled_rest: Array

    def omega_squared(self, rows: Array | slice, oil: Array) -> Array:
        """Lowest ω² (n,) [rad²/s²] of rows with the stiffness (n, nc) [N/m] of their oil."""
        arm = self.scaled_arm[rows]
        oil_stiffness = np.swapaxes(arm, 1, 2) @ (arm * oil[:, :, None])
        return lowest(self.scaled_rest[rows] + oil_stiffness)


@dataclass(frozen=True, eq=False)
class OwnJoints:
    """All rows of a problem in which a design changes K on its diagonal alone, and M not at all.

    By ``triangles``: L⁻¹K L⁻ᵀ without that diagonal (p, n), and l lᵀ (nq, p, n) of each column l
    of L⁻¹.
    """

    scaled_rest: Array
    columns: Array

    @classmethod
    def of(cls, inverse: Array, rest: Array) -> OwnJoints:
        """From L⁻¹ and what no design changes of K, both (n, nq, nq)."""
        columns = np.moveaxis(inverse, 2, 0)
        squares = [triangles(one[:, :, None] * one[:, None, :]) for one in columns]
        return cls(triangles(congruent(inverse, rest)), np.stack(squares))

    def omega_squared(self, rows: Array | slice, diagonal: Array) -> Array:
        """Lowest ω² (n,) [rad²/s²] of rows with their diagonal (n, nq) of K."""
        own = np.einsum("jpn,jn->pn", self.columns[:, :, rows], np.ascontiguousarray(diagonal.T))
        return lowest_of_triangles(self.scaled_rest[:, rows] + own)
