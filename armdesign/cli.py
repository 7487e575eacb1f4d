"""The command line: ``armdesign map | optimize | validate | design MACHINE --out DIR`` and others.

Every command computes first and writes at the end, all files or none; ``design``, interrupted
after its search, keeps the new machine. Bad input is one line on stderr and exit code 2.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from armdesign import __version__, output, output_reports
from armdesign.cli_control import control
from armdesign.cli_draw import draw
from armdesign.cli_export import export
from armdesign.cli_influence import sensitivity, tolerances, what_if
from armdesign.cli_measured import calibrate, identify
from armdesign.cli_motion import move
from armdesign.cli_paper import paper
from armdesign.cli_report import report
from armdesign.cli_sweep import sweep
from armdesign.cli_tradeoffs import pareto, steps
from armdesign.cli_view import view
from armdesign.errors import ArmDesignError
from armdesign.option_values import grid_points, listed, plainly, refuse_empty
from armdesign.options import (
    FrequencyOption,
    LeastOption,
    LikeOption,
    MachineArgument,
    PointsOption,
    PosesWorkersOption,
    VaryOption,
)
from armdesign.output import tell, write_csv
from armdesign.package_files import refuse_archive
from armdesign.runs import AimedSearch, OfMachines, OverWorkspace, Shown, command
from armdesign.streams import printing
from armdesign.transaction import as_interrupt

if TYPE_CHECKING:
    from armdesign.design.design import Design
    from armdesign.frequency.workspace import Workspace
    from armdesign.machine.machine import Machine

_UsageError: Any = typer.BadParameter.__base__  # its home differs between versions of typer

INTERRUPTED = 130  # exit code, 128 + SIGINT

app = typer.Typer(
    help="Natural frequencies of hydraulic booms, and the cylinders and pins that raise them.",
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _tell_version(wanted: bool) -> None:
    if wanted:
        tell(f"armdesign {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_tell_version, is_eager=True, help="Show the version and exit."
        ),
    ] = False,
) -> None:
    pass


@app.command("map")
@command
def map_command(run: OverWorkspace) -> None:
    """Find the worst pose of a machine.

    Prints the lowest natural frequency and its pose, percentiles, the limiting cylinder, and the
    origin of the stiffness, and the lift chart. Writes map.csv, stiffness.csv, lift_chart.csv,
    pictures of frequencies, static pressures, moment arms and lift, and report.html.
    """
    from armdesign import plots
    from armdesign.frequency.maps import frequency_map
    from armdesign.report.lift_charts import lift_charts
    from armdesign.report.maps import map_sheets
    from armdesign.sweeps.numbers import of_map

    with run.progress("mapping the workspace"):
        model, workspace, out = run.open_workspace()
        frequencies = frequency_map(model, workspace)
        sheets = map_sheets(frequencies, run.units.units)
    with run.writing(out) as folder:
        write_csv(frequencies.columns, folder / "map.csv")
        write_csv(frequencies.stiffness_columns, folder / "stiffness.csv")
        output.write_heatmaps(frequencies, folder)
        output.write_lift_charts(lift_charts({plots.title_of(model): model}), folder)
        plots.save(plots.moment_arm_curves({model.name: model}), folder / "moment_arms.png")
        output_reports.write_map_report(frequencies, sheets, run.origin(), folder, run.units.units)
    run.show(sheets, lambda: of_map(frequencies))


@app.command()
@command
def optimize(
    run: OverWorkspace,
    search: AimedSearch,
    vary: VaryOption = "areas,pins",
    of: LeastOption = "",
    frequency: FrequencyOption = None,
) -> None:
    """Find better cylinder sizes and pins.

    Maximises the lowest natural frequency over the workspace. Writes the new machine as
    <name>_optimized.toml, with its URDF where it has one; maps and moment arms before and after.
    """
    from armdesign.report.designs import design_sheets
    from armdesign.report.least import least_sentence
    from armdesign.sweeps.numbers import of_search

    if bool(of) != (frequency is not None):
        raise ArmDesignError("--least", "goes with --frequency", "give both, or neither")
    with run.progress("mapping the workspace") as say:
        model, workspace, out = run.open_workspace()
        output.check_urdf(model, out)
        run.go_on(out)
        options: dict[str, Any] = {"vary": listed(vary), **search.settings}
        if of:
            for name, default in (("objective", "gain"), ("damping", None)):
                if options.pop(name) != default:
                    fault = "goes not with --least, which has an aim of its own"
                    raise ArmDesignError(f"--{name}", fault, "give one of them")
            options |= {"of": of, "frequency": frequency}
        design = _design(model, workspace, options, say)
    with run.writing(out) as folder:
        output.write_design(design, folder)
    leads = []
    if of and frequency is not None:
        leads.append(least_sentence(design, of, frequency, run.units.units))
    stopped = None
    with run.progress("proving how much more no design can reach; Ctrl-C: the answer without"):
        try:
            sheets = design_sheets(design, run.units.units)
        except KeyboardInterrupt as stop:
            design, stopped = design.unproved(), stop
            sheets = design_sheets(design, run.units.units)
    run.show([*leads, *sheets], lambda: of_search(design, of))
    if stopped is not None:
        raise stopped


@app.command()
@command
def validate(run: OverWorkspace, workers: PosesWorkersOption = 1) -> None:
    """Compare the linear answer with nonlinear simulation.

    Moves every cylinder at the worst, the median and the best pose. Writes validation.csv,
    frequency responses and report.html.
    """
    from armdesign import plots
    from armdesign.drawing.colours import actuator_colours
    from armdesign.report.contents import Picture
    from armdesign.report.validations import validation_chart, validation_sheet, verdict
    from armdesign.simulation import validation
    from armdesign.sweeps.numbers import of_validation

    with run.progress("simulating the worst, the median and the best pose"):
        model, workspace, out = run.open_workspace()
        run.go_on(out)
        answer = validation.validate(model, workspace=workspace, workers=workers)
        validations = answer.by_pose
    items: list[Any] = [validation_sheet(validations), f"{verdict(list(validations.values()))}."]
    charts = {"deviations.png": validation_chart(answer, actuator_colours(model))}
    caption = "Sweeps of the limiting cylinder at each pose"
    responses = Picture(caption=caption, file="frequency_responses.png")
    title = f"{model.section.title or model.name}: nonlinear against linear frequencies"
    provenance = run.origin().sheet({"": model})
    with run.writing(out) as folder:
        output.write_validations(validations, folder)
        plots.save(plots.frequency_responses(validations), folder / responses.file)
        drawn = model, validations["worst"].sweeps[0].q
        output_reports.write_plain_report(
            title, items, [responses], charts, drawn, provenance, folder
        )
    tables = {"validation": output.validation_columns(validations)}
    run.show(items, lambda: of_validation(answer), tables)


@app.command()
@command
def design(run: OverWorkspace, search: AimedSearch) -> None:
    """Map, optimize and validate; write report.html.

    The main job: finds better cylinders and pins, and compares today's and the new machine in
    nonlinear simulation. Writes the new machine file, maps, CSV files and the report.
    """
    from armdesign.report.designs import design_sheets, summary
    from armdesign.report.validations import limiting_sheet
    from armdesign.simulation.plant.compiled import refuse_switched_off
    from armdesign.simulation.validation import validate_maps
    from armdesign.sweeps.numbers import of_search, of_validation

    with run.progress("mapping the workspace") as say:
        model, workspace, out = run.open_workspace()
        output.check_urdf(model, out)
        refuse_switched_off()
        run.go_on(out)
        answer = _design(model, workspace, {"vary": ("areas", "pins"), **search.settings}, say)
        say("simulating the worst, the median and the best pose, today and new")
        try:
            both = validate_maps([answer.before, answer.after], search.workers or 1)
        except KeyboardInterrupt:
            with run.writing(out) as folder:
                output.write_machine(answer, folder)
            raise
        proofs = dict(zip(("today", "new"), both, strict=True))
        say("writing the report")
        sheets = design_sheets(answer, run.units.units)
        with run.writing(out) as folder:
            output_reports.write_report(
                answer, proofs, run.origin(search), folder, run.units.units
            )
    shown: list[Any] = [*sheets, limiting_sheet(proofs), summary(answer)]
    tables = {"validation": output.validation_columns(proofs, "version")}
    run.show(shown, lambda: {**of_validation(proofs["new"]), **of_search(answer)}, tables)


@app.command()
@command
def check(run: OverWorkspace) -> None:
    """Explain a machine file, or list its faults.

    Prints masses, joint ranges and what ends them, reach, moment arms, static pressures and
    implausible values; of a file without faults writes machine.png, a drawing to scale, and
    lift_chart.csv and lift_chart.png.
    """
    from armdesign import output, plots
    from armdesign.frequency.workspace import Workspace
    from armdesign.inspection import file_faults
    from armdesign.inspection.inspection import inspect
    from armdesign.report.inspections import check_sheets, lift_faults
    from armdesign.report.lift_charts import lift_charts

    counts = grid_points(run.points)
    with run.progress("reading the file"):
        faults = file_faults.faults(run.machine, allow_outside=run.allow_outside)
        if not faults:
            model = run.load(run.machine)
            out = run.folder(model.source)
            faults = list(lift_faults(model))
        if not faults:
            inspection = inspect(model, Workspace.grid(model, counts))
            sheets = check_sheets(inspection, run.units.units)
    run.refuse(faults)
    run.show(sheets)
    with run.writing(out) as folder:
        plots.save(plots.machine_drawing(model).figure, folder / "machine.png")
        output.write_lift_charts(lift_charts({plots.title_of(model): model}), folder)


@app.command()
@command
def compare(
    run: OfMachines, first: MachineArgument, second: MachineArgument, points: PointsOption = ""
) -> None:
    """Compare two machines, or two versions of one.

    Prints worst poses, percentiles, limiting cylinders, lift charts and the differences of the
    files. Writes compare.csv, lift_chart.csv, maps and lift charts on one colour scale, and
    overlay.png: both over each other, moved pins as arrows.
    """
    from armdesign import plots
    from armdesign.report import comparison

    with run.progress("mapping both machines"):
        counts = grid_points(points)
        one, other = map(run.load, (first, second))
        out = run.folder(one.source, other.source)
        compared = comparison.compare(one, other, counts)
    with run.writing(out) as folder:
        write_csv(compared.frame, folder / "compare.csv")
        for plane in ("joints", "reach"):
            plots.save(compared.plot(plane), folder / f"compare_{plane}.png")
        output.write_overlay(compared.maps, folder)
        output.write_lift_charts(compared.lift_charts, folder)
    run.show(compared.items(run.units.units), tables={"compare": compared.frame})


@app.command()
@command
def new(
    run: Shown,
    name: Annotated[str, typer.Argument(help="Name of the new machine and of its files.")],
    links: Annotated[
        int | None,
        typer.Option(
            "--links", help="Number of moving links, 1 to 6; default: 2.", show_default=False
        ),
    ] = None,
    like: LikeOption = "",
    four_bar: Annotated[
        bool, typer.Option("--four-bar", help="Move the last joint through a four-bar.")
    ] = False,
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for the files; default: one named NAME.")
    ] = None,
) -> None:
    """Write a commented starting machine file.

    It can be mapped at once. Every number in it is a placeholder, to be replaced.
    """
    from armdesign.machine import template
    from armdesign.machine.file.json_schema import json_schema

    if like and links is not None:
        raise ArmDesignError("--links", "contradicts --like", "give one of them")
    text = template.new(name, links=2 if links is None else links, like=like, four_bar=four_bar)
    folder = Path(name) if out is None else out
    output.check_out(folder)
    files = {f"{name}.toml": text}
    for file in files:
        if (folder / file).exists():
            remedy = "give another name or --out another folder"
            raise ArmDesignError(str(folder / file), "exists already", remedy)
    if not (folder / "machine.schema.json").exists():  # for editors; machines may share it
        files["machine.schema.json"] = json_schema()
    with run.writing(folder) as place:
        for file, content in files.items():
            (place / file).write_text(content, encoding="utf-8")
    run.show([f"next: armdesign check {folder / f'{name}.toml'}"])


app.command()(identify)
app.command()(calibrate)
app.command()(pareto)
app.command()(steps)
app.command()(control)
app.command()(draw)
app.command()(view)
app.command()(move)
app.command()(report)
app.command()(export)
app.command()(sensitivity)
app.command("what-if")(what_if)
app.command()(tolerances)
app.command()(sweep)
app.command()(paper)


def _design(
    model: Machine, workspace: Workspace, options: dict[str, Any], say: Callable[[str], None]
) -> Design:
    """New machine, mapped, by the search that the options ask for."""
    from armdesign.design.least import least
    from armdesign.design.optimize import size_cylinders
    from armdesign.optimization import only_sizes, optimize

    if "of" in options:
        say(f"searching for the least {options['of']}")
        answer = least(model, workspace, **options)
    elif only_sizes(options["vary"], options["objective"], options["damping"]):
        say("searching for better sizes")
        if options["starts"] is not None:
            fault = "mean nothing where sizes alone vary: there is one search"
            raise ArmDesignError("--starts", fault, "leave them out")
        given = {name: options[name] for name in ("bands", "catalogue", "objective")}
        answer = size_cylinders(model, workspace, **given)
    else:
        say("searching for a better design")
        answer = optimize(model, workspace, **options)
    say("mapping the new machine")
    _ = answer.before, answer.after
    return answer


def _end_workers() -> None:
    """End processes that an interrupt kept out of their pool: Python would wait for them."""
    if "multiprocessing" in sys.modules:
        for worker in sys.modules["multiprocessing"].active_children():
            worker.terminate()


def main() -> None:
    """Entry point of ``armdesign``: bad input becomes one line on stderr and exit code 2."""
    output.changed.clear()
    output.stops.clear()
    output.kept.clear()
    with as_interrupt() as signals, printing():
        try:
            refuse_archive()
            refuse_empty(sys.argv[1:])
            code = app(standalone_mode=False)
            if code != INTERRUPTED:  # as typer answers Ctrl-C
                sys.exit(code)
        except ArmDesignError as error:
            output.tell_error(error)
            sys.exit(2)
        except _UsageError as error:
            message = plainly(error, sys.argv[1:])
            usage = message.startswith("Usage")
            for line in message.splitlines() if usage else [f"armdesign: {message}"]:
                tell(line, sys.stderr)
            sys.exit(2)
        except (KeyboardInterrupt, typer.Abort) as error:
            # typer takes an end of file for Ctrl-D, but no command asks for input
            if isinstance(error.__cause__, EOFError):
                raise error.__cause__ from None
        _end_workers()
        tell(f"armdesign: {output.interruption()}", sys.stderr)
        sys.exit(128 + signals[-1] if signals else INTERRUPTED)
