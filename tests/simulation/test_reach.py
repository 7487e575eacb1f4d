"""The lean geometry of the simulation is that of ``Linkage``, an independent formula, on every kind of linkage."""

from __future__ import annotations

import machines
import numpy as np

from armdesign import Machine
from armdesign.arm import Dynamics
from armdesign.simulation.reach import Reach


def test_length_and_moment_arm(machine: Machine) -> None:
    q = machines.inner_poses(machine, 5)
    poses, frames = machine.at(q), Dynamics([machine.loaded_arm]).frames(q)
    lengths, arms = Reach([machine.linkages])(frames)
    count = len(machine.cylinders)
    np.testing.assert_allclose(lengths, poses.lengths[:, :count], rtol=1e-12)
    np.testing.assert_allclose(arms, poses.moment_arms[:, :count], atol=1e-11)


def test_frames_are_the_placements(machine: Machine) -> None:
    q = machines.inner_poses(machine, 3)
    rotation, translation, _ = machine.arm.placements(q)
    frames = Dynamics([machine.loaded_arm]).frames(q)
    np.testing.assert_allclose(frames[:, :-1, :3, :3], rotation, atol=1e-12)
    np.testing.assert_allclose(frames[:, :-1, :3, 3], translation, atol=1e-12)


def test_acceleration_from_rest_is_inverse_inertia_times_torque(machine: Machine) -> None:
    """q̈ = M⁻¹(τ − g) at q̇ = 0, with M and g of ``Poses``, where the payload is added in numpy and not as a body."""
    q = machines.inner_poses(machine, 3)
    poses = machine.at(q)
    torque = np.tile(np.linspace(-1e3, 1e3, len(machine.joints)), (3, 1))
    expected = np.linalg.solve(poses.mass_matrix, (torque - poses.gravity_torque)[:, :, None])[:, :, 0]
    found = Dynamics([machine.loaded_arm]).acceleration(q, 0 * q, torque)
    np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-8)


def test_cases_of_different_machines_side_by_side() -> None:
    """Payloads and pins of each case are its own."""
    one = machines.named("excavator_20t").with_payload("full")
    other = one.with_payload("empty").replace({"cylinder.bucket.four_bar.rocker_mm": 590.0})
    q = machines.inner_poses(one, 2)
    pair = [one, other]
    stack = Dynamics([m.loaded_arm for m in pair])
    lengths, arms = Reach([m.linkages for m in pair])(stack.frames(q))
    accelerations = stack.acceleration(q, 0 * q, 0 * q)
    for row, machine in enumerate(pair):
        alone = machine.at(q[row])
        np.testing.assert_allclose(lengths[row], alone.lengths[0], rtol=1e-12)
        np.testing.assert_allclose(arms[row], alone.moment_arms[0], atol=1e-11)
        expected = np.linalg.solve(alone.mass_matrix[0], -alone.gravity_torque[0])
        np.testing.assert_allclose(accelerations[row], expected, rtol=1e-8)
