"""Identity of a user's function: whatever changes its answer changes it."""

from __future__ import annotations

import functools
import importlib
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numba
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


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("def f(x): return x", "def f(*x): return x"),
        (
            "def f():\n    try: g(); g()\n    except ValueError: pass",
            "def f():\n    try: g()\n    except ValueError: pass\n    else: g()",
        ),
    ],
)
def test_functions_of_the_same_instructions_are_apart(one: str, other: str) -> None:
    found: list[Any] = []
    for text in (one, other):
        space: dict[str, Any] = {}
        exec(text, space)
        found.append((space["f"].__code__.co_code, identity_of_function(space["f"])))
    assert found[0][0] == found[1][0]
    assert found[0][1] != found[1][1]


def test_a_file_edited_after_it_was_loaded_decides_nothing(loaded: Loaded, tmp_path: Path) -> None:
    task = loaded()
    before = identity_of_function(task)
    (tmp_path / "reached_task.py").write_text(TASK.replace("FACTOR = 2.0", "FACTOR = 9.0"))
    assert identity_of_function(task) == before


def test_what_a_result_has_computed_of_itself_decides_nothing() -> None:
    machine = ad.load("paper_1dof")
    result = ad.frequency_map(machine, ad.Workspace.grid(machine, points=3))

    def task(machine: Any, workspace: Any) -> Any:
        return {"x": len(result.frame)}

    before = identity_of_function(task)
    assert "frame" not in vars(result)
    task(None, None)
    assert "frame" in vars(result)
    assert identity_of_function(task) == before


def test_what_numba_compiles_is_known_by_its_function() -> None:
    def identity(text: str) -> str:
        space: dict[str, Any] = {"njit": numba.njit}
        exec(f"{text}\ndef task(machine, workspace): return {{'x': f(1.0)}}\n", space)
        return identity_of_function(space["task"])

    first = identity("@njit\ndef f(x): return x\n")
    assert identity("@njit\ndef f(x): return x\n") == first
    assert identity("@njit\ndef f(x): return -x\n") != first
    assert identity("@njit(fastmath=True)\ndef f(x): return x\n") != first


def test_values_without_end_are_refused() -> None:
    deep: list[Any] = []
    for _ in range(100_000):
        deep = [deep]
    with pytest.raises(ad.ArmDesignError, match="values within values without end"):
        identity_of_function(lambda machine, workspace: {"x": len(deep)})
    while deep:  # else Python ends the whole chain at once
        deep = deep[0]


def test_chains_of_functions_may_be_long() -> None:
    space: dict[str, Any] = {"f0": 1}
    for k in range(1000):
        exec(f"def f{k + 1}(machine, workspace): return f{k}", space)
    first = identity_of_function(space["f1000"])
    space["f0"] = 2
    assert identity_of_function(space["f1000"]) != first


def test_a_file_may_have_the_name_of_an_installed_module() -> None:
    found = set()
    for number in "12":
        space: dict[str, Any] = {"__name__": "numpy"}
        exec(f"def task(machine, workspace): return {{'x': {number}}}", space)
        found.add(identity_of_function(space["task"]))
    assert len(found) == 2


class Own:
    """A task as a method, of an instance or of the class."""

    def __init__(self, x: float) -> None:
        self.x = x

    def method(self, machine: Any, workspace: Any) -> dict[str, float]:
        return {"x": self.x}

    @classmethod
    def of_class(cls, machine: Any, workspace: Any) -> dict[str, float]:
        return {"x": 1.0}


@functools.lru_cache
def remembered(machine: Any, workspace: Any) -> dict[str, float]:
    return {"x": 1.0}


def given(machine: Any, workspace: Any, x: float) -> dict[str, float]:
    return {"x": x}


def within(x: float) -> Any:
    return lambda machine, workspace: {"x": x}


@pytest.mark.parametrize(
    ("task", "other"),
    [
        (Own(1.0).method, Own(2.0).method),
        (Own.of_class, None),
        (functools.partial(given, x=1.0), functools.partial(given, x=2.0)),
        (remembered, None),
        (within(1.0), within(2.0)),
    ],
)
def test_whatever_can_be_called_is_a_task(tmp_path: Path, task: Any, other: Any) -> None:
    def asked(one: Any) -> ad.Sweep:
        return ad.sweep("paper_1dof", task=one, points=2, journal=tmp_path / "j.sqlite")

    assert [asked(task).kept, asked(task).kept] == [0, 1]
    if other:
        assert [asked(other).kept, *asked(other).frame["x"]] == [0, 2.0]


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
    lock = threading.Lock()
    closure = {**words, "task": lambda machine, workspace: {"x": id(lock)}}
    assert ad.sweep(**closure).frame["x"].tolist() == [id(lock)]
    with pytest.raises(ad.ArmDesignError, match='reads "lock", a lock that cannot be written'):
        ad.sweep(**closure, journal=tmp_path / "k.sqlite")
