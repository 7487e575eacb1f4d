"""Lift charts of two machines side by side: columns, rows, what is said where one has none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import armdesign as ad
from armdesign.report.lift_charts import lift_charts, lift_columns, lift_sheet
from tests.machines import BOOM, LIFT, STICK, build, named


@pytest.mark.parametrize("name", ["excavator_20t", "patu_boom"])
def test_a_wider_bore_point_by_point(name: str) -> None:
    """Rows and ratios agree with both charts; the strokes, and so the joint ranges, differ."""
    today = named(name)
    (path, stroke), bore = (
        (f"cylinder.{today.cylinders[0].name}", today.cylinders[0].stroke),
        today.cylinders[0].bore,
    )
    new = today.replace({f"{path}.bore_mm": 1050 * bore, f"{path}.stroke_mm": 1000 * stroke - 0.5})
    charts = lift_charts({"today": today, "new": new})
    frame = pd.DataFrame(lift_columns(charts))
    assert list(frame) == [
        *("reach_m", "height_m", "today_kg", "new_kg", "ratio"),
        *("today_limiting", "new_limiting"),
    ]
    assert len(frame) == len(charts["today"].reach)
    assert frame["new_kg"].notna().sum() == len(charts["new"].reach) >= len(frame) - 1
    both = frame.dropna()
    np.testing.assert_allclose(both["ratio"], both["new_kg"] / both["today_kg"])
    assert both["ratio"].max() > 1.05  # 1.05² less the arm's own weight, which stays
    assert (frame["height_m"].diff().dropna() <= 0).all()
    sheet = lift_sheet(charts)
    assert len(sheet.rows) == len(frame)


def test_one_chart_is_a_grid() -> None:
    """Whole kilograms of the chart stand in the cells, with the limiting actuator where
    it is not the usual one.
    """
    chart = ad.lift_chart(named("excavator_20t"))
    sheet = lift_sheet({"": chart})
    assert sheet.columns == ("[m]", "3", "4.5", "6", "7.5")
    assert sum(cell != "" for row in sheet.rows for cell in row[1:]) == len(chart.reach)
    assert "(ISO 10567); with bucket at -49.7°; limited by" in sheet.note
    row = next(row for row in sheet.rows if row[0] == "0")
    places = list(zip(chart.reach, chart.height, strict=True))
    assert row[1] == f"{chart.capacity[places.index((3.0, 0.0))]:.0f} stick"
    assert row[2] == f"{chart.capacity[places.index((4.5, 0.0))]:.0f}"


def test_no_chart_is_said() -> None:
    """Joints about vertical axes raise nothing."""
    axis = {"axis": (0.0, 0.0, 1.0)}
    flat = build(
        [replace(BOOM, **axis), replace(STICK, rpy=(0, 0, 0), **axis)],
        [
            replace(LIFT, base=("root", (0.7, -0.9, 0.5)), rod_end=("boom", (1.1, 0, 0))),
            replace(
                LIFT, name="turn", base=("boom", (1.6, -0.8, 0)), rod_end=("stick", (0.5, 0, 0))
            ),
        ],
    )
    with pytest.raises(ad.ArmDesignError, match="lift_chart: no joint raises the point on the st"):
        ad.lift_chart(flat)
    assert lift_charts({"": flat}) == {}
    assert lift_sheet({}).note.startswith("none")
