"""Poses in which oil with air is softest: forces there, and that it is."""

from __future__ import annotations

import numpy as np

import armdesign as ad
from armdesign.frequency.softest_poses import softest_poses
from tests.opening import opening

AIR = {"fluid.entrained_air_percent": 1.0}


def test_oil_is_softest_with_chambers_at_equal_pressure() -> None:
    """Of forces about p (A1 − A2) it is softest at that one, by the stiffness of one cylinder."""
    machine = ad.load("excavator_20t").replace(AIR)
    for actuator in machine.actuators:
        area = actuator.bore_area - actuator.annulus_area
        forces = area * actuator.preload(machine.supply.return_pressure) * np.linspace(-1, 3, 41)
        stiffness = [
            actuator.stiffness(0.4 * actuator.stroke, force, machine.fluid, machine.supply)
            for force in forces
        ]
        assert int(np.argmin(stiffness)) == 20


def test_poses_near_random_ones_are_of_such_forces() -> None:
    """Of the stick and the bucket, by a tenth of what they were before or less; nothing unloads
    the boom. A pose ends at the ends of joints.
    """
    machine = ad.load("excavator_20t").replace(AIR)
    q = np.random.default_rng(0).uniform(*machine.ranges.T, (200, 3))
    found, none = (softest_poses(machine, machine.ranges, q, most) for most in (1.0, -1.0))
    assert (found.shape, none.shape) == ((600, 3), (0, 3))
    assert np.all((found >= machine.ranges[:, 0]) & (found <= machine.ranges[:, 1]))
    for i, poses in list(enumerate(np.split(found, 3)))[1:]:
        actuator, forces = machine.actuators[i], machine.at(q).cylinder_forces[:, i]
        area = actuator.bore_area - actuator.annulus_area
        expected = area * actuator.preload(machine.supply.return_pressure)
        missed = np.abs(machine.at(poses).cylinder_forces[:, i] - expected)
        before = np.abs(forces - expected)
        assert np.median(missed) < 0.1 * np.median(before)
    assert len(softest_poses(machine, machine.ranges, q[:0])) == 0


def test_no_steps_from_where_a_four_bar_is_open() -> None:
    """There forces are no numbers: warnings and poses that are none."""
    machine = opening()
    q = np.random.default_rng(0).uniform(*machine.ranges.T, (50, 3))
    assert np.isneginf(machine.margins(q)).any()
    found = softest_poses(machine, machine.ranges, q)
    assert len(found) > 50
    assert np.all((found >= machine.ranges[:, 0]) & (found <= machine.ranges[:, 1]))
