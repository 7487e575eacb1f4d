"""The plane of a side view: vertical, along the direction in which the arm points.

Slewing is left out: the observer turns with the arm, and what stands still is seen as without
slewing. What a slew carries whose axis leans, or rocks on a spring, is seen as it stands at its
pose, turned about the foot of that axis into the picture. Each link is a plate: points of its
frame are told by two axes of it, which a 2×3 matrix places in the picture at every pose. That is
exact for points in the plate and for arms that move in one plane; other joints turn the plate out
of the picture, which foreshortens it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armdesign.arrays import Array
from armdesign.machine.heading import Heading
from armdesign.mechanism.arm import Arm
from armdesign.mechanism.rigid_poses import RigidPoses

SQUARE = 0.999  # least part across the picture of an axis that is drawn as it is


@dataclass(frozen=True, eq=False)
class PicturePlane:
    """The picture of an arm: forward to the right, up upwards.

    Attributes:
        heading: where the arm points: there is forward.
    """

    heading: Heading

    @property
    def arm(self) -> Arm:
        """The arm."""
        return self.heading.arm

    def poses(self, q: Array) -> RigidPoses:
        """Placements at q (n, nq), or with springs (n, k), without slewing about the vertical."""
        z = np.array(self.arm.with_springs(q), dtype=float)
        z[:, list(self.arm.slewing)] = 0.0
        return self.arm.kinematics(z)

    @cached_property
    def zero(self) -> RigidPoses:
        """Placements with all joints of q at 0."""
        return self.poses(np.zeros((1, len(self.arm.joints))))

    @cached_property
    def axes(self) -> Array:
        """Directions in the world (2, 3): forward and up."""
        ((x, y),) = self.heading.at(np.zeros((1, len(self.arm.joints))))
        return np.array([[x, y, 0.0], [0.0, 0.0, 1.0]])

    @cached_property
    def across(self) -> Array:
        """Direction in the world (3,), out of the picture to its back: a hinge's axis."""
        return np.cross(self.axes[1], self.axes[0])

    @cached_property
    def leaning(self) -> frozenset[int]:
        """Slews that ``poses`` keeps: about axes that lean, or that a spring rocks."""
        return frozenset(self.arm.slews.axes) - frozenset(self.arm.slewing)

    def axes_at(self, poses: RigidPoses, link: str) -> Array:
        """Forward and up, turned by leaning slews that carry a link: (n, 2, 3), else (2, 3)."""
        if self.leaning.isdisjoint(self.arm.chain(link)):
            return self.axes
        z = np.array(poses.q, dtype=float)
        z[:, list(self.leaning.difference(self.arm.chain(link)))] = 0.0
        axes = np.tile(self.axes, (len(z), 1, 1))
        axes[:, 0, :2] = self.heading.at(z)
        return axes

    def project(self, points: Array) -> Array:
        """Points in the world (…, 3) as places in the picture (…, 2) [m], without slewing."""
        return np.asarray(points @ self.axes.T)

    def seen(self, poses: RigidPoses, link: str, points: Array) -> Array:
        """Points in the world (n, m, 3) that a link carries, in the picture (n, m, 2) [m]."""
        axes = self.axes_at(poses, link)
        if axes is self.axes:
            return self.project(points)
        foot = np.append(self.arm.slews.foot, 0.0)
        return np.asarray((points - foot) @ np.swapaxes(axes, 1, 2) + self.project(foot))

    def plate(self, link: str) -> Array:
        """The two axes of a link's frame (2, 3) that span its plate.

        Its x and z axes where y is square to the picture, as a machine file's outlines have them;
        else what points forward and up while all joints are at 0.
        """
        rotation = self.arm.link_rotation(self.zero, link)[0]
        if abs(float(rotation[:, 1] @ self.across)) > SQUARE:
            return np.eye(3)[[0, 2]]
        return np.asarray(self.axes @ rotation)

    def placements(self, poses: RigidPoses, link: str) -> Array:
        """Matrices (n, 2, 3) that place a link's plate in the picture: A u + t, as [A | t]."""
        axes = self.axes_at(poses, link)
        turn = axes @ self.arm.link_rotation(poses, link) @ self.plate(link).T
        foot = self.seen(poses, link, self.arm.point(poses, link, np.zeros(3))[:, None])
        return np.concatenate([turn, np.swapaxes(foot, 1, 2)], axis=2)


def placed(matrix: Array, points: Array) -> Array:
    """Points of a plate (m, 2) in the picture by matrices (…, 2, 3): (…, m, 2)."""
    return np.asarray(points @ np.swapaxes(matrix[..., :2], -1, -2) + matrix[..., None, :, 2])
