"""The sheet of a sweep, as the terminal shows it."""

from __future__ import annotations

from typing import Any

import pandas as pd

from armdesign.report.sheet import Sheet
from armdesign.report.sweeps import sweep_sheet


def sheet(**columns: list[Any]) -> Sheet:
    count = len(columns["error"])
    return sweep_sheet(pd.DataFrame({"machine": ["arm"] * count, **columns}), kept=0)


def test_a_sheet_has_what_differs_in_its_rows_and_the_rest_below() -> None:
    """A pin that one case moves, and all that one answer has, tell the cases apart."""
    one = sheet(pin=[[0, 0, 1], None], hz=[None, 2.0], cylinder=[None, "lift"], error=["bad", ""])
    assert one.columns == ("case", "pin", "hz", "cylinder")
    assert one.rows == (("1", "[0, 0, 1]", "–", "–"), ("2", "–", "2", "lift"))
    assert one.note == (
        "The same in all that did not fail: machine arm."
        " 1 case failed; sweep.csv says why. The first: bad"
    )
    both = sheet(**{"a.bore_mm": [8, 9, 9], "hz": [1.0, 1.0, None], "error": ["", "", "bad"]})
    assert both.columns == ("case", "bore_mm")
    assert "did not fail: machine arm, hz 1." in both.note
    none = sheet(mm=[8, 9], error=["bad", "worse"])
    assert none.note == "2 cases failed; sweep.csv says why. The first: bad"
    same = sheet(hz=[1.0, 1.0], none=["", None], error=["", ""])
    assert (same.rows, same.note) == ((("1",), ("2",)), "The same in all: machine arm, hz 1.")
