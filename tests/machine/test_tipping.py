"""Tipping of machines whose slew leans or stands apart: by virtual work, and by continuity."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import armdesign as ad
from armdesign import Machine
from armdesign.machine.tipping import centre_ahead, tipping_masses
from tests.machines import BOOM, FOLD, LIFT, STICK, CylinderSpec, Joint, build
from tests.slewing_tables import MOTOR, stability
from tests.sprung import spring

COLUMN = Joint("column", "root", xyz=(0.6, 0.2, 0.8), axis=(0, 0, 1), limits=(-3, 3), mass=700)
STABILITY = stability(900, [-300, 0, 0], 900, 1000)


def _leaning(
    roll: float,
    pitch: float,
    limits: tuple[float, float] = (-3, 3),
    order: list[str] | None = None,
) -> Machine:
    """A column that leans by two angles [rad], boom and stick."""
    column = replace(COLUMN, rpy=(roll, pitch, 0), limits=limits)
    lift = replace(LIFT, base=("column", (0.7, 0, 0.1)))
    joints = [column, replace(BOOM, parent="column"), STICK]
    return build(joints, [lift, FOLD], order=order, more=MOTOR + STABILITY)


def _tipping_by_virtual_work(
    lean: tuple[float, float], q: np.ndarray, point: tuple[float, ...], line: float
) -> float:
    """Work of all weights as the machine turns about a line on the ground, over that of 1 kg.

    Frames by scipy's rotations from the joints as the URDF has them; masses are the links', 900 kg
    0.3 m behind the slew axis, and the kilogram at the stick's point. Of a line behind the axis
    the distance is negative. Differences of ± 1e-6 rad leave their square.
    """
    turn, up = Rotation.from_rotvec, np.array([0, 0, 1.0])
    leaning, root = Rotation.from_euler("xyz", [*lean, 0]), np.array(COLUMN.xyz)
    axis = leaning.apply(up)
    foot = root - root[2] / axis[2] * axis
    ahead = turn(q[0] * axis).apply(leaning.apply([1.0, 0, 0]))  # square to boom and column
    ahead = np.array([*ahead[:2], 0]) / math.hypot(*ahead[:2])
    frame, at = leaning * turn([0, 0, q[0]]), root
    weights = [(900.0, foot - 0.3 * ahead)]
    for joint, angle in zip((BOOM, STICK), q[1:], strict=True):
        at = at + frame.apply(joint.xyz)
        frame = frame * Rotation.from_euler("xyz", joint.rpy) * turn([0, -angle, 0])
        weights.append((joint.mass, at + frame.apply(joint.com)))
    edge = foot + line * ahead

    def work(mass: float, place: np.ndarray) -> float:
        turned = [turn(s * 1e-6 * np.cross(up, ahead)).apply(place - edge)[2] for s in (-1, 1)]
        return mass * (turned[1] - turned[0])

    return -sum(work(*weight) for weight in weights) / work(1.0, at + frame.apply(point))


@pytest.mark.parametrize("lean", [(0, 0), (0.5, 0), (0, -0.5), (10, 0), (0, 10), (-6, 8)])
def test_tipping_of_a_slew_that_leans(lean: tuple[float, float]) -> None:
    """Masses that tip it about both lines, all around, by virtual work from the joints."""
    roll, pitch = (math.radians(angle) for angle in lean)
    machine = _leaning(roll, pitch)
    turns = np.radians(np.arange(-170, 190, 40))
    q = np.column_stack([turns, np.linspace(-0.2, 0.2, 9), np.linspace(0.1, -0.25, 9)])
    rigid = machine.rigid_poses(q)
    for point, line in (((4.0, 0.0, 0.1), 0.9), ((-9.0, 0.0, 0.1), -1.0)):
        wanted = [_tipping_by_virtual_work((roll, pitch), pose, point, line) for pose in q]
        assert 0 < min(wanted) < max(wanted) < 10_000
        ahead = machine.heading.ahead(q, machine.arm.point(rigid, "stick", np.array(point)))
        np.testing.assert_allclose(tipping_masses(machine, rigid, ahead), wanted, rtol=1e-8)


@pytest.mark.parametrize("turn", [0.0, 1.6, 3.1])
def test_no_jump_where_a_slew_becomes_vertical(turn: float) -> None:
    """A slew that leans by 1e-5 rad: chart and centre of mass differ by as little, all around."""
    limits = (turn - 0.02, turn + 0.02)
    one, other = _leaning(0, 0, limits), _leaning(1e-5, -1e-5, limits)
    chart, near = ad.lift_chart(one), ad.lift_chart(other)
    np.testing.assert_allclose(near.reach, chart.reach, atol=1e-9)
    np.testing.assert_allclose(near.tipping, chart.tipping, rtol=1e-3)
    assert np.isfinite(chart.tipping).all()
    q = np.array([[turn, 0.1, -0.1]])
    centres = [centre_ahead(machine, machine.rigid_poses(q)) for machine in (one, other)]
    np.testing.assert_allclose(*centres, atol=1e-4)


def test_moments_do_not_turn_with_a_slew_apart_from_the_root() -> None:
    """Lines are ahead of the slew axis and behind it: all turns of a vertical one are alike."""
    machine = _leaning(0, 0)
    q = np.array([[turn, 0.1, -0.1] for turn in (0.0, 1.0, -2.5)])
    np.testing.assert_allclose(
        np.ptp(centre_ahead(machine, machine.rigid_poses(q))), 0, atol=1e-12
    )


@pytest.mark.parametrize("lean", [(0, 0), (0, 10), (-6, 8)])
@pytest.mark.parametrize("turn", [0.5, 1.57, -2.4])
def test_a_frozen_slew_is_one_that_stands_there(lean: tuple[float, float], turn: float) -> None:
    """Tips, reaches and heads as the machine does whose slew could move and is turned so far."""
    roll, pitch = (math.radians(angle) for angle in lean)
    free = _leaning(roll, pitch)
    frozen = _leaning(roll, pitch, order=["boom", "stick"]).replace({"frozen.column": turn})
    q = np.column_stack([np.linspace(-0.2, 0.2, 5), np.linspace(0.1, -0.25, 5)])
    turned = np.column_stack([np.full(len(q), turn), q])
    _assert_tips_and_reaches_alike((free, turned), (frozen, q))


def _assert_tips_and_reaches_alike(*machines: tuple[Machine, np.ndarray]) -> None:
    """Two machines, each at its own q of the same poses, with a load beyond the stick."""
    tips, places = [], []
    for machine, at in machines:
        rigid = machine.rigid_poses(at)
        tool = machine.arm.point(rigid, "stick", np.array([4.0, 0.0, 0.1]))
        places.append(machine.heading.reach(at, tool))
        tips.append(tipping_masses(machine, rigid, machine.heading.ahead(at, tool)))
    assert np.isfinite(tips[0]).all()
    np.testing.assert_allclose(*tips, rtol=1e-9)
    np.testing.assert_allclose(*places, rtol=1e-12)


@pytest.mark.parametrize("frozen", [False, True])
def test_a_blade_beside_a_slew_leaves_it_one(frozen: bool) -> None:
    """A blade of a microgram, which a cylinder lifts: the machine tips and heads as without it."""
    order = ["boom", "stick"] if frozen else ["column", "boom", "stick"]
    blade = Joint("blade", "root", xyz=(0.9, 0, 0.4), mass=1e-9)
    lift = replace(LIFT, base=("column", (0.7, 0, 0.1)))
    raises = CylinderSpec("blade", ("root", (0.5, 0, 0.8)), ("blade", (0.35, 0, 0.05)))
    joints = [COLUMN, replace(BOOM, parent="column"), STICK, blade]
    more = STABILITY if frozen else MOTOR + STABILITY
    beside = build(
        joints, [lift, FOLD, raises], order=["blade", *order], payload=("stick", (1, 0, 0)),
        more=more,
    )  # fmt: skip
    alone = build(joints[:3], [lift, FOLD], order=order, payload=("stick", (1, 0, 0)), more=more)
    q = np.array([[2.2, 0.2, 0.1], [-0.5, -0.2, -0.2]])[:, -len(order) :]
    _assert_tips_and_reaches_alike((alone, q), (beside, np.column_stack([[0.1, -0.1], q])))


def _on_a_base(kind: str, order: list[str]) -> Machine:
    """Column, boom and stick on a base that is fixed, or frozen or on a spring where it is so."""
    base = Joint("base", "root", axis=(0, 1, 0), limits=(-0.1, 0.1), mass=800.0)
    column = replace(COLUMN, parent="base")
    joints = [base, column, replace(BOOM, parent="column"), STICK]
    joints[0] = replace(base, kind="fixed" if kind == "fixed" else "revolute")
    more = MOTOR + STABILITY
    if kind == "spring":
        more += spring("tracks", "base", 1e8)
    lift = replace(LIFT, base=("column", (0.7, 0, 0.1)))
    return build(joints, [lift, FOLD], order=order, more=more)


@pytest.mark.parametrize("turn", [0.0, 1.2])
@pytest.mark.parametrize("order", [["column", "boom", "stick"], ["boom", "stick"]])
def test_a_base_that_rocks_at_rest_tips_as_a_fixed_one(order: list[str], turn: float) -> None:
    """Its mass is of ``[stability]``, and the slew on it turns what is ahead.

    It was taken for mass that the arm moves, and the slew for none: tipping loads were up to
    eight times too high.
    """
    q = np.column_stack([np.full(4, turn), np.linspace(-0.2, 0.2, 4), np.full(4, -0.1)])
    at, tips, reaches, masses = q[:, -len(order) :], [], [], []
    for kind in ("fixed", "frozen", "spring"):
        machine = _on_a_base(kind, order)
        if len(order) == 2:
            machine = machine.replace({"frozen.column": turn})
        rigid = machine.rigid_poses(at)
        tool = machine.arm.point(rigid, "stick", np.array([4.0, 0.0, 0.1]))
        reaches.append(machine.heading.reach(at, tool))
        tips.append(tipping_masses(machine, rigid, machine.heading.ahead(at, tool)))
        masses.append(centre_ahead(machine, rigid))
        idle = machine.joints_without_effect
        assert not (kind == "spring" and 0 in idle and len(order) == 3)  # it rocks another way
    assert np.isfinite(tips[0]).all()
    for values in (tips, reaches, masses):
        np.testing.assert_allclose(values[1], values[0], rtol=1e-9)
        np.testing.assert_allclose(values[2], values[0], rtol=1e-9)
