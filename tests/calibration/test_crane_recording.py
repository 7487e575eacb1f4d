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
    """Every fourth sample gives the frequencies again within their deviations, and shows while it
    moves that the rod side swings less than a tenth of what trapped oil would.
    """
    windows = list(zip(MEASURED["begin_s"], MEASURED["end_s"], strict=True))
    identified = ad.identify(FOLDER / "recording.csv", windows, signal="lift_cap_bar")
    off = identified.frame["frequency_hz"] - MEASURED["frequency_hz"]
    assert np.all(off.abs() <= MEASURED["deviation_hz"])
    lengths = identified.frame["lift_length_mm"] - MEASURED["lift_length_mm"]
    assert lengths.abs().max() < 0.2
    lift = CRANE.cylinders[0]
    for window, length in zip(identified.windows[:6], MEASURED["lift_length_mm"][:6], strict=True):
        cap, annulus = lift.volumes(length / 1e3 - lift.closed_length)
        trapped = (lift.bore_area / cap) / (lift.annulus_area / annulus)  # of swings, one modulus
        (measured,) = window.ratios
        assert measured.ratio > 10 * trapped


def test_the_file_is_within_two_per_cent_at_rest() -> None:
    """With valves shut, by the front door, at the six moving poses."""
    measured = read_measured(FOLDER / "measured.csv", CRANE)
    q = positions(CRANE, measured)[:6]
    frequencies = ad.natural_modes(CRANE.with_payload("full").at(q)).frequencies[:, 0]
    assert np.abs(frequencies / measured.frequencies[:6] - 1).max() < 0.02
