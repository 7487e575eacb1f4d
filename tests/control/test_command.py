"""The command ``armdesign control``."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

import armdesign as ad
from tests.commands import Refused, main


@pytest.mark.slow
def test_it_writes_bandwidths_gains_and_picture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["control", "patu_boom", "--points", "5", "--out", str(tmp_path)]
    assert main(words, monkeypatch) == 0
    assert {path.name for path in tmp_path.iterdir()} == {
        "bandwidth.csv",
        "gains.csv",
        "bandwidth.png",
        "report.html",
        "report.json",
    }
    table = pd.read_csv(tmp_path / "gains.csv")
    columns = {"lift_boom", "payload", "f1_hz", "damping", "critical_gain_per_s", "closed_damping"}
    assert columns < set(table.columns) | {"lift_boom", table.columns[0]}
    assert set(table["filter"]) == {"high-pass"}
    assert (table.filter(like="_gain_per_s") > 0).all().all()
    printed = capsys.readouterr().out
    for words_of_table in ("position loops alone", "with feed-forward", "Merritt", "f/3"):
        assert words_of_table in printed


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"cylinder.lift.bore_mm": 110.0}, "both machines at the same poses"),
        ({"cylinder.lift.closed_length_mm": 850.0}, "each machine over its own joint ranges"),
    ],
)
def test_a_new_machine_of_the_same_name_is_compared_at_the_same_poses(
    change: dict[str, float],
    words: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """If it can take them; both are told apart by their files."""
    file = str(ad.load("patu_boom").replace(change).save(tmp_path / "patu_new.toml"))
    given = ["control", "patu_boom", "--new", file, "--points", "3", "--out", str(tmp_path / "o")]
    assert main(given, monkeypatch) == 0
    tables = [pd.read_csv(tmp_path / "o" / f"gains_{label}.csv") for label in ("today", "new")]
    same = tables[0]["boom"].equals(tables[1]["boom"])
    assert same == words.startswith("both")
    printed = capsys.readouterr().out
    assert words in printed
    assert "loop: today patu_boom.toml, new patu_new.toml [Hz]" in printed
    assert "Each at its worst pose, position loops alone of today's and of the new" in printed


@pytest.mark.slow
def test_two_machines_stand_side_by_side(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["control", "patu_boom", "--new", "patu_boom", "--points", "3"]
    assert main([*words, "--out", str(tmp_path)], monkeypatch) == 0
    assert (tmp_path / "gains_new.csv").read_text() == (tmp_path / "gains_today.csv").read_text()
    assert "new: position loops alone" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["paper_1dof"], "no bandwidth can rest on that; state it, as --damping 0.02"),
        (["patu_boom", "--damping", "3"], "3 is not in"),
        (
            ["patu_boom", "--gain-margin", "0"],
            "armdesign: --gain-margin: 0 dB is not allowed; give more than 0 dB",
        ),
        (["patu_boom", "--gain-margin", "1e5"], "no gains keep 100000 dB"),
        (["patu_boom", "--gain-margin", "120"], "ask for at most"),
        (["patu_boom", "--phase-margin", "89.999"], "ask for at most"),
        (
            ["patu_boom", "--phase-margin", "2578"],
            "--phase-margin: 2578 deg is not between 0 and 90 deg; give one as 45 deg, in Python",
        ),
        (["patu_boom", "--filter", "low"], "give high-pass or band-pass"),
        (
            ["patu_boom", "--corner", "0"],
            "corner: 0 Hz (0 rad/s) is not allowed; give one above 0",
        ),
        (["patu_boom", "--corner", "-2"], "corner: -2 Hz (-12.5664 rad/s) is not allowed"),
        (
            ["patu_boom", "--delay", "-3"],
            "-3 ms is not a time of 0 ms or more; give one as --delay",
        ),
        (["patu_boom", "--delay", "60000"], "delay: 60000 ms are 409 periods of the lowest mode"),
        (["nowhere"], "no such machine"),
    ],
)
def test_bad_input_is_one_line(words: list[str], message: str, refused: Refused) -> None:
    refused(["control", *words], message)
