"""Slewing joints: idle where nothing depends on their angle, counted where a cylinder does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import armdesign as ad
from armdesign import plots
from tests import machines


def swinging(axis: float, motor: bool = False) -> ad.Machine:
    """A bracket about a vertical axis that a cylinder swings, a boom on it; below it, if asked, a
    slewing motor.
    """
    feet = (
        [machines.Joint("slew", "root", axis=(0, 0, 1), kind="continuous", com=(0, 0, 0.2))]
        if motor
        else []
    )
    foot = "slew" if motor else "root"
    bracket = machines.Joint(
        "bracket",
        foot,
        xyz=(0.6, 0, 0.4),
        axis=(0, 0, axis),
        com=(0.2, 0, 0.1),
        limits=(-0.8, 0.8),
    )
    boom = replace(machines.BOOM, parent="bracket")
    turn = machines.CylinderSpec("turn", (foot, (0.0, 0.5, 0.5)), ("bracket", (0.3, 0.35, 0.2)))
    lift = machines.CylinderSpec("lift", ("bracket", (0.5, 0, -0.2)), ("boom", (1.1, 0, 0.3)))
    table = (
        "[motor.slew]\njoint = 'slew'\ndisplacement_cm3 = 160\ngear_ratio = 24\ntrapped_volume_l ="
        " { a = 1, b = 1 }"
    )
    return machines.build([*feet, bracket, boom], [turn, lift], more=table if motor else "")


@pytest.mark.parametrize("axis", [1, -1])
@pytest.mark.parametrize("motor", [False, True])
def test_a_cylinder_across_a_slewing_joint_makes_its_angle_count(axis: float, motor: bool) -> None:
    """The default grid covers its whole range: no random pose lies below the worst, of either sign
    of the axis.
    """
    machine = swinging(axis, motor)
    j = machine.joints.index("bracket")
    space = ad.Workspace.grid(machine, None if not motor else [2, 15, 15])
    assert_allclose(space.ranges[j], machine.range_within(space.end_margin)[j], atol=1e-12)
    frequencies = ad.frequency_map(machine, space)
    low, high = machine.range_within(space.end_margin).T
    q = low + np.random.default_rng(3).random((4000, len(low))) * (high - low)
    random = ad.natural_modes(machine.at(q)).frequencies[:, 0].min()
    assert frequencies.worst.frequency <= random <= 1.02 * frequencies.worst.frequency
    assert plots.drawn_joints(machine) == [j, j + 1]


@pytest.mark.slow
def test_the_sign_of_a_slewing_axis_changes_no_design() -> None:
    """A mirrored coordinate is the same machine: worst pose and sizes agree."""
    designs = [
        ad.size_cylinders(one, ad.Workspace.grid(one, 7)) for one in (swinging(1), swinging(-1))
    ]
    assert designs[0].before.worst.frequency == pytest.approx(
        designs[1].before.worst.frequency, rel=1e-6
    )
    assert designs[0].after.worst.frequency == pytest.approx(
        designs[1].after.worst.frequency, rel=1e-4
    )


def test_slewing_is_idle_only_where_nothing_depends_on_it() -> None:
    """A lowest motor is; a cylinder's joint is not; nor a second motor whose axis stands beside
    the first one's.

    Of the second the inertia about the first says so: it depends on the second's angle.
    """
    assert machines.named("slewing").joints_without_effect == {0}
    assert swinging(1).joints_without_effect == frozenset()
    assert swinging(1, motor=True).joints_without_effect == {0}
    joints = [
        machines.Joint(name, "root" if k == 0 else "a", axis=(0, 0, 1))
        for k, name in enumerate("ab")
    ]
    table = (
        "[motor.{0}]\njoint = '{0}'\ndisplacement_cm3 = 160\ngear_ratio = 24\ntrapped_volume_l ="
        " {{ a = 1, b = 1 }}"
    )
    tables = "\n".join(table.format(name) for name in "ab")
    for offset, idle in ((0.0, {0, 1}), (0.5, {0})):
        pair = [
            joints[0],
            replace(joints[1], xyz=(offset, 0, 0.3)),
            replace(machines.BOOM, parent="b"),
        ]
        lift = machines.CylinderSpec("lift", ("b", (0.5, 0, -0.2)), ("boom", (1.1, 0, 0.3)))
        machine = machines.build(pair, [lift], more=tables)
        assert machine.joints_without_effect == idle
        mass = machine.at([[0, 0, 0], [0, 0.3, 0]]).mass_matrix[:, 0, 0]
        assert (abs(mass[1] / mass[0] - 1) < 1e-12) == (offset == 0)
