"""What commands leave behind: files in one folder, all or none of them, and words in the terminal."""

from __future__ import annotations

import os
import shlex
import sys
import tomllib
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from armdesign import transaction
from armdesign.errors import ArmDesignError, printable

if TYPE_CHECKING:
    import pandas as pd

    from armdesign.design.design import Design
    from armdesign.frequency.maps import FrequencyMap
    from armdesign.machine.machine import Machine
    from armdesign.report.sheet import Sheet
    from armdesign.simulation.validation import Validation

changed: list[Path] = []  # folders that this process has written into


def write_csv(frame: pd.DataFrame, path: Path) -> None:
    """A frame with nine digits."""
    frame.to_csv(path, index=False, float_format="%.9g")


def write_heatmaps(frequencies: FrequencyMap, folder: Path) -> None:
    """Lowest frequency over joints and over the tool's places, and the pressure that holds the load."""
    from armdesign import plots

    for name, size in (("joints", (7.0, 5.2)), ("reach", (6.4, 7.0)), ("holding", (7.0, 5.2))):
        fig, (ax,) = plots.figure(1, *size)
        if name == "holding":
            plots.holding_pressure(frequencies, ax)
        else:
            frequencies.plot(ax, plane=name)
        fig.suptitle(frequencies.machine.section.title or frequencies.machine.name)
        plots.save(fig, folder / f"map_{name}.png")


def write_design(design: Design, folder: Path) -> list[tuple[str, Path]]:
    """Machine file, maps and pictures of a design; returns the pictures with their captions."""
    from armdesign import plots

    design.written_by(command_line()).save(folder / made_of(design.today))
    write_csv(design.before.frame, folder / "map_before.csv")
    write_csv(design.after.frame, folder / "map_after.csv")
    one = len(plots.drawn_joints(design.today)) == 1
    over = (
        "Natural frequencies over the joint" if one else "Lowest natural frequency over two joints"
    )
    pictures = [
        (over, plots.before_after(design), "map_joints.png"),
        (
            "Lowest natural frequency at each place of the tool",
            plots.before_after(design, "reach"),
            "map_reach.png",
        ),
        (
            "What the pins buy: the shape of the moment arms",
            plots.moment_arms(design),
            "moment_arms.png",
        ),
    ]
    return [(caption, plots.save(fig, folder / name)) for caption, fig, name in pictures]


def command_line() -> str:
    """What was typed in the terminal."""
    return shlex.join(["armdesign", *sys.argv[1:]])


def made_of(machine: Machine) -> str:
    """Name of the machine file of a new design."""
    return f"{machine.name}_optimized.toml"


def check_urdf(machine: Machine, out: Path) -> None:
    """Raise if a new design's URDF would replace one that belongs to another machine file."""
    target, urdf, *_ = machine.files(out / made_of(machine))
    if not urdf.is_file() or urdf.read_bytes() == machine.urdf_text.encode():
        return
    with suppress(OSError, ValueError):
        earlier = tomllib.loads(target.read_text(encoding="utf-8")).get("urdf")
        if isinstance(earlier, str) and target.parent / earlier == urdf:
            return
    raise ArmDesignError(f"--out {out}", f"another {urdf.name} is there", "name another folder")


def write_validations(validations: dict[str, Validation], folder: Path, label: str = "") -> None:
    """All of them in one file; the names go into a column ``label``."""
    import pandas as pd

    frames = [
        v.frame.assign(**({label: name} if label else {})) for name, v in validations.items()
    ]
    write_csv(pd.concat(frames, ignore_index=True), folder / "validation.csv")


def check_out(out: Path) -> None:
    """Raise if nothing can be written there; what a killed run left half done there is ended."""
    try:
        there = next(place for place in (out, *out.absolute().parents) if place.exists())
    except OSError as error:
        raise ArmDesignError(
            f"--out {out!s:.60}", f"cannot be used ({error.strerror})", "name another folder"
        ) from None
    if not there.is_dir() or not os.access(there, os.W_OK):
        raise ArmDesignError(
            f"--out {out}", f"{there} is not a folder to write into", "name another folder"
        )
    transaction.mend(out)


@contextmanager
def outputs(out: Path) -> Iterator[Path]:
    """A folder to write into.

    Its files move to ``out`` when all of them are there, all or none.
    """
    with ExitStack() as told:
        try:
            with transaction.staged(out) as folder:
                yield folder
                written = sorted(
                    str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()
                )
                told.enter_context(transaction.undisturbed())
        except OSError as error:
            words = f"cannot be written ({error.strerror})"
            raise ArmDesignError(f"--out {out}", words, "name another folder") from None
        changed.append(out)
        tell(f"wrote {', '.join(written)} to {out}/")


def tell(text: str, file: TextIO | None = None) -> None:
    """A line in the terminal: on stdout, or on a stream that is given."""
    print(printable(text), file=file)


@contextmanager
def progress(text: str) -> Iterator[Callable[[str], None]]:
    """A progress display on stderr that leaves no trace.

    Call what it yields to change the text.
    """
    from rich.text import Text

    from armdesign.arrays import terminal

    with terminal().status(Text(printable(text))) as status:
        yield lambda words: status.update(Text(printable(words)))


def show(items: Sequence[Sheet | str]) -> None:
    """Sheets and sentences, one after the other, in the terminal."""
    from rich.console import Console

    from armdesign.report.sheet import rich_table

    console = Console()
    if not console.is_terminal:
        console.width = 100
    for item in items:
        if isinstance(item, str):
            console.print(printable(item), highlight=False, markup=False, emoji=False)
            continue
        console.print(item.title, style="bold", highlight=False, markup=False, emoji=False)
        if item.rows:
            console.print(rich_table(item), highlight=False)
        if item.note:
            console.print(
                f"{item.note}\n", style="italic", highlight=False, markup=False, emoji=False
            )
