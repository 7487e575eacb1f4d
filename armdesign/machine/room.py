"""Room that a pose leaves to cylinders across several joints, as conditions for local searches.

These alone cut the box of the joint ranges: by their strokes, and where their linkages open. There
they have no length, so a search that steps there is led back by how far they are open.
"""

from __future__ import annotations

import numpy as np

from armdesign.arrays import Array
from armdesign.machine.machine import Machine
from armdesign.mechanism.rigid_poses import RigidPoses

STRAIGHT = 1e-11  # squared sine of the angle of two bars up to which they count as open


def across(machine: Machine) -> list[int]:
    """Indices of the cylinders across several joints."""
    return [i for i, linkage in enumerate(machine.linkages) if len(linkage.joints) > 1]


def room(machine: Machine, rigid: RigidPoses, end_margin: float = 0.0) -> Array:
    """Numbers (n, 2k) that are ≥ 0 where k cylinders across several joints are within strokes.

    Shares of the strokes that are left beside the end margin, 0 where linkages are open, and how
    far these are from that.
    """
    some = across(machine)
    left = machine.margins(rigid)[:, some] - end_margin
    closures = [machine.linkages[i].closure(rigid) - STRAIGHT for i in some]
    return np.column_stack([np.where(np.isfinite(left), left, 0.0), *closures])
