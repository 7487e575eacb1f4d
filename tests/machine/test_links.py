"""``[links]``: the same numbers as the URDF that says the same."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import armdesign as ad
from armdesign.inspection.file_faults import faults
from armdesign.inspection.inspection import inspect
from armdesign.machine.provenance import retold
from armdesign.units import GRAVITY
from tests import machines
from tests.machine.as_links import with_links

SHIPPED = ("excavator_20t", "mini_excavator_2t", "loader_crane", "patu_boom", "paper_1dof")


def assert_alike(one: ad.Machine, other: ad.Machine) -> None:
    """Mass matrix, gravity and frequencies to 1e-12 of their size."""
    q = machines.inner_poses(one, 20)
    assert other.joints == one.joints
    assert other.arm.limits == pytest.approx(one.arm.limits, rel=1e-12, abs=1e-12)
    a, b = one.at(q), other.at(q)
    for name in ("mass_matrix", "gravity_torque", "lengths", "moment_arms", "stiffness_matrix"):
        x, y = getattr(a, name), getattr(b, name)
        assert np.abs(x - y).max() <= 1e-12 * np.abs(x).max(), name
    f, g = (ad.natural_modes(poses).frequencies for poses in (a, b))
    # an eigenvalue is as exact as the largest of its pose
    assert np.all(np.abs(g - f) <= 1e-12 * f.max(axis=1, keepdims=True))


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_machines(name: str) -> None:
    machine = ad.load(name)
    assert_alike(machine, with_links(machine))


@pytest.mark.parametrize("seed", range(6))
def test_random_arms(seed: int) -> None:
    machine = machines.random_machine(seed)
    assert_alike(machine, with_links(machine))


@pytest.mark.parametrize("name", ["spatial", "branched", "rotator", "slewing"])
def test_odd_arms(name: str) -> None:
    machine = getattr(machines, name)()
    assert_alike(machine, with_links(machine))


# ------------------------------------------------------------------------------ what is left out

HEAD = """
name = "arm"
joints = ["boom", "stick"]
tool = { link = "stick", at_mm = [2000, 0, 0] }
[payload.full]
mass_kg = 200
link = "stick"
at_mm = [2000, 0, 0]
[fluid]
bulk_modulus_MPa = 1200
[supply]
pressure_bar = 250
flow_l_per_min = 60
[cylinder.boom]
bore_mm = 100
rod_mm = 55
stroke_mm = 687
closed_length_mm = 1015
dead_volume_l = { cap = 0.5, annulus = 0.5 }
base = { link = "base", at_mm = [386, 0, -460] }
rod_end = { link = "boom", at_mm = [1352, 0, 362] }
[cylinder.stick]
bore_mm = 80
rod_mm = 45
stroke_mm = 633
closed_length_mm = 831
dead_volume_l = { cap = 0.4, annulus = 0.4 }
base = { link = "boom", at_mm = [1957, 0, 380] }
rod_end = { link = "stick", at_mm = [-493, 0, 132] }
"""
LINKS = """
[links.ground]
[links.base]
parent = "ground"
type = "fixed"
at_mm = [0, 0, 1000]
[links.boom]
parent = "base"
limits_deg = [-25, 45]
length_mm = 3000
mass_kg = 300
[links.stick]
parent = "boom"
limits_deg = [-130, -50]
length_mm = 2000
mass_kg = 150
box_mm = [2000, 170, 170]
"""
PLAIN = HEAD + LINKS


def machine_of(text: str) -> ad.Machine:
    return ad.Machine.from_text(text, "", Path("arm.toml"))


def test_lengths_and_masses_are_enough() -> None:
    """The boom a slender bar, the stick a box: mass matrix by hand with both joints straight."""
    machine = machine_of(PLAIN)
    bar, box = 300 * 3**2 / 3, 150 * (2**2 + 0.17**2) / 12
    at = machine.arm.rigid_poses(np.array([[0.0, 0.0]]))
    second = box + 150 * 1**2
    first = bar + box + 150 * 4**2
    coupled = box + 150 * 4 * 1
    assert at.mass_matrix[0] == pytest.approx(np.array([[first, coupled], [coupled, second]]))
    gravity = GRAVITY * np.array([300 * 1.5 + 150 * 4, 150 * 1.0])
    assert at.gravity_torque[0] == pytest.approx(gravity)
    assert machine.arm.limits == pytest.approx(np.deg2rad([[-25, 45], [-130, -50]]))


def test_names_of_links_and_joints_may_cross() -> None:
    """A joint may have the name of a link that it does not carry."""
    crossed = PLAIN.replace('joints = ["boom", "stick"]', 'joints = ["stick", "boom"]')
    crossed = crossed.replace("limits_deg = [-25, 45]", 'joint = "stick"\nlimits_deg = [-25, 45]')
    crossed = crossed.replace("limits_deg = [-130", 'joint = "boom"\nlimits_deg = [-130')
    q = np.deg2rad([[10.0, -80.0], [20.0, -100.0]])
    one, other = machine_of(PLAIN).at(q), machine_of(crossed).at(q)
    assert other.mass_matrix == pytest.approx(one.mass_matrix, rel=1e-12)
    assert other.moment_arms == pytest.approx(one.moment_arms, rel=1e-12)


# --------------------------------------------------------------------------- key paths and files


def test_replace_goes_down_to_the_links() -> None:
    machine = machine_of(PLAIN)
    heavier = machine.replace({"links.boom.mass_kg": 330})
    q = np.array([[0.0, -1.5]])
    one, other = (m.arm.rigid_poses(q) for m in (machine, heavier))
    assert other.gravity_torque[0, 0] - one.gravity_torque[0, 0] == pytest.approx(
        30 * 1.5 * GRAVITY
    )
    assert machine_of(heavier.text).arm.rigid_poses(q).mass_matrix == pytest.approx(
        other.mass_matrix
    )
    # the stick hangs at the end of the boom
    longer = machine.replace({"links.boom.length_mm": 3100})
    moved = (
        longer.arm.kinematics(q).translation[0, 1] - machine.arm.kinematics(q).translation[0, 1]
    )
    assert moved == pytest.approx([0.1, 0, 0], abs=1e-12)


def test_it_saves_one_file(tmp_path: Path) -> None:
    machine = machine_of(PLAIN)
    machine.save(tmp_path / "saved.toml")
    assert [path.name for path in tmp_path.iterdir()] == ["saved.toml"]
    again = ad.load(tmp_path / "saved.toml")
    assert again.text == machine.text
    assert again.urdf_text == machine.urdf_text


def test_a_design_of_it_is_one_file(tmp_path: Path) -> None:
    """Provenance: the changed lines say what they were, the links stay."""
    machine = machine_of(PLAIN)
    new = retold(machine.replace({"cylinder.boom.bore_mm": 110}), machine, "wider", ["a trial"])
    new.save(tmp_path / "wider.toml")
    text = (tmp_path / "wider.toml").read_text(encoding="utf-8")
    assert "# was 100" in text
    assert ad.load(tmp_path / "wider.toml").section.links == machine.section.links


@pytest.mark.slow
def test_sensitivity_knows_the_links() -> None:
    """Derivatives by a length, a mass and an angle of [links] against whole new maps."""
    machine = machine_of(PLAIN)
    workspace = ad.Workspace.grid(machine, 5)
    answer = ad.sensitivity(machine, workspace)
    rows = answer.frame.set_index("key")
    assert {"links.boom.mass_kg", "links.stick.mass_kg"} <= set(rows.index)
    for key, step in (("links.boom.mass_kg", 1.0), ("links.stick.box_mm.0", 5.0)):
        numbers = {n.path: n.value for n in answer.numbers}
        ends = []
        for sign in (1, -1):
            value = numbers[key] + sign * step
            whole = [value, 170.0, 170.0] if key.endswith(".0") else value
            other = machine.replace({key.removesuffix(".0"): whole})
            grid = ad.Workspace.grid(other, 5)
            ends.append(ad.frequency_map(other, grid).worst.frequency)
        slope = (ends[0] - ends[1]) / (2 * step)
        assert rows.loc[key, "hz_per_unit"] == pytest.approx(slope, rel=1e-3), key


# ----------------------------------------------------------------------------------------- faults


def test_a_name_of_other_letters_is_one_fault(tmp_path: Path) -> None:
    """Joints and pins that name the link are right once it has another name."""
    text = PLAIN.replace("[links.stick]", '[links."стрела"]').replace('"stick"', '"стрела"')
    (tmp_path / "arm.toml").write_text(text, encoding="utf-8")
    (fault,) = faults(tmp_path / "arm.toml")
    assert fault.part == "arm.toml: links.стрела"
    assert fault.remedy.startswith("start with a letter a to z, then letters a to z, digits")


@pytest.mark.parametrize(("key", "of"), [("parent", "boom"), ("joint", "stick")])
def test_a_wrong_name_is_one_fault(key: str, of: str, tmp_path: Path) -> None:
    """A link whose parent is no name is a joint all the same, which poses may name."""
    text = PLAIN.replace("[links.stick]", '[links.stick]\njoint = "stick"')
    head, section, rest = text.partition(f"[links.{of}]\n")
    wrong = re.sub(f"{key} = .*", f"{key} = 0", rest, count=1)
    (tmp_path / "arm.toml").write_text(head + section + wrong, encoding="utf-8")
    (fault,) = faults(tmp_path / "arm.toml")
    assert str(fault).startswith(f"arm.toml: links.{of}.{key}: 0 is not allowed; give a text")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("mass_kg = 300", "mass_kg = -300", "links.boom.mass_kg: -300 is not allowed"),
        (
            "mass_kg = 300",
            "mass_kg = 300\ninertia_kg_m2 = [1, 2, 4]",
            "links.boom.inertia_kg_m2: no body has principal inertias 1, 2, 4 kg m²",
        ),
        (
            "mass_kg = 300",
            "mass_kg = 300\ninertia_kg_m2 = [1, 2, 4, 0]",
            "links.boom.inertia_kg_m2: 4 values are not allowed",
        ),
        ("length_mm = 3000\n", "", "links.boom.centre_mm: missing: a mass has a centre"),
        (
            "length_mm = 3000",
            "centre_mm = [1500, 0, 0]",
            "links.boom.inertia_kg_m2: missing: a mass has an inertia",
        ),
        (
            'parent = "base"',
            'parent = "bse"',
            'links.boom.parent: no link "bse" in [links]; did you mean "base"?',
        ),
        ('parent = "base"', 'parent = "stick"', "links boom, stick are not connected to the root"),
        ('parent = "base"\n', "", "links.boom.limits_deg: is of a joint, but the link has no"),
        ("[links.ground]", "[links.ground]\nmass_kg = 0\n[links.sky]", "2 root links"),
        (
            "[-25, 45]",
            '[-25, 45]\njoint = "stick"',
            'links.stick.joint: "stick" carries "boom" already',
        ),
        ("[-25, 45]", "[45, -25]", "links.boom.limits_deg: limits [45, -25] are empty"),
        ("[-25, 45]", "[-25, 45]\naxis = [0, 0, 0]", "links.boom.axis: the axis has no length"),
        (
            "[-25, 45]",
            '[-25, 45]\ntype = "prismatic"',
            "links.boom.limits_deg: are not of a prismatic joint; give limits_mm",
        ),
        ("limits_deg = [-25, 45]\n", "", "links.boom.limits_deg: missing: the joint moves"),
        ("limits_deg = [-25, 45]", 'type = "fixed"', 'joints.0: joint "boom" is fixed'),
        ('["boom", "stick"]', '["boom", "stik"]', 'joints.1: no joint "stik" in [links]'),
        ('link = "base"', 'link = "bas"', 'cylinder.boom.base.link: no link "bas" in [links]'),
        ('name = "arm"', 'name = "arm"\nurdf = "a.urdf"', "both urdf and [links] given"),
        (LINKS, "", "neither urdf nor [links] given"),
        ("limits_deg = [-25, 45]", "limit_deg = [-25, 45]", 'did you mean "limits_deg"?'),
        ("[links.ground]", "[links.9]\n[links.ground]", "is not a usable name"),
        ("mass_kg = 300", 'mass_kg = "300 kg"', "write the number alone, in kg: 300"),
    ],
)
def test_faults_say_key_and_line(old: str, new: str, message: str, tmp_path: Path) -> None:
    """Raised by load, and listed by check, alike and with their line."""
    assert old in PLAIN
    text = PLAIN.replace(old, new, 1)
    (tmp_path / "arm.toml").write_text(text, encoding="utf-8")
    with pytest.raises(ad.ArmDesignError) as raised:
        ad.load(tmp_path / "arm.toml")
    listed = [str(fault) for fault in faults(tmp_path / "arm.toml")]
    assert any(message in fault for fault in listed), listed
    assert message in str(raised.value) or len(listed) > 1
    if LINKS in text:
        assert re.search(r"\(line \d+\)$", str(raised.value)), raised.value


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[-25, 45]", "[-25, 45]\naxis = [0, 1, 0]", "links.boom.axis: [0, 1, 0] looks reversed"),
        ("[-130, -50]", "[-2.269, -0.873]", "looks like radians"),
    ],
)
def test_what_looks_wrong_is_named_at_its_key(
    old: str, new: str, words: str, tmp_path: Path
) -> None:
    (tmp_path / "arm.toml").write_text(PLAIN.replace(old, new, 1), encoding="utf-8")
    listed = [str(fault) for fault in faults(tmp_path / "arm.toml")]
    if not listed:
        machine = ad.load(tmp_path / "arm.toml")
        findings = inspect(machine, ad.Workspace.grid(machine, 3)).findings()
        listed = [f"{finding.part}: {finding.words}" for finding in findings]
    assert any(words in fault for fault in listed), listed
