"""Documents that name files and versions name those that exist."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "armdesign"
DOCUMENTS = [
    "README.md",
    "CONTRIBUTING.md",
    "CHANGELOG.md",
    *(str(path.relative_to(ROOT)) for path in ROOT.glob("docs/**/*.md")),
]
HOUSE = (ROOT / "docs" / "house.md").read_text(encoding="utf-8")


def listed() -> set[str]:
    """Files of the house's list of rooms: headings give the folder, rows of tables the file."""
    folder, files = "", set()
    for line in HOUSE.splitlines():
        if heading := re.match(r"### `armdesign/([\w/]*)`", line):
            folder = heading[1]
        elif line.startswith("#"):
            folder = ""
        elif row := re.match(r"\| `(\w+)` \|", line):
            files.add(f"{folder}{row[1]}.py")
    return files


def test_every_module_has_its_line_in_the_house_and_every_line_its_module() -> None:
    modules = {
        str(path.relative_to(PACKAGE))
        for path in PACKAGE.rglob("*.py")
        if path.name != "__init__.py"
    }
    assert listed() == modules


@pytest.mark.parametrize("name", ["docs/house.md", "CONTRIBUTING.md"])
def test_files_that_documents_name_exist(name: str) -> None:
    text = (ROOT / name).read_text(encoding="utf-8")
    named = re.findall(r"`((?:[\w.]+/)*[\w.]+\.(?:py|toml|md|j2))`", text)
    named += re.findall(r"`((?:[\w.]+/)+)`", text)
    missing = [path for path in named if not any((at / path).exists() for at in (ROOT, PACKAGE))]
    assert named
    assert not missing


@pytest.mark.parametrize("name", DOCUMENTS)
def test_documents_fit_their_page(name: str) -> None:
    """But for tables, pictures and commands, which cannot break."""
    lines = (ROOT / name).read_text(encoding="utf-8").splitlines()
    unbreakable = ("|", "![", "python3 ", "$ armdesign", "payload,")
    assert not [line for line in lines if len(line) > 99 and not line.startswith(unbreakable)]


@pytest.mark.parametrize("path", sorted(ROOT.glob("robots/*/*.toml")), ids=lambda path: path.stem)
def test_machine_files_fit_their_page(path: Path) -> None:
    assert not [line for line in path.read_text("utf-8").splitlines() if len(line) > 99]


def test_the_citation_is_of_this_version() -> None:
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert re.search(r"^version: (\S+)$", citation, re.M)[1] == project["version"]  # type: ignore[index]
    assert re.search(r"^license: (\S+)$", citation, re.M)[1] == project["license"]  # type: ignore[index]
    for key in ("cff-version", "message", "title", "authors"):  # what the format requires
        assert re.search(rf"^{key}:", citation, re.M), key


def test_changes_are_added_changed_or_fixed() -> None:
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert re.findall(r"^### (.*)$", changes, re.M) == ["Added", "Changed", "Fixed"]
    assert re.findall(r"^## (.*)$", changes, re.M)[0].startswith("Unreleased")
