"""Identity of a user's function: whatever changes its answer changes it."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

import armdesign as ad
from armdesign.sweeps.reach import identity_of_function

HELPER = "K = 2.0\n\n\ndef scaled(x):\n    return K * x\n\n\nclass Law:\n    n = 3\n"
TASK = """
import functools
import math

import reached_helper
import tomlkit

import armdesign as ad
from reached_helper import Law

FACTOR = 2.0
TABLE = tomlkit.parse("plus = [1, 2]")
WORKSPACE = ad.Workspace.grid(ad.load("paper_1dof"), points=3)


@functools.lru_cache
def inner(x, plus=1):
    return x + plus


def power(x, n):
    return x**n


cubed = functools.partial(power, n=3)


def task(machine, workspace, share=0.5):
    assert workspace is not WORKSPACE
    law = TABLE["plus"][0] + inner(FACTOR) + Law.n + cubed(reached_helper.scaled(share))
    return {"x": law + math.pi}
"""
Loaded = Callable[..., Any]


@pytest.fixture
def loaded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Loaded]:
    """Gives the task of ``TASK``, with words of it or of its helper changed."""
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    names = "reached_helper", "reached_task"

    def load(old: str = "", new: str = "") -> Any:
        for name, text in zip(names, (HELPER, TASK), strict=True):
            assert not old or old in HELPER + TASK
            (tmp_path / f"{name}.py").write_text(text.replace(old, new) if old else text)
            sys.modules.pop(name, None)
        importlib.invalidate_caches()
        return importlib.import_module("reached_task").task

    yield load
    for name in names:
        sys.modules.pop(name, None)


def test_it_is_the_same_for_the_same_code(loaded: Loaded) -> None:
    first = identity_of_function(loaded())
    assert identity_of_function(loaded()) == first
    assert identity_of_function(loaded("import math\n", "import math\n\n# a remark\n")) == first


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("K = 2.0", "K = 3.0"),
        ("return K * x", "return K + x"),
        ("n = 3", "n = 4"),
        ("FACTOR = 2.0", "FACTOR = 2.5"),
        ("plus=1", "plus=2"),
        ("n=3", "n=2"),
        ("plus = [1, 2]", "plus = [2, 2]"),
        ("points=3", "points=4"),
        ("x**n", "x*n"),
        ("share=0.5", "share=0.25"),
        ("x + plus", "x - plus"),
        ("math.pi", "math.e"),
        ('"x":', '"y":'),
    ],
)
def test_whatever_it_reaches_changes_it(loaded: Loaded, old: str, new: str) -> None:
    assert identity_of_function(loaded()) != identity_of_function(loaded(old, new))


def test_functions_of_one_name_are_apart() -> None:
    one, other = (lambda machine, workspace: {"x": 1.0}), (lambda machine, workspace: {"x": 2.0})
    assert identity_of_function(one) != identity_of_function(other)


def test_a_file_edited_after_it_was_loaded_decides_nothing(loaded: Loaded, tmp_path: Path) -> None:
    task = loaded()
    before = identity_of_function(task)
    (tmp_path / "reached_task.py").write_text(TASK.replace("FACTOR = 2.0", "FACTOR = 9.0"))
    assert identity_of_function(task) == before


def test_what_cannot_be_written_down_is_refused_beside_a_journal_alone(tmp_path: Path) -> None:
    held = object()
    source = "def task(machine, workspace):\n    return {'x': id(thing)}\n"
    space: dict[str, Any] = {"thing": held, "__name__": "__main__"}
    exec(source, space)  # as typed at a prompt: there is no file
    words = {"machine": "paper_1dof", "task": space["task"], "points": 3}
    assert ad.sweep(**words).frame["x"].tolist() == [id(held)]
    with pytest.raises(ad.ArmDesignError, match='reads "thing", a object that cannot be written'):
        ad.sweep(**words, journal=tmp_path / "j.sqlite")
    space["thing"] = 5
    assert ad.sweep(**words, journal=tmp_path / "j.sqlite").kept == 0
    assert ad.sweep(**words, journal=tmp_path / "j.sqlite").kept == 1
    closure = {**words, "task": lambda machine, workspace: {"x": id(held)}}
    assert ad.sweep(**closure).frame["x"].tolist() == [id(held)]
    with pytest.raises(ad.ArmDesignError, match="holds values that its source does not show"):
        ad.sweep(**closure, journal=tmp_path / "k.sqlite")
