"""The README does what it says; ``test_pages.py`` runs its blocks as other pages'."""

from __future__ import annotations

import ast
import json
import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import armdesign as ad
from armdesign.design.design import Design
from armdesign.design.requirements.performance import torque_shares
from armdesign.output_reports import write_report
from armdesign.report.lift_charts import lift_columns
from armdesign.report.provenance import Origin
from armdesign.simulation.validation import validate_maps
from armdesign.units import WORKSHOP

ROOT = Path(__file__).parents[1]
STUDY = re.compile(r"^\| \[(\d\d)\]\((?:\.\./)?studies/(\S+\.py)\) .*\| (.*) \|$", re.M)


def page(name: str) -> str:
    """A file's text; links are those of the root."""
    return (ROOT / name).read_text(encoding="utf-8").replace("](../", "](")


README = page("README.md")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.S)


@cache
def main_job() -> Design:
    return ad.optimize(ad.load("excavator_20t"))


@pytest.mark.slow
def test_the_first_answer_is_of_this_version() -> None:
    """New machine, gain at the file's values and within the bands, sizes, and what they cost."""
    design = main_job()
    today, new = design.before.worst.frequency, design.after.worst.frequency
    real = max(design.starts) / design.problem.dynamics.corners.nominal
    boom = design.machine.cylinders[0]
    printed = " ".join(README.split())
    lifts = [ad.lift_chart(design.today)]
    lifts.append(ad.lift_chart(design.machine, lifts[0]))
    frame = lift_columns(dict(zip("ab", lifts, strict=True)))
    low = (frame["height_m"] < 0.5) & (frame["reach_m"] < 4)  # near the tracks
    least = frame["ratio"].round(2) <= 0.9
    torques = torque_shares(design.machine, design.today).values()
    for words in (
        f"lift chart keeps {100 * frame['ratio'].min():.0f} % at {least.sum()} places",
        f"gains up to {100 * (frame['ratio'].max() - 1):.0f} % above",
        f"torques are {100 * np.min([*torques]):.0f} to {100 * np.max([*torques]):.0f} %",
        f"new {new:.3f} Hz boom",
        f"gain {100 * (new / today - 1):+.1f} %",
        f"buildable {100 * design.least_gain:+.1f} %, in real numbers {100 * (real - 1):+.1f} %",
        f"→ new 2 × {1000 * boom.bore:.1f} {1000 * boom.rod:.1f} {1000 * boom.stroke:.1f}",
    ):
        assert words.replace(" 2 places", " two places") in printed
    assert low[least].all()


@pytest.mark.slow
def test_its_report_is_one_file_of_at_most_2_mb(tmp_path: Path) -> None:
    """At most 1.3 MB even: machines with more joints and parts need more than this one."""
    design = main_job()
    runs = validate_maps([design.before, design.after])
    proofs = dict(zip(("today", "new"), runs, strict=True))
    origin = Origin.begin("armdesign design excavator_20t", {})
    write_report(design, proofs, origin, tmp_path, WORKSHOP)
    assert (tmp_path / "report.html").stat().st_size <= 1.3e6


def test_two_commands_do_all_the_set_up() -> None:
    commands = [line for block in blocks("sh") for line in block.splitlines() if "-m venv" in line]
    assert len(commands) == 2
    assert "armdesign design excavator_20t" in commands[0]
    assert "pytest" in commands[1]


SAME = {  # rows of docs/validation.json, which a test computes afresh, by rows of the README
    "mass on a 4/2.5/12 in cylinder, 1000 lb": ["mass on a 4/2.5/12 in cylinder, 1000 lb"],
    "worst pose of the 20 t machine; with rigid structure": [
        "worst pose of the 20 t machine",
        "the same with rigid structure",
    ],
    "digging forces of the 20 t machine": ["digging forces of the 20 t machine"],
    "measured: PATU 655, six poses": [
        "measured crane, data sheet alone: error",
        "measured crane, one number fitted: error",
        "measured crane, two numbers fitted: error",
    ],
}


def numbers(text: str, sign: str = "[-+]?") -> list[str]:
    return re.findall(rf"{sign}\d+(?:\.\d+)?", text.replace("−", "-"))


@pytest.mark.parametrize("name", SAME)
def test_its_validation_is_that_of_the_documentation(name: str) -> None:
    """To the digits that it states."""
    computed = {row[0]: row[3] for row in json.loads(page("docs/validation.json"))}
    (row,) = (line for line in README.splitlines() if line.startswith(f"| {name} |"))
    shown = numbers(row.split(" | ")[3])
    exact = [float(value) for one in SAME[name] for value in numbers(computed[one])]
    assert len(shown) == len(exact)
    for text, value in zip(shown, exact, strict=True):
        digits = len(text.partition(".")[2])
        assert float(text) == round(value, digits)


HELD = {  # what a row says, by the words with which the test that it names holds it
    "one joint, 8 masses × 5 lengths": "1e-8",
    "K at every pose": "1e-8",
    "worst pose of the new 20 t machine, made for rigid structure": "rel=1e-5",
    "nonlinear simulation, worst poses": '["deviation"].abs().max() < 1e-3',
    "nonlinear closed loops, 20 random poses of each machine and of the calibrated crane": (
        "nonlinear == pytest.approx(predicted, rel=0.1)"
    ),
    "the paper's mechanism, 40 configurations, small sweeps": "off.max() <= float(headline[3])",
    "natural frequencies of 8 machines": "rtol=1e-9",
    "free vibration, 1-DoF and 3-DoF; four-bar as a closed loop": '("direct_bucket", 1e-5)',
    "valve-driven motion": '("q", 1e-6)',
    "upper bound for pins and areas": "max([*reached, hertz(search.squared)]) <= bound",
}


def rows_of(table: str) -> dict[str, str]:
    rows = [line for line in table.splitlines() if line.startswith("| ")][1:]
    return {line.split(" | ")[0].removeprefix("| "): line for line in rows}


def test_every_row_of_its_validation_is_held_by_a_test() -> None:
    """Computed afresh for the documentation, or asserted in the test that the row names."""
    rows = rows_of(README.partition("## Validation")[2].partition("```")[0])
    documented = rows_of(page("docs/validation.md"))
    assert set(documented) == HELD.keys()
    assert set(rows) <= SAME.keys() | HELD.keys()
    for name, words in HELD.items():
        (file,) = re.findall(r"\]\((tests/[^)]+)\)", documented[name])
        assert words in page(file), name
        assert rows.get(name, documented[name]) == documented[name]


def test_answers_of_studies_are_those_of_the_studies() -> None:
    """Numbers of the documentation stand in a study's own words, which its test holds; numbers of
    the README in the documentation.
    """
    answers = {}
    for number, file, answer in STUDY.findall(page("docs/studies.md")):
        study = ast.get_docstring(ast.parse(page(f"studies/{file}"))) or ""
        assert {*numbers(answer, "")} <= {*numbers(study, "")}, file
        answers[number] = answer
    assert len(answers) == len([*(ROOT / "studies").glob("[0-9]*.py")])
    told = STUDY.findall(README)
    assert told
    for number, file, answer in told:
        assert {*numbers(answer)} <= {*numbers(answers[number])}, file


def test_files_it_names_exist() -> None:
    for name in re.findall(r"\]\(((?!http)[^)#]+)\)", README):
        assert (ROOT / name).exists(), name
