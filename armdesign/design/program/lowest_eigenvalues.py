"""Lowest eigenvalues of many small symmetric matrices, of which the lowest of all count."""

from __future__ import annotations

import math

import numpy as np

from armdesign.arrays import Array

EXACT = 2_000  # of many eigenvalues, how many of the lowest are exact


def lowest(scaled: Array) -> Array:
    """Lowest eigenvalues (n,) of L⁻¹K L⁻ᵀ (n, k, k) as ``lowest_of_triangles``."""
    return lowest_of_triangles(triangles(scaled))


def triangles(matrices: Array) -> Array:
    """Lower triangles (p, n) of matrices (n, k, k), entry by entry, the matrices side by side."""
    rows, columns = np.tril_indices(matrices.shape[1])
    return np.ascontiguousarray(matrices[:, rows, columns].T)


def lowest_of_triangles(lower: Array) -> Array:
    """Lowest eigenvalues (n,) of symmetric matrices by their ``triangles`` (p, n).

    0 where a matrix is not finite; overwrites those. Of many three by three matrices the roots of
    the cubic tell which are low, a tenth of the work; those are exact, the others to 1e-7 of the
    largest eigenvalue.
    """
    if not math.isfinite(lower.sum()):
        lower[:, ~np.isfinite(lower).all(axis=0)] = 0.0
    if len(lower) != 6 or lower.shape[1] <= EXACT:
        return _exact(lower)
    values = _lowest_root(lower)
    low = np.argpartition(values, EXACT)[:EXACT]
    values[low] = _exact(lower[:, low])
    return values


def _exact(lower: Array) -> Array:
    """Lowest eigenvalues (n,) of symmetric matrices by LAPACK, which reads lower triangles."""
    size = (math.isqrt(8 * len(lower) + 1) - 1) // 2
    matrices = np.zeros((lower.shape[1], size, size))
    matrices[:, *np.tril_indices(size)] = lower.T
    return np.asarray(np.linalg.eigvalsh(matrices, UPLO="L")[:, 0])


def _lowest_root(lower: Array) -> Array:
    """Lowest eigenvalues (n,) of symmetric 3 × 3 matrices by the cosine of a third of an angle.

    Smith, Eigenvalues of a symmetric 3 × 3 matrix, Communications of the ACM 4 (1961) 168.
    """
    a, b, d, c, e, f = lower
    mean = (a + d + f) / 3
    a, d, f = a - mean, d - mean, f - mean
    size = np.sqrt((a * a + d * d + f * f + 2 * (b * b + c * c + e * e)) / 6)
    half = (a * (d * f - e * e) - b * (b * f - c * e) + c * (b * e - c * d)) / 2
    cosine = np.clip(half / np.maximum(size**3, np.finfo(float).tiny), -1, 1)
    return np.asarray(mean + 2 * size * np.cos((np.arccos(cosine) + 2 * np.pi) / 3))
