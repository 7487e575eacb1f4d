"""Options that commands share: each does the same wherever it is."""

from __future__ import annotations

import inspect
import os
import subprocess
import sys
from pathlib import Path
from typing import Any, get_args

import pandas as pd
import pytest
import typer

import armdesign as ad
from armdesign import cli
from armdesign.control.controller import Filter
from armdesign.design.least import AMOUNTS
from armdesign.design.search.multistart import OBJECTIVES
from armdesign.exchange.files import FORMATS
from armdesign.motion.shaping import KINDS
from armdesign.options import machine_names, one_of, some_of
from armdesign.plots.designs import TRADED
from tests.commands import assert_one_line, main, run

READING = (  # commands that read machines
    *("map", "optimize", "validate", "design", "check", "compare", "pareto", "steps", "control"),
    *("move", "sensitivity", "what-if", "tolerances", "identify", "calibrate"),
)
COMMANDS = {c.callback.__name__: c.callback for c in cli.app.registered_commands if c.callback}


def options_of(command: str) -> set[str]:
    return set(inspect.signature(COMMANDS[command]).parameters)


@pytest.mark.parametrize("command", READING)
def test_commands_that_read_a_machine_take_other_numbers(command: str) -> None:
    assert {"set", "out", "quiet"} <= options_of(command)


@pytest.mark.parametrize("command", ["optimize", "design", "pareto", "steps"])
def test_searches_say_how(command: str) -> None:
    more = set() if command == "steps" else {"starts", "seed"}
    assert {"workers", "catalogue", "free", "nominal"} | more <= options_of(command)


@pytest.mark.slow
def test_other_numbers_are_those_of_replace(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    more = ["--set", "fluid.bulk_modulus_MPa=1000", "--set", "cylinder.lift.bore_mm=70"]
    assert main(["map", "paper_1dof", "--points", "5", *more, "--quiet"], monkeypatch) == 0
    machine = ad.load("paper_1dof").replace(
        {"fluid.bulk_modulus_MPa": 1000.0, "cylinder.lift.bore_mm": 70.0}
    )
    frame = ad.frequency_map(machine, ad.Workspace.grid(machine, 5)).frame
    written = pd.read_csv("out/map_paper_1dof/map.csv")
    assert written["f1_hz"].to_list() == pytest.approx(frame["f1_hz"].to_list(), rel=1e-8)


def test_of_one_key_the_last_number_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As where a refusal says what to add to the line that it refuses; it was refused again."""
    monkeypatch.chdir(tmp_path)
    written = []
    for bores in (["70"], ["1e9", "70"]):
        more = [word for bore in bores for word in ("--set", f"cylinder.lift.bore_mm={bore}")]
        assert main(["map", "paper_1dof", "--points", "3", "--quiet", *more], monkeypatch) == 0
        written.append(Path("out/map_paper_1dof/map.csv").read_bytes())
    assert written[0] == written[1]


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("fluid.bulk_modulus_MPa", '--set: "fluid.bulk_modulus_MPa" is not understood; give KEY='),
        ("fluid.bulk=1", "--set fluid.bulk"),
        (
            "fluid.bulk_modulus_MPa=-3",
            "--set fluid.bulk_modulus_MPa: -3.0 is not allowed; give a number",
        ),
        ("cylinder.lift.rod_mm=850", "--set cylinder.lift.rod_mm: 850 mm does not fit the bore"),
        ("fluid.bulk_modulus_MPa=soft", '--set fluid.bulk_modulus_MPa: "soft" is not allowed'),
        ("cylinder.lift.base.at_mm.0=x", '--set cylinder.lift.base.at_mm.0: "x" is not allowed'),
        ("cylinder.lift.base.at_mm=[1, 2]", "--set cylinder.lift.base.at_mm: [1.0, 2.0] is not"),
        (
            "cylinder.lift.closed_length_mm=100",
            "--set cylinder.lift.closed_length_mm=100: cylinder.lift.stroke_mm: over joint",
        ),
        ("urdf=other.urdf", "--set urdf: is another file, no number of this; write a machine"),
    ],
)
def test_bad_numbers_are_one_line(
    word: str,
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["map", "paper_1dof", "--set", word], monkeypatch) == 2
    said = capfd.readouterr().err
    assert_one_line(said, message)
    assert ("(line " in said) == ("=100: " in said)  # of another key than the one that is set
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_runs_do_not_mix_and_quiet_ones_say_nothing(tmp_path: Path) -> None:
    for words in (["map", "paper_1dof"], ["compare", "paper_1dof", "paper_1dof"]):
        done = run(*words, "--points", "5", "--quiet", folder=tmp_path)
        assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {"map_paper_1dof", "compare_paper_1dof_paper_1dof"}


def test_version_and_short_help(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--version"], monkeypatch) == 0
    assert capsys.readouterr().out == f"armdesign {ad.__version__}\n"
    for words in (["-h"], ["pareto", "-h"]):
        assert main(words, monkeypatch) == 0
        short = capsys.readouterr().out
        assert main([*words[:-1], "--help"], monkeypatch) == 0
        assert capsys.readouterr().out == short != ""
        assert "...\n" not in short.split("\n", 1)[1]  # no line of a list of commands is cut


def test_machines_complete(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "example").mkdir()
    (tmp_path / "exact.toml").touch()
    (tmp_path / "exact.urdf").touch()
    names = machine_names("ex")
    assert {"excavator_20t", "example/", "exact.toml"} <= set(names)
    assert "exact.urdf" not in names
    assert machine_names("[") == []


def test_words_of_options_complete() -> None:
    """All that an option takes, as its command knows them; after a comma the next of several."""
    known = {
        ("optimize", "--objective"): [*OBJECTIVES, "bandwidth"],
        ("optimize", "--least"): AMOUNTS,
        ("pareto", "--against"): TRADED,
        ("export", "--format"): FORMATS,
        ("control", "--filter"): get_args(Filter),
        ("move", "--shaper"): KINDS,
        ("new", "--like"): machine_names(""),
    }
    group: Any = typer.main.get_command(cli.app)
    for (name, option), words in known.items():
        command = group.commands[name]
        (one,) = (p for p in command.params if option in p.opts)
        completed = one.shell_complete(typer.Context(command), "")
        assert sorted(item.value for item in completed) == sorted(words), option
    assert one_of("high-pass", "band-pass")("b") == ["band-pass"]
    assert some_of("csv", "sdf")("csv,s") == ["csv,sdf"]


def test_the_shell_asks_for_words(tmp_path: Path) -> None:
    """What the shell's script calls while somebody types ``armdesign map pap<TAB>``."""
    script = "import sys; sys.argv = ['armdesign']; from armdesign import cli; cli.main()"
    environment = {"_ARMDESIGN_COMPLETE": "complete_bash", "COMP_WORDS": "armdesign map pap"}
    done = subprocess.run(
        [sys.executable, "-c", script],
        cwd=tmp_path,
        env={**os.environ, **environment, "COMP_CWORD": "2"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split() == ["paper_1dof"]


@pytest.mark.slow
def test_piped_tables_are_not_wrapped_or_filled_up(tmp_path: Path) -> None:
    done = run("check", "excavator_20t", "--points", "3", folder=tmp_path)
    lines = done.stdout.splitlines()
    assert all(line == line.rstrip() for line in lines)
    assert any(len(line) > 100 for line in lines)


@pytest.mark.parametrize(
    ("command", "without"),
    [("export", ("pictures", "units")), ("view", ("pictures", "units")), ("sweep", ("pictures",))],
)
def test_options_that_would_change_nothing_are_not_there(
    command: str,
    without: tuple[str, ...],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """No picture is written, no table printed."""
    assert not set(without) & options_of(command)
    assert main([command, "paper_1dof", "--pictures", "svg"], monkeypatch) == 2
    assert "No such option: --pictures" in capsys.readouterr().err


@pytest.mark.parametrize("pose", ["boom=10,boom=20", "boom=10, boom =10"])
def test_a_joint_has_one_position(
    pose: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["draw", "excavator_20t", "--pose", pose], monkeypatch) == 2
    assert_one_line(capsys.readouterr().err, "--pose: names boom twice; give one position of each")


def test_the_file_of_a_folder_of_another_name_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As of ``design``, whose folder holds ``<machine>_optimized.toml``."""
    file = tmp_path / "x_optimized.toml"
    file.write_text(ad.load("paper_1dof").text, encoding="utf-8")
    for command in ("check", "map", "draw"):
        assert main([command, str(tmp_path)], monkeypatch) == 2
        assert_one_line(capsys.readouterr().err, f"name the .toml file itself, as {file}")
