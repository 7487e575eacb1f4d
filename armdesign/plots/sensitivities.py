"""Worth of the numbers of the machine file: tornado, distribution, linear against exact."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from armdesign.plots.canvas import COMPUTED, CYLINDER, INK, MARK, Style, figure, literal, title_of

if TYPE_CHECKING:
    from armdesign.influence.sensitivity import Sensitivity
    from armdesign.influence.tolerances import Tolerances
    from armdesign.influence.what_if import WhatIf
    from armdesign.plots.canvas import Axes

DRAWN = 20  # numbers


@literal
def tornado(sensitivity: Sensitivity, ax: Axes | None = None) -> Axes:
    """Axes with a bar for each number: change of the worst frequency by a step up and down.

    Of a bar that leaves the axes its end is written on it.
    """
    numbers, changes = sensitivity.numbers[:DRAWN], 1e3 * sensitivity.possible_changes[:DRAWN]
    ax = figure(1, 8.5, 1.2 + 0.27 * max(len(numbers), 4))[1][0] if ax is None else ax
    rows = np.arange(len(numbers))
    for way, (colour, label) in enumerate(((COMPUTED, "step up"), (MARK, "step down"))):
        ax.barh(rows, changes[:, way, 0], color=colour, alpha=0.75, label=f"{label}, linear")
        style: Style = {"color": colour, "mec": INK, "ms": 5, "mew": 0.8}
        ax.plot(changes[:, way, 1], rows, "D", label=f"{label}, exact", **style)
    widest = 1.3 * np.nanmax(np.abs(changes[:, :, 1]), initial=0.0) or 1.0
    ax.set_xlim(-widest, widest)
    for row, way in np.argwhere(np.abs(np.nan_to_num(changes[:, :, 0])) > widest):
        value = changes[row, way, 0]
        at = 0.98 * np.copysign(widest, value)
        side = "right" if value > 0 else "left"
        ax.text(at, row, f"{value:+.0f}", ha=side, va="center", color="white", fontsize=8)
    ax.set_yticks(rows, [f"{number.path}  {number.step[1]}" for number in numbers], fontsize=8)
    ax.invert_yaxis()
    ax.axvline(0, color=INK, lw=0.8)
    ax.grid(axis="x", alpha=0.3)
    worst = sensitivity.rivals[0].frequency
    ax.set(xlabel=f"change of the worst frequency, {worst:.3f} Hz [mHz]")
    ax.set_title(f"{title_of(sensitivity.machine)}\nworst frequency by the numbers of the file")
    ax.legend(frameon=False, fontsize=8, loc="best")
    return ax


@literal
def distribution(tolerances: Tolerances, ax: Axes | None = None) -> Axes:
    """Axes with the distribution of the worst frequency, exact and by the derivatives."""
    ax = figure(1, 7.0, 4.6)[1][0] if ax is None else ax
    works = tolerances.working
    both = {"exact": tolerances.frequencies[works], "linear": tolerances.linear[works]}
    low, high = np.percentile(np.concatenate(list(both.values())), [0.02, 99.98])
    bins = np.linspace(low, high, 61).tolist()
    ax.hist(both["exact"], bins, color=COMPUTED, alpha=0.6, label="exact", density=True)
    ax.hist(both["linear"], bins, color=INK, histtype="step", label="by derivatives", density=True)
    words = "least frequency" if tolerances.stated else "as drawn"
    share = f"{100 * tolerances.share:.1f} % of the machines reach it"
    ax.axvline(tolerances.least, color=MARK, label=f"{words}: {share}")
    low, high = min(low, tolerances.least), max(high, tolerances.least)
    edge = 0.02 * (high - low)  # that the line of the legend is not the frame
    ax.set(xlabel="worst frequency [Hz]", ylabel="density [1/Hz]", xlim=(low - edge, high + edge))
    count = f"{len(tolerances.frequencies):,}".replace(",", "\u202f")
    ax.set_title(f"{title_of(tolerances.machine)}\n{count} machines within their tolerances")
    ax.grid(alpha=0.3)
    ax.legend(frameon=False)
    return ax


@literal
def linear_against_exact(answer: WhatIf, ax: Axes | None = None) -> Axes:
    """Axes with the relative change of every quantity, linear over exact."""
    ax = figure(1, 6.4, 5.6)[1][0] if ax is None else ax
    frame = answer.numbers.dropna(subset=["linear_change", "change"]).reset_index()
    if frame.empty:
        place: Style = {"transform": ax.transAxes, "ha": "center", "color": INK}
        ax.text(0.5, 0.5, "no number has a linear estimate", **place)
    exact, linear = 100 * frame["change"], 100 * frame["linear_change"]
    hertz, lift = frame["unit"] == "Hz", frame["quantity"].str.startswith("lift at ")
    groups = ((hertz, MARK, "frequencies"), (lift, CYLINDER, "lift chart"))
    for rows, colour, label in (*groups, (~hertz & ~lift, COMPUTED, "forces, speeds, pressures")):
        ax.plot(exact[rows], linear[rows], "o", color=colour, ms=4, alpha=0.7, label=label)
    ends = [min(exact.min(), linear.min(), 0.0), max(exact.max(), linear.max(), 0.0)]
    ax.plot(ends, ends, color=INK, lw=0.8)
    ax.set(xlabel="change [%]", ylabel="linear estimate of it [%]")
    ax.set_title(f"{title_of(answer.before.machine)}\nlinear estimates against exact changes")
    ax.grid(alpha=0.3)
    ax.legend(frameon=False)
    return ax
