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
from armdesign.control.lanes import LANES, add_products, fill
from armdesign.errors import ArmDesignError
from armdesign.simulation.plant.compiled import within
from armdesign.units import deg

SWEEPS = 4  # of the balancing
TINY = 1e-150  # of a squared norm, so that a row of zeros balances
GAIN_MARGIN_DB, PHASE_MARGIN = 6.0, 45 * deg  # customary


def disk_margin_for(gain_db: float, phase: float) -> float:
    """The balanced disk margin that keeps a gain margin [dB] and a phase margin [rad].

    Raises:
        ArmDesignError: no disk does.
    """
    if not 0 < gain_db < math.inf:
        fault = f"{gain_db:g} dB is not allowed"
        raise ArmDesignError("gain_margin", fault, "give more than 0 dB, as 6")
    if not 0 < phase < math.pi / 2:
        fault = f"{phase / deg:g} deg is not between 0 and 90 deg"
        in_python = ", in Python 45 * deg = 0.785" if phase / deg > 90 else ""
        raise ArmDesignError("phase_margin", fault, f"give one as 45 deg{in_python}")
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
    """Room for computations of matrices (m, m, lanes), which compiled code may not make anew."""

    square: Array  # Y Yᴴ of the balanced matrix (m, m, lanes)
    lower: Array  # Cholesky factor of limit² I − Y Yᴴ, over its diagonal (m, m, lanes)
    balanced: Array  # Y (m, m, lanes)
    squares: Array  # |X|² of all elements, D and one over it (m + 2, m, lanes)
    sums: Array  # of rows and columns of these (2, lanes)
    left: Array  # det(I − Y Yᴴ/limit²), 0 where μ(X) is above the limit (lanes,)

    @classmethod
    def of(cls, m: int) -> Room:
        """For matrices (m, m, lanes)."""
        made = [np.empty((m, m, LANES), complex) for _ in range(3)]
        real = [np.empty(shape) for shape in ((m + 2, m, LANES), (2, LANES), (LANES,))]
        return cls._make([*made, *real])


def balanced(matrices: Array) -> Array:
    """D X D⁻¹ of matrices (n, m, m, …)."""
    size, squares = matrices.shape[1], matrices.real**2 + matrices.imag**2
    scale = np.ones(squares[:, 0].shape)  # D²
    for _ in range(SWEEPS if size > 1 else 0):
        for i in range(size):
            row, column = squares[:, i] / scale, squares[:, :, i] * scale
            row[:, i] = column[:, i] = TINY
            scale[:, i] = np.sqrt(column.sum(axis=1) / row.sum(axis=1))  # row × d = column / d
    d = np.sqrt(scale)
    return np.asarray(matrices * (d[:, :, None] / d[:, None]))


def largest_norms(matrices: Array, bounds: Array, least: Array) -> Array:
    """The largest ‖X‖ (n,) of matrices (n, m, m, f), or the ``least`` (n,) if that is larger.

    None exceeds its ``bound`` (n, f), so that few need to be computed.
    """
    largest, highest = least.copy(), bounds >= bounds.max(axis=1, initial=0.0, keepdims=True)
    for some in (highest, ~highest):  # of which few exceed what is largest then
        rows, f = np.nonzero(some & (bounds > largest[:, None]))
        np.maximum.at(largest, rows, norms(matrices[rows, :, :, f]))
    return largest


def bound(matrices: Array) -> Array:
    """What ‖X‖ comes near and does not exceed (n, …), X (n, m, m, …): (tr (X Xᴴ)²)^¼."""
    squared = np.einsum("nij...,nkj...->nik...", matrices, matrices.conj())
    return np.asarray((squared.real**2 + squared.imag**2).sum(axis=(1, 2)) ** 0.25)


def norms(matrices: Array) -> Array:
    """‖X‖ (n,), the largest singular value of matrices (n, m, m)."""
    squared = matrices @ np.swapaxes(matrices, 1, 2).conj()
    return np.asarray(np.sqrt(np.linalg.eigvalsh(squared)[:, -1]))


@within
def write_room(matrix: Array, limit: float, room: Room) -> None:
    """Write how far μ(X) is below a limit: det(I − Y Yᴴ/limit²) of the balanced Y; 0 if above."""
    m, scale, over = len(matrix), room.squares[len(matrix)], room.squares[len(matrix) + 1]
    _balance(matrix, room)
    for i in range(m):
        for j in range(m):
            balanced, element, d, one_over = room.balanced[i, j], matrix[i, j], scale[i], over[j]
            for lane in range(LANES):
                ratio, value = d[lane] * one_over[lane], element[lane]
                balanced[lane] = complex(ratio * value.real, ratio * value.imag)
        for j in range(i + 1):
            square = room.square[i, j]
            fill(square, 0.0)
            for k in range(m):
                row, column = room.balanced[i, k], room.balanced[j, k]
                for lane in range(LANES):
                    square[lane] += row[lane] * column[lane].conjugate()
    _write_pivots(room, limit * limit)


@within
def _balance(matrix: Array, room: Room) -> None:
    """Write D and one over it, of matrices (m, m, lanes)."""
    m, squares, row, column = len(matrix), room.squares, room.sums[0], room.sums[1]
    scale, over = squares[m], squares[m + 1]
    for i in range(m):
        fill(scale[i], 1.0)
        fill(over[i], 1.0)
        for j in range(m):
            _write_squares(matrix[i, j], squares[i, j])
    for _ in range(SWEEPS if m > 1 else 0):
        for i in range(m):
            fill(row, TINY)
            fill(column, TINY)
            for j in range(m):
                if j != i:
                    add_products(row, squares[i, j], over[j])
                    add_products(column, squares[j, i], scale[j])
            for lane in range(len(row)):
                even = 1 / math.sqrt(row[lane] * column[lane])  # so that row × d = column / d
                scale[i, lane], over[i, lane] = even * column[lane], even * row[lane]
    for i in range(m):
        for lane in range(len(row)):
            scale[i, lane] = math.sqrt(scale[i, lane])
            over[i, lane] = 1 / scale[i, lane]


@within
def _write_squares(values: Array, squares: Array) -> None:
    """Write |X|² (lanes,)."""
    for lane in range(LANES):
        value = values[lane]
        squares[lane] = value.real * value.real + value.imag * value.imag


@within
def write_squared_norm(matrix: Array, total: Array) -> None:
    """Write the squared Frobenius norm (lanes,) of matrices (m, m, lanes)."""
    fill(total, 0.0)
    for i in range(len(matrix)):
        for j in range(len(matrix)):
            values = matrix[i, j]
            for lane in range(LANES):
                value = values[lane]
                total[lane] += value.real * value.real + value.imag * value.imag


@within
def _write_pivots(room: Room, limit: float) -> None:
    """Write det(I − X/limit), X Hermitian in a room; 0 where I − X/limit is not positive."""
    square, lower, left = room.square, room.lower, room.left
    fill(left, 1.0)
    for i in range(len(square)):
        for j in range(i + 1):
            pivot, own, diagonal = lower[i, j], square[i, j], lower[j, j]
            for lane in range(LANES):
                pivot[lane] = (limit if i == j else 0.0) - own[lane]
            for k in range(j):
                row, column = lower[i, k], lower[j, k]
                for lane in range(LANES):
                    pivot[lane] -= row[lane] * column[lane].conjugate()
            if i > j:
                for lane in range(LANES):  # one over the diagonal is kept
                    pivot[lane] *= diagonal[lane].real
            else:
                for lane in range(len(pivot)):
                    positive, value = pivot[lane].real > 0.0, pivot[lane].real
                    pivot[lane] = 1 / math.sqrt(value if positive else 1.0)
                    left[lane] *= value / limit if positive else 0.0
