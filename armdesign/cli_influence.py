"""Commands of what numbers are worth: ``armdesign sensitivity``, ``what-if``, ``tolerances``."""

from __future__ import annotations

from armdesign.errors import ArmDesignError
from armdesign.option_values import grid_points
from armdesign.options import (
    BandwidthOption,
    BandwidthOrNotOption,
    ChangesArgument,
    CountOption,
    DampingOption,
    LeastFrequencyOption,
    SeedOption,
)
from armdesign.output import write_csv
from armdesign.runs import OverWorkspace, command


@command
def sensitivity(
    run: OverWorkspace, bandwidth: BandwidthOption = False, damping: DampingOption = None
) -> None:
    """Say what each number of the machine file is worth.

    Prints the worst pose with its rivals, and by how much the worst frequency changes with a
    natural step of every number: 10 mm, 100 kg, 1 % air, 10 MN/m …. Writes sensitivity.csv and
    sensitivity.png; with --bandwidth sensitivity_bandwidth.csv, too.
    """
    from armdesign import plots
    from armdesign.influence.sensitivity import bandwidth_sheet
    from armdesign.influence.sensitivity import sensitivity as of_every_number

    _refuse_damping_alone(damping, bandwidth)
    with run.progress("looking for the worst pose and its rivals"):
        model, workspace, out = run.open_workspace()
        answer = of_every_number(model, workspace)
        tables, sheets = {"sensitivity": answer.frame}, answer.sheets(run.units.units)
        if bandwidth:
            tables["sensitivity_bandwidth"] = answer.bandwidths(damping)
            sheets.append(bandwidth_sheet(answer, tables["sensitivity_bandwidth"], damping))
    with run.writing(out) as folder:
        for name, table in tables.items():
            write_csv(table, folder / f"{name}.csv")
        plots.save(answer.plot().figure, folder / "sensitivity.png")
    run.show(sheets, tables=tables)


@command
def what_if(
    run: OverWorkspace,
    changes: ChangesArgument = None,
    bandwidth: BandwidthOrNotOption = None,
    damping: DampingOption = None,
) -> None:
    """Say what changes with other numbers in the file.

    Prints worst poses, percentiles, bandwidths, lift, digging forces, speeds, pressures and
    buckling before and after, with the linear estimate beside the exact answer. Writes what_if.csv
    and a picture.
    """
    from armdesign import plots
    from armdesign.influence.what_if import what_if as with_changes
    from armdesign.machine.changes import read_changes

    if damping is not None and bandwidth is False:
        raise ArmDesignError("--damping", "is of the bandwidth", "leave out --no-bandwidth")
    with run.progress("mapping the machine with other numbers"):
        stated, counts = read_changes(changes or []), grid_points(run.points)
        model, out = run.open()
        answer = with_changes(model, stated, counts, bandwidth=bandwidth, damping=damping)
    with run.writing(out) as folder:
        write_csv(answer.frame, folder / "what_if.csv")
        plots.save(answer.plot().figure, folder / "what_if.png")
    run.show(answer.sheets(run.units.units), tables={"what_if": answer.frame})


@command
def tolerances(
    run: OverWorkspace,
    count: CountOption = 10_000,
    least: LeastFrequencyOption = None,
    seed: SeedOption = 0,
) -> None:
    """Say how machines of one drawing differ.

    Takes the widths of the file's [tolerances]. Prints the share of machines that reach the least
    frequency, that of the first 256 that meet every requirement and which are missed most often,
    percentiles, and where derivatives fail. Writes tolerances.csv, a row for each number that
    differs, requirements.csv, machines.csv, a row for each machine, and tolerances.png.
    """
    from armdesign import plots
    from armdesign.influence.tolerances import tolerances as of_machines

    with run.progress("varying the machine"):
        model, workspace, out = run.open_workspace()
        answer = of_machines(model, workspace, count=count, least=least, seed=seed)
        tables = {"tolerances": answer.by_number, "requirements": answer.acceptance.frame}
    with run.writing(out) as folder:
        for name, table in tables.items():
            write_csv(table, folder / f"{name}.csv")
        write_csv(answer.frame, folder / "machines.csv")
        plots.save(answer.plot().figure, folder / "tolerances.png")
    run.show(answer.sheets(run.units.units), tables=tables)


def _refuse_damping_alone(damping: float | None, bandwidth: bool) -> None:
    if damping is not None and not bandwidth:
        raise ArmDesignError("--damping", "goes with --bandwidth", "give both, or neither")
