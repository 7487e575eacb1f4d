"""Poses: what inertia, gravity, oil and geometry are at n joint positions. Axis 0 is the pose.

Rigid bodies come from ``RigidPoses``, payload, cylinders and motors are added here. With trapped
oil the arm sits on

    K = Rᵀ diag(k_h) R + ∂g/∂q − Σ F_i H_i        (hydraulic + gravity + geometric stiffness)

where R holds the moment arms ∂ℓ/∂q, H their derivatives and F the static cylinder forces (g =
RᵀF).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armdesign.arrays import Array, Flags


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

    The smallest singular value is compared with 1 µm per radian: a cylinder within that of its
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
