"""What a second worker gains on 200 maps and on 24 designs, against one in the same run.

One worker is this process, two are processes of their own, whose first cases, while they start,
are left out. ``python -m benchmarks.sweep`` takes some minutes on two idle cores, tells on
stderr how far it is, prints a table and writes it beside, as JSON. On busy cores it says nothing.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

import pandas as pd

import armdesign as ad

OUT = Path("out") / "benchmarks"
JOBS: dict[str, tuple[int, dict[str, Any]]] = {
    "map": (200, {"machine": "excavator_20t", "points": 9}),
    "design": (24, {"machine": "paper_1dof", "points": 9}),
}


def seconds(task: str, count: int, arguments: dict[str, Any], workers: int) -> float:
    """Seconds between the first and the last answer, over the share of cases between them."""
    changes = {"fluid.bulk_modulus_MPa": [900.0 + n for n in range(count)]}
    moments: list[float] = []

    def say(words: str) -> None:
        moments.append(time.perf_counter())
        print(f"\r{task}, {workers} of 2 workers: {words} ", end="", file=sys.stderr, flush=True)

    answers = ad.sweep(changes=changes, task=task, workers=workers, say=say, **arguments)
    print(file=sys.stderr)
    assert not answers.failures
    first = 2 * workers  # the first ones start the processes and load what they need
    return (moments[-1] - moments[first - 1]) * count / (count - first)


def run(fast: bool = False) -> pd.DataFrame:
    """Seconds of one and two workers for each task, and their ratio; ``fast``: few cases."""
    rows = []
    for task, (count, arguments) in JOBS.items():
        cases = 8 if fast else count
        one, two = (seconds(task, cases, arguments, workers) for workers in (1, 2))
        rows.append({"task": task, "cases": cases, "one_s": one, "two_s": two, "gain": one / two})
    return pd.DataFrame(rows)


def main() -> None:
    """Print the table and write it."""
    table = run("--fast" in sys.argv)
    print(table.to_string(index=False, float_format="{:.2f}".format))
    OUT.mkdir(parents=True, exist_ok=True)
    (OUT / "sweep.json").write_text(json.dumps(table.to_dict("records"), indent=2))


if __name__ == "__main__":
    main()
