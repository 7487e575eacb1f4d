"""``armdesign sweep STUDY.toml``: interrupted or killed, it goes on where it was."""

from __future__ import annotations

import os
import re
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

import armdesign as ad
from tests.commands import ARMDESIGN, assert_one_line, main

STUDY = """
machine = "paper_1dof"
points = 3
[grid]
fluid.bulk_modulus_MPa = [900, 1000, 1200]
"cylinder.lift.stroke_mm" = [200, 190, -5]
"""
TWICE = 'machine = "paper_1dof"\n'
LOGGED = 200_000  # [bytes] of some twenty cases: all that they need is imported by then


def written(folder: Path, text: str = STUDY) -> str:
    (folder / "study.toml").write_text(text)
    return str(folder / "study.toml")


def read(out: Path) -> pd.DataFrame:
    return pd.read_csv(out / "sweep.csv").drop(columns="seconds")


def test_a_study_is_answered_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["sweep", written(tmp_path), "--out", str(tmp_path / "out"), "--workers", "1"]
    assert main(words, monkeypatch) == 0
    first = (tmp_path / "out" / "sweep.csv").read_bytes()
    text = capsys.readouterr().out
    assert "3 cases failed; sweep.csv says why." in text
    assert main(words, monkeypatch) == 0
    assert "9 cases, 9 of them from the journal." in capsys.readouterr().out
    assert (tmp_path / "out" / "sweep.csv").read_bytes() == first
    frame = pd.read_parquet(tmp_path / "out" / "sweep.parquet").drop(columns="seconds")
    assert frame["worst_hz"].tolist()[:2] == read(tmp_path / "out")["worst_hz"].tolist()[:2]


def test_a_column_of_words_and_numbers_is_words_in_parquet(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A field of a CSV file that is no number fails its case alone."""
    (tmp_path / "cases.csv").write_text("fluid.bulk_modulus_MPa\n900\nabc\n")
    study = written(tmp_path, 'machine = "paper_1dof"\npoints = 3\ncsv = "cases.csv"\n')
    words = ["sweep", study, "--out", str(tmp_path / "out"), "--workers", "1"]
    assert main(words, monkeypatch) == 0
    frame = pd.read_parquet(tmp_path / "out" / "sweep.parquet")
    assert frame["fluid.bulk_modulus_MPa"].tolist() == ["900", "abc"]
    assert [error == "" for error in frame["error"]] == [True, False]


def test_a_pyarrow_that_cannot_be_loaded_costs_no_answer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As where its libraries do not fit into the memory; it is installed, and raises."""

    def fails(*_: Any, **__: Any) -> bytes:
        raise ImportError("libarrow.so: failed to map segment\nof another line")

    monkeypatch.setattr(pd.DataFrame, "to_parquet", fails)
    words = ["sweep", written(tmp_path), "--out", str(tmp_path / "out"), "--workers", "1"]
    assert main(words, monkeypatch) == 0
    assert len(read(tmp_path / "out")) == 9
    assert not (tmp_path / "out" / "sweep.parquet").exists()
    told = "sweep.parquet is not written: pyarrow fails (libarrow.so: failed to map segment)"
    assert told in capsys.readouterr().err


@pytest.mark.skipif(sys.platform != "linux", reason="names of files are texts elsewhere")
def test_a_folder_whose_name_is_not_utf_8(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / os.fsdecode(b"out\xff")
    words = ["sweep", written(tmp_path, TWICE), "--out", str(out), "--workers", "1"]
    assert main(words, monkeypatch) == 0
    with (out / "sweep.parquet").open("rb") as file:
        assert len(pd.read_parquet(file)) == len(read(out)) == 1


def test_requirements_of_a_study_need_no_quotes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As key paths of its grid: ``digging.share`` is a table in a table."""
    text = 'machine = "excavator_20t"\npoints = 2\n[[requirements]]\ndigging.share = 0.9\n'
    words = ["sweep", written(tmp_path, text), "--out", str(tmp_path / "out"), "--workers", "1"]
    assert main(words, monkeypatch) == 0
    assert read(tmp_path / "out")["requirements.digging.share"].tolist() == [0.9]


def test_large_whole_numbers_are_whole_in_the_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beside a case that failed; floats have 53 bits."""
    from armdesign.sweeps import tasks

    def large(machine: ad.Machine, _: ad.Workspace) -> dict[str, int]:
        if machine.section.fluid.bulk_modulus_MPa == 900.0:
            raise ValueError
        return {"n": 2**60 + 1}

    monkeypatch.setitem(tasks.TASKS, "map", large)
    words = ["sweep", written(tmp_path), "--out", str(tmp_path / "out"), "--workers", "1"]
    assert main(words, monkeypatch) == 0
    lines = (tmp_path / "out" / "sweep.csv").read_text().splitlines()
    assert f",{2**60 + 1}," in lines[-2]
    column = pd.read_parquet(tmp_path / "out" / "sweep.parquet")["n"]
    assert (column.dtype, set(column.dropna())) == ("Int64", {2**60 + 1})


def test_a_study_without_an_answer_ends_with_code_2(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its files are there all the same, and its table tells the first fault."""
    study = written(tmp_path, f"{STUDY.partition('[')[0]}[grid]\nfluid.bulk_modulus_MPa = [-1, 0]")
    words = ["sweep", study, "--out", str(tmp_path / "out"), "--workers", "1"]
    assert main(words, monkeypatch) == 2
    text = capsys.readouterr()
    assert_one_line(
        text.err, "study.toml: no case has an answer; the first says: sweep fluid.bulk"
    )
    assert "2 cases failed; sweep.csv says why. The first: " in text.out
    assert len(read(tmp_path / "out")) == 2


def test_set_changes_every_machine_of_a_study(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As a map of the machine with both numbers; a journal of other machines is refused."""
    study = written(tmp_path, STUDY.partition('"cylinder')[0])
    words = ["sweep", study, "--out", str(tmp_path / "out"), "--workers", "1"]
    assert main([*words, "--set", "cylinder.lift.bore_mm=70"], monkeypatch) == 0
    machine = ad.load("paper_1dof").replace(
        {"cylinder.lift.bore_mm": 70.0, "fluid.bulk_modulus_MPa": 1000.0}
    )
    worst = ad.frequency_map(machine, ad.Workspace.grid(machine, 3)).worst.frequency
    assert read(tmp_path / "out")["worst_hz"][1] == pytest.approx(worst, rel=1e-9)
    capsys.readouterr()
    assert main(words, monkeypatch) == 2
    said = "belongs to another state of paper_1dof: paper_1dof.toml; restore that, give the --set"
    assert_one_line(capsys.readouterr().err, said)
    assert main([*words, "--set", "cylinder.lift.bore_mm=-1"], monkeypatch) == 2
    assert_one_line(capsys.readouterr().err, "--set cylinder.lift.bore_mm: -1.0 is not allowed")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("points = 3", "names no machine"),
        ('machine = "paper_1dof"\nmashine = 1', 'did you mean "machine"?'),
        ('machine = "paper_1dof"\ntask = "os.remove"', '"os.remove" is none'),
        ('machine = "paper_1dof"\ncsv = "c.csv"\n[grid]', "has grid and csv"),
        ('machine = "paper_1dof"\ncsv = "c.csv"', "cannot be read"),
        ('machine = "paper_1dof"\npoints = true', "give a whole number or a list"),
        ('machine = "paper_1dof"\n[sobol]\ncount = 0', "sobol.count: 0 is not allowed"),
        ('machine = "paper_1dof"\n[sobol]\ncount = 4', "sobol.ranges: is missing"),
        ('machine = "paper_1dof"\ncase = [3]', "is no case"),
        ("machine = [", "study.toml"),
        (f'{TWICE}[grid]\na.b = [1]\n"a.b" = [2]', "study.toml: grid.a.b: is there twice; leave"),
        (f'{TWICE}[[case]]\na.b = 1\n"a.b" = 2', "study.toml: case.a.b: is there twice; leave"),
        (
            f'{TWICE}[sobol]\ncount = 2\n[sobol.ranges]\na.b = [1, 2]\n"a.b" = [1, 2]',
            "study.toml: sobol.ranges.a.b: is there twice; leave",
        ),
    ],
)
def test_a_wrong_study_is_one_line(
    text: str,
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = ["sweep", written(tmp_path, text), "--out", str(tmp_path / "out")]
    assert main(words, monkeypatch) == 2
    assert_one_line(capsys.readouterr().err, message)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "workers"), [(signal.SIGINT, 1), (signal.SIGINT, 2), (signal.SIGHUP, 2)]
)
def test_ctrl_c_says_what_is_kept_and_how_to_go_on(
    number: int, workers: int, tmp_path: Path
) -> None:
    """A terminal sends its signals to all processes of the command."""
    moduli = ", ".join(str(900 + n) for n in range(400))
    study = written(tmp_path, STUDY.replace("900, 1000, 1200", moduli))
    run = subprocess.Popen(
        [*ARMDESIGN, "sweep", study, "--out", str(tmp_path / "out"), "--workers", str(workers)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        process_group=0,
    )
    log = tmp_path / "out" / "sweep.sqlite-wal"  # grows by two pages or more with every case
    while not log.exists() or log.stat().st_size < LOGGED:
        time.sleep(0.05)
    os.killpg(run.pid, number)
    _, words = run.communicate(timeout=60)
    assert run.returncode == 128 + number
    kept = r"what was finished is kept in \S+sweep\.sqlite; go on with: armdesign sweep .*\n"
    assert re.fullmatch(r"armdesign: interrupted at case \d+ of 1200; " + kept, words)


def test_an_interruption_counts_all_cases_and_drops_new_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """In a folder named almost so; nothing is kept where nothing was finished."""
    from armdesign.sweeps import tasks

    real, ends = tasks.TASKS["map"], iter([0, 3, 3, 3])
    left = next(ends)

    def interrupted(*words: Any) -> Any:
        nonlocal left
        left -= 1
        if left < 0:
            left = next(ends)
            raise KeyboardInterrupt
        return real(*words)

    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(tasks.TASKS, "map", interrupted)
    text = STUDY.replace("[200, 190, -5]", "[200, 190, 195]")
    words = ["sweep", written(tmp_path, text), "--out", "o --newer", "--workers", "1", "--new"]
    assert main(words, monkeypatch) == 130
    assert capsys.readouterr().err == (
        "armdesign: interrupted at case 1 of 9; nothing was written\n"
    )
    assert not Path("o --newer").exists()
    for number in (4, 7):
        assert main(words, monkeypatch) == 130
        said = capsys.readouterr().err.strip()
        assert said.startswith(f"armdesign: interrupted at case {number} of 9; what was finished")
        words = shlex.split(said.split("go on with: armdesign ")[-1])
        assert words == ["sweep", str(tmp_path / "study.toml"), *words[2:]]
        assert words[2:] == ["--out", "o --newer", "--workers", "1"]


def test_an_interruption_before_another_journal_has_begun_keeps_new(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from armdesign.sweeps import study_file

    def interrupted(*_: Any) -> Any:
        raise KeyboardInterrupt

    monkeypatch.chdir(tmp_path)
    words = ["sweep", written(tmp_path, STUDY), "--out", "o", "--workers", "1"]
    assert main(words, monkeypatch) == 0
    capsys.readouterr()
    monkeypatch.setattr(study_file, "read_study", interrupted)
    for new in ([], ["--new"]):
        assert main([*words, *new], monkeypatch) == 130
        said = capsys.readouterr().err.strip()
        assert shlex.split(said.split("go on with: armdesign ")[-1]) == [*words, *new]


def test_the_name_of_a_journal_that_is_set_aside_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """After an interruption without a case, too, which leaves no other journal."""
    from armdesign.sweeps import tasks

    def interrupted(*_: Any) -> Any:
        raise KeyboardInterrupt

    text, out = f"{STUDY.partition('[')[0]}\n", tmp_path / "out"
    words = ["sweep", written(tmp_path, text), "--out", str(out), "--workers", "1"]
    assert main(words, monkeypatch) == 0
    assert "earlier" not in capsys.readouterr().err
    said = "armdesign: the earlier journal is kept as {}\n"
    assert main([*words, "--new"], monkeypatch) == 0
    assert said.format(out / "sweep.1.sqlite") in capsys.readouterr().err
    monkeypatch.setitem(tasks.TASKS, "map", interrupted)
    assert main([*words, "--new"], monkeypatch) == 130
    assert said.format(out / "sweep.2.sqlite") in capsys.readouterr().err
    assert not (out / "sweep.sqlite").exists()


def test_a_folder_whose_name_begins_with_a_tilde(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The shell did not take it for the home; nor does pandas."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    words = ["sweep", written(tmp_path), "--out", "~/x", "--workers", "1"]
    assert main(words, monkeypatch) == 0
    assert len(read(tmp_path / "~" / "x")) == 9
    ad.export(ad.load("paper_1dof"), "~/pins.csv")
    assert (tmp_path / "~" / "pins.csv").is_file()


KILLED = """
import os, sys, time
from pathlib import Path
import numpy as np
import armdesign as ad
machine, rng = ad.load("paper_1dof"), np.random.default_rng(0)
changes = {"fluid.bulk_modulus_MPa": [900.0 + n for n in range(30)]}
ad.sweep(machine, points=3)  # loads what the children then have
for _ in range(50):
    out, into = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(out)
        try:
            ad.sweep(machine, changes, points=3, journal=Path(sys.argv[1]),
                     say=lambda _: os.write(into, b"."))
        finally:
            os._exit(0)
    os.close(into)
    if rng.random() < 0.5:
        os.read(out, 1)  # a case is finished, or all are
    time.sleep(rng.uniform(0.0, 0.1))
    os.kill(child, 9)
    os.waitpid(child, 0)
    os.close(out)
"""


@pytest.mark.slow
def test_fifty_kills_at_random_moments_lose_and_double_nothing(tmp_path: Path) -> None:
    """Half of the runs are killed after a case, the others at once, all with a random delay."""
    import armdesign as ad

    journal = tmp_path / "j.sqlite"
    words = [sys.executable, "-c", KILLED, str(journal)]
    subprocess.run(words, check=True, timeout=120)
    changes = {"fluid.bulk_modulus_MPa": [900.0 + n for n in range(30)]}
    resumed = ad.sweep("paper_1dof", changes, points=3, journal=journal)
    undisturbed = ad.sweep("paper_1dof", changes, points=3)
    assert resumed.kept >= 15
    one, other = (each.frame.drop(columns="seconds") for each in (resumed, undisturbed))
    pd.testing.assert_frame_equal(one, other, check_exact=True)


def test_words_of_a_study_are_no_formulas(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "cases.csv").write_text("title\n=cmd|' /C calc'!A0\n@SUM(1)\n")
    study = written(tmp_path, 'machine = "paper_1dof"\npoints = 3\ncsv = "cases.csv"\n')
    words = ["sweep", study, "--out", str(tmp_path / "out"), "--workers", "1"]
    main(words, monkeypatch)
    lines = (tmp_path / "out" / "sweep.csv").read_text().splitlines()
    assert "'=cmd|' /C calc'!A0," in lines[1]
    assert "'@SUM(1)," in lines[2]


@pytest.mark.slow
@pytest.mark.parametrize("closed", [">&-", "2>&-", ">&- 2>&- <&-"])
def test_several_workers_need_no_open_streams(tmp_path: Path, closed: str) -> None:
    words = f"sweep {written(tmp_path)} --out {tmp_path / 'out'} --workers 2 {closed}"
    done = subprocess.run([*["sh", "-c"], f"exec {' '.join(ARMDESIGN)} {words}"], check=False)
    assert done.returncode == 0
    assert len(read(tmp_path / "out")) == 9
