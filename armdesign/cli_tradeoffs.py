"""Commands that find several designs: ``armdesign pareto`` and ``armdesign steps``."""

from __future__ import annotations

import os
from pathlib import Path

from armdesign.options import (
    AgainstOption,
    CatalogueOption,
    FreeOption,
    Habit,
    MachineArgument,
    NominalOption,
    OutOption,
    OutsideOption,
    PointsOption,
    UnitsOption,
    ValuesOption,
    VaryOption,
    bands_to_use,
    listed,
    offered_sizes,
    open_workspace,
)
from armdesign.output import outputs, show, write_csv
from armdesign.progress import progress


def pareto(
    machine: MachineArgument,
    against: AgainstOption = "oil",
    values: ValuesOption = "",
    out: OutOption = Path("out"),
    points: PointsOption = "",
    vary: VaryOption = "areas,pins",
    catalogue: CatalogueOption = "",
    free: FreeOption = False,
    nominal: NominalOption = False,
    units: UnitsOption = Habit.workshop,
    allow_outside: OutsideOption = False,
) -> None:
    """Trade frequency against oil, thrust, digging, lift or pin room.

    Finds the best design for each value of one limit. Writes pareto.csv and pareto.png.
    """
    from armdesign import plots
    from armdesign.design.pareto import pareto as trade_off
    from armdesign.design.pareto import read_values
    from armdesign.report.designs import pareto_sheet

    with progress("searching for the best design under each limit"):
        limits = read_values(values, against)
        model, workspace = open_workspace(machine, points, out, allow_outside)
        bands, sizes = bands_to_use(nominal), offered_sizes(catalogue, free)
        front = trade_off(
            model,
            workspace,
            against=against,
            values=limits,
            vary=listed(vary),
            bands=bands,
            catalogue=sizes,
        )
        table = front.frame
    with outputs(out) as folder:
        write_csv(table, folder / "pareto.csv")
        plots.save(front.plot().figure, folder / "pareto.png")
    show([pareto_sheet(front, units.units)])


def steps(
    machine: MachineArgument,
    out: OutOption = Path("out"),
    points: PointsOption = "",
    catalogue: CatalogueOption = "",
    free: FreeOption = False,
    nominal: NominalOption = False,
    allow_outside: OutsideOption = False,
) -> None:
    """Say which change to make first.

    Finds the best machine with other cylinders alone, with one pin moved, with two, up to all.
    Writes steps.csv, and each machine as <name>_<pins>_pins.toml with its URDF.
    """
    from armdesign import output
    from armdesign.design.steps import steps as with_more_and_more_pins
    from armdesign.report.designs import steps_sheet

    with progress("searching for the best pins to move"):
        model, workspace = open_workspace(machine, points, out, allow_outside)
        output.check_urdf(model, out)
        answer = with_more_and_more_pins(
            model,
            workspace,
            workers=len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1,
            bands=bands_to_use(nominal),
            catalogue=offered_sizes(catalogue, free),
        )
        table = answer.frame
    with outputs(out) as folder:
        write_csv(table, folder / "steps.csv")
        output.write_steps(answer, folder)
    show([steps_sheet(answer)])
