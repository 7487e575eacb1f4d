"""Times of recordings: clocks that count from 1970, and stamps too coarse for the samples."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

import armdesign as ad
from armdesign.errors import SimulationError
from armdesign.report.recordings import identified_sheets
from armdesign.simulation.identification.recording import recording_of
from tests.commands import main
from tests.simulation.test_identify import ring

EPOCH = 1.7e9  # [s] in the year 2023


@pytest.mark.parametrize("time", [ring()[0].round(0), 0 * ring()[0], -ring()[0]])
def test_stamps_of_which_most_repeat_or_step_back_are_refused(time: np.ndarray) -> None:
    """Their median interval is no time in which a spectrum has lines."""
    message = "time steps back after" if time[1] < 0 else "the same time stamp twice, at 0 s"
    with pytest.raises(SimulationError, match=f"{message}.*; choose a window without it"):
        ad.identify({"time_s": time, "boom_cap_bar": ring()[1]})


@pytest.mark.parametrize("rate", [100, 128])
def test_windows_are_told_apart_whatever_the_clock_counts_from(rate: int) -> None:
    """Against the same ring from 0; what is told finds the same samples again."""
    time = np.arange(4 * rate) / rate
    pressure = np.interp(time, *ring())
    early = ad.identify({"time_s": time, "boom_cap_bar": pressure})
    late = ad.identify({"time_s": EPOCH + time, "boom_cap_bar": pressure})
    (first, *_), (told, *_) = (identified_sheets(one)[0].rows for one in (early, late))
    begin, end = (float(word) for word in told[0].split("–"))
    assert [begin - EPOCH, end - EPOCH] == pytest.approx(
        [float(word) for word in first[0].split("–")], abs=1e-6
    )
    assert told[1:] == first[1:]
    (again,) = ad.identify(late.recording, [(begin, end)]).windows
    assert np.array_equal(again.time, late.windows[0].time)


def test_files_hold_late_windows_as_they_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """CSV and JSON: nine digits would make begin and end the same."""
    time, pressure = ring()
    rows = (f"{EPOCH + t:.3f},{p:.4f}\n" for t, p in zip(time, pressure, strict=True))
    file, out = tmp_path / "epoch.csv", tmp_path / "out"
    file.write_text("time_s,boom_cap_bar\n" + "".join(rows))
    window = f"{EPOCH + 0.5:.1f}:{EPOCH + 3:.1f}"
    words = ["identify", str(file), "--windows", window, "--json", "--out", str(out)]
    assert main(words, monkeypatch) == 0
    tables = json.loads(capsys.readouterr().out)["tables"]
    for name in ("identified", "swings"):
        with (out / f"{name}.csv").open() as written:
            first, *_ = csv.DictReader(written)
        for cells in (first, tables[name][0]):
            assert [float(cells[end]) for end in ("begin_s", "end_s")] == [EPOCH + 0.5, EPOCH + 3]
    assert EPOCH + 0.5 < float(first["time_s"]) < EPOCH + 3


def test_faults_tell_when() -> None:
    """To the sample, of a clock that counts from 1970."""
    time = EPOCH + np.arange(0, 4, 0.01)
    values = np.where(np.arange(len(time)) == 123, np.nan, 1.0)
    with pytest.raises(SimulationError, match=r"boom_cap_bar is blank at 1700000001\.23 s"):
        recording_of({"time_s": time, "boom_cap_bar": values}).sampled("boom_cap_bar")
    with pytest.raises(SimulationError, match="1700000003:1700000001 is no window"):
        ad.identify({"time_s": time, "boom_cap_bar": values}, [(EPOCH + 3, EPOCH + 1)])
