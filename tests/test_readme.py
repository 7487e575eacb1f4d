"""The README does what it says; ``test_pages.py`` runs its blocks as other pages'."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

import armdesign as ad

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.S)


@pytest.mark.slow
def test_the_first_answer_is_of_this_version() -> None:
    """New machine, gain at the file's values and within the bands, sizes, and what they cost."""
    design = ad.optimize(ad.load("excavator_20t"))
    today, new = design.before.worst.frequency, design.after.worst.frequency
    real = max(design.starts) / design.problem.dynamics.corners.nominal
    boom = design.machine.cylinders[0]
    printed = " ".join(README.split())
    for words in (
        f"new {new:.3f} Hz boom",
        f"gain {100 * (new / today - 1):+.1f} %",
        f"buildable {100 * design.least_gain:+.1f} %, in real numbers {100 * (real - 1):+.1f} %",
        f"→ new 2 × {1000 * boom.bore:.1f} {1000 * boom.rod:.1f} {1000 * boom.stroke:.1f}",
    ):
        assert words in printed


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


def numbers(text: str) -> list[str]:
    return re.findall(r"[-+]?\d+(?:\.\d+)?", text.replace("−", "-"))


@pytest.mark.parametrize("name", SAME)
def test_its_validation_is_that_of_the_documentation(name: str) -> None:
    """To the digits that it states."""
    file = Path(__file__).parents[1] / "docs" / "validation.json"
    computed = {row[0]: row[3] for row in json.loads(file.read_text("utf-8"))}
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
    "the paper's mechanism, 40 configurations, small sweeps": "off.max() <= float(headline[3])",
    "natural frequencies of 8 machines": "rtol=1e-9",
    "free vibration, 1-DoF and 3-DoF; four-bar as a closed loop": '("direct_bucket", 1e-5)',
    "valve-driven motion": '("q", 1e-6)',
    "upper bound for pins and areas": "max([*reached, hertz(search.squared)]) <= bound",
}


def rows_of_validation() -> dict[str, str]:
    table = README.partition("## Validation")[2].partition("```")[0]
    rows = [line for line in table.splitlines() if line.startswith("| ")][1:]
    return {line.split(" | ")[0].removeprefix("| "): line for line in rows}


def test_every_row_of_its_validation_is_held_by_a_test() -> None:
    """Computed afresh for the documentation, or asserted in the test that the row names."""
    rows, root = rows_of_validation(), Path(__file__).parents[1]
    assert set(rows) == SAME.keys() | HELD.keys()
    documentation = (root / "docs" / "validation.md").read_text("utf-8").replace("](../", "](")
    for name, words in HELD.items():
        (file,) = re.findall(r"\]\((tests/[^)]+)\)", rows[name])
        assert words in (root / file).read_text("utf-8"), name
        assert rows[name] in documentation or name.startswith("nonlinear"), name


def test_files_it_names_exist() -> None:
    root = Path(__file__).parents[1]
    for name in re.findall(r"\]\(((?!http)[^)#]+)\)", README):
        assert (root / name).exists(), name
