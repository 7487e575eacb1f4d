"""Lift charts as sheets and columns: of one machine as a grid, of several as a list."""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from armdesign.arrays import Array
from armdesign.machine.lift_chart import HYDRAULIC_SHARE, TIPPING, TIPPING_SHARE, LiftChart
from armdesign.machine.lift_chart import lift_chart_if_any as chart_if_any
from armdesign.report.sheet import Sheet
from armdesign.units import WORKSHOP, Units, masses

if TYPE_CHECKING:
    from armdesign.machine.machine import Machine

TITLE = "Lift chart"
NONE = (
    "none: no joint raises the tool, or no place of the usual grid is within its reach ahead;"
    " [lift_chart] in the file gives another: step_m, from_m, or link and at_mm of another point"
)


def lift_charts(machines: Mapping[str, Machine]) -> dict[str, LiftChart]:
    """Lift charts by label, all on the grid of the first; without machines that have none."""
    charts: dict[str, LiftChart] = {}
    for label, machine in machines.items():
        chart = chart_if_any(machine, next(iter(charts.values()), None))
        if chart is None and not charts:
            break
        if chart is not None:
            charts[label] = chart
    return charts


def lift_columns(charts: Mapping[str, LiftChart]) -> dict[str, Array]:
    """A row for each point that any of two machines reaches, from the highest down.

    Columns are place [m], capacities [kg], their ratio, and what limits each; NaN and None where
    a machine does not reach.
    """
    reached = {label: list(zip(-c.height, c.reach, strict=True)) for label, c in charts.items()}
    places = sorted({place for some in reached.values() for place in some})
    lifted, limiting = dict[str, Array](), dict[str, Array]()
    for label, chart in charts.items():
        rows = [bisect_left(places, place) for place in reached[label]]
        lifted[f"{label}_kg"] = np.full(len(places), np.nan)
        limiting[f"{label}_limiting"] = np.full(len(places), None, dtype=object)
        lifted[f"{label}_kg"][rows] = chart.capacity
        limiting[f"{label}_limiting"][rows] = chart.limiting
    one, other = lifted.values()
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = other / one
    below, reach = np.transpose(places)
    return {"reach_m": reach, "height_m": 0.0 - below, **lifted, "ratio": ratio, **limiting}


def lift_sheet(charts: Mapping[str, LiftChart], units: Units = WORKSHOP) -> Sheet:
    """Lift charts of machines, by reach and height."""
    if not charts:
        return Sheet(title=TITLE, rows=(), note=NONE)
    first = next(iter(charts.values()))
    return _grid(first, units) if len(charts) == 1 else _list(charts, units)


def _grid(chart: LiftChart, units: Units) -> Sheet:
    """Rows by height, from the highest down, columns by reach."""
    usual = Counter(chart.limiting).most_common(1)[0][0]
    named = usual if usual == TIPPING else f"the {usual}"
    cells = {
        (height, reach): capacity + ("" if limiting == usual else f" {limiting}")
        for height, reach, capacity, limiting in zip(
            chart.height, chart.reach, masses(chart.capacity), chart.limiting, strict=True
        )
    }
    heights, reaches = (sorted({place[k] for place in cells}) for k in (0, 1))
    return Sheet(
        title=f"{TITLE} [kg]: height down, reach across",
        columns=("[m]", *(f"{reach:.3g}" for reach in reaches)),
        rows=tuple(
            (f"{height:.3g}", *(cells.get((height, reach), "") for reach in reaches))
            for height in reversed(heights)
        ),
        note=f"{_note(chart, units)}; limited by {named} where nothing else is said",
    )


def _list(charts: Mapping[str, LiftChart], units: Units) -> Sheet:
    """A row for each point."""
    one, other = charts
    reaches, heights, before, after, ratios, *limiting = lift_columns(charts).values()
    lifted = masses([*before, *after])
    pairs = zip(lifted[: len(before)], lifted[len(before) :], strict=True)
    rows = []
    for reach, height, pair, ratio, *limits in zip(
        reaches, heights, pairs, ratios, *limiting, strict=True
    ):
        rows.append(
            (
                f"{height:.3g}",
                f"{reach:.3g}",
                *pair,
                f"{ratio:.2f}" if np.isfinite(ratio) else "",
                " → ".join(dict.fromkeys(name or "out of reach" for name in limits)),
            )
        )
    return Sheet(
        title=f"{TITLE} [kg]",
        columns=("height [m]", "reach [m]", one, other, "ratio", "limited by"),
        rows=tuple(rows),
        note=_note(charts[one], units),
        words=("limited by",),
    )


def _still(chart: LiftChart, units: Units) -> str:
    """Joints that stand still over all places of a chart, and where; "" for none but slews."""
    arm = chart.machine.arm
    still = np.flatnonzero(np.ptp(chart.q, axis=0) < 1e-9) if len(chart.q) > 1 else ()
    return ", ".join(
        f"{arm.joints[j].name} at {units.text(float(chart.q[0, j]), arm.joints[j].unit)}"
        for j in still
        if j not in arm.slewing
    )


def _note(chart: LiftChart, units: Units) -> str:
    """Note on the meaning of the chart, and on its point."""
    point, share = chart.poses.point, f"{100 * HYDRAULIC_SHARE:.0f} %"
    x, _, z = (units.text(value, "m") for value in point.at)
    machine, tips = chart.machine, f", or {100 * TIPPING_SHARE:.0f} % of what tips it"
    note = (
        f"at x {x}, z {z} of the {point.link}: {share} of the actuators' force less the arm's"
        f" own weight{tips if machine.section.stability else ''} (ISO 10567)"
    )
    if still := _still(chart, units):
        note += f"; with {still}"
    if len(machine.actuators) > len(machine.joints):
        note += (
            "; where cylinders share a joint they divide its load as at rest (least Σ(F/A)²), and"
            " lift more where valves load each of them fully"
        )
    return note
