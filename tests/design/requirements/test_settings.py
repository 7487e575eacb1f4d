"""Settings of requirements: read from the file, refused where they cannot be."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

import armdesign as ad
from armdesign import ArmDesignError, Machine, Requirements
from armdesign.design.program.constraints import evaluations_at
from armdesign.design.requirements.places import Outline
from armdesign.design.requirements.speeds import Speed
from armdesign.errors import MachineFileError
from tests.design.designs import MACHINES, problem_of, some_x, workspace_of
from tests.design.requirements.shared import BOOM_PLATE, EVERYTHING, FRONT, POSED, STICK_PLATE
from tests.machines import demanding, named

FILE = """
buckling_factor = 1.9
buckling_column = "stepped"
cylinder_mass_kg = 600
digging_kN = { stick = 100, bucket = 125 }
pin_boxes_mm = { boom = { base = 100 }, stick = { rod_end = 0 } }
[requirements.speed.raise]
joint_deg_per_s = { boom = 14 }
[requirements.speed.lower]
joint_deg_per_s = { boom = -20 }
at = "every"
[requirements.speed.all]
joint_deg_per_s = { boom = 5.729577951308232, stick = -5.729577951308232 }
cylinder_mm_per_s = { bucket = -50 }
[requirements.lift.front]
mass_kg = 2500
joint_deg = { bucket = -120 }
reach_mm = 6000
height_mm = 1500
[requirements.outline.boom]
points_mm = [[-300, -300], [2800, 300], [5900, -300], [6000, 300], [3500, 1400], [2000, 1200]]
pin_radius_mm = 200
[requirements.clearance.plate]
cylinders = ["bucket", "stick"]
link = "stick"
points_mm = [[200, -200], [2600, -100], [2600, 100], [200, 300]]
distance_mm = 150
"""


def written(extra: str) -> Machine:
    return demanding(named("excavator_20t"), extra)


def test_requirements_from_the_file() -> None:
    """The same as given in SI; 1e-9 where degrees and millimetres are turned into them."""
    of_file, wanted = (
        Requirements.of(written(FILE)),
        replace(Requirements.of(named("excavator_20t")), **EVERYTHING),
    )
    same = ("digging_force", "buckling_factor", "buckling_column", "cylinder_mass", "pin_boxes")
    assert [getattr(of_file, name) for name in same] == [getattr(wanted, name) for name in same]
    for a, b in zip(of_file.speeds, wanted.speeds, strict=True):
        assert (a.name, a.at) == (b.name, b.at)
        assert a.joints == pytest.approx(b.joints)
        assert a.cylinders == pytest.approx(b.cylinders)
    assert (of_file.lifts[0].mass, of_file.lifts[0].reach, of_file.lifts[0].height) == (
        2500,
        6.0,
        1.5,
    )
    assert of_file.lifts[0].joints == pytest.approx(FRONT.joints)
    assert_allclose(of_file.outlines[0].points, BOOM_PLATE, rtol=1e-12)
    assert_allclose(of_file.clearances[0].points, STICK_PLATE, rtol=1e-12)
    assert (of_file.outlines[0].pin_radius, of_file.clearances[0].distance) == (0.2, 0.15)


BAD_FILES = [
    ("digging_kN = { spade = 3 }", r'requirements.digging_kN: no cylinder "spade"'),
    ("pin_boxes_mm = { spade = { base = 3 } }", r'requirements.pin_boxes_mm: no cylinder "spade"'),
    ("pin_boxes_mm = { boom = { lug = 3 } }", "lug"),
    (
        "[requirements.speed.a]\njoint_deg_per_s = { knee = 3 }",
        r'speed.a.joint_deg_per_s: no joint "knee"',
    ),
    (
        "[requirements.speed.a]\ncylinder_mm_per_s = { knee = 3 }",
        r'speed.a.cylinder_mm_per_s: no cylinder "knee"',
    ),
    ("[requirements.lift.a]\nmass_kg = 3\nreach_mm = 4", r"lift.a.height_mm: missing"),
    ('[requirements.lift.a]\nmass_kg = 3\nlink = "moon"', r'lift.a.link: no link "moon"'),
    (
        "[requirements.outline.moon]\npoints_mm = [[0, 0], [1, 0], [0, 1]]",
        r'requirements.outline: no link "moon"',
    ),
    ("[requirements.outline.boom]\npoints_mm = [[0, 0], [1, 0]]", r"points_mm"),
    ('buckling_column = "tube"', r"buckling_column"),
    (
        "thrust_share = 1.2\nthrust_share.boom = 0.9",
        r"thrust_share is a number before .*write thrust_share = { default = …, boom = 0.9 } for",
    ),
    ("thrust_share = { spade = 1 }", r'requirements.thrust_share: no actuator "spade"; choose fr'),
    ("thrust_share = { boom = 11 }", r"requirements.thrust_share.boom: 11 is not allowed; give a"),
    ("thrust_share = { default = -1 }", r"requirements.thrust_share.default: -1 is not allowed"),
    ("thrust_share = [1.0]", r"thrust_share: \[1.0\] is not allowed; give a number in \(0, 10\]"),
]


@pytest.mark.parametrize(("extra", "message"), BAD_FILES)
def test_a_file_that_asks_what_cannot_be(extra: str, message: str) -> None:
    with pytest.raises(MachineFileError, match=message):
        written(extra)


def test_degrees_of_a_joint_that_slides() -> None:
    machine = named("loader_crane")
    extra = "\n[requirements.speed.out]\njoint_deg_per_s = { extension = 3 }\n"
    sliding = Machine.from_text(machine.text + extra, machine.urdf_text, machine.source)
    with pytest.raises(
        MachineFileError,
        match=r'speed.out: "extension" slides, so nothing of it is in deg; give it in mm',
    ):
        Requirements.of(sliding)


BAD_SETTINGS = [
    ({"speeds": (Speed(name="a", joints={"knee": 1.0}),)}, r'speed.a: no joint "knee"'),
    ({"lifts": (replace(FRONT, joints={}),)}, "leaves these joints free: boom, stick, bucket"),
    ({"lifts": (replace(FRONT, height=None),)}, "only one of reach and height"),
    ({"lifts": (replace(FRONT, reach=20.0),)},
     r"^requirements.lift.front: reach 20000 mm at height 1500 mm is \d+ mm out of reach of the"),
    ({"lifts": (replace(POSED, joints={"boom": 0.3, "stick": -1.5, "bucket": 2.0}),)},
     r"^requirements.lift.posed: bucket at 114.6°: beyond its range; give bucket in \[-13"),
    ({"digging_force": {"thumb": 1.0}}, r'digging_force: no cylinder "thumb"'),
    ({"clearances": (replace(EVERYTHING["clearances"][0], link="moon"),)},
     r'clearance.plate: no link "moon"'),
    ({"torque_share": {"thumb": 0.9}}, r'requirements.torque_share: no actuator "thumb"; choose'),
    ({"pin_boxes": {"boom": {"lug": 0.1}}}, r'pin_boxes.boom: no pin "lug"'),
]  # fmt: skip


@pytest.mark.parametrize(("settings", "message"), BAD_SETTINGS)
def test_settings_that_cannot_be(settings: dict[str, Any], message: str) -> None:
    machine = MACHINES["excavator"]()
    with pytest.raises(ArmDesignError, match=message):
        ad.optimize(
            machine,
            workspace_of("excavator"),
            replace(Requirements.of(machine), **settings),
            starts=1,
        )


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_number_that_is_none(value: float) -> None:
    for settings in (
        {"digging_force": {"stick": value}},
        {"lifts": (replace(FRONT, mass=value),)},
    ):
        with pytest.raises(ArmDesignError, match="is not allowed"):
            Requirements(**settings)  # type: ignore[arg-type]


def test_a_word_that_is_none() -> None:
    with pytest.raises(
        ArmDesignError, match=r"speed.a.at: 'best' is not allowed; give 'mean' or 'every'"
    ):
        Requirements(speeds=(Speed(name="a", at="best"),))  # type: ignore[arg-type]
    with pytest.raises(ArmDesignError, match="buckling_column"):
        Requirements(buckling_column="tube")  # type: ignore[arg-type]
    with pytest.raises(ArmDesignError, match=r"^requirements\.outline\.boom: has 2 points"):
        Requirements(outlines=(Outline(link="boom", points=((0, 0), (1, 1))),))


def test_requirements_read_the_file() -> None:
    """The numbers of robots/excavator_20t/excavator_20t.toml; the others are DESIGN.md's
    defaults.
    """
    machine = named("excavator_20t")
    stated = Requirements.of(machine)
    assert [o.link for o in stated.outlines] == ["chassis", "boom", "stick", "bucket"]
    assert {o.pin_radius for o in stated.outlines} == {0.11}
    assert {c.name: (c.link, *c.cylinders) for c in stated.clearances} == {
        "frame": ("chassis", "boom"),
        "boom_back": ("boom", "stick"),
        "stick_back": ("stick", "bucket"),
    }
    places = {"outlines": stated.outlines, "clearances": stated.clearances}
    digging = ("stick", "bucket")
    assert stated == Requirements(digging=digging, digging_share=0.95, pin_box=0.25, **places)
    changed = machine.replace({"requirements.pin_box_mm": 40.0, "requirements.digging.share": 0.9})
    assert Requirements.of(changed) == Requirements(
        digging=digging, digging_share=0.9, pin_box=0.04, **places
    )


def test_lift_and_torque_are_kept_by_default() -> None:
    """The numbers of DESIGN.md, in Python and in a file that states nothing."""
    kept = {"lift_share": 0.9, "torque_share": 0.95, "end_torque_share": 0.8}
    for requirements in (Requirements(), Requirements.of(MACHINES["double"]())):
        assert {name: getattr(requirements, name) for name in kept} == kept


@pytest.mark.parametrize(
    "setting", ["holding_share", "oil_total_share", "thrust_share", "pin_box", "transmission"]
)
@pytest.mark.parametrize("value", [-0.1, math.nan, math.inf])
def test_a_requirement_that_cannot_be_is_refused(setting: str, value: float) -> None:
    with pytest.raises(ArmDesignError, match=f"requirements.{setting}"):
        Requirements(**{setting: value})


def test_shares_by_actuator() -> None:
    """A number, or a table whose default is the schema's where it has none; in file and Python."""
    machine = demanding(named("excavator_20t"), "")
    table = "[requirements.torque_share]\ndefault = 0.95\nbucket = 0.9\n"
    for extra, wanted in (
        ("torque_share = 0.95\n", 0.95),
        (table, {"default": 0.95, "bucket": 0.9}),
        ("thrust_share = { boom = 1.3 }\n", None),
    ):
        file = demanding(machine, extra)
        read = Requirements.of(file)
        if wanted is None:
            assert read.thrust_share == {"default": 1.1, "boom": 1.3}
            assert read == replace(Requirements.of(machine), thrust_share={"boom": 1.3})
        else:
            assert read.torque_share == wanted
            assert read == replace(Requirements.of(machine), torque_share=wanted)
    assert hash(read) == hash(Requirements.of(file))
    assert Requirements(torque_share={"default": 0.9}) == Requirements(torque_share=0.9)


def test_a_share_is_set_and_asked_for_by_its_key() -> None:
    before = Requirements(torque_share=0.95)
    one = before.with_setting("torque_share.bucket", 0.9)
    assert one.torque_share == {"default": 0.95, "bucket": 0.9}
    assert [one.setting(f"torque_share{end}") for end in ("", ".boom", ".bucket")] == [
        0.95, 0.95, 0.9
    ]  # fmt: skip
    assert one.with_setting("torque_share", 0.8).torque_share == {"default": 0.8, "bucket": 0.9}
    assert one.stated_at("torque_share.boom") == "torque_share"
    assert one.stated_at("torque_share.bucket") == "torque_share.bucket"
    assert one.stated_at("digging_kN.boom") == "digging_kN.boom"
    with pytest.raises(ArmDesignError, match=r"torque_share.boom: -1 is not allowed; give a num"):
        Requirements(torque_share={"boom": -1})


def test_a_number_of_a_file_becomes_a_table() -> None:
    """Other actuators keep what the number said."""
    machine = named("excavator_20t").replace({"requirements.thrust_share": 1.2})
    changed = machine.replace({"requirements.thrust_share.boom": 1.3})
    assert Requirements.of(changed).thrust_share == {"default": 1.2, "boom": 1.3}
    again = changed.replace({"requirements.thrust_share.default": 1.1})
    assert Requirements.of(again).thrust_share == {"default": 1.1, "boom": 1.3}


def test_digging_cylinder_must_exist() -> None:
    with pytest.raises(ArmDesignError, match=r'requirements.digging: no cylinder "thumb"'):
        ad.optimize(named("paper_1dof"), requirements=Requirements(digging=("thumb",)))


@pytest.mark.parametrize("name", ["double", "odd", "shipped"])
def test_a_family_alone_says_of_its_requirements_what_all_together_say(name: str) -> None:
    """Names wanted: their families, which have no others; the rest is not computed."""
    problem = problem_of(name)
    x = some_x(problem, 1)
    every = {e.name: e for e in evaluations_at(problem, x)}
    for wanted in every:
        alone = list(evaluations_at(problem, x, None, {wanted}))
        (same,) = (e for e in alone if e.name == wanted)
        assert np.array_equal(same.constraint, every[wanted].constraint)
        assert len(alone) < len(every)
