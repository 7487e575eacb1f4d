"""Masses that an arm carries beside its links: the payload at work and the bars of its cylinders.

Bars are barrels, rods, rockers and couplers that have a mass, as uniform slender ones. Those of
idle cylinders weigh where they stand.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from armdesign.arrays import Array, side_by_side
from armdesign.mechanism.carried_bars import of_linkage
from armdesign.mechanism.jets import VectorJet
from armdesign.mechanism.point_masses import of_carried, points_of_bars
from armdesign.mechanism.rigid_poses import RigidPoses

if TYPE_CHECKING:
    from armdesign.machine.machine import Machine


def loaded(machine: Machine, rigid: RigidPoses) -> tuple[Array, Array, Array]:
    """M, g and ∂g/∂q of the links and of all that they carry, over all coordinates."""
    load = machine.payload
    parts = [(rigid.mass_matrix, rigid.gravity_torque, rigid.gravity_stiffness)]
    if np.any(load.mass != 0) and load.link is not None:
        at = side_by_side(load.at)
        parts.append(of_carried(machine.arm, rigid, load.link, at, load.mass))
    pairs = *zip(machine.cylinders, machine.linkages, strict=True), *machine.idle_cylinders
    for cylinder, linkage in pairs:
        if masses := cylinder.moving_masses:
            parts.append(of_linkage(linkage, masses, cylinder.closed_length, rigid))
    mass, gravity, slope = (sum(each[1:], each[0]) for each in zip(*parts, strict=True))
    return mass, gravity, slope


def bar_points(machine: Machine, rigid: RigidPoses) -> list[tuple[float, VectorJet]]:
    """Point masses [kg] in place of the bars of cylinders that move."""
    pairs = zip(machine.cylinders, machine.linkages, strict=True)
    return [point for pair in pairs for point in points_of_bars(*pair, rigid)]
