"""Modes as motion: joint positions by which a machine swings in a mode, so far at the tool."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from armdesign.arrays import Array

if TYPE_CHECKING:
    from armdesign.machine.machine import Machine

AT_REST = 1e-3  # of the largest motion of a pin: less counts as a tool that stands still


def swung(machine: Machine, q: Array, mode: Array, amplitude: float) -> Array:
    """Coordinates (n, k) [rad, m] of a machine displaced by a mode, springs last.

    The displacement of the tool to first order has the length ``amplitude``; of the point that
    moves furthest where the tool stands still. Over one period q + (swung − q) sin(ωt).

    Args:
        machine: the machine.
        q: positions of the joints (n, nq).
        mode: its shape at each pose (n, k), as ``Modes.shapes[:, :, mode]``.
        amplitude: of the tool [m]; negative to the other side.
    """
    arm = machine.arm
    poses, joints = arm.kinematics(q), tuple(range(len(arm.coordinates)))
    pins = [machine.tool, *(pin for linkage in machine.linkages for pin in linkage.pins)]
    places = [(pin.link, np.array(pin.at)) for pin in pins]
    slopes = [arm.motion(poses, link, at, arm.root, joints).first for link, at in places]
    moves = np.stack([np.linalg.norm(_along(slope, mode), axis=1) for slope in slopes], axis=1)
    tool, most = moves[:, 0], moves.max(axis=1)
    size = np.where(tool > AT_REST * most, tool, most)
    step = amplitude / np.where(size > 0, size, 1.0)
    return np.asarray(arm.with_springs(q) + step[:, None] * mode)


def round_amplitude(size: float) -> float:
    """An amplitude [m] that is well seen in a picture of a size [m]: a twentieth, as 1, 2, 5."""
    rough = size / 20
    decade = 10.0 ** math.floor(math.log10(rough))
    return max(step * decade for step in (1, 2, 5) if step * decade <= rough)


def _along(slope: Array, mode: Array) -> Array:
    """Motion (n, 3) of a point with slopes (n, k, 3) along a mode (n, k)."""
    return np.asarray(np.einsum("nki,nk->ni", slope, mode))
