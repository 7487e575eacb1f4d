"""Pin tables, drawings and robot descriptions, read back by other programs than those that wrote
them.
"""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from xml.sax.saxutils import quoteattr

import ezdxf
import numpy as np
import pandas as pd
import pinocchio
import pytest
from scipy.spatial.transform import Rotation

import armdesign as ad
from armdesign.errors import PoseError
from armdesign.exchange.inertials import light_mass
from armdesign.machine import template
from tests import machines
from tests.commands import Refused, main
from tests.machine.as_links import with_links
from tests.sprung import rocking

NAMES = ("excavator_20t", "loader_crane", "paper_1dof")
ODD = ("spatial", "slewing", "crossing")


def machine_of(name: str) -> ad.Machine:
    return ad.load(name) if name in NAMES else getattr(machines, name)()


def renamed(**names: str) -> ad.Machine:
    """The machine with one joint, with other names of its links."""
    machine = ad.load("paper_1dof")
    text, urdf = machine.text, machine.urdf_text
    for link, name in names.items():
        text = text.replace(f'link = "{link}"', f"link = {json.dumps(name)}")
        for key in ("<link name", "link"):
            urdf = urdf.replace(f'{key}="{link}"', f"{key}={quoteattr(name)}")
    return ad.Machine.from_text(text, urdf, Path("paper_1dof.toml"))


# -------------------------------------------------------------------------------------- pin table


def test_the_pin_table_has_every_pin_in_its_link_and_at_the_pose(tmp_path: Path) -> None:
    machine = ad.load("excavator_20t")
    q = np.deg2rad([20.0, -80.0, -30.0])
    table = pd.read_csv(ad.export(machine, tmp_path / "pins.csv", q)).set_index(["link", "pin"])
    own = table.loc[("boom", "boom.rod_end")]
    assert own[["x_mm", "y_mm", "z_mm"]].tolist() == [2233.7, 0, 950.5]
    # by hand: the foot of the boom, and the pin turned by 20 deg
    c, s = np.cos(q[0]), np.sin(q[0])
    at = (227.7 + c * 2233.7 - s * 950.5, 1957.3 + s * 2233.7 + c * 950.5)
    assert own[["root_x_mm", "root_z_mm"]].tolist() == pytest.approx(at, abs=1e-3)
    knee = table[table.index.get_level_values("pin") == "bucket.knee"].iloc[0]
    pivot = table.loc[("stick", "bucket.pivot")]
    apart = [knee[key] - pivot[key] for key in ("root_x_mm", "root_z_mm")]
    assert np.hypot(*apart) == pytest.approx(578.7, abs=1e-3)
    assert {"joint", "cylinder", "four_bar", "tool", "load"} == set(table["kind"])


def test_what_is_frozen_is_in_the_pin_table() -> None:
    """An idle cylinder's pins and its joint, as all other programs get them."""
    machine = ad.load("excavator_20t")
    text = machine.text.replace(', "bucket"]', "]").replace(
        "swing = 0.0", "swing = 0.0, bucket = -1.0"
    )
    frozen = ad.Machine.from_text(text, machine.urdf_text, machine.source)
    both = ad.pin_table(machine, [0.5, -1.0, -1.0]), ad.pin_table(frozen, [0.5, -1.0])
    for table in both:
        assert {"swing", "bucket", "bucket.base", "bucket.knee"} <= set(table["pin"])
    pins, others = (table.query("kind != 'load'").sort_values(["link", "pin"]) for table in both)
    pd.testing.assert_frame_equal(pins.reset_index(drop=True), others.reset_index(drop=True))


# -------------------------------------------------------------------------------------------- DXF


@pytest.mark.parametrize("name", [*NAMES, *ODD])
def test_ezdxf_reads_the_drawing(name: str, tmp_path: Path) -> None:
    """Circles at all pins of the pose, centre lines through them, names, mm; a block per link."""
    machine = machine_of(name)
    document = ezdxf.readfile(ad.export(machine, tmp_path / "m.dxf"))
    assert not document.audit().errors
    assert document.header["$INSUNITS"] == 4
    circles = document.modelspace().query('CIRCLE[layer=="PINS"]')
    assert len(circles) >= 2 * len(machine.cylinders)
    for link in {row.link for row in ad.pin_table(machine).itertuples() if row.link}:
        rows = ad.pin_table(machine).query("link == @link")
        if len(rows[["x_mm", "z_mm"]].drop_duplicates()) < 2:
            continue
        block = document.blocks[f"link_{link}"]
        centres = [circle.dxf.center for circle in block.query("CIRCLE")]
        drawn = {(round(at.x, 3), round(at.y, 3)) for at in centres}
        assert drawn == {(round(r.x_mm, 3), round(r.z_mm, 3)) for r in rows.itertuples()}
        texts = " ".join(text.dxf.text for text in block.query("TEXT"))
        assert all(pin in texts for pin in rows["pin"])
        assert len(block.query('LWPOLYLINE[layer=="CENTRE_LINES"]')) == 2 * len(drawn)


@pytest.mark.parametrize(
    ("base", "boom", "blocks"),
    [
        ("base", "arm/boom", ("link_base", "link_arm_boom")),
        ("a b", 'ä<>:;?*|,=`"\\', ("link_a b", "link_ä____________")),
        ("Boom", "boom", ("link_Boom", "link_boom_2")),
        ("a/b", "a:B", ("link_a_b", "link_a_B_2")),
        ("a\n", "b", ("link_a_n", "link_b")),
    ],
)
def test_blocks_have_names_that_are_allowed_and_differ(
    base: str, boom: str, blocks: tuple[str, ...], tmp_path: Path
) -> None:
    machine = renamed(base=base, boom=boom)
    document = ezdxf.readfile(ad.export(machine, tmp_path / "m.dxf"))
    assert not document.audit().errors
    drawn = {insert.dxf.name for insert in document.modelspace().query("INSERT")}
    assert drawn == set(blocks)
    texts = [text.dxf.text for name in blocks for text in document.blocks[name].query("TEXT")]
    assert all(any(f"link {link.strip()}:" in text for text in texts) for link in (base, boom))


def test_the_drawing_stands_at_the_pose(tmp_path: Path) -> None:
    """Circles to 0.1 µm, as the table says and as lines between them end; 0.1 mm is no place."""
    machine = ad.load("excavator_20t")
    q = np.deg2rad([20.0, -80.0, -30.0])
    document = ezdxf.readfile(ad.export(machine, tmp_path / "m.dxf", q))
    centres = [c.dxf.center for c in document.modelspace().query("CIRCLE")]
    table = ad.pin_table(machine, q)
    drawn = table["kind"].isin(["cylinder", "four_bar", "joint"]) & (table["pin"] != "swing")
    for row in table[drawn].itertuples():  # a frozen joint is in no side view
        away = [np.hypot(c.x - row.root_x_mm, c.y - row.root_z_mm) for c in centres]
        assert min(away) < 2e-4, row.pin
    words = {text.dxf.text: text.dxf for text in document.modelspace().query("TEXT")}
    sides = {name: words[name].halign for name in ("stick.base", "stick.rod_end")}
    assert sides == {"stick.base": 2, "stick.rod_end": 0}, "clear of the barrel"
    title = [text.dxf.text for text in document.modelspace().query("TEXT")]
    assert any("boom 20.0 deg, stick -80.0 deg, bucket -30.0 deg" in text for text in title)


# ------------------------------------------------------------------------------------- URDF, SDF


def placed(text: str, positions: dict[str, float]) -> tuple[pinocchio.Model, pinocchio.Data]:
    """Pinocchio's model of a URDF with joints at positions, all its frames placed."""
    model = pinocchio.buildModelFromXML(text)
    q = pinocchio.neutral(model)
    for name, value in positions.items():
        joint = model.joints[model.getJointId(name)]
        turns = joint.nq == 2  # a continuous joint: cosine and sine
        q[joint.idx_q : joint.idx_q + joint.nq] = (
            [np.cos(value), np.sin(value)] if turns else [value]
        )
    data = model.createData()
    pinocchio.framesForwardKinematics(model, data, q)
    return model, data


def point(model: pinocchio.Model, data: pinocchio.Data, link: str, at: list[float]) -> np.ndarray:
    frame = model.getFrameId(link, pinocchio.FrameType.BODY)
    return np.asarray(data.oMf[frame].act(np.array(at)))


@pytest.mark.parametrize("name", [*NAMES, *ODD])
def test_rods_end_on_their_pins_in_pinocchio(name: str, tmp_path: Path) -> None:
    """At many poses, with the positions that robot_positions gives."""
    machine = machine_of(name)
    text = ad.export(machine, tmp_path / "m.urdf").read_text(encoding="utf-8")
    q = machines.inner_poses(machine, 5)
    rigid = machine.arm.kinematics(q)
    table = ad.robot_positions(machine, q)
    for k, row in enumerate(table.to_dict("records")):
        model, data = placed(text, row)
        for cylinder, linkage in zip(machine.cylinders, machine.linkages, strict=True):
            end = linkage.ends(rigid)[1][k]
            rod = point(model, data, f"{cylinder.name}_rod", [0, 0, 0])
            assert rod == pytest.approx(end, abs=1e-9)
            extension = linkage.length(rigid)[k] - cylinder.closed_length
            joint = ET.fromstring(text).find(f"joint[@name='{cylinder.name}_rod']")
            lower = float(joint.find("limit").get("lower"))  # type: ignore[union-attr, arg-type]
            assert row[f"{cylinder.name}_rod"] - lower == pytest.approx(extension, abs=1e-9)
            if f"{cylinder.name}_coupler" in row:
                tip = point(model, data, f"{cylinder.name}_coupler", [linkage.coupler, 0, 0])
                lug = linkage.point(rigid, linkage.lug)[k]
                assert tip == pytest.approx(lug, abs=1e-9)


def test_a_cylinder_in_the_plane_of_its_link_at_one_pose_alone_swivels(tmp_path: Path) -> None:
    """A ram beside a slewing column, along x at 0 rad, the pose of the URDF's and SDF's joints."""
    column = machines.Joint("swing", "root", axis=(0, 0, 1), limits=(-0.8, 0.8))
    ram = machines.CylinderSpec("ram", ("root", (-1.0, 0.3, 0.0)), ("swing", (0.0, 0.3, 0.0)))
    machine, q = machines.build([column], [ram]), np.array([[-0.5], [0.0], [0.6]])
    text = ad.export(machine, tmp_path / "m.urdf").read_text(encoding="utf-8")
    names = {joint.get("name") for joint in ET.fromstring(text).findall("joint")}
    for pose in (q, q[1:2]):
        assert set(ad.robot_positions(machine, pose)) == names
    for row in ad.robot_positions(machine, q).to_dict("records"):
        model, data = placed(text, row)
        pin = point(model, data, "swing", [0.0, 0.3, 0.0])
        assert point(model, data, "ram_rod", [0, 0, 0]) == pytest.approx(pin, abs=1e-9)
    loop = ET.parse(ad.export(machine, tmp_path / "m.sdf", q[1]))
    assert loop.find("model/joint[@name='ram_swivel_joint']") is not None


def test_the_links_weigh_what_they_weighed(tmp_path: Path) -> None:
    machine = ad.load("loader_crane")
    for one in (machine, with_links(machine)):
        text = ad.export(one, tmp_path / "m.urdf").read_text()
        model = pinocchio.buildModelFromXML(text)
        masses = sum(inertia.mass for inertia in model.inertias)
        rocker = 11.524  # the only bar with a mass of its own
        bare = sum(i.mass for i in pinocchio.buildModelFromXML(machine.urdf_text).inertias)
        bodies = [inertial_of(link)[0] for link in ET.fromstring(text).iter("link")]
        light = sum(mass for mass in bodies if mass == light_mass(one))
        assert masses - light == pytest.approx(bare + rocker, rel=1e-12)
        assert 0 < light < 2e-5 * bare


@pytest.mark.parametrize("kind", ["urdf", "sdf"])
@pytest.mark.parametrize("mass", [100.0, 0.3])
def test_bars_have_their_own_moments_of_any_size(kind: str, mass: float, tmp_path: Path) -> None:
    """m L²/12 across a barrel and a rod as long; what simulators ask of all: positive moments, of
    which none is more than both others together. A machine of 1 kg has no bodies of 0.1 kg.
    """
    machine = two_joints(mass)
    boom, length = machine.cylinders[0], machine.cylinders[0].closed_length
    robot = ET.parse(ad.export(machine, tmp_path / f"m.{kind}")).getroot()
    found = {str(link.get("name")): inertial_of(link) for link in robot.iter("link")}
    for name, of_bar in (("ram_barrel", boom.barrel_mass), ("ram_rod", boom.rod_mass)):
        moments = sorted(found[name][1])
        assert found[name][0] == of_bar > 0
        assert moments[1:] == pytest.approx([of_bar * length**2 / 12] * 2, rel=1e-12)
        assert moments[0] < 2e-3 * moments[1]
    assert 0 < found["thumb_rod"][0] == found["thumb_barrel"][0] < 2e-5 * mass
    for name in found.keys() - {"root"}:
        own, (least, middle, most) = found[name][0], sorted(found[name][1])
        assert own > 0 < least <= middle <= most <= least + middle


def two_joints(mass: float) -> ad.Machine:
    """Two links of a mass, the first with a cylinder that weighs, the other with one that not."""
    joints = [
        machines.Joint("boom", "root", mass=mass),
        machines.Joint("stick", "boom", xyz=(1.5, 0, 0), mass=mass),
    ]
    weighs = f"barrel_kg = {mass / 15!r}\nrod_kg = {mass / 30!r}"
    ram = machines.CylinderSpec("ram", ("root", (0.3, 0, -0.6)), ("boom", (0.8, 0, 0.2)))
    thumb = machines.CylinderSpec("thumb", ("boom", (0.5, 0, 0.5)), ("stick", (-0.2, 0, 0.3)))
    return machines.build(joints, [replace(ram, extra=weighs), thumb])


def inertial_of(link: ET.Element) -> tuple[float, list[float]]:
    """Mass and three moments, of a URDF or SDF; NaN where a link has none."""
    mass, inertia = link.find("inertial/mass"), link.find("inertial/inertia")
    if mass is None or inertia is None:
        return np.nan, [np.nan] * 3
    keys = ("ixx", "iyy", "izz")
    moments = [float(inertia.get(key) or inertia.findtext(key) or "nan") for key in keys]
    return float(mass.get("value") or mass.text or "nan"), moments


def pose_of(element: ET.Element) -> tuple[np.ndarray, np.ndarray]:
    words = (element.findtext("pose") or "0 0 0 0 0 0").split()
    x = np.array([float(word) for word in words])
    return Rotation.from_euler("xyz", x[3:]).as_matrix(), x[:3]


def frames_of(model: ET.Element) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Rotation and place of every link in the model."""
    frames: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    for link in model.findall("link"):
        rotation, place = pose_of(link)
        base = link.find("pose").get("relative_to")  # type: ignore[union-attr]
        if base:
            turn, foot = frames[base]
            rotation, place = turn @ rotation, foot + turn @ place
        frames[str(link.get("name"))] = rotation, place
    return frames


@pytest.mark.parametrize("name", [*NAMES, *ODD])
def test_loops_are_closed_in_the_sdf(name: str, tmp_path: Path) -> None:
    """Every link has its place in the model; every rod and coupler ends where its joint holds it,
    and every joint of the arm has the rest of its limits.
    """
    machine = machine_of(name)
    q = machines.inner_poses(machine, 1)[0]
    model = ET.parse(ad.export(machine, tmp_path / "m.sdf", q)).getroot().find("model")
    assert model is not None
    names = [str(child.get("name")) for child in model]
    assert len(set(names)) == len(names), "SDF: names of links and joints share one space"
    frames = frames_of(model)
    assert all(float(mass.text or 0) > 0 for mass in model.findall("link/inertial/mass"))
    ends = {f"{cylinder.name}_rod": k for k, cylinder in enumerate(machine.cylinders)}
    rigid = machine.arm.kinematics(q[None])
    for body, k in ends.items():
        assert frames[body][1] == pytest.approx(machine.linkages[k].ends(rigid)[1][0], abs=1e-9)
    closing = [joint for joint in model.findall("joint") if joint.get("type") == "ball"]
    assert {j.findtext("child") for j in closing} >= set(ends)
    for joint, limits in zip(machine.joints, machine.arm.limits, strict=True):
        limit = model.find(f"joint[@name='{joint}_joint']/axis/limit")
        assert limit is not None
        lower_upper = [float(limit.findtext(end) or "nan") for end in ("lower", "upper")]
        at = q[machine.joints.index(joint)]
        assert np.array(lower_upper) + at == pytest.approx(limits, abs=1e-12)


def test_poses_at_which_a_four_bar_is_open_are_refused(tmp_path: Path) -> None:
    machine = ad.load("excavator_20t").replace({"cylinder.bucket.four_bar.coupler_mm": 530.0})
    q = [0.5, -1.0, 1.3]
    words = (
        r"bucket cylinder: its four-bar does not close at .*bucket 74\.5°; stay in the range of"
    )
    for refused in (
        lambda: ad.export(machine, tmp_path / "m.sdf", q),
        lambda: ad.robot_positions(machine, q),
        lambda: machine.at(q),
    ):
        with pytest.raises(PoseError, match=words):
            refused()
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("name", "like_it"), [("world", "World"), ("__model__", "_model__"), ("a::b", "a:b")]
)
def test_names_that_sdf_keeps_are_refused(name: str, like_it: str, tmp_path: Path) -> None:
    message = f'paper_1dof: SDF keeps the name "{name}" of a link for itself; rename it'
    with pytest.raises(ad.ArmDesignError, match=message):
        ad.export(renamed(base=name), tmp_path / "m.sdf")
    ad.export(renamed(base=like_it), tmp_path / "m.sdf")


def test_springs_of_the_sdf_hold_the_unloaded_arm_at_the_pose(tmp_path: Path) -> None:
    """κ times the reference is the moment about the joint of the weights of the SDF's bodies."""
    machine = rocking(more="damping_ratio = 0.1").with_payload("full")
    q = machines.inner_poses(machine, 1)[0]
    model = ET.parse(ad.export(machine, tmp_path / "m.sdf", q)).getroot().find("model")
    assert model is not None
    moment = 0.0  # about −y, through the origin
    for name, (rotation, place) in frames_of(model).items():
        inertial = model.find(f"link[@name='{name}']/inertial")
        assert inertial is not None
        mass = float(inertial.findtext("mass") or 0)
        if name != machine.arm.root and mass != light_mass(machine):  # else a frame
            moment += 9.81 * mass * (place + rotation @ pose_of(inertial)[1])[0]
    found = model.find("joint[@name='rocking_joint']/axis/dynamics")
    assert found is not None
    words = "spring_stiffness", "spring_reference", "damping"
    stiffness, reference, damping = (float(found.findtext(word) or "nan") for word in words)
    assert stiffness == 2.5e7
    assert stiffness * reference == pytest.approx(moment, rel=1e-9)
    assert damping > 0
    others = [axis for axis in model.findall("joint/axis") if axis.find("dynamics") is not None]
    assert len(others) == 1


def test_links_of_the_file_are_drawn_and_have_limits_of_their_actuators(tmp_path: Path) -> None:
    machine = ad.Machine.from_text(template.new("x"), "", Path("x.toml"))
    robot = ET.parse(ad.export(machine, tmp_path / "m.urdf")).getroot()
    assert robot.find("link[@name='boom']/visual/geometry/box") is not None
    limit = robot.find("joint[@name='boom']/limit")
    assert limit is not None
    assert float(limit.get("effort", "0")) > 1e4
    assert 0.05 < float(limit.get("velocity", "0")) < 5


# ---------------------------------------------------------------------------------------- command


def test_the_command_writes_what_is_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ["export", "paper_1dof", "--format", "csv,dxf,urdf,sdf", "--pose", "boom=10"]
    assert main([*words, "--out", str(tmp_path)], monkeypatch) == 0
    assert {path.name for path in tmp_path.iterdir()} == {
        "paper_1dof_pins.csv",
        "paper_1dof_pins.dxf",
        "paper_1dof_with_cylinders.urdf",
        "paper_1dof_with_cylinders.sdf",
    }


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--format", "step"], '--format: "step" is not known; choose from: csv, dxf, urdf, sdf'),
        (["--format", ","], "--format: names no format"),
        (["--pose", "boom=99"], "--pose: boom 99 deg is outside its range"),
        (["--pose", "boom=nan"], "--pose: boom nan deg is outside its range ["),
        (["--pose", "boom=nan"], "] deg; give boom=… in deg"),
    ],
)
def test_bad_options(words: list[str], message: str, refused: Refused) -> None:
    refused(["export", "paper_1dof", *words], message)


def test_bad_files(tmp_path: Path) -> None:
    machine = ad.load("paper_1dof")
    with pytest.raises(ad.ArmDesignError, match=r"end the name in \.csv, \.dxf, \.urdf, \.sdf"):
        ad.export(machine, tmp_path / "m.step")
    with pytest.raises(ad.ArmDesignError, match="cannot be written"):
        ad.export(machine, tmp_path / "none" / "m.csv")
    with pytest.raises(ad.ArmDesignError, match="q"):
        ad.export(machine, tmp_path / "m.csv", [0.0, 1.0])
