"""Places of pins and barrels: outlines of links, and clearances from parts of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeAlias

import numpy as np

from armdesign.arrays import Array
from armdesign.design.requirements.candidate import Candidate, Reference, diameters
from armdesign.design.requirements.polygons import clearance, depth
from armdesign.design.requirements.record import Evaluation
from armdesign.design.requirements.stated import Frozen, Names, at_work, cylinders, entries
from armdesign.errors import ArmDesignError
from armdesign.hydraulics.barrel import barrel_outer
from armdesign.machine.file.requirements_schema import ClearanceSection, OutlineSection
from armdesign.machine.machine import Machine
from armdesign.mechanism.arm import RigidPoses
from armdesign.mechanism.joint_ranges import over
from armdesign.units import mm

Points: TypeAlias = tuple[tuple[float, float], ...]  # corners (x, z) of a polygon in a link [m]

# values of each joint between a barrel and the link it keeps clear of, by their number
MESH = {1: 121, 2: 25, 3: 11}
NEAREST = 12  # poses of least clearance that count
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
    if len(part.points) < 3:
        where = f"requirements: outline on {part.link}"
        raise ArmDesignError(where, f"has {len(part.points)} points", "give at least 3")


@dataclass(frozen=True, kw_only=True)
class Places:
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


def outlines(new: Candidate, reference: Reference) -> Iterator[Evaluation]:
    """Every pin on an outlined link, as far within the outline as its radius."""
    for outline in reference.requirements.outlines:
        polygon = np.array(outline.points)
        size = float(np.ptp(polygon, axis=0).max()) or 1.0
        for i, linkage in enumerate(reference.today.linkages):
            cylinder = reference.today.cylinders[i].name
            for name in linkage.pin_names:
                pin, place = linkage.pin(name), new.place(i, name)
                if pin is None or place is None or pin.link != outline.link:
                    continue
                yield Evaluation(
                    name=f"outline.{cylinder}.{name}",
                    words=f"{name} pin of the {cylinder} cylinder within the"
                    f" {outline.link}'s outline",
                    unit="m",
                    value=depth(place[:, [0, 2]], polygon),
                    limit=outline.pin_radius,
                    at_least=True,
                    slack_scale=size,
                    rounding_loss=ROUNDING / size,
                    setting=f"outline.{outline.link}.pin_radius_mm",
                )


def clearances(new: Candidate, reference: Reference) -> Iterator[Evaluation]:
    """Distance of barrels from parts of links, at the poses of least clearance."""
    for part in reference.requirements.clearances:
        for name in part.cylinders:
            i = cylinders(reference.today).index(name)
            free, stroke = (
                _clear_distance(new, reference, part, i),
                reference.today.cylinders[i].stroke,
            )
            nearest = np.argsort(free[0].real)[:NEAREST]
            yield Evaluation(
                name=f"clearance.{part.name}.{name}",
                words=f"clearance of the {name} barrel, {part.name}",
                unit="m",
                value=free[:, nearest],
                limit=part.distance,
                at_least=True,
                slack_scale=stroke,
                rounding_loss=2 * ROUNDING / stroke,
                curved=True,
                setting=f"clearance.{part.name}.distance_mm",
            )


def _clear_distance(new: Candidate, reference: Reference, part: Clearance, i: int) -> Array:
    """Distance of a barrel from a part of a link (b, n) [m] at the poses between them.

    A barrel is a bar of its outer diameter from the base pin, half as long as the open cylinder,
    as for buckling.
    """
    arm, poses = reference.today.arm, _poses_between(reference.today, part, i)
    base, end = new.span(i, poses)
    along = end - base
    length = np.sqrt((along**2).sum(axis=-1))[..., None]
    tip = base + along / length * ((new.closed[:, i] + new.stroke[:, i]) / 2)[:, None, None]
    turn, origin = arm.link_rotation(poses, part.link), arm.point(poses, part.link, np.zeros(3))
    bar = [np.einsum("bni,nij->bnj", p - origin, turn)[..., [0, 2]] for p in (base, tip)]
    wall, pressure = new.machine.cylinders[i].barrel_wall, new.machine.supply.pressure
    radius = barrel_outer(diameters(new, i)[0], wall, pressure) / 2
    return np.asarray(clearance(bar[0], bar[1], np.array(part.points)) - radius[:, None])


@lru_cache(maxsize=64)
def _poses_between(today: Machine, part: Clearance, i: int) -> RigidPoses:
    """Poses over the ranges of the joints between a cylinder and the link it keeps clear of."""
    arm, linkage = today.arm, today.linkages[i]
    path = (j for j, _ in arm.path(linkage.base.link, part.link) if j < len(arm.joints))
    between = sorted({*linkage.joints, *path})
    count = MESH.get(len(between), 5)
    axes = [over(today.ranges[j], count) for j in between]
    q = np.tile(today.ranges.mean(axis=1), (count ** len(between), 1))
    q[:, between] = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(between))
    return arm.kinematics(q)
