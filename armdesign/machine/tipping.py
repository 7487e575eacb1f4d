"""Tipping: the mass at a point of the arm that tips the machine about a line on the ground.

Moments balance about the tipping line ahead of the slew axis, or about the one behind it: on one
side of it the point's mass, on the other what stands still (``[stability]``) and the arm's own
links, cylinders and four-bars. The lines turn with the reach; where a crawler stands across,
``front_mm`` is the distance of the track's edge. The ground is level, as the root is, whatever way
the slew axis leans: distances are level ones from where that axis meets it.
"""

from __future__ import annotations

import numpy as np

from armdesign.arrays import Array
from armdesign.machine.carried_masses import bar_points
from armdesign.machine.file.schema import StabilitySection
from armdesign.machine.machine import Machine
from armdesign.mechanism.rigid_poses import RigidPoses
from armdesign.units import mm


def tipping_masses(machine: Machine, rigid: RigidPoses, ahead: Array) -> Array:
    """Mass (n,) [kg] that tips the machine; infinite where the point is between the lines.

    0 beyond a line about which the arm alone tips it; between them a load may steady it. Without
    ``[stability]`` nothing tips.

    Args:
        machine: stability, masses.
        rigid: poses (n).
        ahead: of the slew axis, places of the point (n,) [m]; behind it negative.
    """
    stability = machine.section.stability
    if stability is None:
        return np.full(len(rigid), np.inf)
    front = _about(machine, rigid, ahead, stability, stability.front_mm * mm, 1.0)
    rear = _about(machine, rigid, ahead, stability, stability.rear_mm * mm, -1.0)
    return np.minimum(front, rear)


def _about(
    machine: Machine,
    rigid: RigidPoses,
    ahead: Array,
    stability: StabilitySection,
    line: float,
    side: float,
) -> Array:
    """Mass (n,) [kg] that tips it about a line [m] ahead of the slew axis, or behind: −1."""
    mass, moment = moving_mass(machine, rigid)
    standing = stability.mass_kg * (line - side * stability.at_mm[0] * mm)
    righting = standing + mass * line - side * moment
    lever = side * ahead - line
    beyond = lever > 0
    tips = np.maximum(righting, 0.0) / np.where(beyond, lever, 1.0)
    return np.where(beyond, tips, np.inf)


def centre_ahead(machine: Machine, rigid: RigidPoses) -> Array | None:
    """Centre of mass of the unloaded machine (n,) [m] ahead of the slew axis, at n poses.

    None without ``[stability]``, or without any mass.
    """
    stability = machine.section.stability
    if stability is None:
        return None
    mass, moment = moving_mass(machine, rigid)
    whole = stability.mass_kg + mass
    return (stability.mass_kg * stability.at_mm[0] * mm + moment) / whole if whole else None


def moving_mass(machine: Machine, rigid: RigidPoses) -> tuple[float, Array]:
    """Mass [kg] of what the arm's joints move, and its moment (n,) [kg m] ahead of the slew axis.

    What only slews and rocks on springs, such as an excavator's upper structure, belongs to
    ``[stability]``.
    """
    arm = machine.arm
    masses, places = arm.bodies(rigid)
    moves = [j for j in range(len(masses)) if j not in arm.slews and j not in arm.slews.rocking]
    points = [(float(masses[j]), places[:, j]) for j in moves]
    points += [(mass, motion.value) for mass, motion in bar_points(machine, rigid)]
    points += [
        (mass, arm.point(rigid, link, at))
        for mass, link, at in machine.idle_points
        if arm.links[link].joint in moves
    ]
    ahead = machine.heading.ahead
    moment = sum((m * ahead(rigid.q, at) for m, at in points), np.zeros(len(rigid)))
    return sum(m for m, _ in points), moment
