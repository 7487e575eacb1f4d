"""The command ``armdesign control``."""

from __future__ import annotations

from armdesign.option_values import grid_points
from armdesign.options import (
    CornerOption,
    DampingOption,
    DelayOption,
    FilterOption,
    GainMarginOption,
    NewOption,
    PhaseMarginOption,
)
from armdesign.output_reports import write_control_report
from armdesign.runs import OverWorkspace, command


@command
def control(
    run: OverWorkspace,
    new: NewOption = "",
    damping: DampingOption = None,
    delay: DelayOption = 0.0,
    gain_margin: GainMarginOption = 6.0,
    phase_margin: PhaseMarginOption = 45.0,
    filter: FilterOption = "high-pass",
    corner: CornerOption = None,
) -> None:
    """Say how fast position loops can be, pose by pose.

    Finds the largest gains whose loops, all closed at once, keep gain and phase margin: of
    position loops alone, and with feedback of the load pressures. Writes bandwidth.csv, gains.csv,
    heatmaps and report.html; with --new for another machine too, at the same poses if it has the
    same links and can take them.
    """
    import math

    from armdesign.control.bandwidth_map import BandwidthMap, bandwidth_map, default_points
    from armdesign.frequency.workspace import Workspace
    from armdesign.report.bandwidths import bandwidth_sentence, bandwidth_sheets
    from armdesign.sweeps.numbers import of_bandwidths
    from armdesign.units import deg

    with run.progress("closing the loops"):
        counts = grid_points(run.points)
        names = {"today": run.machine, "new": new} if new else {"": run.machine}
        models = {label: run.load(name) for label, name in names.items()}
        out = run.folder(*(model.source for model in models.values()))
        maps: dict[str, BandwidthMap] = {}
        for label, model in models.items():
            fit = (one.workspace for one in maps.values() if one.workspace.suits(model))
            grid = Workspace.grid(model, default_points(model) if counts is None else counts)
            maps[label] = bandwidth_map(
                model,
                next(fit, grid),
                damping=damping,
                delay=delay / 1e3,
                gain_margin_db=gain_margin,
                phase_margin=phase_margin * deg,
                filter=filter,  # type: ignore[arg-type]
                corner=None if corner is None else 2 * math.pi * corner,
            )
    sheets = bandwidth_sheets(maps, run.units.units)
    margins = {"gain_margin": gain_margin, "phase_margin": phase_margin}
    loops = {"damping": damping, "delay": delay, "filter": filter, "corner": corner}
    origin = run.origin(new=new, **loops, **margins)
    with run.writing(out) as folder:
        write_control_report(maps, sheets, origin, folder, run.units.units)
    run.show(
        [*sheets, bandwidth_sentence(maps)], lambda: of_bandwidths(maps.get("new") or maps[""])
    )
