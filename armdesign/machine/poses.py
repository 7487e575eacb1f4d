"""Poses: inertia, gravity, oil and geometry at n joint positions, and positions that cannot be.

Axis 0 is the pose. Rigid bodies come from ``RigidPoses``, payload, cylinders and motors are added
here. With trapped oil the arm sits on

    K = Rᵀ diag(k_h) R + ∂g/∂q − Σ F_i H_i + diag(0, κ)
        (hydraulic + gravity + geometric stiffness + springs)

where R holds the moment arms ∂ℓ/∂q, H their derivatives and F the static cylinder forces (g =
RᵀF). Coordinates are the joints of q, then the springs' joints, which no actuator drives: their
columns of R are zero, and their preload holds g there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from armdesign.arrays import (
    Array,
    Flags,
    ReadOnly,
    in_columns,
    positive_definite,
    product,
    read_only,
    side_by_side,
)
from armdesign.errors import PoseError, TopplingError
from armdesign.machine.toppling import actuator_too_soft, spring_too_soft
from armdesign.mechanism.joint_ranges import DEAD_CENTRE
from armdesign.mechanism.linkage.base import Linkage
from armdesign.mechanism.spring import least_actuator_factors, least_stiffness_factors
from armdesign.short_repr import short_repr
from armdesign.units import WORKSHOP, Units, deg, mm

if TYPE_CHECKING:
    from armdesign.hydraulics.actuator import Cylinder
    from armdesign.machine.machine import Machine
    from armdesign.mechanism.rigid_poses import RigidPoses
    from armdesign.plots.canvas import Axes


@dataclass(frozen=True, eq=False, kw_only=True)
class Poses(ReadOnly):
    """Everything at n poses of a machine with nq joints and nc actuators; arrays are read-only.

    Over k = nq + ns coordinates where it has springs: the joints of q, then its ns springs.

    Actuators are the cylinders and after them the motors, see ``Machine.actuators``. For a motor
    read angle of its joint [rad] for length, torque [N m] for force, and [N m/rad] for the unit of
    its stiffness.

    Attributes:
        machine: the machine, with the load case that counts.
        q: joint positions (n, nq) [rad, m].
        mass_matrix: joint-space inertia M, payload included (n, k, k) [kg m², kg].
        gravity_torque: g (n, k) [N m, N].
        gravity_stiffness: ∂g/∂q (n, k, k).
        lengths: pin-to-pin cylinder lengths ℓ (n, nc) [m].
        moment_arms: R = ∂ℓ/∂q (n, nc, k) [m/rad].
        moment_arm_derivatives: H = ∂²ℓ/∂q² (n, nc, k, k).
        extensions: share of the stroke that is out (n, nc), 0…1; 0 for a motor.
        cylinder_forces: static force of each actuator (n, nc) [N, + pushes].
        oil_stiffness: k of each actuator with its valve closed, of oil and a compliance in series
            with it, 1/k = 1/k_h + c (n, nc) [N/m; of a motor N m/rad].
        spring_stiffness: κ of each spring (n, ns) [N m/rad, N/m].
        tool: position of the tool in the root link (n, 3) [m].
    """

    __repr__ = short_repr

    machine: Machine
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

    def __len__(self) -> int:
        return len(self.q)

    def __getitem__(self, rows: int | slice | Array) -> Poses:
        """The poses that ``rows`` selects (index, slice, mask or indices); axis 0 stays."""
        if isinstance(rows, int | np.integer):
            rows = np.arange(len(self))[rows][None]
        names = [name for name in self.__dataclass_fields__ if name != "machine"]
        chosen = {name: getattr(self, name)[rows] for name in names}
        return Poses(machine=self.machine, **chosen)

    def on(self, machine: Machine) -> Poses:
        """These poses of a machine that differs in oil, structure and springs alone."""
        return replace(
            self,
            machine=machine,
            oil_stiffness=_oil_stiffness(machine, self.lengths, self.cylinder_forces),
            spring_stiffness=np.zeros((len(self), 1)) + machine.spring_stiffness,
        )

    @cached_property
    @read_only
    def hydraulic_stiffness(self) -> Array:
        """Rᵀ diag(k_h) R (n, k, k)."""
        weighted = self.moment_arms * self.oil_stiffness[:, :, None]
        return product(np.swapaxes(self.moment_arms, 1, 2), weighted)

    @cached_property
    @read_only
    def geometric_stiffness(self) -> Array:
        """−Σ F_i H_i (n, k, k): the moment arms change under static load."""
        return -np.einsum("nc,ncij->nij", self.cylinder_forces, self.moment_arm_derivatives)

    @cached_property
    @read_only
    def stiffness_matrix(self) -> Array:
        """K (n, k, k): minus the derivative of the net torque by q with the oil trapped."""
        springs = self.spring_stiffness
        stiffness = self.hydraulic_stiffness + self.gravity_stiffness + self.geometric_stiffness
        dtype = np.result_type(stiffness, springs)  # complex along a step of theirs
        stiffness = stiffness.astype(dtype, copy=False)
        np.einsum("nii->ni", stiffness)[:, self.q.shape[1] :] += springs
        return stiffness

    def plot(self, ax: Axes | None = None) -> Axes:
        """Axes with the static force of every actuator, pose by pose."""
        from armdesign import plots

        return plots.forces_by_pose(self, ax)


def poses_of(machine: Machine, rigid: RigidPoses) -> Poses:
    """Everything of a machine at the poses; what is impossible is inf or NaN."""
    with np.errstate(invalid="ignore", divide="ignore"):
        actuation = [drive.actuation(rigid) for drive in machine.drives]
    moment_arms = in_columns([a.moment_arm for a in actuation])
    lengths = in_columns([a.length for a in actuation])
    mass, gravity, gravity_stiffness = machine.loaded(rigid)
    forces = static_forces(moment_arms, gravity, machine.bore_areas, len(machine.joints))
    return Poses(
        machine=machine,
        q=rigid.q,
        mass_matrix=mass,
        gravity_torque=gravity,
        gravity_stiffness=gravity_stiffness,
        lengths=lengths,
        moment_arms=moment_arms,
        moment_arm_derivatives=in_columns([a.moment_arm_derivative for a in actuation]),
        extensions=(lengths - machine.closed_lengths) / machine.strokes,
        cylinder_forces=forces,
        oil_stiffness=_oil_stiffness(machine, lengths, forces),
        spring_stiffness=np.zeros((len(rigid), 1)) + machine.spring_stiffness,
        tool=np.array(machine.arm.point(rigid, machine.tool.link, side_by_side(machine.tool.at))),
    )


def _oil_stiffness(machine: Machine, lengths: Array, forces: Array) -> Array:
    """Stiffness of every actuator at its lengths and static forces (n, nc)."""
    extension = lengths - machine.closed_lengths
    stiffness = [
        actuator.stiffness(extension[:, i], forces[:, i], machine.fluid, machine.supply)
        for i, actuator in enumerate(machine.actuators)
    ]
    return in_columns(stiffness)


def static_forces(moment_arms: Array, gravity_torque: Array, areas: Array, joints: int) -> Array:
    """Cylinder forces (…, nc) [N, + pushes] that hold gravity (…, k), g = RᵀF.

    Of the k coordinates the first ``joints`` count; springs after them hold by their preload.
    Forces are inf where a pose is singular. With more cylinders than joints equilibrium leaves a
    choice: the least Σ (F/A)² is taken, that is F = W R (Rᵀ W R)⁻¹ g with W = diag(A²), bore areas
    ``areas`` (…, nc). Axes in front are broadcast. Complex-safe.
    """
    moment_arms, gravity_torque = moment_arms[..., :joints], gravity_torque[..., :joints]
    own = own_joints(moment_arms)
    gravity = np.broadcast_to(gravity_torque, (*moment_arms.shape[:-2], moment_arms.shape[-1]))
    if own is not None:
        return own_forces(moment_arms[..., np.arange(len(own)), own], gravity[..., own])
    dtype = np.result_type(moment_arms, gravity, areas, float)
    forces = np.full(moment_arms.shape[:-1], np.inf, dtype=dtype)
    singular = is_singular(np.real(moment_arms))
    arms, loads = moment_arms[~singular], gravity[~singular, :, None]
    turned = np.swapaxes(arms, 1, 2)
    if arms.shape[1] == arms.shape[2]:
        forces[~singular] = np.linalg.solve(turned, loads)[..., 0]
    else:
        squares = np.broadcast_to((areas / np.real(areas).max()) ** 2, forces.shape)
        squares = squares[~singular][..., None]
        least = squares * (arms @ np.linalg.solve(turned @ (squares * arms), loads))
        forces[~singular] = least[..., 0]
    return forces


def own_forces(moment_arms: Array, gravity: Array) -> Array:
    """``static_forces`` where each cylinder has its own joint: arms and gravity there (…, nc)."""
    singular = _next_to_dead_centre(moment_arms)
    if not singular.any():
        return np.asarray(gravity / moment_arms)
    held = gravity / np.where(moment_arms == 0, 1.0, moment_arms)
    return np.asarray(np.where(singular[..., None], np.inf, held))


def _next_to_dead_centre(moment_arms: Array) -> Flags:
    """``is_singular`` (…,) of cylinders on joints of their own: their arms are singular values."""
    size = np.abs(np.real(moment_arms))
    if size.min(initial=np.inf) >= DEAD_CENTRE and size.max(initial=0.0) < np.inf:
        return np.zeros(size.shape[:-1], dtype=bool)
    return np.asarray(~((size >= DEAD_CENTRE) & (size < np.inf)).all(axis=-1))


def is_singular(moment_arms: Array) -> Flags:
    """Whether a motion is free (…,): R (…, nc, nq) without full column rank, or not finite.

    The smallest singular value is compared with 1 µm per radian: a cylinder within this of its
    dead centre.
    """
    nc, nq = moment_arms.shape[-2:]
    if nc < nq:
        return np.ones(moment_arms.shape[:-2], dtype=bool)
    if (own := own_joints(moment_arms)) is not None:
        return _next_to_dead_centre(moment_arms[..., np.arange(len(own)), own])
    finite = np.all(np.isfinite(moment_arms), axis=(-2, -1))
    known = np.where(finite[..., None, None], moment_arms, 0.0)
    smallest = np.linalg.svd(known, compute_uv=False)[..., -1]
    return np.asarray(~finite | ~(smallest >= DEAD_CENTRE))


def own_joints(moment_arms: Array) -> Array | None:
    """The joint that each cylinder moves (nc,); None unless each moves one of its own."""
    used = np.any(moment_arms != 0, axis=tuple(range(moment_arms.ndim - 2)))
    square = used.shape[0] == used.shape[1]
    alone = square and all(np.all(used.sum(axis=axis) == 1) for axis in (0, 1))
    return np.asarray(used.argmax(axis=1)) if alone else None


DEAD_CENTRE_STEPS = np.geomspace(0.001, 0.25, 9)  # of a joint's range, beside a dead centre
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
    except (TypeError, ValueError, OverflowError):
        raise PoseError(part, "is not an array of numbers", f"give shape (n, {nq})") from None
    array = array[None] if array.ndim == 1 else array
    if array.ndim != 2 or array.shape[1] != nq:
        remedy = f"give (n, {nq}): {', '.join(machine.joints)}"
        raise PoseError(part, f"has shape {array.shape}", remedy)
    if not np.all(np.isfinite(array)):
        raise PoseError(part, "holds a number that is not finite", "give finite joint positions")
    return array


def reachable_poses(machine: Machine, rigid: RigidPoses) -> Poses:
    """Everything of a machine at poses that it can take.

    Raises:
        PoseError: out of stroke, a four-bar that does not close, singular, or on springs that are
            too soft.
    """
    poses = poses_of(machine, rigid)
    if not np.isfinite(poses.lengths).all():
        refuse_open(machine, rigid)
    _refuse_unreachable(machine, poses)
    refuse_toppling(machine, poses)
    return poses


def refuse_open(machine: Machine, rigid: RigidPoses) -> None:
    """Raise for the first pose at which a linkage does not close.

    Raises:
        PoseError: a four-bar does not.
    """
    for linkage, cylinder in zip(machine.linkages, machine.cylinders, strict=False):
        if np.any(open_ := ~linkage.closes(rigid)):
            where = pose_text(machine, first := rigid.q[open_][0])
            remedy = f"stay in the range of {_range_text(machine, linkage, cylinder, first)}"
            part = f"{machine.name}: {cylinder.name} cylinder"
            raise PoseError(part, f"its {linkage.title} does not close at {where}", remedy)


def _refuse_unreachable(machine: Machine, poses: Poses) -> None:
    """Raise for the first pose out of stroke, or singular."""
    pairs = zip(machine.linkages, machine.cylinders, poses.lengths.T, strict=False)
    for linkage, cylinder, length in pairs:
        least, most = cylinder.closed_length, cylinder.open_length
        part = f"{machine.name}: {cylinder.name} cylinder"
        out = (length < least - STROKE_TOLERANCE) | (length > most + STROKE_TOLERANCE)
        if np.any(out):
            first = poses.q[out][0]
            where = f"[{least:.4f}, {most:.4f}] m at {pose_text(machine, first)}"
            remedy = f"stay in the range of {_range_text(machine, linkage, cylinder, first)}"
            fault = f"length {length[out][0]:.4f} m is outside its stroke {where}"
            raise PoseError(part, fault, f"{remedy} or change stroke and pins")
    arms = poses.moment_arms[..., : len(machine.joints)]
    if np.any(singular := is_singular(arms)):
        raise _singular(machine, poses.q[singular][0], arms[singular][0])


def _singular(machine: Machine, q: Array, arms: Array) -> PoseError:
    """A pose (nq,) with a free motion, by its moment arms (nc, nq), and the nearest without."""
    j = int(np.abs(np.linalg.svd(arms)[2][-1]).argmax())
    joint, steps = machine.arm.joints[j], DEAD_CENTRE_STEPS * np.ptp(machine.ranges[j])
    near = np.tile(q, (2 * len(steps), 1))
    near[:, j] += np.stack([steps, -steps], axis=1).ravel()
    around = machine.evaluate(machine.rigid_poses(near))
    held = ~is_singular(around.moment_arms[..., : len(q)])
    held &= (machine.margins(near) >= 0).all(axis=1)
    remedy = "choose another pose"
    if held.any():
        nearest = pose_text(machine, near[held.argmax()], decimals=2)
        remedy = f"the nearest pose that is not: {nearest}"
    fault = (
        f"singular at {pose_text(machine, q)}: a cylinder of {joint.name} is at its dead centre"
    )
    return PoseError(f"{machine.name}: pose", fault, remedy)


def refuse_toppling(machine: Machine, poses: Poses) -> None:
    """Raise for the pose that asks most of a spring, where springs are too soft for gravity.

    Named is what lacks least there: a spring, or an actuator beside which springs would be enough.
    Poses at which joints on their oil are unstable, whatever the springs, are left to their
    frequency of zero.

    Raises:
        PoseError: K is not positive definite, and would be on stiffer springs.
    """
    if not machine.springs:
        return
    if positive_definite(poses.stiffness_matrix):
        return
    factors = least_stiffness_factors(poses.stiffness_matrix, machine.spring_stiffness)
    least = factors.min(axis=1)
    worst = int(np.where(np.isinf(least), 0.0, least).argmax())
    if 1 <= least[worst] < np.inf:
        raise _toppling(machine, poses, worst, factors[worst])


def _toppling(machine: Machine, poses: Poses, row: int, factors: Array) -> TopplingError:
    """A pose that topples: the spring that is too soft, or an actuator that lacks less."""
    where = f"{pose_text(machine, poses.q[row])}, payload {machine.payload.name}"
    stiffness = poses.oil_stiffness[row]
    of_actuators = least_actuator_factors(
        poses.stiffness_matrix[row], stiffness, poses.moment_arms[row]
    )
    if of_actuators.min() < factors.min():
        error = actuator_too_soft(machine, where, stiffness, of_actuators)
    else:
        error = spring_too_soft(machine, where, factors)
    error.factor = float(factors.min())
    return error


def refuse_unheld(machine: Machine, q: ArrayLike) -> None:
    """Raise for the first pose at which the load case at work does not exist.

    Raises:
        PoseError: they are no joint positions, or a link is tipped out of the load case's pitch.
    """
    positions, case = joint_positions(machine, q), machine.payload
    unheld = ~machine.holds(positions)
    if not unheld.any():
        return
    first = machine.arm.kinematics(positions[unheld][:1])
    low, high = case.limits
    nearest = (low + high) / 2 + case.from_middle(machine.heading, first)[0]
    fault = (
        f"the {case.link} has a pitch of {nearest / deg:.1f}°"
        f" at {pose_text(machine, positions[unheld][0])}, it holds the load at"
        f" {low / deg:g}…{high / deg:g}°"
    )
    part = f"{machine.name}: payload {case.name}"
    raise PoseError(part, fault, "choose another pose or load case")


def pose_text(
    machine: Machine, q: Array, units: Units = WORKSHOP, decimals: int | None = None
) -> str:
    """Joint positions (nq,) in words: the one place that writes a pose, in errors as in tables.

    ``decimals`` where somebody is to take the pose; None: as usual in these units.
    """
    return ", ".join(
        f"{joint.name} {units.text(value, joint.unit, decimals)}"
        for joint, value in zip(machine.arm.joints, q, strict=True)
    )


def _range_text(machine: Machine, linkage: Linkage, cylinder: Cylinder, q: Array) -> str:
    """Ranges in which a pose (nq,) must be that a cylinder cannot take.

    Where it lies in all of them, as only the pose as a whole is at fault, the range of one joint
    while the others stand: of the last that has one.
    """
    joints, ranges = machine.arm.joints, machine.ranges
    if all(ranges[j, 0] <= q[j] <= ranges[j, 1] for j in linkage.joints):
        for j in reversed(linkage.joints):
            if len(within := _in_stroke(machine, linkage, cylinder, q, j)):
                others = [k for k in linkage.joints if k != j]
                stand = ", ".join(
                    f"{joints[k].name} {WORKSHOP.text(q[k], joints[k].unit)}" for k in others
                )
                ends = WORKSHOP.span(within[0], within[-1], joints[j].unit)
                return f'joint "{joints[j].name}" {ends} at {stand}'
    spans = ((joints[j], *ranges[j]) for j in linkage.joints)
    return " and ".join(
        f'joint "{joint.name}" {WORKSHOP.span(low, high, joint.unit)}'
        for joint, low, high in spans
    )


def _in_stroke(machine: Machine, linkage: Linkage, cylinder: Cylinder, q: Array, j: int) -> Array:
    """Positions of a joint next to a pose (nq,) that a cylinder can take, in a joint's decimals.

    Of several runs of them the one nearest to the pose; empty where there is none.
    """
    step = (deg if machine.arm.joints[j].revolute else mm) / 10
    low, high = machine.ranges[j] / step
    along = np.tile(q, (math.floor(high) - math.ceil(low) + 1, 1))
    along[:, j] = np.arange(math.ceil(low), math.floor(high) + 1) * step
    with np.errstate(invalid="ignore"):
        length = linkage.length(machine.arm.kinematics(along))
        inside = (length >= cylinder.closed_length) & (length <= cylinder.open_length)
    rows = np.flatnonzero(inside)
    runs = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
    nearest = min(runs, key=lambda run: np.abs(along[run, j] - q[j]).min(initial=np.inf))
    return np.asarray(along[nearest, j])
