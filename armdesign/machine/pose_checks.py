"""Joint positions that cannot be: no numbers, out of stroke, open four-bar, singular, toppling."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from armdesign.arrays import Array
from armdesign.errors import PoseError
from armdesign.machine.poses import Poses, is_singular
from armdesign.mechanism.linkage.base import Linkage
from armdesign.mechanism.spring import least_stiffness_factors
from armdesign.units import outward

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
    if np.any(singular := is_singular(poses.moment_arms[..., : len(machine.joints)])):
        where = _pose_text(machine, poses.q[singular][0])
        raise PoseError(
            f"{machine.name}: pose",
            f"singular at {where}: a cylinder is at its dead centre",
            "avoid it",
        )


def refuse_toppling(machine: Machine, poses: Poses) -> None:
    """Raise for the pose that asks most of a spring, where springs are too soft for gravity.

    Poses at which joints on their oil are unstable, whatever the springs, are left to their
    frequency of zero.

    Raises:
        PoseError: K is not positive definite, and would be on stiffer springs.
    """
    if not machine.springs:
        return
    try:
        np.linalg.cholesky(poses.stiffness_matrix)
    except np.linalg.LinAlgError:
        factors = least_stiffness_factors(poses.stiffness_matrix, machine.spring_stiffness)
        least = factors.min(axis=1)
        worst = int(np.where(np.isinf(least), 0.0, least).argmax())
        if 1 <= least[worst] < np.inf:
            raise _too_soft(machine, poses.q[worst], factors[worst]) from None


def _too_soft(machine: Machine, q: Array, factors: Array) -> PoseError:
    """A pose that topples, and how stiff one spring must be, or all, by ``factors`` (ns + 1,)."""
    chosen, factor = int(factors.argmin()), outward(float(factors.min()), 4, up=True)
    spring = machine.springs[min(chosen, len(machine.springs) - 1)]
    path = f"spring.{spring.name}.{spring.stiffness_key}"
    least = f"{outward(factor * spring.stiffness, 4, up=True):g} {spring.stiffness_unit}"
    remedy = f"give more than {least}"
    if chosen == len(machine.springs):
        names = ", ".join(spring.name for spring in machine.springs)
        remedy = f"multiply the stiffness of all springs ({names}) by more than {factor:g}"
    problem = (
        f"{spring.stiffness:g} {spring.stiffness_unit} does not hold the machine upright at"
        f" {_pose_text(machine, q)}, payload {machine.payload.name}: gravity overcomes it"
    )
    place = f"{machine.source.name}: {path}"
    return PoseError(place, problem, remedy, machine.line_of(path))


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
