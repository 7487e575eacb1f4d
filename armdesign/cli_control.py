"""The command ``armdesign control``."""

from __future__ import annotations

from pathlib import Path

from armdesign.options import (
    CommandContext,
    CornerOption,
    DampingOption,
    DelayOption,
    FilterOption,
    GainMarginOption,
    Habit,
    MachineArgument,
    NewOption,
    OutOption,
    OutsideOption,
    PhaseMarginOption,
    PointsOption,
    UnitsOption,
    grid_points,
    run_of,
)
from armdesign.output import check_out, outputs, show, write_control_report
from armdesign.progress import progress


def control(
    context: CommandContext,
    machine: MachineArgument,
    new: NewOption = "",
    out: OutOption = Path("out"),
    points: PointsOption = "",
    damping: DampingOption = None,
    delay: DelayOption = 0.0,
    gain_margin: GainMarginOption = 6.0,
    phase_margin: PhaseMarginOption = 45.0,
    filter: FilterOption = "high-pass",
    corner: CornerOption = 0.0,
    units: UnitsOption = Habit.workshop,
    allow_outside: OutsideOption = False,
) -> None:
    """Say how fast position loops can be, pose by pose.

    Finds the largest gains whose loops, all closed at once, keep gain and phase margin: of
    position loops alone, and with feedback of the load pressures. Writes bandwidth.csv, gains.csv,
    heatmaps and report.html; with --new for another machine too.
    """
    import math

    from armdesign.control.bandwidth_map import bandwidth_map, default_points
    from armdesign.frequency.workspace import Workspace
    from armdesign.machine.loading import load
    from armdesign.report.bandwidths import bandwidth_sheets
    from armdesign.units import deg

    run = run_of(context)
    with progress("closing the loops"):
        counts = grid_points(points)
        check_out(out)
        names = {"today": machine, "new": new} if new else {"": machine}
        maps = {}
        for label, name in names.items():
            model = load(name, allow_outside=allow_outside)
            workspace = Workspace.grid(model, counts or default_points(model))
            maps[label] = bandwidth_map(
                model,
                workspace,
                damping=damping,
                delay=delay / 1e3,
                gain_margin_db=gain_margin,
                phase_margin=phase_margin * deg,
                filter=filter,  # type: ignore[arg-type]
                corner=2 * math.pi * corner or None,
            )
    sheets = bandwidth_sheets(maps, units.units)
    with outputs(out) as folder:
        write_control_report(maps, sheets, run, folder)
    show(sheets)
