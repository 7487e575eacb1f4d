"""Joints of one direction turn by the sum of their angles: placements as products of frames."""

from __future__ import annotations

import numpy as np
import pytest

from armdesign.mechanism.arm import Arm
from armdesign.mechanism.urdf import rotations
from tests.machines import named


def frames(arm: Arm, q: np.ndarray) -> np.ndarray:
    """Rotations of the joints' frames (n, k, 3, 3), one after the other."""
    q, known = arm.with_springs(q), np.empty((len(q), len(arm.coordinates), 3, 3))
    for index in arm.outwards:
        joint = arm.coordinates[index]
        turn = rotations(joint.axis, q[:, index] if joint.revolute else np.zeros(len(q)))
        before = known[:, joint.parent] if joint.parent >= 0 else np.eye(3)
        known[:, index] = before @ joint.rotation @ turn
    return known


@pytest.mark.parametrize(
    ("name", "count"), [("excavator_20t", 3), ("loader_crane", 2), ("slewing", 1), ("spatial", 1)]
)
def test_placements_are_products_of_frames(name: str, count: int) -> None:
    """Also where only the first joints are parallel: a slide, or an axis across, ends the sum."""
    arm = named(name).arm
    assert len(arm._alike) == count
    q = np.random.default_rng(0).uniform(*arm.limits.T, (50, len(arm.joints)))
    np.testing.assert_allclose(arm.placements(q)[0], frames(arm, q), rtol=0, atol=1e-14)
