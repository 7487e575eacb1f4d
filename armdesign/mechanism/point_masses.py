"""Point masses at points of the arm, and slender bars as three of them: their M, g and ∂g/∂q."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armdesign.arrays import Array, product
from armdesign.hydraulics.actuator import Cylinder
from armdesign.mechanism.jets import VectorJet
from armdesign.mechanism.linkage.base import Linkage
from armdesign.mechanism.rigid_poses import RigidPoses
from armdesign.units import GRAVITY


def of_points(points: Sequence[tuple[float, VectorJet]]) -> tuple[Array, Array, Array]:
    """M, g and ∂g/∂q of point masses [kg]: Σ m JᵀJ, Σ m g ∂z/∂q, Σ m g ∂²z/∂q²."""
    inertia = gravity = slope = np.zeros(())
    for mass, p in points:
        m = np.reshape(mass, (-1, 1, 1))  # one mass, or one for each row
        inertia = inertia + m * product(p.first, np.swapaxes(p.first, 1, 2))
        gravity = gravity + m[..., 0] * GRAVITY * p.first[:, :, 2]
        slope = slope + m * GRAVITY * p.second[:, :, :, 2]
    return inertia, gravity, slope


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
