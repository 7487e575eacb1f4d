"""Small complex matrices at several frequencies at once, compiled.

Their last axis is the frequency, one in each lane. Loops over lanes are the innermost and of a
fixed length, so that the compiler does several lanes by one instruction.
"""

from __future__ import annotations

from armdesign.arrays import Array
from armdesign.simulation.plant.compiled import within

LANES = 24
FAR = 8.0  # a pivot so much larger is worth an exchange of rows


@within
def add_products(out: Array, a: Array, b: Array) -> None:
    """Add the products of two numbers in each lane."""
    for lane in range(LANES):
        out[lane] += a[lane] * b[lane]


@within
def subtract_products(out: Array, a: Array, b: Array) -> None:
    """Subtract the products of two numbers in each lane."""
    for lane in range(LANES):
        out[lane] -= a[lane] * b[lane]


@within
def add_scaled(out: Array, factor: float, values: Array) -> None:
    """Add a real factor of complex numbers."""
    for lane in range(LANES):
        value = values[lane]
        out[lane] += complex(factor * value.real, factor * value.imag)


@within
def fill(out: Array, value: float) -> None:
    """Write a number into all lanes."""
    for lane in range(LANES):
        out[lane] = value


@within
def write_product(out: Array, a: Array, b: Array) -> None:
    """Write a (m, k, lanes) times b (k, n, lanes)."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            fill(out[i, j], 0.0)
            for k in range(len(b)):
                add_products(out[i, j], a[i, k], b[k, j])


@within
def invert(matrix: Array, inverse: Array, factor: Array) -> None:
    """Write inverses of matrices (m, m, lanes), which are spoilt; by Gauss and Jordan.

    The ``factor`` (lanes,) is room for what is computed.
    """
    m = len(matrix)
    for i in range(m):
        for j in range(m):
            fill(inverse[i, j], 1.0 if i == j else 0.0)
    for i in range(m):
        for j in range(i + 1, m):
            _keep_larger(matrix, inverse, i, j, factor)
        pivot = matrix[i, i]
        for lane in range(LANES):
            value = pivot[lane]
            over = 1 / (value.real * value.real + value.imag * value.imag)
            factor[lane] = complex(over * value.real, -over * value.imag)
        for j in range(m):
            for lane in range(LANES):
                inverse[i, j, lane] *= factor[lane]
        for j in range(i + 1, m):  # what is to its left is not looked at any more
            for lane in range(LANES):
                matrix[i, j, lane] *= factor[lane]
        for row in range(m):
            if row != i:
                for lane in range(LANES):
                    factor[lane] = matrix[row, i, lane]
                for j in range(m):
                    subtract_products(inverse[row, j], factor, inverse[i, j])
                for j in range(i + 1, m):
                    subtract_products(matrix[row, j], factor, matrix[i, j])


@within
def _keep_larger(matrix: Array, inverse: Array, i: int, j: int, flag: Array) -> None:
    """Exchange rows i and j in the lanes in which the latter's pivot is far larger."""
    own, other, count = matrix[i, i], matrix[j, i], 0
    for lane in range(LANES):
        larger = size(other[lane]) > FAR * size(own[lane])
        flag[lane] = 1.0 if larger else 0.0
        count += larger
    if count > 0:
        for k in range(i, len(matrix)):
            _exchange(matrix[i, k], matrix[j, k], flag)
        for k in range(len(matrix)):
            _exchange(inverse[i, k], inverse[j, k], flag)


@within
def _exchange(a: Array, b: Array, flag: Array) -> None:
    """Exchange numbers in flagged lanes."""
    for lane in range(LANES):
        x, y, changes = a[lane], b[lane], flag[lane].real > 0
        a[lane] = y if changes else x
        b[lane] = x if changes else y


@within
def size(number: complex) -> float:
    """|Re| + |Im|, which is fast."""
    return abs(number.real) + abs(number.imag)
