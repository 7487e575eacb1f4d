"""Sheets of a sweep: every case, and the numbers of its answer that differ."""

from __future__ import annotations

from collections import Counter
from itertools import chain
from typing import TYPE_CHECKING, Any

from armdesign.report.sheet import Sheet

if TYPE_CHECKING:
    import pandas as pd

MOST = 20  # rows that are shown
WIDEST = 6  # columns


def sweep_sheet(frame: pd.DataFrame, kept: int) -> Sheet:
    """The first cases of a sweep's frame; ``kept`` is how many the journal had already."""
    failed = frame["error"] != ""
    told = [str(name) for name in frame if not _idle(frame[name])]
    common = {name: _common(frame[name], failed) for name in told}
    names = [name for name in told if common[name] is None]
    shown = names[:WIDEST]
    rows = frame[shown].head(MOST).to_dict("split")["data"]
    notes = [f"{len(frame)} cases, {kept} of them from the journal."] if kept else []
    if len(frame) > MOST:
        notes.append(f"{len(frame) - MOST} further cases are in sweep.csv.")
    if len(names) > len(shown):
        notes.append(f"Further columns are in sweep.csv: {', '.join(names[WIDEST:])}.")
    short = _short(told)
    alike = [f"{short[n]} {_cell(common[n])}" for n in told if common[n] is not None]
    if alike and not failed.all():
        which = "all that did not fail" if failed.any() else "all"
        notes.append(f"The same in {which}: {', '.join(alike)}.")
    if count := int(failed.sum()):
        cases = "1 case" if count == 1 else f"{count} cases"
        first = frame["error"][failed].iloc[0]
        notes.append(f"{cases} failed; sweep.csv says why. The first: {first}")
    return Sheet(
        title="Sweep",
        columns=("case", *(short[name] for name in shown)),
        rows=tuple((str(n), *(_cell(value) for value in row)) for n, row in enumerate(rows, 1)),
        note=" ".join(notes),
    )


def _idle(column: pd.Series[Any]) -> bool:
    """Whether a column says nothing of the cases."""
    empty = column.isna() | (column == "")
    return column.name in ("seconds", "error") or bool(empty.all())


def _common(column: pd.Series[Any], failed: pd.Series[bool]) -> Any:
    """The value that several cases have in common; None if they differ or only one has it.

    One that failed may lack it.
    """
    values = column[~(column.isna() & failed)]
    alike = len(values) > 1 and values.astype(str).nunique(dropna=False) == 1  # lists, too
    return values.iloc[0] if alike else None


def _short(names: list[str]) -> dict[str, str]:
    """Names by key path: the last keys that tell one from the others, numbers with their list."""
    tails = {name: _tails(name.split(".")) for name in names}
    known = Counter(chain.from_iterable(tails.values()))
    apart = {
        name: (tail for tail in of_name if not tail.isdigit() and known[tail] == 1)
        for name, of_name in tails.items()
    }
    return {name: next(found, name) for name, found in apart.items()}


def _tails(keys: list[str]) -> list[str]:
    return [".".join(keys[-k:]) for k in range(1, len(keys) + 1)]


def _cell(value: Any) -> str:
    if value is None or value != value:
        return "–"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
