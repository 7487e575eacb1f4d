"""Every study answers its question, and the answer in its docstring is what it finds."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import armdesign as ad

STUDIES = Path(__file__).parents[1] / "studies"


def study(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"study_{name[:2]}", STUDIES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.slow
def test_paper_validation_finds_its_headline() -> None:
    """All 40 in closed form, four of them simulated; the exact formula's worst is among the
    four.
    """
    module = study("00_paper_validation")
    headline = re.search(
        r"\(11\) ([\d.]+) rad/s, \(42\) as printed ([\d.]+); .* within ([\d.]+) %",
        module.__doc__ or "",
    )
    assert headline is not None
    table, measured = module.run(fast=True)
    linear = table["linear"][["static_11", "joint_42_as_printed"]]
    # the printed digits
    assert linear.to_list() == pytest.approx([float(headline[1]), float(headline[2])], abs=0.05)
    off = abs(measured.identified / measured.computed["joint_exact"] - 1)
    assert 100 * off.max() <= float(headline[3])


@pytest.mark.slow
def test_baseline_map_finds_its_headline() -> None:
    module = study("01_baseline_map")
    headline = re.search(r"At ([\d.]+) Hz .* limits ≥ (\d+) %", module.__doc__ or "", re.S)
    assert headline is not None
    table = module.run(fast=True)
    assert len(table) >= 6
    assert table.index[0] == "loader_crane"  # sorted: the lowest of all
    # the printed digits; refined
    assert table["worst_hz"].iloc[0] == pytest.approx(float(headline[1]), abs=5e-4)
    assert list(table["cylinder"]) == list(table["most_often"])
    assert set(table["cylinder"]) == {"boom", "lift"}
    # a coarse grid counts edges more
    assert 100 * table["share"].min() == pytest.approx(float(headline[2]), abs=4)


@pytest.mark.slow
def test_which_formula_finds_its_headline() -> None:
    module = study("02_which_formula")
    words = module.__doc__ or ""
    medians, worst = (re.findall(rf"{mark}([\d.]+)", words) for mark in ("×", r"\+"))
    table = module.run()
    rigid, locked = (table.xs(formula, level="formula") for formula in ("rigid", "locked"))
    figures = [rigid["median"].min(), rigid["median"].max(), rigid["worst"].max()]
    assert figures == pytest.approx(
        [float(x) for x in medians], rel=0.02
    )  # printed with two digits
    figures = [100 * (locked["median"].max() - 1), 100 * (locked["worst"].max() - 1)]
    assert figures == pytest.approx([float(x) for x in worst], abs=1)
    assert locked["median"].min() >= 1 - 1e-9, "interlacing"


@pytest.mark.slow
def test_pins_and_areas_finds_its_headline() -> None:
    module = study("04_pins_and_areas")
    printed = [float(n) / 100 for n in re.findall(r"\+([\d.]+) %", module.__doc__ or "")]
    lift = float(re.findall(r"(\d+) % of today's", module.__doc__ or "")[0]) / 100
    table = module.run(fast=True)
    # the coarse grid of the fast run and rounding cost up to a per cent
    assert table["gain"].to_list() == pytest.approx(printed, abs=0.015)
    assert table["lift_share"]["given away"] == pytest.approx(lift, abs=0.02)
    assert (table["lift_share"][["sizes", "pins", "both", "buildable"]] >= 0.9 - 1e-9).all()


@pytest.mark.slow
def test_areas_only_finds_its_headline() -> None:
    module = study("03_areas_only")
    printed = [float(n) for n in re.findall(r"([\d.]+) %", module.__doc__ or "")]
    table = module.run(fast=True)
    assert table.index[0] == "loader_crane"
    gains = [100 * table["gain"].max(), 100 * table["gain"]["excavator_20t"]]
    # one decimal is printed; refined between poses
    assert gains == pytest.approx(printed[:2], abs=0.1)
    assert table["gain"][["paper_1dof", "patu_boom"]].abs().max() < 1e-9
    assert 100 * table["gap"].max() <= printed[2]


@pytest.mark.slow
def test_robust_finds_its_headline() -> None:
    module = study("06_robust")
    words = module.__doc__ or ""
    gain, cost = (
        float(re.findall(pattern, words)[0]) / 100
        for pattern in (r"\+(\d+) %", r"cost of ([\d.]+) %")
    )
    robust, today = (float(n) for n in re.findall(r"\(([\d.]+) against ([\d.]+) Hz\)", words)[0])
    table = module.run(fast=True)
    least, file = table["least_hz"], table["file_hz"]
    # two digits; coarse
    assert [least["for the bands"], least["today"]] == pytest.approx([robust, today], abs=0.01)
    assert least["for the bands"] / least["today"] - 1 == pytest.approx(gain, abs=0.015)
    assert 1 - file["for the bands"] / file["for the file"] == pytest.approx(cost, abs=0.01)
    kept = float(re.findall(r"keeps \+(\d+) %", words)[0]) / 100
    assert least["for the file"] / least["today"] - 1 == pytest.approx(kept, abs=0.02)


@pytest.mark.slow
def test_speed_frequency_finds_its_headline() -> None:
    module = study("07_speed_frequency")
    words = module.__doc__ or ""
    within, fixed = (
        float(re.findall(pattern, words)[0]) for pattern in (r"within ([\d.]+) %", r"\+(\d+) %")
    )
    printed = [float(n) for n in re.findall(r"×(\d\.\d+)", words)]
    table = module.run(fast=True)[0]["squared_times_speed"]
    assert 100 * (table["all bores, dead volumes too"] - 1).abs().max() <= within
    assert 100 * (table["all bores, dead volumes fixed", 1.2] - 1) == pytest.approx(fixed, abs=0.5)
    trades = [table["cylinders", 1.0], table["pins too", 1.0]]
    # squares of gains that a coarse grid has within 0.5 %
    assert trades == pytest.approx(printed, abs=0.02)


@pytest.mark.slow
def test_nonlinear_proof_finds_its_headline() -> None:
    module = study("05_nonlinear_proof")
    words = module.__doc__ or ""
    count = re.search(r"all (\d+) sweeps", words)
    full, half = (float(share) for share in re.findall(r"([\d.]+) %", words))
    worst = re.search(r"([\d.]+) → ([\d.]+) Hz", words)
    assert count is not None
    assert worst is not None
    table = module.run()
    assert table["sweeps"].sum() == table["agree"].sum() == int(count[1])
    largest = 100 * table[["full", "half"]].max().to_numpy()
    assert largest == pytest.approx([full, half], abs=0.005)  # the printed digits
    lowest = table["identified_hz"].groupby(level="machine", sort=False).min()
    assert lowest.to_list() == pytest.approx([float(worst[1]), float(worst[2])], abs=5e-4)
    assert list(table.index) == [(m, load) for m in ("today", "new") for load in ("empty", "full")]


@pytest.mark.slow
def test_large_swings_finds_its_headline() -> None:
    """The fall lies within the measured one, while the boom's rod chamber is empty."""
    module = study("10_large_swings")
    words = module.__doc__ or ""
    ends = [float(n) for n in re.findall(r"([\d.]+) Hz", words)]
    ratio, *measured = (float(n) for n in re.findall(r"×(\d\.\d+)", words))
    table = module.run()[0]
    first, last = table["frequency_hz"].iloc[[0, -1]]
    assert [first, last] == pytest.approx(ends, abs=0.01)  # the printed digits
    assert first / last == pytest.approx(ratio, abs=0.01)
    assert measured[0] < first / last < measured[1]
    low, high = module.MEASURED_FIRST
    decayed = module.MEASURED_LAST
    assert measured == pytest.approx([low / decayed, high / decayed], abs=0.01)
    assert table["swing_bar"].is_monotonic_decreasing
    assert table["annulus_bar"].max() < 3  # empty: as measured, at most 3 bar


@pytest.mark.slow
def test_rocking_finds_its_headline() -> None:
    """The worst pose is refined off the grid, so that a coarse one is enough; tracks as stiff as
    rock take nothing.
    """
    module = study("11_rocking")
    words = module.__doc__ or ""
    stiff, share, worst, soft, loss = (float(x) for x in re.findall(r"[\d.]+(?= )", words)[1:])
    table = module.run(fast=True).set_index("stiffness_mn_m")
    assert 100 * table["loss"].loc[stiff] < share < 100 * table["loss"].iloc[2]
    assert 100 * table["loss"].loc[soft] == pytest.approx(loss, abs=0.5)
    assert table["worst_hz"].iloc[0] == pytest.approx(worst, rel=0.005)
    assert table["worst_hz"].is_monotonic_decreasing
    assert table["limits"].iloc[-1] == "carriage"


@pytest.mark.slow
def test_shaping_finds_its_headline() -> None:
    """The worst pose is refined off the grid, so that a coarse one is enough."""
    module = study("12_shaping")
    words = module.__doc__ or ""
    delay, median, most, duration = (float(x) for x in re.findall(r"([\d.]+) s\b", words))
    periods = float(re.findall(r"([\d.]+) periods", words)[0])
    left, rung = (float(x) for x in re.findall(r"([\d.]+) mm", words))
    table, (move,), frequencies = module.run(fast=True)
    assert table.loc[("workspace, 5 %", 2), "most"] == pytest.approx(delay, abs=0.01)
    assert table.loc[("workspace, 5 %", 2), "periods"] == pytest.approx(periods, abs=0.01)
    zvd = table.loc[("ZVD", 2), ["median", "most"]].to_list()
    assert zvd == pytest.approx([median, most], abs=0.02)
    assert move.duration == pytest.approx(duration, abs=0.05)
    assert 1e3 * move.unshaped.residual == pytest.approx(rung, rel=0.02)
    assert 1e3 * move.shaped.residual == pytest.approx(left, abs=0.1)
    both = frequencies.frame[["f1_hz", "f2_hz"]].to_numpy()
    assert move.shaper.residual(both).max() <= 0.05


@pytest.mark.slow
def test_tolerances_finds_its_headline() -> None:
    module = study("13_tolerances")
    words = module.__doc__ or ""
    pin, off, off_with_air = (float(x) for x in re.findall(r"(\d+) (?:mHz|with it)", words))
    lost, worst, few = (float(x) for x in re.findall(r"([\d.]+) (?:% of 0|Hz|% half)", words))
    pins, air, trust = module.run(fast=True)
    assert pins.index[0] == "cylinder.boom.base"
    assert 1e3 * pins.iloc[0] == pytest.approx(pin, abs=0.5)
    assert pins[pins.index.str.startswith("cylinder.stick")].max() < 1e-3
    assert air[0.0] == pytest.approx(worst, abs=5e-4)
    loss = 1 - air / air[0.0]
    assert 100 * loss[1.0] == pytest.approx(lost, abs=0.5)
    assert loss[few] / loss[1.0] == pytest.approx(0.5, abs=0.05)
    errors = -1e3 * trust["error_1_percent_hz"]
    assert errors["no air", 1.0] == pytest.approx(off, abs=0.5)
    assert errors["air", 1.0] == pytest.approx(off_with_air, abs=1)


@pytest.mark.slow
def test_bandwidth_finds_its_headline() -> None:
    module = study("14_bandwidth")
    words = module.__doc__ or ""
    new, today, without = (float(x) for x in re.findall(r"([\d.]+) Hz", words))
    shares = re.findall(r"([\d.]+) % (?:more|higher|of\s+the)", words)
    more, higher, lost, taken = (float(share) / 100 for share in shares)
    table, _ = module.run()
    common, frequency = table["with pressure feedback"], table["frequency"]
    assert common["today"] == pytest.approx(today, abs=5e-4)
    assert common["new"] == pytest.approx(new, abs=5e-4)
    own = table["with gains of each loop's own"]
    assert (own[["today", "new"]] > 1.7 * common[["today", "new"]]).all()
    assert table["position gains"][["today", "new"]].to_numpy() == pytest.approx(without, abs=5e-4)
    assert frequency["new"] / frequency["today"] - 1 == pytest.approx(higher, abs=0.005)
    assert common["new"] / common["today"] - 1 == pytest.approx(more, abs=0.005)
    assert 1 - frequency["today, 1 % air"] / frequency["today"] == pytest.approx(lost, abs=0.005)
    assert 1 - common["today, 1 % air"] / common["today"] == pytest.approx(taken, abs=0.005)


@pytest.mark.slow
def test_rules_find_their_headline() -> None:
    """Of the 20 t machine; the others are in the table of docs/costs.md."""
    module = study("15_rules")
    words = module.__doc__ or ""
    real, built = (float(x) for x in re.findall(r"\+([\d.]+) %", words)[:2])
    pairs = re.findall(r"\+([\d.]+) and\s+\+([\d.]+) %", words)
    (lift,) = re.findall(r"(\d+) % of the lift", words)
    stated = {"none": (real, built)} | {
        rule: (float(one), float(two))
        for rule, (one, two) in zip(
            ("buckling", "torque", "torque, room", "lift"), pairs, strict=True
        )
    }
    table = module.run(["excavator_20t"], list(stated))
    for rule, gains in stated.items():
        assert 100 * table.loc[rule, ["real", "built"]].to_numpy() == pytest.approx(gains, abs=0.1)
    assert 100 * table.loc["lift", "lift_share"] == pytest.approx(float(lift), abs=0.5)


@pytest.mark.slow
def test_single_rules_find_their_headline() -> None:
    """Of the 20 t machine: every rule that binds, each left out alone; none gains less so."""
    module = study("16_each_rule")
    stated = [float(x) for x in re.findall(r"\+([\d.]+) %", module.__doc__ or "")]
    table = module.run(["excavator_20t"])["real"].loc["excavator_20t"]
    rules = ("lift_share.boom", "torque_share.stick", "torque_share.bucket", "lift_share.stick")
    keys = [module.NONE, *rules, "buckling_share.boom"]
    assert 100 * table[keys].to_numpy() == pytest.approx(stated, abs=0.1)
    assert set(table.index) == {*keys, "outline.stick"}
    assert table.min() == table[module.NONE]


@pytest.mark.parametrize("path", sorted(STUDIES.glob("*.py")), ids=lambda p: p.stem)
def test_study_is_short_and_asks_one_question(path: Path) -> None:
    lines = path.read_text(encoding="utf-8").splitlines()
    assert len(lines) < 80
    assert lines[0].startswith('"""')
    assert lines[0].endswith("?")


@pytest.mark.slow
def test_calibration_finds_its_headline() -> None:
    module = study("08_calibration")
    words = module.__doc__ or ""
    low, high = (float(n) for n in re.findall(r"\+(\d+) to \+(\d+) %", words)[0])
    one, left_out, two = (float(n) for n in re.findall(r"(\d\.\d) %", words))
    table, answers, _ = module.run(fast=True)
    moving = table[: module.MOVING]
    sheet = moving["data sheet, valves shut"]
    assert [sheet.min(), sheet.max()] == pytest.approx([low, high], abs=0.5)
    largest = moving.abs().max()
    assert largest["one number"] == pytest.approx(one, abs=0.05)
    assert largest["one number, left out"] == pytest.approx(left_out, abs=0.05)
    assert largest["two numbers"] == pytest.approx(two, abs=0.05)
    # asked for: 3 % after one number, 2 % after two, 3.5 % left out
    assert one < 3
    assert two < 2
    assert left_out < 3.5
    assert largest["shipped, valves shut"] < 2
    assert abs(table["one number"].iloc[-1]) < 1, "the window after the stop"
    lines = answers["findings"]["three numbers"]
    assert f"{module.MODULUS} and {module.AIR} look alike" in lines
    assert f"{module.COMPLIANCE} and {module.MODULUS} can be told apart" in lines
    shipped = ad.load("loader_crane").section.cylinder["lift"].compliance_m_per_N
    again = ad.calibrate(ad.load("loader_crane"), module.MEASURED, [module.COMPLIANCE])
    assert again.values["value"].iloc[0] == pytest.approx(shipped, rel=2e-3)


@pytest.mark.slow
def test_recorded_manoeuvre_finds_its_headline() -> None:
    module = study("09_recorded_manoeuvre")
    headline = re.search(
        r"within (\d+) %, .* factor of ([\d.]+) and mean cap pressure within (\d+) %",
        (module.__doc__ or "").replace("\n", " "),
    )
    assert headline is not None
    table = module.run()
    frequency, damping, pressure = (table[c] for c in table.columns if c.endswith("over measured"))
    assert len(table) == 6
    assert 100 * (frequency - 1).abs().max() <= float(headline[1]) <= 3
    assert np.exp(np.abs(np.log(damping))).max() <= float(headline[2]) < 1.5
    assert 100 * (pressure - 1).abs().max() <= float(headline[3]) <= 5
