"""The command line in this process or its own, and how it refuses."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TextIO, TypeAlias

import pytest

from armdesign import cli

Refused: TypeAlias = Callable[[Sequence[str], str], None]

# all take MACHINE, --out, --points and --units
COMMANDS = ["map", "optimize", "validate", "design"]


QUICK = {  # what each writes for the one-joint machine
    "map": {
        "map.csv",
        "stiffness.csv",
        "map_joints.png",
        "map_reach.png",
        "map_holding.png",
        "moment_arms.png",
        "lift_chart.csv",
        "lift_chart.png",
        "report.html",
        "report.json",
    },
    "sensitivity": {"sensitivity.csv", "sensitivity.png"},
}


ARMDESIGN = [sys.executable, "-m", "armdesign"]


def main(words: Sequence[str], monkeypatch: pytest.MonkeyPatch) -> int:
    """The entry point in this process: its exit code."""
    monkeypatch.setattr(sys, "argv", ["armdesign", *words])
    with pytest.raises(SystemExit) as caught:
        cli.main()
    return int(caught.value.code or 0)


def spoken(words: Sequence[str], out: TextIO, err: TextIO) -> int:
    """The same with its streams in hand, which may be one."""
    with (
        pytest.MonkeyPatch.context() as patch,
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        return main(words, patch)


def assert_one_line(text: str, message: str) -> None:
    assert text.count("\n") == 1, text
    assert text.startswith("armdesign: ")
    assert message in text
    assert "Traceback" not in text


def map_of(out: Path, points: str = "5") -> list[str]:
    """Words of a quick map."""
    return ["map", "paper_1dof", "--out", str(out), "--points", points]


def areas_of(machine: str, out: Path) -> list[str]:
    """Words of a quick search for areas."""
    return ["optimize", machine, "--vary", "areas", "--points", "3,3,5", "--out", str(out)]


def run(*words: str, folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*ARMDESIGN, *words],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
        env={**os.environ, "OMP_NUM_THREADS": "1", **environment},
    )
