"""Outlines of links as bodies: of the URDF's visuals, of ``outline``, or hulls of pins.

What one coordinate moves before the next is one body, in the plate of its first link. If any of
its links has visuals, their outlines are the body. Else it is what ``[requirements.outline]`` of
its links says, else the rounded hull of its pins, joints, tool and loads. Holes are filled. The
only door to shapely.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from armdesign.arrays import Array
from armdesign.drawing.plane import PicturePlane, placed
from armdesign.drawing.visuals import convex_pieces, visuals
from armdesign.units import mm

if TYPE_CHECKING:
    from armdesign.machine.load_case import LoadCase
    from armdesign.machine.machine import Machine
    from armdesign.mechanism.linkage.base import Pin

FINE = 4e-4  # of the machine's size: details that outlines leave out
HULL = 0.02  # of the machine's size: half the width of a hull of pins
ROUND = 6  # segments of a quarter circle
GRID = 1e-5  # [m] on which corners of visuals lie
FEW = 1_000  # triangles of a mesh that are united one by one
MOST_EDGES = 20_000  # of a mesh that may be its border; where there are more, its hull is drawn
SOURCES = ("visuals", "outline", "pins")


@dataclass(frozen=True, eq=False, kw_only=True)
class DrawnBody:
    """Bodies that one coordinate moves before the next, from the side.

    Attributes:
        link: its first link, in whose plate the polygons are.
        links: all its links.
        source: what its outlines are: "visuals" of the URDF, "outline" of the machine file, or
            hull of its "pins".
        polygons: outlines (m, 2) [m], none where nothing but one point is known.
    """

    link: str
    links: tuple[str, ...]
    source: str
    polygons: tuple[Array, ...]


@lru_cache(maxsize=8)  # every picture of a machine shows them
def bodies(machine: Machine) -> tuple[DrawnBody, ...]:
    """Bodies of a machine: the one that stands still, then of each coordinate (k + 1)."""
    arm, folder = machine.arm, (machine.source.parent / (machine.section.urdf or "")).parent
    of_links, plane = visuals(machine.urdf_text, folder), PicturePlane(machine.heading)
    groups = [
        tuple(name for name, link in arm.links.items() if link.joint == joint)
        for joint in range(-1, len(arm.coordinates))
    ]
    points = [_points(machine, plane, links) for links in groups]
    everywhere = np.concatenate([at for at in points if len(at)] or [np.zeros((1, 2))])
    size = float(np.ptp(everywhere, axis=0).max()) or 1.0
    drawn = []
    for links, own in zip(groups, points, strict=True):
        seen = {
            "visuals": [_of_visuals(plane, link, of_links[link]) for link in links],
            "outline": [_of_outline(machine, plane, link) for link in links],
            "pins": [_hull(own, HULL * size)],
        }
        source = next((s for s in SOURCES if any(not shape.is_empty for shape in seen[s])), "pins")
        to_plate = _to_plate(plane, links[0])
        polygons = (p for shape in seen[source] for p in _polygons(shape, FINE * size))
        corners = tuple(placed(to_plate, polygon) for polygon in polygons)
        drawn.append(DrawnBody(link=links[0], links=links, source=source, polygons=corners))
    return tuple(drawn)


def distance(polygons: Iterable[Array], point: Array) -> float:
    """Distance [m] of a point (2,) from the nearest of some polygons; 0 within, inf from none."""
    import shapely

    outlines = [shapely.Polygon(polygon) for polygon in polygons]
    at = shapely.Point(point)
    return min((shape.distance(at) for shape in outlines), default=np.inf)


def area_between(lines: Iterable[Sequence[Array]], first: Iterable[Array] | None) -> Any:
    """Area that lines (m, 2) sweep from each of their places to the next.

    Args:
        lines: each line at all its places.
        first: rings of an area that belongs to it, too; None: none.
    """
    import shapely

    swept = []
    for places in lines:
        path = np.stack(places)
        sides = path[:-1, :-1], path[:-1, 1:], path[1:, 1:], path[1:, :-1]
        cells = shapely.make_valid(shapely.polygons(np.stack(sides, axis=2)))
        swept += list(shapely.union_all(cells, axis=0))  # what each piece of the line sweeps
    rings = [] if first is None else [shapely.make_valid(shapely.polygons(ring)) for ring in first]
    outer = max(rings, key=lambda ring: float(ring.area), default=shapely.Polygon())
    for ring in rings:  # the others are holes
        outer = outer if ring is outer else outer.difference(ring)
    return shapely.union_all([*swept, outer])


def simplified(shape: Any, tolerance: float) -> Any:
    """A shape without details finer than a tolerance [m]."""
    return shape.simplify(tolerance)


def lines_of(shape: Any, least: float) -> list[Array]:
    """Closed lines (m, 2) about a shape and its holes, each about at least some area [m²]."""
    import shapely

    areas = [part for part in shapely.get_parts(shape) if part.geom_type == "Polygon"]
    rings = [ring for part in areas for ring in (part.exterior, *part.interiors)]
    wide = [ring for ring in rings if shapely.Polygon(ring).area >= least]
    return [np.array(ring.coords) for ring in wide]


def _to_plate(plane: PicturePlane, link: str) -> Array:
    """Matrix (2, 3) from the picture, all joints at 0, to a link's plate."""
    matrix = plane.placements(plane.zero, link)[0]
    inverse = np.linalg.pinv(matrix[:, :2])
    return np.concatenate([inverse, -inverse @ matrix[:, 2:]], axis=1)


def _of_visuals(plane: PicturePlane, link: str, of_link: Iterable[Any]) -> Any:
    """All visuals of a link as one shape in the picture, all joints at 0."""
    import shapely

    arm, rotation = plane.arm, plane.arm.link_rotation(plane.zero, link)[0]
    foot = arm.point(plane.zero, link, np.zeros(3))[0]
    pieces = [plane.project(convex_pieces(shape) @ rotation.T + foot) for shape in of_link]
    hulls = [
        [_covered(piece)]
        if len(piece) > FEW
        else shapely.convex_hull(shapely.multipoints(shapely.points(piece)))
        for piece in pieces
    ]
    areas = [hull for of_piece in hulls for hull in of_piece if hull.area > 0]
    return shapely.union_all(areas, grid_size=GRID) if areas else shapely.Polygon()


def _covered(triangles: Array) -> Any:
    """The part of the plane that triangles (n, 3, 2) [m] cover, in time that grows with n.

    Edges with triangles on both sides are no border. Of a closed surface few are left, which part
    the plane into faces, each covered or not. Where too many are left, it is the convex hull.
    """
    import shapely

    corners = np.rint(triangles / GRID)
    one, other = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    turn = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
    corners = np.where(turn[:, None, None] < 0, corners[:, ::-1], corners)[turn != 0] * GRID
    if len(corners) == 0:
        return shapely.Polygon()
    edges = _one_sided(corners)
    if len(edges) > MOST_EDGES:
        return shapely.convex_hull(shapely.multipoints(corners.reshape(-1, 2)))
    lines = shapely.union_all(shapely.linestrings(edges), grid_size=GRID)
    faces = shapely.get_parts(shapely.polygonize([lines]))
    tree = shapely.STRtree(shapely.polygons(corners))
    inside = tree.query(shapely.point_on_surface(faces), predicate="intersects")[0]
    return shapely.union_all(faces[np.unique(inside)], grid_size=GRID)


def _one_sided(corners: Array) -> Array:
    """Edges (m, 2, 2) with triangles (n, 3, 2), all turning left, on their left alone."""
    _, number = np.unique(corners.reshape(-1, 2), axis=0, return_inverse=True)
    number = number.reshape(-1, 3)
    begin, end = number.ravel(), np.roll(number, -1, axis=1).ravel()
    there, back = (a * (number.max() + 1) + b for a, b in ((begin, end), (end, begin)))
    alone = ~np.isin(there, back)
    ends = np.roll(corners, -1, axis=1).reshape(-1, 2)
    return np.stack([corners.reshape(-1, 2)[alone], ends[alone]], axis=1)


def _of_outline(machine: Machine, plane: PicturePlane, link: str) -> Any:
    """The outline that the machine file gives a link, in the picture, all joints at 0."""
    import shapely

    section = machine.section.requirements.outline.get(link)
    if section is None:
        return shapely.Polygon()
    corners = np.array([[x, 0.0, z] for x, z in section.points_mm]) * mm
    plate = corners @ plane.plate(link).T
    return shapely.Polygon(placed(plane.placements(plane.zero, link)[0], plate)).buffer(0)


def _points(machine: Machine, plane: PicturePlane, links: tuple[str, ...]) -> Array:
    """Joints, pins, ends, tool and loads on some links (m, 2), in the picture, all joints at 0."""
    arm, zero = machine.arm, plane.zero
    known = [*((str(pin.link), pin.at) for pin in _pins(machine, links)), *_ends(machine, links)]
    places = [arm.point(zero, link, np.array(at))[0] for link, at in known]
    first = arm.links[links[0]].joint
    for index, joint in enumerate(arm.coordinates):
        if index == first or joint.parent == first:
            places.append(zero.translation[0, index])
    distinct = np.unique(np.round(plane.project(np.reshape(places, (-1, 3))), 6), axis=0)
    return np.asarray(distinct)


def _pins(machine: Machine, links: tuple[str, ...]) -> Iterator[Pin | LoadCase]:
    every: list[Pin | LoadCase] = [
        machine.tool,
        *machine.payloads,
        *(pin for own in machine.linkages for pin in own.pins),
    ]
    return (pin for pin in every if pin.link in links)


def _ends(machine: Machine, links: tuple[str, ...]) -> Iterator[tuple[str, tuple[float, ...]]]:
    """Ends of links of ``[links]`` that have a length: a telescope's boom has no joint at its."""
    for name in links:
        section = machine.section.links.get(name)
        if section is not None and section.length_mm is not None:
            yield name, (section.length_mm * mm, 0.0, 0.0)


def _hull(points: Array, radius: float) -> Any:
    """Rounded hull of at least two points."""
    import shapely

    if len(points) < 2:
        return shapely.Polygon()
    return shapely.MultiPoint(points).convex_hull.buffer(radius, quad_segs=ROUND)


def _polygons(shape: Any, tolerance: float) -> Iterator[Array]:
    """Outer rings of a shape's polygons (m, 2), without the first corner again at their end."""
    import shapely

    simple = shape.simplify(tolerance)
    for part in shapely.get_parts(simple):
        if part.geom_type == "Polygon" and not part.is_empty:
            yield np.array(part.exterior.coords)[:-1]


def triangles_of(outline: Array) -> Array:
    """Triangles (t, 3, 2), anticlockwise, that fill an outline (m, 2) without crossings."""
    import shapely

    shape = shapely.Polygon(outline)
    parts = shapely.get_parts(shapely.constrained_delaunay_triangles(shape))
    oriented = [shapely.orient_polygons(part) for part in parts]
    corners = [np.array(part.exterior.coords)[:3] for part in oriented]
    return np.reshape(corners, (-1, 3, 2))
