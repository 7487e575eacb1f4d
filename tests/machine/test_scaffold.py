"""`armdesign new`: a file that loads and maps at once; and the schema for editors beside it."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import armdesign as ad
from armdesign.inspection.file_faults import faults
from armdesign.inspection.inspection import inspect
from armdesign.machine import template
from armdesign.machine.file import machine_file
from armdesign.machine.file.json_schema import DESCRIPTIONS, json_schema
from armdesign.machine.parallelogram import with_four_bar
from tests import machines
from tests.commands import Refused, assert_one_line, main

SHIPPED = Path(ad.__file__).with_name("machine.schema.json")


def scaffolded(name: str, **options: Any) -> ad.Machine:
    return ad.Machine.from_text(template.new(name, **options), "", Path(f"{name}.toml"))


@pytest.mark.slow
@pytest.mark.parametrize("links", [1, 2, 3, 4, 5, 6])
def test_it_loads_maps_and_looks_sound(
    links: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["new", "my_boom", "--links", str(links)], monkeypatch) == 0
    assert {path.name for path in (tmp_path / "my_boom").iterdir()} == {
        "my_boom.toml",
        "machine.schema.json",
    }
    assert faults("my_boom") == []
    machine = ad.load("my_boom")
    assert len(machine.joints) == links
    workspace = ad.Workspace.grid(machine, 5 if links < 5 else 3)
    frequencies = ad.frequency_map(machine, workspace)
    assert 0.5 < frequencies.worst.frequency < 20
    assert inspect(machine, workspace).findings() == []
    assert main(["map", "my_boom", "--points", "3" if links < 5 else "2"], monkeypatch) == 0


@pytest.mark.slow
@pytest.mark.parametrize("links", [1, 2, 3, 4, 5, 6])
def test_it_has_a_design(links: int) -> None:
    """Its requirements as they stand: cylinders of the catalogue that it names meet them all."""
    machine = scaffolded("x", links=links)
    assert machine.section.requirements.catalogue == "5mm"
    kept = {"lift_share": 0.9, "torque_share": 0.95, "end_torque_share": 0.8}
    assert {key: getattr(ad.Requirements.of(machine), key) for key in kept} == kept
    workspace = ad.Workspace.grid(machine, 3 if links < 5 else 2)
    design = ad.size_cylinders(machine, workspace)
    assert min(design.slacks.values()) >= -1e-9
    sizes = {(round(1e3 * c.bore, 6), round(1e3 * c.rod, 6)) for c in design.machine.cylinders}
    assert all(bore % 5 == 0 and rod % 5 == 0 for bore, rod in sizes)
    assert design.after.worst.frequency >= design.before.worst.frequency * (1 - 1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("links", [1, 2])
def test_its_pins_can_be_moved_for_more(links: int) -> None:
    machine = scaffolded("x", links=links)
    design = ad.optimize(machine, ad.Workspace.grid(machine, 4), starts=1)
    assert min(design.slacks.values()) >= -1e-9
    assert design.after.worst.frequency > 1.02 * design.before.worst.frequency


@pytest.mark.parametrize("links", [1, 4, 6])
def test_strokes_cover_the_limits(links: int) -> None:
    machine = scaffolded("x", links=links)
    assert machine.ranges == pytest.approx(machine.arm.limits, abs=1e-6)
    assert np.ptp(machine.ranges, axis=1).min() > 1


OFFERED = ("boom", "loader_crane", "excavator_20t", "mini_excavator_2t", "patu_boom", "paper_1dof")
LIKE = OFFERED[1:]


@pytest.mark.parametrize("links", [1, 2, 3])
def test_a_knee_on_the_wrong_side_is_named(links: int) -> None:
    """Its strokes then fit nothing; the axis of its joint, which is right, is not blamed."""
    right = template.new("x", links=links, four_bar=True)
    text = right.replace('knee = "left"', 'knee = "right"')
    line = text[: text.index("knee =")].count("\n") + 1
    with pytest.raises(ad.ArmDesignError) as raised:
        ad.Machine.from_text(text, "", Path("x.toml"))
    message = str(raised.value)
    assert 'four_bar.knee: "right" looks like the wrong side: with "left" the strokes' in message
    assert 'write knee = "left"' in message
    assert message.endswith(f"(line {line})")


@pytest.mark.parametrize("like", LIKE)
@pytest.mark.parametrize("four_bar", [False, True])
def test_like_a_machine_that_there_is(like: str, four_bar: bool) -> None:
    """Its own numbers, to what is left out by rounding; a four-bar keeps strokes and torques."""
    today, machine = machines.named(like), scaffolded("x", like=like, four_bar=four_bar)
    assert machine.section.urdf is None
    q = machines.inner_poses(today, 10)
    one, other = today.at(q), machine.at(q)
    assert other.mass_matrix == pytest.approx(one.mass_matrix, rel=1e-6)
    assert other.moment_arms == pytest.approx(one.moment_arms, rel=1e-4, abs=1e-6)
    assert machine.ranges == pytest.approx(today.ranges, abs=1e-4)
    frequencies = [ad.natural_modes(poses).frequencies for poses in (one, other)]
    assert frequencies[1] == pytest.approx(frequencies[0], rel=1e-4)
    has = any(table.four_bar is not None for table in machine.section.cylinder.values())
    assert has == (four_bar or "excavator" in like or like == "loader_crane")


@pytest.mark.parametrize("links", [1, 2, 3, 4, 5, 6])
def test_a_four_bar_keeps_ranges_and_moment_arms(links: int) -> None:
    """A parallelogram: the knee goes the way of the old rod end."""
    direct, geared = (
        scaffolded("x", links=links, four_bar=four_bar) for four_bar in (False, True)
    )
    assert geared.section.cylinder[geared.joints[-1]].four_bar is not None
    assert geared.ranges == pytest.approx(direct.ranges, abs=1e-5)
    q = machines.inner_poses(direct, 5)
    arms = [machine.at(q).moment_arms for machine in (direct, geared)]
    assert arms[1] == pytest.approx(arms[0], abs=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("like", OFFERED)
@pytest.mark.parametrize("four_bar", [False, True])
def test_every_combination_maps(
    like: str, four_bar: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    words = ["--links", "3"] if like == "boom" else ["--like", like]
    assert main(["new", "x", *words, *(["--four-bar"] if four_bar else [])], monkeypatch) == 0
    assert faults("x") == []
    assert main(["map", "x", "--points", "3"], monkeypatch) == 0


def test_the_file_explains_itself() -> None:
    """Each or together is said of every number that could be either, in every table of it."""
    text = template.new("x", links=3, four_bar=True)
    assert text.startswith("#:schema ./machine.schema.json\n")
    assert "EVERY NUMBER IS A PLACEHOLDER" in text
    assert max(map(len, text.splitlines())) <= 99
    either = ("count", "bore_mm", "rod_mm", "barrel_kg", "rod_kg", "compliance_m_per_N")
    either += ("dead_volume_l", "rated_flow_l_per_min", "rocker_kg", "coupler_kg")
    lines = text.splitlines()
    for key in either:
        at = [k for k, line in enumerate(lines) if line.startswith(f"{key} = ")]
        assert at, key
        for k in at[: 1 if key == "count" else None]:
            said = f"{lines[k - 1] if lines[k - 1].startswith('#') else ''} {lines[k]}"
            assert re.search(r"\b(each|together|in parallel)\b", said), (key, said)
    assert text.count("[links.") == 5


@pytest.mark.parametrize("like", ["", *LIKE])
def test_tables_in_its_comments_are_tables(like: str) -> None:
    """Without its comment sign each of them is read, but for joints that the machine has not."""
    text = template.new("x", like=like)
    head, _, further = text.partition("# ----- what a machine may have besides")
    blocks = further.split("\n\n")[1:]
    assert blocks
    for block in blocks:
        table = "\n".join(line.removeprefix("# ") for line in block.splitlines())
        _, wrong, _ = machine_file.faults(f"{head}\n{table}\n", "x.toml")
        known = {"x.toml: spring.carriage.joint", "x.toml: motor.slew"}
        assert not [fault for fault in wrong if fault.part not in known], table
    names = {block.splitlines()[0].split("]")[0] for block in blocks}
    assert ("# [tolerances" in names) == (like in ("", "paper_1dof"))


def test_it_says_why_there_is_no_four_bar() -> None:
    telescope = """
[links.root]
[links.slide]
parent = "root"
type = "prismatic"
limits_mm = [0, 400]
mass_kg = 10
length_mm = 500
"""
    text = template.new("x", links=1)
    head, tail = text.split("# links:")[0], text[text.index("# payload:") :]
    text = head.replace('"boom"', '"slide"') + telescope + tail.replace('"boom"', '"slide"')
    text = re.sub(r'"base", at_mm = \[.*?\]', '"root", at_mm = [-600, 0, 0]', text)
    text = re.sub(r"rod_end = .*", 'rod_end = { link = "slide", at_mm = [0, 0, 0] }', text)
    text = re.sub(r"(?m)^stroke_mm = .*", "stroke_mm = 400", text)
    text = re.sub(r"(?m)^closed_length_mm = .*", "closed_length_mm = 600", text)
    machine = ad.Machine.from_text(text, "", Path("x.toml"))
    with pytest.raises(ad.ArmDesignError, match="--four-bar: there is no joint that one pin-to"):
        with_four_bar(tomllib.loads(text), machine)


def test_it_does_not_overwrite(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.toml").write_text("mine")
    assert main(["new", "a", "--out", "."], monkeypatch) == 2
    assert_one_line(
        capfd.readouterr().err, "a.toml: exists already; give another name or --out another folder"
    )
    assert [path.name for path in tmp_path.iterdir()] == ["a.toml"]
    assert (tmp_path / "a.toml").read_text() == "mine"


def test_two_machines_share_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["new", "a", "--out", "here"], monkeypatch) == 0
    (tmp_path / "here" / "machine.schema.json").write_text("mine")
    assert main(["new", "b", "--out", "here"], monkeypatch) == 0
    assert (tmp_path / "here" / "machine.schema.json").read_text() == "mine"
    assert ad.load("here/a.toml").name == "a"
    assert ad.load("here/b.toml").name == "b"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["../up"], 'name: "../up" is not allowed; start with a letter'),
        (["a b"], "is not allowed; start with a letter"),
        ([""], "new: is followed by an empty word"),
        (["9x"], "is not allowed; start with a letter"),
        (["x" * 65], "at most 64"),
        (["x\n"], "is not allowed"),
        (["x", "--links", "0"], "--links: 0 is not allowed; give a whole number from 1 to 6"),
        (["x", "--links", "7"], "--links: 7 is not allowed"),
        (["x", "--links", "3", "--like", "paper_1dof"], "--links: contradicts --like"),
        (["x", "--like", "excavator"], "excavator: no such machine; did you mean"),
        (["x", "--links", "two"], '--links: "two" is no whole number; give one, as 3'),
        (["x", "--out", "/proc/none"], "--out /proc/none"),
    ],
)
def test_bad_input(words: list[str], message: str, refused: Refused) -> None:
    refused(["new", *words], message)


# ------------------------------------------------------------------------------------------ schema


def test_the_shipped_schema_is_that_of_the_model() -> None:
    """Else write it again: open(armdesign/machine.schema.json, "w").write(json_schema())."""
    assert SHIPPED.read_text(encoding="utf-8") == json_schema()


def described(schema: dict[str, Any], node: dict[str, Any], data: Any, path: str) -> None:
    """Every key of a file has its place in the schema, and its type is the schema's."""
    if "$ref" in node:
        node = schema["$defs"][node["$ref"].rpartition("/")[2]]
    types = {"object": dict, "array": list, "string": str, "number": (int, float), "integer": int}
    if "oneOf" in node:  # a number for all, or a table by name
        node = next(one for one in node["oneOf"] if isinstance(data, types[one["type"]]))  # type: ignore[arg-type]
    if "type" in node:
        assert isinstance(data, types[node["type"]]), path  # type: ignore[arg-type]
    if isinstance(data, dict):
        for key, value in data.items():
            below = node.get("properties", {}).get(key)
            below = below or next(iter(node.get("patternProperties", {}).values()), None)
            below = below or (
                node["additionalProperties"] if node.get("additionalProperties") else None
            )
            assert below is not None, f"{path}.{key}"
            described(schema, below, value, f"{path}.{key}")


@pytest.mark.parametrize(
    "name", ["excavator_20t", "loader_crane", "paper_1dof", "mini_excavator_2t"]
)
def test_the_shipped_machines_follow_it(name: str) -> None:
    document = json.loads(json_schema())
    described(document, document, tomllib.loads(machines.named(name).text), name)


def test_units_and_descriptions_are_in_it() -> None:
    document = json.loads(json_schema())
    cylinder = document["$defs"]["CylinderSection"]["properties"]
    assert cylinder["bore_mm"]["description"] == "inner diameter of the barrel; each [mm]"
    assert cylinder["compliance_m_per_N"]["description"].endswith("[m/N]")
    assert "null" not in json_schema()
    keys = {
        key
        for section in (document, *document["$defs"].values())
        for key in section.get("properties", {})
    }
    assert set(DESCRIPTIONS) <= keys


def test_no_name_is_refused_in_python_too() -> None:
    with pytest.raises(ad.ArmDesignError, match='"" is not allowed; start with a letter'):
        template.new("")
