"""A URDF as ``[links]``: the tables that say the same, in the units of the machine file."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from typing import Any

import numpy as np

from armdesign.arrays import Array
from armdesign.mechanism.urdf import origin, roll_pitch_yaw
from armdesign.mechanism.urdf_faults import numbers
from armdesign.units import deg, mm

DIGITS = 6  # of mm and degrees that count


def links_of(urdf_text: str) -> dict[str, dict[str, Any]]:
    """Tables of ``[links]`` by link, the root first, of a URDF without fault.

    Visuals are left out; lengths, angles and limits are rounded to 1e-6 mm and degrees.
    """
    robot = ET.fromstring(urdf_text)
    joints = {}
    for joint in robot.findall("joint"):
        parent, child = (joint.find(tag) for tag in ("parent", "child"))
        if parent is not None and child is not None:
            joints[child.get("link", "")] = joint, parent.get("link", "")
    tables = {}
    for link in robot.findall("link"):
        name = link.get("name", "")
        tables[name] = (_of_joint(name, *joints[name]) if name in joints else {}) | _of_mass(link)
    return dict(sorted(tables.items(), key=lambda item: "parent" in item[1]))


def _of_joint(link: str, joint: ET.Element, parent: str) -> dict[str, Any]:
    kind, (rotation, translation) = joint.get("type", ""), origin(joint)
    table: dict[str, Any] = {"parent": parent}
    if kind != "revolute":
        table["type"] = kind
    if joint.get("name") != link:
        table["joint"] = joint.get("name")
    table["at_mm"] = _rounded(translation / mm)
    if any(turn := _rounded(roll_pitch_yaw(rotation) / deg)):
        table["turn_deg"] = turn
    if kind != "fixed":
        table["axis"] = _rounded(numbers(joint.find("axis"), "xyz", "1 0 0"))
    if (limit := joint.find("limit")) is not None and kind in ("revolute", "prismatic"):
        slides = kind == "prismatic"
        ends = np.concatenate([numbers(limit, end, "0") for end in ("lower", "upper")])
        table["limits_mm" if slides else "limits_deg"] = _rounded(ends / (mm if slides else deg))
    return table


def _of_mass(link: ET.Element) -> dict[str, Any]:
    """Mass, centre, and inertia about axes parallel to the link's."""
    inertial = link.find("inertial")
    mass = 0.0 if inertial is None else float(numbers(inertial.find("mass"), "value", "0")[0])
    if inertial is None or mass == 0:
        return {}
    keys, inertia = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), inertial.find("inertia")
    xx, yy, zz, xy, xz, yz = (float(numbers(inertia, key, "0")[0]) for key in keys)
    rotation, translation = origin(inertial)
    i = rotation @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ rotation.T
    moments = [i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2]]
    plain = [float(f"{moment:.9g}") for moment in moments]
    return {
        "mass_kg": mass,
        "centre_mm": _rounded(translation / mm),
        "inertia_kg_m2": plain if any(plain[3:]) else plain[:3],
    }


def _rounded(values: Array) -> list[float]:
    """Numbers to so many digits behind the point, whole ones as such."""
    plain = (round(float(value), DIGITS) + 0.0 for value in values)
    return [int(value) if math.isclose(value, int(value), abs_tol=0) else value for value in plain]
