"""Joints that turn about one direction, as of a boom in its plane: their angles add up.

One rotation by the sum stands for a product of rotations, which takes most of the time of
placements.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armdesign.arrays import Array
from armdesign.mechanism.urdf import Joint, turning

PARALLEL = 1e-14  # sine of the angle between directions that are one but for rounding


def turning_alike(
    joints: Sequence[Joint], chains: Sequence[tuple[int, ...]]
) -> dict[int, tuple[Array, Array]]:
    """Joints whose chain from the root has revolute joints of one direction alone.

    Of each the sign of every joint's angle in the sum (k,), and the parts (3, 9) of its frame's
    rotation by that sum, as ``rotated`` takes them.

    Args:
        joints: of the arm (k).
        chains: the joints from the root to each, itself included.
    """
    alike: dict[int, tuple[Array, Array]] = {}
    for index, chain in enumerate(chains):
        still, directions = np.eye(3), list[Array]()
        for joint in (joints[k] for k in chain):
            still = still @ joint.rotation
            directions.append(still @ joint.axis)
        across = np.linalg.norm(np.cross(directions, directions[-1]), axis=1)
        if all(joints[k].revolute for k in chain) and across.max() < PARALLEL:
            signs = np.zeros(len(joints))
            signs[list(chain)] = np.sign(directions @ directions[-1])
            alike[index] = signs, turning(joints[index].axis, still)
    return alike
