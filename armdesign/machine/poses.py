"""Poses: inertia, gravity, oil and geometry at n joint positions, and positions that cannot be.

Axis 0 is the pose. Rigid bodies come from ``RigidPoses``, payload, cylinders and motors are added
here. With trapped oil the arm sits on

    K = Rᵀ diag(k_h) R + ∂g/∂q − Σ F_i H_i        (hydraulic + gravity + geometric stiffness)

where R holds the moment arms ∂ℓ/∂q, H their derivatives and F the static cylinder forces (g =
RᵀF).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from armdesign.arrays import Array, Flags
from armdesign.errors import PoseError
from armdesign.mechanism.linkage.base import Linkage
from armdesign.units import deg

if TYPE_CHECKING:
    from armdesign.machine.machine import Machine


@dataclass(frozen=True, eq=False, kw_only=True)
class Poses:
    """Everything at n poses of a machine with nq joints and nc actuators; arrays are read-only.

    Actuators are the cylinders and after them the motors, see ``Machine.actuators``. For a motor
    read angle of its joint [rad] for length, torque [N m] for force, and [N m/rad] for the unit of
    its stiffness.

    Attributes:
        q: joint positions (n, nq) [rad, m].
        mass_matrix: joint-space inertia M, payload included (n, nq, nq) [kg m², kg].
        gravity_torque: g (n, nq) [N m, N].
        gravity_stiffness: ∂g/∂q (n, nq, nq).
        lengths: pin-to-pin cylinder lengths ℓ (n, nc) [m].
        moment_arms: R = ∂ℓ/∂q (n, nc, nq) [m/rad].
        moment_arm_derivatives: H = ∂²ℓ/∂q² (n, nc, nq, nq).
        extensions: share of the stroke that is out (n, nc), 0…1; 0 for a motor.
        cylinder_forces: static force of each actuator (n, nc) [N, + pushes].
        oil_stiffness: k_h of each actuator with its valve closed (n, nc) [N/m].
        tool: position of the tool in the root link (n, 3) [m].
    """

    q: Array
    mass_matrix: Array
    gravity_torque: Array
    gravity_stiffness: Array
    lengths: Array
    moment_arms: Array
    moment_arm_derivatives: Array
    extensions: Array
    cylinder_forces: Array
    oil_stiffness: Array
    tool: Array

    def __post_init__(self) -> None:
        for value in vars(self).values():
            value.setflags(write=False)

    def __len__(self) -> int:
        return len(self.q)

    def __getitem__(self, rows: slice | Array) -> Poses:
        """The poses that ``rows`` selects (slice, mask or indices)."""
        return Poses(**{name: getattr(self, name)[rows] for name in self.__dataclass_fields__})

    @cached_property
    def hydraulic_stiffness(self) -> Array:
        """Rᵀ diag(k_h) R (n, nq, nq)."""
        weighted = self.moment_arms * self.oil_stiffness[:, :, None]
        return np.asarray(np.swapaxes(self.moment_arms, 1, 2) @ weighted)

    @cached_property
    def geometric_stiffness(self) -> Array:
        """−Σ F_i H_i (n, nq, nq): the moment arms change under static load."""
        return -np.einsum("nc,ncij->nij", self.cylinder_forces, self.moment_arm_derivatives)

    @cached_property
    def stiffness_matrix(self) -> Array:
        """K (n, nq, nq): minus the derivative of the net torque by q with the oil trapped."""
        return self.hydraulic_stiffness + self.gravity_stiffness + self.geometric_stiffness


def static_forces(moment_arms: Array, gravity_torque: Array, areas: Array) -> Array:
    """Cylinder forces (…, nc) [N, + pushes] that hold gravity (…, nq), g = RᵀF.

    They are inf where a pose is singular. With more cylinders than joints equilibrium leaves a
    choice: the least Σ (F/A)² is taken, that is F = W R (Rᵀ W R)⁻¹ g with W = diag(A²), bore areas
    ``areas`` (…, nc). Axes in front are broadcast. Complex-safe.
    """
    singular, own = is_singular(np.real(moment_arms)), own_joints(moment_arms)
    gravity = np.broadcast_to(gravity_torque, (*moment_arms.shape[:-2], moment_arms.shape[-1]))
    if own is not None:
        arm = moment_arms[..., np.arange(len(own)), own]
        return np.asarray(
            np.where(singular[..., None], np.inf, gravity[..., own] / np.where(arm == 0, 1.0, arm))
        )
    forces = np.full(
        moment_arms.shape[:-1], np.inf, dtype=np.result_type(moment_arms, gravity, areas, float)
    )
    arms, loads = moment_arms[~singular], gravity[~singular, :, None]
    turned = np.swapaxes(arms, 1, 2)
    if arms.shape[1] == arms.shape[2]:
        forces[~singular] = np.linalg.solve(turned, loads)[..., 0]
    else:
        squares = np.broadcast_to((areas / np.real(areas).max()) ** 2, forces.shape)[~singular][
            ..., None
        ]
        forces[~singular] = (squares * (arms @ np.linalg.solve(turned @ (squares * arms), loads)))[
            ..., 0
        ]
    return forces


def is_singular(moment_arms: Array) -> Flags:
    """Whether a motion is free (…,): R (…, nc, nq) without full column rank, or not finite.

    The smallest singular value is compared with 1 µm per radian: a cylinder within this of its
    dead centre.
    """
    nc, nq = moment_arms.shape[-2:]
    if nc < nq:
        return np.ones(moment_arms.shape[:-2], dtype=bool)
    finite, own = np.all(np.isfinite(moment_arms), axis=(-2, -1)), own_joints(moment_arms)
    if own is not None:  # the arms are the singular values
        smallest = np.abs(moment_arms[..., np.arange(len(own)), own]).min(axis=-1)
    else:
        known = np.where(finite[..., None, None], moment_arms, 0.0)
        smallest = np.linalg.svd(known, compute_uv=False)[..., -1]
    return np.asarray(~finite | ~(smallest >= 1e-6))


def own_joints(moment_arms: Array) -> Array | None:
    """The joint that each cylinder moves (nc,); None unless each moves one of its own."""
    used = np.any(moment_arms != 0, axis=tuple(range(moment_arms.ndim - 2)))
    alone = (
        used.shape[0] == used.shape[1]
        and np.all(used.sum(axis=0) == 1)
        and np.all(used.sum(axis=1) == 1)
    )
    return np.asarray(used.argmax(axis=1)) if alone else None


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
