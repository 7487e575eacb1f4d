"""Machines that a file turns about the vertical answer what those that point along x do.

The 20 t excavator with its first joint yawed, its boom mounted along another direction of what
slews, and both; a lever whose tool is behind its joint; arms of slides, of slews alone and with a
tool over their axis.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import armdesign as ad
from armdesign import Machine
from armdesign.drawing.side_view import side_view
from armdesign.inspection.reach_figures import reach_figures
from armdesign.machine.tipping import centre_ahead, tipping_masses
from tests.inspection.inspected import odd
from tests.machines import BOOM, FOLD, LIFT, STICK, CylinderSpec, Joint, build, inner_poses, named
from tests.slewing_tables import MOTOR, stability

STABILITY = stability(12000, [-900, 0, 900], 1300, 1300)
FOOT = (0.2277, 1.9573)  # x and z of the boom's foot in the excavator's URDF
YAWS = (math.pi / 2, 1.5707, 1.5708, 2.356, math.pi, -1.0)


@cache
def excavator(root: float = 0.0, foot: float = 0.0, slewing: bool = False) -> Machine:
    """The excavator, its first joint turned by an angle [rad], or the boom's foot on what slews.

    It stands on narrow tracks, so that at some places it tips before its cylinders give way.
    """
    plain, (x, z) = named("excavator_20t"), FOOT
    text, urdf = plain.text + STABILITY, plain.urdf_text
    turned = {
        '<child link="platform"/>\n    <origin xyz="0 0 0" rpy="0 0 0"/>': (
            f'<child link="platform"/>\n    <origin xyz="0 0 0" rpy="0 0 {root!r}"/>'
        ),
        f'<origin xyz="{x} 0 {z}" rpy="0 0 0"/>': (
            f'<origin xyz="{x * math.cos(foot)!r} {x * math.sin(foot)!r} {z}" rpy="0 0 {foot!r}"/>'
        ),
    }
    for old, new in turned.items():
        assert urdf.count(old) == 1
        urdf = urdf.replace(old, new)
    machine = Machine.from_text(text, urdf, plain.source)
    return machine.replace({"joints": ["swing", *machine.joints]}) if slewing else machine


TURNED = [*((yaw, 0.0) for yaw in YAWS), *((0.0, yaw) for yaw in YAWS), (2.0, -0.7)]


@pytest.mark.parametrize(("root", "foot"), TURNED)
def test_lift_chart_and_reach_of_a_turned_machine(root: float, foot: float) -> None:
    """An arm along y never tipped, one along −x had no chart and reaches below 0."""
    machine, plain = excavator(root, foot), excavator()
    chart, wanted = ad.lift_chart(machine), ad.lift_chart(plain)
    assert "tipping" in wanted.limiting
    assert set(wanted.limiting) != {"tipping"}
    for name in ("reach", "height", "capacity", "hydraulic", "tipping", "q"):
        got, known = getattr(chart, name), getattr(wanted, name)
        np.testing.assert_allclose(got, known, rtol=1e-7, atol=1e-9)
    assert chart.limiting == wanted.limiting
    figures, known = reach_figures(machine), reach_figures(plain)
    assert vars(figures) == pytest.approx(vars(known), abs=1e-6)
    ahead = np.array([math.cos(root + foot), math.sin(root + foot)])
    np.testing.assert_allclose(machine.heading.at(machine.ranges[None, :, 0])[0], ahead, atol=1e-9)


@pytest.mark.parametrize(("root", "foot"), [(math.pi / 2, 0.0), (0.0, math.pi), (2.0, -0.7)])
def test_tipping_of_a_turned_machine_that_slews(root: float, foot: float) -> None:
    """At all turns of the slew: the standing excavator's, in the same pose of its arm."""
    machine, plain = excavator(root, foot, slewing=True), excavator()
    q = inner_poses(plain, 9)
    slewed = np.column_stack([np.linspace(-3, 3, len(q)), q])
    at = np.array([9.0, 0.0, 0.1])  # beyond the bucket, ahead of the front line at every pose
    tips, centres, reaches = [], [], []
    for one, poses in ((plain, q), (machine, slewed)):
        rigid = one.rigid_poses(poses)
        place = one.arm.point(rigid, "boom", at)
        reaches.append(one.heading.reach(poses, place))
        tips.append(tipping_masses(one, rigid, one.heading.ahead(poses, place)))
        centres.append(centre_ahead(one, rigid))
    assert np.isfinite(tips[0]).all()
    np.testing.assert_allclose(tips[1], tips[0], rtol=1e-9)
    np.testing.assert_allclose(reaches[1], reaches[0], rtol=1e-9)
    np.testing.assert_allclose(centres[1], centres[0], atol=1e-9)


@pytest.mark.parametrize(("root", "foot"), [(math.pi, 0.0), (0.0, 1.5708)])
def test_a_design_of_a_turned_machine_keeps_the_lift(root: float, foot: float) -> None:
    """The default ``lift_share`` has a slack for each cylinder, and new sizes are the same."""
    designs = [
        ad.size_cylinders(one, ad.Workspace.grid(one, 3))
        for one in (excavator(), excavator(root, foot))
    ]
    wanted, got = ([(one.bore, one.rod) for one in each.machine.cylinders] for each in designs)
    np.testing.assert_allclose(got, wanted, atol=1e-9)
    shares = [{k for k in each.slacks if k.startswith("lift_share")} for each in designs]
    assert shares[0] == shares[1] != set()


@pytest.mark.parametrize(("root", "foot"), [(math.pi, 0.0), (0.0, 1.5708)])
def test_maps_and_pictures_of_a_turned_machine(root: float, foot: float) -> None:
    """Reach maps have the same cells, and a picture shows the arm in its plane, pointing ahead."""
    machine, plain = excavator(root, foot), excavator()
    maps = [
        ad.frequency_map(one, ad.Workspace.grid(one, [4, 4, 3])).reach_map(8)
        for one in (plain, machine)
    ]
    for name in ("reach", "height", "frequency"):
        got, wanted = getattr(maps[1], name), getattr(maps[0], name)
        np.testing.assert_allclose(got, wanted, rtol=1e-5, atol=1e-5)
    assert maps[0].reach.max() > 5
    q = inner_poses(plain, 3)
    views = [side_view(one, q) for one in (plain, machine)]
    np.testing.assert_allclose(views[1].points, views[0].points, atol=1e-9)
    np.testing.assert_allclose(views[1].tool, views[0].tool, atol=1e-9)
    tool = machine.arm.point(machine.arm.kinematics(q), "bucket", np.array(machine.tool.at))
    np.testing.assert_allclose(views[1].tool[:, 0], machine.heading.reach(q, tool), atol=1e-9)


def test_the_plane_of_the_workspace_is_the_arm_s() -> None:
    """Poses with the tool on the middles of cells: the same ones, whatever way the arm points."""
    spaces = [ad.Workspace.reach_plane(one, 5) for one in (excavator(), excavator(0.0, math.pi))]
    np.testing.assert_allclose(spaces[1].q, spaces[0].q, atol=1e-6)


def test_a_tool_behind_its_joint() -> None:
    """The paper's lever with its tool 1 m along −x points there; the joint's axis stays."""
    lever = named("paper_1dof")
    behind = lever.replace({"tool.at_mm": [-1000, 0, 150]})
    np.testing.assert_array_equal(lever.heading.forward, [1, 0, 0])
    np.testing.assert_array_equal(behind.heading.forward, [-1, 0, 0])
    assert reach_figures(behind).reach == pytest.approx(math.hypot(1, 0.15))
    assert "tool" not in odd({"tool.at_mm": [-1000, 0, 150]}, "paper_1dof")


@pytest.mark.parametrize("off", [-0.1, 0.0, 0.1])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_tool_over_its_axis_says_nothing(off: float, sign: int) -> None:
    """A mast of 4 m that leans as far to both sides: ahead is what a positive angle raises, also
    where the tool is 0.1 m beside it.
    """
    mast = Joint("mast", "root", rpy=(0, -math.pi / 2, 0), axis=(0, -sign, 0), limits=(-0.5, 0.5))
    lift = CylinderSpec("lift", ("root", (0.9, 0, 0)), ("mast", (1.5, 0, 0.0)))
    machine = build([mast], [lift], more="", order=["mast"])
    machine = replace(machine, tool=replace(machine.tool, link="mast", at=(4.0, 0.0, off)))
    np.testing.assert_allclose(machine.heading.forward, [sign, 0, 0], atol=1e-12)


def test_slides_and_slews_alone() -> None:
    """A slide points where it goes out with its tool, a column's arm where its tool is."""
    slide = Joint("out", "root", axis=(0, 1, 0), kind="prismatic", limits=(0.1, 0.9))
    push = CylinderSpec("push", ("root", (0.0, -1.0, 0.1)), ("out", (0, 0.2, 0.1)))
    machine = build([slide], [push])
    for reach, sign in ((2.0, 1), (-2.0, -1)):
        there = replace(machine, tool=replace(machine.tool, link="out", at=(0.0, reach, 0.0)))
        np.testing.assert_allclose(there.heading.forward, [0, sign, 0], atol=1e-12)
    column = Joint("column", "root", axis=(0, 0, 1), limits=(-1.0, 1.0))
    ram = CylinderSpec("ram", ("root", (0.3, -1.0, 0.0)), ("column", (0.3, 0.0, 0.0)))
    alone = build([column], [ram])
    alone = replace(alone, tool=replace(alone.tool, link="column", at=(-3.0, 3.0, 1.0)))
    half = math.sqrt(0.5)
    np.testing.assert_allclose(alone.heading.forward, [-half, half, 0], atol=1e-12)
    turned = alone.heading.at(np.array([[math.pi / 4]]))
    np.testing.assert_allclose(turned, [[-1, 0]], atol=1e-12)


def test_two_slews_and_a_crossing_joint() -> None:
    """Boom and stick outvote a joint that rolls the column; two slews turn the arm together."""
    first = Joint("column", "root", axis=(0, 0, 1), limits=(-3, 3))
    second = Joint("post", "column", xyz=(0.5, 0, 0), axis=(0, 0, -1), limits=(-1, 1))
    boom = replace(BOOM, parent="post", rpy=(0, 0, math.pi / 2))
    motors = MOTOR + MOTOR.replace("column", "post")
    lift = replace(LIFT, base=("post", (0, 0.7, 0.1)))
    machine = build([first, second, boom, STICK], [lift, FOLD], more=motors)
    np.testing.assert_allclose(machine.heading.forward, [0, 1, 0], atol=1e-12)
    ahead = machine.heading.at(np.array([[1.2, 0.4, 0.0, 0.0]]))[0]
    angle = math.pi / 2 + 1.2 - 0.4
    np.testing.assert_allclose(ahead, [math.cos(angle), math.sin(angle)], atol=1e-12)
    rolled = replace(first, axis=(1, 0, 0), limits=(-0.1, 0.1))
    over = build([rolled, replace(BOOM, parent="column"), STICK],
                 [replace(LIFT, base=("column", (0.7, 0, 0.1))), FOLD], more=MOTOR)  # fmt: skip
    np.testing.assert_allclose(over.heading.forward, [1, 0, 0], atol=1e-12)


def test_a_frozen_boom_counts() -> None:
    """Seen from the boom's pin, frozen or not, a stick that folds back is ahead."""
    back = replace(STICK, rpy=(0, 2.2, 0))
    joints, cylinders = [BOOM, back], [LIFT, replace(FOLD, rod_end=("stick", (-0.4, 0, -0.25)))]
    for order in (["boom", "stick"], ["stick"]):
        machine = build(joints, cylinders, order=order, payload=("stick", (1.5, 0, 0)))
        np.testing.assert_allclose(machine.heading.forward, [1, 0, 0], atol=1e-12)
        assert reach_figures(machine).reach > 1.5


SPRING = '\n[spring.{0}]\njoint = "{0}"\nstiffness_N_m_per_rad = 1e7\n'


@pytest.mark.parametrize("order", [["boom", "roll"], ["roll", "boom"]])
@pytest.mark.parametrize("springs", [0, 2])
def test_what_rolls_does_not_turn_an_arm(order: list[str], springs: int) -> None:
    """Neither two springs below it nor a tool that rolls about it, in whatever order of q."""
    below = [
        Joint(f"bank{k}", f"bank{k - 1}" if k else "root", axis=(1, 0, 0)) for k in range(springs)
    ]
    boom = replace(BOOM, parent=below[-1].name if below else "root")
    roll = Joint("roll", "boom", xyz=(2.5, 0, 0), axis=(1, 0, 0))
    turn = CylinderSpec("turn", ("boom", (2.4, -0.5, 0.4)), ("roll", (0, 0.5, 0.4)))
    machine = build(
        [*below, boom, roll],
        [replace(LIFT, base=(boom.parent, (0.7, 0, 0.1))), turn],
        order=order,
        more="".join(SPRING.format(one.name) for one in below),
    )
    np.testing.assert_allclose(machine.heading.forward, [1, 0, 0], atol=1e-12)


@pytest.mark.parametrize("turn", [0.0, math.pi, 1.0])
@pytest.mark.parametrize("rolled", [False, True])
def test_a_pitch_is_of_the_x_axis_however_a_frame_is_rolled_about_it(
    turn: float, rolled: bool
) -> None:
    """Its rise over its way along forward; the file may turn the arm about the vertical."""
    stick = replace(STICK, rpy=(math.pi, 0.7, 0), axis=(0, 1, 0)) if rolled else STICK
    base = Joint("base", "root", rpy=(0, 0, turn), kind="fixed")
    lift = replace(LIFT, base=("base", (0.7, 0, 0.1)))
    fold = replace(FOLD, rod_end=("stick", (-0.4, 0, -0.25 if rolled else 0.25)))
    joints = [base, replace(BOOM, parent="base"), stick]
    machine = build(joints, [lift, fold], order=["boom", "stick"], payload=("stick", (1.5, 0, 0)))
    rigid = machine.rigid_poses(inner_poses(machine, 9))
    x = machine.arm.link_rotation(rigid, "stick")[:, :, 0]
    forward = np.array([math.cos(turn), math.sin(turn), 0])
    pitch = machine.heading.pitch(rigid, "stick")
    np.testing.assert_allclose(pitch, np.arctan2(x[:, 2], x @ forward), atol=1e-12)
    assert np.ptp(pitch) > 0.2
    slopes = machine.heading.pitch_slopes(rigid, "stick", (0, 1))
    np.testing.assert_allclose(slopes, 1.0, rtol=1e-12)  # both joints raise it
