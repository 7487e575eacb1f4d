"""The shipped crane beside its recording: what is read from it, and what the file makes of it."""

from __future__ import annotations

import numpy as np
import pandas as pd

import armdesign as ad
from armdesign.calibration.measured import read_measured
from armdesign.calibration.prediction import positions

CRANE = ad.load("loader_crane")
FOLDER = CRANE.source.parent
MEASURED = pd.read_csv(FOLDER / "measured.csv", comment="#")


def test_the_recording_holds_what_is_measured() -> None:
    """Every fourth sample of it gives the frequencies again within their deviations, and shows in
    every window that the rod side does not swing.
    """
    windows = list(zip(MEASURED["begin_s"], MEASURED["end_s"], strict=True))
    found = ad.identify(FOLDER / "recording.csv", windows, signal="lift_cap_bar")
    off = found.frame["frequency_hz"] - MEASURED["frequency_hz"]
    assert np.all(off.abs() <= MEASURED["deviation_hz"])
    lengths = found.frame["lift_length_mm"] - MEASURED["lift_length_mm"]
    assert lengths.abs().max() < 0.2
    words = "lift: the annulus pressure does not swing with the cap pressure"
    assert all(words in " ".join(window.words) for window in found.windows)


def test_the_file_is_within_two_per_cent_at_rest() -> None:
    """With valves shut, by the front door, at the six moving poses."""
    measured = read_measured(FOLDER / "measured.csv", CRANE)
    q = positions(CRANE, measured)[:6]
    frequencies = ad.natural_modes(CRANE.with_payload("full").at(q)).frequencies[:, 0]
    assert np.abs(frequencies / measured.frequencies[:6] - 1).max() < 0.02
