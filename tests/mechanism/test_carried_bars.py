"""Bars in the link that carries them: moments there against point masses moved by all joints."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from armdesign.arrays import Array
from armdesign.mechanism.carried_bars import (
    first_of_bar,
    gravity,
    inertia_and_gravity,
    of_bar,
    of_linkage,
    weighed,
    weighed_by_row,
)
from armdesign.mechanism.jets import VectorJet
from armdesign.mechanism.point_masses import of_carried, points_of_bar
from armdesign.units import GRAVITY
from tests.machines import named
from tests.sprung import rocking

# prismatic and skew joints, cylinders over two joints, a four-bar whose base its own joint moves
# twice, springs before and behind, a slewing arm
MACHINES = [
    *("four_bar_left", "four_bar_from_boom", "spatial", "crossing", "branched", "redundant"),
    *("rotator", "slewing", "random_3", "random_8"),
]


def of_points(points: list[tuple[float, VectorJet]]) -> tuple[Array, Array, Array]:
    """Σ m JᵀJ, Σ m g ∂z/∂q and Σ m g ∂²z/∂q² of point masses [kg]."""
    inertia = sum(m * p.first @ np.swapaxes(p.first, 1, 2) for m, p in points)
    gravity_torque = sum(m * GRAVITY * p.first[:, :, 2] for m, p in points)
    slope = sum(m * GRAVITY * p.second[:, :, :, 2] for m, p in points)
    return np.asarray(inertia), np.asarray(gravity_torque), np.asarray(slope)


@pytest.mark.parametrize("name", [*MACHINES, "rocking"])
def test_a_load_in_a_link_is_a_point_that_all_joints_before_it_move(name: str) -> None:
    """One mass for all poses, and one for each."""
    machine = rocking() if name == "rocking" else named(name)
    low, high = np.array(machine.ranges).T
    arm, at = machine.arm, np.array([0.3, -0.2, 0.1])
    poses = arm.rigid_poses(np.random.default_rng(6).uniform(low, high, (5, len(low))))
    joints = tuple(range(len(arm.coordinates)))
    for link in arm.links:
        point = arm.motion(poses, link, at, arm.root, joints)
        terms = of_points([(1.0, point)])
        for mass in (800.0, np.array([1.0, 0.0, 300.0, 800.0, 2.0])):
            for actual, unit in zip(of_carried(arm, poses, link, at, mass), terms, strict=True):
                expected = np.reshape(mass, (-1, *[1] * (unit.ndim - 1))) * unit
                assert np.moveaxis(actual, 0, -1).flags.c_contiguous  # by component
                assert_allclose(actual, expected, rtol=0, atol=1e-12 * 800 * np.abs(unit).max())


@pytest.mark.parametrize("name", [*MACHINES, "rocking"])
def test_moments_say_what_points_say(name: str) -> None:
    """Every bar of every cylinder, 37 kg of the first, 53 kg of the second and so on."""
    machine = rocking() if name == "rocking" else named(name)
    low, high = np.array(machine.ranges).T
    q = np.random.default_rng(4).uniform(low, high, (9, len(low)))
    poses = machine.arm.rigid_poses(q)
    for cylinder, linkage in zip(machine.cylinders, machine.linkages, strict=True):
        arm, link, own = linkage.arm, linkage.observer, linkage.joints
        seen = linkage.bars(poses, cylinder.closed_length, link, own)
        masses = 37.0 + 16.0 * np.arange(len(seen))
        placed = arm.link_rotation(poses, link), arm.point(poses, link, np.zeros(3))
        units = [of_bar(ends, *placed) for ends in seen.values()]
        of_root = linkage.bars(poses, cylinder.closed_length)
        points = [
            point
            for mass, ends in zip(masses, of_root.values(), strict=True)
            for point in points_of_bar(mass, ends)
        ]
        by_row = weighed_by_row(np.tile(masses, (len(q), 1)), units)
        for moments in (weighed(masses, units), by_row):
            terms = inertia_and_gravity(arm, link, own, poses, moments)
            for actual, expected in zip(terms, of_points(points), strict=True):
                scale = np.abs(expected).max()
                assert_allclose(actual, expected, rtol=0, atol=1e-12 * scale)
        first = weighed(masses, [first_of_bar(ends, *placed) for ends in seen.values()])
        alone, expected = gravity(arm, link, own, poses, first), of_points(points)[1]
        assert_allclose(alone, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("name", [*MACHINES, "rocking"])
def test_slopes_are_those_of_gravity_by_a_complex_step(name: str) -> None:
    """Along every joint; poses of bars may be complex, as those of links may."""
    machine, step = rocking() if name == "rocking" else named(name), 1e-30
    low, high = np.array(machine.ranges).T
    q = np.random.default_rng(5).uniform(low, high, (4, len(low)))
    for cylinder, linkage in zip(machine.cylinders, machine.linkages, strict=True):
        length, poses = cylinder.closed_length, machine.arm.kinematics(q)
        masses = {bar: 37.0 + 16.0 * k for k, bar in enumerate(linkage.bars(poses, length))}
        slope = of_linkage(linkage, masses, length, poses)[2]
        for j, along in enumerate(np.eye(len(low))):
            poses = machine.arm.kinematics(q + 1j * step * along)
            stepped = of_linkage(linkage, masses, length, poses)[1].imag / step
            assert_allclose(slope[:, :, j], stepped, rtol=0, atol=1e-12 * np.abs(slope).max())
