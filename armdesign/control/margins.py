"""Disk margins of loops that are closed together.

With the loop L(jω), S = (I + L)⁻¹ and T = I − S, the balanced disk margin is

    α = 1 / max_ω μ(½(S − T)),   μ(X) = min_D σ_max(D X D⁻¹), D diagonal,

as ``control.disk_margins`` has it (there by slycot). All loops together may then change at once by
gains up to (2 + α)/(2 − α) or phases up to 2 arctan(α/2), each by its own (Seiler, Packard,
Gahinet 2020); without D the number would depend on the units of the loops. D is Osborne's
balancing (1960): exact for two loops and where one mode rings, else a few percent on the safe
side.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armdesign.arrays import Array
from armdesign.errors import ArmDesignError
from armdesign.simulation.plant.compiled import within
from armdesign.units import deg

SWEEPS = 4  # of the balancing
TINY = 1e-300  # of a squared norm, so that a row of zeros balances
GAIN_MARGIN_DB, PHASE_MARGIN = 6.0, 45 * deg  # customary


def disk_margin_for(gain_db: float, phase: float) -> float:
    """The balanced disk margin that keeps a gain margin [dB] and a phase margin [rad].

    Raises:
        ArmDesignError: no disk does.
    """
    if not 0 < gain_db < math.inf:
        raise ArmDesignError("gain margin", f"{gain_db:g} dB", "give more than 0 dB, as 6")
    if not 0 < phase < math.pi / 2:
        fault = f"{phase / deg:g} deg is not between 0 and 90 deg"
        in_python = ", in Python 45 * deg = 0.785" if phase / deg > 90 else ""
        raise ArmDesignError("phase margin", fault, f"give one as 45 deg{in_python}")
    return max(of_gain_margin(gain_db), of_phase_margin(phase))


def of_gain_margin(gain_db: float) -> float:
    """The balanced disk margin that guarantees a gain margin [dB]: 2 (g − 1)/(g + 1)."""
    return 2 * math.tanh(gain_db * math.log(10) / 40)


def of_phase_margin(phase: float) -> float:
    """The balanced disk margin that guarantees a phase margin [rad]."""
    return 2 * math.tan(phase / 2)


def gain_margin_db(margin: Array | float) -> Array:
    """Gain margin [dB] in all loops at once that a balanced disk margin α guarantees."""
    bounded = np.minimum(margin, 2 - 1e-12)
    return np.asarray(20 * np.log10((2 + bounded) / (2 - bounded)))


def phase_margin(margin: Array | float) -> Array:
    """Phase margin [rad] in all loops at once that a balanced disk margin α guarantees."""
    return np.asarray(2 * np.arctan(np.asarray(margin) / 2))


class Room(NamedTuple):
    """Room for the computations of one matrix (m, m), which compiled code may not make anew."""

    square: Array  # Y Yᴴ of the balanced matrix (m, m)
    lower: Array  # Cholesky factor of limit² I − Y Yᴴ, over its diagonal (m, m)
    balanced: Array  # Y (m, m)
    squares: Array  # |X|² of all elements, D and one over it (m + 2, m)

    @classmethod
    def of(cls, m: int) -> Room:
        """For matrices (m, m)."""
        square, lower, balanced = (np.empty((m, m), complex) for _ in range(3))
        return cls(square, lower, balanced, np.empty((m + 2, m)))


def structured_norms(matrices: Array) -> Array:
    """μ(X) (n,) of matrices (n, m, m)."""
    size = matrices.shape[-1]
    squares = matrices.real**2 + matrices.imag**2
    scale = np.ones(matrices.shape[:2])  # D²
    for _ in range(SWEEPS if size > 1 else 0):
        for i in range(size):
            row, column = squares[:, i] / scale, squares[:, :, i] * scale
            row[:, i] = column[:, i] = TINY
            scale[:, i] = np.sqrt(column.sum(axis=1) / row.sum(axis=1))  # row × d = column / d
    d = np.sqrt(scale)
    balanced = matrices * (d[:, :, None] / d[:, None])
    return np.asarray(np.sqrt(np.linalg.eigvalsh(_squared(balanced))[:, -1]))


def largest_norms(matrices: Array) -> Array:
    """The largest μ(X) (n,) of matrices (n, f, m, m)."""
    bounds = np.sqrt(np.abs(_squared(matrices)).sum(axis=3).max(axis=2))  # μ² ≤ σ² ≤ ‖X Xᴴ‖∞
    worst = bounds.argmax(axis=1)
    largest = structured_norms(matrices[range(len(worst)), worst])
    row, f = np.nonzero(bounds > largest[:, None])  # few others can exceed it
    np.maximum.at(largest, row, structured_norms(matrices[row, f]))
    return largest


def _squared(matrices: Array) -> Array:
    """X Xᴴ of matrices (..., m, m)."""
    return np.asarray(matrices @ np.swapaxes(matrices, -1, -2).conj())


@within
def log_room(matrix: Array, limit: float, room: Room) -> float:
    """How far μ(X) is below a limit: log det(I − Y Yᴴ/limit²) of the balanced Y; −∞ if above."""
    m, squares = len(matrix), room.squares
    scale, over = squares[m], squares[m + 1]
    for i in range(m):
        scale[i] = over[i] = 1.0
        for j in range(m):
            squares[i, j] = matrix[i, j].real ** 2 + matrix[i, j].imag ** 2
    for _ in range(SWEEPS if m > 1 else 0):
        for i in range(m):
            row, column = TINY, TINY
            for j in range(m):
                if j != i:
                    row += squares[i, j] * over[j]
                    column += squares[j, i] * scale[j]
            scale[i] = math.sqrt(column / row)  # so that row × d = column / d
            over[i] = 1 / scale[i]
    for i in range(m):
        scale[i] = math.sqrt(scale[i])
        over[i] = 1 / scale[i]
    for i in range(m):
        for j in range(m):
            room.balanced[i, j] = matrix[i, j] * (scale[i] * over[j])
        for j in range(i + 1):
            product = 0j
            for k in range(m):
                product += room.balanced[i, k] * room.balanced[j, k].conjugate()
            room.square[i, j] = product
    return _log_pivots(room, limit * limit)


@within
def squared_norm(matrix: Array) -> float:
    """The squared Frobenius norm."""
    total = 0.0
    for i in range(len(matrix)):
        for j in range(len(matrix)):
            total += matrix[i, j].real ** 2 + matrix[i, j].imag ** 2
    return total


@within
def _log_pivots(room: Room, limit: float) -> float:
    """Logarithm of det(I − X/limit), X Hermitian in a room; −∞ where that is not positive."""
    square, lower, product = room.square, room.lower, 1.0
    for i in range(len(square)):
        for j in range(i + 1):
            pivot = (limit if i == j else 0.0) - square[i, j]
            for k in range(j):
                pivot -= lower[i, k] * lower[j, k].conjugate()
            if i > j:
                lower[i, j] = pivot * lower[j, j].real  # where one over the diagonal is kept
            elif pivot.real <= 0.0:
                return -math.inf
            else:
                lower[i, i] = 1 / math.sqrt(pivot.real)
                product *= pivot.real / limit
    return math.log(product)


@within
def size(number: complex) -> float:
    """|Re| + |Im|, which is fast."""
    return abs(number.real) + abs(number.imag)


@within
def invert(matrix: Array, inverse: Array) -> None:
    """Write the inverse of a small complex matrix (m, m), which is spoilt; by Gauss and Jordan."""
    m = len(matrix)
    for i in range(m):
        for j in range(m):
            inverse[i, j] = 1.0 if i == j else 0.0
    for i in range(m):
        pivot = i
        for j in range(i + 1, m):
            if size(matrix[j, i]) > size(matrix[pivot, i]):
                pivot = j
        for j in range(m):
            matrix[i, j], matrix[pivot, j] = matrix[pivot, j], matrix[i, j]
            inverse[i, j], inverse[pivot, j] = inverse[pivot, j], inverse[i, j]
        over = 1.0 / matrix[i, i]
        for j in range(m):
            matrix[i, j] *= over
            inverse[i, j] *= over
        for row in range(m):
            if row != i:
                factor = matrix[row, i]
                for j in range(m):
                    matrix[row, j] -= factor * matrix[i, j]
                    inverse[row, j] -= factor * inverse[i, j]
