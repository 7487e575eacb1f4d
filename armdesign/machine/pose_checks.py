"""Joint positions that cannot be: no numbers, out of stroke, singular, the load not held."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from armdesign.arrays import Array
from armdesign.errors import PoseError
from armdesign.machine.poses import Poses, is_singular
from armdesign.mechanism.linkage.base import Linkage
from armdesign.units import deg

if TYPE_CHECKING:
    from armdesign.machine.machine import Machine

STROKE_TOLERANCE = 1e-6  # [m] a pose this far beyond an end stop still counts as on it


def joint_positions(machine: Machine, q: ArrayLike) -> Array:
    """Joint positions as an array (n, nq) of finite numbers; one pose may be given alone (nq,).

    Raises:
        PoseError: they are no such array.
    """
    part, nq = f"{machine.name}: q", len(machine.joints)
    try:
        if np.iscomplexobj(q):
            raise TypeError
        array = np.array(q, dtype=float)
    except (TypeError, ValueError):
        raise PoseError(part, "is not an array of numbers", f"give shape (n, {nq})") from None
    array = array[None] if array.ndim == 1 else array
    if array.ndim != 2 or array.shape[1] != nq:
        raise PoseError(
            part, f"has shape {array.shape}", f"give (n, {nq}): {', '.join(machine.joints)}"
        )
    if not np.all(np.isfinite(array)):
        raise PoseError(part, "holds a number that is not finite", "give finite joint positions")
    return array


def refuse_unreachable(machine: Machine, poses: Poses) -> None:
    """Raise for the first pose that the machine cannot take.

    Raises:
        PoseError: out of stroke, a four-bar that does not close, or singular.
    """
    pairs = zip(machine.linkages, machine.cylinders, poses.lengths.T, strict=False)
    for linkage, cylinder, length in pairs:
        part = f"{machine.name}: {cylinder.name} cylinder"
        if np.any(open_ := ~np.isfinite(length)):
            raise PoseError(
                part,
                f"its {linkage.title} does not close at {_pose_text(machine, poses.q[open_][0])}",
                f"stay in the range of {_range_text(machine, linkage)}",
            )
        out = (length < cylinder.closed_length - STROKE_TOLERANCE) | (
            length > cylinder.open_length + STROKE_TOLERANCE
        )
        if np.any(out):
            raise PoseError(
                part,
                f"length {length[out][0]:.4f} m is outside its stroke "
                f"[{cylinder.closed_length:.4f}, {cylinder.open_length:.4f}] m "
                f"at {_pose_text(machine, poses.q[out][0])}",
                f"stay in the range of {_range_text(machine, linkage)} or change stroke and pins",
            )
    if np.any(singular := is_singular(poses.moment_arms)):
        where = _pose_text(machine, poses.q[singular][0])
        raise PoseError(
            f"{machine.name}: pose",
            f"singular at {where}: a cylinder is at its dead centre",
            "avoid it",
        )


def refuse_unheld(machine: Machine, q: ArrayLike) -> None:
    """Raise for the first pose at which the load case at work does not exist.

    Raises:
        PoseError: they are no joint positions, or a link is tipped out of the load case's pitch.
    """
    positions, case = joint_positions(machine, q), machine.payload
    unheld = ~machine.holds(positions)
    if case.pitch is None or case.link is None or not unheld.any():
        return
    pitch = machine.arm.pitch(machine.arm.kinematics(positions[unheld][:1]), case.link)[0]
    low, high = case.pitch
    middle = (low + high) / 2
    nearest = middle + math.remainder(pitch - middle, 2 * math.pi)
    raise PoseError(
        f"{machine.name}: payload {case.name}",
        f"the {case.link} has a pitch of {nearest / deg:.1f} deg"
        f" at {_pose_text(machine, positions[unheld][0])}, it holds the load at"
        f" {low / deg:g}…{high / deg:g} deg",
        "choose another pose or load case",
    )


def _pose_text(machine: Machine, q: Array) -> str:
    return ", ".join(
        f"{joint.name} {value:.4f} {joint.unit}"
        for joint, value in zip(machine.arm.joints, q, strict=True)
    )


def _range_text(machine: Machine, linkage: Linkage) -> str:
    ranges = ((machine.arm.joints[j], *machine.ranges[j]) for j in linkage.joints)
    return " and ".join(
        f'joint "{joint.name}" [{low:.4f}, {high:.4f}] {joint.unit}' for joint, low, high in ranges
    )
