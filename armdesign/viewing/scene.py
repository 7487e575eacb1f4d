"""A machine in space: solids, each carried by a frame, and where the frames are at n poses.

Frames are the links of the arm, and of every cylinder its barrel and rod, of four-bars their
bars: x along the part, y across the machine. A barrel begins at the base pin, a rod at the rod
end and points back; so solids never change, only their frames move. Links look as their visuals
in the URDF; where a body has none, as the plate of its outline. Poses out of stroke are shown too.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import groupby
from typing import TYPE_CHECKING

import numpy as np

from armdesign.arrays import Array
from armdesign.drawing.colours import actuator_colours
from armdesign.drawing.joint_arcs import middle_pose
from armdesign.drawing.plane import PicturePlane
from armdesign.drawing.side_view import CylinderShape, SideView, shown_cylinders, side_view
from armdesign.drawing.swing import Swings
from armdesign.drawing.visuals import visuals
from armdesign.hydraulics.actuator import Cylinder
from armdesign.mechanism.linkage.base import Linkage
from armdesign.viewing.meshes import Mesh, joined, of_visual, plate, tube

if TYPE_CHECKING:
    from armdesign.machine.machine import Machine
    from armdesign.mechanism.rigid_poses import RigidPoses

# thickness of bodies without visuals, over the machine's size: cylinders stand out on both sides
PLATE = 0.008
DRIVE = 0.03  # of the machine's size: radius of a motor or spring about its joint
APART = 1.5  # between the middles of parallel cylinders, over their diameter
PARALLEL = 1e-6  # rad between a part and the direction across the machine
BAR_WIDTH, BOLT = 0.6, 0.5  # diameters of bars and pins, over the bore
BODY, NEXT_BODY = "#C9A227", "#8A6D12"
ROD, BAR, PIN = "#C7CCD1", "#6B7280", "#1F2933"


@dataclass(frozen=True, eq=False, kw_only=True)
class Solid:
    """A body of one colour that a frame carries.

    Attributes:
        name: such as ``boom.barrel``, or ``links/boom``.
        frame: of its corners.
        mesh: its surface, in the frame [m].
        colour: as ``#RRGGBB``.
    """

    name: str
    frame: str
    mesh: Mesh
    colour: str


@dataclass(frozen=True, eq=False, kw_only=True)
class Mark:
    """A named point: a pin, joint or the tool, at [m] in its frame."""

    name: str
    frame: str
    at: tuple[float, float, float]


@dataclass(frozen=True, eq=False, kw_only=True)
class Scene:
    """A machine as solids.

    Attributes:
        machine: the machine.
        solids: everything that is seen of it.
        marks: pins, joints and tool.
        size: larger side of the machine in its middle pose [m].
        ground: height of the ground [m].
        across: direction across the machine to its far side, all joints at 0 (3,).
        swings: how far it is shown to swing in its modes.
    """

    machine: Machine
    solids: tuple[Solid, ...]
    marks: tuple[Mark, ...]
    size: float
    ground: float
    across: Array
    swings: Swings

    def placements(self, z: Array) -> dict[str, tuple[Array, Array]]:
        """Rotation (n, 3, 3) and place (n, 3) [m] of every frame at z (n, nq) or (n, k).

        NaN where a four-bar does not close.
        """
        arm = self.machine.arm
        rigid = arm.kinematics(arm.with_springs(np.atleast_2d(z)))
        frames = {
            link: (arm.link_rotation(rigid, link), arm.point(rigid, link, np.zeros(3)))
            for link in arm.links
        }
        zero = arm.zero
        for cylinder, linkage, _ in shown_cylinders(self.machine):
            link = linkage.base.link
            side = arm.link_rotation(zero, link)[0].T @ self.across
            across = frames[link][0] @ side
            frames |= _between_pins(cylinder.name, linkage, rigid, across)
        return frames

    def near_side(self, link: str) -> tuple[Array, float]:
        """Direction across the machine (3,) in a link's frame, and where the link begins [m]."""
        arm = self.machine.arm
        zero = arm.zero
        side = arm.link_rotation(zero, link)[0].T @ self.across
        own = [one.mesh.vertices for one in self.solids if one.frame == link]
        return side, min((float((corners @ side).min()) for corners in own), default=0.0)

    def heading(self, q: Array) -> Array:
        """Rotation (3, 3) that turns x to where the arm points at q (nq,)."""
        x, y = self.machine.heading.at(q[None])[0]
        return np.array([[x, -y, 0.0], [y, x, 0.0], [0.0, 0.0, 1.0]])


def scene_of(machine: Machine, plates: bool = False) -> Scene:
    """The scene of a machine.

    Args:
        machine: the machine.
        plates: whether its links are plates of outlines, whatever visuals the URDF has.
    """
    view = side_view(machine, middle_pose(machine))
    plane = PicturePlane(machine.heading)
    arm, colours = machine.arm, actuator_colours(machine)
    across = {link: arm.link_rotation(plane.zero, link)[0].T @ plane.across for link in arm.links}
    solids = [*_links(machine, plane, view, plates), *_drives(machine, view.size)]
    for (cylinder, linkage, _), shape in zip(
        shown_cylinders(machine), view.cylinders, strict=True
    ):
        solids += _cylinder(cylinder, linkage, shape, colours[cylinder.name])
        solids += _pins(cylinder, linkage, shape, across)
    return Scene(
        machine=machine,
        solids=tuple(solids),
        marks=tuple(_marks(machine)),
        size=view.size,
        ground=view.ground,
        across=plane.across,
        swings=Swings(machine=machine, bodies=view.bodies, size=view.size),
    )


def _between_pins(
    name: str, linkage: Linkage, rigid: RigidPoses, across: Array
) -> dict[str, tuple[Array, Array]]:
    """Frames of barrel, rod and bars."""
    with np.errstate(invalid="ignore"):
        base, end = linkage.ends(rigid)
    turned = _turned(end - base, across)
    frames = {f"{name}.barrel": (turned, base), f"{name}.rod": (turned, end)}
    for bar, pin in linkage.legs:
        begin = linkage.point(rigid, getattr(linkage, pin))
        frames[f"{name}.{bar}"] = (_turned(end - begin, across), begin)
    return frames


def _turned(along: Array, across: Array) -> Array:
    """Rotations (n, 3, 3) with x along a vector (n, 3) and y near to another.

    A part that lies along the other, as a ram across the machine, has y near to the
    axis of the root link that it is farthest from.
    """
    x = along / np.linalg.norm(along, axis=1, keepdims=True)
    parallel = np.linalg.norm(np.cross(x, across), axis=1) < PARALLEL
    aside = np.where(parallel[:, None], np.eye(3)[np.abs(x).argmin(axis=1)], across)
    y = aside - np.einsum("ni,ni->n", aside, x)[:, None] * x
    y = y / np.linalg.norm(y, axis=1, keepdims=True)
    return np.stack([x, y, np.cross(x, y)], axis=2)


# ------------------------------------------------------------------------------------------ solids


def _links(machine: Machine, plane: PicturePlane, view: SideView, plates: bool) -> Iterator[Solid]:
    """Bodies: visuals of their links, one solid of each colour, or plates of outlines."""
    folder = (machine.source.parent / (machine.section.urdf or "")).parent
    of_links = visuals(machine.urdf_text, folder)
    for order, body in enumerate(view.bodies):
        if plates or body.source != "visuals":
            yield from _plate(machine, plane, view, order)
            continue
        for link in body.links:
            coloured = [(_hex(shape.colour), shape) for shape in of_links[link]]
            coloured.sort(key=lambda pair: pair[0])
            for index, (colour, group) in enumerate(groupby(coloured, key=lambda pair: pair[0])):
                mesh = joined(of_visual(shape) for _, shape in group)
                if len(mesh.faces):
                    name = f"links/{link}_{index}"
                    yield Solid(name=name, frame=link, mesh=mesh, colour=colour)


def _hex(colour: tuple[float, ...] | None) -> str:
    """A URDF's colour as ``#RRGGBB``; the colour of bodies where it says none."""
    if colour is None:
        return BODY
    return "#" + "".join(f"{round(255 * part):02X}" for part in colour[:3])


def _plate(machine: Machine, plane: PicturePlane, view: SideView, order: int) -> Iterator[Solid]:
    """A body as the plate of its outline; neighbours differ in shade and thickness."""
    body = view.bodies[order]
    axes = plane.plate(body.link)
    pins = (pin for linkage in machine.linkages for pin in linkage.pins)
    normal = np.cross(*axes)
    offsets = [float(np.array(pin.at) @ normal) for pin in pins if pin.link == body.link]
    middle = (float(np.mean(offsets)) if offsets else 0.0) * normal
    thickness = PLATE * view.size * (1 + order % 2 / 2)
    meshes = [plate(outline, axes, middle, thickness) for outline in body.polygons]
    if meshes:
        colour = (BODY, NEXT_BODY)[order % 2]
        name = f"links/{body.link}"
        yield Solid(name=name, frame=body.link, mesh=joined(meshes), colour=colour)


def _cylinder(
    cylinder: Cylinder, linkage: Linkage, shape: CylinderShape, colour: str
) -> Iterator[Solid]:
    """Barrel, rod and bars; parallel cylinders side by side."""
    offsets = _offsets(shape.count, shape.barrel_width)
    begin, stop = shape.barrel
    eyes = offsets if begin > 0 else []
    foot = [_along_x(0.0, begin, shape.rod_width / 2, y) for y in eyes]
    barrels = [_along_x(begin, stop, shape.barrel_width / 2, y) for y in offsets]
    rods = [_along_x(begin - shape.closed_length, 0.0, shape.rod_width / 2, y) for y in offsets]
    parts = {"barrel": (foot + barrels, colour), "rod": (rods, ROD)}
    for bar, _ in linkage.legs:
        (length,) = linkage.place(bar) or (0.0,)
        parts[bar] = ([_along_x(0.0, length, BAR_WIDTH * cylinder.bore / 2, 0.0)], BAR)
    for part, (meshes, paint) in parts.items():
        name = f"{shape.name}.{part}"
        yield Solid(name=name, frame=name, mesh=joined(meshes), colour=paint)


def _offsets(count: int, diameter: float) -> list[float]:
    """Places of parallel cylinders across the machine [m]."""
    return [APART * diameter * (k - (count - 1) / 2) for k in range(count)]


def _along_x(begin: float, end: float, radius: float, aside: float) -> Mesh:
    return tube(np.array([begin, aside, 0.0]), np.array([end, aside, 0.0]), radius)


def _pins(
    cylinder: Cylinder, linkage: Linkage, shape: CylinderShape, across: Mapping[str, Array]
) -> Iterator[Solid]:
    """Pins of a cylinder as bolts across the machine, and the knee of a four-bar on its bar."""
    outermost = max(_offsets(shape.count, shape.barrel_width)) + 0.7 * shape.barrel_width
    bolts = {
        name: (pin.link, np.array(pin.at), across[pin.link])
        for name, pin in zip(linkage.pin_names, linkage.pins, strict=True)
    }
    if linkage.rod_end_name not in bolts:
        frame = f"{shape.name}.rod"
        bolts[linkage.rod_end_name] = (frame, np.zeros(3), np.array([0.0, 1.0, 0.0]))
    for name, (frame, at, side) in bolts.items():
        mesh = tube(at - outermost * side, at + outermost * side, BOLT * cylinder.bore / 2)
        yield Solid(name=f"pins/{shape.name}.{name}", frame=frame, mesh=mesh, colour=PIN)


def _drives(machine: Machine, size: float) -> Iterator[Solid]:
    """Motors and springs as drums about their joints."""
    colours = actuator_colours(machine)
    names = {motor.name: machine.joints.index(motor.joint) for motor in machine.motors}
    first = len(machine.joints)
    names |= {spring.name: first + k for k, spring in enumerate(machine.springs)}
    for name, index in names.items():
        joint, link = machine.arm.coordinates[index], machine.arm.links[machine.arm.carried(index)]
        axis = link.rotation.T @ joint.axis
        at = -link.rotation.T @ link.translation
        half = DRIVE * size / 2
        mesh = tube(at - half * axis, at + half * axis, DRIVE * size)
        yield Solid(name=f"drives/{name}", frame=link.name, mesh=mesh, colour=colours[name])


def _marks(machine: Machine) -> Iterator[Mark]:
    """Pins of cylinders, knees, and the tool."""
    for cylinder, linkage, _ in shown_cylinders(machine):
        for name, pin in zip(linkage.pin_names, linkage.pins, strict=True):
            yield Mark(name=f"{cylinder.name}.{name}", frame=pin.link, at=pin.at)
        if (knee := linkage.rod_end_name) not in linkage.pin_names:
            name = f"{cylinder.name}.{knee}"
            yield Mark(name=name, frame=f"{cylinder.name}.rod", at=(0.0, 0.0, 0.0))
    yield Mark(name="tool", frame=machine.tool.link, at=machine.tool.at)
