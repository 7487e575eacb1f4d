"""``--json``: one document on stdout, whatever the end of the command is, as its schema says."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import jsonschema
import pandas as pd
import pytest

import armdesign as ad
from armdesign.json_document import schema
from armdesign.sweeps.numbers import MEANINGS
from tests.commands import main

SHIPPED = Path(ad.__file__).with_name("answer.schema.json")
FAMILIES = [re.sub(r"<.*?>", ".+", name) for name in MEANINGS if "<" in name]


@pytest.fixture
def document_of(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> Any:
    """The document of a command, which the schema allows."""
    monkeypatch.chdir(tmp_path)

    def document(*words: str, code: int = 0) -> dict[str, Any]:
        assert main([*words, "--json"], monkeypatch) == code
        answer: dict[str, Any] = json.loads(capsys.readouterr().out)
        jsonschema.validate(answer, json.loads(schema()))
        assert answer["finished"] == (code == 0)
        assert answer["command_line"] == " ".join(["armdesign", *words, "--json"])
        return answer

    return document


def test_schema_is_shipped() -> None:
    """Else write it again: open("armdesign/answer.schema.json", "w").write(schema())."""
    assert SHIPPED.read_text(encoding="utf-8") == schema()
    jsonschema.Draft202012Validator.check_schema(json.loads(schema()))


@pytest.mark.slow
def test_a_map_comes_down_to_numbers(document_of: Any) -> None:
    answer = document_of("map", "paper_1dof", "--points", "5")
    frequencies = ad.frequency_map(machine := ad.load("paper_1dof"), ad.Workspace.grid(machine, 5))
    assert answer["numbers"]["worst_hz"] == pytest.approx(frequencies.worst.frequency, rel=1e-8)
    assert answer["numbers"]["boom_at_worst"] == pytest.approx(frequencies.worst.q[0], rel=1e-8)
    folder = Path(answer["folder"])
    assert {folder / name for name in answer["files"]} == set(folder.iterdir())
    assert "Lowest coupled frequency at the poses of the workspace [Hz]" in {
        sheet["title"] for sheet in answer["sheets"]
    }


@pytest.mark.parametrize(
    "words",
    [
        pytest.param(
            ("optimize", "paper_1dof", "--points", "5", "--vary", "areas"), marks=pytest.mark.slow
        ),
        pytest.param(
            ("optimize", "paper_1dof", "--points", "3", "--least", "oil", "--frequency", "7.2"),
            marks=pytest.mark.slow,
        ),
        ("control", "paper_1dof", "--points", "3", "--damping", "0.02"),
    ],
    ids=lambda words: words[0],
)
def test_every_number_has_a_meaning(document_of: Any, words: tuple[str, ...]) -> None:
    numbers = document_of(*words)["numbers"]
    assert numbers
    for name in numbers:
        assert name in MEANINGS or any(re.fullmatch(one, name) for one in FAMILIES), name


@pytest.mark.slow
def test_the_bound_and_the_least_amount_are_numbers(document_of: Any) -> None:
    """What the sentence and the sheets say, and the machine that was written has."""
    words = ("--points", "3", "--vary", "areas", "--least", "oil", "--frequency", "7.2")
    answer = document_of("optimize", "paper_1dof", *words)
    numbers, written = answer["numbers"], ad.load(next(Path(answer["folder"]).glob("*.toml")))
    for one, name in ((ad.load("paper_1dof"), "amount_before"), (written, "amount_after")):
        oil = sum(c.bore_area * c.stroke for c in one.cylinders)
        assert numbers[name] == pytest.approx(oil, rel=1e-8)
        assert f"{1000 * oil:.3f}" in answer["sentences"][0]
    assert numbers["least_of"] == "oil"
    assert numbers["gap"] == pytest.approx(numbers["bound_hz"] / numbers["unrounded_hz"] - 1)
    bound = f"{numbers['bound_hz']:.3f} Hz (gap {100 * numbers['gap']:.1f} %)"
    assert bound in json.dumps(answer["sheets"])


def test_tables_are_those_of_the_files(document_of: Any) -> None:
    answer = document_of("sensitivity", "paper_1dof", "--points", "3")
    written = pd.read_csv(Path(answer["folder"], "sensitivity.csv"))
    numbers = pd.DataFrame(answer["tables"]["sensitivity"]).select_dtypes("number")
    assert list(answer["tables"]["sensitivity"][0]) == list(written)
    pd.testing.assert_frame_equal(numbers, written[numbers.columns], check_dtype=False, rtol=1e-8)


@pytest.mark.slow
def test_a_design_has_the_validations_of_both_machines(document_of: Any) -> None:
    answer = document_of("design", "paper_1dof", "--points", "3", "--starts", "1")
    rows = answer["tables"]["validation"]
    written = pd.read_csv(Path(answer["folder"], "validation.csv"))
    assert list(rows[0]) == list(written)
    assert [row["version"] for row in rows] == written["version"].tolist()
    assert {"today", "new"} == set(written["version"])
    numbers = pd.DataFrame(rows).select_dtypes("number")
    pd.testing.assert_frame_equal(numbers, written[numbers.columns], check_dtype=False, rtol=1e-8)


def test_faults_are_in_the_document(document_of: Any, tmp_path: Path) -> None:
    answer = document_of("map", "paper_1dof", "--set", "fluid.bulk=3", code=2)
    (fault,) = answer["faults"]
    assert fault["part"] == "--set fluid.bulk"
    assert "bulk_modulus_MPa" in fault["remedy"]
    text = ad.load("paper_1dof").text.replace("bore_mm = 63", "bore_mm = -63")
    (tmp_path / "wrong.toml").write_text(text)
    faults = document_of("check", "wrong.toml", "--allow-outside", code=2)["faults"]
    assert "wrong.toml: cylinder.lift.bore_mm" in {fault["part"] for fault in faults}
    assert all(fault["fault"] for fault in faults)


def test_what_is_missing_is_null(document_of: Any) -> None:
    """JSON has no NaN: strict readers refuse it."""
    study = 'machine = "paper_1dof"\npoints = 3\n[grid]\n"cylinder.lift.stroke_mm" = [200, -5]\n'
    Path("study.toml").write_text(study)
    rows = document_of("sweep", "study.toml", "--workers", "1")["tables"]["sweep"]
    assert rows[0]["worst_hz"] > 0
    assert rows[1]["worst_hz"] is None
    assert rows[1]["error"]
