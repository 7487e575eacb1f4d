"""Geometry, bars and rigid bodies of the simulation agree with ``Poses``, independent formulas,
on every machine.
"""

from __future__ import annotations

import numpy as np

from armdesign import Machine
from armdesign.arrays import Array
from armdesign.simulation.plant.equilibrium import find_equilibrium
from armdesign.simulation.plant.forward_dynamics import ForwardDynamics
from armdesign.simulation.plant.kinematics import (
    BarLoads,
    add_bars,
    drives_of,
    joints_of,
    new_frames,
    new_pin_motion,
    place_drive,
    place_joints,
)
from armdesign.simulation.plant.plant import Plant
from armdesign.units import GRAVITY
from tests import machines


def placed(
    machine: Machine, q: Array, speed: Array
) -> tuple[Array, Array, Array, Array, Array, Array]:
    """Rotations, origins, lengths, moment arms, and M and h of the bars at one pose."""
    nq, joints = len(q), joints_of(machine.arm)
    frames = new_frames(nq)
    place_joints(joints, q, frames)
    mass, force, lengths, arms = np.zeros((nq, nq)), np.zeros(nq), [], []
    for drive in drives_of(machine)[: len(machine.cylinders)]:
        pins = new_pin_motion(nq)
        length, span = place_drive(drive, joints, frames, speed, pins)
        add_bars(drive, length, span, speed, pins, mass, force)
        lengths.append(length)
        arms.append(pins.arm)
    return frames.rotation, frames.origin, np.array(lengths), np.array(arms), mass, force


def test_length_moment_arm_and_frames(machine: Machine) -> None:
    q = machines.inner_poses(machine, 5)
    poses, count = machine.at(q), len(machine.cylinders)
    rotation, translation, _ = machine.arm.placements(q)
    for row, at in enumerate(q):
        turned, origin, lengths, arms, _, _ = placed(machine, at, 0 * at)
        np.testing.assert_allclose(turned, rotation[row], atol=1e-12)
        np.testing.assert_allclose(origin, translation[row], atol=1e-12)
        np.testing.assert_allclose(lengths, poses.lengths[row, :count], rtol=1e-12)
        np.testing.assert_allclose(arms, poses.moment_arms[row, :count], atol=1e-11)


def test_bars_in_motion(machine: Machine) -> None:
    """M = Σ m JᵀJ and h = Σ m Jᵀ(q̇ᵀ ∂²P/∂q² q̇ + g e_z) of the point masses of ``Poses``, by
    second-order jets.
    """
    q = machines.inner_poses(machine, 4)
    speed = np.linspace(-0.7, 0.9, q.shape[1])
    points = machine.bar_points(machine.arm.kinematics(q))
    nothing = np.zeros((len(q), q.shape[1], q.shape[1]))
    mass = sum((m * p.first @ np.swapaxes(p.first, 1, 2) for m, p in points), nothing)
    pull = [
        np.einsum("njki,j,k->ni", p.second, speed, speed) + np.array([0.0, 0.0, GRAVITY])
        for _, p in points
    ]
    felt = [
        m * np.einsum("nji,ni->nj", p.first, a) for (m, p), a in zip(points, pull, strict=True)
    ]
    force = sum(felt, nothing[:, 0])
    for row, at in enumerate(q):
        *_, added, pulled = placed(machine, at, speed)
        np.testing.assert_allclose(
            added, mass[row], rtol=1e-10, atol=1e-10 * np.abs(mass[row]).max()
        )
        np.testing.assert_allclose(
            pulled, force[row], rtol=1e-10, atol=1e-10 * np.abs(force[row]).max()
        )


def test_acceleration_from_rest_is_inverse_inertia_times_torque(machine: Machine) -> None:
    """q̈ = M⁻¹(τ − g) at q̇ = 0, with M and g of ``Poses``, where payload and bars are added in
    numpy.
    """
    q = machines.inner_poses(machine, 3)
    poses, bodies = machine.at(q), ForwardDynamics([machine.loaded_arm])
    torque = np.tile(np.linspace(-1e3, 1e3, len(machine.joints)), (3, 1))
    expected = np.linalg.solve(poses.mass_matrix, (torque - poses.gravity_torque)[:, :, None])[
        :, :, 0
    ]
    bars = [placed(machine, at, 0 * at)[4:] for at in q]
    acceleration = bodies.acceleration(
        q, 0 * q, torque, BarLoads(*(np.array(part) for part in zip(*bars, strict=True)))
    )
    np.testing.assert_allclose(acceleration, expected, rtol=1e-8, atol=1e-8)
    if not machine.has_bars:
        np.testing.assert_allclose(
            bodies.acceleration(q, 0 * q, torque), expected, rtol=1e-8, atol=1e-8
        )


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
