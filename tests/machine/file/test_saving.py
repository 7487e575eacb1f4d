"""Machine files saved with their URDFs: both or none, and nothing of others replaced unasked."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
from numpy.testing import assert_allclose

import armdesign as ad
from tests.machine.file.changed_files import EXCAVATOR, TEXT, changed_lines, frequencies

# ------------------------------------------------------------------------------------------ saving


def test_saved_and_loaded_it_is_the_same_machine(tmp_path: Path) -> None:
    changes = {
        "cylinder.boom.bore_mm": 126.123456789012345,
        "cylinder.stick.base.at_mm": [3400.1, 0, 1100.7],
    }
    changed = EXCAVATOR.replace(changes)
    path = changed.save(tmp_path / "deep" / "new.toml")
    again = ad.load(path)
    assert again.section == changed.section
    assert_allclose(frequencies(again), frequencies(changed), rtol=0, atol=0)
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
