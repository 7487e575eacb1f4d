"""The command line: what it writes, and that bad input is one line, exit code 2 and nothing
written.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import tomllib
from pathlib import Path

import pandas as pd
import pytest

import armdesign as ad
from armdesign import cli
from armdesign.errors import ArmDesignError
from armdesign.frequency.bands import worst_within
from armdesign.report.designs import design_sheets
from armdesign.units import SI, WORKSHOP
from tests import machines
from tests.commands import Refused, assert_one_line, main

# all take MACHINE, --out, --points and --units
COMMANDS = ["map", "optimize", "validate", "design"]
OTHERS = {  # and what they take
    "check": ["--points", "--units"],
    "compare": ["--out", "--points", "--units"],
    "new": ["--out", "--links"],
    "pareto": ["--against", "--values", "--vary", "--robust", "--out", "--points", "--units"],
}
QUICK = {  # what each writes for the one-joint machine
    "map": {
        "map.csv",
        "stiffness.csv",
        "map_joints.png",
        "map_reach.png",
        "map_holding.png",
        "moment_arms.png",
    }
}
ARMDESIGN = [sys.executable, "-m", "armdesign.cli"]


def run(*words: str, folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*ARMDESIGN, *words],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
        env={**os.environ, "OMP_NUM_THREADS": "1", **environment},
    )


# ------------------------------------------------------------------------------------ what it does


@pytest.mark.parametrize("command", QUICK)
def test_a_command_writes_its_files_and_nothing_else(command: str, tmp_path: Path) -> None:
    done = run(command, "paper_1dof", "--out", "results/here", "--points", "15", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert {path.name for path in (tmp_path / "results" / "here").iterdir()} == QUICK[command]
    assert [path.name for path in tmp_path.iterdir()] == ["results"]
    assert "Traceback" not in done.stdout
    assert "results/here" in done.stdout


@pytest.mark.slow
def test_optimize_from_a_catalogue_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The machine written has sizes of the list, and the report says that they are proved the
    best.
    """
    (tmp_path / "own.csv").write_text(
        "bore_mm,rod_mm\n120,85\n140,100\n115,85\n", encoding="utf-8"
    )
    words = [
        "optimize",
        "excavator_20t",
        "--vary",
        "areas",
        "--points",
        "3,3,5",
        "--out",
        str(tmp_path / "a"),
    ]
    assert main([*words, "--catalogue", str(tmp_path / "own.csv")], monkeypatch) == 0
    machine = ad.load(tmp_path / "a" / "excavator_20t_optimized.toml")
    assert {(round(c.bore, 9), round(c.rod, 9)) for c in machine.cylinders} <= {
        (0.12, 0.085),
        (0.14, 0.1),
        (0.115, 0.085),
    }
    assert "all combinations of the catalogue" in " ".join(capsys.readouterr().out.split())
    assert main([*words, "--catalogue", "din"], monkeypatch) == 2
    assert 'catalogue: "din" is not known' in capsys.readouterr().err


@pytest.mark.slow
def test_least_oil_for_a_frequency(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The machine written has the frequency on the poses that counted, and sweeps no more oil than
    today's.
    """
    words = [
        "optimize",
        "excavator_20t",
        "--vary",
        "areas",
        "--points",
        "3,3,5",
        "--out",
        str(tmp_path / "a"),
    ]
    assert main([*words, "--least", "oil", "--frequency", "0.9"], monkeypatch) == 0
    machine, today = (
        ad.load(tmp_path / "a" / "excavator_20t_optimized.toml"),
        machines.named("excavator_20t"),
    )
    frame = ad.frequency_map(machine, ad.Workspace.grid(today, [3, 3, 5])).frame
    assert frame["f1_hz"].min() >= 0.9
    oil = [sum(c.bore_area * c.stroke for c in m.cylinders) for m in (machine, today)]
    assert oil[0] < oil[1]
    capsys.readouterr()
    for more in (["--least", "oil"], ["--frequency", "1"]):
        assert main([*words, *more], monkeypatch) == 2
        assert "--least: goes with --frequency" in capsys.readouterr().err


BANDED = "\n[bands]\npayload_share = [0.7, 1.3]\nbulk_modulus_share = [0.8, 1.0]\n"


def stated(folder: Path, more: str = BANDED) -> str:
    """A copy of the 20 t machine whose file says more."""
    machine = machines.named("excavator_20t")
    (folder / "excavator_20t.urdf").write_text(machine.urdf_text, encoding="utf-8")
    text = machine.text.partition("[bands]")[0]  # the last table
    (folder / "own.toml").write_text(text + more, encoding="utf-8")
    return str(folder / "own.toml")


@pytest.mark.slow
@pytest.mark.parametrize(
    "more", [[], ["--nominal"], ["--catalogue", "5mm"], ["--least", "oil", "--frequency", "0.7"]]
)
def test_designs_are_for_the_bands_of_the_file(
    more: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The machine written is that of ``ad.size_cylinders``, for the file's bands unless they are
    not to count, and the report says so.
    """
    words = [
        "optimize",
        stated(tmp_path),
        "--vary",
        "areas",
        "--points",
        "3,3,5",
        "--out",
        str(tmp_path / "a"),
    ]
    assert main([*words, *more], monkeypatch) == 0
    printed = " ".join(capsys.readouterr().out.split())
    machine = ad.load(tmp_path / "own.toml")
    bands, space = ad.Bands.of(machine), ad.Workspace.grid(machine, [3, 3, 5])
    found = ad.load(tmp_path / "a" / "excavator_20t_optimized.toml")
    worst = worst_within(found, space, bands, machine).frequency
    made_for = "least gain"
    if "--least" in more:
        made_for = "lowest"
        assert worst >= 0.7
    else:
        made = ad.size_cylinders(
            machine,
            space,
            bands=ad.Bands() if "--nominal" in more else None,
            catalogue="5mm" if "--catalogue" in more else None,
        )
        made_for = "file's values alone" if "--nominal" in more else made_for
        assert found.section == made.machine.section
    assert f"{worst:.3f} Hz" in printed
    assert f"the new machine was designed for the {made_for}" in printed


def test_map_csv_is_the_frame_of_the_map(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "a"
    assert main(["map", "excavator_20t", "--out", str(out), "--points", "3,3,5"], monkeypatch) == 0
    machine = machines.named("excavator_20t")
    frame = ad.frequency_map(machine, ad.Workspace.grid(machine, [3, 3, 5])).frame
    pd.testing.assert_frame_equal(
        pd.read_csv(out / "map.csv"), frame, check_dtype=False, rtol=1e-8, atol=1e-8
    )


def test_the_worst_frequency_is_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """0.910 Hz by boom cylinder, full bucket: tests/reference_planar.py."""
    assert (
        main(["map", "excavator_20t", "--out", str(tmp_path), "--points", "5"], monkeypatch) == 0
    )
    printed = capsys.readouterr().out
    assert "0.910 Hz" in printed
    assert "boom" in printed
    assert "payload full" in printed


def test_a_second_run_replaces_its_files_and_leaves_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    for points in ("5", "6"):
        assert (
            main(["map", "paper_1dof", "--out", str(tmp_path), "--points", points], monkeypatch)
            == 0
        )
    assert len(pd.read_csv(tmp_path / "map.csv")) == 6
    assert (tmp_path / "notes.txt").read_text() == "mine"
    assert {path.name for path in tmp_path.iterdir()} == {*QUICK["map"], "notes.txt"}


@pytest.mark.parametrize("command", ["", *COMMANDS, *OTHERS])
def test_help(
    command: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*([command] if command else []), "--help"], monkeypatch) == 0
    printed = capsys.readouterr().out
    for word in (
        [command, *OTHERS.get(command, ["--out", "--points", "--units"])]
        if command
        else [*COMMANDS, *OTHERS]
    ):
        assert word in printed


@pytest.mark.slow
def test_tables_in_si(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The same pose in both habits: 66.1° is 1.1545 rad."""
    words = ["map", "excavator_20t", "--out", str(tmp_path), "--points", "5"]
    printed = []
    for units in ("workshop", "si"):
        assert main([*words, "--units", units], monkeypatch) == 0
        printed.append(capsys.readouterr().out)
    assert "boom 66.1°" in printed[0]
    assert "boom 1.1545 rad" in printed[1]
    assert "°" not in printed[1]


def test_every_table_in_both_habits() -> None:
    """One table of units serves all sheets: a bore of 120 mm is 0.1200 m, 350 bar × area is in kN
    or N.
    """
    machine = machines.named("excavator_20t")
    found = ad.size_cylinders(machine, ad.Workspace.grid(machine, 4))
    workshop, si = (design_sheets(found, units) for units in (WORKSHOP, SI))
    assert [len(sheet.rows) for sheet in workshop] == [len(sheet.rows) for sheet in si]
    assert workshop[1].rows[0][:3] == ("boom", "2 × 120.0", "85.0")
    assert si[1].rows[0][:3] == ("boom", "2 × 0.1200", "0.0850")
    assert (workshop[3].rows[0][3], si[3].rows[0][3]) == ("792", "791681")
    assert "[mm]" in workshop[1].title
    assert re.search(r"\d (mm|kN|l)\b|°|\[(mm|kN|bar|l)\]", str(workshop))
    assert not re.search(r"\d (mm|kN|l)\b|°|\[(mm|kN|bar|l)\]", str(si))


def test_a_trade_off_is_a_table_and_a_picture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [
        "pareto",
        "paper_1dof",
        "--values",
        "0.9,1",
        "--vary",
        "areas",
        "--points",
        "9",
        "--out",
        str(tmp_path),
    ]
    assert main(words, monkeypatch) == 0
    assert {path.name for path in tmp_path.iterdir()} == {"pareto.csv", "pareto.png"}
    table = pd.read_csv(tmp_path / "pareto.csv")
    assert table["limit"].to_list() == [0.9, 1.0]
    printed = capsys.readouterr().out
    for frequency in table["frequency_hz"]:
        assert f"{frequency:.3f} Hz" in printed


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--values", "1,x"], '--values: "1,x" is not a list of numbers; give 0.9,1.0,1.1'),
        (["--values", "0,9"], '--values: "0,9" may be 0.9, or 0 and 9; give 0.9, or 0.0,9.0'),
        (["--values", "0.8,1,2"], '--values: "1,2" may be 1.2, or 1 and 2; give 1.2, or 1.0,2.0'),
        (
            ["--values", "0.0,1.0"],
            "--values: 0 of today's is not allowed; give 0.1 to 3 of today's",
        ),
        (
            ["--values", "1.0,9.0"],
            "--values: 9 of today's is not allowed; give 0.1 to 3 of today's",
        ),
        (["--values", "nan"], "--values: nan of today's is not allowed"),
        (
            ["--against", "pin_box", "--values", "50"],
            "--values: 50 m is not allowed; give 0 to 3 m",
        ),
        (
            ["--against", "speed"],
            "against: 'speed' is not allowed; choose from: oil, thrust, digging, pin_box",
        ),
    ],
)
def test_bad_trade_offs_are_one_line(
    words: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    assert main(["pareto", "paper_1dof", *words, "--out", str(tmp_path / "out")], monkeypatch) == 2
    assert_one_line(capfd.readouterr().err, message)
    assert not list(tmp_path.iterdir())


# --------------------------------------------------------------------------------------- bad input


def broken(folder: Path, old: str, new: str) -> str:
    """A copy of the excavator with one text changed, as `broken.toml` in the folder."""
    machine = machines.named("excavator_20t")
    assert old in machine.text
    (folder / "broken.toml").write_text(machine.text.replace(old, new, 1), encoding="utf-8")
    (folder / "excavator_20t.urdf").write_text(machine.urdf_text, encoding="utf-8")
    return "broken.toml"


BAD = [
    (["excavater_20t"], 'did you mean "excavator_20t"'),
    (["none.toml"], "none.toml: no such file"),
    ([""], "holds no"),
    (["."], "holds no"),
    (
        ["excavator_20t", "--points", "x"],
        '--points: "x" is not a list of numbers; give 21 or 21,21,61',
    ),
    (["excavator_20t", "--points", "1"], "points: 1 is not allowed"),
    (["excavator_20t", "--points", "3,3"], "points: [3, 3] is not allowed"),
    (["excavator_20t", "--points", "3,3,3,3"], "is not allowed; give one number ≥ 2, or 3"),
    (["excavator_20t", "--points", "-5"], "points: -5 is not allowed"),
    (["excavator_20t", "--points", "3.5"], "is not a list of numbers"),
    (
        ["excavator_20t", "--units", "inch"],
        "Invalid value for '--units': 'inch' is not one of 'workshop', 'si'.",
    ),
    (["excavator_20t", "--points", "999999"], "poses are too many; give at most 5"),
]


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize(("words", "message"), BAD, ids=[" ".join(words) for words, _ in BAD])
def test_bad_arguments_are_one_line(
    command: str, words: list[str], message: str, refused: Refused
) -> None:
    refused([command, *words, "--out", "out"], message)


@pytest.mark.parametrize(("words", "message"), BAD, ids=[" ".join(words) for words, _ in BAD])
def test_bad_arguments_of_check(words: list[str], message: str, refused: Refused) -> None:
    refused(["check", *words], message)


FILES = [
    (
        "bore_mm = 120",
        "bore = 120",
        'broken.toml: cylinder.boom.bore: unknown key; did you mean "bore_mm"?',
    ),
    (
        "bore_mm = 120\n",
        "",
        "broken.toml: cylinder.boom.bore_mm: missing; add bore_mm: a number in (0, 100000] mm",
    ),
    (
        "bore_mm = 120",
        "bore_mm = nan",
        "cylinder.boom.bore_mm: nan is not allowed; give a number in (0, 100000] mm",
    ),
    (
        "bore_mm = 120",
        'bore_mm = "120"',
        'cylinder.boom.bore_mm: "120" is not allowed; give a number',
    ),
    (
        "bore_mm = 120",
        "bore_mm = -120",
        "cylinder.boom.bore_mm: -120 is not allowed; give a number in (0, 100000] mm",
    ),
    (
        'link = "chassis"',
        'link = "chasis"',
        'cylinder.boom.base.link: no link "chasis" in the URDF; did you mean',
    ),
    ("closed_length_mm = 1825", "closed_length_mm = 9000", "cylinder.boom.stroke_mm: over joint"),
    ("rocker_mm = 578.7", "rocker_mm = 5000", "cylinder.bucket.four_bar: does not close at any"),
    (
        'link = "bucket"\nat_mm = [645',
        "at_mm = [645",
        "payload.full.link: missing: a mass must sit somewhere; add link",
    ),
    ("[461.5, 0, -602.5]", "[0, 0, 0]", "cylinder.boom: is at its dead centre"),
    ("excavator_20t.urdf", "none.urdf", 'urdf: "none.urdf": no such file; check the path'),
    ("[fluid]", "[fluid", "broken.toml: not valid TOML"),
]


@pytest.mark.parametrize(
    ("old", "new", "message"), FILES, ids=[message[:40] for *_, message in FILES]
)
def test_a_broken_file_is_one_line(
    old: str,
    new: str,
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    """The list of the requirement, each with key, value, range and remedy."""
    monkeypatch.chdir(tmp_path)
    before = {path.name for path in tmp_path.iterdir()} | {
        broken(tmp_path, old, new),
        "excavator_20t.urdf",
    }
    assert main(["map", "broken.toml", "--out", "out", "--points", "3"], monkeypatch) == 2
    out, err = capfd.readouterr()
    assert out == ""
    assert_one_line(err, message)
    assert {path.name for path in tmp_path.iterdir()} == before
    assert main(["check", "broken.toml"], monkeypatch) == 2
    assert message in capfd.readouterr().err


@pytest.mark.parametrize("command", COMMANDS)
def test_a_process_of_its_own_says_the_same(command: str, tmp_path: Path) -> None:
    """Nothing on the way to the terminal: no warning, no C++ parser, no progress display."""
    name = broken(tmp_path, "rod_mm = 85", "rod_mm = 850")
    done = run(command, name, folder=tmp_path, PYTHONWARNINGS="error")
    assert done.returncode == 2
    assert done.stdout == ""
    assert_one_line(
        done.stderr,
        "broken.toml: cylinder.boom.rod_mm: 850 mm does not fit the bore; give a rod in (0, 120)",
    )
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "broken.toml",
        "excavator_20t.urdf",
    ]


@pytest.mark.parametrize("out", ["/proc/none", "/dev/null/x", "notes.txt", "l" * 300])
def test_a_place_that_cannot_be_written(
    out: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "notes.txt").write_text("mine")
    assert main(["map", "paper_1dof", "--out", out, "--points", "5"], monkeypatch) == 2
    assert_one_line(capfd.readouterr().err, f"--out {out[:40]}")
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]
    assert (tmp_path / "notes.txt").read_text() == "mine"


@pytest.mark.parametrize(
    "words", [["map"], ["nothing"], ["map", "a", "b"], ["map", "a", "--nothing"]]
)
def test_wrong_usage_is_code_2(words: list[str], tmp_path: Path) -> None:
    done = run(*words, folder=tmp_path)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert not list(tmp_path.iterdir())


# ------------------------------------------------------------------------------------ interruption


@pytest.mark.parametrize(
    "error", [OSError(28, "No space left on device"), ArmDesignError("part", "problem", "remedy")]
)
def test_a_failed_write_leaves_the_old_files(
    error: Exception,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    """The CSV is written, then the second picture fails: neither is there, the files of the last
    run are.
    """
    from armdesign import plots

    assert main(["map", "paper_1dof", "--out", str(tmp_path), "--points", "5"], monkeypatch) == 0
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    capfd.readouterr()

    def failing(fig: object, path: Path) -> Path:
        raise error

    monkeypatch.setattr(plots, "save", failing)
    assert main(["map", "paper_1dof", "--out", str(tmp_path), "--points", "9"], monkeypatch) == 2
    assert capfd.readouterr().err.count("\n") == 1
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


WAITING = """
import sys, time
from armdesign import cli, plots
from armdesign.frequency import maps
def wait(*_, **__):
    print("ready", flush=True)
    time.sleep(60)
{}.{} = wait
sys.argv = ["armdesign", "map", "paper_1dof", "--points", "5"]
cli.main()
"""


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("where", [("maps", "frequency_map"), ("plots", "save")])
def test_ended_in_the_middle(
    number: signal.Signals, where: tuple[str, str], tmp_path: Path
) -> None:
    """By Ctrl-C, as a service ends or with the terminal, while computing or writing: no traceback,
    nothing written.
    """
    process = subprocess.Popen(
        [sys.executable, "-c", WAITING.format(*where)],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    process.send_signal(number)
    out, err = process.communicate(timeout=30)
    assert (process.returncode, out) == (128 + number, "")
    assert err.strip() == "armdesign: interrupted; nothing was written"
    assert not list(tmp_path.iterdir())


def test_ended_while_files_move(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Ctrl-C then waits until all of them are in place, and what is said is true."""
    real = os.replace

    def interrupted(source: str, target: str) -> None:
        os.kill(os.getpid(), signal.SIGINT)
        real(source, target)

    monkeypatch.setattr(os, "replace", interrupted)
    assert main(["map", "paper_1dof", "--out", str(tmp_path), "--points", "5"], monkeypatch) == 130
    out, err = capsys.readouterr()
    assert out.startswith("wrote map.csv")
    assert err.strip() == "armdesign: interrupted; all was written"
    assert {path.name for path in tmp_path.iterdir()} == QUICK["map"]


def test_an_end_of_file_is_no_interruption(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """typer takes it for Ctrl-D; what a damaged file says of itself is not hidden behind that."""

    def ended(*_: object) -> None:
        raise EOFError("Ran out of input")

    monkeypatch.setattr("armdesign.frequency.maps.frequency_map", ended)
    monkeypatch.setattr(
        sys, "argv", ["armdesign", "map", "paper_1dof", "--points", "5", "--out", str(tmp_path)]
    )
    with pytest.raises(EOFError, match="Ran out of input"):
        cli.main()


def test_a_folder_in_the_way(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "stiffness.csv").mkdir()
    assert main(["map", "paper_1dof", "--out", str(tmp_path), "--points", "5"], monkeypatch) == 2
    assert_one_line(
        capfd.readouterr().err, "cannot be written (a folder named stiffness.csv is in the way)"
    )
    assert [path.name for path in tmp_path.iterdir()] == ["stiffness.csv"]


def test_what_a_killed_run_left_behind_is_gone_with_the_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", WAITING.format("plots", "save")],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    assert [path.name[:9] for path in (tmp_path / "out").iterdir()] == [".writing-"]
    process.kill()
    process.communicate(timeout=30)
    assert list((tmp_path / "out").iterdir())
    monkeypatch.chdir(tmp_path)
    # even one that is refused later
    assert main(["map", "paper_1dof", "--points", "x"], monkeypatch) == 2
    assert main(["map", "none.toml"], monkeypatch) == 2
    assert not list((tmp_path / "out").iterdir())


def test_the_urdf_of_another_machine_is_not_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Another is refused before anything is computed; that of an earlier design of the same
    machine is replaced.
    """
    words = ["optimize", "paper_1dof", "--vary", "areas", "--points", "5", "--out", str(tmp_path)]
    (tmp_path / "paper_1dof.urdf").write_text("mine")
    assert main(words, monkeypatch) == 2
    assert_one_line(
        capfd.readouterr().err, "another paper_1dof.urdf is there; name another folder"
    )
    assert [path.read_text() for path in tmp_path.iterdir()] == ["mine"]
    (tmp_path / "paper_1dof_optimized.toml").write_text('urdf = "paper_1dof.urdf"')
    assert main(words, monkeypatch) == 0
    assert (
        ad.load(tmp_path / "paper_1dof_optimized.toml").urdf_text
        == machines.named("paper_1dof").urdf_text
    )


def test_what_is_installed_as_a_script() -> None:
    project = tomllib.loads((Path(__file__).parent.parent / "pyproject.toml").read_text())
    assert project["project"]["scripts"] == {"armdesign": "armdesign.cli:main"}


@pytest.mark.slow
def test_vary_takes_key_paths(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One pin alone, by the path that it has in the file: nothing else moves, but the stroke
    follows.
    """
    words = ["optimize", "excavator_20t", "--points", "4", "--out", str(tmp_path), "--vary"]
    assert main([*words, "cylinder.boom.base"], monkeypatch) == 0
    old, new = (
        tomllib.loads(Path(path).read_text(encoding="utf-8"))["cylinder"]
        for path in (ad.load("excavator_20t").source, tmp_path / "excavator_20t_optimized.toml")
    )
    assert {key for key in old["boom"] if new["boom"][key] != old["boom"][key]} == {
        "base", "stroke_mm", "closed_length_mm"
    }  # fmt: skip
    assert [new[name] for name in ("stick", "bucket")] == [
        old[name] for name in ("stick", "bucket")
    ]


def test_an_unknown_vary_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["optimize", "excavator_20t", "--points", "4", "--out", str(tmp_path), "--vary"]
    assert main([*words, "areas,cylinder.boom.bore"], monkeypatch) == 2
    assert capsys.readouterr().err.splitlines() == [
        "armdesign: vary cylinder.boom.bore: nothing of this name can vary; "
        'did you mean "cylinder.boom.bore_mm"?'
    ]  # fmt: skip
