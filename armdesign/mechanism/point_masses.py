"""Point masses on an arm: M, g and ∂g/∂q of one that a link carries, and bars as three of them."""

from __future__ import annotations

import numpy as np

from armdesign.arrays import Array
from armdesign.hydraulics.actuator import Cylinder
from armdesign.mechanism.arm import Arm
from armdesign.mechanism.composite_bodies import pose_by_pose
from armdesign.mechanism.jets import VectorJet, cross
from armdesign.mechanism.linkage.base import Linkage
from armdesign.mechanism.rigid_poses import RigidPoses
from armdesign.units import GRAVITY


def of_carried(
    arm: Arm, poses: RigidPoses, link: str, at: Array, mass: float | Array
) -> tuple[Array, Array, Array]:
    """M (n, k, k), g (n, k) and ∂g/∂q (n, k, k) of a point mass at a place in a link.

    A joint i between root and link moves it by v_i = a_i × (p − p_i), or a_i if prismatic:
    M_ij = m v_i·v_j, g_i = m g v_i,z, and of a revolute i before j ∂g_i/∂q_j = m g (a_i × v_j)_z.

    Args:
        arm: with k coordinates.
        poses: n poses.
        link: that carries it.
        at: place in the link's frame (3,), or one for each pose (n, 3) [m].
        mass: [kg], one, or one for each pose (n,).
    """
    point, k = arm.point(poses, link, at), len(arm.coordinates)
    dtype = np.result_type(point, mass)
    inertia, slope = np.zeros((2, k, k, len(poses)), dtype)
    gravity = np.zeros((k, len(poses)), dtype)
    axes, moved = dict[int, Array](), dict[int, Array]()
    for j in arm.chain(link):
        axes[j] = moved[j] = np.ascontiguousarray(poses.axis[:, j].T)
        if arm.coordinates[j].revolute:
            moved[j] = cross(axes[j], (point - poses.translation[:, j]).T, axis=0)
        x, y, z = mass * moved[j]
        gravity[j] = GRAVITY * z
        for i, v in moved.items():
            inertia[i, j] = inertia[j, i] = v[0] * x + v[1] * y + v[2] * z
            if arm.coordinates[i].revolute:
                rising = axes[i][0] * y - axes[i][1] * x
                slope[i, j] = slope[j, i] = GRAVITY * rising
    return pose_by_pose(inertia), pose_by_pose(gravity), pose_by_pose(slope)


def points_of_bars(
    cylinder: Cylinder, linkage: Linkage, poses: RigidPoses
) -> list[tuple[float, VectorJet]]:
    """Point masses [kg] in place of a cylinder's barrel, rod, rocker and coupler."""
    masses = cylinder.moving_masses
    bars = linkage.bars(poses, cylinder.closed_length, names=masses) if masses else {}
    return [point for name, mass in masses.items() for point in points_of_bar(mass, bars[name])]


def fixed_points(cylinder: Cylinder, linkage: Linkage) -> list[tuple[float, str, Array]]:
    """``points_of_bars`` of a cylinder that stands still, each in a link at (3,) [m]."""
    arm, link = linkage.arm, linkage.observer
    points = points_of_bars(cylinder, linkage, arm.zero)
    return [(mass, link, arm.in_link(arm.zero, link, point.value)[0]) for mass, point in points]


def points_of_bar(mass: float, ends: tuple[VectorJet, VectorJet]) -> list[tuple[float, VectorJet]]:
    """Three point masses that move, weigh and store like a uniform slender bar between two points.

    A sixth of the mass at either end, the rest in the middle (Simpson's rule, exact: all is
    quadratic along the bar).
    """
    middle = (ends[0] + ends[1]) * 0.5
    return [(mass / 6, ends[0]), (2 * mass / 3, middle), (mass / 6, ends[1])]
