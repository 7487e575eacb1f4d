"""What if: against maps of the changed machine, and linear against exact."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import armdesign as ad
from armdesign.influence.what_if import PART, _estimate, _evenly
from armdesign.machine.changes import read_changes
from tests import machines
from tests.commands import assert_one_line, main
from tests.sprung import rocking

POINTS = 5


@pytest.fixture(scope="module")
def answer() -> ad.WhatIf:
    changes = {"cylinder.boom.bore_mm": 125, "payload.full.mass_kg": 2000}
    return ad.what_if(ad.load("excavator_20t"), changes, POINTS)


def row(answer: ad.WhatIf, quantity: str) -> pd.Series:
    return answer.frame.set_index("quantity").loc[quantity]


@pytest.mark.slow
def test_exact_is_the_map_of_the_changed_file(answer: ad.WhatIf) -> None:
    machine = ad.load("excavator_20t")
    changes = {"cylinder.boom.bore_mm": 125.0, "payload.full.mass_kg": 2000.0}
    other = machine.replace(changes)
    for one, kind in ((machine, "before"), (other, "after")):
        mapped = ad.frequency_map(one, ad.Workspace.grid(one, points=POINTS))
        assert row(answer, "worst")[kind] == mapped.worst.frequency
        largest = mapped.static_pressures.max(axis=0)
        pressures = [row(answer, f"{a.name}.static_pressure")[kind] for a in one.actuators]
        assert pressures == pytest.approx(largest)
    chart = ad.lift_chart(other, ad.lift_chart(machine))
    lift = answer.frame[answer.frame["quantity"].str.startswith("lift at")]
    assert lift["after"].to_list() == pytest.approx(chart.capacity)


@pytest.mark.slow
def test_areas_and_speeds_follow_the_bore(answer: ad.WhatIf) -> None:
    """By hand: thrust with the square of the bore, buckling safety and speed against it."""
    square = (125 / 120) ** 2 - 1
    assert row(answer, "boom.thrust")["change"] == pytest.approx(square)
    assert row(answer, "boom.thrust")["linear_change"] == pytest.approx(2 * 5 / 120)
    assert row(answer, "boom.tool_force")["change"] == pytest.approx(square)
    assert row(answer, "boom.buckling_safety")["change"] == pytest.approx(1 / (1 + square) - 1)
    speed = row(answer, "boom.joint_speed_largest_extending")["change"]
    assert speed == pytest.approx(1 / (1 + square) - 1)


@pytest.mark.slow
def test_linear_estimates_of_derivatives_and_of_differences_agree() -> None:
    """Of all load cases and of each: by multipliers, and by maps of two machines beside."""
    path, today = "cylinder.boom.closed_length_mm", 1825.0
    machine = ad.load("excavator_20t")
    answer = ad.what_if(machine, {path: today + 5.0}, POINTS)
    near = [machine.replace({path: today + step}) for step in (0.5, -0.5)]
    up, down = (ad.frequency_map(one, ad.Workspace.grid(one, POINTS)).worst_of for one in near)
    for name in up:
        one = row(answer, f"{name}.worst")
        change = 5.0 * (up[name].frequency - down[name].frequency)
        assert one["linear"] - one["before"] == pytest.approx(change, rel=1e-3)
        assert one["change"] == pytest.approx(one["linear_change"], rel=0.05)
    worst, full = row(answer, "worst"), row(answer, "full.worst")
    assert worst["before"] == full["before"]
    assert worst["linear_change"] == full["linear_change"]


def test_further_quantities_stand_beside_the_others() -> None:
    """The cube of a bore, whose linear change is three times the bore's."""

    def cube(mapped: ad.FrequencyMap) -> dict[str, tuple[float, str]]:
        return {"cube": (mapped.machine.cylinders[0].bore ** 3, "m³")}

    changes = {"cylinder.lift.bore_mm": 69.3}
    answer = ad.what_if(ad.load("paper_1dof"), changes, 5, more=cube)
    assert row(answer, "cube")["change"] == pytest.approx(1.1**3 - 1)
    assert row(answer, "cube")["linear_change"] == pytest.approx(0.3, rel=1e-5)


@pytest.mark.slow
def test_bandwidth_stands_beside_the_others() -> None:
    """With pressure feedback it grows with the boom's bore, and linearly for 1 mm."""
    changes = {"cylinder.boom.bore_mm": 121.0}
    answer = ad.what_if(ad.load("excavator_20t"), changes, POINTS)
    damped = row(answer, "bandwidth.damped")
    assert 0.05 < damped["before"] < 0.3
    assert damped["change"] > 0.005
    assert damped["linear_change"] == pytest.approx(damped["change"], rel=0.2)


def test_bandwidth_rests_on_the_damping_that_is_stated() -> None:
    """Half the damping, half the proportional bandwidth; without any there is none."""
    machine, widths = ad.load("paper_1dof"), []
    changes = {"cylinder.lift.bore_mm": 64.0}
    for ratio in (0.02, 0.01):
        answer = ad.what_if(machine, changes, 3, damping=ratio)
        widths.append(row(answer, "bandwidth.proportional")["before"])
    assert widths[1] == pytest.approx(widths[0] / 2, rel=0.05)
    with pytest.raises(ad.ArmDesignError, match="no bandwidth can rest on that"):
        ad.what_if(machine, changes, 3, bandwidth=True)
    unknown = ad.what_if(machine, changes, 3)
    assert row(unknown, "bandwidth.damped")[["before", "linear", "after"]].isna().all()
    assert "state it, as --damping 0.02" in unknown.missing
    assert unknown.sheets()[1].note.count("mode 1 has a damping ratio of 0") == 1


@pytest.mark.slow
def test_a_word_has_no_linear_estimate() -> None:
    answer = ad.what_if(ad.load("excavator_20t"), {"cylinder.boom.count": 1}, 4)
    assert answer.frame["linear"].isna().all()
    assert row(answer, "boom.thrust")["change"] == pytest.approx(-0.5)
    assert any("–" in cell for cells in answer.sheets()[1].rows for cell in cells)
    changes, _, lift, _ = answer.sheets()
    assert changes.note.startswith("no linear estimate: more than numbers changes")
    assert not any("nan" in cell for cells in lift.rows for cell in cells)
    assert lift.rows[0][2] == "–"


def test_a_frequency_below_zero_is_no_estimate() -> None:
    """Ten times the load: the straight line ends below zero. Angles may be there."""
    machine = ad.load("paper_1dof")
    answer = ad.what_if(machine, {"payload.load.mass_kg": 2000.0}, 5, damping=0.02)
    worst = row(answer, "worst")
    assert worst["linear"] < 0 < worst["after"] < worst["before"]
    hertz = answer.sheets()[1].rows[0]
    assert (hertz[0], hertz[2], hertz[4]) == ("worst", "–", "–")
    below = answer.numbers["linear"].dropna() < 0
    assert set(answer.numbers.loc[below[below].index, "unit"]) <= {"m", "rad"}
    count = int(answer.impossible.sum())
    assert answer.sheets()[0].note.startswith(f"{count} linear estimates are left out")
    assert answer.plot().get_ylim()[0] > -110


@pytest.mark.slow
def test_one_number_of_a_list_changes_alone() -> None:
    machine = ad.load("excavator_20t")
    path = "cylinder.boom.base.at_mm"
    answer = ad.what_if(machine, {f"{path}.0": 500}, 4)
    assert answer.changes == {f"{path}.0": (461.5, 500.0)}
    whole = ad.what_if(machine, {path: [500, 0, -602.5]}, 4)
    pd.testing.assert_frame_equal(answer.frame, whole.frame)


@pytest.mark.slow
def test_every_kind_of_machine_has_an_answer() -> None:
    """A motor, springs, several cylinders on a joint, one joint alone."""
    for name in ("rotator", "rocking", "redundant", "paper_1dof"):
        answer = ad.what_if(machines.named(name), {"fluid.bulk_modulus_MPa": 1250}, 4)
        changed = row(answer, "worst")
        assert 0 < changed["change"] < 0.05
        assert changed["linear_change"] == pytest.approx(changed["change"], rel=0.1)
        assert all(len(sheet.rows) for sheet in answer.sheets()[:2])


@pytest.mark.slow
def test_tables_and_picture(answer: ad.WhatIf) -> None:
    changes, frequencies, lift, others = answer.sheets()
    assert changes.rows == (
        ("payload.full.mass_kg", "1600.0", "2000.0"),
        ("cylinder.boom.bore_mm", "120.0", "125.0"),
    )
    assert frequencies.rows[0][0] == "worst"
    assert len(lift.rows) == 3
    assert "others do not change" in others.note
    assert answer.plot().get_ylabel() == "linear estimate of it [%]"


def test_changes_are_read_as_toml() -> None:
    words = ["a.b=1", "c = 2.5", "d=[1, 2]", "e=left", 'f="left"', "g=true"]
    expected = {"a.b": 1, "c": 2.5, "d": [1, 2], "e": "left", "f": "left", "g": True}
    assert read_changes(words) == expected
    others = ["9" * 5000, "[" * 5000, "1\nb = 2"]  # no values of TOML, or more than one
    assert [*read_changes([f"a{k}={word}" for k, word in enumerate(others)]).values()] == others


BAD = [
    ([], "what-if: nothing changes; give KEY=VALUE, as cylinder.boom.bore_mm=125"),
    (["cylinder.boom.bora_mm=125"], 'did you mean "cylinder.boom.bore_mm"?'),
    (["payload.fully.mass_kg=1"], 'did you mean "payload.full.mass_kg"?'),
    (["cylinder.boom.bore_mm"], "is not understood; give KEY=VALUE"),
    (["cylinder.boom.bore_mm=" + "9" * 400], "999… is not allowed; give a number"),
    (["fluid.bulk_modulus_MPa=1e-320"], "1e-320 is not allowed; give 1e-100 or more"),
    (["cylinder.boom.bore_mm=1", "cylinder.boom.bore_mm=2"], "is there twice"),
    (["fluid.entrained_air_percent=-1"], "give a number in [0, 50) %"),
    (["cylinder.boom.bore_mm=x"], 'bore_mm: "x" is not allowed'),
    (["cylinder.boom=3"], "is a table; name one of its numbers"),
    (["cylinder.boom.base.at_mm.3=5"], "no such number; cylinder.boom.base.at_mm has: 0, 1, 2"),
    (
        ["cylinder.boom.diameter=5"],
        "no such number; cylinder.boom has: bore_mm, rod_mm, stroke_mm",
    ),
    (["cylinder.dipper.bore_mm=5"], "no such number; cylinder has: boom, stick, bucket"),
    (["links.boom.mass_kg=5"], "links are in its URDF, excavator_20t.urdf; change them there"),
    (["stability.front_mm=5"], "the file has no [stability]; write it first, with mass_kg, at_mm"),
    (["spring.foot.at_mm=5"], "the file has no [spring.…]; write it first"),
    (["requirements.digging_kN.thumb=5"], 'no cylinder "thumb"; choose from: boom, stick, bucket'),
    (["cylinder.boom.load_holding.setting_bar=5"], "boom.load_holding.side: missing; add side"),
    (["torque_share.bucket=1"], 'did you mean "requirements.torque_share.bucket"?'),
    (["supply.pressure_bar.x=1"], "no such number; supply.pressure_bar is one number"),
    (["cylinder.boom.rod_mm=130"], "does not fit the bore"),
    (["tolerances.pins_mm=1"], 'there is no such width; did you mean "pin_mm"?'),
    (["nothing.at.all=1"], "has no such number; it has: frozen, tool, payload, fluid"),
]


@pytest.mark.parametrize(("words", "message"), BAD)
def test_bad_changes_are_one_line(
    words: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "out"
    code = main(
        ["what-if", "excavator_20t", *words, "--points", "4", "--out", str(out)], monkeypatch
    )
    assert code == 2
    assert_one_line(capsys.readouterr().err, message)
    assert not out.exists()


def test_nothing_to_change_is_refused() -> None:
    with pytest.raises(ad.ArmDesignError, match="nothing changes"):
        ad.what_if(ad.load("paper_1dof"), {})


def test_the_commands_write_their_tables(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["what-if", "paper_1dof", "cylinder.lift.bore_mm=70", "--points", "9", "--out"]
    assert main([*words, str(tmp_path / "a")], monkeypatch) == 0
    assert {path.name for path in (tmp_path / "a").iterdir()} == {"what_if.csv", "what_if.png"}
    said = " ".join(capsys.readouterr().out.split())
    assert "bandwidth.damped – – – – –" in said
    assert "no bandwidth can rest on that; state it, as --damping 0.02" in said
    assert "lowest pose of the grid, damping of the file; none is given: paper_1dof" in said
    with_damping = [*words, str(tmp_path / "c"), "--damping", "0.02"]
    assert main([*with_damping, "--no-bandwidth"], monkeypatch) == 2
    assert_one_line(capsys.readouterr().err, "--damping: is of the bandwidth; leave out --no-")
    assert main([*words, str(tmp_path / "c"), "--bandwidth"], monkeypatch) == 2
    assert_one_line(capsys.readouterr().err, "no bandwidth can rest on that; state it, as")
    assert main([*words, str(tmp_path / "c"), "--no-bandwidth"], monkeypatch) == 0
    assert "bandwidth" not in capsys.readouterr().out
    assert main([*with_damping, "--bandwidth"], monkeypatch) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "damping stated, 0.02" in said
    assert "none is given" not in said
    table = pd.read_csv(tmp_path / "c" / "what_if.csv").set_index("quantity")
    assert table.loc["bandwidth.damped", ["before", "linear", "after"]].astype(float).gt(0).all()
    machine = machines.named("paper_1dof")
    file = tmp_path / "paper_1dof.toml"
    file.write_text(f"{machine.text}\n[tolerances]\npin_mm = 1\n", encoding="utf-8")
    (tmp_path / "paper_1dof.urdf").write_text(machine.urdf_text, encoding="utf-8")
    words = ["tolerances", str(file), "--points", "9", "--count", "100", "--least-frequency", "7"]
    assert main([*words, "--out", str(tmp_path / "b")], monkeypatch) == 0
    written = {path.name for path in (tmp_path / "b").iterdir()}
    assert written == {"tolerances.csv", "requirements.csv", "machines.csv", "tolerances.png"}
    table = pd.read_csv(tmp_path / "b" / "machines.csv")
    assert len(table) == 100
    assert np.all(table["worst_hz"] > 7)
    assert "worst frequency of at least 7.000 Hz (stated)" in capsys.readouterr().out


def test_joints_of_worst_poses_change_by_degrees() -> None:
    """The worst pose's boom from 66.1° to 63.5°: no share of an angle means anything."""
    answer = ad.what_if(ad.load("excavator_20t"), {"cylinder.boom.base.at_mm.0": 600.0}, POINTS)
    boom = row(answer, "empty.worst.boom")
    turned = math.degrees(boom["after"] - boom["before"])
    assert abs(turned) > 1
    assert np.isnan(boom["change"])
    assert np.isnan(boom["linear_change"])
    cells = {cells[0]: cells for cells in answer.sheets()[-1].rows}
    assert cells["empty.worst.boom [°]"][-1] == f"{turned:+.1f}°"
    assert "empty.worst.stick [°]" not in cells or cells["empty.worst.stick [°]"][-1] != "+0.0°"
    assert cells["boom.joint_speed_least_extending [°/s]"][-1].endswith(" %")


def test_all_that_can_limit_has_its_row_though_nothing_changes() -> None:
    """On a soft carriage it alone limits at every pose, before and after."""
    machine = rocking(stiffness=1e6)
    answer = ad.what_if(machine, {"cylinder.stick.bore_mm": 136}, points=2, bandwidth=False)
    shares = {cells[0]: cells[1] for cells in answer.sheets()[-1].rows if "limiting" in cells[0]}
    parts = ["boom", "stick", "bucket", "carriage"]
    assert shares == {f"limiting.{name}": f"{name == 'carriage':.2f}" for name in parts}


def test_positions_of_joints_that_change_no_frequency_are_no_change() -> None:
    """The worst pose has any slew: each map finds another."""
    machine = machines.named("slewing")
    assert machine.joints_without_effect == {machine.joints.index("swing")}
    answer = ad.what_if(machine, {"cylinder.boom.bore_mm": 130.0}, 3)
    frame = answer.frame.set_index("quantity")
    swings = [name for name in frame.index if name.endswith(".worst.swing")]
    assert swings
    assert frame.loc[swings, "linear"].isna().all()
    assert not any(row[0].endswith("worst.swing") for row in answer.sheets()[-1].rows)


@pytest.mark.parametrize(
    ("before", "after", "even"),
    [
        (0.10, 0.12, True),
        (0.10, 0.1201, True),
        (0.11, 0.11, True),
        (0.11, 0.12, False),  # a limit of the joint holds it
        (0.11, math.pi, False),  # another pose is as low
        (0.10, 0.10, False),
    ],
)
def test_positions_have_linear_estimates_where_they_move_evenly(
    before: float, after: float, even: bool
) -> None:
    assert _evenly(before, 0.11, after) == even


def test_a_position_that_moves_evenly_is_estimated() -> None:
    """Of the empty bucket's worst pose: a fifth of the change moves it a fifth as far."""
    machine, key = ad.load("excavator_20t"), "cylinder.boom.bore_mm"
    far, near = (ad.what_if(machine, {key: bore}, POINTS) for bore in (125.0, 121.0))
    joint = "empty.worst.bucket"
    before = row(far, joint)["before"]
    moved = [row(one, joint)["linear"] - before for one in (far, near)]
    assert abs(moved[0]) > 1e-3
    assert moved[0] == pytest.approx(5 * moved[1], rel=0.02)
    assert row(near, joint)["after"] - before == pytest.approx(moved[1], rel=0.1)


def test_what_jumps_has_no_estimate_and_a_kink_has_that_of_its_side() -> None:
    """By hand: 3 + 2 x right of 0 and 3 + 5 x left of it; 3 with a step to the right of 0."""
    kink = _estimate("soil.worst", 3.0, 3.0 + 2 * PART, 3.0 - 5 * PART)
    assert kink == pytest.approx(5.0)
    assert _estimate("soil.worst", 3.0, 3.0 + 2 * PART, 3.0 - 2 * PART) == pytest.approx(5.0)
    assert math.isnan(_estimate("soil.percentile_95", 3.0, 3.1, 3.0))
    assert math.isnan(_estimate("boom.static_pressure", 3.0, 3.1, 3.0))
    assert _estimate("soil.percentile_95", 3.0, 3.0 + 1e-8, 3.0) == pytest.approx(3.0, rel=1e-5)


def swung_by_two() -> ad.Machine:
    """A boom that two cylinders alike swing, one on each side."""
    swing = machines.Joint("swing", "root", axis=(0, 0, 1), limits=(-0.7, 0.7), com=(0.8, 0, 0))
    left, right = (
        machines.CylinderSpec(name, ("root", (-0.9, side, 0)), ("swing", (0.1, side, 0)))
        for name, side in (("left", 0.3), ("right", -0.3))
    )
    return machines.build([swing], [left, right], payload=("swing", (1.0, 0.0, 0.0)))


def test_a_load_case_with_two_worst_poses_has_the_slope_of_the_one_that_is_lower() -> None:
    """A rod of one breaks the tie; by the mean over both sides the estimate had half the slope."""
    answer = ad.what_if(swung_by_two(), {"cylinder.right.rod_mm": 63.3}, 9, bandwidth=False)
    worst = row(answer, "worst")
    own = row(answer, f"{answer.before.worst.payload}.worst")
    assert worst["before"] == own["before"]
    assert own["linear_change"] == worst["linear_change"]
    assert own["change"] == pytest.approx(own["linear_change"], rel=0.02)


def test_the_estimate_of_a_load_case_is_a_straight_line() -> None:
    """A hundredth of the change has a hundredth of the effect; by differences of maps the noise of
    their searches came in a hundredfold (0.019 in place of 0.016 Hz/mm for a backhoe).
    """
    effects = []
    for change in (0.01, 1.0):
        changes = {"cylinder.left.bore_mm": 100.0 + change}
        answer = ad.what_if(swung_by_two(), changes, 4, bandwidth=False)
        own = row(answer, f"{answer.before.worst.payload}.worst")
        effects.append((own["linear"] - own["before"]) / change)
    assert effects[0] == pytest.approx(effects[1], rel=1e-9)


def test_no_step_goes_back_to_a_number_that_the_file_may_not_have() -> None:
    """From 0.2 kg to 40 kg a hundredth back was -0.2 kg: masses were not positive definite.

    By hand: frequencies of a point mass alone fall as 1/√m; its pressures are straight lines.
    """
    machine = ad.load("paper_1dof").replace({"payload.load.mass_kg": 0.2})
    answer = ad.what_if(machine, {"payload.load.mass_kg": 40.0}, POINTS, bandwidth=False)
    assert row(answer, "worst")["linear_change"] == pytest.approx(-0.5 * (40 / 0.2 - 1), rel=1e-5)
    pressure = row(answer, "lift.static_pressure")
    assert pressure["linear"] == pytest.approx(pressure["after"])
