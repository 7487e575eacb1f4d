"""Measurements and unknowns that cannot be: one clear line each, and nothing is written."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import armdesign as ad
from armdesign.calibration.measured import measured_of, read_measured
from tests.calibration.synthetic import AIR, BETA, LIFT, crane, measurements, poses
from tests.commands import Refused
from tests.sprung import rocking

HEAD = "payload,lift_length_mm,tilt_boom_deg,extension_mm,frequency_hz"
ROW = "full,1000,-40,0,2.1"


def table(*columns: str, row: str = ROW, head: str = HEAD) -> str:
    """CSV text of one row, with columns in addition as name=value."""
    pairs = [column.split("=") for column in columns]
    names = ",".join([head, *(name for name, _ in pairs)])
    return f"{names}\n{','.join([row, *(value for _, value in pairs)])}\n"


BAD = {
    "": "holds no measurement; give a row for each",
    HEAD.replace(",frequency_hz", "") + "\n" + ROW[: ROW.rindex(",")]: (
        "row 1: holds no measurement; give frequency_hz, or pressures with pressure_deviation_bar"
    ),
    table(head=HEAD.replace("extension_mm", "extention_mm")): (
        "no column says where joint extension stands; give one column: extension_mm or"
        " extension_length_mm"
    ),
    table("lift_boom_deg=9"): (
        "lift_boom_deg and lift_length_mm say where joint lift_boom stands; give one column"
    ),
    table(row=ROW.replace("1000", "700")): (
        "row 1, lift_length_mm: 700 mm is outside the stroke [820, 1355] mm"
    ),
    table(row=ROW.replace("-40", "40")): (
        "row 1, tilt_boom_deg: 40 deg is outside the joint's range [-150.576, -1.504"
    ),
    table(row=ROW.replace("1000", "one metre")): (
        "row 1, lift_length_mm: 'one metre' is not allowed; give a number"
    ),
    table(row=ROW.replace("2.1", "-2.1")): (
        "row 1, frequency_hz: '-2.1' is not allowed; give a number in [1e-100, 1e+06]"
    ),
    table(row=ROW.replace("2.1", "inf")): "row 1, frequency_hz: 'inf' is not allowed",
    table("deviation_hz=0"): "row 1, deviation_hz: '0' is not allowed; give a number in [1e-100, ",
    table("deviation_hz=1e-320"): "row 1, deviation_hz: '1e-320' is not allowed",
    table(
        row=ROW.replace("full", "fulll")
    ): ': row 1, loader_crane: payload fulll: no such load case; did you mean "full"',
    table(row=ROW.replace("full", "-3")): ": row 1, loader_crane: payload: -3 kg is not allowed",
    table("mode=4"): "row 1, mode: 4 is not there; give 1 to 3",
    table("mode=1.5"): "row 1, mode: 1.5 is not there; give 1 to 3",
    table("lift_chambers=rod"): (
        'row 1, lift_chambers: "rod" is not known; give one of both, cap, annulus, stuck'
    ),
    table("lift_cap_bar=72", "pressure_deviation_bar=1"): (
        "row 1: lift_cap_bar without lift_annulus_bar; give both pressures, or neither"
    ),
    table("mode=1", "mode=1"): 'column "mode" is there twice; leave one out',
}


@pytest.fixture
def csv(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where measurements may stand: not in the folder that must stay empty."""
    return tmp_path_factory.mktemp("measured") / "measured.csv"


@pytest.mark.parametrize("text", BAD)
def test_bad_measurements_are_one_line(text: str, csv: Path, refused: Refused) -> None:
    csv.write_text(text, encoding="utf-8")
    refused(["calibrate", "loader_crane", str(csv), "--fit", BETA], BAD[text])


OPTIONS = {
    (): "--fit: names nothing",
    ("--fit", "fluid.bulk_modulus_mpa"): (
        'fit fluid.bulk_modulus_mpa: the machine file has no such number; did you mean "fluid.bul'
    ),
    ("--fit", "nonsense"): "the machine file has no such number",
    ("--fit", "cylinder.lift.barrel_wall_mm"): (
        "fit cylinder.lift.barrel_wall_mm: has no value in the file; write one first: a number in"
    ),
    ("--fit", "name"): "fit name: is no number that can vary; name one such as",
    ("--fit", "cylinder.lift.count"): "fit cylinder.lift.count: is no number that can vary",
    ("--fit", "cylinder.lift.base.at_mm"): "is a list of 3 numbers; name one of its numbers",
    ("--fit", "cylinder.lift"): "is a table; name one of its numbers, such as",
    ("--fit", f"{BETA},{BETA}"): f"fit {BETA}: is there twice; leave one out",
    ("--fit", f"{BETA},{LIFT}"): (
        "fit: 2 unknowns, but 1 measured value; fit fewer, measure more poses, or give priors"
    ),
    ("--fit", BETA, "--prior", "fluid"): '--prior: "fluid" is not understood; give PATH=VALUE:',
    ("--fit", BETA, "--prior", f"{AIR}=1:1"): f"prior {AIR}: is not fitted",
    ("--fit", BETA, "--prior", f"{BETA}=1:1,{BETA}=2:1"): f"--prior: {BETA} is there twice",
    ("--fit", BETA, "--prior", f"{BETA}=1200:0"): "1200 ± 0; give a number in (0, 10000] MPa",
}


@pytest.mark.parametrize("options", OPTIONS)
def test_bad_unknowns_are_one_line(options: tuple[str, ...], csv: Path, refused: Refused) -> None:
    csv.write_text(table(), encoding="utf-8")
    refused(["calibrate", "loader_crane", str(csv), *options], OPTIONS[options])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda path: path.mkdir(), "cannot be read"),
        (lambda path: path.write_bytes(b"\xff\xfe\x00"), "is not UTF-8 text"),
        (lambda path: None, "cannot be read (No such file or directory)"),
    ],
)
def test_a_file_that_cannot_be_read(
    make: Callable[[Path], object], message: str, tmp_path: Path
) -> None:
    path = tmp_path / "measured.csv"
    make(path)
    with pytest.raises(ad.ArmDesignError) as caught:
        read_measured(path, crane())
    assert message in str(caught.value)


def test_comments_and_blank_lines_are_no_rows(tmp_path: Path) -> None:
    path = tmp_path / "measured.csv"
    path.write_text(f"# from a test\n\n{table('mode=1')}\n", encoding="utf-8")
    measured = read_measured(path, crane())
    assert len(measured) == 1
    assert measured.payloads == ("full",)


@pytest.mark.parametrize("blank", ["", " ", "nan", "NaN", "NAN"])
def test_a_blank_is_nan_in_any_case(blank: str, csv: Path) -> None:
    """As in recordings; "NaN" was refused."""
    csv.write_text(table(f"deviation_hz={blank}"), encoding="utf-8")
    assert read_measured(csv, crane()).deviations == pytest.approx([0.021])  # 1 %


def test_an_inclinometer_is_warned_of_and_a_typing_error_told() -> None:
    machine = crane()
    tilts = dict.fromkeys(("lift_inclinometer_deg", "boom_incl_deg"), 3.0)
    rows = measurements(machine, poses(2), **tilts, lift_presure_bar=1.0)
    words = " ".join(measured_of(rows.to_dict("records"), machine).warnings)
    for name in tilts:
        assert f'"{name}" is not used: an inclinometer on a moving machine feels' in words
    assert '"lift_presure_bar" is not used' in words
    calibration = ad.calibrate(machine, rows, [BETA])
    assert any("inclinometer" in line for line in calibration.findings)


def test_columns_of_springs_are_no_typing_errors() -> None:
    """``identify --machine`` writes them; "did you mean" put the carriage's angle in a joint's."""
    machine = rocking()
    row = {
        "payload": "full",
        "boom_deg": 10,
        "stick_deg": -60,
        "bucket_deg": 0,
        "rocking_deg": 0.1,
    }
    measured = measured_of([{**row, "frequency_hz": 1.1, "rockin_deg": 0.1}], machine)
    assert len([one for one in measured.warnings if "rockin" in one]) == 1


def test_columns_that_there_may_be_are_told_in_order() -> None:
    """Before, in the order of a set: another one in every process."""
    machine = crane()
    rows = measurements(machine, poses(2), zzz=1.0)
    (line,) = (w for w in measured_of(rows.to_dict("records"), machine).warnings if "zzz" in w)
    columns = line.partition("choose from: ")[2].split(", ")
    joints = [f"{joint.name}_{'deg' if joint.revolute else 'mm'}" for joint in machine.arm.joints]
    assert [name for name in columns if name in joints] == joints
    assert columns.index("payload") < columns.index("lift_cap_bar") < columns.index("begin_s")


def test_a_pressure_alone_is_not_used_and_said() -> None:
    machine = crane()
    rows = measurements(machine, poses(2), lift_cap_bar=72.0)
    measured = measured_of(rows.to_dict("records"), machine)
    assert np.isnan(measured.pressures).all()
    assert "lift: one chamber's pressure without the other's is not used" in measured.warnings


def test_frequencies_without_deviations_count_as_known_to_a_hundredth() -> None:
    machine = crane()
    rows = measurements(machine, poses(2)).drop(columns="deviation_hz")
    measured = measured_of(rows.to_dict("records"), machine)
    assert measured.deviations == pytest.approx(0.01 * measured.frequencies)
    assert any("count as known to 1%" in line for line in measured.warnings)


def test_two_frequencies_of_one_mode_are_warned_of() -> None:
    """Both modes of one window, without their column; and repeated measurements with noise."""
    machine = crane()
    rows = measurements(machine, poses(1)).to_dict("records") * 2
    rows[1] = {**rows[1], "frequency_hz": 2 * rows[0]["frequency_hz"], "begin_s": 3.0}
    (line,) = measured_of(rows, machine).warnings
    assert line.startswith("rows 1 and 2 are of one pose, load case and mode, but of ")
    told = [{**row, "mode": n} for n, row in enumerate(rows, 1)]
    again = measurements(machine, np.repeat(poses(1), 8, axis=0), noise=0.01).to_dict("records")
    for good in (told, again):
        assert measured_of(good, machine).warnings == ()
