"""Every public function shows an example in its docstring, and it runs as printed."""

from __future__ import annotations

import doctest
import inspect
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import armdesign as ad


def functions() -> Iterator[tuple[str, Any]]:
    """Public functions, and the public ones of public modules, by name."""
    for name in ad.__all__:
        public = getattr(ad, name)
        if inspect.isfunction(public):
            yield name, public
        elif inspect.ismodule(public):
            for inner, function in vars(public).items():
                own = inspect.isfunction(function) and function.__module__.startswith("armdesign.")
                if own and not inner.startswith("_"):
                    yield f"{name}.{inner}", function


def methods() -> Iterator[doctest.DocTest]:
    """Examples in docstrings of public classes."""
    for name in ad.__all__:
        public = getattr(ad, name)
        if inspect.isclass(public):
            finder = doctest.DocTestFinder()
            yield from (one for one in finder.find(public, name, globs={}) if one.examples)


PUBLIC = dict(functions())
METHODS = {one.name: one for one in methods()}
LONG = ("steps", "plan_move")  # they search, or plan and simulate


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.slow if n in LONG else ()) for n in PUBLIC]
)
def test_its_example_runs(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    examples = doctest.DocTestFinder(recurse=False).find(PUBLIC[name], name, globs={})
    assert examples, f"{name} shows no example"
    assert examples[0].examples, f"{name} shows no example"
    result = doctest.DocTestRunner().run(examples[0])
    assert result.failed == 0


@pytest.mark.parametrize("name", METHODS)
def test_examples_of_methods_run(name: str) -> None:
    """One printed 2.222 Hz long after the 20 t machine had come to yield: 1.955 Hz."""
    assert doctest.DocTestRunner().run(METHODS[name]).failed == 0
