"""``armdesign move``: what it writes and says, and what it refuses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import armdesign as ad
from armdesign.option_values import payload_of, pose_of
from tests import machines
from tests.commands import Refused, main

FILES = {"move.csv", "move.png", "residual.csv", "shaper.csv", "shaper.png"}
MOVE = ["move", "paper_1dof", "--from", "-20", "--to", "boom=10"]


@pytest.mark.parametrize("shaper", ["ei", "none"])
def test_a_move_is_written_and_said(
    shaper: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = [*MOVE, "--out", str(tmp_path), "--shaper", shaper, "--spread", "0"]
    assert main(words, monkeypatch) == 0
    printed = capsys.readouterr().out
    assert {path.name for path in tmp_path.iterdir()} == FILES
    plan, runs = (pd.read_csv(tmp_path / f"{name}.csv") for name in ("move", "residual"))
    assert plan["boom_deg"].iloc[[0, -1]].to_list() == pytest.approx([-20, 10])
    assert list(runs["shaper"]) == ["none", shaper]
    impulses = pd.read_csv(tmp_path / "shaper.csv")["amplitude"]
    assert len(impulses) == {"ei": 3, "none": 1}[shaper]
    assert impulses.sum() == pytest.approx(1)
    assert f"{runs['residual_mm'].iloc[1]:.2f}" in printed
    assert ("without a shaper" in printed) == (shaper == "none")
    assert (" 100 % " in printed) == (shaper == "none")
    assert "1e+02" not in printed
    assert "zvd" in printed, "the usual ones beside it"


@pytest.mark.slow
def test_stops_one_after_the_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    words = [*MOVE, "--to", "-5", "--out", str(tmp_path), "--spread", "0", "--shaper", "zv"]
    assert main(words, monkeypatch) == 0
    angle = pd.read_csv(tmp_path / "move.csv")["boom_deg"]
    assert angle.max() == pytest.approx(10, abs=0.01)
    assert angle.iloc[-1] == pytest.approx(-5)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--to", "bom=3"], '--to: there is no joint "bom" in the pose; did you mean "boom"?'),
        (["--to", "boom=x"], '--to: "x" is no position of boom; give boom=… deg'),
        (["--to", "1,2"], '--to: "1,2" is not one position per joint; give boom=… deg'),
        (
            ["--to", "boom=80"],
            "--to: boom 80 deg is outside its range [-49.7, 39] deg; the nearest",
        ),
        (["--to", "boom=5", "--duration", "0.1"], "0.1 s is faster than 0.7 of the pump's"),
        (
            ["--to", "boom=5", "--duration", "nan"],
            "duration: nan is not in (0, inf) s; give a time",
        ),
        (["--to", "boom=5", "--duration", "-1"], "duration: -1 is not in (0, inf) s; give a time"),
        (
            ["--to", "boom=5", "--duration", "1e6"],
            "1e+06 s is more than 30 times the shortest, 0.377 s; give 60 s or less: so slow",
        ),
        (["--to", "boom=5", "--duration", "inf"], "inf s is more than 30 times the shortest"),
        (
            ["--to", "boom=5", "--shaper", "x"],
            "shaper x: there is no such kind; choose from: none",
        ),
        (["--to", "boom=-20"], "no piston moves between the poses; give two poses that differ"),
    ],
)
def test_refusals(refused: Refused, words: list[str], message: str) -> None:
    refused(["move", "paper_1dof", "--from", "boom=-20", *words], message)


def test_the_nearest_position_that_is_named_is_within_the_stroke(refused: Refused) -> None:
    machine = ad.load("excavator_20t")
    with pytest.raises(ad.ArmDesignError) as caught:
        pose_of(machine, "boom=85", "--to", (0.0, -1.5, -1.5))
    nearest = caught.value.remedy.split()[-2]
    pose = pose_of(machine, f"boom={nearest}", "--to", (0.0, -1.5, -1.5))
    assert len(machine.at(pose)) == 1
    assert pose[0] == pytest.approx(machine.ranges[0, 1], abs=np.radians(0.1))


def test_positions_by_name_or_in_order() -> None:
    """Slides in mm; joints that are not named stay where they were."""
    machine = machines.named("loader_crane")
    expected = (np.radians(10), np.radians(-60), 0.02)
    assert pose_of(machine, "10, -60, 20", "--from") == pytest.approx(expected)
    by_name = pose_of(machine, "extension=20,lift_boom=10,tilt_boom=-60", "--from")
    assert by_name == pytest.approx(expected)
    later = pose_of(machine, "tilt_boom = -30", "--to", by_name)
    assert later == pytest.approx((expected[0], np.radians(-30), 0.02))
    with pytest.raises(ad.ArmDesignError, match="--from: says nothing of tilt_boom and extension"):
        pose_of(machine, "lift_boom=10", "--from")
    assert (payload_of(""), payload_of("full"), payload_of("80")) == (None, "full", 80.0)


@pytest.mark.parametrize("end", ["30,-90,-30", "60,-40,-10", "-10,-60,20"])
def test_the_nearest_pose_that_holds_the_load_is_named(end: str) -> None:
    """It can be taken as it stands, holds the load, and a tenth of a degree less does not."""
    machine = ad.load("excavator_20t").with_payload("full")
    start, spilling = (pose_of(machine, words, "--to") for words in ("30,-90,-90", end))
    with pytest.raises(ad.ArmDesignError, match="the nearest that does is boom=") as caught:
        ad.plan_move(machine, start, spilling)
    nearest = np.array(pose_of(machine, caught.value.remedy.split()[-2], "--to"))
    away = nearest - spilling
    assert machine.holds(nearest[None])[0]
    assert np.count_nonzero(np.abs(away) > 1e-9) < 3
    less = nearest - np.radians(0.1) * np.sign(np.where(np.abs(away) > 1e-9, away, 0.0))
    assert not machine.holds(less[None])[0]


def test_a_joint_without_ends_is_given_the_short_way() -> None:
    """From 170° to 200°, not back to −160°; a turn beyond its range is enough for any."""
    machine = machines.named("slewing")
    level = "boom=0,stick=-90,bucket=-90"
    start = pose_of(machine, f"swing=170,{level}", "--from")
    assert pose_of(machine, "swing=200", "--to", start)[0] == pytest.approx(np.radians(200))
    with pytest.raises(ad.ArmDesignError, match=r"swing 545 deg is outside its range \[-5"):
        pose_of(machine, "swing=545", "--to", start)
