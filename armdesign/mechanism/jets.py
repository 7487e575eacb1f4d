"""Second-order jets: values over n poses with their first and second derivatives by k coordinates.

Written as plain arithmetic (``+``, ``*``, ``dot``, ``sqrt`` …), a formula for a length gives
moment arm and its derivative exactly. All parts may be complex, so that a complex step adds one
more exact derivative.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armdesign.arrays import Array


@dataclass(frozen=True, eq=False)
class ScalarJet:
    """Numbers (n,), their gradients (n, k) and Hessians (n, k, k)."""

    value: Array
    first: Array
    second: Array

    def __add__(self, other: ScalarJet | float) -> ScalarJet:
        if isinstance(other, ScalarJet):
            return ScalarJet(
                self.value + other.value, self.first + other.first, self.second + other.second
            )
        return ScalarJet(self.value + other, self.first, self.second)

    def __sub__(self, other: ScalarJet | float) -> ScalarJet:
        return self + other * -1.0

    def __mul__(self, other: ScalarJet | float) -> ScalarJet:
        if not isinstance(other, ScalarJet):
            return ScalarJet(self.value * other, self.first * other, self.second * other)
        mixed = self.first[:, :, None] * other.first[:, None, :]
        return ScalarJet(
            self.value * other.value,
            self.first * other.value[:, None] + self.value[:, None] * other.first,
            self.second * other.value[:, None, None]
            + self.value[:, None, None] * other.second
            + mixed
            + np.swapaxes(mixed, 1, 2),
        )

    def through(self, value: Array, slope: Array, curvature: Array) -> ScalarJet:
        """f(self) from f, f′ and f″ at its values (chain rule)."""
        outer = self.first[:, :, None] * self.first[:, None, :]
        return ScalarJet(
            value,
            slope[:, None] * self.first,
            slope[:, None, None] * self.second + curvature[:, None, None] * outer,
        )

    def sqrt(self) -> ScalarJet:
        """Square root; NaN, without a warning, where it is not positive."""
        root = np.sqrt(np.where(np.real(self.value) > 0, self.value, np.nan))
        return self.through(root, 0.5 / root, -0.25 / root**3)

    def reciprocal(self) -> ScalarJet:
        """Reciprocal."""
        inverse = 1 / self.value
        return self.through(inverse, -(inverse**2), 2 * inverse**3)


@dataclass(frozen=True, eq=False)
class VectorJet:
    """Vectors (n, 3) with first (n, k, 3) and second derivatives (n, k, k, 3)."""

    value: Array
    first: Array
    second: Array

    def __add__(self, other: VectorJet) -> VectorJet:
        return VectorJet(
            self.value + other.value, self.first + other.first, self.second + other.second
        )

    def __sub__(self, other: VectorJet) -> VectorJet:
        return VectorJet(
            self.value - other.value, self.first - other.first, self.second - other.second
        )

    def __neg__(self) -> VectorJet:
        return VectorJet(-self.value, -self.first, -self.second)

    def __mul__(self, factor: ScalarJet | float) -> VectorJet:
        if not isinstance(factor, ScalarJet):
            return VectorJet(self.value * factor, self.first * factor, self.second * factor)
        mixed = factor.first[:, :, None, None] * self.first[:, None, :, :]
        return VectorJet(
            factor.value[:, None] * self.value,
            factor.value[:, None, None] * self.first
            + factor.first[:, :, None] * self.value[:, None],
            factor.value[:, None, None, None] * self.second
            + factor.second[..., None] * self.value[:, None, None]
            + mixed
            + np.swapaxes(mixed, 1, 2),
        )

    def dot(self, other: VectorJet) -> ScalarJet:
        """Scalar product."""
        mixed = np.einsum("nji,nki->njk", self.first, other.first)
        return ScalarJet(
            np.einsum("ni,ni->n", self.value, other.value),
            np.einsum("nji,ni->nj", self.first, other.value)
            + np.einsum("ni,nji->nj", self.value, other.first),
            np.einsum("njki,ni->njk", self.second, other.value)
            + np.einsum("ni,njki->njk", self.value, other.second)
            + mixed
            + np.swapaxes(mixed, 1, 2),
        )

    def cross(self, other: VectorJet) -> VectorJet:
        """Vector product."""
        mixed = cross(self.first[:, :, None], other.first[:, None, :])
        return VectorJet(
            cross(self.value, other.value),
            cross(self.first, other.value[:, None]) + cross(self.value[:, None], other.first),
            cross(self.second, other.value[:, None, None])
            + cross(self.value[:, None, None], other.second)
            + mixed
            + np.swapaxes(mixed, 1, 2),
        )


def cross(a: Array, b: Array) -> Array:
    """Cross product over the last axis; on small arrays several times faster than numpy's."""
    return np.stack(
        [
            a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1],
            a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2],
            a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0],
        ],
        axis=-1,
    )
