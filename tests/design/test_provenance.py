"""What a new machine's file says of itself."""

from __future__ import annotations

import re
import tomllib
from dataclasses import replace
from datetime import date
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest

import armdesign as ad
from armdesign.design.provenance import stated_requirements
from armdesign.design.search.multistart import formulate_with_sizes
from armdesign.machine import template
from armdesign.machine.file.machine_file import flat
from tests import machines

COARSE = (3, 3, 5)


@pytest.fixture(scope="module")
def crane(tmp_path_factory: pytest.TempPathFactory) -> ad.Machine:
    """A machine made by ``armdesign new``, whose head says that every number is a placeholder.

    Here with cylinders of any size.
    """
    folder = tmp_path_factory.mktemp("crane")
    text = template.new("crane")
    assert "EVERY NUMBER IS A PLACEHOLDER" in text
    text = re.sub(r"(?m)^catalogue = .*\n", "", text)
    (folder / "crane.toml").write_text(text, encoding="utf-8")
    return ad.load(folder / "crane.toml")


@pytest.fixture(scope="module")
def design(crane: ad.Machine) -> ad.Design:
    less = {"oil_total_share": 0.95, **machines.ANY_LIFT_AND_TORQUE}
    limits = replace(ad.Requirements.of(crane), **less)
    return ad.size_cylinders(crane, ad.Workspace.grid(crane, [3, 4]), limits)


def head(machine: ad.Machine) -> str:
    """The comments in front of the first key, in one line."""
    lines = machine.text.split("\n")
    first = next(k for k, line in enumerate(lines) if line and not line.startswith("#"))
    return " ".join(" ".join(line.lstrip("# ") for line in lines[:first]).split())


def test_its_name_and_title_are_its_own(design: ad.Design) -> None:
    assert (design.machine.name, design.machine.section.title) == (
        "crane_optimized",
        "crane, optimized",
    )
    assert design.machine.source.name == "crane_optimized.toml"
    assert (design.today.name, design.today.section.title) == ("crane", "crane")


def test_its_head_is_its_own_story(design: ad.Design) -> None:
    """From what, when, by which command and version, within which requirements; nothing of the old
    head.
    """
    words = head(design.machine)
    for part in (
        f"Made by armdesign {version('armdesign')} on {date.today().isoformat()} from crane.toml",
        "Command: armdesign.size_cylinders(dead_volume='fixed')",
        "thrust_share 1.1",
        "oil_total_share = 0.95",
    ):
        assert part in words
    assert "PLACEHOLDER" not in design.machine.text
    assert design.machine.text.startswith("#:schema ./machine.schema.json\n")


@pytest.mark.parametrize(
    ("catalogue", "name"),
    [(None, "5mm"), ("free", "free"), ("iso", "iso"), ([(0.12, 0.08)], "own")],
)
def test_the_catalogue_that_was_used_is_stated(catalogue: Any, name: str) -> None:
    """The file's own was stated whatever sizes were chosen from."""
    machine = ad.load("excavator_20t")
    workspace = ad.Workspace.grid(machine, 3)
    problem, _ = formulate_with_sizes(
        machine, workspace, None, ("areas",), bands=None, objective="worst", catalogue=catalogue
    )
    assert f', catalogue "{name}", ' in stated_requirements(problem)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["crane", "excavator_20t"])
def test_each_changed_line_says_what_it_was(name: str, design: ad.Design) -> None:
    """Lines that differ, read as TOML once more with what they say they were, give today's file
    back.
    """
    if name != "crane":
        machine = machines.named(name)
        design = ad.optimize(machine, ad.Workspace.grid(machine, COARSE), starts=1)
    new, today = flat(design.machine.section), flat(design.today.section)
    changed = {path for path in new if new[path] != today.get(path)}
    lines = {re.sub(r"(bands\.structures)\..*", r"\1", path) for path in changed}
    restored: list[str] = []
    for line in design.machine.text.split("\n"):
        if was := re.search(r"\s*# was (.*)$", line):
            old, key = was[1].split(": ")[0], line.split("=")[0]
            if old == "not given":
                continue
            if within := re.fullmatch(r"(\w+) = (.*)", old):
                line = re.sub(rf"{within[1]} = (\[.*?\]|[\d.]+)", old, line)
            else:
                line = f"{key}= {old}"
        restored.append(line)
    assert tomllib.loads("\n".join(restored)) == tomllib.loads(design.today.text)
    assert design.machine.text.count("# was ") == len(lines)


def test_comments_of_what_did_not_change_stay(design: ad.Design) -> None:
    assert "# largest flow of the pump" in design.machine.text
    bore = next(line for line in design.machine.text.split("\n") if line.startswith("bore_mm"))
    assert bore.endswith("# was 100: inner diameter of the barrel; each")


def test_the_schema_that_it_names_lies_beside_it(design: ad.Design, tmp_path: Path) -> None:
    place = design.machine.save(tmp_path / "far" / "new.toml")
    shipped = Path(ad.__file__).with_name("machine.schema.json").read_bytes()
    assert (place.parent / "machine.schema.json").read_bytes() == shipped
    (place.parent / "machine.schema.json").write_text("{}", encoding="utf-8")
    design.machine.save(place)
    assert (place.parent / "machine.schema.json").read_text(encoding="utf-8") == "{}"


@pytest.mark.parametrize(
    ("named", "kept"),
    [
        ("../schemas/own.json", "./own.json"),
        ("https://example.org/a.json", "https://example.org/a.json"),
        ("/usr/share/a.json", "/usr/share/a.json"),
    ],
)
def test_a_schema_elsewhere(named: str, kept: str, crane: ad.Machine, tmp_path: Path) -> None:
    text = crane.text.replace("./machine.schema.json", named)
    place = ad.Machine.from_text(text, crane.urdf_text, crane.source).save(tmp_path / "a.toml")
    assert place.read_text(encoding="utf-8").split("\n")[0] == f"#:schema {kept}"
    beside = {path.name for path in tmp_path.iterdir()} - {"a.toml", "crane.urdf"}
    assert beside == ({"own.json"} if kept == "./own.json" else set())


def test_a_story_told_again_is_told_once(design: ad.Design) -> None:
    """The command line signs the file anew: the same file but for its line."""
    again = design.written_by("armdesign optimize crane.toml --out 'a\nb'")
    other = [line for line in again.text.split("\n") if not line.startswith("# Command")]
    assert other == [
        line for line in design.machine.text.split("\n") if not line.startswith("# Command")
    ]
    assert "# Command: armdesign optimize crane.toml --out 'a\\nb'" in again.text


def test_a_new_machine_of_a_new_machine(design: ad.Design) -> None:
    """What today's file says of its own past is not carried on."""
    today = design.machine
    again = ad.size_cylinders(today, ad.Workspace.grid(today, [3, 4]))
    assert head(again.machine).count("Made by armdesign") == 1
    assert "from crane_optimized.toml" in head(again.machine)
    assert not re.search(r"# was .*# was|was \d+: was", again.machine.text)


def test_lines_that_did_not_change_again_say_nothing_of_their_past(design: ad.Design) -> None:
    """Of a machine made twice, the second file tells the second change alone; comments of old
    lines stay.
    """
    before = tomllib.loads(design.machine.text)
    varied = ad.optimize(
        design.machine,
        ad.Workspace.grid(design.machine, [3, 4]),
        vary=("cylinder.boom.bore_mm",),
        starts=1,
    )
    text, after = varied.machine.text, tomllib.loads(varied.machine.text)
    assert after["cylinder"]["stick"] == before["cylinder"]["stick"]
    # it had changed before
    assert re.search(r"(?m)^\[cylinder.stick\](\n.+)*# was 80: each$", design.machine.text)
    changed = sum(
        flat(varied.machine.section)[path] != value
        for path, value in flat(design.machine.section).items()
    )
    assert text.count("# was ") == changed
    part = text[text.index("[cylinder.stick]") : text.index("[cylinder.stick.valve]")]
    assert re.search(r"(?m)^bore_mm = \S+ +# each$", part)
    assert not re.search("(?m)[ \t]+$", text)


def test_windows_line_ends_stay(crane: ad.Machine) -> None:
    machine = ad.Machine.from_text(crane.text.replace("\n", "\r\n"), crane.urdf_text, crane.source)
    text = ad.size_cylinders(machine, ad.Workspace.grid(machine, [3, 4])).machine.text
    assert text.count("\n") == text.count("\r\n")
