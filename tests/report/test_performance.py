"""The sheet of torques, stroke times and reach."""

from __future__ import annotations

from dataclasses import replace

import pytest

import armdesign as ad
from armdesign.report.performance import figures, performance_sheet
from armdesign.units import SI
from tests import machines

EXCAVATOR = machines.named("excavator_20t")


def test_a_wider_bore_has_its_ratio() -> None:
    """Torque and time extending grow with the bore's area, the reach not at all."""
    wider = EXCAVATOR.replace({"cylinder.boom.bore_mm": 126})
    sheet = performance_sheet({"today": EXCAVATOR, "new": wider})
    assert sheet.columns == ("part", "figure", "today", "new", "ratio")
    ratios = {(row[0], row[1]): row[-1] for row in sheet.rows}
    out, back = (126 / 120) ** 2, (126**2 - 85**2) / (120**2 - 85**2)
    assert ratios["boom", "largest torque [kN m]"] == f"{out:.3f}, {back:.3f}"
    assert ratios["", "stroke time [s]"] == "1.000, 1.000"  # of the last cylinder
    assert ratios["tool", "largest reach [mm]"] == "1.000"
    boom = [row[1:] for row in sheet.rows[:7]]
    assert boom[3] == ("stroke time [s]", "3.99, 1.99", "4.39, 2.39", f"{out:.3f}, {back:.3f}")


def test_the_note_says_where_outer_joints_stand() -> None:
    """They decide the boom's force at the tool, which other pins of the stick's change."""
    today = ad.load("excavator_20t")
    base = dict(zip("xyz", today.section.cylinder["stick"].base.at_mm, strict=True))
    moved = today.replace({"cylinder.stick.base.at_mm": [base["x"], base["y"], base["z"] + 60]})
    sheet = performance_sheet({"today": today, "moved": moved})
    rows = [row for row in sheet.rows if row[1].startswith("force at the tool")]
    assert [row[0] for row in sheet.rows if row[0]][:1] == ["boom"]
    assert float(rows[0][-1]) != 1.0
    assert "joints further out where their own cylinders dig best" in sheet.note


def test_figures_that_one_machine_has_not() -> None:
    crane = machines.named("patu_boom")
    sheet = performance_sheet({"a": EXCAVATOR, "b": crane}, SI)
    rows = {row[1]: row[2:] for row in sheet.rows[-5:]}
    assert rows["largest reach at height 0 [m]"] == ("9.7493", "–", "–")
    assert rows["largest reach [m]"][1] == "2.7850"
    assert all(len(row) == len(sheet.columns) for row in sheet.rows)


def test_keys_of_numbers_are_those_of_a_csv_file() -> None:
    keys = {f"{f.part}.{key}" for f in figures(EXCAVATOR) for key in f.keys}
    assert {
        "boom.torque_largest_extending",
        "bucket.stroke_time_retracting",
        "stick.tool_force",
        "tool.depth",
    } <= keys
    numbers = [value for f in figures(EXCAVATOR) for value in f.values or ()]
    assert len(keys) == len(numbers) == 3 * 13 + 5
    assert min(numbers) > 0


def test_heights_below_the_root_are_figures_too() -> None:
    """A boom 9 m lower has all heights 9 m lower, and its depth 9 m deeper."""
    low = replace(machines.BOOM, xyz=(0.1, 0, 0.5 - 9))
    deep = machines.build(
        [low, machines.STICK],
        [replace(machines.LIFT, base=("root", (0.7, 0, 0.1 - 9))), machines.FOLD],
    )
    usual = machines.build([machines.BOOM, machines.STICK], [machines.LIFT, machines.FOLD])
    one, other = ({f.keys[0]: f.values for f in figures(m)} for m in (usual, deep))
    for key, lower in (("reach", 0.0), ("height", -9.0), ("depth", 9.0)):
        before, after = one[key], other[key]
        assert before is not None
        assert after is not None
        assert after[0] == pytest.approx(before[0] + lower)
