"""From a recording to a calibrated file: what ``identify`` writes, ``calibrate`` reads."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import armdesign as ad
from tests.calibration.synthetic import BETA, crane, poses
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
