"""A cylinder whose joints are all frozen is idle, as a motor is: the machine answers as if its
file had none, but for what it weighs (``test_idle_masses``).
"""

from __future__ import annotations

import dataclasses
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

import armdesign as ad
from armdesign.inspection.file_faults import faults
from armdesign.inspection.inspection import inspect
from armdesign.machine.file import toml_writing
from armdesign.machine.machine import Machine
from tests import machines
from tests.commands import main

EXCAVATOR = machines.named("excavator_20t")
FROZEN = EXCAVATOR.replace({"joints": ["boom", "stick"], "frozen.bucket": -1.0})


def without(cylinder: str) -> Machine:
    """The same machine from a file that does not have the cylinder's tables, nor names it."""
    data = tomllib.loads(FROZEN.text)
    del data["cylinder"][cylinder]
    requirements = data["requirements"]
    requirements["digging"]["cylinders"].remove(cylinder)
    requirements["clearance"] = {
        name: table
        for name, table in requirements["clearance"].items()
        if table["cylinders"] != [cylinder]
    }
    text = toml_writing.dump(data, "without")
    return Machine.from_text(text, FROZEN.urdf_text, Path("x.toml"))


def test_it_answers_as_if_the_file_had_no_such_cylinder() -> None:
    bare = without("bucket")
    assert "bucket" in FROZEN.section.cylinder
    assert "bucket" not in bare.section.cylinder
    assert (
        [c.name for c in FROZEN.cylinders] == [c.name for c in bare.cylinders] == ["boom", "stick"]
    )
    assert FROZEN.idle == {"bucket": ["bucket"], "swing": ["swing"]}
    q = machines.inner_poses(bare, 5)
    for payload in ("empty", "full"):
        modes, expected = (ad.natural_modes(m.with_payload(payload).at(q)) for m in (FROZEN, bare))
        assert_allclose(modes.frequencies, expected.frequencies, rtol=0)
        assert_allclose(modes.locked_frequencies, expected.locked_frequencies, rtol=0)
    assert_allclose(FROZEN.ranges, bare.ranges, rtol=0)
    assert ad.Requirements.of(FROZEN) == ad.Requirements.of(bare)
    assert ad.Requirements.of(FROZEN).digging == ("stick",)


def test_saving_keeps_its_table_and_freeing_the_joint_wakes_it(tmp_path: Path) -> None:
    again = ad.load(FROZEN.replace({"cylinder.bucket.bore_mm": 121}).save(tmp_path / "a.toml"))
    assert again.section.cylinder["bucket"].bore_mm == 121
    awake = again.replace({"joints": ["boom", "stick", "bucket"], "cylinder.bucket.bore_mm": 120})
    q = EXCAVATOR.ranges.mean(axis=1)
    assert_allclose(awake.at(q).oil_stiffness, EXCAVATOR.at(q).oil_stiffness, rtol=0)


def test_check_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    path = FROZEN.save(tmp_path / "a.toml")
    assert faults(path) == []
    assert main(["check", str(path)], monkeypatch) == 0
    assert "idle: joint bucket is frozen" in re.sub(r"\s+", " ", capfd.readouterr().out)
    words = {f.part: f.words for f in inspect(FROZEN, ad.Workspace.grid(FROZEN, 4)).findings()}
    assert "cylinder.bucket" in words


@pytest.mark.slow
def test_every_command_works(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    FROZEN.save(tmp_path / "a.toml")
    assert main(["map", "a.toml", "--points", "3", "--out", "map"], monkeypatch) == 0
    assert (
        "bucket"
        not in (tmp_path / "map" / "map.csv").read_text(encoding="utf-8").partition("\n")[0]
    )
    assert (
        main(
            ["optimize", "a.toml", "--points", "3", "--vary", "areas", "--free", "--out", "new"],
            monkeypatch,
        )
        == 0
    )
    optimized = ad.load(tmp_path / "new" / "excavator_20t_optimized.toml")
    assert optimized.section.cylinder["bucket"] == FROZEN.section.cylinder["bucket"]
    assert optimized.section.cylinder["boom"] != FROZEN.section.cylinder["boom"]


def test_what_is_idle_cannot_vary() -> None:
    space = ad.Workspace.grid(FROZEN, 3)
    with pytest.raises(
        ad.ArmDesignError,
        match="the bucket cylinder stands still: joint bucket is frozen; vary anoth",
    ):
        ad.optimize(FROZEN, space, vary=("cylinder.bucket.bore_mm",))


@pytest.mark.slow
def test_motors_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every cylinder idle: the slewing motor has a map, and nothing to design."""
    one_joint = {
        "joints": ["swing"],
        "frozen.boom": 0.3,
        "frozen.stick": -1.0,
        "frozen.bucket": -1.0,
    }
    slewing = EXCAVATOR.replace(one_joint | {"payload.full.pitch_deg": [-180, 180]})
    assert slewing.cylinders == ()
    path = slewing.save(tmp_path / "a.toml")
    monkeypatch.chdir(tmp_path)
    assert main(["map", str(path), "--points", "5"], monkeypatch) == 0
    with pytest.raises(
        ad.ArmDesignError, match="vary: no cylinder of the machine moves: nothing can vary"
    ):
        ad.optimize(slewing, ad.Workspace.grid(slewing, 5))


def test_a_cylinder_across_frozen_and_moving_joints_still_counts() -> None:
    """`long` spans boom and stick; with the stick frozen it moves the boom alone, as a cylinder on
    the boom would.
    """
    crossing = machines.named("crossing")
    at = 0.1
    held = crossing.replace({"joints": ["boom"], "frozen": {"stick": at}})
    assert [c.name for c in held.cylinders] == ["lift", "long"]
    q = np.linspace(*held.ranges[0], 5)[1:-1, None]
    whole = crossing.at(np.column_stack([np.full(3, at), q]))
    assert_allclose(held.at(q).lengths, whole.lengths, rtol=1e-12)
    assert_allclose(held.at(q).moment_arms[:, :, 0], whole.moment_arms[:, :, 1], rtol=1e-10)


def test_a_four_bar_that_stands_still_is_a_pin() -> None:
    """Its joint frozen, its cylinder from another link: the knee is a point of the pivot's
    link.
    """
    machine = machines.named("four_bar_from_boom")
    held = machine.replace({"joints": ["boom", "stick"], "frozen": {"bucket": 0.05}})
    assert [c.name for c in held.cylinders] == [c.name for c in machine.cylinders]
    q = machines.inner_poses(held, 3)
    whole = machine.at(np.column_stack([q, np.full(3, 0.05)]))
    assert_allclose(held.at(q).lengths, whole.lengths, rtol=1e-12)
    assert_allclose(held.at(q).moment_arms, whole.moment_arms[:, :, :2], rtol=1e-9, atol=1e-12)


def test_pins_on_one_body_are_still_a_fault() -> None:
    """No joint at all between the pins, frozen or not."""
    message = (
        r"cylinder\.boom: no joint lies between its pins; put its pins on links that move to each"
        r" other"
    )
    with pytest.raises(ad.ArmDesignError, match=message):
        FROZEN.replace(
            {"cylinder.boom.rod_end.link": "chassis", "cylinder.boom.rod_end.at_mm": [0, 0, 0]}
        )


def test_what_is_changed_in_memory_is_another_machine_to_a_journal() -> None:
    """Also an idle cylinder, the arm, and what the file states: the texts do not tell."""
    (cylinder, linkage), *others = FROZEN.idle_cylinders
    heavier = dataclasses.replace(cylinder, barrel_mass=9000.0)
    other = machines.named("excavator_12t").arm
    stated = FROZEN.section.model_copy(update={"title": "another"})
    changed = [
        dataclasses.replace(FROZEN, idle_cylinders=((heavier, linkage), *others)),
        dataclasses.replace(FROZEN, arm=other),
        dataclasses.replace(FROZEN, arm=FROZEN.arm.within(0, -0.1, 0.1)),
        dataclasses.replace(FROZEN, section=stated),
    ]
    identities = [machine.identity for machine in (FROZEN, *changed)]
    assert len({repr(identity) for identity in identities}) == 5
    again = Machine.from_text(FROZEN.text, FROZEN.urdf_text, FROZEN.source)
    assert again.identity == FROZEN.identity
