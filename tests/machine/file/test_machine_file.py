"""The machine file: what is read, variants by key path, saving without losing a comment."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

import armdesign as ad
from armdesign.machine.file.section import plain
from armdesign.machine.loading import shipped
from armdesign.machine.machine import Machine
from tests.machine.file.changed_files import EXCAVATOR, FILE, TEXT, changed_lines, unusual

# ----------------------------------------------------------------------------------------- reading


@pytest.mark.parametrize("name", [*shipped(), "shares by actuator"])
def test_tables_are_as_pydantic_gives_them(name: str) -> None:
    """Down to the last number, in its order; and lists are copies."""
    shares = {"requirements.lift_share": {"default": 0.9, "boom": 0.8}}
    machine = ad.load(name) if name in shipped() else EXCAVATOR.replace(shares)
    tables = plain(machine.section)
    assert repr(tables) == repr(machine.section.model_dump())
    tables["joints"].append("another")
    assert "another" not in machine.section.joints


def test_units_are_converted_once() -> None:
    """By hand from excavator_20t.toml, SI inside."""
    boom = EXCAVATOR.cylinders[0]
    assert (boom.name, boom.count) == ("boom", 2)
    values = (boom.bore, boom.rod, boom.stroke, boom.closed_length, boom.cap_dead_volume)
    assert_allclose(values, (0.120, 0.085, 1.260, 1.825, 5.6e-3), rtol=1e-12)
    assert_allclose(EXCAVATOR.linkages[0].base.at, (0.4615, 0, -0.6025), rtol=1e-12)
    assert_allclose(EXCAVATOR.fluid.bulk_modulus, 1.2e9, rtol=1e-12)
    assert_allclose(
        (EXCAVATOR.supply.pressure, EXCAVATOR.supply.flow), (350e5, 0.429 / 60), rtol=1e-12
    )
    assert_allclose(EXCAVATOR.payloads[1].pitch, np.deg2rad([120, 240]), rtol=1e-12)
    assert boom.valve is not None
    assert_allclose((boom.valve.rated_drop, boom.valve.rated_flow), (14e5, 0.429 / 60), rtol=1e-12)
    assert EXCAVATOR.payload.name == "empty", "a machine carries its first load case"


@pytest.mark.parametrize("name", ["excavator_20t", "paper_1dof"])
def test_shipped_names_work_from_any_folder(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / name).mkdir()  # results of the machine in a folder of its name do not hide it
    assert ad.load(name).name == name
    monkeypatch.chdir(FILE.parent.parent)
    assert ad.load(name).name == name
    assert (
        ad.load(Path(name)).name
        == ad.load(f"{name}/{name}.toml").name
        == ad.load(shipped()[name].parent).name
    )


def test_byte_order_mark_and_windows_line_ends_are_read_and_kept(tmp_path: Path) -> None:
    windows = TEXT.replace("\n", "\r\n")
    (tmp_path / "excavator_20t.toml").write_bytes(b"\xef\xbb\xbf" + windows.encode())
    (tmp_path / "excavator_20t.urdf").write_text(EXCAVATOR.urdf_text, encoding="utf-8")
    machine = ad.load(tmp_path / "excavator_20t.toml").replace({"cylinder.boom.bore_mm": 121})
    saved = machine.save(tmp_path / "new.toml").read_bytes().decode()
    assert saved == windows.replace("bore_mm = 120", "bore_mm = 121", 1)


# ---------------------------------------------------------------------------------------- variants

CHANGES = [
    ("cylinder.boom.bore_mm", 131.5, "bore_mm = 120", "bore_mm = 131.5"),
    (
        "cylinder.boom.base.at_mm",
        [460, 0.0, -600.25],
        "at_mm = [461.5, 0, -602.5]",
        "at_mm = [460, 0, -600.25]",
    ),
    ("cylinder.boom.dead_volume_l.cap", 6.0, "{ cap = 5.6, annulus", "{ cap = 6.0, annulus"),
    ("cylinder.bucket.four_bar.knee", "right", 'knee = "left"', 'knee = "right"'),
    ("payload.full.mass_kg", 900, "mass_kg = 1600", "mass_kg = 900"),
    ("payload.full.pitch_deg", (110, 250), "pitch_deg = [120, 240]", "pitch_deg = [110, 250]"),
    ("requirements.digging.share", 0.9, "share = 0.95", "share = 0.9"),
    ("frozen.swing", 0.5, "swing = 0.0", "swing = 0.5"),
    ("title", "größer", '"20 t crawler excavator"', '"größer"'),
]


@pytest.mark.parametrize(("path", "value", "old", "new"), CHANGES)
def test_replace_changes_the_value_and_nothing_else(
    path: str, value: object, old: str, new: str
) -> None:
    """Line by line: comments, spacing, inline tables and the order of keys stay as the author
    wrote them.
    """
    ((before, after),) = changed_lines(TEXT, EXCAVATOR.replace({path: value}).text)
    assert after == before.replace(old, new)


@pytest.mark.parametrize(
    "path", ["cylinder.boom.base.at_mm", "cylinder.boom.bore_mm", "supply.flow_l_per_min"]
)
def test_replace_in_a_file_as_a_person_writes_it(path: str) -> None:
    """Lists over several lines with comments, dotted keys, sub-tables far from their table."""
    machine = unusual()
    assert machine.cylinders[0].valve is not None
    value = [470.5, 0, -600.5] if path.endswith("at_mm") else 123.5
    changed = machine.replace({path: value})
    changes = changed_lines(machine.text, changed.text)
    assert len(changes) == (2 if path.endswith("at_mm") else 1)
    for before, after in changes:
        assert before.partition("#")[2] == after.partition("#")[2]
    again = Machine.from_text(changed.text, changed.urdf_text, changed.source)
    assert again.section == changed.section


ABSENT = [
    ("cylinder.boom.hose.cap_l", 1.5, lambda m: m.cylinders[0].cap_hose_volume, 1.5e-3),
    ("cylinder.boom.barrel_kg", 0, lambda m: m.section.cylinder["boom"].barrel_kg, 0),
    (
        "cylinder.boom.friction.stribeck_velocity_mm_per_s",
        8,
        lambda m: m.cylinders[0].friction.stribeck_velocity,
        8e-3,
    ),
    ("bands.payload_share", [0.8, 1.2], lambda m: m.section.bands.payload_share, [0.8, 1.2]),
    ("cylinder.boom.valve.overlap_percent", 5, lambda m: m.cylinders[0].valve.overlap, 0.05),
    ("requirements.end_margin", 0.05, lambda m: m.section.requirements.end_margin, 0.05),
    (
        "requirements.digging.cylinders",
        ["stick"],
        lambda m: m.section.requirements.digging.cylinders,
        ["stick"],
    ),
]


@pytest.mark.parametrize(("path", "value", "read", "expected"), ABSENT)
def test_replace_adds_an_optional_key(
    path: str, value: object, read: object, expected: object
) -> None:
    """A key that the file leaves to its default may be set; every line that was there stays."""
    changed = EXCAVATOR.replace({path: value})
    assert (
        read(changed) == pytest.approx(expected)
        if not isinstance(expected, list)
        else read(changed) == expected
    )
    kept = changed.text.splitlines()
    lost = [line for line in TEXT.splitlines() if line not in kept]
    assert len(lost) <= (1 if path == "requirements.digging.cylinders" else 0)


@pytest.mark.parametrize("path", ["requirements.end_margin", "requirements.pin_box_mm"])
def test_replace_makes_a_table_that_is_missing(path: str) -> None:
    bare = Machine.from_text(
        TEXT[: TEXT.index("[requirements]")], EXCAVATOR.urdf_text, Path("a.toml")
    )
    changed = bare.replace({path: 0.1})
    assert getattr(changed.section.requirements, path.split(".")[1]) == 0.1
    assert changed.section.cylinder == bare.section.cylinder
    assert (
        Machine.from_text(changed.text, changed.urdf_text, changed.source).section
        == changed.section
    )


def test_replace_takes_numbers_of_numpy() -> None:
    pin = np.array(EXCAVATOR.linkages[0].base.at) * 1000
    changed = EXCAVATOR.replace(
        {"cylinder.boom.bore_mm": np.float64(125), "cylinder.boom.base.at_mm": pin}
    )
    assert changed.cylinders[0].bore == pytest.approx(0.125)
    assert_allclose(changed.linkages[0].base.at, EXCAVATOR.linkages[0].base.at, rtol=1e-12)


def test_replace_leaves_the_machine_as_it_was_and_keeps_its_load_case() -> None:
    before = EXCAVATOR.text
    changed = EXCAVATOR.with_payload("full").replace({"cylinder.stick.bore_mm": 150.0})
    assert changed.payload.name == "full"
    assert EXCAVATOR.text == before
    assert EXCAVATOR.cylinders[1].bore == 0.140
    back = changed.replace({"cylinder.stick.bore_mm": 140})
    assert back.text == before


BAD_CHANGES = [
    ({"cylinder.boom.bore": 130}, r'cylinder\.boom\.bore: unknown key; did you mean "bore_mm"'),
    ({"cylinder.bom.bore_mm": 130}, r'no "bom" in the file; did you mean "boom"'),
    ({"payload.half.mass_kg": 3}, r'no "half" in the file; choose from: empty, full'),
    ({"": 1}, "is not a key path"),
    ({".": 1}, "choose from: name"),
    ({5: 1}, "is not a key path"),
    ({"cylinder.boom": 1}, "is a table, not a value"),
    ({"cylinder.boom.bore_mm.x": 1}, "is a value, not a table"),
    (
        {"cylinder.boom.base.at_mm.0": 1},
        r'"at_mm" is a list; give the whole of it, now cylinder\.boom\.base\.at_mm=\[461\.5, ',
    ),
    ({"spring.a.at_mm": 1}, r'no "a" in the file; write \[spring\.a\] first, with joint, '),
    ({"requirements.lfit.a.mass_kg": 1}, 'did you mean "lift"'),
    ({"cylinder.boom.base.at_mm": [1, 2]}, "list of 3 values"),
    ({"cylinder.boom.base.at_mm": [1, 2, None]}, "cannot hold"),
    ({"cylinder.boom.base.at_mm": [1, 2, np.nan]}, r"at_mm\.2: nan"),
    ({"cylinder.boom.base.at_mm": 5}, "list of 3 values"),
    (
        {"cylinder.boom.bore_mm": -1},
        r"bore_mm: -1 is not allowed; give a number in \(0, 100000\] mm",
    ),
    ({"cylinder.boom.bore_mm": None}, "cannot hold None"),
    ({"cylinder.boom.bore_mm": "x"}, "give a number in"),
    ({"cylinder.boom.bore_mm": True}, "true is not allowed"),
    ({"cylinder.boom.bore_mm": 1j}, "cannot hold"),
    ({"cylinder.boom.bore_mm": object()}, "cannot hold"),
    ({"cylinder.boom.bore_mm": {}}, "empty table is not allowed"),
    (
        {"cylinder.boom.bore_mm": 50},
        r"rod_mm: 85 mm does not fit the bore; give a rod in \(0, 50\) mm",
    ),
    ({"cylinder.boom.count": 2.0}, "whole number in"),
    ({"urdf": "a/.."}, "is not a file name"),
    (None, "expected {key path: value}"),
    ("cylinder.boom.bore_mm", "expected {key path: value}"),
]


@pytest.mark.parametrize(("changes", "message"), BAD_CHANGES)
def test_replace_refuses(changes: object, message: str) -> None:
    with pytest.raises(ad.ArmDesignError, match=message) as caught:
        EXCAVATOR.replace(changes)
    assert str(caught.value).startswith("excavator_20t.toml")
    assert "\n" not in str(caught.value)
