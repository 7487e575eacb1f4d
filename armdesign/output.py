"""Output of commands: files in one folder, all or none, and text in the terminal."""

from __future__ import annotations

import csv
import errno
import io
import os
import shlex
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from armdesign import text_files, transaction
from armdesign.csv_rows import as_written, digits_of
from armdesign.errors import ArmDesignError, printable
from armdesign.streams import as_printed
from armdesign.text_files import LARGEST_MACHINE_FILE

if TYPE_CHECKING:
    import pandas as pd
    from rich.console import Console

    from armdesign.arrays import Array
    from armdesign.calibration.calibrate import Calibration
    from armdesign.control.bandwidth_map import BandwidthMap
    from armdesign.design.design import Design
    from armdesign.design.steps import Steps
    from armdesign.frequency.maps import FrequencyMap
    from armdesign.machine.lift_chart import LiftChart
    from armdesign.machine.machine import Machine
    from armdesign.motion.move import Move
    from armdesign.report.sheet import Sheet
    from armdesign.simulation.identified import Identified
    from armdesign.simulation.validation import Validation

LOOKED_AT, FEW = 512, 64  # of a column's numbers, and as many of them that are few
UNBOUNDED = 10_000  # columns, where the output is no terminal
stops: list[KeyboardInterrupt] = []  # Ctrl-C, of which typer tells nothing
kept: list[Path] = []  # journals with which the same command goes on
changed: list[Path] = []  # files that this process has written


def write_csv(table: pd.DataFrame | Mapping[str, Array], path: Path) -> None:
    """Write a frame or columns as CSV with nine digits, without text that a spreadsheet would run.

    To the letter what ``DataFrame.to_csv`` writes, in a fraction of its time; late instants have
    more digits.
    """
    import numpy as np

    from armdesign.arrays import chunks

    names, columns = zip(*table.items(), strict=True)
    formats, parts = zip(*map(_cells, names, columns), strict=True)
    if len(parts) == 1:  # an empty line would be none
        formats, parts = ("%s",), ([formats[0] % cell or '""' for cell in parts[0]],)
    line = ",".join(formats) + os.linesep
    with path.open("w", encoding="utf-8", newline="") as file:
        file.write(",".join(map(_as_written, names)) + os.linesep)
        for rows in chunks(len(parts[0])):
            cells = np.empty((len(parts[0][rows]), len(parts)), dtype=object)
            for k, part in enumerate(parts):
                cells[:, k] = part[rows]
            file.write(line * len(cells) % tuple(cells.ravel()))


def _cells(name: str, column: pd.Series[Any] | Array) -> tuple[str, Array | list[str]]:
    """The format of a column's cells, and these: texts, empty where there is none, or numbers."""
    numbers = column.dtype.kind == "f"
    missing = column.isna().to_numpy() if hasattr(column, "isna") else column != column
    if numbers and not missing.any():
        array = column.to_numpy() if hasattr(column, "to_numpy") else column
        return _numbers(array, digits_of(name, array))
    values = column.tolist()
    if numbers:
        digits = digits_of(name, values)
        cells = [f"{value:.{digits}g}" for value in values]
    elif column.dtype.kind in "iub":
        cells = list(map(str, values))
    else:
        words = {value for value in values if isinstance(value, str)}
        texts = {word: _as_written(word) for word in words}
        cells = [texts[v] if isinstance(v, str) else _as_written(v) for v in values]
    for place in missing.nonzero()[0]:
        cells[place] = ""
    return "%s", cells


def _numbers(column: Array, digits: int) -> tuple[str, Array]:
    """Format and cells of numbers; few that come again and again, as joints', are made texts."""
    import numpy as np

    bits = np.ascontiguousarray(column, dtype=float).view(np.int64)  # which tell -0 from 0
    if len(np.unique(bits[:: len(bits) // LOOKED_AT + 1])) > FEW:
        return f"%.{digits}g", column
    some, which = np.unique(bits, return_inverse=True)
    return "%s", np.array([f"{each:.{digits}g}" for each in some.view(float)], object)[which]


def _as_written(cell: Any) -> str:
    """A cell as CSV has it: quoted where it must be, and no formula."""
    line = io.StringIO()
    plain = as_written(cell) if isinstance(cell, str) else cell
    csv.writer(line, lineterminator=os.linesep).writerow([plain, ""])
    return line.getvalue().removesuffix(f",{os.linesep}")


def write_heatmaps(frequencies: FrequencyMap, folder: Path) -> None:
    """Pictures of the lowest frequency, over joints and by place of the tool, and of pressures."""
    from armdesign import plots

    for plane in ("joints", "reach", "holding"):
        plots.save(plots.map_figure(frequencies, plane), folder / f"map_{plane}.png")


def write_lift_charts(charts: Mapping[str, LiftChart], folder: Path) -> Path | None:
    """Write lift charts as CSV and picture, of which the path; nothing where there are none."""
    from armdesign import plots
    from armdesign.report.lift_charts import lift_columns

    if not charts:
        return None
    first, *others = charts.values()
    write_csv(lift_columns(charts) if others else first.columns, folder / "lift_chart.csv")
    return plots.save(plots.lift_charts(charts), folder / "lift_chart.png")


def write_design(design: Design, folder: Path) -> list[tuple[str, Path]]:
    """Write machine file, maps and pictures of a design; returns captions and pictures."""
    from armdesign import plots
    from armdesign.report.lift_charts import lift_charts

    write_machine(design, folder)
    write_csv(design.before.columns, folder / "map_before.csv")
    write_csv(design.after.columns, folder / "map_after.csv")
    over_joints = "Lowest natural frequency over two joints"
    if len(plots.drawn_joints(design.today)) == 1:
        over_joints = "Natural frequencies over the joint"
    by_place = "Lowest natural frequency by place of the tool"
    pictures = {
        "map_joints.png": (over_joints, plots.before_after(design)),
        "map_reach.png": (by_place, plots.before_after(design, "reach")),
        "moment_arms.png": (
            "Moment arms and torques over the joint ranges",
            plots.moment_arms(design),
        ),
    }
    saved = [(text, plots.save(fig, folder / name)) for name, (text, fig) in pictures.items()]
    charts = lift_charts({"today": design.today, "new": design.machine})
    chart = write_lift_charts(charts, folder)
    overlay = write_overlay({"today": design.before, "new": design.after}, folder)
    drawn = [("Both machines in today's worst pose; arrows show moved pins", overlay)]
    more = [*drawn, ("Lift charts (ISO 10567)", chart)]
    return [*saved, *((text, path) for text, path in more if path)]


def write_machine(design: Design, folder: Path) -> None:
    """Write the machine file of a design alone."""
    design.written_by(command_line()).save(folder / made_of(design.today))


def write_overlay(maps: Mapping[str, FrequencyMap], folder: Path) -> Path | None:
    """Write two machines over each other in the first one's worst pose.

    Nothing if their joints differ.
    """
    from armdesign import plots

    old, new = (frequencies.machine for frequencies in maps.values())
    if old.joints != new.joints:
        return None
    worst, labels = next(iter(maps.values())).worst, tuple(maps)
    ax = plots.machine_overlay(old, new, worst.q, labels=(labels[0], labels[1]))
    return plots.save(ax.figure, folder / "overlay.png")


def write_steps(answer: Steps, folder: Path) -> None:
    """Write the machine of every step."""
    for step in answer.steps:
        name = f"{answer.today.name}_{len(step.pins)}_pins.toml"
        step.design.written_by(command_line()).save(folder / name)


def write_calibration(calibration: Calibration, folder: Path) -> None:
    """Write the calibrated machine file, values, measurements and their picture."""
    from armdesign import plots

    machine = calibration.written_by(command_line())
    machine.save(folder / f"{machine.name}.toml")
    write_csv(calibration.values.reset_index(), folder / "calibration_values.csv")
    write_csv(calibration.frame, folder / "calibration.csv")
    plots.save(plots.calibration_figure(calibration), folder / "calibration.png")


def write_bandwidths(bandwidths: BandwidthMap, folder: Path, suffix: str = "") -> None:
    """Write bandwidths, gains and heatmaps of a machine; the suffix goes into the files' names."""
    from armdesign import plots

    write_csv(bandwidths.frame, folder / f"bandwidth{suffix}.csv")
    write_csv(bandwidths.schedule, folder / f"gains{suffix}.csv")
    plots.save(plots.bandwidth_maps(bandwidths), folder / f"bandwidth{suffix}.png")


def write_identified(identified: Identified, folder: Path) -> None:
    """Write windows, swings, pressures and their picture."""
    from armdesign import plots

    write_csv(identified.frame, folder / "identified.csv")
    write_csv(identified.swings, folder / "swings.csv")
    if len(identified.pressures):
        write_csv(identified.pressures, folder / "pressures.csv")
    plots.save(identified.plot(), folder / "identified.png")


def write_move(move: Move, folder: Path) -> None:
    """Write plan, runs and shaper of a move with their pictures."""
    import pandas as pd

    from armdesign import plots

    impulses = {"time_s": move.shaper.times, "amplitude": move.shaper.amplitudes}
    write_csv(move.frame, folder / "move.csv")
    write_csv(move.residuals, folder / "residual.csv")
    write_csv(pd.DataFrame(impulses), folder / "shaper.csv")
    plots.save(move.plot(), folder / "move.png")
    plots.save(plots.shaper_figure(move), folder / "shaper.png")


def command_line(without: str | None = None) -> str:
    """The command as typed in the terminal, but for one word."""
    words = (word for word in sys.argv[1:] if word != without)
    return " ".join(["armdesign", *map(_as_typed, words)])


def _as_typed(word: str) -> str:
    r"""A word of a command; one with control characters as shells read it: ``$'a\nb'``."""
    shown = printable(word)
    if shown == word:
        return shlex.quote(word)
    escaped = printable(word.replace("\\", "\\\\").replace("'", "\\'"))
    return f"$'{escaped}'"


def made_of(machine: Machine) -> str:
    """Name of the machine file of a new design."""
    return f"{machine.name}_optimized.toml"


def check_urdf(machine: Machine, out: Path) -> None:
    """Raise if a new design's URDF would replace one that belongs to another machine file."""
    from armdesign.machine.file import saving
    from armdesign.machine.file.toml_reading import read_toml

    files = machine.files(out / made_of(machine))
    target, urdf = next(iter(files)), saving.other_urdf(machine, files)
    if urdf is None:
        return
    with suppress(OSError, ValueError, ArmDesignError):
        text = text_files.read(target, LARGEST_MACHINE_FILE)
        earlier = read_toml(text, target.name).get("urdf")
        if isinstance(earlier, str) and target.parent / earlier == urdf:
            return
    raise _refused(out, f"another {urdf.name} is there")


def validation_columns(validations: Mapping[str, Validation], label: str = "") -> dict[str, Array]:
    """All validations as in ``validation.csv``; their names go into a column ``label``."""
    from armdesign.arrays import by_columns

    named = (({label: name} if label else {}, one.rows) for name, one in validations.items())
    return by_columns([row | column for column, rows in named for row in rows])


def write_validations(
    validations: Mapping[str, Validation], folder: Path, label: str = ""
) -> None:
    """Write all validations as one CSV file; their names go into a column ``label``."""
    write_csv(validation_columns(validations, label), folder / "validation.csv")


def _refused(out: Path | str, fault: str, code: int | None = None) -> ArmDesignError:
    """The error of a folder that cannot be used, with the operating system's code if there is."""
    full = code in (errno.ENOSPC, errno.EDQUOT)
    remedy = (
        "make room and run it again, or name another folder" if full else "name another folder"
    )
    return ArmDesignError(f"--out {out}", fault, remedy)


def check_out(out: Path) -> None:
    """Raise if a folder cannot be written; complete or undo what a killed run left there."""
    try:
        _refuse_broken_link(out)
        existing = next(folder for folder in (out, *out.absolute().parents) if folder.exists())
    except OSError as error:
        raise _refused(f"{out!s:.60}", f"cannot be used ({error.strerror})") from None
    if not existing.is_dir() or not os.access(existing, os.W_OK):
        raise _refused(out, f"{existing} is not a folder to write into")
    transaction.mend(out)


def _refuse_broken_link(out: Path) -> None:
    """Raise for a folder that is, or is within, a link without an end."""
    ends = {errno.ENOENT: "a link to nothing", errno.ELOOP: "a link in a circle"}
    for folder in (out, *out.absolute().parents):
        try:
            os.stat(folder)
        except OSError as error:
            if folder.is_symlink() and error.errno in ends:
                remedy = "remove it or mend it, or name another folder"
                fault = f"{folder} is {ends[error.errno]}"
                raise ArmDesignError(f"--out {out}", fault, remedy) from None


@contextmanager
def outputs(out: Path, *, silent: bool = False) -> Iterator[Path]:
    """A folder to write into, whose files move to ``out`` when they are complete, all or none."""
    with ExitStack() as undisturbed:
        try:
            with transaction.staged(out) as folder:
                yield folder
                files = (path for path in folder.rglob("*") if path.is_file())
                written = sorted(str(path.relative_to(folder)) for path in files)
                undisturbed.enter_context(transaction.undisturbed())
        except OSError as error:
            fault = f"cannot be written ({error.strerror})"
            raise _refused(out, fault, error.errno) from None
        changed.extend(out / name for name in written)
        if not silent:
            tell(f"wrote {', '.join(written)} to {out}/")


def tell(text: str, file: TextIO | None = None) -> None:
    """Print a line: on stdout, or on a stream that is given."""
    print(printable(text), file=file)


def interruption() -> str:
    """Sentence after Ctrl-C or a signal: where the work was, what is written, how to go on."""
    stop = stops[-1] if stops else KeyboardInterrupt()
    where = "".join(f" {note}" for note in getattr(stop, "__notes__", ()))
    go_on = f"; {stop.args[0]}" if stop.args else ""
    folders = dict.fromkeys(str(path.parent) for path in changed)
    left = [f"finished files are in {', '.join(folders)}/"] if folders else []
    left += [f"what was finished is kept in {path}" for path in kept]
    return f"interrupted{where}; {'; '.join(left) or 'nothing was written'}{go_on}"


def tell_error(error: ArmDesignError) -> None:
    """Print an error on stderr: one line, and below it the table that some errors have."""
    tell(f"armdesign: {error}", sys.stderr)
    for line in error.table.splitlines():
        tell(line, sys.stderr)


def show(items: Sequence[Sheet | str]) -> None:
    """Print sheets and sentences one after the other."""
    from rich.console import Console

    console = Console(highlight=False, markup=False, emoji=False)
    if not console.is_terminal:  # for another program: nothing is wrapped or filled up with blanks
        console.width = UNBOUNDED
        with console.capture() as captured:
            _print(items, console)
        for line in captured.get().splitlines():
            tell(line.rstrip())
        return
    _print(items, console)


def _print(items: Sequence[Sheet | str], console: Console) -> None:
    from armdesign.report.terminal_table import terminal_table

    for i, item in enumerate(items):
        if isinstance(item, str):
            console.print(printable(item), end="\n" if i == len(items) - 1 else "\n\n")
            continue
        console.print(item.title, style="bold")
        if item.rows:
            console.print(terminal_table(_shown(item), console.width), crop=False)
        if item.note:
            console.print(f"{item.note}\n", style="italic")


def _shown(sheet: Sheet) -> Sheet:
    """The sheet in the signs that stdout has: columns are as wide as what they then hold."""
    columns, words = (tuple(map(as_printed, heads)) for heads in (sheet.columns, sheet.words))
    rows = tuple(tuple(map(as_printed, row)) for row in sheet.rows)
    return replace(sheet, columns=columns, words=words, rows=rows)
