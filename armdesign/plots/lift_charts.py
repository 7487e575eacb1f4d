"""Lift charts by reach and height: what a machine lifts, of two machines and their ratio."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from armdesign.arrays import Array
from armdesign.plots.canvas import COLOURS, INK, WIDTH, Style, figure, line_width, literal, wrapped
from armdesign.plots.colour_bars import colour_bar, hide_colour_bar
from armdesign.units import masses

if TYPE_CHECKING:
    from armdesign.machine.lift_chart import LiftChart
    from armdesign.plots.canvas import Axes, Figure

KILOGRAMS = "lift capacity [kg]"
TITLE, WORDS = 11.0, 7.0  # [pt] letters of titles, of words at points
SMALLEST = 0.6  # share of the letters at points, where they would meet
ROW = 0.38  # [in] from a row of points to the next, with two lines of words between them
SMALL = 30.0  # [pt²] points without words
GAP = 0.04  # [in] between words
BESIDE = 1.0  # [in] beside axes: numbers, labels, a colour bar
TALLEST = 16.0  # [in] of a figure
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
    words = list(zip(masses(chart.capacity), chart.limiting, strict=True))
    _points(ax, (chart.reach, chart.height), chart.capacity, words, KILOGRAMS, COLOURS, limits)
    ax.set_title(_limited(chart), fontsize=10)
    return ax


def _limited(chart: LiftChart) -> str:
    """By which shares of ISO 10567 the capacities are limited, in words."""
    tips = chart.machine.section.stability is not None
    return f"{HYDRAULIC}{LOWER if tips else ''} (ISO 10567)"


@literal
def lift_charts(charts: Mapping[str, LiftChart]) -> Figure:
    """Figure of one chart, or of two on one colour scale with their ratio beside them.

    It is as high as the rows of points with their words need. Points that are too near each other
    for words have colours alone.
    """
    fig, axes = figure(1, 7.0, 4.6) if len(charts) == 1 else figure(3, 4.0, 5.4)
    most = max(float(chart.capacity.max()) for chart in charts.values())
    for ax, (label, chart) in zip(axes, charts.items(), strict=False):
        lift_chart(chart, ax, vmin=0.0, vmax=most)
        ax.set_title(label if len(charts) > 1 else f"{label}\n{_limited(chart)}", fontsize=TITLE)
    drawn = list(axes[: len(charts)])
    ends = np.array([(*ax.get_xlim(), *ax.get_ylim()) for ax in drawn])
    if len(charts) > 1:
        hide_colour_bar(axes[0])  # the second chart has the same
        _ratios(axes[2], charts)
    (left, _, low, _), (_, right, _, high) = ends.min(axis=0), ends.max(axis=0)
    for ax in axes:  # to one scale; tall and narrow charts would be columns amid white paper
        ax.set(xlim=(left, right), ylim=(low, high), aspect="auto")
    for ax in axes[1:]:
        ax.set_ylabel("")
    if (share := _room_sideways(axes, drawn)) >= SMALLEST:
        for text in (text for ax in drawn for text in ax.texts):
            text.set_fontsize(WORDS * share)
        _room_upwards(fig, axes, charts)
    else:
        _colours_alone(fig, axes)
    return fig


def _ratios(ax: Axes, charts: Mapping[str, LiftChart]) -> None:
    """What the second chart lifts over what the first does, at the points of both."""
    one, other = (
        {(x, z): mass for x, z, mass in zip(c.reach, c.height, c.capacity, strict=True)}
        for c in charts.values()
    )
    both = [place for place in one if one[place] > 0 and place in other]
    ratio = np.array([other[place] / one[place] for place in both])
    words = [(f"{value:.2f}",) for value in ratio]
    ax.set_title(" over\n".join(reversed(list(charts))), fontsize=TITLE)
    if both:
        at = np.array(both).T
        _points(ax, (at[0], at[1]), ratio, words, "ratio", "RdBu", {"vmin": 0.5, "vmax": 1.5})
    else:
        ax.text(0.5, 0.5, "no common points", transform=ax.transAxes, ha="center", color=INK)
        ax.set(xlabel="reach [m]", ylabel="height [m]")
        ax.grid(alpha=0.3)


def _room_sideways(axes: Sequence[Axes], drawn: Sequence[Axes]) -> float:
    """Limits so wide that no word leaves the axes; share of the letters at which none meet."""
    rows: dict[tuple[int, float, float], list[tuple[float, float]]] = {}
    texts: list[tuple[int, Any]] = [(k, text) for k, ax in enumerate(drawn) for text in ax.texts]
    for k, text in texts:
        width = line_width(text.get_text(), WORDS)
        rows.setdefault((k, text.xy[1], text.xyann[1]), []).append((text.xy[0], width))
    places, widths = zip(*(word for row in rows.values() for word in row), strict=True)
    inches, widest = WIDTH / len(axes) - BESIDE, max(widths)
    edge = float(np.ptp(places)) * (widest / 2 + GAP) / max(inches - widest - 2 * GAP, GAP)
    left, right = axes[0].get_xlim()
    left, right = min(left, min(places) - edge), max(right, max(places) + edge)
    for ax in axes:
        ax.set_xlim(left, right)
    shares = [
        inches * (x - before) / (right - left) / ((width + other) / 2 + GAP)
        for row in rows.values()
        for (before, width), (x, other) in pairwise(sorted(row))
    ]
    return min([1.0, *shares])


def _colours_alone(fig: Figure, axes: Sequence[Axes]) -> None:
    """Small points without words."""
    for ax in axes:
        for points in ax.collections:
            points.set_sizes([SMALL])  # type: ignore[attr-defined]
        for text in [text for text in ax.texts if ax.collections]:
            text.remove()
    fig.suptitle("points too near each other for numbers: colours alone", fontsize=TITLE - 2)


def _room_upwards(fig: Figure, axes: Sequence[Axes], charts: Mapping[str, LiftChart]) -> None:
    """A figure so high that the words of a row of points end above the next row."""
    heights = [np.unique(chart.height) for chart in charts.values()]
    step = min((float(np.diff(of).min()) for of in heights if len(of) > 1), default=np.inf)
    low, high = axes[0].get_ylim()
    titles = (wrapped(ax.get_title(), WIDTH / len(axes), TITLE) for ax in axes)
    around = 0.7 + 0.19 * max(len(title) for title in titles)  # [in]
    width, height = fig.get_size_inches()
    fig.set_size_inches(width, max(height, min(ROW * (high - low) / step + around, TALLEST)))


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
    style: Style = {"ha": "center", "va": "top", "fontsize": WORDS, "color": INK}
    for x, z, lines in zip(*at, words, strict=True):
        for k, line in enumerate(lines):
            ax.annotate(line, (x, z), (0, -6.5 - 7 * k), textcoords="offset points", **style)
    ax.set(xlabel="reach [m]", ylabel="height [m]", aspect="equal")
    ax.margins(0.16, 0.12)
    ax.grid(alpha=0.3)
