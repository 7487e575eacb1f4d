"""The lean geometry of the simulation is that of ``Linkage``, an independent formula, on every kind of linkage."""

from __future__ import annotations

import machines
import numpy as np

from armdesign import Machine
from armdesign.simulation.reach import reach


def test_length_and_moment_arm(machine: Machine) -> None:
    q = machines.inner_poses(machine, 5)
    poses, dynamics = machine.at(q), machine.dynamics()
    for row, pose in enumerate(q.tolist()):
        frames = dynamics.frames(pose)
        for i, linkage in enumerate(machine.drives):
            length, moments = reach(linkage)(pose, frames)
            arms = np.zeros(len(pose))
            for j, arm in moments:
                arms[j] += arm
            np.testing.assert_allclose(length, poses.lengths[row, i], rtol=1e-12)
            np.testing.assert_allclose(arms, poses.moment_arms[row, i], atol=1e-11)


def test_acceleration_from_rest_is_inverse_inertia_times_torque(machine: Machine) -> None:
    """q̈ = M⁻¹(τ − g) at q̇ = 0, with M and g of ``Poses``, where the payload is added in numpy and not as a body."""
    q = machines.inner_poses(machine, 3)
    poses, dynamics = machine.at(q), machine.dynamics()
    torque = np.linspace(-1e3, 1e3, len(machine.joints))
    for row, pose in enumerate(q.tolist()):
        expected = np.linalg.solve(poses.mass_matrix[row], torque - poses.gravity_torque[row])
        found = dynamics.acceleration(pose, [0.0] * len(pose), torque.tolist())
        np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-8)
