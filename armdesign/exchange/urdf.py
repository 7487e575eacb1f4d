"""A machine as URDF with its cylinders and four-bars, for viewers and simulators.

A URDF is a tree: a rod ends on its pin because its joint's position says so, not because a joint
holds it there. ``robot_positions`` gives the positions of all joints at poses of the machine.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from armdesign.arguments import checked
from armdesign.drawing.visuals import mesh_file
from armdesign.exchange.cylinder_bodies import CylinderBody, cylinder_bodies, reference
from armdesign.exchange.inertials import Inertial, complete, light_mass
from armdesign.machine.poses import joint_positions
from armdesign.mechanism.urdf import attribute
from armdesign.mechanism.urdf_faults import MOVABLE
from armdesign.units import mm

if TYPE_CHECKING:
    import pandas as pd

    from armdesign.machine.machine import Machine

THIN = 1 / 15  # drawn height of a link of [links] without a box, over its length
PAINT = (0.95, 0.70, 0.10, 1.0)


@checked
def robot_positions(machine: Machine, q: ArrayLike) -> pd.DataFrame:
    """Positions of every movable joint of the machine's exported URDF, a row for each pose.

    Columns are joints of the URDF that move: joints of poses, frozen ones, springs at rest, and
    joints of barrels, rods, rockers and couplers, as ``boom_rod`` [rad, m].

    Args:
        machine: the machine.
        q: poses (n, nq) [rad, m], or one (nq,).

    Raises:
        PoseError: not one number per joint, or a four-bar does not close.

    Example:
        >>> import armdesign as ad
        >>> machine = ad.load("paper_1dof")
        >>> print(ad.robot_positions(machine, [0.5]).round(3).to_string(index=False))
         boom  lift_barrel  lift_rod
          0.5        0.007    -0.074
    """
    import pandas as pd

    poses = joint_positions(machine, q)
    robot = ET.fromstring(machine.urdf_text)
    movable = [str(j.get("name")) for j in robot.findall("joint") if j.get("type") in MOVABLE]
    fixed = dict.fromkeys(movable, 0.0) | machine.section.frozen
    fixed |= {spring.joint: spring.at for spring in machine.springs}
    columns = {name: np.full(len(poses), fixed[name]) for name in movable}
    columns |= dict(zip(machine.joints, poses.T, strict=True))
    bodies = cylinder_bodies(machine, poses, reference(machine))
    return pd.DataFrame(columns | {body.name: body.positions for body in bodies})


def urdf(machine: Machine) -> str:
    """Text of the URDF with links and joints for barrels, rods, rockers and couplers."""
    robot = ET.fromstring(machine.urdf_text)
    robot.set("name", machine.name)
    for mesh in robot.iter("mesh"):  # from wherever the new file lies
        file = mesh_file(mesh.get("filename", ""), folder_of(machine))
        mesh.set("filename", str(file.resolve()) if file else mesh.get("filename", ""))
    if machine.section.links:
        _add_boxes(machine, robot)
        _add_limits(machine, robot)
    complete(machine, robot)
    at, light = reference(machine), light_mass(machine)
    for body in cylinder_bodies(machine, at[None], at):
        _add_link(robot, body, Inertial.of_bar(body, light))
        _add_joint(robot, body)
    ET.indent(robot)
    text = ET.tostring(robot, encoding="unicode")
    return f'<?xml version="1.0"?>\n<!-- {_remark(machine)} -->\n{text}\n'


def folder_of(machine: Machine) -> Path:
    """Folder of the machine's URDF."""
    return (machine.source.parent / (machine.section.urdf or "links.urdf")).parent


def _remark(machine: Machine) -> str:
    return (
        f"{machine.name}, exported by armdesign. Units: m, kg, rad. Joints ending in _barrel,"
        " _rod, _rocker, _coupler (_swivel) are of cylinders and four-bars: set them by"
        " armdesign.robot_positions; all are 0 where the other joints are nearest to 0."
        f" Bodies of {light_mass(machine):.3g} kg have their mass within the links, or are frames."
    )


def _add_boxes(machine: Machine, robot: ET.Element) -> None:
    """Boxes of ``[links]``, or thin ones as long as their link."""
    for element in robot.findall("link"):
        link = machine.section.links[str(element.get("name"))]
        length = link.length_mm or 0.0
        edges = link.box_mm or [length, length * THIN, length * THIN]
        if all(edges):
            middle = (link.centre_mm if link.box_mm else None) or [length / 2, 0.0, 0.0]
            shape = ET.Element("box", size=attribute(edge * mm for edge in edges))
            add_visual(element, shape, (x * mm for x in middle), (0.0, 0.0, 0.0), PAINT)


def _add_limits(machine: Machine, robot: ET.Element) -> None:
    """Effort and velocity of joints, which ``[links]`` do not state: of their actuators."""
    from armdesign.design.requirements.performance import performances

    figures: dict[str, tuple[float, float]] = {}
    for one in performances(machine):
        speed = one.speed[np.isfinite(one.speed)]
        name = machine.joints[one.joint]
        effort, fastest = figures.get(name, (0.0, 0.0))
        own_speed = float(speed.max(initial=0.0))
        figures[name] = max(float(one.largest.max()), effort), max(own_speed, fastest)
    for joint in robot.findall("joint"):
        if (limit := joint.find("limit")) is not None:
            effort, velocity = figures.get(str(joint.get("name")), (0.0, 0.0))
            limit.set("effort", f"{effort:.6g}")
            limit.set("velocity", f"{velocity:.6g}")


def _add_link(robot: ET.Element, body: CylinderBody, own: Inertial) -> None:
    link = ET.SubElement(robot, "link", name=body.name)
    own.add_to(link)
    length = body.span[1] - body.span[0]
    for offset in body.offsets if length > 0 else ():
        shape = ET.Element("cylinder", radius=repr(body.diameter / 2), length=repr(length))
        middle = (sum(body.span) / 2, offset, 0.0)
        add_visual(link, shape, middle, (0.0, np.pi / 2, 0.0), body.colour)


def _add_joint(robot: ET.Element, body: CylinderBody) -> None:
    joint = ET.SubElement(robot, "joint", name=body.name, type=body.kind)
    ET.SubElement(joint, "parent", link=body.parent)
    ET.SubElement(joint, "child", link=body.name)
    ET.SubElement(joint, "origin", xyz=attribute(body.place), rpy=attribute(body.turn))
    ET.SubElement(joint, "axis", xyz=attribute(body.axis))
    if body.limits is not None:
        lower, upper = map(repr, body.limits)
        ET.SubElement(joint, "limit", lower=lower, upper=upper, effort="0", velocity="0")


def add_visual(
    link: ET.Element,
    shape: ET.Element,
    xyz: Iterable[float],
    rpy: Iterable[float],
    colour: Iterable[float],
) -> None:
    """Give a link a visual of a shape at a place [m], in a colour."""
    visual = ET.SubElement(link, "visual")
    ET.SubElement(visual, "origin", xyz=attribute(xyz), rpy=attribute(rpy))
    ET.SubElement(visual, "geometry").append(shape)
    rgba = " ".join(f"{x:g}" for x in colour)
    material = ET.SubElement(visual, "material", name=f"rgba {rgba}")
    ET.SubElement(material, "color", rgba=rgba)
