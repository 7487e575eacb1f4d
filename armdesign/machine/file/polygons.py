"""Polygons of points in a plane: their edges, and whether any two cross."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from armdesign.arrays import Array, Flags

CROSSED, IN_ORDER = "its edges cross", "give its corners in their order around it"


def edges(points: Array) -> tuple[Array, Array]:
    """Starts and ends (m, 2) of the edges of a closed polygon (m, 2)."""
    return points, np.roll(points, -1, axis=0)


def cross(a: Array, b: Array, u: Array, v: Array) -> Flags:
    """Whether segments a–b and u–v cross (…,)."""
    return np.asarray(
        (_turn(a, b, u) * _turn(a, b, v) < 0) & (_turn(u, v, a) * _turn(u, v, b) < 0)
    )


def crosses_itself(points: ArrayLike) -> bool:
    """Whether two edges of a polygon (m, 2) cross."""
    u, v = edges(np.asarray(points, dtype=float))
    return bool(cross(u[:, None], v[:, None], u, v).any())


def _turn(a: Array, b: Array, c: Array) -> Array:
    """Twice the area of the triangle a, b, c: positive where it turns left."""
    along, beyond = b - a, c - a
    return np.asarray(along[..., 0] * beyond[..., 1] - along[..., 1] * beyond[..., 0])
