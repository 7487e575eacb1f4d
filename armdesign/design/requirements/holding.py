"""Holding and lifting: static forces over the workspace, and masses at given poses or places."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from armdesign.arrays import Array
from armdesign.design.requirements.candidate import Candidate, Reference
from armdesign.design.requirements.record import Evaluation, names_begin_with
from armdesign.design.requirements.stated import (
    Frozen,
    Names,
    by_joint,
    entries,
    fault_of,
    number,
    shares,
)
from armdesign.errors import ArmDesignError
from armdesign.hydraulics.oil_spring import holding_force
from armdesign.machine.file.schema import LiftSection, Shares, share_of
from armdesign.machine.lifting import liftable, liftable_masses, torque_per_mass
from armdesign.machine.machine import Machine
from armdesign.machine.out_of_reach import place_out_of_reach, pose_out_of_reach
from armdesign.machine.poses import static_forces
from armdesign.machine.reaching import poses_reaching
from armdesign.mechanism.linkage.base import Pin, moment_arms
from armdesign.mechanism.rigid_poses import RigidPoses
from armdesign.units import mm


@dataclass(frozen=True, kw_only=True)
class Holding:
    """Settings: static loads.

    Attributes:
        end_margin: share of the stroke that every cylinder keeps free at both ends, in today's
            workspace. A new stroke keeps it beyond a joint's limit too, or as much of it as
            today's does.
        holding_share: static force over what supply against return pressure gives, at most.
    """

    end_margin: float = number("end_margin")
    holding_share: float | Mapping[str, float] = shares("holding_share")


def holding(new: Candidate, reference: Reference, forces: Array) -> Iterator[Evaluation]:
    """Static forces (b, k, nc) [N, + pushes] within a share of what the supply holds.

    A port relief below the supply's pressure holds but its own.
    The share used is infinite where the supply holds nothing: pulling on a rod so thick that the
    return pressure on the bore outdoes the supply's on the annulus. The bound states it again for
    one cylinder alone: ``bound/cylinder_constraints.py``;
    ``test_branching_against_dense_sampling`` ties them.
    """
    supply = new.machine.supply
    for i, actuator in enumerate(reference.today.actuators):
        share = share_of(reference.requirements.holding_share, actuator.name)
        pushes, areas = forces[0, :, i].real > 0, new.areas[:, i, None]
        pressure = new.machine.actuators[i].available_pressure(supply)
        held = holding_force(
            areas[..., 0], areas[..., 1], pressure, supply.return_pressure, pushes
        )
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


JOINT_KEYS = {"joint_deg": True, "joint_mm": False}  # of a lift, by whether joints turn


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

    def point(self, machine: Machine) -> Pin:
        """The point that carries the mass."""
        if self.link is None and self.at is None:
            return machine.tool
        return Pin(link=self.link or machine.tool.link, at=self.at or (0.0, 0.0, 0.0))


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


@names_begin_with("lift")
def lifts(new: Candidate, reference: Reference) -> Iterator[Evaluation]:
    """Mass that each cylinder could hold; for the optimiser, by the forces at the lift's mass."""
    share = every_share(reference.today, reference.requirements.holding_share)
    for lift in reference.requirements.lifts:
        pose = lift_pose(reference.today, lift, reference.requirements.holding_share)
        mass, per_mass = masses_held(new, pose.rigid, pose.torque, share)
        constraint, per_limit = spare_force(
            reference, mass[:, 0], per_mass[:, 0], np.array(lift.mass)
        )
        yield Evaluation(
            name=f"lift.{lift.name}",
            words=f"mass that the lift {lift.name} could be",
            unit="kg",
            value=mass[:, 0],
            limit=lift.mass,
            at_least=True,
            reformulated=(constraint, per_limit),
            setting=f"lift.{lift.name}.mass_kg",
        )


def masses_held(
    new: Candidate, rigid: RigidPoses, torque: Array, share: Array | float
) -> tuple[Array, Array]:
    """Mass [kg] that each actuator of a candidate lifts at n poses, and force per mass [N/kg].

    Both (b, n, nc); ``torque`` (n, nq) is the torque of a kilogram [N m/kg].
    """
    arms = new.moment_arms(rigid)
    bare, per_mass = (
        static_forces(arms, load, new.areas[:, None, :, 0], len(new.machine.joints))
        for load in (new.bare_gravity(rigid), torque[None])
    )
    return liftable(new.machine, bare, per_mass, new.areas[:, None], share), per_mass


def spare_force(
    reference: Reference, mass: Array, per_mass: Array, limit: Array
) -> tuple[Array, Array]:
    """Force (…, nc) that actuators have left at a ``limit`` of the mass, over today's thrust.

    It is linear in the areas, and an actuator that is not loaded has enough. Beside it what it
    gains per 100 % of the limit.
    """
    loaded = np.isfinite(mass.real)
    thrust = reference.today.supply.pressure * reference.old.areas[0, :, 0]
    per_kg = np.where(loaded, per_mass * np.sign(per_mass.real) / thrust, 0.0)
    spare = np.where(loaded, mass, 0.0) - limit
    return np.where(loaded, spare * per_kg, 1.0), limit * per_kg


def every_share(machine: Machine, shares: Shares) -> Array:
    """Shares of all actuators (nc,), from one for all or by name."""
    return np.array([share_of(shares, actuator.name) for actuator in machine.actuators])


@dataclass(frozen=True, eq=False)
class LiftPose:
    """A lift at its one pose, and the joint torque of a kilogram there (1, nq) [N m/kg]."""

    lift: Lift
    rigid: RigidPoses
    torque: Array


@lru_cache(maxsize=64)
def lift_pose(machine: Machine, lift: Lift, shares: Shares) -> LiftPose:
    """The pose of a lift on today's machine: as given, or where it brings the mass to its place.

    Raises:
        ArmDesignError: too few or too many joints given, or a pose out of reach.
    """
    fixed = np.array([joint in lift.joints for joint in machine.joints])
    free, placed = np.flatnonzero(~fixed), lift.reach is not None
    if placed != (lift.height is not None):
        raise _fault(machine, lift, "has only one of reach and height", "give both or none")
    if len(free) != (2 if placed else 0):
        names = ", ".join(machine.joints[j] for j in free) or "none"
        wanted = "two are left for reach and height to decide" if placed else "none is left"
        turning = [machine.arm.joints[j].revolute for j in range(len(machine.joints))]
        keys = [key for key, turns in JOINT_KEYS.items() if turns in turning]
        fault = f"leaves these joints free: {names}"
        raise _fault(machine, lift, fault, f"state joints in {' or '.join(keys)}, {wanted}")
    q = np.array([lift.joints.get(joint, 0.0) for joint in machine.joints])
    point = lift.point(machine)
    if placed:
        joints, place = tuple(map(int, free)), np.array([lift.reach, lift.height])
        poses, _ = poses_reaching(machine, point, joints, q, place[None])
        if len(poses) == 0:
            raise _fault(machine, lift, *place_out_of_reach(machine, point, joints, q, place))
    else:
        if reason := pose_out_of_reach(machine, q):
            raise _fault(machine, lift, *reason)
        poses = q[None]
    rigid = machine.rigid_poses(poses)
    torque = torque_per_mass(machine, rigid, point)
    arms = moment_arms(machine.drives, rigid)
    masses = liftable_masses(machine, rigid, arms, torque, every_share(machine, shares))
    best = int(masses.min(axis=1).argmax())
    return LiftPose(lift, rigid[best : best + 1], torque[best : best + 1])


def _fault(machine: Machine, lift: Lift, fault: str, remedy: str) -> ArmDesignError:
    """A fault of a lift, with the line of the file that states it, if one does."""
    in_file = lift.name in machine.section.requirements.lift
    return fault_of(machine, f"lift.{lift.name}", in_file, fault, remedy)
