"""A four-bar in place of a pin-to-pin cylinder, as a start: a parallelogram.

The pivot lies beside the joint by a vector d in the link that carries it, the coupler is as long
as d, the rocker as the arm of the old rod end, where the lug is. So the knee goes the way of the
old rod end, shifted by d, and with the base pin shifted alike the cylinder keeps its length,
stroke and moment arm at every pose. d is square to the arm amid the range, back along the link.
"""

from __future__ import annotations

import copy
from typing import Any

import numpy as np

from armdesign.errors import ArmDesignError
from armdesign.machine.machine import Machine
from armdesign.mechanism.linkage.direct import Direct
from armdesign.units import deg, mm

SHARE = 0.8  # of the arm: how far the pivot lies from the joint
WIDEST = 140 * deg  # range of the joint that leaves rocker and coupler 20° of transmission


def with_four_bar(data: dict[str, Any], machine: Machine) -> dict[str, Any]:
    """Data of a machine file whose last joint is moved through a four-bar.

    As it is, if a four-bar is there already.

    Args:
        data: of the machine file, by the keys of its tables.
        machine: that it describes.

    Raises:
        ArmDesignError: no joint is moved by one pin-to-pin cylinder alone on its two links.
    """
    if any("four_bar" in table for table in data["cylinder"].values()):
        return data
    for joint in reversed(range(len(machine.joints))):
        own = [k for k, linkage in enumerate(machine.linkages) if joint in linkage.joints]
        if len(own) == 1 and (tables := _tables(machine, joint, own[0])):
            new = copy.deepcopy(data)
            cylinder = new["cylinder"][machine.cylinders[own[0]].name]
            del cylinder["rod_end"]
            cylinder |= tables
            for key in ("outline", "clearance"):  # were drawn around the old pins
                new.get("requirements", {}).pop(key, None)
            return new
    fault = "there is no joint that one pin-to-pin cylinder alone turns by less than 140 deg"
    raise ArmDesignError("--four-bar", fault, "leave it out")


def _tables(machine: Machine, joint: int, k: int) -> dict[str, Any]:
    """Base pin and four-bar in place of the rod end; empty where they do not fit the joint."""
    linkage, arm, at = machine.linkages[k], machine.arm, machine.arm.joints[joint]
    wide = float(np.ptp(machine.ranges[joint])) > WIDEST
    if not isinstance(linkage, Direct) or not at.revolute or wide:
        return {}
    if linkage.joints != (joint,) or arm.links[linkage.rod_end.link].joint != joint:
        return {}
    rigid = arm.kinematics(machine.ranges.mean(axis=1)[None])
    turn, foot = arm.link_rotation(rigid, linkage.base.link)[0], rigid.translation[0, joint]
    if abs(abs(float(turn[:, 1] @ rigid.axis[0, joint])) - 1) > 1e-6:
        return {}
    # in the base pin's link: the joint, and the arm from it to the old rod end
    origin = arm.point(rigid, linkage.base.link, np.zeros(3))[0]
    pivot = turn.T @ (foot - origin)
    lever = turn.T @ (
        arm.point(rigid, linkage.rod_end.link, np.array(linkage.rod_end.at))[0] - foot
    )
    x, z = float(lever[0]), float(lever[2])
    rocker = float(np.hypot(x, z))
    if rocker < mm:
        return {}
    d = SHARE * np.array([-abs(z), 0.0, x if z > 0 else -x] if z else [0.0, 0.0, abs(x)])
    left = (x - d[0]) * z - (z - d[2]) * x > 0
    link = linkage.base.link
    return {
        "base": {"link": link, "at_mm": _in_mm(np.array(linkage.base.at) + d)},
        "four_bar": {
            "pivot": {"link": link, "at_mm": _in_mm(pivot + d)},
            "rocker_mm": round(rocker / mm, 3),
            "coupler_mm": round(float(np.hypot(d[0], d[2])) / mm, 3),
            "lug": {"link": linkage.rod_end.link, "at_mm": _in_mm(np.array(linkage.rod_end.at))},
            "knee": "left" if left else "right",
            "rocker_kg": 0,
            "coupler_kg": 0,
        },
    }


def _in_mm(at: Any) -> list[float]:
    return [round(float(x) / mm, 3) + 0.0 for x in at]
