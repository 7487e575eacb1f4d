"""The shipped machines against what is known of them: their sources, data sheets, a second
implementation.

Where a number comes from:

- *source*: printed in the machine's source, see its SOURCE.md;
- *second*: computed from the same pins by an independent planar implementation, which printed the
  digits given here; its extremes over the workspace are maxima over samples, so they fall short of
  the true ones by up to 3 %;
- *by hand*: geometry done here.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET

import numpy as np
import pinocchio
import pytest
from matplotlib.patches import Polygon
from numpy.testing import assert_allclose

import armdesign as ad
from armdesign.design.requirements.check import check
from armdesign.machine.loading import shipped
from armdesign.machine.machine import Machine
from tests import machines
from tests.machine.shipped_facts import (
    EXCAVATORS,
    FACTS,
    MPA,
    REAL,
    SHIPPED,
    box,
    digging,
    reach_at_ground,
    source_text,
    sweep,
    tool_positions,
)

# ----------------------------------------------------------------------------- ranges and linkages


@pytest.mark.parametrize("name", SHIPPED)
def test_strokes_give_the_joint_limits(name: str) -> None:
    """With the URDF's limits 0.01 [rad, m] wider the strokes alone end the motion, within 0.06 mm
    of the limits.

    The limits are rounded to 1e-5 rad, and bore pins to 0.1 mm: 0.05 mm is what SOURCE.md states.
    """
    machine = machines.named(name)
    robot = ET.fromstring(machine.urdf_text)
    for limit in robot.findall("joint/limit"):
        for key, step in (("lower", -0.01), ("upper", 0.01)):
            if limit.get(key) is not None:
                limit.set(key, repr(float(str(limit.get(key))) + step))
    wider = Machine.from_text(machine.text, ET.tostring(robot, encoding="unicode"), machine.source)
    for linkage, cylinder in zip(wider.linkages, wider.cylinders, strict=True):
        (joint,) = linkage.joints
        ends = np.array([cylinder.closed_length, cylinder.open_length])
        at_limits = np.sort(linkage.length(machine.arm.kinematics(sweep(machine, joint, 2))))
        assert_allclose(at_limits, ends, rtol=0, atol=6e-5)
        by_stroke = np.sort(linkage.length(wider.arm.kinematics(sweep(wider, joint, 2))))
        assert_allclose(by_stroke, ends, rtol=0, atol=1e-9)
        least = (
            np.abs(machine.at(sweep(machine, joint)).moment_arms[:, :, joint]).max(axis=1).min()
        )
        assert_allclose(wider.ranges[joint], machine.arm.limits[joint], rtol=0, atol=6e-5 / least)


def test_ranges_of_the_exact_arm() -> None:
    """Source: the comment in MATLAB/simulation.m of eXactMPC, four decimals of lengths and
    angles.
    """
    stated = [(-0.4737, 1.0923), (-2.5848, -0.5103), (-2.8659, 0.7839)]
    assert_allclose(machines.named("mini_excavator_2t").ranges, stated, rtol=0, atol=1.1e-4)


def test_ranges_of_the_zx120() -> None:
    """Source: zx120.xacro, whole degrees (strokes of whole mm: 0.2°); the bucket stops 7° short of
    −143°.
    """
    ranges = np.degrees(machines.named("excavator_12t").ranges)
    assert_allclose(ranges[:2], [(-44, 70), (-152, -30)], rtol=0, atol=0.2)
    assert_allclose(ranges[2], (-135.6, 33), rtol=0, atol=0.2)


def test_bucket_range_of_the_zx200() -> None:
    """Source: zx200.xacro, three decimals; the other joints carry the Cat 320's strokes and
    differ.
    """
    assert_allclose(machines.named("excavator_20t").ranges[2], (-2.384, 0.650), rtol=0, atol=6e-4)


def test_paper_triangle() -> None:
    """By hand: law of cosines in the triangle d1 = 0.5, a1 = 0.15, ℓ with θ = 90° − q;
    right-angled at mid-stroke.
    """
    machine = machines.named("paper_1dof")
    d1, a1, stroke = 0.5, 0.15, 0.2
    middle = math.hypot(d1, a1)
    ends = [
        math.pi / 2 - math.acos((d1**2 + a1**2 - x**2) / (2 * d1 * a1))
        for x in (middle + 0.1, middle - 0.1)
    ]
    assert_allclose(machine.ranges[0], ends, rtol=0, atol=1e-6)
    poses = machine.at([[0.0]])
    assert_allclose(poses.lengths[0, 0], middle, rtol=0, atol=1e-9)
    assert_allclose(poses.extensions[0, 0], 0.5, rtol=0, atol=1e-7)
    assert_allclose(abs(poses.moment_arms[0, 0, 0]), d1 * a1 / middle, rtol=1e-12)
    assert machine.cylinders[0].stroke == pytest.approx(stroke)
    # l2 = 1 m, any g
    assert_allclose(poses.gravity_torque[0, 0], machine.payload.mass * 9.81 * 1.0, rtol=1e-3)


@pytest.mark.parametrize("name", REAL)
def test_moment_arms(name: str) -> None:
    """Second, four decimals: half a digit, and half a digit for its own sampling."""
    machine = machines.named(name)
    for i, (linkage, cylinder) in enumerate(zip(machine.linkages, machine.cylinders, strict=True)):
        (joint,) = linkage.joints
        arms = np.abs(machine.at(sweep(machine, joint)).moment_arms[:, i, joint])
        assert_allclose(
            (arms.min(), arms.max()), FACTS[name].moment_arms[cylinder.name], rtol=0, atol=1e-4
        )


@pytest.mark.parametrize("name", REAL)
def test_dead_lengths(name: str) -> None:
    """By hand: closed length less stroke, whole millimetres."""
    dead = {c.name: c.dead_length for c in machines.named(name).cylinders}
    assert dead == pytest.approx(FACTS[name].dead_lengths, abs=1e-9)


def test_sourced_tilt_stroke_folds_the_crane_through_itself() -> None:
    """Why the stroke is clipped: at the sourced 1050 + 780 mm the tilt boom has turned past the
    lift boom, −180°.
    """
    machine = machines.named("loader_crane")
    folded = np.radians([[0.0, -180.0, 0.0], [0.0, -190.6, 0.0]])
    lengths = machine.linkages[1].length(machine.arm.kinematics(folded))
    assert lengths[0] < 1.050 + 0.780
    assert lengths[1] == pytest.approx(1.050 + 0.780, abs=1e-4)


# --------------------------------------------------------------------------------------- workspace


@pytest.mark.parametrize("name", REAL)
def test_reach_height_depth(name: str) -> None:
    """Second, whole centimetres: one centimetre, for its rounding and its samples."""
    facts, tool = FACTS[name], tool_positions(name)
    assert tool[:, 0].max() == pytest.approx(facts.reach, abs=0.011)
    assert tool[:, 2].max() == pytest.approx(facts.height, abs=0.011)
    assert -tool[:, 2].min() == pytest.approx(facts.depth, abs=0.011)
    # there a band of samples near the ground, which reaches up to 1 % further
    if facts.reach_at_ground is not None:
        assert reach_at_ground(name) == pytest.approx(facts.reach_at_ground, rel=0.01)


def test_retracted_tip_of_the_crane() -> None:
    """Source: the MATLAB model hangs the load at (2113, 260) mm in the frame of the tilt boom."""
    machine = machines.named("loader_crane")
    poses = machine.arm.kinematics(np.array([[0.3, -1.2, 0.0]]))
    tip = machine.arm.point(poses, "extension", np.array(machine.tool.at))
    assert_allclose(
        tip, machine.arm.point(poses, "tilt_boom", np.array([2.113, 0, 0.260])), rtol=0, atol=1e-9
    )


def test_lengths_of_the_zx120() -> None:
    """Source: zx120.xacro gives the next joint's place by components, to 0.1 mm and 0.01 mm."""
    machine = machines.named("excavator_12t")
    poses = machine.arm.kinematics(np.zeros((1, 3)))
    boom, stick, bucket = (
        machine.arm.point(poses, k, np.zeros(3))[0] for k in ("boom", "stick", "bucket")
    )
    assert np.linalg.norm(stick - boom) == pytest.approx(math.hypot(4.2241, 1.7311), abs=1e-4)
    assert np.linalg.norm(bucket - stick) == pytest.approx(math.hypot(0.35383, 2.4712), abs=1e-4)


# ------------------------------------------------------------------ forces, pressures, frequencies


@pytest.mark.parametrize("name", EXCAVATORS)
def test_digging_forces(name: str) -> None:
    """Second, 0.1 kN and 0.1°: half a digit of the force; the best angle lies on a flat maximum, ±
    0.15°.
    """
    for cylinder, (force, angle) in digging(name).items():
        assert force == pytest.approx(FACTS[name].digging[cylinder][0], abs=0.06)
        assert angle == pytest.approx(FACTS[name].digging[cylinder][1], abs=0.15)


@pytest.mark.parametrize("name", REAL)
def test_static_pressures_under_full_payload(name: str) -> None:
    """Second, 0.1 MPa, maxima over a coarse grid: ours are not lower but for half a digit, and at
    most 4 % higher.

    It knows no pitch limits: the load is in the bucket at every pose.
    """
    machine = machines.named(name).with_payload("full")
    poses = machine.at(box(machine, (2001,) if len(machine.joints) == 1 else (31, 31, 31)))
    for i, cylinder in enumerate(machine.cylinders):
        force = poses.cylinder_forces[:, i]
        cap, annulus = FACTS[name].pressures[cylinder.name]
        assert cap - 0.051 < max(0.0, force.max()) / cylinder.bore_area / MPA < 1.04 * cap + 0.051
        assert (
            annulus - 0.051
            < max(0.0, -force.min()) / cylinder.annulus_area / MPA
            < 1.04 * annulus + 0.051
        )


@pytest.mark.parametrize("name", SHIPPED)
def test_no_cylinder_gives_way_under_its_payload(name: str) -> None:
    """By hand: what the machine carries stays below its supply pressure at every pose where the
    load is held.
    """
    machine = machines.named(name)
    q = box(machine, (501,) if len(machine.joints) == 1 else (15, 15, 15))
    for payload in machine.payloads:
        case = machine.with_payload(payload.name)
        forces = case.at(q[case.holds(q)]).cylinder_forces
        for i, cylinder in enumerate(machine.cylinders):
            assert forces[:, i].max() < machine.supply.pressure * cylinder.bore_area
            assert -forces[:, i].min() < machine.supply.pressure * cylinder.annulus_area


@pytest.mark.parametrize("name", REAL)
def test_frequencies(name: str) -> None:
    """Second, which took the structure as rigid and the oil as free of air: percentiles of the
    lowest frequency over samples of the joint box, 3 % between two sets of samples.
    """
    machine = machines.rigid(name).replace({"fluid.entrained_air_percent": 0})
    q = box(machine, (2000,) if len(machine.joints) == 1 else (21, 21, 21), inner=True)
    rigid = machine.rigid_poses(q)
    for payload in ("empty", "full"):
        frequencies = ad.natural_modes(machine.with_payload(payload).at(rigid)).frequencies[:, 0]
        assert_allclose(
            np.percentile(frequencies, (5, 50, 95)), getattr(FACTS[name], payload), rtol=0.03
        )


def test_what_the_choice_of_the_coupler_costs() -> None:
    """SOURCE.md: the crane with 7.9 kg in the coupler beside, or instead of, those in the
    extension; in per cent.
    """
    machine = machines.named("loader_crane")
    bars = {c.name: dict(c.linkage_masses) for c in machine.cylinders if c.moving_masses}
    assert bars == {"tilt": {"rocker": 11.524, "coupler": 0.0}}
    beside = machine.replace({"cylinder.tilt.four_bar.coupler_kg": 7.9})
    urdf = machine.urdf_text.replace('mass value="58.63"', 'mass value="50.73"')
    instead = Machine.from_text(beside.text, urdf, machine.source)
    q = box(machine, (21, 21, 21), inner=True)
    words = {"empty": ("3.1", "7.0", "2.6"), "full": ("1.9", "0.7", "1.1")}
    for payload, (most, low, high) in words.items():
        ours, both, moved = (
            ad.natural_modes(case.with_payload(payload).at(q)).frequencies[:, 0]
            for case in (machine, beside, instead)
        )
        assert f"{100 * (ours / both - 1).max():.1f}" == most
        assert f"{100 * (1 - ours / moved).max():.1f}" == low
        assert f"{100 * (ours / moved - 1).max():.1f}" == high
        assert all(f"{word} %" in source_text("loader_crane") for word in (most, low, high))


# --------------------------------------------------------------------------------------- the URDFs


@pytest.mark.parametrize("name", SHIPPED)
def test_urdf_loads_in_pinocchio_without_a_word(
    name: str, capfd: pytest.CaptureFixture[str]
) -> None:
    path = str(shipped()[name].with_suffix(".urdf"))
    model = pinocchio.buildModelFromUrdf(path)
    visuals = pinocchio.buildGeomFromUrdf(model, path, pinocchio.GeometryType.VISUAL)
    collisions = pinocchio.buildGeomFromUrdf(model, path, pinocchio.GeometryType.COLLISION)
    assert capfd.readouterr() == ("", "")
    assert visuals.ngeoms > 10
    assert collisions.ngeoms == 0
    mass = FACTS[name].mass if name in FACTS else 0.0  # the paper's lever is massless
    assert pinocchio.computeTotalMass(model) + model.inertias[0].mass == pytest.approx(
        mass, rel=1e-9, abs=1e-9
    )


@pytest.mark.parametrize("name", SHIPPED)
def test_every_body_is_drawn_from_primitives(name: str) -> None:
    """Links with a mass, a payload or the tool have visuals; no mesh files, so the folder is all
    that is needed.
    """
    machine = machines.named(name)
    robot = ET.fromstring(machine.urdf_text)
    assert not robot.findall(".//mesh")
    drawn = {link.get("name") for link in robot.findall("link") if link.find("visual") is not None}
    heavy = {
        link.get("name") for link in robot.findall("link") if link.find("inertial") is not None
    }
    carrying = {case.link for case in machine.payloads if case.link is not None}
    assert heavy | carrying | {machine.tool.link} <= drawn
    colours = {material.get("name") for material in robot.findall("material")}
    assert {material.get("name") for material in robot.findall("link/visual/material")} <= colours


@pytest.mark.parametrize("name", EXCAVATORS)
def test_the_tooth_is_drawn_where_the_tool_is(name: str) -> None:
    """A box ends at the tool point, within 2 cm: pictures show the point whose path the maps
    tell.
    """
    machine = machines.named(name)
    link = ET.fromstring(machine.urdf_text).find(f"link[@name='{machine.tool.link}']")
    assert link is not None
    ends = []
    for visual in link.findall("visual"):
        origin, shape = visual.find("origin"), visual.find("geometry/box")
        if origin is None or shape is None:
            continue
        x, y, z = (float(word) for word in str(origin.get("xyz")).split())
        pitch = float(origin.get("rpy", "0 0 0").split()[1])
        half = float(str(shape.get("size")).split()[0]) / 2
        ends.append([x + half * math.cos(pitch), y, z - half * math.sin(pitch)])
    gaps = np.linalg.norm((np.array(ends) - machine.tool.at) * [1, 0, 1], axis=1)
    assert gaps.min() < 0.02


@pytest.mark.parametrize("name", REAL)
def test_designs_are_buildable_and_pins_stay_on_the_plates(name: str) -> None:
    """A catalogue; for every link that carries pins a plate that holds today's, by matplotlib."""
    machine = machines.named(name)
    stated = machine.section.requirements
    assert stated.catalogue == ("5mm" if name in EXCAVATORS else "iso")
    pins = [pin for linkage in machine.linkages for pin in linkage.pins]
    assert set(stated.outline) == {pin.link for pin in pins}
    for pin in pins:
        plate = stated.outline[pin.link]
        assert plate.pin_radius_mm > 0
        at = [1000 * pin.at[0], 1000 * pin.at[2]]
        turns = np.linspace(0, 2 * math.pi, 73)
        boss = at + 0.99 * plate.pin_radius_mm * np.column_stack([np.cos(turns), np.sin(turns)])
        assert Polygon(plate.points_mm).get_path().contains_points(boss).all(), pin
    reasons = {cylinder for part in stated.clearance.values() for cylinder in part.cylinders}
    assert reasons <= {cylinder.name for cylinder in machine.cylinders}
    assert machine.cylinders[0].name in reasons  # beside chassis or pillar


@pytest.mark.parametrize("name", REAL)
def test_todays_machine_meets_its_own_requirements(name: str) -> None:
    machine = machines.named(name)
    limits = ad.Requirements.of(machine)
    checks = check(machine, machine, ad.Workspace.grid(machine, points=3), limits)
    places = {c.name: c.slack for c in checks if c.name.startswith(("outline", "clearance"))}
    assert len(places) > len(machine.cylinders)
    assert min(places.values()) >= 0
    assert min(c.slack for c in checks) >= -1e-9
