"""Masses of idle cylinders: a machine with a frozen joint is the one that holds it there.

What moves is compared, row by row: bars of cylinders that move have their own tests.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pinocchio
import pytest
import scipy.linalg
from numpy.testing import assert_allclose

import armdesign as ad
from armdesign.influence.family import Family, rebuilt
from armdesign.inspection.file_faults import faults
from armdesign.inspection.inspection import inspect
from armdesign.machine.file.key_paths import Location
from armdesign.machine.file.numbers import numbers_of
from armdesign.machine.tipping import centre_ahead, moving_mass, tipping_masses
from armdesign.report.inspections import check_sheets
from armdesign.units import GRAVITY
from tests.checks import assert_same
from tests.held import FROZEN, MASSES, WITH_OWN_JOINTS, Held, held
from tests.slewing_tables import stability

STABILITY = stability(30000, [-400, 0, 900], 2000, 2000)
OTHER: dict[Location, float] = {  # of a four-bar that is idle: its masses, and where it stands
    ("cylinder", "tilt", "barrel_kg"): 300.0,
    ("cylinder", "tilt", "four_bar", "coupler_kg"): 20.0,
    ("cylinder", "tilt", "base", "at_mm", 0): 150.0,
    ("cylinder", "tilt", "four_bar", "rocker_mm"): 520.0,
}


@pytest.mark.parametrize("name", FROZEN)
def test_inertia_and_gravity_are_those_of_the_joint_held(name: str) -> None:
    case = held(name)
    assert set(FROZEN[name]) == {j for joints in case.frozen.idle.values() for j in joints} - {
        "swing"
    }
    one, other = case.frozen.at(case.q), case.awake.evaluate(case.awake.rigid_poses(case.whole))
    pick = np.ix_(range(len(case.q)), case.rest, case.rest)
    assert_same(one.mass_matrix, other.mass_matrix[pick], 1e-12)
    assert_same(one.gravity_torque, other.gravity_torque[:, case.rest], 1e-12)
    assert_same(one.gravity_stiffness, other.gravity_stiffness[pick], 1e-12)


@pytest.mark.parametrize("name", WITH_OWN_JOINTS)
def test_modes_are_those_with_the_joint_held(name: str) -> None:
    """By Rayleigh's constraint: rows and columns of K and M of the held joints left out."""
    case = held(name)
    other = case.awake.evaluate(case.awake.rigid_poses(case.whole))
    pick = np.ix_(range(len(case.q)), case.rest, case.rest)
    expected = [
        np.sqrt(scipy.linalg.eigh(stiffness, mass, eigvals_only=True)) / (2 * np.pi)
        for stiffness, mass in zip(
            other.stiffness_matrix[pick], other.mass_matrix[pick], strict=True
        )
    ]
    assert_allclose(ad.natural_modes(case.frozen.at(case.q)).frequencies, expected, rtol=1e-9)


def with_stability(machine: ad.Machine) -> ad.Machine:
    return ad.Machine.from_text(machine.text + STABILITY, machine.urdf_text, machine.source)


def test_the_idle_bars_tip_the_machine() -> None:
    """Of an idle cylinder on the stick; on what only slews they are of ``[stability]``."""
    case = held("slewing")
    machines = with_stability(case.frozen), with_stability(case.awake)
    rigid = [m.rigid_poses(q) for m, q in zip(machines, (case.q, case.whole), strict=True)]
    for ahead in (4.0, -4.0):
        tips = [
            tipping_masses(m, at, np.full(3, ahead)) for m, at in zip(machines, rigid, strict=True)
        ]
        assert 0 < tips[1].min() < tips[1].max() < 1e5
        assert_allclose(tips[0], tips[1], rtol=1e-12)
    centres = [centre_ahead(m, at) for m, at in zip(machines, rigid, strict=True)]
    assert_allclose(*centres, rtol=1e-12)
    standing = {"frozen.boom": 0.3, "frozen.stick": -1.0}
    folded = machines[0].replace({"joints": ["swing"], **standing})
    assert len(folded.idle_points) == 3 * 8  # three points for each bar
    assert moving_mass(folded, folded.rigid_poses([[0.4]]))[0] == 0


def test_check_shows_the_masses_and_where_they_are() -> None:
    machine = held("four_bar_left").frozen
    inspection = inspect(machine, ad.Workspace.grid(machine, 3))
    (masses,) = (sheet for sheet in check_sheets(inspection) if sheet.title == "Masses")
    rows = {part: (mass, where) for part, mass, where in masses.rows}
    for key, mass in MASSES.items():
        part = f"tilt {key.split('.')[-1].removesuffix('_kg')}"
        assert rows[part] == (f"{mass}.0", "stick")
    words = [f.words for f in inspection.findings() if f.part == "cylinder.tilt"]
    assert len(words) == 1
    assert words[0].endswith("; its masses are fixed to link stick")


def centre_of_exported(machine: ad.Machine, q: np.ndarray, file: Path) -> tuple[float, np.ndarray]:
    """Mass and centre of mass of the exported URDF at a pose, by Pinocchio."""
    model = pinocchio.buildModelFromXML(ad.export(machine, file).read_text())
    positions, at = ad.robot_positions(machine, q).iloc[0], pinocchio.neutral(model)
    for name, value in positions.items():
        joint = model.joints[model.getJointId(str(name))]
        at[joint.idx_q : joint.idx_q + joint.nq] = (
            value if joint.nq == 1 else (np.cos(value), np.sin(value))
        )
    data = model.createData()
    return pinocchio.computeTotalMass(model), np.array(pinocchio.centerOfMass(model, data, at))


@pytest.mark.parametrize("name", ["four_bar_from_boom", "spatial"])
def test_exported_robots_weigh_as_much_and_where(name: str, tmp_path: Path) -> None:
    case, file = held(name), tmp_path / "robot.urdf"
    mass, centre = centre_of_exported(case.frozen, case.q[0], file)
    expected_mass, expected = centre_of_exported(case.awake, case.whole[0], file)
    assert mass == pytest.approx(expected_mass)
    assert_allclose(centre, expected, atol=1e-9)
    scenes = (
        ET.parse(ad.export(machine, tmp_path / "robot.sdf", pose)).iter("mass")
        for machine, pose in ((case.frozen, case.q[0]), (case.awake, case.whole[0]))
    )
    masses, wanted = (sum(float(str(mass.text)) for mass in scene) for scene in scenes)
    assert masses == pytest.approx(wanted)


def gravity_with(case: Held, changes: dict[Location, float]) -> np.ndarray:
    """Gravity torque of the machine awake with other values, where joints are held."""
    other = rebuilt(case.awake, changes)
    return other.evaluate(other.rigid_poses(case.whole)).gravity_torque[:, case.rest]


@pytest.mark.parametrize("location", OTHER)
def test_changes_of_an_idle_cylinder_count(location: Location) -> None:
    case, value = held("four_bar_left"), OTHER[location]
    path = ".".join(map(str, location))
    change: dict[str, object] = {path: value}
    if path.endswith(".0"):
        change = {path.removesuffix(".0"): [value, 0.0, 500.0]}
    expected = gravity_with(case, {location: value})
    assert_same(case.frozen.replace(change).at(case.q).gravity_torque, expected, 1e-12)
    assert np.abs(expected - case.frozen.at(case.q).gravity_torque).max() > 10  # [N m]


def test_a_family_may_differ_in_idle_cylinders() -> None:
    """What sensitivities and tolerances ask: each member has one of the changes."""
    case = held("four_bar_left")
    today = {n.location: n.value for n in numbers_of(case.frozen.section).values()}
    alone = np.eye(len(OTHER), dtype=bool)
    values = {
        location: np.where(own, value, today[location])
        for own, (location, value) in zip(alone, OTHER.items(), strict=True)
    }
    members = Family.of(case.frozen, values, len(OTHER))
    torque = members.at(case.q[0], case.frozen.payload.name).gravity_torque
    for row, (location, value) in enumerate(OTHER.items()):
        assert_same(torque[row], gravity_with(case, {location: value})[0], 1e-12)


def test_a_bar_by_hand() -> None:
    """A barrel of 300 kg from (0.2, 0, 0.5) m in the stick: its torque about the boom's foot."""
    case = held("four_bar_left")
    machine = case.frozen.with_payload(0.0)
    kg = {"barrel_kg": 300.0, "rod_kg": 0.0, "four_bar.rocker_kg": 0.0, "four_bar.coupler_kg": 0.0}
    light = machine.replace({f"cylinder.tilt.{key}": 0.0 for key in kg})
    heavy = machine.replace({f"cylinder.tilt.{key}": mass for key, mass in kg.items()})
    torque = heavy.at(case.q).gravity_torque - light.at(case.q).gravity_torque
    cylinder, linkage = heavy.idle_cylinders[0]
    rigid = heavy.arm.kinematics(case.q)
    base, knee = linkage.ends(rigid)
    along = (knee - base) / np.linalg.norm(knee - base, axis=1)[:, None]
    centre = base + along * cylinder.closed_length / 2
    foot = rigid.translation[:, 0]  # the boom turns about −y: what is ahead of the foot pulls it
    assert_allclose(torque[:, 0], 300 * GRAVITY * (centre - foot)[:, 0], rtol=1e-9)


def test_a_four_bar_that_does_not_close_where_it_is_frozen(tmp_path: Path) -> None:
    """With masses it is refused, by ``check`` too; without them nothing depends on it."""
    machine = held("four_bar_left").frozen
    short = {"cylinder.tilt.four_bar.rocker_mm": 20.0, "cylinder.tilt.four_bar.coupler_mm": 20.0}
    message = (
        r"odd\.toml: cylinder\.tilt: has masses and does not close at the frozen bucket = 0\.1;"
        r" freeze it elsewhere: rocker \+ coupler must exceed"
    )
    with pytest.raises(ad.ArmDesignError, match=message):
        machine.replace(short)
    none = {f"cylinder.tilt.{key}": 0.0 for key in MASSES}
    light = machine.replace(short | none)
    words = [f.words for f in inspect(light, ad.Workspace.grid(light, 3)).findings()]
    assert "its four-bar does not close where it is frozen" in words
    assert "tilt_barrel" not in ad.export(light, tmp_path / "light.urdf").read_text()
    file = light.save(tmp_path / "light.toml")
    text = re.sub(r"(?m)^barrel_kg = 0.*$", "barrel_kg = 110", file.read_text())
    file.write_text(text)
    assert [str(fault.part) for fault in faults(file)] == ["light.toml: cylinder.tilt"]


def test_a_cylinder_frozen_out_of_its_stroke_is_told() -> None:
    machine = held("spatial").frozen.replace({"cylinder.reach.stroke_mm": 10.0})
    words = [f.words for f in inspect(machine, ad.Workspace.grid(machine, 3)).findings()]
    assert any(re.match(r"where it is frozen it is [\d.]+ m?m long, not \[", one) for one in words)
