"""Inertials of exported bodies: masses and moments that simulators take.

They refuse bodies without mass, and moments of zero. So a bar has a small moment about itself, and
bodies whose mass is within the links, and frames, are light: together they change frequencies by
less than 1e-4.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import TYPE_CHECKING, NamedTuple

from armdesign.exchange.cylinder_bodies import CylinderBody

if TYPE_CHECKING:
    from armdesign.machine.machine import Machine

LIGHT = 1e-6  # mass of a light body, over that of all links
SLENDER = 1e-3  # moment of a bar about itself, over that across it


class Inertial(NamedTuple):
    """Mass [kg], its centre [m] along x, and moments about it along x, y and z [kg m²]."""

    mass: float
    centre: float
    moments: tuple[float, float, float]


def light_mass(machine: Machine) -> float:
    """Mass of a light body [kg]."""
    masses = ET.fromstring(machine.urdf_text).iterfind("link/inertial/mass")
    return LIGHT * (sum(float(mass.get("value", "0")) for mass in masses) or 1.0)


def of_bar(body: CylinderBody, light: float) -> Inertial:
    """Of a body of a cylinder or four-bar: a slender bar, or a light one [kg]."""
    begin, end = body.bar
    mass = body.mass or light
    across = mass * (end - begin) ** 2 / 12
    return Inertial(mass, (begin + end) / 2, (SLENDER * across, across, across))


def of_frame(light: float, size: float) -> Inertial:
    """Of a link without mass, in a machine of a size [m]."""
    moment = light * (size / 10) ** 2
    return Inertial(light, 0.0, (moment, moment, moment))
