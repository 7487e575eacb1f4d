"""Values found from measurements: known truths, deviations, what is not determined, words."""

from __future__ import annotations

import time
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import armdesign as ad
from tests.calibration.synthetic import (
    AIR,
    BETA,
    LIFT,
    TILT,
    TRUTH,
    crane,
    lifter,
    measurements,
    poses,
)
from tests.commands import main


def test_known_values_are_found_again() -> None:
    """From a file with another bulk modulus and no compliance at all; the truth is the source."""
    machine = crane()
    calibration = ad.calibrate(
        machine, measurements(machine.replace(TRUTH), poses()), [BETA, LIFT]
    )
    assert calibration.values["determined"].all()
    assert calibration.values["value"].to_list() == pytest.approx(list(TRUTH.values()), rel=1e-6)
    assert calibration.values["before"].to_list() == [1200.0, 0.0]
    assert calibration.frame["calibrated_error"].abs().max() < 1e-7
    assert calibration.left_out == pytest.approx(0, abs=1e-6)
    assert calibration.machine.section.fluid.bulk_modulus_MPa == pytest.approx(1050, rel=1e-6)


@pytest.mark.slow
def test_masses_and_dead_volumes_are_found_too() -> None:
    """Any number of the file: a load case's mass and a dead volume."""
    truth = {"payload.full.mass_kg": 260.0, "cylinder.lift.dead_volume_l.cap": 0.6}
    machine = crane()
    calibration = ad.calibrate(machine, measurements(machine.replace(truth), poses()), list(truth))
    assert calibration.values["value"].to_list() == pytest.approx(list(truth.values()), rel=1e-5)


@pytest.mark.slow
def test_intervals_hold_the_truth() -> None:
    """Intervals of 95 % over 50 simulated sets with noise of 1 %: at least 90 % of them do."""
    machine, q = crane(), poses()
    clean = measurements(machine.replace(TRUTH), q)
    start = machine.replace({LIFT: 1e-8})
    held = []
    for seed in range(50):
        noise = np.exp(0.01 * np.random.default_rng(seed).standard_normal(len(q)))
        noisy = clean.assign(
            frequency_hz=clean["frequency_hz"] * noise, deviation_hz=0.01 * clean["frequency_hz"]
        )
        values = ad.calibrate(start, noisy, list(TRUTH)).values
        truth = pd.Series(TRUTH)
        held.append((values["low"] <= truth) & (truth <= values["high"]))
    assert np.mean(held) >= 0.90


def test_deviations_grow_where_the_machine_misses() -> None:
    """A machine that cannot follow the measurements: χ² per degree of freedom widens them, and
    the words say so. The reference is the weighted mean square by hand.
    """
    machine = crane()
    table = measurements(machine.replace(TRUTH), poses(), noise=0.001)
    one = ad.calibrate(machine, table, [BETA])
    frame = one.frame
    misses = np.log(frame["calibrated_hz"] / frame["measured_hz"])
    misses *= frame["measured_hz"] / frame["deviation_hz"]
    assert one.fit is not None
    assert one.fit.scale == pytest.approx(np.sqrt(np.sum(misses**2) / 7), rel=1e-3)
    assert any("do not explain the measurements" in line for line in one.findings)
    none = ad.calibrate(machine, table, ["cylinder.lift.friction.viscous_N_s_per_m"])
    assert none.fit is None
    assert any("no values explain the measurements" in line for line in none.findings)


def test_what_looks_alike_is_not_claimed() -> None:
    """At one pose and load any two springs in a row look alike: one is held and said to be."""
    machine, q = crane(), np.tile(poses()[:1], (8, 1))
    table = measurements(machine.replace(TRUTH), q, noise=0.005)
    table = table[table["payload"] == "full"]
    calibration = ad.calibrate(machine.replace({LIFT: 1e-8}), table, [BETA, LIFT])
    assert sorted(calibration.values["determined"]) == [False, True]
    (held,) = calibration.values.index[~calibration.values["determined"]]
    row = calibration.values.loc[held]
    assert row["value"] == row["before"]
    assert np.isnan(row["deviation"])
    words = " ".join(calibration.findings)
    assert f"{held} is not determined by these measurements" in words
    assert f"held at {row['before']:g} " in words
    assert "the intervals of the others allow for all that it may be" in words
    assert f"{BETA} and {LIFT} look alike" in words
    assert "what cannot be told apart" in words


def test_an_interval_beside_a_held_unknown_allows_for_what_that_may_be() -> None:
    """Springs in a row, of which one is held at a wrong value: the other's interval has the truth.

    It had it as little as a fit has that takes the file's value for right. Its lower end is that
    of a machine without a compliance, as the softest oil explains the measurements alone.
    """
    truth, machine = crane().replace(TRUTH), crane().replace({LIFT: 1e-8})
    table = measurements(truth, np.tile(poses()[:1], (8, 1)), noise=0.005)
    table = table[table["payload"] == "full"]
    calibration = ad.calibrate(machine, table, [BETA, LIFT])
    assert list(calibration.loose) == [LIFT]
    row = calibration.values.loc[BETA]
    as_filed = ad.calibrate(machine, table, [BETA]).values.loc[BETA]
    assert row["value"] == pytest.approx(as_filed["value"], rel=1e-6)
    assert not as_filed["low"] < TRUTH[BETA] < as_filed["high"]
    assert row["low"] < TRUTH[BETA] < row["high"]
    rigid = ad.calibrate(crane(), table, [BETA]).values.loc[BETA]
    assert row["low"] == pytest.approx(rigid["low"], rel=0.02)  # interpolated
    assert row["deviation"] >= (row["high"] - row["value"]) / 4


@pytest.mark.slow
def test_what_no_measurement_depends_on_is_not_claimed() -> None:
    machine = crane()
    table = measurements(machine.replace(TRUTH), poses())
    calibration = ad.calibrate(machine, table, ["supply.flow_l_per_min", BETA, LIFT])
    assert calibration.values["determined"].to_list() == [False, True, True]
    assert calibration.values["value"].iloc[0] == 80
    assert any("no measurement depends on it" in line for line in calibration.findings)
    alone = ad.calibrate(machine, table, ["supply.flow_l_per_min"])
    assert alone.fit is None
    assert alone.machine is machine
    assert alone.correlations.empty


@pytest.mark.slow
def test_an_unknown_that_fits_best_at_zero_is_no_weak_direction() -> None:
    """Ten per cent of nothing change no frequency: that was said to be what is known least."""
    machine = crane()
    table = measurements(machine.replace({BETA: 1050.0}), poses(), noise=0.01)
    calibration = ad.calibrate(machine, table, [BETA, LIFT, TILT])
    assert calibration.values["determined"].to_list() == [True, False, False]
    assert not any(line.startswith("what ") for line in calibration.findings)


@pytest.mark.slow
def test_values_that_no_oil_or_structure_has_are_said() -> None:
    """Oil softer than any and a structure ten times as soft as oil fit, but are named."""
    machine = crane()
    soft = 10 * machine.actuators[0].oil_compliance(machine.fluid, machine.supply)
    for path, value in ((BETA, 300.0), (LIFT, soft)):
        for truth, implausible in ((value, True), (TRUTH[path], False)):
            table = measurements(machine.replace({path: truth}), poses())
            words = " ".join(ad.calibrate(machine, table, [path]).findings)
            assert (f"{path} {truth:.3g}" in words and "is implausible" in words) is implausible


def test_a_weak_direction_changes_as_little_as_is_said() -> None:
    """The change that is named, made to the machine: frequencies differ by what is said."""
    machine = crane().replace({LIFT: 4e-8})
    calibration = ad.calibrate(machine, measurements(machine, poses(), noise=0.01), [BETA, LIFT])
    (line,) = (line for line in calibration.findings if line.startswith("what is known least"))
    words = line.replace(",", "").split()
    changes = {p: float(words[words.index(p) + 1]) / 100 for p in (BETA, LIFT) if p in words}
    said = float(words[-2]) / 100
    before = calibration.after.frequencies
    values = calibration.values["value"]
    other = calibration.machine.replace({p: values[p] * np.exp(x) for p, x in changes.items()})
    table = measurements(other, poses())
    assert np.abs(table["frequency_hz"] / before - 1).max() == pytest.approx(said, rel=0.15)


@pytest.mark.slow
def test_priors_add_what_is_known() -> None:
    """Two sources of one number: the mean weighted by the inverse squares of their deviations."""
    machine = crane()
    table = measurements(machine.replace({BETA: 1000.0}), poses(), noise=0.01, seed=1)
    alone = ad.calibrate(machine, table, [BETA]).values.loc[BETA]
    both = ad.calibrate(machine, table, [BETA], {BETA: (1010.0, 20.0)}).values.loc[BETA]
    logs = np.log([alone["value"], 1010.0])
    weights = np.array([alone["value"] / alone["deviation"], 1010 / 20]) ** 2
    assert np.log(both["value"]) == pytest.approx(np.sum(weights * logs) / weights.sum(), abs=2e-3)
    assert both["deviation"] < alone["deviation"]


def test_static_pressures_tell_a_mass() -> None:
    """From pressures alone, p1 A1 − p2 A2 = F at every pose; A and F through the front door."""
    machine = crane()
    truth = machine.replace({"payload.full.mass_kg": 250.0}).with_payload("full")
    q = poses()
    lift = machine.cylinders[0]
    forces = truth.at(q).cylinder_forces[:, 0]
    rows = pd.DataFrame(
        {
            "payload": "full",
            "lift_boom_deg": np.degrees(q[:, 0]),
            "tilt_boom_deg": np.degrees(q[:, 1]),
            "extension_mm": 1e3 * q[:, 2],
            "lift_cap_bar": (forces + lift.annulus_area * 8e5) / lift.bore_area / 1e5,
            "lift_annulus_bar": 8.0,
            "pressure_deviation_bar": 0.5,
        }
    )
    calibration = ad.calibrate(machine, rows, ["payload.full.mass_kg"])
    assert calibration.values["value"].iloc[0] == pytest.approx(250, rel=1e-6)
    loads = calibration.frame[["lift_load_bar", "lift_calibrated_load_bar"]].to_numpy()
    assert loads[:, 0] == pytest.approx(loads[:, 1], rel=1e-6)
    assert np.isnan(calibration.left_out).all()


@pytest.mark.slow
def test_left_out_errors_are_those_of_fits_without_the_measurement() -> None:
    machine = crane()
    table = measurements(machine.replace(TRUTH), poses(), noise=0.01, seed=3)
    calibration = ad.calibrate(machine, table, [BETA, LIFT])
    for n in (0, 4):
        without_one = ad.calibrate(machine, table.drop(index=n), [BETA, LIFT])
        exact = machine.replace(without_one.values["value"].to_dict())  # the file's are rounded
        answer = measurements(exact, poses())["frequency_hz"][n]
        assert calibration.left_out[n] == pytest.approx(
            answer / table["frequency_hz"][n] - 1, abs=1e-4
        )


def test_left_out_errors_are_of_fits_that_have_converged() -> None:
    """Oil with air at two loads, where χ² bends; the source of the errors is SciPy's
    ``least_squares`` over the other rows, from three starts. The first was 4.20 %.
    """
    rows = [
        (38.73, -111.05, "empty", 5.934),
        (30.69, -115.25, "full", 3.696),
        (10.81, -116.21, "empty", 7.125),
        (21.91, -65.39, "full", 2.703),
        (5.31, -57.10, "empty", 6.472),
        (30.50, -101.65, "full", 3.196),
    ]
    table = pd.DataFrame(rows, columns=["boom_deg", "stick_deg", "payload", "frequency_hz"])
    table["deviation_hz"] = 0.02 * table["frequency_hz"]
    errors = 100 * ad.calibrate(lifter(), table, [BETA, AIR]).left_out
    assert errors == pytest.approx([2.904, -1.517, 0.855, 0.323, -2.510, 2.635], abs=2e-3)


@pytest.mark.slow
def test_two_unknowns_and_ten_poses_take_less_than_ten_seconds() -> None:
    machine = crane()
    table = measurements(machine.replace(TRUTH), poses(10), noise=0.01)
    begin = time.perf_counter()
    ad.calibrate(machine, table, [BETA, LIFT])
    assert time.perf_counter() - begin < 10


@pytest.mark.slow
def test_the_command_writes_its_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    crane().save(tmp_path / "loader_crane.toml")
    table = measurements(crane().replace(TRUTH), poses(4), noise=0.01)
    table.to_csv(tmp_path / "measured.csv", index=False)
    monkeypatch.chdir(tmp_path)
    words = ["--fit", f"{BETA}, {LIFT}", "--prior", f"{BETA}=1200:200"]
    assert main(["calibrate", "loader_crane.toml", "measured.csv", *words], monkeypatch) == 0
    out = tmp_path / "out" / "calibrate_loader_crane"
    assert {path.name for path in out.iterdir()} == {
        "calibration.csv",
        "calibration_values.csv",
        "calibration.png",
        "loader_crane_calibrated.toml",
        "loader_crane.urdf",
    }
    printed = capsys.readouterr().out
    assert "left out" in printed
    assert "correlations: fluid.bulk_modulus_MPa with" in printed
    values = pd.read_csv(out / "calibration_values.csv", index_col="path")
    saved = ad.load(out / "loader_crane_calibrated.toml").section
    assert saved.cylinder["lift"].compliance_m_per_N == pytest.approx(
        values["value"][LIFT], rel=0.02
    )


def test_its_file_tells_where_values_are_from(tmp_path: Path) -> None:
    machine = crane()
    table = measurements(machine.replace(TRUTH), poses(), noise=0.01)
    calibration = ad.calibrate(machine, table, [BETA, LIFT, TILT])
    path = calibration.save(tmp_path / "crane.toml")
    text = path.read_text(encoding="utf-8")
    for name, row in calibration.values.iterrows():
        leaf = str(name).rpartition(".")[2]
        story = f", fitted ± {row['deviation']:.2g}" if row["determined"] else leaf
        assert story in text
    assert text.startswith("# Made by armdesign")
    assert "8 measured frequencies" in text
    saved = tomllib.loads(text)
    assert saved["name"] == "loader_crane_calibrated"
    assert ad.load(path).fluid == calibration.machine.fluid


def test_a_compliance_that_the_measurements_refute_does_not_bend_the_others() -> None:
    """A stiff machine, whose file says that it yields: held at that, nothing was determined."""
    truth = crane().replace({BETA: 1050.0})
    found = ad.calibrate(
        truth.replace({LIFT: 4e-8}), measurements(truth, poses(), 0.005), [BETA, LIFT]
    )
    assert found.values.loc[BETA, "low"] < 1050 < found.values.loc[BETA, "high"]
    assert found.values.loc[BETA, "deviation"] < 20
    assert found.values.loc[LIFT, "high"] < 1e-8
    assert np.isfinite(found.correlations.to_numpy()).all()
    assert found.frame["left_out_error"].abs().max() < 0.02
