"""M, h and accelerations of the simulation: beside Pinocchio and ``Poses``, on every machine."""

from __future__ import annotations

import numpy as np
import pinocchio
import pytest

from armdesign import Machine
from armdesign.arrays import Array
from armdesign.machine.carried_masses import bar_points
from armdesign.mechanism.arm import Arm, LoadedArm
from armdesign.simulation.plant.compiled import borrowing
from armdesign.simulation.plant.inertia import (
    Inertia,
    add_bars,
    add_bodies,
    bodies_of,
    new_inertia,
    solve,
)
from armdesign.simulation.plant.kinematics import (
    drives_of,
    joints_of,
    new_frames,
    new_pin_motion,
    place_drive,
    place_joints,
)
from armdesign.simulation.plant.rigid_bodies import RigidBodies
from armdesign.units import GRAVITY
from tests import machines
from tests.held import held

# compiled functions, called from Python here alone
_place_joints = borrowing(place_joints)
_add_bodies = borrowing(add_bodies)
_place_drive = borrowing(place_drive)
_add_bars = borrowing(add_bars)
_solve = borrowing(solve)


def terms(loaded: LoadedArm, q: Array, speed: Array, machine: Machine | None = None) -> Inertia:
    """M and h of links and payload, and of a machine's bars, at one pose."""
    joints, frames, inertia = joints_of(loaded.arm), new_frames(len(q)), new_inertia(len(q))
    inertia.mass[:], inertia.force[:], inertia.torque[:] = 0.0, 0.0, 0.0
    _place_joints(joints, q, frames)
    _add_bodies(bodies_of(loaded), joints, frames, speed, inertia)
    for drive in drives_of(machine)[: len(machine.cylinders)] if machine else ():
        pins = new_pin_motion(len(q))
        length, span = _place_drive(drive, joints, frames, speed, pins)
        _add_bars(drive, length, span, speed, pins, inertia)
    return inertia


def whole(mass: Array) -> Array:
    """M, of which the lower triangle is filled."""
    return np.tril(mass) + np.tril(mass, -1).T


def close(actual: Array, expected: Array, share: float = 1e-10) -> None:
    np.testing.assert_allclose(actual, expected, rtol=share, atol=share * np.abs(expected).max())


def test_inertia_and_forces_in_motion(machine: Machine) -> None:
    """M of ``Poses``, by composite bodies, and h by Newton and Euler's recursion, each with the
    bars as point masses.
    """
    q = machines.inner_poses(machine, 4)
    speed = np.linspace(-0.7, 0.9, q.shape[1])
    expected = RigidBodies(machine.loaded_arm).resistance(q, np.tile(speed, (4, 1)))
    for row, at in enumerate(q):
        inertia = terms(machine.loaded_arm, at, speed, machine)
        close(whole(inertia.mass), machine.at(q).mass_matrix[row])
        close(inertia.force, expected[row])


def test_bars_in_motion(machine: Machine) -> None:
    """M = Σ m JᵀJ and h = Σ m Jᵀ(q̇ᵀ ∂²P/∂q² q̇ + g e_z) of the point masses of ``Poses``, by
    second-order jets.
    """
    q = machines.inner_poses(machine, 4)
    speed = np.linspace(-0.7, 0.9, q.shape[1])
    points = bar_points(machine, machine.arm.kinematics(q))
    mass, force = np.zeros((*q.shape, q.shape[1])), np.zeros(q.shape)
    for m, p in points:
        mass += m * p.first @ np.swapaxes(p.first, 1, 2)
        pull = np.einsum("njki,j,k->ni", p.second, speed, speed) + np.array([0.0, 0.0, GRAVITY])
        force += m * np.einsum("nji,ni->nj", p.first, pull)
    for row, at in enumerate(q):
        apart, both = (terms(machine.loaded_arm, at, speed, bars) for bars in (None, machine))
        close(whole(both.mass - apart.mass), mass[row], 1e-8)
        close(both.force - apart.force, force[row], 1e-8)


def test_accelerations_are_those_of_articulated_bodies(machine: Machine) -> None:
    """Links and payload by Pinocchio's articulated-body algorithm."""
    model, order = machine.loaded_arm.model(), machine.arm.model_order
    data, q = model.createData(), machines.inner_poses(machine, 4)
    speed, torque = np.linspace(-0.7, 0.9, q.shape[1]), np.linspace(-1e3, 1e3, q.shape[1])
    for at in q:
        ordered = np.zeros((3, len(order)))
        ordered[:, order] = at, speed, torque
        inertia, acceleration = terms(machine.loaded_arm, at, speed), np.empty(len(at))
        inertia.torque[:] = torque
        _solve(inertia, acceleration)
        close(acceleration, pinocchio.aba(model, data, *ordered)[order], 1e-9)


SKEW = """<robot name="skew"><link name="ground"/>
<link name="post"><inertial><mass value="300"/><origin xyz="0.1 -0.2 0.4" rpy="0.3 -0.2 0.5"/>
<inertia ixx="40" iyy="60" izz="30" ixy="5" ixz="-8" iyz="3"/></inertial></link>
<link name="jib"><inertial><mass value="120"/><origin xyz="0.9 0.1 -0.05" rpy="-0.4 0.1 0.2"/>
<inertia ixx="3" iyy="28" izz="30" ixy="1" ixz="2" iyz="-1"/></inertial></link>
<link name="tip"><inertial><mass value="50"/><origin xyz="0.5 0.05 0.1"/>
<inertia ixx="1" iyy="6" izz="6" ixy="0.3" ixz="0.2" iyz="-0.1"/></inertial></link>
<joint name="slew" type="revolute"><parent link="ground"/><child link="post"/>
<origin xyz="0 0 1" rpy="0.1 0.2 0.3"/><axis xyz="0.1 0.2 0.97"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="lift" type="revolute"><parent link="post"/><child link="jib"/>
<origin xyz="0.2 0.1 0.6" rpy="-0.2 0.4 0.1"/><axis xyz="0.1 -1 0.2"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="reach" type="prismatic"><parent link="jib"/><child link="tip"/>
<origin xyz="1.5 0.1 0.2" rpy="0.5 -0.3 0.2"/><axis xyz="0.9 0.1 0.2"/>
<limit lower="0" upper="1" effort="1" velocity="1"/></joint></robot>"""


def test_bodies_that_are_in_no_plane() -> None:
    """Axes and principal directions askew, a joint that slides, a load: M, h and accelerations
    beside Pinocchio's.
    """
    arm = Arm(SKEW, ["slew", "lift", "reach"], {}, "skew.urdf")
    loaded = LoadedArm(arm, [(80.0, "tip", np.array([0.4, -0.2, 0.3]))], None)
    model, q = loaded.model(), np.array([0.4, -0.3, 0.6])
    data, speed, torque = model.createData(), np.array([0.8, -1.1, 0.5]), np.array([1e3, 2e3, 3e2])
    inertia, acceleration = terms(loaded, q, speed), np.empty(3)
    upper = np.triu(pinocchio.crba(model, data, q))
    close(whole(inertia.mass), upper + np.triu(upper, 1).T, 1e-13)
    close(inertia.force, pinocchio.nonLinearEffects(model, data, q, speed), 1e-12)
    inertia.torque[:] = torque
    _solve(inertia, acceleration)
    close(acceleration, pinocchio.aba(model, data, q, speed, torque), 1e-12)


@pytest.mark.parametrize("name", ["four_bar_from_boom", "spatial", "rocking"])
def test_idle_bars_in_motion(name: str) -> None:
    """M and h of a machine with frozen joints are those of the joints held, compiled and not."""
    case = held(name)
    speed = np.linspace(-0.7, 0.9, len(case.rest))
    wide, k = np.zeros(len(case.awake.arm.coordinates)), len(case.q)
    wide[case.rest] = speed
    rows = [m.arm.with_springs(q) for m, q in ((case.frozen, case.q), (case.awake, case.whole))]
    expected = RigidBodies(case.awake.loaded_arm).resistance(rows[1], np.tile(wide, (k, 1)))
    alike = RigidBodies(case.frozen.loaded_arm).resistance(rows[0], np.tile(speed, (k, 1)))
    close(alike, expected[:, case.rest])
    for q, held_q, force in zip(*rows, expected, strict=True):
        frozen = terms(case.frozen.loaded_arm, q, speed, case.frozen)
        awake = terms(case.awake.loaded_arm, held_q, wide, case.awake)
        close(whole(frozen.mass), whole(awake.mass)[np.ix_(case.rest, case.rest)])
        close(frozen.force, force[case.rest])
