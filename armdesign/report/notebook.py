"""Results as a notebook shows them: a few sheets and a picture, in HTML."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from armdesign.report.designs import gain_sheet, sizes_sheet, summary
from armdesign.report.maps import map_head, spread_sheet
from armdesign.report.sheet import Sheet
from armdesign.report.validations import validation_sheet, verdict

if TYPE_CHECKING:
    from armdesign.design.design import Design
    from armdesign.frequency.maps import FrequencyMap
    from armdesign.machine.machine import Machine
    from armdesign.simulation.run import Simulation
    from armdesign.simulation.validation import Validation

DOTS = 72  # per inch of a picture


def of_machine(machine: Machine) -> str:
    """Parts of a machine, and its drawing to scale."""
    return _html([repr(machine)], machine.plot().figure)


def of_map(frequencies: FrequencyMap) -> str:
    """Worst pose and percentiles, and the map over two joints."""
    return _html(
        [map_head(frequencies), spread_sheet({"": frequencies})], frequencies.plot().figure
    )


def of_design(design: Design) -> str:
    """Gain, sizes and pins, and maps before and after."""
    return _html([summary(design), gain_sheet(design), sizes_sheet(design)], design.plot())


def of_validation(validation: Validation) -> str:
    """Every sweep, and the frequency responses."""
    poses = validation.by_pose
    return _html([f"{verdict([validation])}.", validation_sheet(poses)], validation.plot())


def of_simulation(simulation: Simulation) -> str:
    """Shape of a run, with its events, and its motion over time."""
    return _html([repr(simulation)], simulation.plot())


def _html(items: Sequence[Sheet | str], figure: Any) -> str:
    return "\n".join([*(_item(item) for item in items), _picture(figure)])


def _item(item: Sheet | str) -> str:
    import pandas as pd

    if isinstance(item, str):
        tag = "pre" if "\n" in item else "p"
        return f"<{tag}>{html.escape(item)}</{tag}>"
    frame = pd.DataFrame(list(item.rows), columns=list(item.columns) or None)
    table = frame.to_html(index=False, header=bool(item.columns), border=0)
    note = f"<p><small>{html.escape(item.note)}</small></p>" if item.note else ""
    scrolled = f'<div style="overflow-x: auto">{table}</div>'
    return f"<p><b>{html.escape(item.title)}</b></p>{scrolled}{note}"


def _picture(figure: Any) -> str:
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=DOTS)
    data = base64.b64encode(stream.getvalue()).decode("ascii")
    return f'<img alt="" style="max-width: 100%" src="data:image/png;base64,{data}">'
