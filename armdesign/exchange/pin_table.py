"""The pin table: every pin and joint in the frame of its link, and where it is at one pose."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from armdesign.arguments import checked
from armdesign.arrays import Array
from armdesign.drawing.joint_arcs import middle_pose
from armdesign.machine.poses import joint_positions
from armdesign.mechanism.urdf_faults import numbers
from armdesign.units import mm

if TYPE_CHECKING:
    import pandas as pd

    from armdesign.hydraulics.actuator import Cylinder
    from armdesign.machine.machine import Machine
    from armdesign.mechanism.linkage.base import Linkage

Row = tuple[str, str, str, Array]  # link, pin, kind, place in the link's frame [m]


@checked
def pin_table(machine: Machine, pose: ArrayLike | None = None) -> pd.DataFrame:
    """Pins of cylinders and four-bars, joints and tool, a row for each link that has it.

    Idle cylinders and frozen joints too: what is frozen here may move in another program.

    Columns: ``link``, ``pin``, ``kind`` (cylinder, four_bar, joint, tool, load), ``x_mm``,
    ``y_mm``, ``z_mm`` in the link's frame; ``root_x_mm`` … in the root link's frame at the pose. A
    joint stands in the tables of both of its links. The knee of a four-bar is on no link: its own
    coordinates are missing.

    Args:
        machine: the machine.
        pose: q (nq,) [rad, m]; default: the middle of the joint ranges.

    Raises:
        PoseError: not one number per joint.

    Example:
        >>> import armdesign as ad
        >>> machine = ad.load("paper_1dof")
        >>> pins = ad.pin_table(machine, [0.0])
        >>> print(pins[["link", "pin", "root_x_mm", "root_z_mm"]].head(2).to_string(index=False))
        link       pin  root_x_mm  root_z_mm
        base lift.base     -500.0        0.0
        base      boom        0.0        0.0
    """
    import pandas as pd

    q = joint_positions(machine, middle_pose(machine) if pose is None else pose)[:1]
    rigid = machine.arm.kinematics(q)
    rows = []
    for link, pin, kind, at in _rows(machine):
        root = machine.arm.point(rigid, link, at)[0]
        rows.append((link, pin, kind, *(at / mm), *(root / mm)))
    for cylinder, linkage in _pairs(machine):
        if (name := linkage.rod_end_name) not in linkage.pin_names:
            end = linkage.ends(rigid)[1][0]
            rows.append(("", f"{cylinder.name}.{name}", linkage.key, *[np.nan] * 3, *(end / mm)))
    axes = ("x_mm", "y_mm", "z_mm")
    columns = ["link", "pin", "kind", *axes, *(f"root_{axis}" for axis in axes)]
    order = {name: index for index, name in enumerate((*machine.arm.links, ""))}
    rows.sort(key=lambda row: order[row[0]])
    table = pd.DataFrame(rows, columns=columns)
    places = columns[3:]
    table[places] = table[places].round(4) + 0.0  # 0.1 µm; no minus zero
    return table


def _pairs(machine: Machine) -> Iterator[tuple[Cylinder, Linkage]]:
    """All cylinders with their linkages."""
    yield from zip(machine.cylinders, machine.linkages, strict=True)
    yield from machine.idle_cylinders


def _rows(machine: Machine) -> Iterator[Row]:
    for cylinder, linkage in _pairs(machine):
        for name in linkage.pin_names:
            pin = getattr(linkage, name)
            kind = "cylinder" if name in ("base", "rod_end") else linkage.key
            yield pin.link, f"{cylinder.name}.{name}", kind, np.array(pin.at)
    for joint in ET.fromstring(machine.urdf_text).findall("joint"):
        if joint.get("type") == "fixed":
            continue
        parent, child = (joint.find(tag) for tag in ("parent", "child"))
        name = str(joint.get("name"))
        if parent is not None and child is not None:
            place = numbers(joint.find("origin"), "xyz", "0 0 0")
            yield str(parent.get("link")), name, "joint", place
            yield str(child.get("link")), name, "joint", np.zeros(3)
    yield machine.tool.link, "tool", "tool", np.array(machine.tool.at)
    for case in machine.payloads:
        if case.link is not None and case.mass > 0:
            yield case.link, f"load.{case.name}", "load", np.array(case.at)
