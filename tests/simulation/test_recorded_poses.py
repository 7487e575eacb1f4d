"""Poses of recordings: told by lengths or angles; what tells none is said, and fitted all the
same.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import armdesign as ad
from tests.simulation.test_identify import ring

CRANE = ad.load("loader_crane")
TOLD = {"lift_length_mm": 1000.0, "tilt_boom_deg": -40.0, "extension_mm": 100.0}


def identified(**columns: float) -> Any:
    """A ring of 2 Hz with constant columns, whose windows are 0 to 2 s and 2 to 4 s."""
    time, pressure = ring()
    recording_columns = {name: np.full(len(time), value) for name, value in columns.items()}
    recording = {"time_s": time, "lift_cap_bar": pressure, **recording_columns}
    identification = ad.identify(recording, [(0, 2), (2, 4)], machine=CRANE)
    assert identification.frame["frequency_hz"].to_numpy() == pytest.approx([2.0, 2.0], rel=1e-3)
    return identification


def test_a_pose_that_is_told() -> None:
    windows = identified(**TOLD)
    assert windows.findings == []
    assert windows.windows[0].pose[1:] == pytest.approx([np.radians(-40), 0.1])


@pytest.mark.parametrize(
    ("change", "pose", "message"),
    [
        (
            {"tilt_boom_deg": None},
            False,
            "no column tells where joint tilt_boom stands: the pose is left out; give"
            " tilt_boom_deg or tilt_length_mm (2 of 2 windows)",
        ),
        (
            {"lift_length_mm": 700.0},
            False,
            "lift_length_mm: 700 mm is outside the stroke [820, 1355] mm; give the pin-to-pin"
            " length, or correct closed length and stroke; the pose is left out (2 of 2 windows)",
        ),
        (
            {"tilt_boom_deg": np.nan},
            False,
            "no column tells where joint tilt_boom stands: the pose is left out",
        ),
        (
            {"extension_mm": None},
            True,
            "no column tells where joint extension stands: taken as 0 mm; give extension_mm or",
        ),
        (
            {"tilt_boom_deg": 10.0},
            True,
            "tilt_boom_deg: 10 deg is outside the joint's range [-150.576, -1.504",
        ),
    ],
)
def test_a_pose_that_is_not_told_is_left_out_or_said(
    change: dict[str, float | None], pose: bool, message: str
) -> None:
    given = {name: value for name, value in {**TOLD, **change}.items() if value is not None}
    windows = identified(**given)
    assert sum(line.startswith(message) for line in windows.findings) == 1
    assert all((window.pose is not None) is pose for window in windows.windows)
