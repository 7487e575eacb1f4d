"""From a recording to a calibrated file: what ``identify`` writes, ``calibrate`` reads."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import armdesign as ad
from armdesign.machine.changes import changed_machine
from tests.calibration.synthetic import BETA, crane, lifter, measurements, poses
from tests.commands import main

TRUTH, LASTS, STEP = 1050.0, 5.0, 0.01  # MPa, s, s


@pytest.mark.slow
def test_columns_of_a_recording_calibrate_a_machine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rings of a known machine at four poses, one after the other; its bulk modulus is found."""
    machine, q = crane(), poses(4)
    true = machine.replace({BETA: TRUTH}).at(q)
    frequencies = ad.natural_modes(true).frequencies[:, 0]
    time = np.arange(0, LASTS, STEP)
    parts = [
        pd.DataFrame(
            {
                "time_s": time + n * LASTS,
                "lift_cap_bar": 80 + np.exp(-0.1 * f * time) * np.cos(2 * math.pi * f * time),
                "lift_pin_to_pin_mm": 1e3 * true.lengths[n, 0],
                "tilt_boom_deg": math.degrees(q[n, 1]),
                "extension_mm": 1e3 * q[n, 2],
            }
        )
        for n, f in enumerate(frequencies)
    ]
    pd.concat(parts).to_csv(tmp_path / "recording.csv", index=False)
    machine.save(tmp_path / "crane.toml")
    monkeypatch.chdir(tmp_path)
    windows = ",".join(f"{n * LASTS:g}:{(n + 1) * LASTS - STEP:g}" for n in range(len(q)))
    words = ["identify", "recording.csv", "--windows", windows, "--machine", "crane.toml"]
    assert main(words, monkeypatch) == 0
    table = "out/identify_recording/identified.csv"
    words = ["calibrate", "crane.toml", table, "--fit", BETA, "--out", "calibrated"]
    assert main(words, monkeypatch) == 0
    values = pd.read_csv("calibrated/calibration_values.csv", index_col="path")
    assert values.loc[BETA, "value"] == pytest.approx(TRUTH, rel=1e-3)
    assert values.loc[BETA, "determined"]


def test_numbers_of_a_list_are_found_and_written(tmp_path: Path) -> None:
    """Where the load sits, beside the bulk modulus; the third number of the list stays."""
    at = [f"payload.full.at_mm.{index}" for index in (0, 2)]
    truth = crane().replace({"payload.full.at_mm": [2300, 0, 300], BETA: 1050.0})
    found = ad.calibrate(crane(), measurements(truth, poses()), [*at, BETA])
    assert found.values.loc[at, "value"].to_numpy() == pytest.approx([2300, 300], abs=0.1)
    text = found.save(tmp_path / "crane.toml").read_text(encoding="utf-8")
    assert re.search(r"at_mm = .*was.*number 0 fitted ± .*, number 2 fitted ± ", text)
    assert ad.load(tmp_path / "crane.toml").with_payload("full").payload.at == pytest.approx(
        [2.3, 0.0, 0.3], abs=1e-4
    )


def test_the_modes_of_a_window_are_told_apart(tmp_path: Path) -> None:
    """A pressure that rings with both modes of a known machine; its bulk modulus is found."""
    machine, q = lifter(), np.array([0.2, -1.4])
    time, first = np.arange(0, 3, 0.002), ad.natural_modes(machine.replace({BETA: TRUTH}).at(q))
    rings = [np.exp(-0.5 * time) * np.cos(2 * math.pi * f * time) for f in first.frequencies[0]]
    columns = dict(zip(("boom_deg", "stick_deg"), np.degrees(q), strict=True))
    recording = pd.DataFrame({"time_s": time, "boom_cap_bar": 80 + sum(rings), **columns})
    identified = ad.identify(recording, [(0, 2.9)], modes=2)
    assert identified.frame["mode"].to_list() == [1, 2]
    identified.frame.to_csv(tmp_path / "identified.csv", index=False)
    found = ad.calibrate(machine, tmp_path / "identified.csv", [BETA])
    assert found.values.loc[BETA, "value"] == pytest.approx(TRUTH, rel=2e-3)


@pytest.mark.parametrize(
    ("fit", "truth"),
    [
        (("links.boom.mass_kg",), (420.0,)),
        (("links.boom.length_mm", BETA), (2950.0, 1150.0)),
        (("links.stick.mass_kg", "cylinder.boom.rod_end.at_mm.0"), (200.0, 1352.0)),
    ],
)
def test_numbers_of_links_are_found(fit: tuple[str, ...], truth: tuple[float, ...]) -> None:
    """Frequencies of the calibrated machine are those measured, and those that are shown."""
    machine = lifter()
    true = changed_machine(machine, dict(zip(fit, truth, strict=True)))
    low, high = machine.ranges.T
    shares = np.random.default_rng(0).uniform(0.2, 0.8, (8, 2))
    rows = []
    for n, q in enumerate(low + shares * (high - low)):
        frequencies = ad.natural_modes(true.at(q)).frequencies[0]
        named = {f"{j}_deg": math.degrees(x) for j, x in zip(machine.joints, q, strict=True)}
        mode = n % 2
        known = {"mode": mode + 1, "frequency_hz": frequencies[mode], "deviation_hz": 1e-3}
        rows.append({"payload": machine.payload.name, **named, **known})
    found = ad.calibrate(machine, pd.DataFrame(rows), list(fit))
    assert found.values.loc[list(fit), "value"].to_numpy() == pytest.approx(truth, rel=1e-4)
    assert found.frame["calibrated_hz"].to_numpy() == pytest.approx(
        [row["frequency_hz"] for row in rows], rel=1e-4
    )


def test_a_coordinate_is_known_to_so_many_millimetres() -> None:
    """The load's height of 65 mm, which frequencies with large deviations do not tell."""
    height = "payload.full.at_mm.2"
    table = measurements(crane(), poses())
    table["deviation_hz"] *= 5000
    found = ad.calibrate(crane(), table, [height, BETA])
    (words,) = (words for words in found.findings if height in words and "held" in words)
    assert re.search(r"\(known to ± \d+ mm at best\): held at 65 mm", words), words


@pytest.mark.parametrize("missing", [None, np.nan, pd.NA])
def test_what_a_table_lacks_is_blank(missing: object) -> None:
    """As in a file: the load case at work, both chambers, 1 % of the frequency."""
    truth = crane().replace({BETA: TRUTH})
    table = measurements(truth, poses(), lift_chambers="both")
    blank = table[table["payload"] == "full"].astype(object)
    blank[["payload", "lift_chambers", "deviation_hz"]] = missing
    filled = blank.assign(payload="full", lift_chambers="both", deviation_hz="")
    full = crane().with_payload("full")
    values = [ad.calibrate(full, one, [BETA]).values for one in (blank, filled)]
    pd.testing.assert_frame_equal(*values)
