"""Reach figures against the independent planar arm, by hand and by brute force."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from armdesign.inspection.reach_figures import reach_figures
from tests.design.requirements.shared import shipped_reference
from tests.machine.shipped_facts import foot
from tests.machines import BOOM, LIFT, STICK, CylinderSpec, Joint, build, named
from tests.opening import opening
from tests.planar_arm import at

EXCAVATORS = ["excavator_20t", "excavator_12t", "mini_excavator_2t"]


def largest(function: Callable[[np.ndarray], np.ndarray], ranges: np.ndarray) -> float:
    """Largest value over a box: an even grid, then ever finer ones around its best."""
    low, high = ranges.T
    offsets = np.stack(np.meshgrid(*[np.linspace(-1, 1, 21)] * len(low), indexing="ij"), axis=-1)
    offsets = offsets.reshape(-1, len(low))
    best, half = (low + high) / 2, (high - low) / 2
    for _ in range(14):
        q = np.clip(best + offsets * half, low, high)
        best, half = q[np.nanargmax(function(q))], half / 4
    return float(np.nanmax(function(best[None])))


@pytest.mark.parametrize("name", EXCAVATORS)
def test_figures_by_the_planar_arm(name: str) -> None:
    """Reach, height and depth by zooming; at ground level by the circle of the stretched arm.

    From the boom foot the stretched stick and bucket reach a circle, which the ground cuts. The
    dump height with the bucket's angle by hand, so that its tooth is straight below its pin.
    """
    machine, plane = named(name), shipped_reference(named(name))
    x, z = foot(name)

    def tool(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return at(plane.frames(q), plane.tool)

    def hanging(q: np.ndarray) -> np.ndarray:
        bucket = -math.pi / 2 - q.sum(axis=1)
        low, high = machine.ranges[2]
        inside = (bucket >= low) & (bucket <= high)
        height = tool(np.column_stack([q, bucket]))[1]
        return np.where(inside, height, -np.inf)

    radius = largest(lambda q: np.hypot(tool(q)[0] - x, tool(q)[1] - z), machine.ranges)
    figures = reach_figures(machine)
    assert figures.reach == pytest.approx(largest(lambda q: tool(q)[0], machine.ranges), abs=1e-6)
    assert figures.height == pytest.approx(largest(lambda q: tool(q)[1], machine.ranges), abs=1e-6)
    assert figures.depth == pytest.approx(largest(lambda q: -tool(q)[1], machine.ranges), abs=1e-6)
    assert figures.reach_at_ground == pytest.approx(x + math.sqrt(radius**2 - z**2), abs=1e-6)
    assert figures.dump_height == pytest.approx(largest(hanging, machine.ranges[:2]), abs=1e-5)


def test_data_sheet_of_the_20_t_machine() -> None:
    """SOURCE.md, over the full strokes: 9.76 m at ground within a band of samples."""
    figures = reach_figures(named("excavator_20t"))
    assert figures.reach_at_ground == pytest.approx(9.76, abs=0.012)
    assert figures.depth == pytest.approx(6.35, abs=0.01)
    assert figures.height == pytest.approx(10.46, abs=0.006)
    assert figures.dump_height == pytest.approx(7.51, abs=0.006)


def test_slewing_changes_no_figure() -> None:
    fixed, slewing = reach_figures(named("rigid_excavator_20t")), reach_figures(named("slewing"))
    for one, other in zip(vars(fixed).values(), vars(slewing).values(), strict=True):
        assert one == pytest.approx(other, abs=1e-6)


def test_a_motor_beside_a_cylinder_across_joints_changes_no_figure() -> None:
    """A wrist that turns about the line to the tool; its margin, which never ends, is inf."""
    ends = ("stick", (1.5, 0.0, 0.0)), ("wrist", (0.5, 0.0, 0.0))
    wrist = Joint("wrist", "stick", xyz=(1.0, 0, 0), axis=(1, 0, 0), kind="continuous")
    motor = (
        "[motor.turn]\njoint = 'wrist'\ndisplacement_cm3 = 160\ngear_ratio = 24\n"
        "trapped_volume_l = { a = 0.6, b = 0.9 }"
    )
    long = CylinderSpec("long", ("root", (-0.5, 0, 0.9)), ("stick", (-0.3, 0, 0.7)))
    bare = build([BOOM, STICK], [LIFT, long], payload=ends[0])
    turned = build([BOOM, STICK, wrist], [LIFT, long], payload=ends[1], more=motor)
    one, other = reach_figures(bare), reach_figures(turned)
    assert one.reach_at_ground is not None
    for name, figure in vars(one).items():
        assert getattr(other, name) == (figure and pytest.approx(figure, abs=1e-6)), name


@pytest.mark.parametrize("name", ["loader_crane", "crossing", "branched", "redundant"])
def test_no_random_pose_is_beyond_and_some_are_near(name: str) -> None:
    """50 000 random poses in stroke; also where cylinders across several joints cut the box."""
    machine, random = named(name), np.random.default_rng(1)
    low, high = machine.ranges.T
    q = low + np.clip(1.1 * random.random((50_000, len(low))) - 0.05, 0, 1) * (high - low)
    q = q[machine.margins(q).min(axis=1) >= 0]
    poses = machine.arm.kinematics(q)
    tool = machine.arm.point(poses, machine.tool.link, np.array(machine.tool.at))
    reach = machine.heading.reach(q, tool)
    figures = reach_figures(machine)
    for figure, values in (
        (figures.reach, reach),
        (figures.height, tool[:, 2]),
        (figures.depth, -tool[:, 2]),
    ):
        assert values.max() - 1e-6 <= figure <= values.max() + 0.05
    ground = reach[abs(tool[:, 2]) < 0.01]
    if len(ground):
        assert figures.reach_at_ground is not None
        assert ground.max() - 0.05 <= figures.reach_at_ground <= ground.max() + 0.1


def test_what_a_machine_never_does_is_none() -> None:
    """The tool of the PATU boom stays 0.21 m above the floor (SOURCE.md), and never hangs."""
    figures = reach_figures(named("patu_boom"))
    assert (figures.reach_at_ground, figures.dump_height) == (None, None)
    assert figures.depth == pytest.approx(-0.21, abs=0.005)


def test_the_highest_pose_is_where_a_four_bar_all_but_opens() -> None:
    """2.861 m by 400 000 random poses and steps at random from the best (2.744 m before)."""
    figures = reach_figures(opening())
    assert figures.height == pytest.approx(2.8612, abs=5e-4)
