"""Geometry of the simulation agrees with ``Poses``, independent formulas, on every machine."""

from __future__ import annotations

import numpy as np

from armdesign import Machine
from armdesign.arrays import Array
from armdesign.simulation.plant.compiled import borrowing
from armdesign.simulation.plant.equilibrium import find_equilibrium
from armdesign.simulation.plant.kinematics import (
    drives_of,
    joints_of,
    new_frames,
    new_pin_motion,
    place_drive,
    place_joints,
)
from armdesign.simulation.plant.plant import Plant
from tests import machines

# compiled functions, called from Python here alone
_place_joints = borrowing(place_joints)
_place_drive = borrowing(place_drive)


def placed(machine: Machine, q: Array) -> tuple[Array, Array, Array, Array]:
    """Rotations, origins, lengths and moment arms at one pose."""
    nq, joints = len(q), joints_of(machine.arm)
    frames = new_frames(nq)
    _place_joints(joints, q, frames)
    lengths, arms = [], []
    for drive in drives_of(machine)[: len(machine.cylinders)]:
        pins = new_pin_motion(nq)
        length, _ = _place_drive(drive, joints, frames, np.zeros(nq), pins)
        lengths.append(length)
        arms.append(pins.arm)
    return frames.rotation, frames.origin, np.array(lengths), np.array(arms)


def test_length_moment_arm_and_frames(machine: Machine) -> None:
    q = machines.inner_poses(machine, 5)
    poses, count = machine.at(q), len(machine.cylinders)
    rotation, translation, _ = machine.arm.placements(q)
    for row, at in enumerate(q):
        turned, origin, lengths, arms = placed(machine, at)
        np.testing.assert_allclose(turned, rotation[row], atol=1e-12)
        np.testing.assert_allclose(origin, translation[row], atol=1e-12)
        np.testing.assert_allclose(lengths, poses.lengths[row, :count], rtol=1e-12)
        np.testing.assert_allclose(arms, poses.moment_arms[row, :count], atol=1e-11)


def test_cases_of_different_machines_side_by_side() -> None:
    """Payloads and pins of each case are its own."""
    one = machines.rigid("excavator_20t").with_payload("full")
    other = one.with_payload("empty").replace({"cylinder.bucket.four_bar.rocker_mm": 590.0})
    q = machines.inner_poses(one, 2)
    alone = [Plant(machine) for machine in (one, other)]
    states = np.array(
        [find_equilibrium(plant, at).state for plant, at in zip(alone, q, strict=True)]
    )
    states[:, 6:9] += 2.0
    shut = np.zeros((2, 3))
    stack = Plant(one, other).derivative(states, shut)
    for row, plant in enumerate(alone):
        np.testing.assert_array_equal(
            stack[row], plant.derivative(states[row : row + 1], shut[:1])[0]
        )
