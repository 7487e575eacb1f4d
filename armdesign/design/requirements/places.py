"""Places of pins and barrels: polygons that hold them or that they keep clear of.

Elementwise over any leading axes, and complex-safe: which edge or corner is nearest is decided by
the real parts.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple, TypeAlias

import numpy as np

from armdesign.arrays import Array, Flags, mesh
from armdesign.design.requirements.candidate import Candidate, Reference, diameters
from armdesign.design.requirements.record import Evaluation, names_begin_with
from armdesign.design.requirements.stated import (
    Frozen,
    Names,
    at_work,
    cylinders,
    entries,
    fault_of,
)
from armdesign.errors import ArmDesignError
from armdesign.hydraulics.cylinder_build import barrel_outer
from armdesign.machine.file.polygons import CROSSED, IN_ORDER, cross, crosses_itself, edges
from armdesign.machine.file.schema import ClearanceSection, OutlineSection
from armdesign.machine.machine import Machine
from armdesign.mechanism.joint_ranges import over
from armdesign.mechanism.linkage.base import Pin
from armdesign.mechanism.rigid_poses import RigidPoses
from armdesign.units import mm


def depth(at: Array, polygon: Array) -> Array:
    """Distance of points (…, 2) within a polygon from each of its edges (…, m).

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
    return _contact(start.real, end.real, polygon).distance(start, end, polygon)


class Contact(NamedTuple):
    """Where bars and a polygon are nearest: an end of the one and a side of the other.

    Attributes:
        edge: number of the polygon's edge (…,).
        point: 0 or 1: start or end of the bar, next to the edge; 2 or 3: of the edge, next to the
            bar (…,).
        square: of their distance, negative where it counts negative (…,) [m²].
    """

    edge: Array
    point: Array
    square: Array

    def distance(self, start: Array, end: Array, polygon: Array) -> Array:
        """Distance of these parts of bars (…, 2) and polygon, with its sign (…,)."""
        u, v = (corners[self.edge] for corners in edges(polygon))
        point, of_edge = self.point[..., None], (self.point >= 2)[..., None]
        parts = np.broadcast_arrays(start, end, u, v)
        at = np.choose(point, parts)
        gap = _to_segment(at, np.where(of_edge, start, u), np.where(of_edge, end, v))
        return np.where(self.square < 0, -gap, gap)

    def at(self, rows: Array) -> Contact:
        """Contacts of some rows."""
        return Contact(*(part[rows] for part in self))


def _contact(start: Array, end: Array, polygon: Array) -> Contact:
    """Where bars (…, 2) and a polygon are nearest, in real numbers."""
    u, v = edges(polygon)
    a, b = start[..., None, :], end[..., None, :]
    from_edge, from_bar = _square(np.stack([a, b]), u, v), _square(u, a, b)
    # the end of an edge is the start of the next
    squares = np.stack([*from_edge, from_bar, np.roll(from_bar, -1, axis=-1)])
    point, least = squares.argmin(axis=0), squares.min(axis=0)
    crossed = cross(a, b, u, v)
    signed = np.where(crossed, -least, least)
    edge = signed.argmin(axis=-1)[..., None]
    point, square = (np.take_along_axis(part, edge, axis=-1)[..., 0] for part in (point, signed))
    wholly_inside = _inside(start, polygon) & ~crossed.any(axis=-1)
    return Contact(edge[..., 0], point, np.where(wholly_inside, -square, square))


def _to_segment(point: Array, start: Array, end: Array) -> Array:
    """Distance from points to segments (…,)."""
    return np.asarray(np.sqrt(_square(point, start, end)))


def _square(point: Array, start: Array, end: Array) -> Array:
    """Square of the distance from points to segments (…,)."""
    along, away = end - start, point - start
    square = _dot(along, along)
    share = _dot(away, along) / np.where(square == 0, 1.0, square)
    share = np.where(share.real < 0, 0.0, np.where(share.real > 1, 1.0, share))
    gap = away - share[..., None] * along
    return _dot(gap, gap)


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1])


def _inside(point: Array, polygon: Array) -> Flags:
    """Whether points (…, 2) lie inside: a ray to the right meets an odd number of edges."""
    u, v = edges(polygon)
    x, z = point[..., 0, None], point[..., 1, None]
    spans = (u[:, 1] > z) != (v[:, 1] > z)
    rise = np.where(v[:, 1] == u[:, 1], 1.0, v[:, 1] - u[:, 1])
    met = u[:, 0] + (z - u[:, 1]) * (v[:, 0] - u[:, 0]) / rise
    return np.asarray((spans & (x < met)).sum(axis=-1) % 2 == 1)


Points: TypeAlias = tuple[tuple[float, float], ...]  # corners (x, z) of a polygon in a link [m]

# values of each joint between a barrel and the link it keeps clear of, by their number
MESH = {1: 121, 2: 25, 3: 11}
NEAREST = 12  # poses of least clearance that count
HELD = 1e-8  # [m] by which an outline may miss today's pin
ROUNDING = 7.1e-5  # [m] that a pin on the 0.1 mm grid may lie beside its place


@dataclass(frozen=True, kw_only=True)
class Outline(Frozen):
    """An outline (x, z) [m] of a link: cylinder pins on it lie within it by their radius [m]."""

    link: str
    points: Points
    pin_radius: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Clearance(Frozen):
    """A distance [m] of the barrels of cylinders from a part of a link with corners (x, z) [m]."""

    name: str
    cylinders: tuple[str, ...]
    link: str
    points: Points
    distance: float = 0.0


def _points(points: list[list[float]]) -> Points:
    return tuple((x * mm, z * mm) for x, z in points)


def _read_outline(machine: Machine, link: str, section: OutlineSection) -> Outline:
    points = _points(section.points_mm)
    return Outline(link=link, points=points, pin_radius=section.pin_radius_mm * mm)


def _read_clearance(machine: Machine, name: str, section: ClearanceSection) -> Clearance | None:
    barrels = tuple(cylinder for cylinder in section.cylinders if at_work(machine, cylinder))
    return (
        Clearance(
            name=name,
            cylinders=barrels,
            link=section.link,
            points=_points(section.points_mm),
            distance=section.distance_mm * mm,
        )
        if barrels
        else None
    )


def _outline_names(outline: Outline, machine: Machine) -> Names:
    yield "outline", "link", [outline.link], machine.arm.links


def _clearance_names(clear: Clearance, machine: Machine) -> Names:
    yield f"clearance.{clear.name}", "cylinder", clear.cylinders, cylinders(machine)
    yield f"clearance.{clear.name}", "link", [clear.link], machine.arm.links


def _check(part: Outline | Clearance) -> None:
    key = f"outline.{part.link}" if isinstance(part, Outline) else f"clearance.{part.name}"
    where = f"requirements.{key}"
    if len(part.points) < 3:
        raise ArmDesignError(where, f"has {len(part.points)} points", "give at least 3")
    if crosses_itself(part.points):
        raise ArmDesignError(where, CROSSED, IN_ORDER)


@dataclass(frozen=True, kw_only=True)
class PinPlaces:
    """Settings: places of pins and barrels.

    Attributes:
        outlines: of links, for the pins on them.
        clearances: of barrels from links.
    """

    outlines: tuple[Outline, ...] = entries(
        "outline",
        _read_outline,
        ("pin_radius_mm", "pin_radius", mm),
        _outline_names,
        label="link",
        check=_check,
    )
    clearances: tuple[Clearance, ...] = entries(
        "clearance",
        _read_clearance,
        ("distance_mm", "distance", mm),
        _clearance_names,
        check=_check,
    )


def pins_on(machine: Machine, link: str) -> Iterator[tuple[int, str, Pin]]:
    """Cylinders with a pin on a link: index, the pin's name, the pin."""
    for i, linkage in enumerate(machine.linkages):
        for name in linkage.pin_names:
            if (pin := linkage.pin(name)) is not None and pin.link == link:
                yield i, name, pin


def pins_outside(machine: Machine, outlines: Iterable[Outline]) -> Iterator[ArmDesignError]:
    """Pins of a machine that an outline does not hold by its radius, with the distance lacking."""
    for outline in outlines:
        for i, name, pin in pins_on(machine, outline.link):
            x, z = pin.at[0] / mm, pin.at[2] / mm
            within = float(depth(np.array([x, z]) * mm, np.array(outline.points)).min()) / mm
            radius, cylinder = outline.pin_radius / mm, machine.cylinders[i].name
            if within < radius - HELD / mm:
                yield fault_of(
                    machine,
                    f"outline.{outline.link}",
                    outline.link in machine.section.requirements.outline,
                    f"does not hold today's {name} pin of the {cylinder} cylinder at x {x:.1f},"
                    f" z {z:.1f} mm: it is {abs(within):.1f} mm"
                    f" {'outside' if within < 0 else 'within'} it, pin_radius_mm is {radius:g}",
                    f"move the edge there out by {radius - within:.1f} mm"
                    f"{' or lower pin_radius_mm' if within > 0 else ''}",
                )


@names_begin_with("outline")
def outlines(new: Candidate, reference: Reference) -> Iterator[Evaluation]:
    """Every pin on an outlined link, as far within the outline as its radius."""
    for outline in reference.requirements.outlines:
        polygon = np.array(outline.points)
        size = float(np.ptp(polygon, axis=0).max()) or 1.0
        pins = {
            (reference.today.cylinders[i].name, name): place[:, [0, 2]]
            for i, name, _ in pins_on(reference.today, outline.link)
            if (place := new.place(i, name)) is not None
        }
        within = depth(np.stack([*pins.values()]), polygon) if pins else ()
        for (cylinder, name), value in zip(pins, within, strict=True):
            yield Evaluation(
                name=f"outline.{cylinder}.{name}",
                words=f"{name} pin of the {cylinder} cylinder within the {outline.link}'s outline",
                unit="m",
                value=value,
                limit=outline.pin_radius,
                at_least=True,
                slack_scale=size,
                rounding_loss=ROUNDING / size,
                setting=f"outline.{outline.link}.pin_radius_mm",
            )


@names_begin_with("clearance")
def clearances(new: Candidate, reference: Reference) -> Iterator[Evaluation]:
    """Distance of barrels from parts of links, at the poses of least clearance."""
    for part in reference.requirements.clearances:
        for name in part.cylinders:
            i = cylinders(reference.today).index(name)
            stroke = reference.today.cylinders[i].stroke
            yield Evaluation(
                name=f"clearance.{part.name}.{name}",
                words=f"clearance of the {name} barrel, {part.name}",
                unit="m",
                value=_clear_distance(new, reference, part, i),
                limit=part.distance,
                at_least=True,
                slack_scale=stroke,
                rounding_loss=2 * ROUNDING / stroke,
                curved=True,
                setting=f"clearance.{part.name}.distance_mm",
            )


def _clear_distance(new: Candidate, reference: Reference, part: Clearance, i: int) -> Array:
    """Distance of a barrel from a part of a link (b, n) [m], at the poses where it is least.

    A barrel is a bar of its outer diameter from the base pin, half as long as the open cylinder,
    as for buckling.
    """
    poses, turn, origin = _poses_between(reference.today, part, i)
    length, polygon = (new.closed[:, i] + new.stroke[:, i]) / 2, np.array(part.points)
    # which poses count depends on no steps, nor what is nearest there
    base, end = new.linkages[i].ends(poses)
    start, tip = _barrel(turn, origin, base[None], end[None], length[:1].real)
    contact = _contact(start[0], tip[0], polygon)
    few = np.argsort(contact.square)[:NEAREST]
    start, tip = _barrel(turn[few], origin[few], *new.span(i, poses[few]), length)
    free = contact.at(few).distance(start, tip, polygon)
    wall, pressure = new.machine.cylinders[i].barrel_wall, new.machine.supply.pressure
    radius = barrel_outer(diameters(new, i)[0], wall, pressure) / 2
    return np.asarray(free - radius[:, None])


def _barrel(
    turn: Array, origin: Array, base: Array, end: Array, length: Array
) -> tuple[Array, Array]:
    """Ends (b, n, 2) of barrels of a length (b,) in the plane of a link, from pins (b, n, 3).

    ``turn`` (n, 3, 3) and ``origin`` (n, 3) place the link in the world.
    """
    along = end - base
    span = np.sqrt((along**2).sum(axis=-1))[..., None]
    tip = base + along / span * length[:, None, None]
    first, second = (
        np.einsum("bni,nij->bnj", pin - origin, turn)[..., [0, 2]] for pin in (base, tip)
    )
    return first, second


@lru_cache(maxsize=64)
def _poses_between(today: Machine, part: Clearance, i: int) -> tuple[RigidPoses, Array, Array]:
    """Poses over the ranges of the joints between a cylinder and the link it keeps clear of.

    And that link's orientation (n, 3, 3) and place (n, 3) there.
    """
    arm, linkage = today.arm, today.linkages[i]
    path = (j for j, _ in arm.path(linkage.base.link, part.link) if j < len(arm.joints))
    between = sorted({*linkage.joints, *path})
    count = MESH.get(len(between), 5)
    axes = [over(today.ranges[j], count) for j in between]
    q = np.tile(today.ranges.mean(axis=1), (count ** len(between), 1))
    q[:, between] = mesh(axes)
    poses = arm.kinematics(q)
    return poses, arm.link_rotation(poses, part.link), arm.point(poses, part.link, np.zeros(3))
