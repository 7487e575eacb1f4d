"""Second-order jets: values over n poses with their first and second derivatives by k coordinates.

Written as plain arithmetic (``+``, ``*``, ``dot``, ``sqrt`` …), a formula for a length gives
moment arm and its derivative exactly. All parts may be complex, so that a complex step adds one
more exact derivative. A factor is one number, or one for each row (n,).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self, TypeVar

import numpy as np

from armdesign.arrays import Array

# of every coordinate the other two
AHEAD, BEHIND = np.array([1, 2, 0]), np.array([2, 0, 1])


@dataclass(frozen=True, eq=False)
class Jet:
    """Values (n, …), first (n, k, …) and second derivatives (n, k, k, …)."""

    value: Array
    first: Array
    second: Array

    def __add__(self, other: Self) -> Self:
        return type(self)(*map(np.add, self._parts, other._parts))

    def __sub__(self, other: Self) -> Self:
        return type(self)(*map(np.subtract, self._parts, other._parts))

    def __neg__(self) -> Self:
        return self._scaled(-1.0)

    def _scaled(self, factor: float | Array) -> Self:
        if not np.ndim(factor):
            return type(self)(*(part * factor for part in self._parts))
        rows = (np.reshape(factor, (-1, *[1] * (part.ndim - 1))) for part in self._parts)
        return type(self)(*map(np.multiply, self._parts, rows))

    @property
    def _parts(self) -> tuple[Array, Array, Array]:
        return self.value, self.first, self.second


AnyJet = TypeVar("AnyJet", bound=Jet)


class ScalarJet(Jet):
    """Numbers (n,), their gradients (n, k) and Hessians (n, k, k)."""

    def __add__(self, other: ScalarJet | float | Array) -> ScalarJet:
        if isinstance(other, ScalarJet):
            return super().__add__(other)
        return ScalarJet(self.value + other, self.first, self.second)

    def __mul__(self, factor: ScalarJet | float | Array) -> ScalarJet:
        if isinstance(factor, ScalarJet):
            return _product(np.multiply, self, factor, ScalarJet)
        return self._scaled(factor)

    def through(self, value: Array, slope: Array, curvature: Array) -> ScalarJet:
        """f(self) from f, f′ and f″ at its values (chain rule)."""
        outer = self.first[:, :, None] * self.first[:, None, :]
        second = slope[:, None, None] * self.second + curvature[:, None, None] * outer
        return ScalarJet(value, slope[:, None] * self.first, second)

    def sqrt(self) -> ScalarJet:
        """Square root; NaN, without a warning, where it is not positive."""
        root = np.sqrt(np.where(np.real(self.value) > 0, self.value, np.nan))
        return self.through(root, 0.5 / root, -0.25 / root**3)

    def reciprocal(self) -> ScalarJet:
        """Reciprocal."""
        inverse = 1 / self.value
        return self.through(inverse, -(inverse**2), 2 * inverse**3)


class VectorJet(Jet):
    """Vectors (n, 3) with first (n, k, 3) and second derivatives (n, k, k, 3)."""

    def __mul__(self, factor: ScalarJet | float | Array) -> VectorJet:
        if isinstance(factor, ScalarJet):
            return _product(lambda a, b: a[..., None] * b, factor, self, VectorJet)
        return self._scaled(factor)

    def dot(self, other: VectorJet) -> ScalarJet:
        """Scalar product."""
        return _product(lambda a, b: np.einsum("...i,...i->...", a, b), self, other, ScalarJet)

    def cross(self, other: VectorJet) -> VectorJet:
        """Vector product."""
        return _product(cross, self, other, VectorJet)


def _product(
    multiply: Callable[[Array, Array], Array], a: Jet, b: Jet, kind: type[AnyJet]
) -> AnyJet:
    """Any product, linear in both jets, by the product rule."""
    mixed = multiply(a.first[:, :, None], b.first[:, None])
    return kind(
        multiply(a.value, b.value),
        multiply(a.first, b.value[:, None]) + multiply(a.value[:, None], b.first),
        multiply(a.second, b.value[:, None, None])
        + multiply(a.value[:, None, None], b.second)
        + mixed
        + np.swapaxes(mixed, 1, 2),
    )


def cross(a: Array, b: Array) -> Array:
    """Cross product over the last axis; on small arrays several times faster than numpy's."""
    forward = a.take(AHEAD, -1) * b.take(BEHIND, -1)
    return np.asarray(forward - a.take(BEHIND, -1) * b.take(AHEAD, -1))
