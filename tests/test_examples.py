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


PUBLIC = dict(functions())
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
