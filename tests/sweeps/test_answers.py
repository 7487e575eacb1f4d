"""Columns of a sweep's frame: what has the name of another is told apart, whatever ran before."""

from __future__ import annotations

from itertools import permutations
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

import armdesign as ad

BORE, MODULUS = "cylinder.lift.bore_mm", "fluid.bulk_modulus_MPa"
OTHERS = "answer {}: is the name of another column; give it another name"


def sizes(machine: ad.Machine, _: ad.Workspace, n: int = 0, k: int = 0) -> dict[str, float]:
    """A task whose answers have names that changes and options may have, too."""
    return {BORE: machine.section.cylinder["lift"].bore_mm, "k": n + 10 * k}


@pytest.mark.parametrize(
    ("given", "sets", "name", "alone"),
    [
        ("changes", [{MODULUS: 900}, {BORE: 70}], BORE, {BORE: 63.0, "k": 0}),
        ("options", [{"n": 1}, {"k": 2}], "k", {BORE: 63.0, "k": 1}),
    ],
)
def test_no_order_of_runs_decides_which_answers_there_are(
    given: str, sets: list[dict[str, Any]], name: str, alone: dict[str, float], tmp_path: Path
) -> None:
    """The other cases give a frame its columns; a case that met one of them failed for good."""
    how: dict[str, Any] = {"machine": "paper_1dof", "task": sizes, "points": 2}
    runs: list[dict[str, Any]] = [{**how, given: some} for some in (sets, sets[:1], sets[1:])]
    undisturbed = [ad.sweep(**run).frame.drop(columns="seconds") for run in runs]
    assert undisturbed[0]["error"].tolist() == 2 * [OTHERS.format(name)]
    assert undisturbed[1].iloc[0][["error", *alone]].tolist() == ["", *alone.values()]
    assert undisturbed[2]["error"].tolist() == [OTHERS.format(name)]
    for order in permutations(range(3)):
        journal = tmp_path / f"{order}.sqlite"
        for k in order:
            answers = ad.sweep(**runs[k], journal=journal)
            pd.testing.assert_frame_equal(answers.frame.drop(columns="seconds"), undisturbed[k])
        assert answers.kept == len(answers.cases)


@pytest.mark.parametrize("stroke", [300.0, -5.0])
@pytest.mark.parametrize("name", ["machine", "error", "cylinder.lift.stroke_mm", "damping"])
def test_columns_of_every_frame_are_no_outputs(name: str, stroke: float, tmp_path: Path) -> None:
    """Where no case had an answer, they were emptied and moved; with one they were refused."""
    how: dict[str, Any] = {"task": "control", "options": [{"damping": 0.1}], "points": 2}
    how |= {"journal": tmp_path / "j.sqlite", "outputs": ["delay", name]}
    with pytest.raises(ad.ArmDesignError, match=f"outputs: '{name}' is a column of the frame"):
        ad.sweep("paper_1dof", {"cylinder.lift.stroke_mm": [stroke]}, **how)
    assert not (tmp_path / "j.sqlite").exists()
