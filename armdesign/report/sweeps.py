"""Sheets of a sweep: every case, and the numbers of its answer that differ."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from armdesign.report.sheet import Sheet

if TYPE_CHECKING:
    import pandas as pd

MOST = 20  # rows that are shown
WIDEST = 6  # columns


def sweep_sheet(frame: pd.DataFrame, kept: int) -> Sheet:
    """The first cases of a sweep's frame; ``kept`` is how many the journal had already."""
    names = [str(name) for name in frame.columns if not _idle(frame[name])]
    shown = names[:WIDEST]
    rows = frame[shown].head(MOST).to_dict("split")["data"]
    notes = [f"{len(frame)} cases, {kept} of them from the journal."] if kept else []
    if len(frame) > MOST:
        notes.append(f"{len(frame) - MOST} further cases are in sweep.csv.")
    if len(names) > len(shown):
        notes.append(f"Further columns are in sweep.csv: {', '.join(names[WIDEST:])}.")
    failed = int((frame["error"] != "").sum())
    if failed:
        cases = "1 case" if failed == 1 else f"{failed} cases"
        first = frame["error"][frame["error"] != ""].iloc[0]
        notes.append(f"{cases} failed; sweep.csv says why. The first: {first}")
    return Sheet(
        title="Sweep",
        columns=("case", *(name.rpartition(".")[2] for name in shown)),
        rows=tuple((str(n), *(_cell(value) for value in row)) for n, row in enumerate(rows, 1)),
        note=" ".join(notes),
    )


def _idle(column: pd.Series[Any]) -> bool:
    """Whether a column tells the cases not apart."""
    words = column.dropna().astype(str)  # values may be lists
    constant = len(column) > 1 and words.nunique() == 1
    return column.name in ("seconds", "error") or constant or bool((words == "").all())


def _cell(value: Any) -> str:
    if value is None or value != value:
        return "–"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
