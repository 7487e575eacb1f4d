"""Second-order jets: values over n poses with their first and second derivatives by k coordinates.

Written as plain arithmetic (``+``, ``*``, ``dot``, ``sqrt`` …), a formula for a length gives
moment arm and its derivative exactly. All parts may be complex, so that a complex step adds one
more exact derivative. A factor is one number, or one for each row (n,). In memory numbers of a
component lie side by side (Fortran order), so that NumPy goes along the poses.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Self, TypeAlias, TypeVar

import numpy as np

from armdesign.arrays import Array

Second: TypeAlias = Array | Callable[[], Array]  # or how to compute it


class Jet:
    """Values (n, …), first (n, k, …) and second derivatives (n, k, k, …).

    The latter, the larger part of the work, are computed when they are asked for.
    """

    def __init__(self, value: Array, first: Array, second: Second) -> None:
        self.value, self.first, self._second = value, first, second

    @property
    def second(self) -> Array:
        """Second derivatives (n, k, k, …)."""
        if not isinstance(self._second, np.ndarray):
            self._second = self._second()
        return self._second

    def __add__(self, other: Self) -> Self:
        value, first = self.value + other.value, self.first + other.first
        return type(self)(value, first, lambda: self.second + other.second)

    def __sub__(self, other: Self) -> Self:
        value, first = self.value - other.value, self.first - other.first
        return type(self)(value, first, lambda: self.second - other.second)

    def __neg__(self) -> Self:
        return self._scaled(-1.0)

    def _scaled(self, factor: float | Array) -> Self:
        def scaled(part: Array) -> Array:
            rows = (-1, *[1] * (part.ndim - 1))
            return np.asarray(part * (np.reshape(factor, rows) if np.ndim(factor) else factor))

        return type(self)(scaled(self.value), scaled(self.first), lambda: scaled(self.second))


AnyJet = TypeVar("AnyJet", bound=Jet)


class ScalarJet(Jet):
    """Numbers (n,), their gradients (n, k) and Hessians (n, k, k)."""

    def __add__(self, other: ScalarJet | float | Array) -> ScalarJet:
        if isinstance(other, ScalarJet):
            return super().__add__(other)
        return ScalarJet(self.value + other, self.first, lambda: self.second)

    def __mul__(self, factor: ScalarJet | float | Array) -> ScalarJet:
        if isinstance(factor, ScalarJet):
            return _product(np.multiply, self, factor, ScalarJet)
        return self._scaled(factor)

    def through(self, value: Array, slope: Array, curvature: Array) -> ScalarJet:
        """f(self) from f, f′ and f″ at its values (chain rule)."""

        def second() -> Array:
            outer = self.first[:, :, None] * self.first[:, None, :]
            return np.asarray(
                slope[:, None, None] * self.second + curvature[:, None, None] * outer
            )

        return ScalarJet(value, slope[:, None] * self.first, second)

    def sqrt(self) -> ScalarJet:
        """Square root; NaN, without a warning, where it is not positive."""
        root = np.sqrt(np.where(np.real(self.value) > 0, self.value, np.nan))
        return self.through(root, 0.5 / root, -0.25 / (root * root * root))

    def reciprocal(self) -> ScalarJet:
        """Reciprocal."""
        inverse = 1 / self.value
        square = inverse * inverse
        return self.through(inverse, -square, 2 * square * inverse)


class VectorJet(Jet):
    """Vectors (n, 3) with first (n, k, 3) and second derivatives (n, k, k, 3)."""

    def __mul__(self, factor: ScalarJet | float | Array) -> VectorJet:
        if isinstance(factor, ScalarJet):
            return _product(lambda a, b: a[..., None] * b, factor, self, VectorJet)
        return self._scaled(factor)

    def dot(self, other: VectorJet) -> ScalarJet:
        """Scalar product."""
        return _product(dot, self, other, ScalarJet)

    def cross(self, other: VectorJet) -> VectorJet:
        """Vector product."""
        return _product(cross, self, other, VectorJet)


def _product(
    multiply: Callable[[Array, Array], Array], a: Jet, b: Jet, kind: type[AnyJet]
) -> AnyJet:
    """Any product, linear in both jets, by the product rule."""

    def second() -> Array:
        mixed = multiply(a.first[:, :, None], b.first[:, None])
        return (
            multiply(a.second, b.value[:, None, None])
            + multiply(a.value[:, None, None], b.second)
            + mixed
            + np.swapaxes(mixed, 1, 2)
        )

    first = multiply(a.first, b.value[:, None]) + multiply(a.value[:, None], b.first)
    return kind(multiply(a.value, b.value), first, second)


def cross(a: Array, b: Array, axis: int = -1) -> Array:
    """Cross product over the last axis or the first; several times faster than numpy's."""
    x, y, z = ((..., i) if axis else (i,) for i in range(3))
    shape, dtype = np.broadcast_shapes(a.shape, b.shape), np.result_type(a, b)
    product = np.empty(shape, dtype, order="F" if axis else "C")
    back = np.empty_like(product[x])
    for i, j, k in ((x, y, z), (y, z, x), (z, x, y)):
        np.multiply(a[j], b[k], out=product[i])
        product[i] -= np.multiply(a[k], b[j], out=back)
    return product


def dot(a: Array, b: Array) -> Array:
    """Scalar product over the last axis, x and z first: most arms lie in their plane."""
    product = a[..., 0] * b[..., 0]
    product += a[..., 2] * b[..., 2]
    product += a[..., 1] * b[..., 1]
    return product
