"""Options of the commands: their names, kinds and help texts."""

from __future__ import annotations

import glob
from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from armdesign.arguments import MOST
from armdesign.option_values import within
from armdesign.units import SI, WORKSHOP, Units

STARTS, WORKERS = (within(f"--{name}", 1, MOST[name]) for name in ("starts", "workers"))
SOME_STARTS, SOME_WORKERS = (f"1 to {MOST[name]}" for name in ("starts", "workers"))


class Habit(StrEnum):
    """Units of printed tables."""

    workshop = "workshop"
    si = "si"

    @property
    def units(self) -> Units:
        """Factors and names of the units."""
        return SI if self is Habit.si else WORKSHOP


def machine_names(incomplete: str) -> list[str]:
    """Machines that a word may become: shipped ones, and files and folders here."""
    from armdesign.machine.loading import shipped

    names = [name for name in shipped() if name.startswith(incomplete)]
    paths = sorted(Path().glob(f"{glob.escape(incomplete)}*"))
    names += [f"{path}/" for path in paths if path.is_dir() and not path.name.startswith(".")]
    return [*names, *(str(path) for path in paths if path.suffix == ".toml")]


def one_of(*words: str) -> Callable[[str], list[str]]:
    """For a shell: which of some words a beginning may become."""

    def completed(incomplete: str) -> list[str]:
        return [word for word in words if word.startswith(incomplete)]

    return completed


def some_of(*words: str) -> Callable[[str], list[str]]:
    """As ``one_of``, for the last of several words that commas separate."""
    last_of = one_of(*words)

    def completed(incomplete: str) -> list[str]:
        before, comma, last = incomplete.rpartition(",")
        return [f"{before}{comma}{word}" for word in last_of(last)]

    return completed


FolderArgument = Annotated[Path, typer.Argument(help="Folder that a command has written into.")]
MachineArgument = Annotated[
    str,
    typer.Argument(
        help="A shipped machine (excavator_20t), a folder, or a .toml file.",
        autocompletion=machine_names,
    ),
]
LikeOption = Annotated[
    str,
    typer.Option(
        "--like",
        help="A machine to begin with, as excavator_20t, loader_crane.",
        autocompletion=machine_names,
    ),
]
OutOption = Annotated[
    Path | None,
    typer.Option(
        "--out", help="Folder for all that is written; default: out/<command>_<machine>."
    ),
]
QuietOption = Annotated[
    bool, typer.Option("--quiet", "-q", help="Show nothing but faults: no tables, no progress.")
]
JsonOption = Annotated[
    bool,
    typer.Option("--json", help="Answer with one JSON document on stdout, in place of tables."),
]
SetOption = Annotated[
    list[str],
    typer.Option(
        "--set",
        metavar="PATH=VALUE",
        help="Another number at a key path of the machine file, as fluid.bulk_modulus_MPa=1400,"
        " for this run; again for each further one, of one key the last counts.",
        show_default=False,
    ),
]
ObjectiveOption = Annotated[
    str,
    typer.Option(
        "--objective",
        metavar="gain|worst|bandwidth",
        autocompletion=one_of("gain", "worst", "bandwidth"),
        help="What rises: the least gain in frequency within the bands, the worst frequency within"
        " them, or the least bandwidth of position loops, with the file's values.",
    ),
]
StartsOption = Annotated[
    int | None,
    typer.Option(
        "--starts",
        callback=STARTS,
        help=f"Starts of the search, {SOME_STARTS}; default: 3, or 4 where four-bars move.",
    ),
]
StartsOfSetsOption = Annotated[
    int | None,
    typer.Option(
        "--starts",
        callback=STARTS,
        help=f"Starts of each set of pins, {SOME_STARTS}: today's, the best of one pin less,"
        " then drawn ones; default: the first two.",
    ),
]
WorkersOption = Annotated[
    int | None,
    typer.Option(
        "--workers",
        callback=WORKERS,
        help=f"Processes, {SOME_WORKERS}, that share the starts, and the poses of simulations;"
        " default: 1, for pareto and steps each core.",
    ),
]
PosesWorkersOption = Annotated[
    int, typer.Option("--workers", callback=WORKERS, help=f"Processes for poses, {SOME_WORKERS}.")
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
        " key paths of cylinders, such as cylinder.boom or cylinder.boom.base.at_mm.",
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
    str,
    typer.Option(
        "--least",
        help="Minimise oil, flow or mass instead; needs --frequency.",
        autocompletion=one_of("oil", "flow", "mass"),
    ),
]
FrequencyOption = Annotated[
    float | None,
    typer.Option(
        "--frequency",
        help="Frequency in Hz that no pose of the workspace may fall below, within the bands;"
        " needs --least.",
        show_default=False,
    ),
]
AgainstOption = Annotated[
    str,
    typer.Option(
        "--against",
        help="Limit to vary: oil, thrust, digging, lift or pin_box.",
        autocompletion=one_of("oil", "thrust", "digging", "lift", "pin_box"),
    ),
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
    str,
    typer.Option(
        "--machine",
        help="A machine, whose cylinders and joints the columns name.",
        autocompletion=machine_names,
    ),
]
NewOption = Annotated[
    str,
    typer.Option(
        "--new",
        help="Another machine, whose loops are closed for comparison.",
        autocompletion=machine_names,
    ),
]
DelayOption = Annotated[
    float, typer.Option("--delay", help="Delay between controller and spool in ms.")
]
GainMarginOption = Annotated[
    float, typer.Option("--gain-margin", help="That all loops keep together, in dB.")
]
PhaseMarginOption = Annotated[
    float, typer.Option("--phase-margin", help="That all loops keep together, in deg.")
]
FilterOption = Annotated[
    str,
    typer.Option(
        "--filter",
        help="Of load pressures fed back: high-pass or band-pass.",
        autocompletion=one_of("high-pass", "band-pass"),
    ),
]
CornerOption = Annotated[
    float | None,
    typer.Option(
        "--corner", help="Of that filter, in Hz; default: by each pose's mode.", show_default=False
    ),
]
ChangesArgument = Annotated[
    list[str] | None,  # without any the machine says what could change
    typer.Argument(help="Changes as KEY=VALUE: cylinder.boom.bore_mm=125 …", show_default=False),
]
BandwidthOption = Annotated[
    bool, typer.Option("--bandwidth", help="Bandwidths at the lowest pose, too.")
]
BandwidthOrNotOption = Annotated[
    bool | None,
    typer.Option(
        "--bandwidth/--no-bandwidth",
        help="Bandwidths at the lowest pose must be, or are left out; default: where there are.",
        show_default=False,
    ),
]
CountOption = Annotated[int, typer.Option("--count", help="Number of machines.")]
SeedOption = Annotated[
    int,
    typer.Option(
        "--seed", callback=within("--seed", 0), help="Of the chance; equal ones repeat it."
    ),
]
LeastFrequencyOption = Annotated[
    float | None,
    typer.Option(
        "--least-frequency",
        help="Worst frequency that a machine must reach, in Hz; default: least_hz of the file.",
        show_default=False,
    ),
]
FromOption = Annotated[
    str,
    typer.Option(
        "--from",
        help="Joints in deg, slides in mm: boom=-20,stick=-90,bucket=-90, or numbers in order.",
        show_default=False,
    ),
]
ToOption = Annotated[
    list[str],
    typer.Option(
        "--to",
        help="The same where the move ends; joints not named stay. Again for each further stop.",
        show_default=False,
    ),
]
PayloadOption = Annotated[
    str, typer.Option("--payload", help="A load case, or a mass in kg; default: the first case.")
]
ShaperOption = Annotated[
    str,
    typer.Option(
        "--shaper",
        help="none, zv, zvd, ei: for the end; band: for all of the way and its payloads; or"
        " workspace.",
        autocompletion=one_of("none", "zv", "zvd", "ei", "band", "workspace"),
    ),
]
ShapedModesOption = Annotated[
    int | None,
    typer.Option(
        "--modes",
        help="Number of lowest modes that it is made for; default: up to 4.5 times the lowest.",
    ),
]
DampingOption = Annotated[
    float | None,
    typer.Option("--damping", help="Damping ratio to assume; default: what the file gives."),
]
DurationOption = Annotated[
    float | None,
    typer.Option("--duration", help="In s, without the shaper's delay; default: the shortest."),
]
ShareOption = Annotated[
    float | None,
    typer.Option(
        "--share", help="Share of the pump's flow and of free force to use; default: 0.7, or less."
    ),
]
SpreadOption = Annotated[
    float,
    typer.Option("--spread", help="Tried with payloads this share lighter and heavier, too."),
]
ExportFormatOption = Annotated[
    str,
    typer.Option(
        "--format",
        help="csv, dxf, urdf, sdf; several by commas.",
        autocompletion=some_of("csv", "dxf", "urdf", "sdf"),
    ),
]
NewArgument = Annotated[
    str,
    typer.Argument(
        help="Another machine, drawn over it; default: none.",
        show_default=False,
        autocompletion=machine_names,
    ),
]
PoseOption = Annotated[
    str,
    typer.Option(
        "--pose",
        help="Joints in deg, slides in mm: boom=10,stick=-60; those not named, and by default all,"
        " stand in the middle of their ranges.",
        show_default=False,
    ),
]


HtmlOption = Annotated[
    bool,
    typer.Option(
        "--html", help="Write view.html, a player that needs no network, and serve none."
    ),
]
PortOption = Annotated[
    int | None,
    typer.Option(
        "--port",
        callback=within("--port", 1024, 65535),
        help="Of the page on this computer, 1024 to 65535; default: the first free one from 8080.",
        show_default=False,
    ),
]
NoOpenOption = Annotated[
    bool, typer.Option("--no-open", help="Tell the page's address, and open no browser.")
]


class PictureFormat(StrEnum):
    """Formats of pictures."""

    png = "png"
    svg = "svg"
    pdf = "pdf"


PicturesOption = Annotated[
    PictureFormat, typer.Option("--pictures", help="Pictures in this format too, beside the PNG.")
]
StudyArgument = Annotated[
    Path, typer.Argument(help="A .toml file: machines, what changes in them, and the task.")
]
ProcessesOption = Annotated[
    int | None,
    typer.Option(
        "--workers",
        callback=WORKERS,
        help=f"Processes, {SOME_WORKERS}; default: one per processor.",
        show_default=False,
    ),
]
SchedulerOption = Annotated[
    str,
    typer.Option(
        "--scheduler", help="Address of a dask scheduler, as tcp://host:8786: work on its cluster."
    ),
]
FreshOption = Annotated[
    bool, typer.Option("--new", help="Set an earlier journal aside and begin another.")
]
UnitsOption = Annotated[
    Habit,
    typer.Option(
        "--units",
        help="Units of tables and of a report's maps, not of pictures: mm, bar, l, deg; or SI.",
    ),
]
OutsideOption = Annotated[
    bool, typer.Option("--allow-outside", help="Accept a URDF outside the machine file's folder.")
]
