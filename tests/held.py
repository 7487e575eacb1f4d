"""Machines with heavy cylinders and frozen joints, beside themselves with these joints held."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from armdesign import Machine
from tests import sprung
from tests.machines import inner_poses, named

MASSES = {"barrel_kg": 110, "rod_kg": 85, "four_bar.rocker_kg": 95, "four_bar.coupler_kg": 130}
AT = {"bucket": -1.0}  # of the excavators; of all others 0.1 rad or m
FROZEN = {  # by the name of a machine its joints that are frozen; their cylinders are then idle
    "four_bar_left": ("bucket",),
    "four_bar_from_boom": ("stick", "bucket"),  # its cylinder spans both
    "spatial": ("slide", "wrist"),  # one slides, all lean
    "redundant": ("stick",),
    "slewing": ("bucket",),
    "rocking": ("bucket",),  # on a spring
}
WITH_OWN_JOINTS = tuple(name for name in FROZEN if name != "redundant")


@dataclass(frozen=True, eq=False)
class Held:
    """A machine with frozen joints, and the same one that holds them there.

    Attributes:
        frozen: the machine.
        awake: with all joints as coordinates.
        q: poses of the frozen one (n, nq).
        whole: the same poses of the other.
        rest: the coordinates of the other that the frozen one has too.
    """

    frozen: Machine
    awake: Machine
    q: np.ndarray
    whole: np.ndarray
    rest: list[int]


@cache
def held(name: str) -> Held:
    """One of ``FROZEN``, whose cylinders and four-bars all weigh."""
    awake = heavy(sprung.rocking() if name == "rocking" else named(name))
    awake = awake.with_payload(awake.payloads[-1].name)
    values = {joint: AT.get(joint, 0.1) for joint in FROZEN[name]}
    if name.startswith("four_bar"):
        values = dict.fromkeys(values, 0.1)
    moving = [joint for joint in awake.joints if joint not in values]
    standing = {f"frozen.{joint}": value for joint, value in values.items()}
    frozen = awake.replace({"joints": moving, **standing})
    q = inner_poses(frozen, 3)
    whole = np.array([[values.get(joint, 0.0) for joint in awake.joints]] * len(q))
    whole[:, [awake.joints.index(joint) for joint in moving]] = q
    names = [joint.name for joint in awake.arm.coordinates]
    rest = [names.index(joint.name) for joint in frozen.arm.coordinates]
    return Held(frozen, awake, q, whole, rest)


def heavy(machine: Machine) -> Machine:
    """A machine all of whose cylinders and four-bars weigh."""
    masses: dict[str, Any] = {}
    for cylinder, linkage in zip(machine.cylinders, machine.linkages, strict=True):
        for key, mass in MASSES.items():
            if linkage.bar_names or "." not in key:
                masses[f"cylinder.{cylinder.name}.{key}"] = mass
    return machine.replace(masses)
