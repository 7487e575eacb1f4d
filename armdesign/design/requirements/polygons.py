"""Outlines: polygons in a plane, and how far points and bars are from them.

Elementwise over any leading axes, and complex-safe: which edge or corner is nearest is decided by
the real parts.
"""

from __future__ import annotations

import numpy as np

from armdesign.arrays import Array, Flags


def edges(points: Array) -> tuple[Array, Array]:
    """Starts and ends (m, 2) of the edges of a closed polygon (m, 2)."""
    return points, np.roll(points, -1, axis=0)


def depth(at: Array, polygon: Array) -> Array:
    """How far points (…, 2) lie within a polygon, from each of its edges (…, m).

    All are negative for a point outside: minus the distance to the nearest edge.
    """
    starts, ends = edges(polygon)
    distance = _to_segment(at[..., None, :], starts, ends)
    nearest = np.take_along_axis(distance, distance.real.argmin(axis=-1)[..., None], axis=-1)
    return np.where(_inside(at.real, polygon)[..., None], distance, -nearest)


def clearance(start: Array, end: Array, polygon: Array) -> Array:
    """Distance between bars from ``start`` to ``end`` (…, 2) and a polygon's area (…,).

    Exact where they are apart. Where a bar crosses an edge, minus the least distance by which an
    end of the one must move to uncross them; where it lies wholly inside, minus the distance to
    the nearest edge.
    """
    u, v = edges(polygon)
    a, b = start[..., None, :], end[..., None, :]
    gaps = np.stack(
        [_to_segment(a, u, v), _to_segment(b, u, v), _to_segment(u, a, b), _to_segment(v, a, b)],
        axis=-1,
    )
    gap = _least(gaps)
    crossed = _cross(a.real, b.real, u, v)
    wholly_inside = _inside(start.real, polygon) & ~crossed.any(axis=-1)
    nearest = _least(np.where(crossed, -gap, gap))
    return np.where(wholly_inside, -nearest, nearest)


def _least(values: Array) -> Array:
    """The entry of least real part along the last axis."""
    return np.take_along_axis(values, values.real.argmin(axis=-1)[..., None], axis=-1)[..., 0]


def _to_segment(point: Array, start: Array, end: Array) -> Array:
    """Distance from points to segments (…,)."""
    along, away = end - start, point - start
    square = _dot(along, along)
    share = _dot(away, along) / np.where(square == 0, 1.0, square)
    share = np.where(share.real < 0, 0.0, np.where(share.real > 1, 1.0, share))
    gap = away - share[..., None] * along
    return np.asarray(np.sqrt(_dot(gap, gap)))


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1])


def _turn(a: Array, b: Array, c: Array) -> Array:
    """Twice the area of the triangle a, b, c: positive where it turns left."""
    along, beyond = b - a, c - a
    return np.asarray(along[..., 0] * beyond[..., 1] - along[..., 1] * beyond[..., 0])


def _cross(a: Array, b: Array, u: Array, v: Array) -> Flags:
    """Whether segments a–b and u–v cross."""
    return np.asarray(
        (_turn(a, b, u) * _turn(a, b, v) < 0) & (_turn(u, v, a) * _turn(u, v, b) < 0)
    )


def _inside(point: Array, polygon: Array) -> Flags:
    """Whether points (…, 2) lie inside: a ray to the right meets an odd number of edges."""
    u, v = edges(polygon)
    x, z = point[..., 0, None], point[..., 1, None]
    spans = (u[:, 1] > z) != (v[:, 1] > z)
    rise = np.where(v[:, 1] == u[:, 1], 1.0, v[:, 1] - u[:, 1])
    met = u[:, 0] + (z - u[:, 1]) * (v[:, 0] - u[:, 0]) / rise
    return np.asarray((spans & (x < met)).sum(axis=-1) % 2 == 1)
