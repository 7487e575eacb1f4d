"""``[links]`` as a URDF: the one way by which links of a machine file become an arm.

What a table leaves out is filled in here: a joint at the end of the parent's length, a centre of
mass in the middle of the link's own, the inertia of a box or of a slender bar.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping

from armdesign.machine.file.links import LinkSection
from armdesign.mechanism.urdf import attribute
from armdesign.units import deg, mm

AXES = {"prismatic": (1.0, 0.0, 0.0)}  # of joints without axis; of others RAISES
RAISES = (0.0, -1.0, 0.0)  # positive turns raise what points forward
INERTIAS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")


def urdf_of(links: Mapping[str, LinkSection]) -> str:
    """Text of the URDF that stands for ``[links]``."""
    robot = ET.Element("robot", name="arm")
    for name, link in links.items():
        element = ET.SubElement(robot, "link", name=name)
        if link.mass_kg:
            _add_inertial(element, link)
    for name, link in links.items():
        if link.parent is not None:
            _add_joint(robot, name, link, links[link.parent])
    ET.indent(robot)
    return ET.tostring(robot, encoding="unicode") + "\n"


def joint_of(name: str, link: LinkSection) -> str:
    """Name of the joint that carries a link."""
    return link.joint or name


def centre(link: LinkSection) -> tuple[float, ...]:
    """Centre of mass [m] in the link's frame: its own, or the middle of the link."""
    return tuple(x * mm for x in link.centre_mm or ((link.length_mm or 0.0) / 2, 0.0, 0.0))


def inertia(link: LinkSection) -> tuple[float, ...]:
    """Inertia [kg m²] about the centre of mass: xx, yy, zz, xy, xz, yz.

    Its own, else of a uniform box, else of a slender bar along x as long as the link.
    """
    if link.inertia_kg_m2 is not None:
        return (*link.inertia_kg_m2, 0.0, 0.0, 0.0)[:6]
    x, y, z = (edge * mm for edge in link.box_mm or (link.length_mm or 0.0, 0.0, 0.0))
    squares = (y * y + z * z, x * x + z * z, x * x + y * y)
    return (*(link.mass_kg / 12 * square for square in squares), 0.0, 0.0, 0.0)


def place(link: LinkSection, parent: LinkSection) -> tuple[float, ...]:
    """Origin of a link's frame [m] in its parent's frame: its own, or the end of the parent."""
    return tuple(x * mm for x in link.at_mm or (parent.length_mm or 0.0, 0.0, 0.0))


def _add_inertial(element: ET.Element, link: LinkSection) -> None:
    inertial = ET.SubElement(element, "inertial")
    ET.SubElement(inertial, "origin", xyz=attribute(centre(link)), rpy="0 0 0")
    ET.SubElement(inertial, "mass", value=repr(float(link.mass_kg)))
    moments = zip(INERTIAS, inertia(link), strict=True)
    ET.SubElement(inertial, "inertia", {key: repr(float(value)) for key, value in moments})


def _add_joint(robot: ET.Element, name: str, link: LinkSection, parent: LinkSection) -> None:
    joint = ET.SubElement(robot, "joint", name=joint_of(name, link), type=link.kind)
    ET.SubElement(joint, "parent", link=str(link.parent))
    ET.SubElement(joint, "child", link=name)
    turn = attribute(angle * deg for angle in link.turn_deg or (0.0, 0.0, 0.0))
    ET.SubElement(joint, "origin", xyz=attribute(place(link, parent)), rpy=turn)
    if link.kind == "fixed":
        return
    ET.SubElement(joint, "axis", xyz=attribute(link.axis or AXES.get(link.kind, RAISES)))
    if (limits := limits_of(link)) is not None:
        ends = {end: repr(float(x)) for end, x in zip(("lower", "upper"), limits, strict=True)}
        ET.SubElement(joint, "limit", ends | {"effort": "0", "velocity": "0"})


def limits_of(link: LinkSection) -> tuple[float, float] | None:
    """Limits of a link's joint [rad or m]; None where it has none."""
    unit, given = (mm, link.limits_mm) if link.kind == "prismatic" else (deg, link.limits_deg)
    return None if given is None else (given[0] * unit, given[1] * unit)
