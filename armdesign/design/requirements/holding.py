"""Holding and lifting: static forces over the workspace, and masses at given poses or places."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from armdesign.arrays import Array
from armdesign.design.requirements.candidate import Candidate, Reference, unloaded
from armdesign.design.requirements.record import Evaluation
from armdesign.design.requirements.stated import Frozen, Names, by_joint, entries, number, shares
from armdesign.errors import ArmDesignError
from armdesign.hydraulics.actuator import areas_of
from armdesign.hydraulics.oil_spring import holding_force
from armdesign.machine.file.schema import LiftSection, Shares, share_of
from armdesign.machine.machine import Machine
from armdesign.machine.poses import static_forces
from armdesign.mechanism.arm import RigidPoses
from armdesign.mechanism.joint_ranges import over
from armdesign.units import GRAVITY, mm


@dataclass(frozen=True, kw_only=True)
class Holding:
    """Settings: static loads.

    Attributes:
        end_margin: share of the stroke that every cylinder keeps free at both ends, in today's
            workspace.
        holding_share: static force over what supply against return pressure gives, at most.
    """

    end_margin: float = number("end_margin")
    holding_share: float | Mapping[str, float] = shares("holding_share")


def holding(new: Candidate, reference: Reference, forces: Array) -> Iterator[Evaluation]:
    """Static forces (b, k, nc) [N, + pushes] within a share of what the supply holds.

    The share used is infinite where the supply holds nothing: pulling on a rod so thick that the
    return pressure on the bore outdoes the supply's on the annulus. The bound states it again for
    one cylinder alone: ``bound/cylinder_constraints.py``;
    ``test_branching_against_dense_sampling`` ties them.
    """
    supply = new.machine.supply
    for i, actuator in enumerate(reference.today.actuators):
        share = share_of(reference.requirements.holding_share, actuator.name)
        pushes = forces[0, :, i].real > 0
        held = holding_force(new.areas[:, i, None, 0], new.areas[:, i, None, 1], supply, pushes)
        used = forces[:, :, i] * np.where(pushes, 1.0, -1.0)
        holds, loaded = held.real > 0, used.real > 0
        ratio = np.where(holds, used / np.where(holds, held, 1.0), np.where(loaded, np.inf, 0.0))
        scale = supply.pressure * float(reference.old.areas[0, i, 0])
        yield Evaluation(
            name=f"holding.{actuator.name}",
            words=f"static load of the {actuator.name} {actuator.kind} over what the supply gives",
            unit="",
            value=ratio,
            limit=share,
            reformulated=((share * held - used) / scale, share * held / scale),
            setting=f"holding_share.{actuator.name}",
        )


LATTICE = 41  # values of each free joint from which a place is sought
TOLERANCE = 1e-9  # [m] by which the place may be missed, [rad, m] by which a range may be left


@dataclass(frozen=True, kw_only=True)
class Lift(Frozen):
    """A mass that every cylinder must hold at one pose, within ``holding_share`` of the supply.

    Attributes:
        name: of the lift.
        mass: [kg], in place of any load case; hook and sling included.
        link: that carries it; None: the tool's.
        at: its place in the link [m]; None: the tool.
        joints: where the joints stand [rad, m]. All of them; or all but two, which then bring the
            mass to ``reach`` and ``height``, of several ways in that in which today's machine
            lifts most.
        reach: of the mass from the root's vertical axis [m].
        height: of the mass over the root [m].
    """

    name: str
    mass: float
    link: str | None = None
    at: tuple[float, float, float] | None = None
    joints: Mapping[str, float] = field(default_factory=dict)
    reach: float | None = None
    height: float | None = None


def _read(machine: Machine, name: str, section: LiftSection) -> Lift:
    x, y, z = (value * mm for value in section.at_mm or (0.0, 0.0, 0.0))
    return Lift(
        name=name,
        mass=section.mass_kg,
        link=section.link,
        at=None if section.at_mm is None else (x, y, z),
        joints=by_joint(machine, f"lift.{name}", section.joint_deg, section.joint_mm),
        reach=None if section.reach_mm is None else section.reach_mm * mm,
        height=None if section.height_mm is None else section.height_mm * mm,
    )


def _names(lift: Lift, machine: Machine) -> Names:
    yield f"lift.{lift.name}", "joint", lift.joints, machine.joints
    yield f"lift.{lift.name}", "link", [lift.link] if lift.link else [], machine.arm.links


@dataclass(frozen=True, kw_only=True)
class Lifts:
    """Settings: lifts.

    Attributes:
        lifts: masses to hold at given poses or places.
    """

    lifts: tuple[Lift, ...] = entries("lift", _read, ("mass_kg", "mass", 1.0), _names)


def lifts(new: Candidate, reference: Reference) -> Iterator[Evaluation]:
    """Mass that each cylinder could hold; for the optimiser, by the forces at the lift's mass."""
    share = holding_shares(reference.today, reference.requirements.holding_share)
    supply = new.machine.supply
    for lift in reference.requirements.lifts:
        pose = lift_pose(reference.today, lift, reference.requirements.holding_share)
        arms = new.moment_arms(pose.rigid)
        bare, per_mass = (
            static_forces(arms, load, new.areas[:, None, :, 0], len(new.machine.joints))[:, 0]
            for load in (new.bare_gravity(pose.rigid), pose.torque[None])
        )
        mass = liftable(new.machine, bare, per_mass, new.areas, share)
        loaded = np.isfinite(mass[0].real)
        thrust = supply.pressure * reference.old.areas[0, :, 0]
        per_kg = np.where(loaded, per_mass * np.sign(per_mass[0].real) / thrust, 0.0)
        spare = np.where(loaded, mass, 0.0) - lift.mass
        yield Evaluation(
            name=f"lift.{lift.name}",
            words=f"mass that the lift {lift.name} could be",
            unit="kg",
            value=mass,
            limit=lift.mass,
            at_least=True,
            reformulated=(np.where(loaded, spare * per_kg, 1.0), lift.mass * per_kg),
            setting=f"lift.{lift.name}.mass_kg",
        )


def holding_shares(machine: Machine, shares: Shares) -> Array:
    """Share of what the supply gives that each actuator may use (nc,)."""
    return np.array([share_of(shares, actuator.name) for actuator in machine.actuators])


@dataclass(frozen=True, eq=False)
class LiftPose:
    """A lift at its one pose, and the joint torque of a kilogram there (1, nq) [N m/kg]."""

    lift: Lift
    rigid: RigidPoses
    torque: Array


def liftable(
    machine: Machine, forces: Array, per_mass: Array, areas: Array, share: Array
) -> Array:
    """Mass [kg] at which each cylinder (…, nc) uses up a share of what the supply gives.

    Infinite for a cylinder that the mass does not load.

    Args:
        machine: supply.
        forces: without the mass [N], pushing positive.
        per_mass: what a kilogram adds [N/kg].
        areas: bore and annulus (…, nc, 2) [m²].
        share: of the supply's force (nc,).
    """
    pushes = per_mass.real > 0
    held = holding_force(areas[..., 0], areas[..., 1], machine.supply, pushes)
    loads = np.abs(per_mass.real) > 1e-12
    used = np.where(pushes, 1.0, -1.0)
    return np.where(
        loads, (share * held - used * forces) / np.where(loads, used * per_mass, 1.0), np.inf
    )


@lru_cache(maxsize=64)
def lift_pose(machine: Machine, lift: Lift, shares: Shares) -> LiftPose:
    """The pose of a lift on today's machine: as given, or where it brings the mass to its place.

    Raises:
        ArmDesignError: too few or too many joints given, or a pose out of reach.
    """
    part = f"requirements.lift.{lift.name}"
    fixed = np.array([joint in lift.joints for joint in machine.joints])
    free, placed = np.flatnonzero(~fixed), lift.reach is not None
    if placed != (lift.height is not None):
        raise ArmDesignError(part, "has only one of reach and height", "give both or none")
    if len(free) != (2 if placed else 0):
        names = ", ".join(machine.joints[j] for j in free) or "none"
        wanted = "two are left for reach and height to decide" if placed else "all stand somewhere"
        raise ArmDesignError(
            part, f"leaves these joints free: {names}", f"give joints so that {wanted}"
        )
    q = np.array([[lift.joints.get(joint, 0.0) for joint in machine.joints]])
    poses = _reaching(machine, lift, q, free) if placed else q
    low, high = machine.ranges.T
    inside = np.all((poses >= low - TOLERANCE) & (poses <= high + TOLERANCE), axis=1)
    poses = (
        poses[inside & (machine.margins(poses).min(axis=1) >= -TOLERANCE)] if len(poses) else poses
    )
    if len(poses) == 0:
        raise ArmDesignError(
            part, "no pose in the joint ranges does that", "ask for another pose or place"
        )
    rigid = machine.rigid_poses(poses)
    torque = _torque(machine, lift, rigid)
    best = int(_capacity(machine, rigid, torque, holding_shares(machine, shares)).argmax())
    return LiftPose(lift, rigid[best : best + 1], torque[best : best + 1])


def _point(machine: Machine, lift: Lift) -> tuple[str, Array]:
    at = machine.tool.at if lift.at is None and lift.link is None else lift.at or (0.0, 0.0, 0.0)
    return lift.link or machine.tool.link, np.array(at)


def _torque(machine: Machine, lift: Lift, rigid: RigidPoses) -> Array:
    """Joint torque of a kilogram at the lift's point (n, nq) [N m/kg]."""
    motion = machine.arm.motion(
        rigid, *_point(machine, lift), machine.arm.root, tuple(range(len(machine.joints)))
    )
    return GRAVITY * motion.first[:, :, 2]


def _capacity(machine: Machine, rigid: RigidPoses, torque: Array, share: Array) -> Array:
    """Mass (n,) [kg] that the weakest cylinder of a machine lifts."""
    areas = areas_of(machine.actuators)
    arms = np.stack([drive.actuation(rigid).moment_arm for drive in machine.drives], axis=1)
    bare, per_mass = (
        static_forces(arms, load, areas[:, 0], len(machine.joints))
        for load in (unloaded(machine, rigid), torque)
    )
    return np.asarray(liftable(machine, bare, per_mass, areas, share).min(axis=1))


def _reaching(machine: Machine, lift: Lift, q: Array, free: Array) -> Array:
    """Poses that bring the mass to its place (n, nq), by Newton's method from a lattice."""
    first, second = (over(machine.ranges[j], LATTICE) for j in free)
    poses = np.repeat(q, LATTICE**2, axis=0)
    poses[:, free] = np.stack(np.meshgrid(first, second, indexing="ij"), axis=-1).reshape(-1, 2)
    joints, span = tuple(int(j) for j in free), np.ptp(machine.ranges[free], axis=1)
    wanted = np.array([lift.reach or 0.0, lift.height or 0.0])
    for _ in range(30):
        point = machine.arm.motion(
            machine.arm.kinematics(poses), *_point(machine, lift), machine.arm.root, joints
        )
        place, slope = machine.arm.reach_and_height(poses, point)
        missed = place - wanted
        step = (np.linalg.pinv(slope * span, rcond=1e-6) @ missed[..., None])[..., 0]
        poses[:, free] -= span * np.clip(step, -0.2, 0.2)
    met = poses[np.abs(missed).max(axis=1) < TOLERANCE]
    _, first_of_each = np.unique(np.rint(met * 1e6), axis=0, return_index=True)
    return np.asarray(met[first_of_each])
