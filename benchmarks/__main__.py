"""The regression gate: counts of every job beside those that were agreed, and processor seconds.

``python -m benchmarks`` prints a table and writes it to ``out/benchmarks/gate.json``; it ends with
1 where a count has grown by more than ``ALLOWED``. ``--agree`` makes today's counts the agreed
ones, in ``agreed_counts.json`` beside this file. Seconds are for the reader: none is judged.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import pandas as pd

from benchmarks.counts import counting
from benchmarks.jobs import JOBS

OUT = Path("out") / "benchmarks"
AGREED = Path(__file__).with_name("agreed_counts.json")
ALLOWED = 1.1  # times the agreed count


def table(names: list[str] | None = None) -> pd.DataFrame:
    """A row for every job and count: now, agreed, their ratio, and the job's processor seconds."""
    agreed, rows = json.loads(AGREED.read_text()) if AGREED.exists() else {}, []
    for name in names or JOBS:
        start = time.process_time()
        with counting() as counts:
            JOBS[name]()
        seconds = time.process_time() - start
        for what, now in sorted(counts.items()):
            before = agreed.get(name, {}).get(what, 0)
            ratio = now / before if before else float("inf")
            rows.append((name, what, now, before, ratio, seconds))
    return pd.DataFrame(rows, columns=["job", "count", "now", "agreed", "ratio", "seconds"])


def main() -> None:
    """Measure, print, write, and judge."""
    measured = table()
    print(measured.to_string(index=False, float_format="{:.2f}".format))
    OUT.mkdir(parents=True, exist_ok=True)
    (OUT / "gate.json").write_text(json.dumps(measured.to_dict("records"), indent=2) + "\n")
    if "--agree" in sys.argv:
        counts = {
            str(name): dict(zip(of["count"], of["now"].tolist(), strict=True))
            for name, of in measured.groupby("job", sort=False)
        }
        AGREED.write_text(json.dumps(counts, indent=2) + "\n")
    elif (measured["ratio"] > ALLOWED).any():
        raise SystemExit(1)


if __name__ == "__main__":
    main()
