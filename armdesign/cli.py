"""The command line: ``armdesign map | optimize | validate | design MACHINE --out DIR``, ``armdesign check FILE`` ….

Every command computes first and writes at the end, all files or none. Bad input is one line on
stderr and exit code 2.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from armdesign.errors import ArmDesignError
from armdesign.output import (
    changed,
    check_out,
    check_urdf,
    outputs,
    progress,
    show,
    tell,
    write_csv,
    write_design,
    write_heatmaps,
    write_validations,
)
from armdesign.transaction import as_interrupt
from armdesign.units import SI, WORKSHOP, Units

if TYPE_CHECKING:
    from armdesign.design.catalogue.sizes import Sizes
    from armdesign.design.design import Design
    from armdesign.frequency.bands import Bands
    from armdesign.frequency.workspace import Workspace
    from armdesign.machine.machine import Machine

_UsageError: Any = typer.BadParameter.__base__  # its home differs between versions of typer

INTERRUPTED = 130  # exit code, 128 + SIGINT

app = typer.Typer(
    help="Natural frequencies of hydraulic booms, and the cylinders and pins that raise them.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

MachineArgument = Annotated[
    str, typer.Argument(help="A shipped machine (excavator_20t), its folder, or a .toml file.")
]
OutOption = Annotated[
    Path, typer.Option("--out", help="Folder for everything the command writes.")
]
PointsOption = Annotated[
    str, typer.Option("--points", help="Grid values per joint: one number, or one each: 21,21,61.")
]
VaryOption = Annotated[
    str,
    typer.Option(
        "--vary",
        help=(
            "What may change, commas between: areas, pins, linkages (pins and four-bars), or key"
            " paths of the file: cylinder.boom.bore_mm,cylinder.bucket.four_bar."
        ),
    ),
]

AgainstOption = Annotated[
    str, typer.Option("--against", help="The limit that moves: oil, thrust, digging, pin_box.")
]
ValuesOption = Annotated[
    str,
    typer.Option(
        "--values", help="Of that limit, commas between: shares of today's, or the pin box in m."
    ),
]
CatalogueOption = Annotated[
    str,
    typer.Option(
        "--catalogue", help="Sizes to choose from: iso, 5mm, or a CSV file with bore_mm, rod_mm."
    ),
]
RobustOption = Annotated[
    bool,
    typer.Option(
        "--robust", help="Raise the worst frequency within the file's [bands], not at its values."
    ),
]
OutsideOption = Annotated[
    bool, typer.Option("--allow-outside", help="Allow a URDF outside the machine file's folder.")
]


class Habit(StrEnum):
    """Units of printed tables."""

    workshop = "workshop"
    si = "si"

    @property
    def units(self) -> Units:
        """The units themselves."""
        return SI if self is Habit.si else WORKSHOP


UnitsOption = Annotated[
    Habit, typer.Option("--units", help="Units of printed tables: mm, bar, l, kN, deg or SI.")
]


@app.callback()
def _root() -> None:
    pass


@app.command("map")
def map_command(
    machine: MachineArgument,
    out: OutOption = Path("out"),
    points: PointsOption = "",
    units: UnitsOption = Habit.workshop,
    allow_outside: OutsideOption = False,
) -> None:
    """Find the worst pose; write map.csv, heatmaps.

    Prints the worst pose, percentiles, which cylinder limits and what holds the lowest mode.
    Writes map.csv and stiffness.csv, heatmaps over joints and over the tool's reach, static
    pressures, moment arms.
    """
    from armdesign import plots
    from armdesign.frequency.maps import frequency_map
    from armdesign.report.maps import map_sheets

    with progress("mapping the workspace"):
        model, workspace = _model(machine, points, out, allow_outside)
        frequencies = frequency_map(model, workspace)
    with outputs(out) as folder:
        write_csv(frequencies.frame, folder / "map.csv")
        write_csv(frequencies.stiffness, folder / "stiffness.csv")
        write_heatmaps(frequencies, folder)
        if model.cylinders:  # motors have no moment arm that changes
            plots.save(plots.moment_arm_curves({model.name: model}), folder / "moment_arms.png")
    show(map_sheets(frequencies, units.units))


@app.command()
def optimize(
    machine: MachineArgument,
    out: OutOption = Path("out"),
    points: PointsOption = "",
    vary: VaryOption = "areas,pins",
    catalogue: CatalogueOption = "",
    least: Annotated[
        str, typer.Option("--least", help="With --frequency: make oil, flow or mass least.")
    ] = "",
    frequency: Annotated[
        float, typer.Option("--frequency", help="Worst frequency [Hz] that is enough.")
    ] = 0.0,
    robust: RobustOption = False,
    units: UnitsOption = Habit.workshop,
    allow_outside: OutsideOption = False,
) -> None:
    """Find new sizes and pins; write the machine.

    Writes <name>_optimized.toml and its URDF, maps before and after on one colour scale, moment
    arms.
    """
    from armdesign.report.designs import design_sheets

    if bool(least) != bool(frequency):
        raise ArmDesignError("--least", "goes with --frequency", "give both, or neither")
    with progress("mapping the workspace") as say:
        model, workspace = _model(machine, points, out, allow_outside)
        check_urdf(model, out)
        bands = _bands(model) if robust else None
        if least:
            design = _least(model, workspace, vary, catalogue, least, frequency, bands, say)
        else:
            design = _design(model, workspace, vary, catalogue, bands, say)
    with outputs(out) as folder:
        write_design(design, folder)
    show(design_sheets(design, units.units))


@app.command()
def pareto(
    machine: MachineArgument,
    against: AgainstOption = "oil",
    values: ValuesOption = "",
    out: OutOption = Path("out"),
    points: PointsOption = "",
    vary: VaryOption = "areas,pins",
    catalogue: CatalogueOption = "",
    robust: RobustOption = False,
    units: UnitsOption = Habit.workshop,
    allow_outside: OutsideOption = False,
) -> None:
    """What frequency costs in oil, thrust, digging or pin room.

    A best design for each value of one limit; writes pareto.csv and pareto.png.
    """
    from armdesign import plots
    from armdesign.design.pareto import pareto as trade_off
    from armdesign.design.pareto import read_values
    from armdesign.report.designs import pareto_sheet

    with progress("looking for the best design under each limit"):
        numbers = read_values(values, against)
        model, workspace = _model(machine, points, out, allow_outside)
        bands, sizes = _bands(model) if robust else None, _offered(catalogue)
        found = trade_off(
            model,
            workspace,
            against=against,
            values=numbers,
            vary=_words(vary),
            bands=bands,
            catalogue=sizes,
        )
        table = found.frame
    with outputs(out) as folder:
        write_csv(table, folder / "pareto.csv")
        plots.save(found.plot().figure, folder / "pareto.png")
    show([pareto_sheet(found, units.units)])


@app.command()
def validate(
    machine: MachineArgument,
    out: OutOption = Path("out"),
    points: PointsOption = "",
    units: UnitsOption = Habit.workshop,
    allow_outside: OutsideOption = False,
) -> None:
    """Prove the linear answer in nonlinear runs.

    Every cylinder at the worst, the median and the best pose; writes validation.csv and the
    frequency responses.
    """
    from armdesign import plots
    from armdesign.report.validations import validation_sheet, verdict
    from armdesign.simulation import validation

    with progress("simulating the worst, the median and the best pose"):
        model, workspace = _model(machine, points, out, allow_outside)
        validations = validation.validate(model, workspace=workspace).by_pose
    with outputs(out) as folder:
        write_validations(validations, folder)
        plots.save(plots.frequency_responses(validations), folder / "frequency_responses.png")
    show([validation_sheet(validations), verdict(list(validations.values()))])


@app.command()
def design(
    machine: MachineArgument,
    out: OutOption = Path("out"),
    points: PointsOption = "",
    catalogue: CatalogueOption = "",
    robust: RobustOption = False,
    units: UnitsOption = Habit.workshop,
    allow_outside: OutsideOption = False,
) -> None:
    """The main job: all three, and report.html.

    Maps today's machine, finds a new one, proves both in nonlinear runs; writes machine file,
    maps, CSVs and report.
    """
    from armdesign import plots
    from armdesign.report.designs import design_sheets, summary
    from armdesign.report.sheet import html
    from armdesign.report.validations import validation_sheet, verdict
    from armdesign.simulation.validation import validate_maps

    with progress("mapping the workspace") as say:
        model, workspace = _model(machine, points, out, allow_outside)
        check_urdf(model, out)
        answer = _design(
            model, workspace, "areas,pins", catalogue, _bands(model) if robust else None, say
        )
        say("simulating the worst, the median and the best pose, today and new")
        proof = dict(
            zip(("today", "new"), validate_maps([answer.before, answer.after]), strict=True)
        )
        say("writing the report")
        sheets, worst = (
            design_sheets(answer, units.units),
            {k: v.by_pose["worst"] for k, v in proof.items()},
        )
        every = {
            f"{label} {pose}": one
            for label, found in proof.items()
            for pose, one in found.by_pose.items()
        }
        said = verdict(list(proof.values()))
        with outputs(out) as folder:
            pictures = write_design(answer, folder)
            write_validations(proof, folder, "version")
            response = plots.save(
                plots.frequency_responses(worst), folder / "frequency_responses.png"
            )
            pictures.append(
                ("Nonlinear simulation: a small slow sweep at each machine's worst pose", response)
            )
            title = f"{model.section.title or model.name}: new cylinders and pins"
            lead = f"{summary(answer)} In nonlinear simulation, {said}."
            page = html(title, lead, [*sheets, validation_sheet(every)], pictures)
            (folder / "report.html").write_text(page, encoding="utf-8")
        shown = validation_sheet({label: found.limiting for label, found in worst.items()})
        sheets.append(dataclasses.replace(shown, note=f"{said}: validation.csv; {shown.note}"))
    show([*sheets, summary(answer)])


@app.command()
def check(
    machine: MachineArgument,
    points: PointsOption = "",
    units: UnitsOption = Habit.workshop,
    allow_outside: OutsideOption = False,
) -> None:
    """Explain a machine file, or list all that is wrong.

    Masses, joint ranges and what ends them, reach, moment arms, static pressures, what looks odd.
    Writes nothing.
    """
    from armdesign.frequency.workspace import Workspace
    from armdesign.inspection.file_faults import faults as faults_of
    from armdesign.inspection.inspection import inspect
    from armdesign.machine.loading import load
    from armdesign.report.inspections import check_sheets

    counts = _counts(points)
    with progress("reading the file"):
        faults = faults_of(machine, allow_outside=allow_outside)
        if not faults:
            model = load(machine, allow_outside=allow_outside)
            sheets = check_sheets(inspect(model, Workspace.grid(model, counts)), units.units)
    if faults:
        for fault in faults:
            tell(f"armdesign: {fault}", sys.stderr)
        raise typer.Exit(2)
    show(sheets)


@app.command()
def compare(
    first: MachineArgument,
    second: MachineArgument,
    out: OutOption = Path("out"),
    points: PointsOption = "",
    units: UnitsOption = Habit.workshop,
    allow_outside: OutsideOption = False,
) -> None:
    """Two machines, or two versions of one, side by side.

    Worst poses, percentiles, what limits, what differs in the files; compare.csv and heatmaps on
    one colour scale.
    """
    from armdesign import plots
    from armdesign.machine.loading import load
    from armdesign.report import comparison

    with progress("mapping both machines"):
        counts = _counts(points)
        check_out(out)
        one, other = (load(machine, allow_outside=allow_outside) for machine in (first, second))
        found = comparison.compare(one, other, counts)
    with outputs(out) as folder:
        write_csv(found.frame, folder / "compare.csv")
        for plane in ("joints", "reach"):
            plots.save(found.plot(plane), folder / f"compare_{plane}.png")
    show(found.sheets(units.units))


@app.command()
def new(
    name: Annotated[str, typer.Argument(help="Name of the new machine and its files.")],
    links: Annotated[int, typer.Option("--links", help="Number of moving links, 1 to 6.")] = 2,
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for the files; default: one named NAME.")
    ] = None,
) -> None:
    """Write a commented starting machine file and URDF.

    It loads and maps at once; every number in it is a placeholder to be replaced.
    """
    from armdesign.machine import scaffold
    from armdesign.machine.json_schema import json_schema

    text, urdf = scaffold.new(name, links)
    folder = Path(name) if out is None else out
    check_out(folder)
    files = {f"{name}.toml": text, f"{name}.urdf": urdf}
    for file in files:
        if (folder / file).exists():
            raise ArmDesignError(
                str(folder / file), "exists already", "give another name or --out another folder"
            )
    if not (
        folder / "machine.schema.json"
    ).exists():  # which editors read; several machines may share it
        files["machine.schema.json"] = json_schema()
    with outputs(folder) as place:
        for file, content in files.items():
            (place / file).write_text(content, encoding="utf-8")
    tell(f"next: armdesign map {folder / f'{name}.toml'}")


@app.command()
def paper(out: OutOption = Path("out")) -> None:
    """The source paper's 40 configurations, simulated.

    Its formulas against what nonlinear runs identify, its way and at small amplitude; its errata;
    what could have given its printed error; what a sweep alone gets wrong. Writes paper.csv,
    paper_errors.csv, paper_errata.csv, paper_scan.csv, paper_sweep_bias.csv and its figures.
    """
    from armdesign import plots
    from armdesign.paper import reproduction as source
    from armdesign.paper.sheets import paper_sheets
    from armdesign.simulation.identification.sweep_bias import sweep_bias

    check_out(out)
    with progress("sweeping 40 configurations"):
        found = source.reproduce()
        errata, scan, bias = source.errata(found.mechanism), source.scan(), sweep_bias()
    pictures = {"3_4": "static_11", "5_6": "joint_42_as_printed", "5_6_exact": "joint_exact"}
    with outputs(out) as folder:
        write_csv(found.frame, folder / "paper.csv")
        write_csv(found.errors.reset_index(), folder / "paper_errors.csv")
        write_csv(source.errata_frame(errata), folder / "paper_errata.csv")
        write_csv(scan, folder / "paper_scan.csv")
        write_csv(bias, folder / "paper_sweep_bias.csv")
        for name, formula in pictures.items():
            plots.save(found.plot(formula), folder / f"paper_figures_{name}.png")
    show(paper_sheets(found, errata, scan, bias))


def _design(
    model: Machine,
    workspace: Workspace,
    vary: str,
    catalogue: str,
    bands: Bands | None,
    say: Callable[[str], None],
) -> Design:
    from armdesign.design.design import optimize, size_cylinders

    words = _words(vary)
    say("looking for better sizes" if words == ("areas",) else "looking for a better design")
    offered = _offered(catalogue)
    if words == ("areas",):
        made = size_cylinders(model, workspace, bands=bands, catalogue=offered)
    else:
        made = optimize(model, workspace, vary=words, bands=bands, catalogue=offered)
    say("mapping the new machine")
    _ = made.before, made.after
    return made


def _least(
    model: Machine,
    workspace: Workspace,
    vary: str,
    catalogue: str,
    of: str,
    frequency: float,
    bands: Bands | None,
    say: Callable[[str], None],
) -> Design:
    from armdesign.design.least import least

    say(f"looking for the least {of}")
    sizes = _offered(catalogue)
    made = least(
        model,
        workspace,
        frequency=frequency,
        of=of,
        vary=_words(vary),
        bands=bands,
        catalogue=sizes,
    )
    say("mapping the new machine")
    _ = made.before, made.after
    return made


def _offered(catalogue: str) -> str | Sizes | None:
    """What ``--catalogue`` asks for."""
    from armdesign.design.catalogue.sizes import read_sizes

    return read_sizes(catalogue) if catalogue.lower().endswith(".csv") else catalogue or None


def _model(machine: str, points: str, out: Path, allow_outside: bool) -> tuple[Machine, Workspace]:
    """The machine and its workspace.

    What is wrong with the options is said before anything is computed.
    """
    from armdesign.frequency.workspace import Workspace
    from armdesign.machine.loading import load

    counts = _counts(points)
    check_out(out)
    model = load(machine, allow_outside=allow_outside)
    return model, Workspace.grid(model, counts)


def _bands(model: Machine) -> Bands:
    """What ``--robust`` asks for: the bands of the file."""
    from armdesign.frequency.bands import Bands

    stated = Bands.of(model)
    if stated == Bands():
        example = "payload_share = [0.8, 1.2]"
        raise ArmDesignError(
            "--robust",
            f"{model.source.name} states no bands",
            f"add [bands] to it, like {example}",
        )
    return stated


def _counts(points: str) -> int | list[int] | None:
    """What ``--points`` asks for."""
    try:
        counts = [int(word) for word in points.split(",")] if points else None
    except ValueError:
        raise ArmDesignError(
            "--points", f'"{points}" is not a list of numbers', "give 21 or 21,21,61"
        ) from None
    return counts[0] if counts and len(counts) == 1 else counts


def _words(text: str) -> tuple[str, ...]:
    """What an option lists, commas between."""
    return tuple(word.strip() for word in text.split(",") if word.strip())


def main() -> None:
    """Entry point of ``armdesign``: bad input becomes one line on stderr and exit code 2."""
    changed.clear()
    with as_interrupt() as came:
        try:
            code = app(standalone_mode=False)
            if code != INTERRUPTED:  # as typer answers Ctrl-C
                sys.exit(code)
        except ArmDesignError as error:
            tell(f"armdesign: {error}", sys.stderr)
            sys.exit(2)
        except _UsageError as error:
            message = error.format_message().replace("Value error, ", "")
            for line in (
                message.splitlines() if message.startswith("Usage") else [f"armdesign: {message}"]
            ):
                tell(line, sys.stderr)
            sys.exit(2)
        except (KeyboardInterrupt, typer.Abort) as error:
            if isinstance(
                error.__cause__, EOFError
            ):  # which typer takes for Ctrl-D; nobody is asked anything here
                raise error.__cause__ from None
        tell(
            f"armdesign: interrupted; {'all was written' if changed else 'nothing was written'}",
            sys.stderr,
        )
        sys.exit(128 + came[-1] if came else INTERRUPTED)


if __name__ == "__main__":
    main()
