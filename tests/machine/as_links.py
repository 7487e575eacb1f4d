"""A URDF's links as ``[links]``, for comparison: another way from one to the other than the
package's own.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from scipy.spatial.transform import Rotation

from armdesign import Machine

MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")


def numbers(element: ET.Element | None, key: str, default: str) -> list[float]:
    return [float(x) for x in (default if element is None else element.get(key, default)).split()]


def tables(urdf: str) -> dict[str, Any]:
    robot = ET.fromstring(urdf)
    links: dict[str, Any] = {str(link.get("name")): {} for link in robot.findall("link")}
    for joint in robot.findall("joint"):
        ends = {tag: str(joint.find(tag).get("link")) for tag in ("parent", "child")}  # type: ignore[union-attr]
        kind, origin = str(joint.get("type")), joint.find("origin")
        # angles outside of one turn are turned back
        roll, pitch, yaw = (math.remainder(x, math.tau) for x in numbers(origin, "rpy", "0 0 0"))
        table: dict[str, Any] = {
            "parent": ends["parent"],
            "joint": str(joint.get("name")),
            "type": kind,
            "at_mm": [1e3 * x for x in numbers(origin, "xyz", "0 0 0")],
            "turn_deg": [math.degrees(angle) for angle in (roll, pitch, yaw)],
        }
        if kind != "fixed":
            table["axis"] = numbers(joint.find("axis"), "xyz", "1 0 0")
        limit = joint.find("limit")
        if limit is not None and kind in ("revolute", "prismatic"):
            ends_of = [numbers(limit, end, "0")[0] for end in ("lower", "upper")]
            slides = kind == "prismatic"
            table["limits_mm" if slides else "limits_deg"] = [
                1e3 * x if slides else math.degrees(x) for x in ends_of
            ]
        links[ends["child"]] |= table
    for link in robot.findall("link"):
        if (inertial := link.find("inertial")) is not None:
            links[str(link.get("name"))] |= inertia(inertial)
    return links


def inertia(inertial: ET.Element) -> dict[str, Any]:
    """Mass, centre, and inertia about axes parallel to the link's."""
    origin = inertial.find("origin")
    xx, yy, zz, xy, xz, yz = (numbers(inertial.find("inertia"), key, "")[0] for key in MOMENTS)
    turn = Rotation.from_euler("xyz", numbers(origin, "rpy", "0 0 0")).as_matrix()
    i = turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turn.T
    return {
        "mass_kg": numbers(inertial.find("mass"), "value", "")[0],
        "centre_mm": [1e3 * x for x in numbers(origin, "xyz", "0 0 0")],
        "inertia_kg_m2": [i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2]],
    }


def with_links(machine: Machine) -> Machine:
    """The machine whose file has ``[links]`` in place of its URDF."""
    return Machine.from_text(text_of(machine), "", Path("linked.toml"))


def text_of(machine: Machine) -> str:
    document = tomlkit.parse(machine.text)
    del document["urdf"]
    links = tomlkit.table()
    for name, table in tables(machine.urdf_text).items():
        own = tomlkit.table()
        for key, value in table.items():
            own[key] = [float(x) for x in value] if isinstance(value, list) else value
        links[name] = own
    document["links"] = links
    return tomlkit.dumps(document)
