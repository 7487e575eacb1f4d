"""Any study file: answered, or refused in one line; what is wrong with a case is in its row.

Ten minutes of it by the command in CONTRIBUTING.md.
"""

from __future__ import annotations

import io
import json
import re
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import tomlkit
from hypothesis import example, given, settings
from hypothesis import strategies as st

from tests.checks import no_longer_than
from tests.commands import spoken

SECONDS = 60  # of processor time
PATHS = (
    *("fluid.bulk_modulus_MPa", "cylinder.lift.bore_mm", "cylinder.lift.base.at_mm", "name"),
    *("payload.load.mass_kg", "requirements.end_margin", "cylinder.lift", "x.y", "", "=1+1"),
)
NUMBERS = st.sampled_from([0, -1, 3, 900, 1000, 10**20, 10**400, 0.05, 1e300, -0.0])
PLAIN = (
    NUMBERS
    | st.sampled_from([float("nan"), float("inf"), True, False])
    | st.sampled_from(["", "=1+1", "paper_1dof", "load", "map", "1", "\x1b[31m", "ä\n"])
    | st.dates()
)
VALUES = st.recursive(
    PLAIN,
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.sampled_from(["a", "damping", "points"]), inner, max_size=2)
    ),
    max_leaves=4,
)
GRIDS = st.dictionaries(st.sampled_from(PATHS), st.lists(VALUES, max_size=2) | VALUES, max_size=2)


def mostly(value: Any) -> st.SearchStrategy[Any]:
    """A right value, and any now and then."""
    return st.one_of(*[st.just(value)] * 4, VALUES)


STUDIES = st.fixed_dictionaries(
    {"machine": mostly("paper_1dof"), "points": mostly(3)},
    optional={
        "task": st.sampled_from(["map", "control", "simulate", "x"]) | VALUES,
        "payloads": mostly(["load"]),
        "outputs": mostly(["worst_hz"]),
        "options": VALUES,
        "requirements": st.lists(st.dictionaries(st.just("end_margin"), VALUES), max_size=2),
        "grid": GRIDS,
        "case": st.lists(GRIDS, max_size=3),
        "sobol": st.fixed_dictionaries(
            {"count": mostly(2), "ranges": GRIDS}, optional={"seed": VALUES}
        ),
    },
)


def answered(study: dict[str, Any], folder: Path) -> tuple[int, str, str]:
    """Exit code, output and errors of a study, which has two files at most."""
    path, out, err = folder / "study.toml", io.StringIO(), io.StringIO()
    path.write_text(tomlkit.dumps(study), encoding="utf-8")
    words = ["sweep", str(path), "--out", str(folder / "out"), "--json", "--workers", "1"]
    with no_longer_than(SECONDS):
        code = spoken(words, out, err)
    return code, out.getvalue(), err.getvalue()


def judge(study: dict[str, Any]) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        code, out, err = answered(study, folder)
        if code:
            assert code == 2, study
            assert err.startswith("armdesign: "), err
            assert err.count("\n") == 1, err
            assert err.rstrip("\n").isprintable(), err
        else:
            assert err == "", err
        if not (folder / "out" / "sweep.csv").exists():
            assert code, study
            return
        table = pd.read_csv(folder / "out" / "sweep.csv")
        assert len(table) == len(json.loads(out)["tables"]["sweep"])
        assert len(table) == len(pd.read_parquet(folder / "out" / "sweep.parquet"))
        foreign = [words for words in table["error"].dropna() if re.match(r"\w+Error\b", words)]
        assert not foreign, foreign


def all_of(test: Callable[..., None]) -> Callable[..., None]:
    """What once was a foreign exception is tried first."""
    for values in ([[900], [1000]], [900, 10**20], [10**400], [{"a": 1}]):
        grid = {"fluid.bulk_modulus_MPa": values}
        test = example(study={"machine": "paper_1dof", "points": 3, "grid": grid})(test)
    return test


@all_of
@given(study=STUDIES)
@settings(max_examples=10)
def test_any_study(study: dict[str, Any]) -> None:
    judge(study)


@pytest.mark.slow
@given(study=STUDIES)
@settings(max_examples=settings.default.max_examples)
def test_any_study_for_longer(study: dict[str, Any]) -> None:
    judge(study)
