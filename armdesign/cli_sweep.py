"""The command ``armdesign sweep``."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from armdesign.csv_rows import plain_cells
from armdesign.errors import ArmDesignError
from armdesign.options import FreshOption, ProcessesOption, SchedulerOption, StudyArgument
from armdesign.output import command_line, kept, tell
from armdesign.runs import OfMachines, command
from armdesign.threads import processors

if TYPE_CHECKING:
    import pandas as pd

JOURNAL = "sweep.sqlite"


@partial(command, without=("pictures", "units"))
def sweep(
    run: OfMachines,
    study: StudyArgument,
    workers: ProcessesOption = None,
    scheduler: SchedulerOption = "",
    new: FreshOption = False,
) -> None:
    """Answer one question for many machines.

    STUDY.toml names machines, what changes in them (grid, sobol, case, csv), load cases,
    requirements, the task (map, design, validate, control or simulate) and which of its outputs
    the table has. Every finished case stays in sweep.sqlite: interrupted, the same command goes on
    where it was. Writes sweep.csv, and sweep.parquet where pyarrow is installed. Exit code 2 where
    no case has an answer.
    """
    from armdesign.report.sweeps import sweep_sheet
    from armdesign.sweeps.study_file import read_study
    from armdesign.sweeps.sweep import sweep as swept

    out = run.folder(study)
    earlier = _begun(out)
    try:
        with _telling_of_earlier(out, run.quiet), run.progress("sweeping"):
            answers = swept(
                **read_study(study, run.load),
                workers=processors() if workers is None else workers,
                scheduler=scheduler or None,
                journal=out / JOURNAL,
                new=new,
            )
            table = answers.frame
        with run.writing(out) as folder:
            place = folder.absolute()  # pandas takes a ~ at the beginning for the home
            plain_cells(table).to_csv(place / "sweep.csv", index=False)  # every digit
            if importlib.util.find_spec("pyarrow"):
                _write_parquet(table, place / "sweep.parquet")
    except KeyboardInterrupt as stop:
        if (out / JOURNAL).exists():
            kept.append(out / JOURNAL)
            begun = _begun(out) != earlier
            stop.args = (f"go on with: {command_line(without='--new' if begun else None)}",)
        raise
    again = [f"A worker died; done again: {name}." for name in answers.retried]
    run.show([sweep_sheet(table, answers.kept), *again], tables={"sweep": table})
    if (table["error"] != "").all():
        fault, first = "no case has an answer", table["error"].iloc[0]
        run.refuse([ArmDesignError(str(study), fault, f"the first says: {first}")])


@contextmanager
def _telling_of_earlier(out: Path, quiet: bool) -> Iterator[None]:
    """Say after the block, however it ends, by which name it set an earlier journal aside."""
    before = _set_aside(out)
    try:
        yield
    finally:
        for path in () if quiet else sorted(_set_aside(out) - before):
            tell(f"armdesign: the earlier journal is kept as {path}", sys.stderr)


def _begun(out: Path) -> tuple[bool, int]:
    """Whether a folder has a journal, and how many are set aside: others once one has begun."""
    return (out / JOURNAL).exists(), len(_set_aside(out))


def _set_aside(out: Path) -> set[Path]:
    """Journals in a folder that are set aside."""
    return set(out.glob(f"{Path(JOURNAL).stem}.*{Path(JOURNAL).suffix}"))


def _write_parquet(table: pd.DataFrame, path: Path) -> None:
    """Write the table as Parquet; where pyarrow cannot be loaded, say so: the CSV file has all."""
    try:
        data = _of_one_kind(table).to_parquet(engine="pyarrow", index=False)
    except ImportError as error:
        reason = str(error).partition("\n")[0]
        tell(f"armdesign: {path.name} is not written: pyarrow fails ({reason})", sys.stderr)
        return
    path.write_bytes(data)  # pyarrow itself takes no path that is not UTF-8


def _of_one_kind(table: pd.DataFrame) -> pd.DataFrame:
    """The table with words in place of what a column of Parquet has not.

    That is words beside numbers, lists and tables, and whole numbers beyond 64 bits.
    """
    table = table.copy()
    for name in table:
        values = list(table[name].dropna()) if table[name].dtype == object else []
        kinds = set(map(type, values))
        if kinds == {int} and max(map(abs, values)) < 2**63:  # beside cases without a number
            table[name] = table[name].astype("Int64")
        elif len(kinds) > 1 or not kinds <= {str, bool, float}:
            table[name] = [value if value is None else str(value) for value in table[name]]
    return table
