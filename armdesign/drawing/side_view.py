"""The side view of a machine at n poses: bodies, pins, cylinders between their pins, four-bars.

Outlines and arcs are given once, in the plates of their bodies; ``placements`` put them into the
picture pose by pose, and ``points`` are the places of all pins. From these and the sizes of the
cylinders any pose can be drawn; ``record`` is all of it as lists for JSON. The picture's axes are
forward and up from the root link's origin [m]; axis 0 is the pose.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from armdesign.arrays import Array, Flags, ReadOnly
from armdesign.drawing.joint_arcs import JointArc, joint_arcs
from armdesign.drawing.outlines import DrawnBody, bodies, distance
from armdesign.drawing.plane import PicturePlane, placed
from armdesign.errors import PoseError
from armdesign.hydraulics.actuator import Cylinder
from armdesign.hydraulics.cylinder_build import barrel_outer
from armdesign.mechanism.linkage.base import Linkage
from armdesign.mechanism.rigid_poses import RigidPoses
from armdesign.units import bar

if TYPE_CHECKING:
    from armdesign.machine.load_case import LoadCase
    from armdesign.machine.machine import Machine
    from armdesign.mechanism.linkage.base import Pin

EYE = 0.8  # of the bore: length of an eye with the end of barrel or rod that carries it
STRAY = 0.02  # of the drawn size: how far outside its body a pin counts as out of place
THICKEST = 1000 * bar  # beyond which no wall is drawn thicker: a file in psi is drawn, too
BEYOND = 1e-6  # [m] by which a length may miss a stroke


@dataclass(frozen=True, kw_only=True)
class PinPoint:
    """A pin: ``boom.base`` …, and the knee of a four-bar, which is on no link.

    Attributes:
        name: of cylinder and pin.
        link: that carries it; None of a knee.
        at: place in the link's frame [m]; None of a knee.
        body: index of the body that carries it; None of a knee.
    """

    name: str
    link: str | None = None
    at: tuple[float, float, float] | None = None
    body: int | None = None


@dataclass(frozen=True, kw_only=True)
class CylinderShape:
    """A cylinder between two pins, with the sizes that a picture needs [m].

    The barrel begins an eye's length from the base pin and ends where the closed length leaves an
    eye for the rod; the rod goes on to its pin. Parallel cylinders lie behind each other.

    Attributes:
        name: of the cylinder.
        count: of parallel cylinders.
        ends: indices of base pin and rod end among the points.
        barrel: distances from the base pin at which the barrel begins and ends.
        barrel_width: outer diameter of the barrel.
        rod_width: diameter of the rod.
        closed_length: pin to pin, rod in.
        stroke: of the piston.
        idle: whether all joints between its pins are frozen.
    """

    name: str
    count: int
    ends: tuple[int, int]
    barrel: tuple[float, float]
    barrel_width: float
    rod_width: float
    closed_length: float
    stroke: float
    idle: bool = False


@dataclass(frozen=True, kw_only=True)
class Bar:
    """A bar between two points, such as ``bucket.rocker``.

    Attributes:
        name: of cylinder and bar.
        ends: indices of its ends among the points.
        length: of the bar [m].
    """

    name: str
    ends: tuple[int, int]
    length: float


@dataclass(frozen=True, kw_only=True, eq=False)
class SideView(ReadOnly):
    """A machine seen from the side at n poses; arrays are read-only.

    Attributes:
        bodies: what stands still, then what each coordinate moves before the next (k + 1).
        placements: of the bodies in the picture (n, k + 1, 2, 3), as [A | t].
        pins: pins of all cylinders and knees.
        points: their places (n, np, 2) [m]; NaN where a four-bar does not close.
        cylinders: between which pins, and how thick.
        bars: rockers and couplers.
        lengths: pin to pin, in space (n, nc) [m].
        joints: names of the coordinates, springs last.
        coordinates: their positions (n, k) [rad, m].
        pivots: their places (n, k, 2) [m].
        turning: whether each is a hinge square to the picture (k,).
        motors: names of motors, each with the index of its joint.
        springs: number of coordinates that are springs, the last ones.
        tool: place of the tool (n, 2) [m].
        loads: load cases with a mass, each with its places (n, 2) [m].
        arcs: ranges of the joints, in the plates of the bodies before them.
        ground: height of the ground [m]: of the root link's origin, or what stands lower.
    """

    bodies: tuple[DrawnBody, ...]
    placements: Array
    pins: tuple[PinPoint, ...]
    points: Array
    cylinders: tuple[CylinderShape, ...]
    bars: tuple[Bar, ...]
    lengths: Array
    joints: tuple[str, ...]
    coordinates: Array
    pivots: Array
    turning: Flags
    motors: dict[str, int]
    springs: int
    tool: Array
    loads: dict[str, Array]
    arcs: tuple[JointArc, ...]
    ground: float

    def __len__(self) -> int:
        return len(self.placements)

    def polygons(self, pose: int = 0) -> list[list[Array]]:
        """Outlines (m, 2) [m] of every body at a pose."""
        return [
            [placed(matrix, corners) for corners in body.polygons]
            for body, matrix in zip(self.bodies, self.placements[pose], strict=True)
        ]

    def arc_lines(self) -> list[Array]:
        """Arcs of the joints' ranges (m, 2) [m] at the first pose."""
        return [placed(self.placements[0, arc.body], arc.points) for arc in self.arcs]

    def barrel_and_rod(self, pose: int = 0) -> list[tuple[Array, Array]]:
        """Rectangles (4, 2) [m] of each cylinder's barrel and rod at a pose."""
        return [self._barrel_and_rod(shape, pose) for shape in self.cylinders]

    def _barrel_and_rod(self, shape: CylinderShape, pose: int) -> tuple[Array, Array]:
        base, end = self.points[pose, list(shape.ends)]
        length = float(np.hypot(*(end - base)))
        along = (end - base) / (length or 1.0)
        begin, stop = shape.barrel
        barrel = _rectangle(base + begin * along, base + stop * along, shape.barrel_width)
        return barrel, _rectangle(base, end, shape.rod_width)

    @cached_property
    def out_of_stroke(self) -> Flags:
        """Whether each cylinder is shorter or longer than it can be (n, nc), or does not close."""
        closed = np.array([shape.closed_length for shape in self.cylinders])
        stroke = np.array([shape.stroke for shape in self.cylinders])
        fits = self.lengths >= closed - BEYOND
        return np.asarray(~(fits & (self.lengths <= closed + stroke + BEYOND)))

    @cached_property
    def size(self) -> float:
        """Larger side of what is drawn at the first pose [m]."""
        drawn = [corners for body in self.polygons() for corners in body]
        points = np.concatenate([*drawn, self.points[0], self.tool[:1], self.pivots[0]])
        return float(np.max(np.nanmax(points, axis=0) - np.nanmin(points, axis=0))) or 1.0

    @cached_property
    def stray_pins(self) -> tuple[str, ...]:
        """Names of the pins that lie outside the outline of what carries them.

        So shows a pin with a wrong sign. Hulls of pins hold all pins.
        """
        outlines, names = self.polygons(), []
        for pin, at in zip(self.pins, self.points[0], strict=True):
            if pin.body is None or self.bodies[pin.body].source == "pins":
                continue
            if distance(outlines[pin.body], at) > STRAY * self.size:
                names.append(pin.name)
        return tuple(names)

    def record(self) -> dict[str, Any]:
        """All of it as numbers, texts, lists and mappings, places to 0.1 mm; NaN becomes None."""
        return {
            "bodies": [
                {"link": body.link, "source": body.source, "polygons": _listed(body.polygons)}
                for body in self.bodies
            ],
            "placements": _listed(self.placements, 6),
            "pins": [vars(pin) for pin in self.pins],
            "points": _listed(self.points),
            "cylinders": [vars(shape) for shape in self.cylinders],
            "bars": [vars(bar) for bar in self.bars],
            "lengths": _listed(self.lengths),
            "joints": list(self.joints),
            "coordinates": _listed(self.coordinates, 6),
            "pivots": _listed(self.pivots),
            "turning": self.turning.tolist(),
            "motors": self.motors,
            "springs": self.springs,
            "tool": _listed(self.tool),
            "loads": {name: _listed(places) for name, places in self.loads.items()},
            "arcs": [vars(arc) | {"points": _listed(arc.points)} for arc in self.arcs],
            "ground": self.ground,
        }


def side_view(machine: Machine, q: ArrayLike, known: SideView | None = None) -> SideView:
    """The side view of a machine at q (n, nq) [rad, m], one pose (nq,), or with springs (n, k).

    Poses out of stroke are drawn too: their cylinders are longer or shorter than they can be.
    Outlines of the bodies are taken from a view of the machine that is ``known``.

    Raises:
        PoseError: q has another number of columns, or is not finite.
    """
    z, arm = _coordinates(machine, q), machine.arm
    plane = PicturePlane(machine.heading)
    poses = plane.poses(z)
    drawn_bodies = known.bodies if known is not None else bodies(machine)
    where = {link: index for index, body in enumerate(drawn_bodies) for link in body.links}
    placements = np.stack([plane.placements(poses, body.link) for body in drawn_bodies], axis=1)
    pins, points, cylinders, bars = _between_pins(machine, poses, where)
    lengths = _lengths(machine, arm.kinematics(z))
    loads = [load for load in machine.payloads if load.link is not None and load.mass > 0]
    return SideView(
        bodies=drawn_bodies,
        placements=placements,
        pins=tuple(pins),
        points=_seen(plane, poses, _carriers(pins), np.stack(points, axis=1))
        if points
        else np.zeros((len(z), 0, 2)),
        cylinders=tuple(cylinders),
        bars=tuple(bars),
        lengths=np.stack(lengths, axis=1) if lengths else np.zeros((len(z), 0)),
        joints=tuple(joint.name for joint in arm.coordinates),
        coordinates=arm.with_springs(z),
        pivots=_seen(plane, poses, [b.link for b in drawn_bodies[1:]], poses.translation),
        turning=np.array(
            [
                joint.revolute and abs(float(axis @ plane.across)) > LYING
                for joint, axis in zip(arm.coordinates, plane.zero.axis[0], strict=True)
            ]
        ),
        motors={motor.name: machine.joints.index(motor.joint) for motor in machine.motors},
        springs=len(machine.springs),
        tool=_place(plane, poses, machine.tool),
        loads={load.name: _place(plane, poses, load) for load in loads},
        arcs=joint_arcs(machine, plane, drawn_bodies),
        ground=_ground(plane, drawn_bodies[0]),
    )


def _place(plane: PicturePlane, poses: RigidPoses, point: Pin | LoadCase) -> Array:
    """Place (n, 2) [m] of the tool or a load in the picture."""
    link = str(point.link)
    return plane.seen(poses, link, plane.arm.point(poses, link, np.array(point.at))[:, None])[:, 0]


def _seen(plane: PicturePlane, poses: RigidPoses, links: list[str], points: Array) -> Array:
    """Points (n, m, 3) in the picture (n, m, 2) [m], each seen beside the link that carries it."""
    seen = {link: plane.seen(poses, link, points) for link in dict.fromkeys(links)}
    return np.stack([seen[link][:, i] for i, link in enumerate(links)], axis=1)


def _carriers(pins: list[PinPoint]) -> list[str]:
    """Links beside which pins are seen: knees as the pin before them."""
    return [str(pin.link or pins[i - 1].link) for i, pin in enumerate(pins)]


LYING = 0.9  # least part across the picture of a hinge's axis that turns in it


def _coordinates(machine: Machine, q: ArrayLike) -> Array:
    """Positions (n, nq), or with springs (n, k)."""
    z = np.atleast_2d(np.asarray(q, dtype=float))
    counts = len(machine.joints), len(machine.arm.coordinates)
    if z.ndim != 2 or z.shape[1] not in counts:
        remedy = f"give (n, {counts[0]}): {', '.join(machine.joints)}"
        raise PoseError(f"{machine.name}: q", f"has shape {z.shape}", remedy)
    if not np.all(np.isfinite(z)):
        fault = "holds a number that is not finite"
        raise PoseError(f"{machine.name}: q", fault, "give finite joint positions")
    return z


def _between_pins(
    machine: Machine, poses: RigidPoses, where: dict[str, int]
) -> tuple[list[PinPoint], list[Array], list[CylinderShape], list[Bar]]:
    """Pins and their places as drawn, cylinders and bars between them."""
    pins, points = list[PinPoint](), list[Array]()
    cylinders, bars = list[CylinderShape](), list[Bar]()
    for cylinder, linkage, idle in shown_cylinders(machine):
        first = len(pins)
        for name in linkage.pin_names:
            pin = getattr(linkage, name)
            body = where[pin.link]
            label = f"{cylinder.name}.{name}"
            pins.append(PinPoint(name=label, link=pin.link, at=pin.at, body=body))
            points.append(linkage.point(poses, pin))
        with np.errstate(invalid="ignore"):
            _, end = linkage.ends(poses)
        index = {name: first + i for i, name in enumerate(linkage.pin_names)}
        if (rod_end := linkage.rod_end_name) not in index:
            index[rod_end] = len(pins)
            pins.append(PinPoint(name=f"{cylinder.name}.{rod_end}"))
            points.append(end)
        ends = (index["base"], index[rod_end])
        cylinders.append(_shape(machine, cylinder, ends, idle))
        for leg, pin in linkage.legs:
            ends, (length,) = (index[pin], index[rod_end]), linkage.place(leg) or (0.0,)
            bars.append(Bar(name=f"{cylinder.name}.{leg}", ends=ends, length=length))
    return pins, points, cylinders, bars


def _lengths(machine: Machine, poses: RigidPoses) -> list[Array]:
    """Pin-to-pin lengths at poses with their slewing, which changes those across a slew."""
    with np.errstate(invalid="ignore"):
        return [linkage.length(poses) for _, linkage, _ in shown_cylinders(machine)]


def shown_cylinders(machine: Machine) -> Iterator[tuple[Cylinder, Linkage, bool]]:
    """Every cylinder of the file with its linkage, and whether it stands still."""
    for cylinder, linkage in zip(machine.cylinders, machine.linkages, strict=True):
        yield cylinder, linkage, False
    for cylinder, linkage in machine.idle_cylinders:
        yield cylinder, linkage, True


def _shape(
    machine: Machine, cylinder: Cylinder, ends: tuple[int, int], idle: bool
) -> CylinderShape:
    pressure = min(machine.supply.pressure, THICKEST)
    outer = barrel_outer(cylinder.bore, cylinder.barrel_wall, pressure)
    eye = max(min(EYE * cylinder.bore, cylinder.dead_length / 3), 0.0)
    return CylinderShape(
        name=cylinder.name,
        count=cylinder.count,
        ends=ends,
        barrel=(eye, cylinder.closed_length - eye),
        barrel_width=float(outer),
        rod_width=cylinder.rod,
        closed_length=cylinder.closed_length,
        stroke=cylinder.stroke,
        idle=idle,
    )


def _ground(plane: PicturePlane, standing: DrawnBody) -> float:
    matrix = plane.placements(plane.zero, standing.link)[0]
    drawn = standing.polygons if standing.source == "visuals" else ()
    return min([0.0, *(float(placed(matrix, corners)[:, 1].min()) for corners in drawn)])


def _rectangle(begin: Array, end: Array, width: float) -> Array:
    """Corners (4, 2) of a bar between two points."""
    span = end - begin
    side = np.array([-span[1], span[0]]) / (float(np.hypot(*span)) or 1.0) * width / 2
    return np.array([begin + side, end + side, end - side, begin - side])


def _listed(values: Any, digits: int = 4) -> Any:
    """Nested lists of rounded numbers, None for NaN."""
    if isinstance(values, tuple):
        return [_listed(value, digits) for value in values]
    rounded = np.round(values, digits) + 0.0
    numbers: Array = rounded.astype(object)
    numbers[~np.isfinite(rounded)] = None
    return numbers.tolist()
