"""Lift charts by reach and height: what a machine lifts, of two machines and their ratio."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from armdesign.arrays import Array
from armdesign.plots.canvas import COLOURS, INK, Style, figure, literal
from armdesign.plots.colour_bars import colour_bar, hide_colour_bar

if TYPE_CHECKING:
    from armdesign.machine.lift_chart import LiftChart
    from armdesign.plots.canvas import Axes, Figure

KILOGRAMS = "lift capacity [kg]"
HYDRAULIC, LOWER = "87 % hydraulic", ", or 75 % of tipping"


@literal
def lift_chart(chart: LiftChart, ax: Axes | None = None, **limits: float) -> Axes:
    """Capacity at every point, and what limits it there.

    Args:
        chart: the lift chart.
        ax: axes to draw into; new ones if None.
        limits: ``vmin`` and ``vmax`` [kg] of the colours, so that two charts share one scale.

    Returns:
        The axes.
    """
    ax = figure()[1][0] if ax is None else ax
    words = [
        (f"{mass:.0f}", name) for mass, name in zip(chart.capacity, chart.limiting, strict=True)
    ]
    _points(ax, (chart.reach, chart.height), chart.capacity, words, KILOGRAMS, COLOURS, limits)
    ax.set_title(_limited(chart), fontsize=10)
    return ax


def _limited(chart: LiftChart) -> str:
    """By which shares of ISO 10567 the capacities are limited, in words."""
    tips = chart.machine.section.stability is not None
    return f"{HYDRAULIC}{LOWER if tips else ''} (ISO 10567)"


@literal
def lift_charts(charts: Mapping[str, LiftChart]) -> Figure:
    """Figure of one chart, or of two on one colour scale with their ratio beside them."""
    fig, axes = figure(1, 7.0, 4.6) if len(charts) == 1 else figure(3, 4.0, 5.4)
    most = max(float(chart.capacity.max()) for chart in charts.values())
    for ax, (label, chart) in zip(axes, charts.items(), strict=False):
        lift_chart(chart, ax, vmin=0.0, vmax=most)
        ax.set_title(label, fontsize=11)
    if len(charts) == 1:
        ((label, chart),) = charts.items()
        axes[0].set_title(f"{label}\n{_limited(chart)}", fontsize=11)
    else:
        hide_colour_bar(axes[0])  # the second chart has the same
        ends = np.array([(*ax.get_xlim(), *ax.get_ylim()) for ax in axes[:2]])
        places = [
            {(x, z): mass for x, z, mass in zip(c.reach, c.height, c.capacity, strict=True)}
            for c in charts.values()
        ]
        both = [place for place in places[0] if places[0][place] > 0 and place in places[1]]
        ratio = np.array([places[1][place] / places[0][place] for place in both])
        words = [(f"{value:.2f}",) for value in ratio]
        at = np.array(both).reshape(-1, 2).T
        _points(axes[2], (at[0], at[1]), ratio, words, "ratio", "RdBu", {"vmin": 0.5, "vmax": 1.5})
        axes[2].set_title(" over\n".join(reversed(list(charts))), fontsize=11)
        (left, _, low, _), (_, right, _, high) = ends.min(axis=0), ends.max(axis=0)
        for ax in axes:  # to one scale
            ax.set(xlim=(left, right), ylim=(low, high))
    for ax in axes:  # tall and narrow charts would be columns amid white paper
        ax.set_aspect("auto")
    return fig


def _points(
    ax: Axes,
    at: tuple[Array, Array],
    values: Array,
    words: Sequence[tuple[str, ...]],
    label: str,
    colours: str,
    limits: Style,
) -> None:
    """Coloured points with lines of words below them."""
    drawn = ax.scatter(*at, c=values, s=130, cmap=colours, edgecolors=INK, zorder=3, **limits)
    colour_bar(ax, drawn, label)
    style: Style = {"ha": "center", "va": "top", "fontsize": 7, "color": INK}
    for x, z, lines in zip(*at, words, strict=True):
        for k, line in enumerate(lines):
            ax.annotate(line, (x, z), (0, -6.5 - 7 * k), textcoords="offset points", **style)
    ax.set(xlabel="reach [m]", ylabel="height [m]", aspect="equal")
    ax.margins(0.16, 0.12)
    ax.grid(alpha=0.3)
