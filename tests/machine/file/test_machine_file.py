"""The machine file: what is read, variants by key path, saving without losing a comment."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

import armdesign as ad
from armdesign.machine.loading import shipped
from armdesign.machine.machine import Machine
from tests import machines

EXCAVATOR = machines.named("excavator_20t")
FILE = shipped()["excavator_20t"]
TEXT = FILE.read_text(encoding="utf-8")
UNUSUAL = """# comments everywhere, tables out of order, dotted keys
name = "odd"    # a name
urdf = 'excavator_20t.urdf'
joints = [      # q
    "boom",     # first
    "stick",
    "bucket",   # last
]
tool = {link = "bucket", at_mm = [ 1502 , 0 , 0 ]}   # tip
supply.pressure_bar = 350
supply.flow_l_per_min = 4.29e2    # both pumps

[cylinder.boom]  # two of them
count = 2
bore_mm = 120    # [mm]
rod_mm = 85.0
stroke_mm = 1_260
closed_length_mm = 1825
dead_volume_l.cap = 5.6
dead_volume_l.annulus = 5.6   # hoses included
[cylinder.boom.base]
link = "chassis"
at_mm = [461.5,   # x
         0,       # y
         -602.5]  # z
[cylinder.boom.rod_end]
link = "boom"
at_mm = [2233.7, 0, 950.5]

[fluid]          # between the cylinders
bulk_modulus_MPa = 1200

"""
LATE = """
[payload.full]
mass_kg = 1600
link = "bucket"
at_mm = [645, 0, 435]

[cylinder.boom.valve]  # far from its cylinder
rated_flow_l_per_min = 429
rated_drop_bar = 14
natural_frequency_hz = 10
damping_ratio = 0.8
"""


def unusual() -> Machine:
    """A file as a person might write it, with the stick and bucket cylinders of the shipped
    one.
    """
    rest = TEXT[TEXT.index("[cylinder.stick]") : TEXT.index("[requirements]")]
    return Machine.from_text(UNUSUAL + rest + LATE, EXCAVATOR.urdf_text, Path("odd.toml"))


def changed_lines(before: str, after: str) -> list[tuple[str, str]]:
    """Pairs of lines that differ; both texts must have as many."""
    old, new = before.splitlines(), after.splitlines()
    assert len(old) == len(new)
    return [pair for pair in zip(old, new, strict=True) if pair[0] != pair[1]]


def frequencies(machine: Machine) -> np.ndarray:
    q = machines.inner_poses(EXCAVATOR, 4, seed=2)
    return ad.natural_modes(machine.with_payload("full").at(q)).frequencies


# ----------------------------------------------------------------------------------------- reading


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
    made = machine.replace({path: value})
    changes = changed_lines(machine.text, made.text)
    assert len(changes) == (2 if path.endswith("at_mm") else 1)
    for before, after in changes:
        assert before.partition("#")[2] == after.partition("#")[2]
    again = Machine.from_text(made.text, made.urdf_text, made.source)
    assert again.section == made.section


ABSENT = [
    ("cylinder.boom.hose.cap_l", 1.5, lambda m: m.cylinders[0].cap_hose_volume, 1.5e-3),
    ("cylinder.boom.barrel_kg", 0, lambda m: m.section.cylinder["boom"].barrel_kg, 0),
    (
        "cylinder.boom.friction.viscous_N_s_per_m",
        2e4,
        lambda m: m.cylinders[0].friction.viscous,
        2e4,
    ),
    ("cylinder.boom.compliance_m_per_N", 1e-9, lambda m: m.cylinders[0].compliance, 1e-9),
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
    made = EXCAVATOR.replace({path: value})
    assert (
        read(made) == pytest.approx(expected)
        if not isinstance(expected, list)
        else read(made) == expected
    )
    kept = made.text.splitlines()
    lost = [line for line in TEXT.splitlines() if line not in kept]
    assert len(lost) <= (1 if path == "requirements.digging.cylinders" else 0)


@pytest.mark.parametrize("path", ["requirements.end_margin", "requirements.pin_box_mm"])
def test_replace_makes_a_table_that_is_missing(path: str) -> None:
    bare = Machine.from_text(
        TEXT[: TEXT.index("[requirements]")], EXCAVATOR.urdf_text, Path("a.toml")
    )
    made = bare.replace({path: 0.1})
    assert getattr(made.section.requirements, path.split(".")[1]) == 0.1
    assert made.section.cylinder == bare.section.cylinder
    assert Machine.from_text(made.text, made.urdf_text, made.source).section == made.section


def test_replace_takes_numbers_of_numpy() -> None:
    pin = np.array(EXCAVATOR.linkages[0].base.at) * 1000
    made = EXCAVATOR.replace(
        {"cylinder.boom.bore_mm": np.float64(125), "cylinder.boom.base.at_mm": pin}
    )
    assert made.cylinders[0].bore == pytest.approx(0.125)
    assert_allclose(made.linkages[0].base.at, EXCAVATOR.linkages[0].base.at, rtol=1e-12)


def test_replace_leaves_the_machine_as_it_was_and_keeps_its_load_case() -> None:
    before = EXCAVATOR.text
    made = EXCAVATOR.with_payload("full").replace({"cylinder.stick.bore_mm": 150.0})
    assert made.payload.name == "full"
    assert EXCAVATOR.text == before
    assert EXCAVATOR.cylinders[1].bore == 0.140
    back = made.replace({"cylinder.stick.bore_mm": 140})
    assert back.text == before


BAD_CHANGES = [
    ({"cylinder.boom.bore": 130}, r'cylinder\.boom\.bore: unknown key; did you mean "bore_mm"'),
    ({"cylinder.bom.bore_mm": 130}, r'no "bom" in the file; choose from: boom, stick, bucket'),
    ({"payload.half.mass_kg": 3}, r'no "half" in the file; choose from: empty, full'),
    ({"": 1}, "is not a key path"),
    ({".": 1}, "choose from: name"),
    ({5: 1}, "is not a key path"),
    ({"cylinder.boom": 1}, "is a table, not a value"),
    ({"cylinder.boom.bore_mm.x": 1}, "is a value, not a table"),
    ({"cylinder.boom.base.at_mm.0": 1}, "is a value, not a table"),
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


# ------------------------------------------------------------------------------------------ saving


def test_saved_and_loaded_it_is_the_same_machine(tmp_path: Path) -> None:
    changes = {
        "cylinder.boom.bore_mm": 126.123456789012345,
        "cylinder.stick.base.at_mm": [3400.1, 0, 1100.7],
    }
    made = EXCAVATOR.replace(changes)
    path = made.save(tmp_path / "deep" / "new.toml")
    again = ad.load(path)
    assert again.section == made.section
    assert_allclose(frequencies(again), frequencies(made), rtol=0, atol=0)
    assert (frequencies(again) != frequencies(EXCAVATOR)).all()
    assert (path.parent / "excavator_20t.urdf").read_text(encoding="utf-8") == EXCAVATOR.urdf_text
    assert sorted(p.name for p in path.parent.iterdir()) == ["excavator_20t.urdf", "new.toml"]
    assert len(changed_lines(TEXT, path.read_text(encoding="utf-8"))) == 2


def test_saves_into_the_folder_it_came_from(tmp_path: Path) -> None:
    first = EXCAVATOR.save(tmp_path / "a.toml")
    machine = ad.load(first).replace({"payload.full.mass_kg": 1000})
    machine.save(tmp_path / "b.toml")
    machine.save(first)
    assert (
        first.read_text(encoding="utf-8")
        == machine.text
        == (tmp_path / "b.toml").read_text(encoding="utf-8")
    )


def test_a_file_of_somebody_else_is_replaced_only_when_asked(tmp_path: Path) -> None:
    """Unless it says that this package made it, or holds the same already."""
    path = tmp_path / "a.toml"
    path.write_text("# notes of mine\n", encoding="utf-8")
    refusal = (
        r"a\.toml: exists, and armdesign did not make it; name another place, or give"
        r" overwrite=True"
    )
    with pytest.raises(ad.ArmDesignError, match=refusal):
        EXCAVATOR.save(path)
    assert path.read_text(encoding="utf-8") == "# notes of mine\n"
    assert [p.name for p in tmp_path.iterdir()] == ["a.toml"]
    EXCAVATOR.save(path, overwrite=True)
    assert path.read_text(encoding="utf-8") == TEXT
    for heading in (
        "# Made by armdesign optimize\n",
        "#:schema ./machine.schema.json\n\n# Made by armdesign\n",
    ):
        path = tmp_path / f"{len(heading)}.toml"
        path.write_text(heading + TEXT, encoding="utf-8")
        assert EXCAVATOR.save(path).read_text(encoding="utf-8") == TEXT


def test_a_machine_is_not_saved_over_the_file_that_it_was_read_from_unasked(
    tmp_path: Path,
) -> None:
    path = tmp_path / "own.toml"
    path.write_text(TEXT, encoding="utf-8")
    (tmp_path / "excavator_20t.urdf").write_text(EXCAVATOR.urdf_text, encoding="utf-8")
    machine = ad.load(path)
    machine.save(path)  # nothing changes
    wider = machine.replace({"cylinder.boom.bore_mm": 126})
    with pytest.raises(ad.ArmDesignError, match="overwrite=True"):
        wider.save(path)
    assert path.read_text(encoding="utf-8") == TEXT
    wider.save(path, overwrite=True)
    wider.replace({"cylinder.boom.bore_mm": 127}).save(path)  # its own by now
    assert len(changed_lines(TEXT, path.read_text(encoding="utf-8"))) == 1


def test_another_urdf_is_replaced_when_asked(tmp_path: Path) -> None:
    (tmp_path / "excavator_20t.urdf").write_text("<robot/>", encoding="utf-8")
    EXCAVATOR.save(tmp_path / "a.toml", overwrite=True)
    assert ad.load(tmp_path / "a.toml").urdf_text == EXCAVATOR.urdf_text


def test_save_follows_no_link(tmp_path: Path) -> None:
    """Neither one under a temporary name that can be guessed nor one in the place of the file."""
    (tmp_path / "mine.txt").write_text("mine", encoding="utf-8")
    for name in (".writing-a.toml", ".writing-excavator_20t.urdf", "a.toml"):
        (tmp_path / name).symlink_to(tmp_path / "mine.txt")
    EXCAVATOR.save(tmp_path / "a.toml", overwrite=True)
    assert (tmp_path / "mine.txt").read_text(encoding="utf-8") == "mine"
    assert not (tmp_path / "a.toml").is_symlink()
    assert (tmp_path / ".writing-a.toml").is_symlink()


@pytest.mark.parametrize("number", [1, 2, 3])
def test_machine_file_and_urdf_are_saved_both_or_none(
    number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The journal, then either file cannot be moved."""
    path = EXCAVATOR.save(tmp_path / "a.toml")
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
    other = ad.Machine.from_text(TEXT, EXCAVATOR.urdf_text + "\n", tmp_path / "x.toml").replace(
        {"title": "new"}
    )
    calls, real = [0], os.replace

    def failing(source: str, target: str) -> None:
        calls[0] += 1
        if calls[0] == number:
            raise OSError(5, "Input/output error")
        real(source, target)

    monkeypatch.setattr(os, "replace", failing)
    with pytest.raises(ad.ArmDesignError, match="cannot be written"):
        other.save(path, overwrite=True)
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == before
    other.save(path, overwrite=True)
    assert ad.load(path).urdf_text == other.urdf_text


def test_a_pair_half_moved_by_a_killed_run_is_not_read_so(tmp_path: Path) -> None:
    path = EXCAVATOR.save(tmp_path / "a.toml")
    root = tmp_path / ".writing-00000000"
    (root / "new").mkdir(parents=True)
    root.chmod(0o700)
    (root / "new" / "a.toml").write_text(
        TEXT.replace("bore_mm = 120", "bore_mm = 121", 1), encoding="utf-8"
    )
    files = ["a.toml", "excavator_20t.urdf"]
    (root / "moving").write_text(
        json.dumps({"files": files, "replaced": files, "folders": []}), encoding="utf-8"
    )
    assert ad.load(path).cylinders[0].bore == pytest.approx(0.121)
    assert sorted(p.name for p in tmp_path.iterdir()) == files


def test_saved_under_a_new_urdf_name(tmp_path: Path) -> None:
    EXCAVATOR.replace({"urdf": "sub/arm.urdf"}).save(tmp_path / "a.toml")
    assert (tmp_path / "sub" / "arm.urdf").is_file()
    assert ad.load(tmp_path / "a.toml").joints == EXCAVATOR.joints


def outside(folder: Path, how: str) -> Path:
    """A machine file in a folder whose URDF lies beside that folder; the URDF's own text."""
    path = EXCAVATOR.save(folder / "machine" / "a.toml")
    urdf = folder / "arm.urdf"
    (path.parent / "excavator_20t.urdf").rename(urdf)
    if how == "link":
        (path.parent / "excavator_20t.urdf").symlink_to(urdf)
    elif how == "folder":
        (path.parent / "linked").symlink_to(folder)
    named = {
        "dots": "../arm.urdf",
        "absolute": str(urdf),
        "link": "excavator_20t.urdf",
        "folder": "linked/arm.urdf",
    }
    path.write_text(TEXT.replace('"excavator_20t.urdf"', f'"{named[how]}"'), encoding="utf-8")
    return path


@pytest.mark.parametrize("how", ["dots", "absolute", "link", "folder"])
def test_a_urdf_outside_the_folder_needs_permission(how: str, tmp_path: Path) -> None:
    """`..`, an absolute path, a symbolic link to the file or through a folder: refused, allowed,
    saved beside.
    """
    path = outside(tmp_path, how)
    with pytest.raises(
        ad.ArmDesignError,
        match=r"a\.toml: urdf: .* is outside the folder .*; .*--allow-outside, in Py",
    ):
        ad.load(path)
    machine = ad.load(path, allow_outside=True).replace({"cylinder.boom.bore_mm": 126})
    again = ad.load(machine.save(tmp_path / "new" / "b.toml"))
    assert again.section.urdf == {"link": "excavator_20t.urdf"}.get(how, "arm.urdf")
    assert (tmp_path / "new" / again.section.urdf).read_text(
        encoding="utf-8"
    ) == EXCAVATOR.urdf_text
    assert_allclose(frequencies(again), frequencies(machine), rtol=0, atol=0)
    kept = {"link": 1}.get(how, 2)
    assert (
        len(changed_lines(TEXT, (tmp_path / "new" / "b.toml").read_text(encoding="utf-8"))) == kept
    )
    machine.save(path)  # into its own folder: what lies outside is left alone
    assert (tmp_path / "arm.urdf").read_text(encoding="utf-8") == EXCAVATOR.urdf_text
    assert_allclose(frequencies(ad.load(path)), frequencies(machine), rtol=0, atol=0)


def test_an_absolute_path_into_the_folder_and_a_linked_folder_are_inside(tmp_path: Path) -> None:
    path = EXCAVATOR.save(tmp_path / "machine" / "a.toml")
    path.write_text(
        TEXT.replace('"excavator_20t.urdf"', f'"{path.parent / "excavator_20t.urdf"}"'),
        encoding="utf-8",
    )
    (tmp_path / "other").symlink_to(path.parent)
    assert (
        ad.load(path).joints == ad.load(tmp_path / "other" / "a.toml").joints == EXCAVATOR.joints
    )


def test_another_urdf_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "excavator_20t.urdf").write_text("<robot/>", encoding="utf-8")
    with pytest.raises(ad.ArmDesignError, match="another URDF of this name exists"):
        EXCAVATOR.save(tmp_path / "a.toml")
    assert not (tmp_path / "a.toml").exists()


@pytest.mark.parametrize(
    "name", ["a.txt", "a", "a.TOML", ".toml", "excavator_20t.urdf", "folder.toml", "x\0.toml"]
)
def test_save_refuses_a_path_and_writes_nothing(name: str, tmp_path: Path) -> None:
    (tmp_path / "folder.toml").mkdir()
    with pytest.raises(ad.ArmDesignError):
        EXCAVATOR.save(tmp_path / name)
    assert [p.name for p in tmp_path.iterdir()] == ["folder.toml"]


@pytest.mark.parametrize(
    "path", ["/proc/none/a.toml", "/dev/null/a.toml", "l" * 300 + ".toml", None, 5, ""]
)
def test_save_refuses_places_that_cannot_be(path: object) -> None:
    with pytest.raises(ad.ArmDesignError):
        EXCAVATOR.save(path)


def test_an_interrupted_save_leaves_the_old_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = EXCAVATOR.save(tmp_path / "a.toml")
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}

    def full(*_: object) -> None:
        raise OSError(28, os.strerror(28))

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(ad.ArmDesignError, match="No space left"):
        EXCAVATOR.replace({"title": "new"}).save(path)
    monkeypatch.undo()
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == before
