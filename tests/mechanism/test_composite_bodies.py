"""M, g and ∂g/∂q of arms askew, against Pinocchio and against g itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio
import pytest
from numpy.testing import assert_allclose

from armdesign.mechanism.arm import Arm
from armdesign.mechanism.composite_bodies import Bodies, inertia_and_gravity
from tests.machines import BOOM, BUCKET, STICK, Joint, urdf

SLIDE = Joint("slide", "stick", (0.5, 0.1, 0), (0.3, 0, 0.2), (1, 0.5, 0), "prismatic")
TIP = replace(BUCKET, name="tip", parent="slide", rpy=(0.2, 0.3, -0.4), axis=(0.3, -1, 0.2))
SIDE = replace(BUCKET, name="side", parent="boom", rpy=(0.7, -0.3, 0.1), axis=(-0.4, 1, 0.6))
ARMS = {
    "askew, with a slide": ([BOOM, STICK, SLIDE, TIP], ["boom", "stick", "slide", "tip"]),
    "forked, in another order": (
        [BOOM, STICK, SLIDE, TIP, SIDE],
        ["side", "tip", "slide", "boom", "stick"],
    ),
    "sliding at its root": (
        [replace(BOOM, kind="prismatic", axis=(0.2, 0.3, 0.9)), STICK],
        ["boom", "stick"],
    ),
    "a kilometre away": ([replace(BOOM, xyz=(1e3, 0, 0)), STICK], ["boom", "stick"]),
}


@pytest.fixture(params=ARMS)
def arm(request: pytest.FixtureRequest) -> Arm:
    joints, order = ARMS[request.param]
    return Arm(urdf(joints), order, {}, "test.urdf")


def positions(arm: Arm) -> np.ndarray:
    return np.random.default_rng(3).uniform(-0.3, 0.3, (5, len(arm.coordinates)))


def test_inertia_and_gravity_are_pinocchios(arm: Arm) -> None:
    """Composite bodies and derivatives of Pinocchio's own recursions, pose by pose."""
    model, order = pinocchio.buildModelFromXML(arm.xml), arm.model_order
    data, pick = model.createData(), np.ix_(arm.model_order, arm.model_order)
    poses = arm.rigid_poses(positions(arm))
    for row, q in enumerate(poses.q):
        ordered = np.empty(len(q))
        ordered[order] = q
        upper = np.triu(pinocchio.crba(model, data, ordered))
        slope = pinocchio.computeGeneralizedGravityDerivatives(model, data, ordered)
        expected = (upper + np.triu(upper, 1).T)[pick], data.g[order], slope[pick]
        terms = poses.mass_matrix[row], poses.gravity_torque[row], poses.gravity_stiffness[row]
        for own, other in zip(terms, expected, strict=True):
            assert_allclose(own, other, atol=1e-12 * np.abs(other).max(), rtol=0)


def test_slopes_are_those_of_gravity_by_a_complex_step(arm: Arm) -> None:
    """Everything is analytic in q, so an imaginary step of g gives ∂g/∂q to rounding."""
    q, step = positions(arm), 1e-30
    bodies, expected = Bodies.of(arm._model, arm.coordinates), arm.rigid_poses(q).gravity_stiffness
    for j in range(q.shape[1]):
        stepped = arm.placements(q + 1j * step * np.eye(q.shape[1])[j])
        gravity = inertia_and_gravity(bodies, arm.coordinates, arm._chains, stepped)[1]
        scale = np.abs(expected).max()
        assert_allclose(gravity.imag / step, expected[:, :, j], atol=1e-12 * scale, rtol=0)


def test_a_body_of_the_name_that_pinocchio_gives_the_world() -> None:
    """A joint may be named "universe": the body is its own, not the world's, which has no mass."""
    plain = urdf([BOOM, STICK])
    arms = (
        Arm(plain, ["boom", "stick"], {}, "plain.urdf"),
        Arm(plain.replace('"stick"', '"universe"'), ["boom", "universe"], {}, "odd.urdf"),
    )
    one, other = (Bodies.of(arm._model, arm.coordinates) for arm in arms)
    for own, expected in zip(other, one, strict=True):
        assert_allclose(own, expected, rtol=1e-15)
