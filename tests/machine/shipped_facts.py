"""Facts of the shipped machines: masses, reach, digging forces by the makers' definitions."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from functools import cache

import numpy as np

from armdesign.machine.loading import shipped
from armdesign.machine.machine import Machine
from tests import machines

MPA = 1e6


SHIPPED = (
    "paper_1dof",
    "patu_boom",
    "mini_excavator_2t",
    "excavator_12t",
    "excavator_20t",
    "loader_crane",
)


EXCAVATORS = ("mini_excavator_2t", "excavator_12t", "excavator_20t")


REAL = SHIPPED[1:]


@dataclass(frozen=True)
class Facts:
    """What is known of a machine, by cylinder or joint; m, kg, MPa, Hz, kN, degrees."""

    mass: float  # of all links
    moment_arms: dict[str, tuple[float, float]]  # smallest and largest over the range
    dead_lengths: dict[str, float]
    # largest static cap and annulus pressure under full payload, any pitch
    pressures: dict[str, tuple[float, float]]
    reach: float
    height: float
    depth: float
    reach_at_ground: float | None = None
    # lowest frequency: 5 %, 50 %, 95 % of the joint box
    empty: tuple[float, float, float] = 0, 0, 0
    full: tuple[float, float, float] = (0, 0, 0)
    # force [kN] and best joint angle [deg]
    digging: dict[str, tuple[float, float]] = field(default_factory=dict)


FACTS = {  # second, but for the masses: sums of the sources' masses, by hand
    "patu_boom": Facts(
        mass=143.66,
        moment_arms={"lift": (0.1330, 0.3202)},
        dead_lengths={"lift": 0.285},
        pressures={"lift": (3.8, 0.3)},
        reach=2.78,
        height=4.30,
        depth=-0.21,
        empty=(17.81, 21.04, 34.66),
        full=(6.83, 8.06, 13.28),
    ),
    "mini_excavator_2t": Facts(
        mass=227.343 + 130.123 + 53,
        moment_arms={
            "boom": (0.1529, 0.2965),
            "stick": (0.1395, 0.2966),
            "bucket": (0.0310, 0.1766),
        },
        dead_lengths={"boom": 0.505, "stick": 0.536, "bucket": 0.420},
        pressures={"boom": (8.5, 0.0), "stick": (5.1, 6.7), "bucket": (5.8, 6.3)},
        reach=4.23,
        height=3.91,
        depth=1.59,
        reach_at_ground=4.13,
        empty=(4.92, 6.49, 10.02),
        full=(4.02, 5.47, 8.02),
        digging={"bucket": (15.5, -16.7), "stick": (11.0, -79.1)},
    ),
    "excavator_12t": Facts(
        mass=1250 + 550 + 430,
        moment_arms={
            "boom": (0.2276, 0.4899),
            "stick": (0.2730, 0.6687),
            "bucket": (0.1246, 0.3986),
        },
        dead_lengths={"boom": 0.699, "stick": 0.456, "bucket": 0.466},
        pressures={"boom": (25.9, 0.0), "stick": (15.1, 19.8), "bucket": (8.1, 13.4)},
        reach=8.23,
        height=8.51,
        depth=5.48,
        reach_at_ground=8.10,
        empty=(2.12, 2.91, 3.79),
        full=(1.50, 2.07, 2.73),
        digging={"bucket": (86.8, -24.2), "stick": (65.1, -75.3)},
    ),
    "excavator_20t": Facts(
        mass=16520 + 2310 + 1010 + 660,
        moment_arms={
            "boom": (0.3355, 0.7589),
            "stick": (0.3148, 0.8734),
            "bucket": (0.0942, 0.4919),
        },
        dead_lengths={"boom": 0.565, "stick": 0.296, "bucket": 0.590},
        pressures={"boom": (20.8, 0.0), "stick": (18.2, 19.4), "bucket": (16.2, 17.3)},
        reach=9.94,
        height=10.46,
        depth=6.35,
        reach_at_ground=9.76,
        empty=(1.36, 2.42, 3.28),
        full=(0.98, 1.67, 2.32),
        digging={"bucket": (129.6, -14.9), "stick": (108.0, -73.5)},
    ),
    "loader_crane": Facts(
        mass=93.26 + 143.66 + 76.7 + 58.63,
        moment_arms={"lift": (0.1330, 0.3202), "tilt": (0.1434, 0.3437), "extension": (1.0, 1.0)},
        dead_lengths={"lift": 0.285, "tilt": 0.350, "extension": 0.400},
        pressures={"lift": (10.8, 1.4), "tilt": (8.2, 7.7), "extension": (1.3, 2.6)},
        reach=6.46,
        height=7.97,
        depth=3.46,
        reach_at_ground=6.30,
        empty=(5.78, 7.96, 12.04),
        full=(2.85, 4.04, 6.19),
    ),
}


def sweep(machine: Machine, joint: int, count: int = 2001) -> np.ndarray:
    """Poses with one joint moving over its range and the others in the middle of theirs."""
    q = np.tile(machine.ranges.mean(axis=1), (count, 1))
    q[:, joint] = np.linspace(*machine.ranges[joint], count)
    return q


def box(machine: Machine, counts: tuple[int, ...], inner: bool = False) -> np.ndarray:
    """A grid over the full joint ranges, ends included; or the middles of its cells."""
    axes = []
    for (low, high), n in zip(machine.ranges, counts, strict=False):
        shares = (np.arange(n) + 0.5) / n if inner else np.linspace(0, 1, n)
        axes.append(low + shares * (high - low))
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))


@cache
def tool_positions(name: str) -> np.ndarray:
    """Tool positions (n, 3) [m] over the joint box; the step costs less than 3 mm of the largest
    reach.
    """
    machine = machines.named(name)
    counts = (4001,) if len(machine.joints) == 1 else (71, 71, 41)
    kinematics = machine.arm.kinematics(box(machine, counts))
    return np.array(machine.arm.point(kinematics, machine.tool.link, np.array(machine.tool.at)))


def foot(name: str) -> np.ndarray:
    """Boom-foot pin (x, z) [m] from the slew axis on the ground."""
    robot = ET.fromstring(machines.named(name).urdf_text)
    origin = robot.find("joint[@name='boom_foot']/origin")
    assert origin is not None
    x, _, z = (float(word) for word in str(origin.get("xyz")).split())
    return np.array([x, z])


def reach_at_ground(name: str) -> float:
    """By hand: from the boom foot the stretched arm reaches a circle, which the ground cuts at z =
    0 [m].
    """
    x, z = foot(name)
    tool = tool_positions(name)
    radius = np.hypot(tool[:, 0] - x, tool[:, 2] - z).max()
    return float(x + math.sqrt(radius**2 - z**2))


def loading_height(name: str) -> float:
    """Largest height of the tooth while it hangs straight below the bucket pin [m]."""
    machine = machines.named(name)
    q = box(machine, (301, 301, 2))
    q = q[q[:, 2] == machine.ranges[2, 0]]
    q[:, 2] = -math.pi / 2 - q[:, 0] - q[:, 1]  # pitch of the bucket: straight down
    q = q[(q[:, 2] >= machine.ranges[2, 0]) & (q[:, 2] <= machine.ranges[2, 1])]
    return float(
        machine.arm.point(machine.arm.kinematics(q), machine.tool.link, np.array(machine.tool.at))[
            :, 2
        ].max()
    )


def digging(name: str) -> dict[str, tuple[float, float]]:
    """By hand, after ISO 6015: p A r / distance to the tooth, at the largest r, bucket as it digs
    best [kN, deg].
    """
    machine = machines.named(name)
    q = machine.ranges.mean(axis=1)
    forces = {}
    for cylinder, joint in (("bucket", 2), ("stick", 1)):
        i = [c.name for c in machine.cylinders].index(cylinder)
        poses = machine.at(sweep(machine, joint, 8001))
        arms = np.abs(poses.moment_arms[:, i, joint])
        q[joint] = poses.q[arms.argmax(), joint]
        # the link's own joint
        pivot = machine.arm.point(machine.arm.kinematics(q[None]), cylinder, np.zeros(3))
        distance = float(np.linalg.norm(machine.at(q).tool - pivot))
        force = machine.supply.pressure * machine.cylinders[i].bore_area * arms.max() / distance
        forces[cylinder] = (force / 1e3, math.degrees(q[joint]))
    return forces


# --------------------------------------------------------------------------------------- SOURCE.md


def source_text(name: str) -> str:
    return shipped()[name].with_name("SOURCE.md").read_text(encoding="utf-8").replace("−", "-")
