"""What areas leave alone when nothing else moves: worked out once, so that many areas are tried on many poses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from armdesign.arrays import Array


@dataclass(eq=False)
class Still:
    """All rows of a problem in which only areas vary and static forces do not hang on them.

    Lengths, static forces (n, nc), and in the frame of L⁻¹, M = L Lᵀ: arm L⁻¹r (n, nc, nq) and rest, K without oil
    (n, nq, nq). It remembers the last look at all rows.
    """

    length: Array
    force: Array
    arm: Array
    rest: Array
    seen: tuple[bytes, Array] | None = None

    def look(self, x: Array, rows: Array | None, oil: Callable[[Array, Array], Array]) -> tuple[Array, Array]:
        """Lowest ω² [rad²/s²] and static forces [N] of rows (all if None) at x, with ``oil(length, force)`` [N/m]."""
        if rows is not None:
            return self._squared(rows, oil), self.force[rows]
        if self.seen is None or self.seen[0] != x.tobytes():
            self.seen = (x.tobytes(), self._squared(slice(None), oil))
        return self.seen[1], self.force

    def _squared(self, rows: Array | slice, oil: Callable[[Array, Array], Array]) -> Array:
        arm, stiffness = self.arm[rows], oil(self.length[rows], self.force[rows])
        return lowest(self.rest[rows] + np.swapaxes(arm, 1, 2) @ (arm * stiffness[:, :, None]))


def lowest(scaled: Array) -> Array:
    """Lowest eigenvalues (n,) of L⁻¹K L⁻ᵀ, 0 where a matrix is not finite; overwrites those."""
    scaled[~np.isfinite(scaled).all(axis=(1, 2))] = 0.0
    return np.asarray(np.linalg.eigvalsh(scaled)[:, 0])


def inverse_root(mass: Array) -> Array:
    """L⁻¹ (n, nq, nq) of M = L Lᵀ."""
    return np.asarray(np.linalg.inv(np.linalg.cholesky(mass)))
