"""Triangle meshes of simple bodies: tubes, plates of outlines, visuals of a URDF."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from armdesign.arrays import Array
from armdesign.drawing.outlines import triangles_of
from armdesign.drawing.visuals import Visual, convex_pieces

ROUND = 24  # corners of a circle


@dataclass(frozen=True, eq=False)
class Mesh:
    """A surface of triangles, seen from the side where their corners run anticlockwise.

    Attributes:
        vertices: corners (m, 3) [m].
        faces: three corners each (t, 3), by index.
    """

    vertices: Array
    faces: Any

    def placed(self, rotation: Array, translation: Array) -> Mesh:
        """The mesh turned by a matrix (3, 3), then moved by (3,) [m]."""
        return Mesh(self.vertices @ rotation.T + translation, self.faces)


def joined(meshes: Iterable[Mesh]) -> Mesh:
    """Several meshes as one."""
    parts = list(meshes)
    first = np.cumsum([0, *(len(part.vertices) for part in parts)])
    faces = [part.faces + begin for part, begin in zip(parts, first, strict=False)]
    return Mesh(
        np.concatenate([np.zeros((0, 3)), *(part.vertices for part in parts)]),
        np.concatenate([np.zeros((0, 3), dtype=int), *faces]),
    )


def tube(begin: Array, end: Array, radius: float) -> Mesh:
    """A closed round tube between two points (3,) [m]."""
    along = np.asarray(end - begin, dtype=float)
    along /= float(np.linalg.norm(along)) or 1.0
    across = np.cross(along, np.eye(3)[int(np.abs(along).argmin())])
    across /= np.linalg.norm(across)
    angle = np.linspace(0, 2 * np.pi, ROUND, endpoint=False)[:, None]
    rim = radius * (np.cos(angle) * across + np.sin(angle) * np.cross(along, across))
    vertices = np.concatenate([begin + rim, end + rim, [begin, end]])
    k = np.arange(ROUND)
    after, low, high = (k + 1) % ROUND, 2 * ROUND, 2 * ROUND + 1
    sides = [[k, after, ROUND + after], [k, ROUND + after, ROUND + k]]
    caps = [[after, k, np.full(ROUND, low)], [ROUND + k, ROUND + after, np.full(ROUND, high)]]
    return Mesh(vertices, np.concatenate([np.stack(part, axis=1) for part in sides + caps]))


def plate(outline: Array, axes: Array, across: Array, thickness: float) -> Mesh:
    """A plate of an outline (m, 2) [m].

    Args:
        outline: its corners, in the plane of the axes.
        axes: two directions (2, 3), at right angles.
        across: the middle of its thickness along their cross product, as a point (3,) [m].
        thickness: of the plate [m].
    """
    flat = triangles_of(outline)
    corners = flat.reshape(-1, 2) @ axes
    normal = np.cross(*axes)
    half = thickness / 2 * normal
    count = len(corners)
    ahead = np.arange(count).reshape(-1, 3)
    ring = np.asarray(outline, dtype=float)
    if _area(ring) < 0:
        ring = ring[::-1]
    rim, k = ring @ axes, np.arange(len(ring))
    after, m = (k + 1) % len(ring), len(ring)
    first = 2 * count
    sides = [[k, m + after, m + k], [k, after, m + after]]
    walls = first + np.concatenate([np.stack(part, axis=1) for part in sides])
    vertices = np.concatenate([corners + half, corners - half, rim - half, rim + half]) + across
    faces = np.concatenate([ahead, count + ahead[:, ::-1], walls])
    return Mesh(vertices, faces)


def of_visual(visual: Visual) -> Mesh:
    """A visual of a URDF in its link's frame."""
    pieces = convex_pieces(visual)
    if visual.kind == "mesh":
        corners, places = np.unique(pieces.reshape(-1, 3), axis=0, return_inverse=True)
        return Mesh(corners, places.reshape(-1, 3))
    return joined(_hull(corners) for corners in pieces)


def _hull(corners: Array) -> Mesh:
    """The surface of a convex body by its corners (m, 3); nothing of a flat one."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(corners)
    except QhullError:
        return joined([])
    faces = np.array(hull.simplices)
    first, second, third = np.moveaxis(corners[faces], 1, 0)
    outwards = np.einsum(
        "ti,ti->t", np.cross(second - first, third - first), hull.equations[:, :3]
    )
    faces[outwards < 0] = faces[outwards < 0][:, ::-1]
    return Mesh(np.asarray(corners), faces)


def _area(ring: Array) -> float:
    """Area [m²] of a ring of corners (m, 2), positive where they run anticlockwise."""
    x, y = ring.T
    return float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) / 2)
