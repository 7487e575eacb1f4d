"""`armdesign new`: files that load and map at once; and the schema for editors that lies beside
them.
"""

from __future__ import annotations

import json
import tomllib
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import armdesign as ad
from armdesign.inspection.file_faults import faults
from armdesign.inspection.inspection import inspect
from armdesign.machine import scaffold
from armdesign.machine.file.json_schema import DESCRIPTIONS, json_schema
from tests import machines
from tests.commands import Refused, assert_one_line, main

SHIPPED = Path(ad.__file__).with_name("machine.schema.json")


@pytest.mark.slow
@pytest.mark.parametrize("links", [1, 2, 3, 4, 5, 6])
def test_it_loads_maps_and_looks_sound(
    links: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["new", "my_boom", "--links", str(links)], monkeypatch) == 0
    assert {path.name for path in (tmp_path / "my_boom").iterdir()} == {
        "my_boom.toml",
        "my_boom.urdf",
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
    machine = ad.Machine.from_text(*scaffold.new("x", links), Path("x.toml"))
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
    machine = ad.Machine.from_text(*scaffold.new("x", links), Path("x.toml"))
    design = ad.optimize(machine, ad.Workspace.grid(machine, 4), starts=1)
    assert min(design.slacks.values()) >= -1e-9
    assert design.after.worst.frequency > 1.02 * design.before.worst.frequency


@pytest.mark.parametrize("links", [1, 4, 6])
def test_strokes_cover_the_ranges_of_the_urdf(links: int) -> None:
    text, urdf = scaffold.new("x", links)
    machine = ad.Machine.from_text(text, urdf, Path("x.toml"))
    assert machine.ranges == pytest.approx(machine.arm.limits, abs=1e-6)
    assert np.ptp(machine.ranges, axis=1).min() > 1


def test_the_files_explain_themselves() -> None:
    text, urdf = scaffold.new("x", 3)
    assert text.startswith("#:schema ./machine.schema.json\n")
    assert "EVERY NUMBER IS A PLACEHOLDER" in text
    assert "EVERY NUMBER IS A PLACEHOLDER" in urdf
    for key in ("bore_mm", "rod_mm", "stroke_mm", "closed_length_mm", "mass_kg", "pressure_bar"):
        assert any(key in line and "# replace" in line for line in text.splitlines()), key
    assert max(map(len, text.splitlines())) <= 120
    links = ET.fromstring(urdf).findall("link")
    assert all(
        link.find("visual/geometry/box") is not None
        for link in links
        if link.find("inertial") is not None
    )


def test_the_spring_in_its_comments_is_one(tmp_path: Path) -> None:
    """Without its comment signs only the joint, which the URDF lacks, is wrong."""
    text, urdf = scaffold.new("crane", 2)
    assert "\n# [spring.carriage]" in text
    head, spring = text.split("# [spring.carriage]")
    text = head + "[spring.carriage]" + spring.replace("\n# ", "\n")
    (tmp_path / "crane.toml").write_text(text, encoding="utf-8")
    (tmp_path / "crane.urdf").write_text(urdf, encoding="utf-8")
    (fault,) = faults(tmp_path / "crane.toml")
    assert "joint rocking: is not in the URDF (named in spring)" in str(fault)


def test_it_does_not_overwrite(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.urdf").write_text("mine")
    assert main(["new", "a", "--out", "."], monkeypatch) == 2
    assert_one_line(
        capfd.readouterr().err, "a.urdf: exists already; give another name or --out another folder"
    )
    assert [path.name for path in tmp_path.iterdir()] == ["a.urdf"]
    assert (tmp_path / "a.urdf").read_text() == "mine"


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
        ([""], "is not allowed; start with a letter"),
        (["9x"], "is not allowed; start with a letter"),
        (["x" * 65], "at most 64"),
        (["x\n"], "is not allowed"),
        (["x", "--links", "0"], "--links: 0 is not allowed; give a whole number from 1 to 6"),
        (["x", "--links", "7"], "--links: 7 is not allowed"),
        (["x", "--links", "two"], "--links': Input should be a valid integer"),
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
