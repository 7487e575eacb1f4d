"""`armdesign compare`: two machines, or two versions of one, side by side."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

import armdesign as ad
from armdesign.report.comparison import compare
from armdesign.report.maps import between_poses, map_sheets
from armdesign.report.scene import scene_of
from armdesign.units import SI, WORKSHOP
from tests import machines
from tests.commands import Refused, main
from tests.report.test_packed import read

EXCAVATOR = machines.named("excavator_20t")
CHANGES = {"cylinder.boom.bore_mm": 126, "cylinder.boom.closed_length_mm": 1825}


@pytest.mark.slow
def test_two_versions_in_one_workspace() -> None:
    """Areas alone change: the poses stay, so the second map shows the new machine on today's
    poses.
    """
    comparison = compare(EXCAVATOR, EXCAVATOR.replace(CHANGES), 5)
    assert comparison.same_workspace
    assert list(comparison.differences.items()) == [("cylinder.boom.bore_mm", (120, 126))]
    one, other = comparison.maps.values()
    assert one.workspace is other.workspace
    frame = comparison.frame.set_index("quantity")
    columns = list(comparison.maps)
    assert list(frame.columns) == ["unit", *columns, "change"]
    values = frame.loc["full.worst", columns]
    assert list(values) == pytest.approx([m.worst_of["full"].frequency for m in (one, other)])
    assert frame.loc["boom.thrust", "change"] == pytest.approx((126 / 120) ** 2 - 1)
    assert frame.loc["boom.oil_cap", columns[0]] == pytest.approx(
        2 * 3.14159265 / 4 * 0.12**2 * 1.26
    )


@pytest.mark.slow
def test_values_of_the_files_stay_in_the_files_units() -> None:
    """A key names its unit (bore_mm), so either habit prints the number that stands in the file,
    and says so.
    """
    comparison = compare(EXCAVATOR, EXCAVATOR.replace(CHANGES), 3)
    for units in (WORKSHOP, SI):
        sheet = next(
            sheet
            for sheet in comparison.sheets(units)
            if sheet.title == "Differences of the files"
        )
        assert sheet.rows == (("cylinder.boom.bore_mm", "120", "126"),)
        assert "in the unit that its key names" in sheet.note
    thrusts = [
        sheet
        for units in (WORKSHOP, SI)
        for sheet in comparison.sheets(units)
        if "thrust" in str(sheet.columns)
    ]
    assert ["[kN]" in str(sheet.columns) for sheet in thrusts] == [True, False]
    frame = comparison.frame.set_index("quantity")
    assert frame.loc["cylinder.boom.bore_mm", "unit"] == "file"


@pytest.mark.slow
def test_a_version_that_cannot_take_the_poses_has_its_own_workspace() -> None:
    comparison = compare(EXCAVATOR, EXCAVATOR.replace({"cylinder.stick.stroke_mm": 1300}), 4)
    assert not comparison.same_workspace
    assert comparison.sheets()[0].note == "each in its own workspace"
    names = list(comparison.maps)
    words = f"The cylinders of {names[1]} do not reach all poses of {names[0]}: "
    assert comparison.sentences == [f"{words}each is mapped in its own workspace."]


@pytest.mark.slow
def test_two_machines_with_other_joints_cylinders_and_load_cases() -> None:
    comparison = compare(machines.named("paper_1dof"), EXCAVATOR, 5)
    assert not comparison.same_workspace
    sheets = comparison.sheets(SI)
    words = str([sheet.rows for sheet in sheets])
    for name in ("lift", "boom", "load", "full"):
        assert name in words
    assert all(len(row) == len(sheet.columns) for sheet in sheets for row in sheet.rows)
    frame = comparison.frame.set_index("quantity")
    assert frame.loc["load.worst", "excavator_20t"] is None or pd.isna(
        frame.loc["load.worst", "excavator_20t"]
    )
    comparison.plot("reach")
    (said,) = comparison.sentences
    assert said.startswith(
        "The joints differ (paper_1dof: boom; excavator_20t: boom, stick, bucket): each is mapped"
    )
    assert "no overlay.png is drawn" in said


@pytest.mark.slow
def test_other_links_are_the_reason_for_other_workspaces() -> None:
    comparison = compare(EXCAVATOR, machines.named("excavator_12t"), 2)
    assert comparison.sentences == ["The links differ: each is mapped in its own workspace."]


def test_the_lowest_pose_is_told_beside_a_worst_one_between_poses() -> None:
    """The tested machine is softest off this grid, the shipped ones at a corner of it."""
    machine = machines.named("spatial")
    frequencies = ad.frequency_map(machine, ad.Workspace.grid(machine, 3))
    lowest = frequencies.frame["f1_hz"].min()
    assert frequencies.worst.frequency < 0.9 * lowest
    words = f"the worst is sought between the poses too; lowest of the poses: {lowest:.3f} Hz"
    assert between_poses({"": frequencies}) == words
    head, of_bands, spread, *_ = map_sheets(frequencies)
    assert head.rows[0] == ("worst frequency", f"{frequencies.worst.frequency:.3f} Hz")
    assert head.note.startswith(words)
    assert (of_bands.rows[0][0], of_bands.rows[0][2]) == (
        "lowest of the poses",
        f"{lowest:.3f} Hz",
    )
    assert f"{lowest:.3f}" in [row[spread.columns.index("lowest")] for row in spread.rows]
    (drawn,) = scene_of({"today": frequencies}).machines
    everywhere = read(drawn.cells)[:, 1] == 0
    assert f"{read(drawn.frequencies)[everywhere, 0].min():.3f}" == f"{lowest:.3f}"
    one = ad.load("paper_1dof")
    known = ad.frequency_map(one, ad.Workspace.grid(one, 3))
    assert between_poses({"": known}) == ""
    assert between_poses({"a": known, "b": frequencies}).endswith(f", b {lowest:.3f} Hz")


@pytest.mark.slow
def test_a_machine_and_itself() -> None:
    comparison = compare(EXCAVATOR, EXCAVATOR, 3)
    assert comparison.differences == {}
    assert list(comparison.maps) == ["excavator_20t A", "excavator_20t B"]
    assert (comparison.frame["change"].dropna() == 0).all()
    assert "The files do not differ" in [sheet.title for sheet in comparison.sheets()]


@pytest.mark.slow
@pytest.mark.parametrize("plane", ["joints", "reach"])
def test_one_colour_scale(plane: str) -> None:
    comparison = compare(EXCAVATOR, EXCAVATOR.replace(CHANGES), 5)
    axes = [ax for ax in comparison.plot(plane).axes if ax.get_xlabel()]
    scales = [c.get_clim() for ax in axes for c in ax.collections if c.get_array() is not None]
    assert len(scales) == 2
    assert scales[0] == scales[1]
    assert scales[0][0] <= min(m.frame["f1_hz"].min() for m in comparison.maps.values()) + 0.2


@pytest.mark.slow
def test_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    second = EXCAVATOR.replace({"cylinder.boom.bore_mm": 126}).save(tmp_path / "wider.toml")
    assert (
        main(
            ["compare", "excavator_20t", str(second), "--out", "out", "--points", "4"], monkeypatch
        )
        == 0
    )
    assert {p.name for p in (tmp_path / "out").iterdir()} == {
        "compare.csv",
        "compare_joints.png",
        "overlay.png",
        "compare_reach.png",
        "lift_chart.csv",
        "lift_chart.png",
    }
    printed = capfd.readouterr().out
    assert "cylinder.boom.bore_mm" in printed
    assert "wider" in printed
    rules = [line for line in printed.splitlines() if set(line.strip()) == {"─"}]
    assert max(map(len, rules)) <= 100  # widths of tables; sentences are not wrapped in pipes
    assert set(ad.load(second).section.cylinder) == {"boom", "stick", "bucket"}


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["excavator_20t", "none.toml"], "none.toml: no such file"),
        (["none.toml", "excavator_20t"], "none.toml: no such file"),
        (["excavator_20t", "excavator_12t", "--points", "x"], "--points"),
        (["excavator_20t", "paper_1dof", "--points", "3,3,3"], "points: [3, 3, 3] is not allowed"),
        (["excavator_20t", "excavator_12t", "--out", "/proc/none"], "--out /proc/none"),
    ],
)
def test_bad_input(words: list[str], message: str, refused: Refused) -> None:
    refused(["compare", *words], message)
