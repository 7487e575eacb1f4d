"""Point masses and slender bars that points of the arm carry: their M, g and ∂g/∂q."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armdesign.arrays import Array
from armdesign.mechanism.jets import VectorJet
from armdesign.units import GRAVITY


def of_points(points: Sequence[tuple[float, VectorJet]]) -> tuple[Array, Array, Array]:
    """M, g and ∂g/∂q of point masses [kg]: Σ m JᵀJ, Σ m g ∂z/∂q, Σ m g ∂²z/∂q²."""
    inertia = gravity = slope = np.zeros(())
    for mass, p in points:
        m = np.reshape(mass, (-1, 1, 1))  # one mass, or one for each row
        inertia = inertia + m * (p.first @ np.swapaxes(p.first, 1, 2))
        gravity = gravity + m[..., 0] * GRAVITY * p.first[:, :, 2]
        slope = slope + m * GRAVITY * p.second[:, :, :, 2]
    return inertia, gravity, slope


def of_bar(ends: tuple[VectorJet, VectorJet]) -> tuple[Array, Array, Array]:
    """M, g and ∂g/∂q of a kilogram in a uniform slender bar between two points.

    The sums over ``points_of_bar``: with J and K of its ends M = (JᵀJ + KᵀK + (J + K)ᵀ(J + K))/6.
    """
    both = ends[0] + ends[1]
    first, last, of_sum = (p.first @ np.swapaxes(p.first, 1, 2) for p in (*ends, both))
    gravity, slope = both.first[:, :, 2], both.second[:, :, :, 2]
    return (first + last + of_sum) / 6, GRAVITY / 2 * gravity, GRAVITY / 2 * slope


def points_of_bar(mass: float, ends: tuple[VectorJet, VectorJet]) -> list[tuple[float, VectorJet]]:
    """Three point masses that move, weigh and store like a uniform slender bar between two points.

    A sixth of the mass at either end, the rest in the middle (Simpson's rule, exact: all is
    quadratic along the bar).
    """
    middle = (ends[0] + ends[1]) * 0.5
    return [(mass / 6, ends[0]), (2 * mass / 3, middle), (mass / 6, ends[1])]
