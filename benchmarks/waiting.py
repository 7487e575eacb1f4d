"""How long people wait: commands beside their targets, each in a process of its own on one core.

Run on an otherwise idle machine: ``python -m benchmarks.waiting``. It prints a table and writes it
to ``out/benchmarks/waiting.json``. Seconds are the shortest of some runs, after one by which
bytecode and compiled kernels are kept; before ``cold`` ones no kernels are. A machine's own speed
is in all of them: ``starts`` are seconds over those in which Python starts and imports NumPy,
SciPy's optimisers and Matplotlib, in the same run.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

OUT = Path("out") / "benchmarks"
TIMES = 3
ARMDESIGN = "-m", "armdesign"
START = "-c", "import numpy, scipy.optimize, matplotlib.figure"


@dataclass(frozen=True)
class Wait:
    """A command, the seconds that it may take on a quick machine, and its exit code."""

    words: tuple[str, ...]
    target: float
    ends: int = 0
    cold: bool = False


WAITS = {
    "import armdesign": Wait(("-c", "import armdesign"), 0.5),
    "--help": Wait((*ARMDESIGN, "--help"), 0.5),
    "map": Wait((*ARMDESIGN, "map", "excavator_20t"), 2),
    "four-bars that weigh": Wait(
        (*ARMDESIGN, "optimize", "loader_crane", "--vary", "linkages", "--points", "5"), 8
    ),
    "conflict": Wait(
        (*ARMDESIGN, "optimize", "excavator_20t", "--set", "requirements.oil_total_share=0.7"),
        target=5,
        ends=2,
    ),
    "design": Wait((*ARMDESIGN, "design", "excavator_20t"), 15),
    "design, cold": Wait((*ARMDESIGN, "design", "excavator_20t"), 25, cold=True),
}


def seconds_of(wait: Wait) -> float:
    """Shortest wall time of a command [s], whose files go to a folder that is deleted."""
    surroundings = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    shortest = float("inf")
    for number in range(TIMES + (not wait.cold)):
        with tempfile.TemporaryDirectory() as folder:
            kernels = {"NUMBA_CACHE_DIR": f"{folder}/kernels"} if wait.cold else {}
            start = time.perf_counter()
            run = subprocess.run(
                [sys.executable, *wait.words],
                cwd=folder,
                env=surroundings | kernels,
                capture_output=True,
                text=True,
                check=False,
            )
            if wait.cold or number:
                shortest = min(shortest, time.perf_counter() - start)
        if run.returncode != wait.ends:
            raise SystemExit(f"{' '.join(wait.words)}: {run.stderr}")
    return shortest


def table(names: list[str]) -> pd.DataFrame:
    """A row for every command: seconds, target, whether it is reached, and starts."""
    start, rows = seconds_of(Wait(START, 0)), []
    for name in names:
        seconds, target = seconds_of(WAITS[name]), WAITS[name].target
        rows.append((name, seconds, target, seconds <= target, seconds / start))
        print(f"{name}: {seconds:.2f} s", file=sys.stderr)
    return pd.DataFrame(rows, columns=["command", "seconds", "target", "reached", "starts"])


def main() -> None:
    """Measure, print and write."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    measured = table(sys.argv[1:] or list(WAITS))
    print(measured.to_string(index=False, float_format="{:.2f}".format))
    OUT.mkdir(parents=True, exist_ok=True)
    (OUT / "waiting.json").write_text(json.dumps(measured.to_dict("records"), indent=2) + "\n")


if __name__ == "__main__":
    main()
