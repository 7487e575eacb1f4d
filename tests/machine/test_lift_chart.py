"""Lift charts: places and capacities by independent planar arms, by hand, and by brute force."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import armdesign as ad
from armdesign import ArmDesignError, LiftChart, Machine
from armdesign.inspection.inspection import inspect
from armdesign.machine.lifting import liftable_masses, torque_per_mass
from armdesign.machine.tipping import moving_mass, tipping_masses
from armdesign.mechanism.linkage.base import moment_arms
from tests.machines import BOOM, BUCKET, FOLD, LIFT, STICK, CylinderSpec, Joint, build, named
from tests.planar_arm import at
from tests.planar_file import read_payload
from tests.reference_planar import Reference
from tests.slewing_tables import MOTOR

SHARE, G = 0.87, 9.81  # ISO 10567; m/s²


def _elbows(reference: Reference, x: float, z: float) -> list[tuple[float, float]]:
    """Boom and stick angles that bring the bucket's pin to a place, by the law of cosines."""
    frames = reference.frames(np.zeros((1, len(reference.joints))))
    foot, elbow, nose = (np.array([frames[k][0][0], frames[k][1][0]]) for k in reference.joints)
    first, second = elbow - foot, nose - elbow
    a, b = np.hypot(*first), np.hypot(*second)
    distance = math.hypot(x - foot[0], z - foot[1])
    if not abs(a - b) < distance < a + b:
        return []
    turn = math.acos((distance**2 - a**2 - b**2) / (2 * a * b))
    resting = math.atan2(second[1], second[0]) - math.atan2(first[1], first[0])
    angles = []
    for fold in (turn, -turn):
        boom = math.atan2(z - foot[1], x - foot[0])
        boom -= math.atan2(b * math.sin(fold), a + b * math.cos(fold))
        angles.append((boom - math.atan2(first[1], first[0]), fold - resting))
    return angles


def _capacity(reference: Reference, q: np.ndarray, pressure: np.ndarray) -> float:
    """Least mass that a cylinder lifts at the bucket's pin, by forces without it and with 1 t."""
    for name, mass in (("none", 0), ("tonne", 1000)):
        table = {"mass_kg": mass, "link": "bucket", "at_mm": [0, 0, 0]}
        reference.cases[name] = read_payload(name, table)
    bare, loaded = (reference.forces(q[None], name)[0] for name in ("none", "tonne"))
    per_kg = (loaded - bare) / 1000
    back = reference.return_pressure
    push = pressure * reference.bore_areas - back * reference.annulus_areas
    pull = pressure * reference.annulus_areas - back * reference.bore_areas
    held = np.where(per_kg > 0, push, -pull)
    works = np.abs(per_kg) > 1e-9
    return float(((SHARE * held - bare)[works] / per_kg[works]).min())


CHARTS = {  # step, points: counted in the trials on grids of 1.5 m from 3 m
    "excavator_20t": (1.5, 25),
    "excavator_12t": (1.5, 17),
    "mini_excavator_2t": (0.5, 23),
}


@pytest.mark.parametrize("reliefs", [{}, {"boom": 130, "stick": 110}], ids=["supply", "reliefs"])
@pytest.mark.parametrize("name", CHARTS)
def test_chart_by_an_independent_planar_arm(name: str, reliefs: dict[str, float]) -> None:
    """Places by the law of cosines within the reference's own joint ranges, capacities by its own
    static forces; the bucket at the middle of its range. A cylinder whose port relief opens below
    the supply's pressure [bar] has no more than the relief's.
    """
    machine, reference = named(name), Reference.load(Path(named(name).source))
    machine = machine.replace(
        {f"cylinder.{c}.valve.relief_bar": float(bar) for c, bar in reliefs.items()}
    )
    pressure = np.array(
        [1e5 * reliefs.get(c.name, reference.supply_pressure / 1e5) for c in machine.cylinders]
    )
    step, count = CHARTS[name]
    chart = ad.lift_chart(machine)
    assert (chart.poses.step, len(chart.reach)) == (step, count)
    (low, high) = np.transpose(reference.ranges)
    expected = {}
    for i in range(2, 12):
        for k in range(-12, 13):
            for boom, stick in _elbows(reference, i * step, k * step):
                q = np.array([boom, stick, (low[2] + high[2]) / 2])
                if np.all((q >= low) & (q <= high)):
                    mass = _capacity(reference, q, pressure)
                    expected[i, k] = max(mass, expected.get((i, k), 0.0))
    places = np.rint(np.column_stack([chart.reach, chart.height]) / step).astype(int)
    assert set(map(tuple, places)) == set(expected)
    wanted = [expected[i, k] for i, k in places]
    np.testing.assert_allclose(chart.capacity, wanted, rtol=1e-5)  # ranges differ by 1e-6 rad


def test_one_joint_by_hand() -> None:
    """A massless lever on one cylinder that is pulled: capacity = 0.87 F r / (g x), with the
    moment arm r from the triangle of joint and pins.
    """
    machine = named("paper_1dof")
    chart = ad.lift_chart(machine)
    (cylinder,), supply = machine.cylinders, machine.supply
    pull = supply.pressure * cylinder.annulus_area - supply.return_pressure * cylinder.bore_area
    for q, x, z, mass in zip(
        chart.q[:, 0], chart.reach, chart.height, chart.capacity, strict=True
    ):
        rod_end = 0.15 * np.array([-math.sin(q), math.cos(q)])
        along = (rod_end - (-0.5, 0.0)) / np.hypot(*(rod_end - (-0.5, 0.0)))
        arm = abs(rod_end[0] * along[1] - rod_end[1] * along[0])
        assert mass == pytest.approx(SHARE * pull * arm / (G * x), rel=2e-9)  # x to 1e-9 m
        assert math.hypot(x, z) == pytest.approx(math.hypot(1.0, 0.15), rel=2e-9)
        assert z / chart.poses.step == pytest.approx(round(z / chart.poses.step), abs=1e-9)


def two_elbows() -> Machine:
    """A boom on a cylinder and a stick on a motor without end: two ways to most places."""
    boom = replace(BOOM, limits=(-0.7, 0.6))
    stick = replace(STICK, kind="continuous", rpy=(0, 0, 0))
    motor = (
        "[motor.turn]\njoint = 'stick'\ndisplacement_cm3 = 160\ngear_ratio = 24\n"
        "trapped_volume_l = { a = 0.6, b = 0.9 }"
    )
    return build([boom, stick], [LIFT], payload=("stick", (1.0, 0, 0)), more=motor)


def test_of_several_poses_the_one_that_lifts_most() -> None:
    """Both elbows by the law of cosines, with links of 2.5 m and 1 m from (0.1, 0.5) m."""
    machine = two_elbows()
    chart = ad.lift_chart(machine)
    low, high = machine.ranges.T
    places = 0
    for reach, height, capacity in zip(chart.reach, chart.height, chart.capacity, strict=True):
        x, z = reach - 0.1, height - 0.5
        turn = math.acos((x**2 + z**2 - 2.5**2 - 1) / (2 * 2.5))
        fold = np.array([turn, -turn])
        boom = math.atan2(z, x) - np.arctan2(np.sin(fold), 2.5 + np.cos(fold))
        q = np.column_stack([boom, fold])
        rigid = machine.rigid_poses(q[np.all((q >= low) & (q <= high), axis=1)])
        torque = torque_per_mass(machine, rigid, chart.poses.point)
        arms = moment_arms(machine.drives, rigid)
        masses = liftable_masses(machine, rigid, arms, torque, SHARE).min(axis=1)
        assert capacity == pytest.approx(max(masses.max(), 0.0), rel=1e-9)
        places += len(masses) == 2 and abs(masses[0] - masses[1]) > 10
    assert places >= 5


STABLE = """
[stability]
mass_kg = {mass}
at_mm = [{x}, 0, 0]
front_mm = {front}
rear_mm = {rear}
"""


def _standing(machine: Machine, **numbers: float) -> Machine:
    text = machine.text + STABLE.format(**numbers)
    return Machine.from_text(text, machine.urdf_text, machine.source)


def _parts(chart: LiftChart) -> tuple[list[float], list[str]]:
    return list(chart.capacity), list(chart.limiting)


def test_tipping_of_a_massless_lever_by_hand() -> None:
    """M = 300 kg 0.2 m behind the axis, the line 0.1 m ahead: 0.75 · 300 · 0.3 / (x − 0.1)."""
    plain = ad.lift_chart(named("paper_1dof"))
    machine = _standing(named("paper_1dof"), mass=300, x=-200, front=100, rear=0)
    chart = ad.lift_chart(machine)
    by_hand = 0.75 * 300 * 0.3 / (chart.reach - 0.1)
    np.testing.assert_allclose(chart.tipping, by_hand, rtol=1e-8)  # reach to 1e-9 m
    np.testing.assert_allclose(chart.capacity, np.minimum(plain.capacity, by_hand), rtol=1e-8)
    assert set(chart.limiting) == {"tipping"}
    heavy = ad.lift_chart(_standing(named("paper_1dof"), mass=9000, x=-200, front=100, rear=0))
    assert _parts(heavy) == _parts(plain)
    light = ad.lift_chart(_standing(named("paper_1dof"), mass=0, x=0, front=100, rear=0))
    assert set(light.capacity) == {0.0}


def test_behind_the_rear_line() -> None:
    """A load 2 m behind the axis turns about the line 0.5 m behind it: M (x + 0.5) / 1.5."""
    machine = _standing(named("paper_1dof"), mass=300, x=100, front=100, rear=500)
    rigid = machine.rigid_poses([[0.0], [0.1], [0.2]])
    masses = tipping_masses(machine, rigid, np.array([-2.0, 0.0, -0.5]))
    np.testing.assert_allclose(masses, [300 * 0.6 / 1.5, np.inf, np.inf])


def test_own_weights_by_the_independent_planar_arm() -> None:
    """Mass and moment of boom, stick and bucket about the slew axis, by the reference's bodies;
    with the swing as a joint too, which moves the upper structure but does not count it.
    """
    machine, reference = named("excavator_20t"), Reference.load(named("excavator_20t").source)
    q = np.random.default_rng(0).uniform(*machine.ranges.T, (5, 3))
    frames = reference.frames(q)
    bodies = [body for body in reference.bodies if frames_move(frames, body.link)]
    mass, moment = moving_mass(machine, machine.rigid_poses(q))
    assert mass == pytest.approx(sum(body.mass for body in bodies), rel=1e-12)
    along = [b.mass * at(frames, b)[0] for b in bodies]
    np.testing.assert_allclose(moment, sum(along), rtol=1e-9)
    slewing = machine.replace({"joints": ["swing", "boom", "stick", "bucket"]})
    turned = slewing.rigid_poses(np.column_stack([np.linspace(-3, 3, 5), q]))
    slewed = moving_mass(slewing, turned)
    assert slewed[0] == pytest.approx(mass, rel=1e-12)
    np.testing.assert_allclose(slewed[1], moment, rtol=1e-9)


def test_check_remarks_on_a_machine_that_tips_by_itself() -> None:
    """Its one mass, 300 kg, 120 mm beyond either edge, at every pose; with its arm's weight, by
    the reference's bodies, at the pose of those looked at whose centre of mass is furthest ahead.
    """

    def remarks(machine: Machine) -> dict[str, str]:
        found = inspect(machine, ad.Workspace.grid(machine, points=5)).findings()
        return {one.part: one.words for one in found if one.part.startswith("stability")}

    for x, edge, where in ((220, "front", "ahead of"), (-220, "rear", "behind")):
        machine = _standing(named("paper_1dof"), mass=300, x=x, front=100, rear=100)
        (part,), (words,) = zip(*remarks(machine).items(), strict=True)
        assert part == f"stability.{edge}_mm"
        assert words.startswith(
            f"unloaded it tips over its {edge} edge at 100 % of the poses: its centre of mass is"
            f" up to 220.0 mm {where} the slew axis, 120.0 mm beyond that edge, at boom "
        )
    sound = _standing(named("paper_1dof"), mass=300, x=90, front=100, rear=100)
    assert remarks(sound) == {}
    machine, reference = named("excavator_20t"), Reference.load(named("excavator_20t").source)
    standing = _standing(machine, mass=15000, x=-500, front=300, rear=1500)
    q = ad.Workspace.grid(machine, points=5).q
    frames = reference.frames(q)
    bodies = [body for body in reference.bodies if frames_move(frames, body.link)]
    moment = sum(b.mass * at(frames, b)[0] for b in bodies) - 15000 * 0.5
    centre = float(np.max(moment) / (15000 + sum(b.mass for b in bodies)))
    assert f"up to {1000 * centre:.1f} mm ahead" in remarks(standing)["stability.front_mm"]


def frames_move(frames: dict[str, tuple[np.ndarray, ...]], link: str) -> bool:
    return bool(np.ptp(frames[link][2]) > 0)


def test_slewing_changes_no_chart() -> None:
    """The same places and masses with the swing as a joint, at the middle of its range."""
    machine = named("excavator_20t")
    slewing = machine.replace({"joints": ["swing", "boom", "stick", "bucket"]})
    one, other = ad.lift_chart(machine), ad.lift_chart(slewing)
    np.testing.assert_allclose(other.capacity, one.capacity, rtol=1e-9)
    assert other.limiting == one.limiting


def test_a_slew_on_a_base_that_is_not_level_brings_no_point_to_its_place() -> None:
    """Slewing moves heights there, too; the chart is that of a column that stands still."""
    column = Joint("column", "root", rpy=(0.05, -0.07, 0), axis=(0, 0, 1), kind="continuous")
    joints = [column, replace(BOOM, parent="column"), replace(STICK, limits=(-0.7, 0.6))]
    cylinders = [replace(LIFT, base=("column", (0.7, 0, 0.1))), FOLD]
    slewing = ad.lift_chart(build(joints, cylinders, more=MOTOR))
    joints[0] = replace(column, kind="fixed")
    standing = ad.lift_chart(build(joints, cylinders, order=["boom", "stick"]))
    np.testing.assert_allclose(slewing.reach, standing.reach)
    np.testing.assert_allclose(slewing.height, standing.height)
    np.testing.assert_allclose(slewing.q, np.insert(standing.q, 0, 0.0, axis=1), atol=1e-9)
    np.testing.assert_allclose(slewing.capacity, standing.capacity, rtol=1e-9)
    assert len(slewing.reach) >= 3


def test_the_usual_grid_is_finer_where_the_tool_has_a_narrow_range() -> None:
    """A loader, whose tool its own boom and four-bar keep 3 to 4 m away: the usual grid is the
    first of the round ones with six places, and its chart that of the file with its step.
    """
    boom = replace(BOOM, xyz=(0, 0, 1.9))
    bucket = replace(BUCKET, parent="boom", xyz=(2.6, 0, 0), com=(0.5, 0, 0.2))
    lift = CylinderSpec("lift", ("root", (0.3, 0, 0.9)), ("boom", (1.3, 0, -0.1)))
    base, pivot, lug = (0.4, 0, 0.6), (2.2, 0, 0.2), (0.1, 0, 0.35)
    tilt = CylinderSpec("tilt", ("boom", base), pivot=("boom", pivot), lug=("bucket", lug))
    chart = ad.lift_chart(build([boom, bucket], [lift, tilt]))
    assert (chart.poses.step, chart.poses.start) == (0.2, 0.4)

    def stated(step: float) -> LiftChart:
        table = f"[lift_chart]\nstep_m = {step}"
        return ad.lift_chart(build([boom, bucket], [lift, tilt], more=table))

    assert all(len(stated(step).reach) < 6 for step in (0.3, 0.5))
    assert len(chart.reach) >= 6
    pd.testing.assert_frame_equal(stated(0.2).frame, chart.frame)


def test_the_table_says_point_joints_and_grid() -> None:
    """The stick's own pin of the bucket is the default point; other joints, step and start."""
    machine = named("excavator_20t")
    (nose,) = {joint.translation[0] for joint in machine.arm.joints if joint.name == "bucket"}
    text = '[lift_chart]\nlink = "stick"\nat_mm = [{x}, 0, 0]\njoints = ["{a}", "{b}"]\n{more}\n'

    def chart(a: str, b: str, more: str = "") -> LiftChart:
        table = text.format(x=1000 * nose, a=a, b=b, more=more)
        return ad.lift_chart(
            Machine.from_text(machine.text + table, machine.urdf_text, machine.source)
        )

    assert _parts(chart("boom", "stick"))[1] == _parts(ad.lift_chart(machine))[1]
    np.testing.assert_allclose(chart("boom", "stick").capacity, ad.lift_chart(machine).capacity)
    fine = chart("stick", "boom", "step_m = 0.75\nfrom_m = 1.5")
    assert fine.reach.min() == 1.5
    np.testing.assert_allclose(np.unique(np.diff(np.unique(fine.reach))), 0.75)
    columns = ["reach_m", "height_m", "capacity_kg", "limiting", "boom", "stick", "bucket"]
    assert list(fine.frame) == columns


BAD = [
    ("step_m = 0", r"lift_chart.step_m: 0 is not allowed; give a number in \(0, 100\]"),
    ("step_m = -1", r"lift_chart.step_m: -1 is not allowed"),
    ("from_m = -1", r"lift_chart.from_m: -1 is not allowed"),
    ('link = "moon"', r'lift_chart.link: no link "moon" in the URDF; choose from'),
    ('joints = ["boom", "knee"]', r'lift_chart.joints: no joint "knee"; choose from: boom'),
    ('joints = ["boom", "boom"]', r"lift_chart.joints: a joint is named twice"),
    (
        'joints = ["boom", "bucket"]',
        r'lift_chart.joints: "bucket" does not raise the point on the bucket; choose from: boom,',
    ),
    (
        'joints = ["boom", "stick", "bucket"]',
        r"lift_chart.joints: 3 joints, but two bring a point to a reach and a height; others stand"
        r" at the middle of their range: choose at most two of: boom, stick \(line \d+\)",
    ),
    (
        "from_m = 50",
        r"lift_chart.from_m: the chart begins at a reach of 50 m, beyond that of the point on the"
        r" bucket \(x 0, z 0 mm\); it reaches from 1.4 to 8.45 m: give from_m and step_m within",
    ),
    (
        "step_m = 12",
        r"lift_chart.step_m: the chart begins at a reach of 24 m, beyond .* from 1.4 to 8.45 m",
    ),
    (
        "step_m = 12\nfrom_m = 1",
        r"lift_chart.from_m: steps of 12 m from a reach of 1 m on: none meets the point on the",
    ),
    (
        'link = "boom"\nat_mm = [-20000, 0, 0]',  # behind the machine
        r"lift_chart.link: the point on the boom \(x -20000, z 0 mm\) is behind, at -\S+ to -\S+"
        r" m; give link and at_mm of a point ahead",
    ),
    ("step_m = 0.01", r"lift_chart.step_m: 0.01 m makes \d+ × \d+ places, more than 2000; give a"),
    ('link = "ground"', r"lift_chart.link: no joint raises the point on the ground; give link"),
]


@pytest.mark.parametrize(("table", "message"), BAD)
def test_charts_that_cannot_be(table: str, message: str) -> None:
    machine = named("excavator_20t")
    text = f"{machine.text}\n[lift_chart]\n{table}\n"
    with pytest.raises(ArmDesignError, match=message):
        ad.lift_chart(Machine.from_text(text, machine.urdf_text, machine.source))


@pytest.mark.parametrize("key", ["mass", "front", "rear"])
def test_negative_stability(key: str) -> None:
    numbers = {"mass": 1, "x": 1, "front": 1, "rear": 1} | {key: -1}
    with pytest.raises(ArmDesignError, match=rf"stability.{key}_\w+: -1 is not allowed; give a"):
        _standing(named("paper_1dof"), **numbers)
