"""The documentation: it builds without a warning, its blocks run, its reference is complete."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest

import armdesign as ad
from armdesign.machine.file.schema import MachineSection
from docs import generated_pages
from tests import pictures, validation_figures
from tests.pages import DOCS, PAGES, PROSE, ROOT, RUNS, is_slow, page

LONG = ("docs/own_machine.md", "docs/report.md", "docs/howto/bands.md")
WITH_BLOCKS = [path for path in PAGES if page(path).examples()]


def named(path: Path) -> str:
    return str(path.relative_to(ROOT))


def run(path: Path, slow: bool) -> None:
    for example in page(path).examples():
        if slow or not is_slow(example):
            example.evaluate()


def long(path: Path) -> Any:
    """A page whose blocks search or map whole machines is a slow test."""
    return pytest.param(path, marks=pytest.mark.slow) if named(path) in LONG else path


@pytest.mark.parametrize("path", [long(path) for path in WITH_BLOCKS], ids=named)
def test_blocks_run(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    run(path, slow=False)
    assert not pictures.stale(path.stem, tmp_path), "python -m tests.pictures draws them again"


@pytest.mark.slow
@pytest.mark.parametrize(
    "path", [path for path in WITH_BLOCKS if any(map(is_slow, page(path).examples()))], ids=named
)
def test_all_blocks_run(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    run(path, slow=True)
    assert not pictures.stale(path.stem, tmp_path), "python -m tests.pictures draws them again"


@pytest.mark.parametrize("path", PAGES, ids=named)
def test_every_block_has_a_language_that_runs(path: Path) -> None:
    fences = re.findall(r"^```(.*)$", path.read_text("utf-8"), re.M)[::2]
    known = {*RUNS, *PROSE}
    assert not [kind for kind in fences if kind not in known and not kind.startswith("{")]


@pytest.mark.slow
def test_it_builds_without_a_warning(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "docs", str(tmp_path)]
    built = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    assert (tmp_path / "index.html").exists()


# ------------------------------------------------------------------- reference of the machine file


def test_every_key_of_the_schema_has_all_columns() -> None:
    """Give a new key its text in json_schema.py and its example in docs/every_key.toml."""
    for kind, paths in generated_pages.tables().items():
        rows = generated_pages.rows(kind, paths)
        assert [row[0] for row in rows] == [f"`{key}`" for key in kind.model_fields]
        assert not [row for row in rows if not all(row)]


def test_the_examples_are_values_that_the_schema_takes() -> None:
    MachineSection.model_validate(tomllib.loads((DOCS / "every_key.toml").read_text("utf-8")))


def test_the_reference_has_what_the_schema_has() -> None:
    """By hand: rows of keys with a unit, a default, a range, and of each or together."""
    text = generated_pages.fill((DOCS / "machine_file.md").read_text("utf-8"))
    assert (
        "| `bore_mm` | mm | required | (0, 100000] | each | inner diameter of the barrel |"
        " `bore_mm = 120` |" in text
    )
    assert "| `relief_bar` | bar | 1.1 × supply pressure | (0, 5000] | – |" in text
    assert "| `cap` | l | required | [0, 10000] | together |" in text
    assert '| `knee` | – | required | `"left"` or `"right"` |' in text


# -------------------------------------------------------------------------------------- validation


@pytest.mark.slow
def test_figures_of_the_validation_are_of_this_version() -> None:
    """Else write them again: python -m tests.validation_figures."""
    assert json.loads(validation_figures.FILE.read_text("utf-8")) == validation_figures.rows()


# ----------------------------------------------------------------------------------- API reference


def test_every_public_name_is_in_the_reference() -> None:
    text = (DOCS / "api.md").read_text("utf-8")
    named = re.findall(r"^\.\. auto\w+:: armdesign\.([\w.]+)$", text, re.M)
    assert sorted(named) == sorted([*({*ad.__all__} - {"formulas"}), "paper.formulas"])
