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
TOLERANCE = 1e-13  # of a squared norm
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
    lower: Array  # its Cholesky factor (m, m)
    squares: Array  # |X|² of all elements, squares of D, and one over them (m + 2, m)

    @classmethod
    def of(cls, m: int) -> Room:
        """For matrices (m, m)."""
        return cls(np.empty((m, m), complex), np.empty((m, m), complex), np.empty((m + 2, m)))


@within
def balanced_norm(matrix: Array, floor: float, room: Room) -> float:
    """μ(X) of one matrix, or ``floor`` where that is larger."""
    if not exceeds(matrix, floor, room):
        return floor
    low, high = floor * floor, 0.0  # of the squared norm, the largest eigenvalue of Y Yᴴ
    for i in range(len(matrix)):
        high += room.square[i, i].real
    while high - low > TOLERANCE * high:
        middle = 0.5 * (low + high)
        if _log_pivots(room, middle) == -math.inf:
            low = middle
        else:
            high = middle
    return math.sqrt(high)


@within
def largest_norm(matrices: Array, room: Room) -> float:
    """The largest μ(X) of matrices (f, m, m)."""
    worst, most = 0, 0.0
    for f in range(len(matrices)):
        squares = _squares(matrices[f])
        if squares > most:
            worst, most = f, squares
    norm = balanced_norm(matrices[worst], 0.0, room)  # hardly any other exceeds it
    for f in range(len(matrices)):
        norm = balanced_norm(matrices[f], norm, room)
    return norm


@within
def exceeds(matrix: Array, limit: float, room: Room) -> bool:
    """Whether μ(X) of a matrix exceeds a limit; if so Y Yᴴ of the balanced Y is in the room."""
    if _squares(matrix) <= limit * limit:  # μ ≤ σ_max ≤ Frobenius norm
        return False
    return log_room(matrix, limit, room) == -math.inf


@within
def log_room(matrix: Array, limit: float, room: Room) -> float:
    """How far μ(X) is below a limit: log det(I − Y Yᴴ/limit²) of the balanced Y; −∞ if above.

    Y Yᴴ is in the room then.
    """
    m, squares = len(matrix), room.squares
    scale, over = squares[m], squares[m + 1]
    for i in range(m):
        scale[i] = over[i] = 1.0
        for j in range(m):
            squares[i, j] = matrix[i, j].real ** 2 + matrix[i, j].imag ** 2
    for _ in range(SWEEPS if m > 1 else 0):
        for i in range(m):
            row, column = 1e-300, 1e-300
            for j in range(m):
                if j != i:
                    row += squares[i, j] * over[j]
                    column += squares[j, i] * scale[j]
            scale[i] = math.sqrt(column / row)  # so that row × d = column / d
            over[i] = 1 / scale[i]
    for i in range(m):
        for j in range(i + 1):
            product = 0j
            for k in range(m):
                product += matrix[i, k] * matrix[j, k].conjugate() * over[k]
            room.square[i, j] = product * math.sqrt(scale[i] * scale[j])
    return _log_pivots(room, limit * limit)


@within
def _squares(matrix: Array) -> float:
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
