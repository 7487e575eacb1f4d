"""The gear of a motor, which turns one joint: its "length" is the joint's coordinate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from armdesign.arrays import Array
from armdesign.mechanism.linkage.base import Actuation, Drive
from armdesign.mechanism.rigid_poses import RigidPoses


@dataclass(frozen=True, kw_only=True)
class Gear(Drive):
    """A joint turned by a motor: moment arm 1, moment-arm derivative 0."""

    joint: int

    @property
    def joints(self) -> tuple[int, ...]:
        """The coordinate that it turns."""
        return (self.joint,)

    def length(self, poses: RigidPoses) -> Array:
        """Angle of the joint (n,) [rad]."""
        return np.asarray(poses.q[:, self.joint])

    def actuation(self, poses: RigidPoses) -> Actuation:
        """Angle, and the unit moment arm."""
        n, k = poses.gravity_torque.shape
        moment_arm = np.zeros((n, k))
        moment_arm[:, self.joint] = 1.0
        return Actuation(self.length(poses), moment_arm, np.zeros((n, k, k)))

    def record(self) -> dict[str, Any]:
        """Record for compiled code."""
        return {"joint": self.joint}
