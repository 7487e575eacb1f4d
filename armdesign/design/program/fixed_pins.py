"""Fixed pins: what areas leave alone is worked out once, so that many areas can be tried."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armdesign.arrays import Array


@dataclass(frozen=True, eq=False)
class FixedPins:
    """All rows of a problem in which only areas vary and static forces do not depend on them.

    Lengths and static forces (n, nc); and with M = L Lᵀ the moment arms L⁻¹r (n, nc, nq) and
    L⁻¹K L⁻ᵀ without oil (n, nq, nq).
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


def lowest(scaled: Array) -> Array:
    """Lowest eigenvalues (n,) of L⁻¹K L⁻ᵀ, 0 where a matrix is not finite; overwrites those."""
    scaled[~np.isfinite(scaled).all(axis=(1, 2))] = 0.0
    return np.asarray(np.linalg.eigvalsh(scaled)[:, 0])
