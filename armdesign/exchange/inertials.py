"""Inertials of exported bodies: masses and moments that simulators take.

They refuse bodies without mass, and moments of zero. So a bar has a small moment about itself, and
bodies whose mass is within the links, and frames, are light: together they change frequencies by
less than 1e-4.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from armdesign.exchange.cylinder_bodies import CylinderBody, reference
from armdesign.mechanism.urdf import attribute

if TYPE_CHECKING:
    from armdesign.machine.machine import Machine

LIGHT = 1e-6  # mass of a light body, over that of all links
FRAME = 0.1  # radius of gyration of a frame, over the distance of the tool from the root
SLENDER = 1e-3  # moment of a bar about itself, over that across it
MOMENTS = ("ixx", "iyy", "izz")
PRODUCTS = ("ixy", "ixz", "iyz")


class Inertial(NamedTuple):
    """Mass [kg], its centre [m] along x, and moments about it along x, y and z [kg m²]."""

    mass: float
    centre: float
    moments: tuple[float, float, float]

    @classmethod
    def of_bar(cls, body: CylinderBody, light: float) -> Inertial:
        """Of a body of a cylinder or four-bar: a slender bar, or a light one [kg]."""
        begin, end = body.bar
        mass = body.mass or light
        across = mass * (end - begin) ** 2 / 12
        return cls(mass, (begin + end) / 2, (SLENDER * across, across, across))

    @classmethod
    def of_frame(cls, machine: Machine) -> Inertial:
        """Of a link without mass."""
        tool, light = machine.tool, light_mass(machine)
        rigid = machine.arm.kinematics(reference(machine)[None])
        size = np.linalg.norm(machine.arm.point(rigid, tool.link, np.array(tool.at))[0])
        moment = light * float(FRAME * size or 1.0) ** 2
        return cls(light, 0.0, (moment, moment, moment))

    def add_to(self, link: ET.Element) -> None:
        """Give a link of a URDF this inertial."""
        element = ET.Element("inertial")
        ET.SubElement(element, "origin", xyz=attribute((self.centre, 0.0, 0.0)), rpy="0 0 0")
        ET.SubElement(element, "mass", value=repr(self.mass))
        moments = dict(zip(MOMENTS, map(repr, self.moments), strict=True))
        ET.SubElement(element, "inertia", moments | dict.fromkeys(PRODUCTS, "0"))
        link.insert(0, element)


def light_mass(machine: Machine) -> float:
    """Mass of a light body [kg]."""
    masses = ET.fromstring(machine.urdf_text).iterfind("link/inertial/mass")
    return LIGHT * (sum(float(mass.get("value", "0")) for mass in masses) or 1.0)


def complete(machine: Machine, robot: ET.Element) -> None:
    """Give links that move and have no inertial one, and slender links a moment about them."""
    frame = Inertial.of_frame(machine)
    for link in robot.findall("link"):
        if link.find("inertial") is None and link.get("name") != machine.arm.root:
            frame.add_to(link)
        for inertia in link.iterfind("inertial/inertia"):
            moments = {key: float(inertia.get(key, "0")) for key in MOMENTS}
            least = SLENDER * max(moments.values())
            for key, moment in moments.items():
                if moment == 0:
                    inertia.set(key, repr(least))
