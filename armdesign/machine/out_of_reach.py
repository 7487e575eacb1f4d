"""Places and poses out of reach: by how much, and the nearest within it."""

from __future__ import annotations

import itertools
from collections.abc import Iterable

import numpy as np

from armdesign.arrays import Array
from armdesign.machine.machine import Machine
from armdesign.machine.reaching import (
    LATTICE,
    TOLERANCE,
    lattice,
    place_and_slopes,
    poses_reaching,
    within_reach,
)
from armdesign.mechanism.linkage.base import Pin
from armdesign.units import WORKSHOP, deg, mm

Reason = tuple[str, str]  # words, remedy

ZOOMS = 4  # of the lattice, each to the cells about its nearest node
AROUND = 4  # whole millimetres about the nearest place, of which one is within reach


def pose_out_of_reach(machine: Machine, q: Array) -> Reason | None:
    """Joints or stroke that end before a pose (nq,), and where; None where none does.

    A joint's range is what its own strokes and limits allow, so that a stroke alone ends a motion
    only where its cylinder spans several joints.
    """
    if reason := _beyond_range(machine, q, range(len(machine.joints))):
        return reason
    margins = machine.margins(q[None])[0]
    worst = int(margins.argmin())
    if margins[worst] >= -TOLERANCE:
        return None
    moved = " or ".join(machine.joints[j] for j in machine.drives[worst].joints)
    share = f" by {-100 * margins[worst]:.0f} % of it" * bool(np.isfinite(margins[worst]))
    name = machine.actuators[worst].name
    return f"the pose is beyond the stroke of the {name} cylinder{share}", f"change {moved}"


def _beyond_range(machine: Machine, q: Array, joints: Iterable[int]) -> Reason | None:
    """Joints of a pose (nq,) that are beyond their range, and the ranges; None where none is."""
    words, ranges = [], []
    for j in joints:
        joint, (low, high) = machine.arm.joints[j], machine.ranges[j]
        if not low - TOLERANCE <= q[j] <= high + TOLERANCE:
            words.append(f"{joint.name} at {WORKSHOP.text(q[j], joint.unit)}")
            step = (deg if joint.revolute else mm) / 10  # a joint's own decimal, rounded inward
            inside = np.ceil(low / step) * step, np.floor(high / step) * step
            ranges.append(f"{joint.name} in {WORKSHOP.span(*inside, joint.unit)}")
    if not words:
        return None
    return f"{', '.join(words)}: beyond its range", f"give {', '.join(ranges)}"


def place_out_of_reach(
    machine: Machine, point: Pin, joints: tuple[int, ...], q: Array, place: Array
) -> Reason:
    """Distance of a place (2,) [m] from those that a point reaches by two joints; the nearest.

    The others stand as in ``q`` (nq,).
    """
    others = [j for j in range(len(machine.joints)) if j not in joints]
    fixed = q.copy()
    fixed[list(joints)] = machine.ranges[list(joints)].mean(axis=1)
    if reason := _beyond_range(machine, fixed, others):
        return reason
    nearest = _nearest(machine, point, joints, fixed, place)
    stands = f" with {_standing(machine, others, fixed)}" if others else ""
    at = ", ".join(f"{x / mm:.0f}" for x in point.at)
    carrier = f"the point [{at}] mm on the {point.link}"
    if nearest is None:
        return f"no stroke allows a pose of {carrier}{stands}", "let other joints stand elsewhere"
    asked = f"reach {place[0] / mm:.0f} mm at height {place[1] / mm:.0f} mm"
    beyond = f"{np.hypot(*(nearest - place)) / mm:.0f} mm out of reach of"
    within = _whole(machine, point, joints, fixed, nearest)
    reach, height = (f"{round(x / mm, 1) + 0.0:g}" for x in within)
    return (
        f"{asked} is {beyond} {carrier}{stands}",
        f"the nearest that works is reach_mm = {reach}, height_mm = {height}",
    )


def _standing(machine: Machine, joints: list[int], q: Array) -> str:
    units = [machine.arm.joints[j].unit for j in joints]
    return " and ".join(
        f"{machine.joints[j]} at {WORKSHOP.text(q[j], unit)}"
        for j, unit in zip(joints, units, strict=True)
    )


def _nearest(
    machine: Machine, point: Pin, joints: tuple[int, ...], q: Array, place: Array
) -> Array | None:
    """Reached place (2,) [m] nearest to another; None where strokes allow no pose."""
    ranges = machine.ranges[list(joints)]
    width, nodes = np.ptp(ranges, axis=1), lattice(machine, joints, q)
    for _ in range(ZOOMS):
        nodes = nodes[within_reach(machine, nodes)]
        if len(nodes) == 0:
            return None
        places, _ = place_and_slopes(machine, point, joints, nodes)
        k = int(np.hypot(*(places - place).T).argmin())
        best, node = places[k], nodes[k : k + 1]
        width = width / (LATTICE - 1)
        around = node[0, list(joints), None] + np.outer(width, [-1.0, 1.0])
        spans = np.clip(around, ranges[:, :1], ranges[:, 1:])
        nodes = np.concatenate([node, lattice(machine, joints, q, spans)])
        width = 2 * width
    return best


def _whole(machine: Machine, point: Pin, joints: tuple[int, ...], q: Array, place: Array) -> Array:
    """The nearest place within reach on whole millimetres; without one, the given place."""
    shifts = np.array(list(itertools.product(range(-AROUND, AROUND + 1), repeat=2)))
    whole = (np.rint(place / mm) + shifts) * mm
    _, which = poses_reaching(machine, point, joints, q, whole)
    reached = whole[which]
    if len(reached) == 0:
        return place
    return np.asarray(reached[np.hypot(*(reached - place).T).argmin()])
