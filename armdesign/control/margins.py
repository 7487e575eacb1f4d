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

import numpy as np

from armdesign.arrays import Array
from armdesign.errors import ArmDesignError
from armdesign.simulation.plant.compiled import compiled
from armdesign.units import deg

SWEEPS = 4  # of the balancing
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


@compiled
def balanced_norm(matrix: Array, floor: float) -> float:
    """μ(X) of one matrix, or ``floor`` where that is larger."""
    square = np.empty((len(matrix), len(matrix)), np.complex128)
    if not exceeds(matrix, floor, square):
        return floor
    return max(math.sqrt(np.linalg.eigvalsh(square)[-1]), floor)


@compiled
def largest_norm(matrices: Array) -> float:
    """The largest μ(X) of matrices (f, m, m)."""
    worst, most = 0, 0.0
    for f in range(len(matrices)):
        squares = 0.0
        for value in matrices[f].ravel():
            squares += value.real**2 + value.imag**2
        if squares > most:
            worst, most = f, squares
    norm = balanced_norm(matrices[worst], 0.0)  # hardly any other exceeds it
    for f in range(len(matrices)):
        norm = balanced_norm(matrices[f], norm)
    return norm


@compiled
def exceeds(matrix: Array, limit: float, square: Array) -> bool:
    """Whether μ(X) of a matrix exceeds a limit; if so Y Yᴴ of the balanced Y is in ``square``."""
    m, total = len(matrix), 0.0
    for i in range(m):
        for j in range(m):
            total += matrix[i, j].real ** 2 + matrix[i, j].imag ** 2
    if total <= limit * limit:  # μ ≤ σ_max ≤ Frobenius norm
        return False
    squares, scale, sums = np.empty((m, m)), np.ones(m), np.zeros((2, m))
    for i in range(m):
        for j in range(m):
            squares[i, j] = matrix[i, j].real ** 2 + matrix[i, j].imag ** 2
            magnitude = math.sqrt(squares[i, j])
            sums[0, i] += magnitude
            sums[1, j] += magnitude
    if sums[0].max() * sums[1].max() <= limit * limit:  # σ_max² ≤ ‖X‖_∞ ‖X‖_1
        return False
    for _ in range(SWEEPS if m > 1 else 0):
        for i in range(m):
            row, column = 1e-300, 1e-300
            for j in range(m):
                if j != i:
                    row += squares[i, j] / scale[j]
                    column += squares[j, i] * scale[j]
            scale[i] = math.sqrt(column / row)  # scale: squares of D, where row × d = column / d
    total = 0.0
    for i in range(m):
        for j in range(m):
            total += squares[i, j] * scale[i] / scale[j]
    if total <= limit * limit:
        return False
    for i in range(m):
        for j in range(i + 1):
            product = 0j
            for k in range(m):
                product += matrix[i, k] * matrix[j, k].conjugate() / scale[k]
            square[i, j] = product * math.sqrt(scale[i] * scale[j])
            square[j, i] = square[i, j].conjugate()
    return not _below(square, limit * limit)


@compiled
def _below(square: Array, limit: float) -> bool:
    """Whether all eigenvalues of a Hermitian matrix lie below a limit: by Cholesky's pivots."""
    m = len(square)
    lower = np.empty((m, m), np.complex128)  # of limit · I − square
    for i in range(m):
        for j in range(i + 1):
            pivot = (limit if i == j else 0.0) - square[i, j]
            for k in range(j):
                pivot -= lower[i, k] * lower[j, k].conjugate()
            if i > j:
                lower[i, j] = pivot / lower[j, j].real
            elif pivot.real <= 0.0:
                return False
            else:
                lower[i, i] = math.sqrt(pivot.real)
    return True


@compiled
def size(number: complex) -> float:
    """|Re| + |Im|, which is fast."""
    return abs(number.real) + abs(number.imag)


@compiled
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
