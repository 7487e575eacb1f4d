"""The paper's pairs of figures: frequency against load mass and against link length."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from armdesign.arrays import Array
from armdesign.paper.configurations import FORMULAS
from armdesign.plots.canvas import COMPUTED, MARK, figure, literal

if TYPE_CHECKING:
    from armdesign.paper.reproduction import Reproduction


@literal
def paper_pair(reproduction: Reproduction, formula: str) -> Any:
    """Figure of identified (red) and computed (blue) frequencies, in the paper's form.

    Dots: identified in the sweep, the paper's way; rings: at small amplitude.
    """
    mass, length = reproduction.mechanism.load_mass, reproduction.mechanism.link_length
    computed = reproduction.computed[formula]
    fig, axes = figure(2, 6.2, 5.4)
    pairs = (("load mass m2 [kg]", mass, length, "m"), ("link length l2 [m]", length, mass, "kg"))
    for ax, (label, x, family, unit) in zip(axes, pairs, strict=True):
        curve_family(ax, x, family, computed, color=COMPUTED, marker="s", label="computed")
        sweep = {"color": MARK, "marker": "o", "label": "identified in the sweep"}
        curve_family(ax, x, family, reproduction.swept, **sweep)
        small = {"mfc": "none", "mec": MARK, "ms": 6, "label": "identified at small amplitude"}
        ax.plot(x, reproduction.identified, "o", **small)
        title = f"a curve for each {'length' if unit == 'm' else 'mass'}"
        ax.set(xlabel=label, ylim=(0, None), title=title)
        name_ends(ax, x, family, computed, unit)
        ax.grid(alpha=0.3)
    axes[0].set_ylabel("frequency [Hz]")
    axes[0].legend(frameon=False)
    error = float(reproduction.errors["swept"][formula])
    fig.suptitle(f"{FORMULAS[formula]}: {error:.3g} rad/s from the peaks of the sweep")
    return fig


def curve_family(ax: Any, x: Array, family: Array, y: Array, *, label: str, **style: Any) -> None:
    """One curve of y (n,) over x (n,) for each value of ``family`` (n,), under one label."""
    for value in np.unique(family):
        rows = np.flatnonzero(family == value)
        rows = rows[np.argsort(x[rows])]
        ax.plot(x[rows], y[rows], "-", lw=1, ms=3, label=label, **style)
        label = "_nolegend_"


def name_ends(ax: Any, x: Array, family: Array, y: Array, unit: str) -> None:
    """The value of each curve's ``family`` (n,) beside its left end, in a margin made for it."""
    low, high = float(x.min()), float(x.max())
    ax.set_xlim(low - 0.16 * (high - low), high + 0.04 * (high - low))
    for row in np.flatnonzero(x == low):
        ax.annotate(
            f"{family[row]:g} {unit}",
            (low, y[row]),
            xytext=(-6, 0),
            textcoords="offset points",
            ha="right",
            va="center",
            fontsize=6.5,
            color=COMPUTED,
        )
