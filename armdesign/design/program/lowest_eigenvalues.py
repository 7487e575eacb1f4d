"""Lowest eigenvalues of many small symmetric matrices, of which the lowest of all count."""

from __future__ import annotations

import numpy as np

from armdesign.arrays import Array

EXACT = 2_000  # of many eigenvalues, how many of the lowest are exact


def lowest(scaled: Array) -> Array:
    """Lowest eigenvalues (n,) of L⁻¹K L⁻ᵀ, 0 where a matrix is not finite; overwrites those.

    Of many three by three matrices the roots of the cubic tell which are low, a tenth of the work;
    those are exact, the others to 1e-7 of the largest eigenvalue.
    """
    finite = np.isfinite(scaled)
    if not finite.all():
        scaled[~finite.all(axis=(1, 2))] = 0.0
    if scaled.shape[1] != 3 or len(scaled) <= EXACT:
        return np.asarray(np.linalg.eigvalsh(scaled)[:, 0])
    values = _lowest_root(scaled)
    low = np.argpartition(values, EXACT)[:EXACT]
    values[low] = np.linalg.eigvalsh(scaled[low])[:, 0]
    return values


def _lowest_root(matrices: Array) -> Array:
    """Lowest eigenvalues (n,) of symmetric 3 × 3 matrices by the cosine of a third of an angle.

    Smith, Eigenvalues of a symmetric 3 × 3 matrix, Communications of the ACM 4 (1961) 168.
    """
    (a, b, c), (_, d, e), (_, _, f) = np.ascontiguousarray(np.moveaxis(matrices, 0, -1))
    mean = (a + d + f) / 3
    a, d, f = a - mean, d - mean, f - mean
    size = np.sqrt((a * a + d * d + f * f + 2 * (b * b + c * c + e * e)) / 6)
    half = (a * (d * f - e * e) - b * (b * f - c * e) + c * (b * e - c * d)) / 2
    cosine = np.clip(half / np.maximum(size**3, np.finfo(float).tiny), -1, 1)
    return np.asarray(mean + 2 * size * np.cos((np.arccos(cosine) + 2 * np.pi) / 3))
