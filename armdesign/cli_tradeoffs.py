"""Commands that find several designs: ``armdesign pareto`` and ``armdesign steps``."""

from __future__ import annotations

from armdesign.errors import Stopped
from armdesign.option_values import listed
from armdesign.options import (
    AgainstOption,
    SeedOption,
    StartsOfSetsOption,
    ValuesOption,
    VaryOption,
)
from armdesign.output import write_csv
from armdesign.runs import DrawnSearch, OverWorkspace, SearchOptions, command
from armdesign.threads import processors


@command
def pareto(
    run: OverWorkspace,
    search: DrawnSearch,
    against: AgainstOption = "oil",
    values: ValuesOption = "",
    vary: VaryOption = "areas,pins",
) -> None:
    """Trade frequency against lift, oil or another limit.

    Finds the best design for each value of one limit: oil, thrust, digging, lift or pin room.
    Writes pareto.csv and pareto.png.
    """
    from armdesign import plots
    from armdesign.design.pareto import read_values
    from armdesign.report.trade_offs import pareto_sheet
    from armdesign.sweeps.trade_offs import pareto as trade_off

    with run.progress("searching for the best design under each limit"):
        limits = read_values(values, against)
        model, workspace, out = run.open_workspace()
        run.go_on(out)
        stopped: Stopped | None = None
        try:
            front = trade_off(
                model,
                workspace,
                against=against,
                values=limits,
                vary=listed(vary),
                **{"workers": processors(), **search.settings},
            )
        except Stopped as stop:
            front, stopped = stop.finished, stop
        table = front.frame
    with run.writing(out) as folder:
        write_csv(table, folder / "pareto.csv")
        plots.save(front.plot().figure, folder / "pareto.png")
    run.show([pareto_sheet(front, run.units.units)], tables={"pareto": table})
    if stopped is not None:
        raise stopped


@command
def steps(
    run: OverWorkspace,
    search: SearchOptions,
    starts: StartsOfSetsOption = None,
    seed: SeedOption = 0,
) -> None:
    """Say which change to make first.

    Finds the best machine with other cylinders alone, with one pin moved, with two, up to all.
    Writes steps.csv, and each machine as <name>_<pins>_pins.toml.
    """
    from armdesign import output
    from armdesign.design.steps import steps as with_more_and_more_pins
    from armdesign.report.trade_offs import steps_sheet

    with run.progress("searching for the best pins to move"):
        model, workspace, out = run.open_workspace()
        output.check_urdf(model, out)
        run.go_on(out)
        drawn = {"starts": starts, "seed": seed}
        settings = {"workers": processors(), **search.settings, **drawn}
        answer = with_more_and_more_pins(model, workspace, **settings)
        table = answer.frame
    with run.writing(out) as folder:
        write_csv(table, folder / "steps.csv")
        output.write_steps(answer, folder)
    run.show([steps_sheet(answer)], tables={"steps": table})
