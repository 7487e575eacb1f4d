"""Options of the commands: their names and help texts, and how what they say is read."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from armdesign.errors import ArmDesignError
from armdesign.output import check_out
from armdesign.units import SI, WORKSHOP, Units

if TYPE_CHECKING:
    from armdesign.design.catalogue.sizes import Sizes
    from armdesign.frequency.bands import Bands
    from armdesign.frequency.workspace import Workspace
    from armdesign.machine.machine import Machine


class Habit(StrEnum):
    """Units of printed tables."""

    workshop = "workshop"
    si = "si"

    @property
    def units(self) -> Units:
        """Factors and names of the units."""
        return SI if self is Habit.si else WORKSHOP


MachineArgument = Annotated[
    str, typer.Argument(help="A shipped machine (excavator_20t), a folder, or a .toml file.")
]
OutOption = Annotated[
    Path, typer.Option("--out", help="Folder for everything that the command writes.")
]
PointsOption = Annotated[
    str,
    typer.Option("--points", help="Grid points per joint: one number, or one each as 21,21,61."),
]
VaryOption = Annotated[
    str,
    typer.Option(
        "--vary",
        help="What may change, separated by commas: areas, pins, linkages (pins and four-bars), or"
        " key paths of the file such as cylinder.boom.bore_mm.",
    ),
]
CatalogueOption = Annotated[
    str,
    typer.Option(
        "--catalogue",
        help=(
            "Sizes to choose from: iso, 5mm, or a CSV file with columns bore_mm, rod_mm; default:"
            " what the machine file says. Pins then lie on whole mm, strokes on 5 mm."
        ),
    ),
]
FreeOption = Annotated[
    bool, typer.Option("--free", help="Any size, pin and stroke to 0.1 mm, no catalogue.")
]
NominalOption = Annotated[
    bool, typer.Option("--nominal", help="Design for the file's values alone, not its [bands].")
]
LeastOption = Annotated[
    str, typer.Option("--least", help="Minimise oil, flow or mass instead; needs --frequency.")
]
FrequencyOption = Annotated[
    float,
    typer.Option(
        "--frequency",
        help="Worst natural frequency to reach, in Hz; needs --least.",
        show_default=False,
    ),
]
AgainstOption = Annotated[
    str, typer.Option("--against", help="Limit to vary: oil, thrust, digging, lift or pin_box.")
]
ValuesOption = Annotated[
    str,
    typer.Option(
        "--values",
        help="Values of that limit, separated by commas: shares of today's, for pin_box metres.",
    ),
]
MeasuredArgument = Annotated[
    Path, typer.Argument(help="CSV file of measured frequencies, one row for each.")
]
FitOption = Annotated[
    str,
    typer.Option(
        "--fit",
        help="Key paths to be found, separated by commas: fluid.bulk_modulus_MPa,…",
        show_default=False,
    ),
]
PriorOption = Annotated[
    str,
    typer.Option(
        "--prior",
        help="What is known of them: PATH=VALUE:DEVIATION in the file's unit, by commas.",
    ),
]
RecordingArgument = Annotated[
    str, typer.Argument(help="CSV file: time_s and a column for each signal, as boom_cap_bar.")
]
WindowsOption = Annotated[
    str, typer.Option("--windows", help="Windows in s, as 1.9:4.5,4:7; default: found.")
]
SignalOption = Annotated[
    str, typer.Option("--signal", help="Column to fit; default: the pressure that rings most.")
]
ModesOption = Annotated[int, typer.Option("--modes", help="Number of modes in each window.")]
ExcitationOption = Annotated[
    str,
    typer.Option(
        "--excitation", help="Column of a recorded input; default: windows hold free decays."
    ),
]
BandOption = Annotated[
    str, typer.Option("--band", help="Lowest and highest frequency of a response, as 0.5:4.")
]
MachineOption = Annotated[
    str, typer.Option("--machine", help="A machine, whose cylinders and joints the columns name.")
]
UnitsOption = Annotated[
    Habit, typer.Option("--units", help="Units of printed tables: mm, bar, l, kN, deg; or SI.")
]
OutsideOption = Annotated[
    bool, typer.Option("--allow-outside", help="Accept a URDF outside the machine file's folder.")
]


def open_workspace(
    machine: str, points: str, out: Path, allow_outside: bool
) -> tuple[Machine, Workspace]:
    """The machine and its workspace; faults of options are raised before anything is computed."""
    from armdesign.frequency.workspace import Workspace
    from armdesign.machine.loading import load

    counts = grid_points(points)
    check_out(out)
    model = load(machine, allow_outside=allow_outside)
    return model, Workspace.grid(model, counts)


def grid_points(points: str) -> int | list[int] | None:
    """Value of ``--points``."""
    try:
        counts = [int(word) for word in points.split(",")] if points else None
    except ValueError:
        fault = f'"{points}" is not a list of numbers'
        raise ArmDesignError("--points", fault, "give 21 or 21,21,61") from None
    return counts[0] if counts and len(counts) == 1 else counts


def spans(text: str, option: str) -> list[tuple[float, float]]:
    """Pairs of numbers as ``1.9:4.5,4:7``."""
    found = []
    for word in listed(text):
        try:
            low, high = map(float, word.split(":"))
        except ValueError:
            raise ArmDesignError(option, f'"{word}" is no span', "give it as 1.9:4.5") from None
        found.append((low, high))
    return found


def listed(text: str) -> tuple[str, ...]:
    """Words of an option that are separated by commas."""
    return tuple(word.strip() for word in text.split(",") if word.strip())


def stated_priors(text: str) -> dict[str, tuple[float, float]]:
    """Value of ``--prior``: value and standard deviation by key path."""
    priors = {}
    for word in listed(text):
        path, _, numbers = word.partition("=")
        try:
            value, deviation = (float(number) for number in numbers.split(":"))
        except ValueError:
            remedy = "give PATH=VALUE:DEVIATION, as fluid.bulk_modulus_MPa=1200:240"
            raise ArmDesignError("--prior", f'"{word}" is not understood', remedy) from None
        if path.strip() in priors:
            raise ArmDesignError("--prior", f"{path.strip()} is there twice", "leave one out")
        priors[path.strip()] = value, deviation
    return priors


def offered_sizes(catalogue: str, free: bool) -> str | Sizes | None:
    """Sizes that ``--catalogue`` and ``--free`` ask for; None for those of the machine file."""
    from armdesign.design.catalogue.sizes import FREE, read_sizes

    if free:
        if catalogue:
            raise ArmDesignError("--free", "contradicts --catalogue", "give one of them")
        return FREE
    return read_sizes(catalogue) if catalogue.lower().endswith(".csv") else catalogue or None


def bands_to_use(nominal: bool) -> Bands | None:
    """None for those of the machine file; none at all if ``--nominal`` is given."""
    from armdesign.frequency.bands import Bands

    return Bands() if nominal else None
