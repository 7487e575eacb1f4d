"""What areas leave alone when nothing else moves: worked out once, so that many areas are tried on many poses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armdesign.arrays import Array


@dataclass(frozen=True, eq=False)
class Still:
    """All rows of a problem in which only areas vary and static forces do not depend on them.

    Lengths, static forces (n, nc), and in the frame of L⁻¹, M = L Lᵀ: arm L⁻¹r (n, nc, nq) and
    rest, K without oil (n, nq, nq).
    """

    length: Array
    forces: Array
    arm: Array
    rest: Array

    def squared(self, rows: Array | slice, oil: Array) -> Array:
        """Lowest ω² (n,) [rad²/s²] of rows with the stiffness (n, nc) [N/m] of their oil."""
        arm = self.arm[rows]
        return lowest(self.rest[rows] + np.swapaxes(arm, 1, 2) @ (arm * oil[:, :, None]))


def lowest(scaled: Array) -> Array:
    """Lowest eigenvalues (n,) of L⁻¹K L⁻ᵀ, 0 where a matrix is not finite; overwrites those."""
    scaled[~np.isfinite(scaled).all(axis=(1, 2))] = 0.0
    return np.asarray(np.linalg.eigvalsh(scaled)[:, 0])
