"""Poses: what inertia, gravity, oil and geometry are at n joint positions. Axis 0 is the pose.

Rigid bodies come from ``RigidPoses``, payload, cylinders and motors are added here. With trapped
oil the arm sits on

    K = Rᵀ diag(k_h) R + ∂g/∂q − Σ F_i H_i + diag(0, κ)
        (hydraulic + gravity + geometric stiffness + springs)

where R holds the moment arms ∂ℓ/∂q, H their derivatives and F the static cylinder forces (g =
RᵀF). Coordinates are the joints of q, then the springs' joints, which no actuator drives: their
columns of R are zero, and their preload holds g there.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from armdesign.arrays import Array, Flags

if TYPE_CHECKING:
    from armdesign.machine.machine import Machine
    from armdesign.mechanism.arm import RigidPoses


@dataclass(frozen=True, eq=False, kw_only=True)
class Poses:
    """Everything at n poses of a machine with nq joints and nc actuators; arrays are read-only.

    Over k = nq + ns coordinates where it has springs: the joints of q, then its ns springs.

    Actuators are the cylinders and after them the motors, see ``Machine.actuators``. For a motor
    read angle of its joint [rad] for length, torque [N m] for force, and [N m/rad] for the unit of
    its stiffness.

    Attributes:
        q: joint positions (n, nq) [rad, m].
        mass_matrix: joint-space inertia M, payload included (n, k, k) [kg m², kg].
        gravity_torque: g (n, k) [N m, N].
        gravity_stiffness: ∂g/∂q (n, k, k).
        lengths: pin-to-pin cylinder lengths ℓ (n, nc) [m].
        moment_arms: R = ∂ℓ/∂q (n, nc, k) [m/rad].
        moment_arm_derivatives: H = ∂²ℓ/∂q² (n, nc, k, k).
        extensions: share of the stroke that is out (n, nc), 0…1; 0 for a motor.
        cylinder_forces: static force of each actuator (n, nc) [N, + pushes].
        oil_stiffness: k_h of each actuator with its valve closed (n, nc) [N/m].
        spring_stiffness: κ of each spring (n, ns) [N m/rad, N/m].
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
    spring_stiffness: Array
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
        """Rᵀ diag(k_h) R (n, k, k)."""
        weighted = self.moment_arms * self.oil_stiffness[:, :, None]
        return np.asarray(np.swapaxes(self.moment_arms, 1, 2) @ weighted)

    @cached_property
    def geometric_stiffness(self) -> Array:
        """−Σ F_i H_i (n, k, k): the moment arms change under static load."""
        return -np.einsum("nc,ncij->nij", self.cylinder_forces, self.moment_arm_derivatives)

    @cached_property
    def stiffness_matrix(self) -> Array:
        """K (n, k, k): minus the derivative of the net torque by q with the oil trapped."""
        stiffness = self.hydraulic_stiffness + self.gravity_stiffness + self.geometric_stiffness
        diagonal = np.einsum("nii->ni", stiffness)
        diagonal[:, self.q.shape[1] :] += self.spring_stiffness
        return stiffness


def poses_of(machine: Machine, rigid: RigidPoses) -> Poses:
    """Everything of a machine at the poses; what is impossible is inf or NaN."""
    with np.errstate(invalid="ignore", divide="ignore"):
        actuation = [drive.actuation(rigid) for drive in machine.drives]
    moment_arms = np.stack([a.moment_arm for a in actuation], axis=1)
    lengths = np.stack([a.length for a in actuation], axis=1)
    mass, gravity, gravity_stiffness = machine.loaded(rigid)
    forces = static_forces(moment_arms, gravity, machine.bore_areas, len(machine.joints))
    extension = lengths - machine.closed_lengths
    stiffness = [
        actuator.stiffness(extension[:, i], forces[:, i], machine.fluid, machine.supply)
        for i, actuator in enumerate(machine.actuators)
    ]
    return Poses(
        q=rigid.q,
        mass_matrix=mass,
        gravity_torque=gravity,
        gravity_stiffness=gravity_stiffness,
        lengths=lengths,
        moment_arms=moment_arms,
        moment_arm_derivatives=np.stack([a.moment_arm_derivative for a in actuation], axis=1),
        extensions=extension / machine.strokes,
        cylinder_forces=forces,
        oil_stiffness=np.stack(stiffness, axis=1),
        spring_stiffness=np.tile(machine.spring_stiffness, (len(rigid), 1)),
        tool=np.array(machine.arm.point(rigid, machine.tool.link, np.array(machine.tool.at))),
    )


def static_forces(moment_arms: Array, gravity_torque: Array, areas: Array, joints: int) -> Array:
    """Cylinder forces (…, nc) [N, + pushes] that hold gravity (…, k), g = RᵀF.

    Of the k coordinates the first ``joints`` count; springs after them hold by their preload.
    Forces are inf where a pose is singular. With more cylinders than joints equilibrium leaves a
    choice: the least Σ (F/A)² is taken, that is F = W R (Rᵀ W R)⁻¹ g with W = diag(A²), bore areas
    ``areas`` (…, nc). Axes in front are broadcast. Complex-safe.
    """
    moment_arms, gravity_torque = moment_arms[..., :joints], gravity_torque[..., :joints]
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
