"""The command line in this process, and how it refuses."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from typing import TypeAlias

import pytest

from armdesign import cli

Refused: TypeAlias = Callable[[Sequence[str], str], None]


def main(words: Sequence[str], monkeypatch: pytest.MonkeyPatch) -> int:
    """The entry point in this process: its exit code."""
    monkeypatch.setattr(sys, "argv", ["armdesign", *words])
    with pytest.raises(SystemExit) as caught:
        cli.main()
    return int(caught.value.code or 0)


def assert_one_line(text: str, message: str) -> None:
    assert text.count("\n") == 1, text
    assert text.startswith("armdesign: ")
    assert message in text
    assert "Traceback" not in text
