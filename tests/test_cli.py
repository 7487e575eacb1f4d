"""The command line: what it writes, and that bad input is one line, exit code 2 and nothing
written.
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pandas as pd
import pytest

import armdesign as ad
from armdesign.report.designs import design_sheets
from armdesign.units import SI, WORKSHOP
from tests import machines
from tests.checks import worst_within
from tests.commands import COMMANDS, QUICK, areas_of, assert_one_line, main, map_of, run

OTHERS = {  # and what they take
    "check": ["--out", "--points", "--units"],
    "draw": ["--pose", "--payload", "--out", "--pictures"],
    "compare": ["--out", "--points", "--units"],
    "new": ["--out", "--links"],
    "sensitivity": ["--out", "--points", "--units"],
    "move": ["--from", "--to", "--payload", "--shaper", "--modes", "--damping", "--duration"],
    "pareto": ["--against", "--values", "--vary", "--nominal", "--out", "--points", "--units"],
}


# ------------------------------------------------------------------------------------ what it does


@pytest.mark.parametrize(
    "command", [pytest.param(c, marks=() if c == "map" else pytest.mark.slow) for c in QUICK]
)
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
    words = areas_of("excavator_20t", tmp_path / "a")
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
    words = areas_of(stated(tmp_path, ""), tmp_path / "a")
    least = ["--least", "oil", "--frequency", "0.75", "--nominal"]
    assert main([*words, *least], monkeypatch) == 0
    machine, today = (
        ad.load(tmp_path / "a" / "excavator_20t_optimized.toml"),
        machines.rigid("excavator_20t"),
    )
    frame = ad.frequency_map(machine, ad.Workspace.grid(today, [3, 3, 5])).frame
    assert frame["f1_hz"].min() >= 0.75
    oil = [sum(c.bore_area * c.stroke for c in m.cylinders) for m in (machine, today)]
    assert oil[0] < oil[1]
    lines = capsys.readouterr().out.splitlines()
    swept = " → ".join(f"{1000 * one:.1f}" for one in oil[::-1])
    assert lines[0].startswith("wrote ")
    assert lines[1].startswith(f"Oil of all cap sides: {swept} l (")
    assert lines[1].endswith(" Hz, 0.75 Hz asked for.")
    assert not lines[2]
    for more in (["--least", "oil"], ["--frequency", "1"]):
        assert main([*words, *more], monkeypatch) == 2
        assert "--least: goes with --frequency" in capsys.readouterr().err
    assert main([*words, "--least", "oil", "--frequency", "0"], monkeypatch) == 2
    assert "frequency: 0 Hz is not allowed; give a number > 0" in capsys.readouterr().err
    for name, value in (("--objective", "bandwidth"), ("--damping", "0.02")):
        assert main([*words, *least, name, value], monkeypatch) == 2
        assert f"{name}: goes not with --least" in capsys.readouterr().err


BANDED = "payload_share = [0.7, 1.3]\nbulk_modulus_share = [0.8, 1.0]\n"


def stated(folder: Path, bands: str = BANDED) -> str:
    """A copy of the rigid 20 t machine whose file states other bands."""
    machine = machines.rigid("excavator_20t")
    (folder / "excavator_20t.urdf").write_text(machine.urdf_text, encoding="utf-8")
    text = machines.machine_with(machine, bands).text
    (folder / "own.toml").write_text(text, encoding="utf-8")
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
    """The machine written is what ``ad.size_cylinders`` gives, for the file's bands unless they
    are not to count, and the report says so.
    """
    words = areas_of(stated(tmp_path), tmp_path / "a")
    assert main([*words, *more], monkeypatch) == 0
    printed = " ".join(capsys.readouterr().out.split())
    machine = ad.load(tmp_path / "own.toml")
    bands, space = ad.Bands.of(machine), ad.Workspace.grid(machine, [3, 3, 5])
    optimized = ad.load(tmp_path / "a" / "excavator_20t_optimized.toml")
    worst = worst_within(optimized, space, bands, machine).frequency
    made_for = "least gain"
    if "--least" in more:
        made_for = "lowest"
        assert worst >= 0.7
    else:
        design = ad.size_cylinders(
            machine,
            space,
            bands=ad.Bands() if "--nominal" in more else None,
            catalogue="5mm" if "--catalogue" in more else None,
        )
        made_for = "file's values alone" if "--nominal" in more else made_for
        assert optimized.section == design.machine.section
    assert f"{worst:.3f} Hz" in printed
    assert f"the new machine was designed for the {made_for}" in printed


@pytest.mark.slow
def test_a_map_is_written_and_its_worst_frequency_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """0.767 Hz by boom cylinder, full bucket: tests/reference_planar.py."""
    words = ["map", "excavator_20t", "--out", str(tmp_path), "--points", "5,3,5"]
    assert main(words, monkeypatch) == 0
    machine = machines.named("excavator_20t")
    frame = ad.frequency_map(machine, ad.Workspace.grid(machine, [5, 3, 5])).frame
    pd.testing.assert_frame_equal(
        pd.read_csv(tmp_path / "map.csv"), frame, check_dtype=False, rtol=1e-8, atol=1e-8
    )
    printed = capsys.readouterr().out
    assert "0.767 Hz" in printed
    assert "boom" in printed
    assert "payload full" in printed


@pytest.mark.parametrize("quiet", [False, True])
def test_a_number_that_looks_wrong_is_told_after_the_answer(
    quiet: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """1.3 GPa under a key in MPa: the map is of 1.3 MPa, and says so."""
    words = ["map", "paper_1dof", "--points", "5", "--out", str(tmp_path / "a")]
    wrong = ["--set", "fluid.bulk_modulus_MPa=1.3", *(["--quiet"] if quiet else [])]
    assert main(words, monkeypatch) == 0
    assert not capsys.readouterr().err
    assert main([*words, *wrong], monkeypatch) == 0
    told = "fluid.bulk_modulus_MPa is taken as it stands, but 1.3 MPa looks like GPa: write 1300"
    assert (told in capsys.readouterr().err) != quiet


@pytest.mark.slow
def test_a_second_run_replaces_its_files_and_leaves_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    for points in ("5", "6"):
        assert main(map_of(tmp_path, points), monkeypatch) == 0
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


def test_help_says_ranges(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Those that the refusals of other numbers state, too."""
    assert main(["design", "--help"], monkeypatch) == 0
    words = " ".join(re.sub("[│|]", " ", capsys.readouterr().out).split())
    assert "Starts of the search, 1 to 10000;" in words
    assert "Processes, 1 to 256, that share" in words


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


@pytest.mark.slow
def test_every_table_in_both_habits() -> None:
    """One table of units serves all sheets: a bore of 120 mm is 0.1200 m, 350 bar × area is in kN
    or N.
    """
    machine = machines.named("excavator_20t")
    design = ad.size_cylinders(machine, ad.Workspace.grid(machine, 4))
    workshop, si = (design_sheets(design, units) for units in (WORKSHOP, SI))
    assert [len(sheet.rows) for sheet in workshop] == [len(sheet.rows) for sheet in si]
    assert workshop[2].rows[0][:3] == ("boom", "2 × 120.0", "85.0")
    assert si[2].rows[0][:3] == ("boom", "2 × 0.1200", "0.0850")
    assert (workshop[4].rows[0][3], si[4].rows[0][3]) == ("792", "791681")
    assert "[mm]" in workshop[2].title
    assert re.search(r"\d (mm|kN|l)\b|°|\[(mm|kN|bar|l)\]", str(workshop))
    assert not re.search(r"\d (mm|kN|l)\b|°|\[(mm|kN|bar|l)\]", str(si))


def test_a_trade_off_is_a_table_and_a_picture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [
        "pareto",
        "paper_1dof",
        "--values",
        "0.97,1",
        "--vary",
        "areas",
        "--points",
        "9",
        "--out",
    ]
    assert main([*words, str(tmp_path)], monkeypatch) == 0
    assert {path.name for path in tmp_path.iterdir()} == {"pareto.csv", "pareto.png"}
    table = pd.read_csv(tmp_path / "pareto.csv")
    assert table["limit"].to_list() == [0.97, 1.0]
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
            "--against: 'speed' is not allowed; choose from: oil, thrust, digging, lift, pin_box",
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


@pytest.mark.slow
def test_the_urdf_of_another_machine_is_not_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Another is refused before anything is computed; the folder of an earlier design of the same
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
    assert project["project"]["scripts"] == {"armdesign": "armdesign.__main__:main"}


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
