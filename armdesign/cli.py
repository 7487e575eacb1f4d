"""The command line: ``armdesign map | optimize | validate | design MACHINE --out DIR``.

Every command computes first and writes at the end, all files or none. Bad input is one line on stderr and exit code 2.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from armdesign.errors import ArmDesignError

if TYPE_CHECKING:
    from armdesign.machine import Machine
    from armdesign.maps import FrequencyMap
    from armdesign.workspace import Workspace

app = typer.Typer(
    help="Natural frequencies of hydraulic booms, and the cylinders and pins that raise them.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

MachineArgument = Annotated[str, typer.Argument(help="A shipped machine (excavator_20t), its folder, or a .toml file.")]
OutOption = Annotated[Path, typer.Option("--out", help="Folder for everything the command writes.")]
PointsOption = Annotated[
    str, typer.Option("--points", help="Grid values per joint: one number, or one each: 21,21,61.")
]


@app.callback()
def _root() -> None:
    pass


@app.command("map")
def map_command(machine: MachineArgument, out: OutOption = Path("out"), points: PointsOption = "") -> None:
    """Worst pose, percentiles, which cylinder; writes map.csv and heatmaps."""
    model, workspace = _model(machine, points)
    with _progress("mapping the workspace"):
        frequencies = _frequency_map(model, workspace)
    from armdesign.report import map_tables

    with _outputs(out) as folder:
        frequencies.frame.to_csv(folder / "map.csv", index=False)
        write_heatmaps(frequencies, folder, "map")
    _print(*map_tables(frequencies))


def write_heatmaps(frequencies: FrequencyMap, folder: Path, stem: str, **limits: float) -> list[Path]:
    """Draw a map over the joints and over reach and height."""
    from armdesign import plots

    written = []
    for plane, size in (("joints", (7.0, 5.2)), ("reach", (6.4, 7.0))):
        fig, (ax,) = plots.figure(1, *size)
        frequencies.plot(ax, plane=plane, **limits)
        fig.suptitle(frequencies.machine.section.title or frequencies.machine.name)
        written.append(plots.save(fig, folder / f"{stem}_{plane}.png"))
    return written


def _model(machine: str, points: str) -> tuple[Machine, Workspace]:
    from armdesign.machine import load
    from armdesign.workspace import Workspace

    try:
        counts = [int(word) for word in points.split(",")] if points else None
    except ValueError:
        raise ArmDesignError("--points", f'"{points}" is not a list of numbers', "give 21 or 21,21,61") from None
    model = load(machine)
    return model, Workspace.grid(model, counts[0] if counts and len(counts) == 1 else counts)


def _frequency_map(model: Machine, workspace: Workspace) -> FrequencyMap:
    from armdesign.maps import frequency_map

    return frequency_map(model, workspace)


@contextmanager
def _outputs(out: Path) -> Iterator[Path]:
    """A folder to write into; its files move to ``out`` only when all of them are there."""
    try:
        out.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=out, prefix=".writing-") as temporary:
            yield Path(temporary)
            written = sorted(p.name for p in Path(temporary).iterdir())
            for name in written:
                shutil.move(Path(temporary) / name, out / name)
    except OSError as error:
        raise ArmDesignError(f"--out {out}", f"cannot be written ({error.strerror})", "name another folder") from None
    _print(f"wrote {', '.join(written)} to {out}/")


@contextmanager
def _progress(text: str) -> Iterator[Any]:
    """A progress display on stderr that leaves no trace; call what it yields to change the text."""
    from rich.console import Console

    with Console(stderr=True).status(text) as status:
        yield status.update


def _print(*items: Any) -> None:
    from rich.console import Console

    console = Console(soft_wrap=False)
    for item in items:
        console.print(item, highlight=False)


def main() -> None:
    """Entry point of ``armdesign``: bad input becomes one line on stderr and exit code 2."""
    try:
        app()
    except ArmDesignError as error:
        print(f"armdesign: {error}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        print("armdesign: interrupted; nothing was written", file=sys.stderr)
        sys.exit(130)


if __name__ == "__main__":
    main()
