"""Poses exactly on the pitch limits of load cases."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.testing import assert_allclose

import armdesign as ad
from armdesign.frequency.spread import onto_pitch_limit, tipping_joints
from armdesign.machine.heading import Heading
from armdesign.mechanism.arm import Arm
from tests import machines
from tests.frequency.cached import workspace


def test_poses_on_the_pitch_limits_belong_to_it(excavator: ad.Machine) -> None:
    """The load case's limits, 120° and 240°, are met exactly, and the bucket holds its load
    there.
    """
    space = workspace("excavator_20t")
    excess = excavator.pitch_excess(excavator.arm.kinematics(space.q), excavator.payload)
    on_limit = np.abs(excess) < 1e-8
    assert on_limit.sum() > 50
    assert excavator.holds(space.q[on_limit]).all()
    pitch = (
        np.rad2deg(excavator.heading.pitch(excavator.arm.kinematics(space.q[on_limit]), "bucket"))
        % 360
    )
    assert_allclose(np.minimum(abs(pitch - 120), abs(pitch - 240)), 0, atol=1e-6)
    assert (abs(pitch - 120) < 1e-6).any()
    assert (abs(pitch - 240) < 1e-6).any()


def test_each_joint_is_turned_onto_the_pitch_limit(excavator: ad.Machine) -> None:
    q = machines.inner_poses(excavator, 5)
    for joint in tipping_joints(excavator, excavator.payload):
        _, moved = onto_pitch_limit(excavator, excavator.payload, q, joint, np.deg2rad(120))
        assert len(moved) == 5
        others = [j for j in range(3) if j != joint]
        assert_allclose(moved[:, others], q[:, others], atol=0)
        assert_allclose(
            excavator.pitch_excess(excavator.arm.kinematics(moved), excavator.payload),
            0,
            atol=1e-9,
        )


def test_slopes_of_the_pitch_are_what_it_changes_by() -> None:
    """Of all links of an arm with tilted axes, against central differences."""
    tilted = [
        replace(machines.STICK, rpy=(0.3, 0.1, 0.2), axis=(0.2, -1, 0.5)),
        replace(machines.BUCKET, rpy=(0.2, 0.3, -0.4), axis=(0.3, -1, 0.2)),
    ]
    joints, step = ["boom", "stick", "bucket"], 1e-6
    arm = Arm(machines.urdf([machines.BOOM, *tilted]), joints, {}, "test.urdf")
    heading = Heading(arm=arm, forward=np.array([1.0, 0, 0]))
    q = np.random.default_rng(3).uniform(-0.3, 0.3, (20, 3))
    for link in joints:
        slopes = heading.pitch_slopes(arm.kinematics(q), link, (0, 1, 2))
        for joint, one in enumerate(step * np.eye(3)):
            ahead, behind = (heading.pitch(arm.kinematics(q + way * one), link) for way in (1, -1))
            assert_allclose(slopes[:, joint], (ahead - behind) / (2 * step), atol=1e-8)
    assert np.ptp(slopes, axis=0).max() > 0.01
