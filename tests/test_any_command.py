"""Any command line, one after the other in one folder: answered, or refused with nothing touched.

Ten minutes of it by the command in CONTRIBUTING.md.
"""

from __future__ import annotations

import io
import json
import os
import re
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path

import pandas as pd
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import Bundle, RuleBasedStateMachine, initialize, multiple, rule
from PIL import Image

import armdesign as ad
from tests.checks import no_longer_than
from tests.commands import spoken

SECONDS = 60  # of processor time, enough for each of these
GOOD_NAMES = ("arm", "boom_2", "loader")
NAMES = (*GOOD_NAMES, "a_b", "-x", "", "a b", "CON", "../up", "=1+1", "ä", "x" * 300, "arm.toml")
FOLDERS = ("one", "two words", "deep/er", "ü", "=1", "taken", "", "taken/in", "\0")
POINTS = ("2", "3", "3,4", "1", "-3", "x", "3,3,3,3", "nan", "99999999", ",", "3,", "1e9", "٣")
HUGE = "9" * 400, "9" * 5000  # no float; and more digits than Python reads
SHARES = ("0", "-1", "1e300", "-1e-300", "nan", "inf", "1", "0.5", "10", "1234.5", "٣", "1_0")
WORDS = (
    *(*SHARES, *HUGE, "1\nx = 2", "true", "", '"x"', "[1, 2]", "[]", "{}", "left", "["),
    *("\x1b[31m", "x" * 2000),
)
PATHS = (
    *("fluid.bulk_modulus_MPa", "fluid.entrained_air_percent", "supply.pressure_bar"),
    *("payload.full.mass_kg", "cylinder.boom.bore_mm", "cylinder.boom.rod_mm", "payload"),
    *("cylinder.boom.stroke_mm", "cylinder.boom.base.at_mm", "cylinder.boom.count", "joints"),
    *("requirements.end_margin", "lift_chart.step_m", "stability.mass_kg", "bands.structure"),
    *("name", "urdf", "cylinder", "cylinder.boom", "", ".", "a.b.c", "cylinder.boom.base.at_mm.0"),
    *("cylinder.boom.valve.damping_ratio", "tolerances.pin_mm", "[x]", "fluid.bulk_modulus"),
)
POSES = ("boom=10", "boom=1e9", "boom=nan", "boom", "x=1", "boom=10,boom=20", "", "=", "boom=-0")
OPTIONS = {  # of each command, beside what all have
    "check": ("points", "set", "units", "out"),
    "draw": ("pose", "payload", "picture", "set", "out"),
    "export": ("pose", "format", "set", "out"),
    "map": ("points", "set", "units", "out"),
    "what-if": ("points", "out"),
    "compare": ("points", "set", "units", "out"),
    "sensitivity": ("points", "set", "out"),
}
VALUES = {
    "points": (*POINTS, *HUGE),
    "units": ("si", "workshop", "inch", ""),
    "out": FOLDERS,
    "pose": POSES,
    "payload": ("full", "empty", "100", "-1", "nan", "1e300", ""),
    "picture": ("svg", "png", "pdf", "gif"),
    "format": ("csv", "urdf", "sdf", "csv,urdf", "dxf", "x", "", "csv,csv"),
}
GOOD = ("fluid.bulk_modulus_MPa=1100", "cylinder.boom.bore_mm=130", "payload.full.mass_kg=55")
ANY = st.builds("{}={}".format, st.sampled_from(PATHS), st.sampled_from(WORDS))
SETTINGS = st.sampled_from(GOOD) | ANY


@st.composite
def some_options(draw: st.DrawFn, command: str) -> list[str]:
    """Options, few of them wrong; a small grid where none is asked for."""
    words = draw(st.sampled_from([[], [], [], ["--json"], ["--quiet"], ["--no-such"]]))
    words = list(words)
    for option in OPTIONS[command]:
        if option == "set":
            for _ in range(draw(st.sampled_from([0, 0, 1, 1, 2]))):
                words += ["--set", draw(SETTINGS)]
        elif draw(st.sampled_from([False, False, False, True])):
            name = "format" if option == "picture" else option
            words += [f"--{name}", draw(st.sampled_from(VALUES[option]))]
        elif option == "points":
            words += ["--points", "3"]
    return words


def contents(folder: Path) -> dict[Path, bytes | None]:
    """Every file and folder, hidden ones too."""
    paths = sorted(folder.rglob("*"))
    return {path: path.read_bytes() if path.is_file() else None for path in paths}


def assert_whole(path: Path) -> None:
    """A file as its reader takes it."""
    assert path.stat().st_size > 0, path
    if path.suffix == ".csv":
        pd.read_csv(path)
    elif path.suffix == ".json":
        json.loads(path.read_text(encoding="utf-8"))
    elif path.suffix == ".png":
        with Image.open(path) as picture:
            picture.load()
    elif path.suffix in (".html", ".svg", ".urdf", ".sdf"):
        assert re.search(r"</(html|svg|robot|sdf)>\s*$", path.read_text(encoding="utf-8")), path
    elif path.suffix == ".pdf":
        assert path.read_bytes().rstrip().endswith(b"%%EOF")


class CommandLines(RuleBasedStateMachine):
    """A folder in which somebody types."""

    machines: Bundle[str] = Bundle("machines")

    def __init__(self) -> None:
        super().__init__()
        self.before = Path.cwd()
        self.folder = Path(tempfile.mkdtemp()).resolve()
        os.chdir(self.folder)
        Path("taken").write_text("mine", encoding="utf-8")

    def teardown(self) -> None:
        os.chdir(self.before)
        shutil.rmtree(self.folder)

    def answer(self, words: Sequence[str]) -> bool:
        """Runs a command; whether it was answered. What holds of either is asserted."""
        before, out, err = contents(self.folder), io.StringIO(), io.StringIO()
        with no_longer_than(SECONDS):
            code = spoken(words, out, err)
        lines = err.getvalue().splitlines()
        assert code in (0, 2), (words, code)
        assert all(line.startswith("armdesign: ") for line in lines), (words, lines)
        assert all(len(line) < 2000 and line.isprintable() for line in lines), (words, lines)
        if "--json" in words and "--no-such" not in words and code == 0:
            assert json.loads(out.getvalue())["finished"]
        after = contents(self.folder)
        if code == 2:
            assert lines, words
            assert len(lines) == 1 or words[0] in ("check", "draw"), lines  # they list all
            assert after == before, (words, set(after) ^ set(before))
            return False
        assert not lines, (words, lines)
        assert not (out.getvalue() and "--quiet" in words)
        new = [path for path, content in after.items() if before.get(path, b"") != content]
        for path in new:
            if path.is_file():
                assert_whole(path)
        folder = words[words.index("--out") + 1] if "--out" in words else None
        if folder is not None:
            assert all(path.is_relative_to(self.folder / folder.partition("/")[0]) for path in new)
        assert {path: before[path] for path in before if path not in new} == {
            path: after[path] for path in before if path not in new
        }
        return True

    @initialize(
        target=machines,
        name=st.sampled_from(GOOD_NAMES),
        links=st.sampled_from(["1", "2"]),
        more=st.sampled_from([[], ["--four-bar"]]),
    )
    def begin(self, name: str, links: str, more: list[str]) -> object:
        assert self.answer(["new", name, "--links", links, *more])
        return multiple("paper_1dof", f"{name}/{name}.toml", f"{name}/{name}.toml")

    @rule(
        target=machines,
        name=st.sampled_from(NAMES),
        links=st.sampled_from(["1", "2", "0", "7", "x"]),
        four_bar=st.booleans(),
        out=st.sampled_from([None, *FOLDERS]),
    )
    def new(self, name: str, links: str, four_bar: bool, out: str | None) -> object:
        words = ["new", name, "--links", links, *(["--four-bar"] if four_bar else [])]
        words += [] if out is None else ["--out", out]
        if not self.answer(words):
            return multiple()
        path = Path(name if out is None else out) / f"{name}.toml"
        ad.load(path)
        return str(path)

    @rule(machine=machines, line=st.integers(0, 200), word=st.sampled_from(WORDS))
    def damage(self, machine: str, line: int, word: str) -> None:
        """Somebody types a wrong value into the file."""
        path = Path(machine)
        if path.is_file():
            lines = path.read_text(encoding="utf-8").splitlines()
            key, is_, _ = lines[line % len(lines)].partition(" = ")
            lines[line % len(lines)] = f"{key} = {word}" if is_ else word
            path.write_text("\n".join(lines), encoding="utf-8")

    @rule(data=st.data(), machine=machines, command=st.sampled_from(["check", "draw", "export"]))
    def look(self, data: st.DataObject, machine: str, command: str) -> None:
        self.answer([command, machine, *data.draw(some_options(command))])


class LongCommandLines(CommandLines):
    """Commands that take longer, too."""

    @rule(
        data=st.data(),
        machine=CommandLines.machines,
        command=st.sampled_from(["map", "what-if", "sensitivity"]),
    )
    def map(self, data: st.DataObject, machine: str, command: str) -> None:
        changes = data.draw(st.lists(SETTINGS, max_size=2)) if command == "what-if" else []
        self.answer([command, machine, *changes, *data.draw(some_options(command))])

    @rule(data=st.data(), one=CommandLines.machines, other=CommandLines.machines)
    def compare(self, data: st.DataObject, one: str, other: str) -> None:
        self.answer(["compare", one, other, *data.draw(some_options("compare"))])

    @rule(which=st.integers(0, 100), end=st.integers(0, 100))
    def cut_off(self, which: int, end: int) -> None:
        """A file of an answer loses its end, and the next answer takes its place."""
        files = [path for path in sorted(Path().rglob("*")) if path.is_file()]
        path = files[which % len(files)]
        if path.suffix in (".csv", ".png", ".json", ".html"):
            path.write_bytes(path.read_bytes()[: 10 * end])


TestCommandLines = CommandLines.TestCase
TestCommandLines.settings = settings(max_examples=2, stateful_step_count=5)
TestLongCommandLines = pytest.mark.slow(LongCommandLines.TestCase)
TestLongCommandLines.settings = settings(
    max_examples=settings.default.max_examples // 20, stateful_step_count=10
)
