"""Sheets and figures of the paper's reproduction: configurations, errors, errata, and the scan."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from armdesign.arrays import Array
from armdesign.paper.configurations import FORMULAS, PUBLISHED
from armdesign.plots.canvas import COMPUTED, MARK, Style, figure, literal
from armdesign.plots.charts import Chart, Curve
from armdesign.plots.labels import spread
from armdesign.report.sheet import Sheet
from armdesign.units import WORKSHOP, percent

if TYPE_CHECKING:
    import pandas as pd

    from armdesign.paper.errata import Erratum
    from armdesign.paper.reproduction import Reproduction
    from armdesign.plots.canvas import Axes


def paper_sheets(
    reproduction: Reproduction, errata: Sequence[Erratum], scan: pd.DataFrame, bias: pd.DataFrame
) -> list[Sheet]:
    """Parameters, configurations, error of the sweep itself, errors, errata, scan."""
    return [
        _paper_choices(reproduction),
        _paper_frequencies(reproduction),
        _sweep_bias(bias),
        _paper_errors(reproduction),
        _paper_errata(errata),
        *_paper_scan(scan),
    ]


def _paper_choices(reproduction: Reproduction) -> Sheet:
    machine, at, sweep = reproduction.machine, reproduction.mechanism, reproduction.sweep
    cylinder, valve, units = machine.cylinders[0], machine.cylinders[0].valve, WORKSHOP
    masses, lengths = np.unique(at.load_mass), np.unique(at.link_length)
    sizes = "/".join(units.number(size, "m") for size in (cylinder.bore, cylinder.rod))
    stroke = units.text(cylinder.stroke, "m")
    volumes = cylinder.cap_dead_volume, cylinder.annulus_dead_volume
    dead = " and ".join(units.text(volume, "m³") for volume in volumes)
    sweeps = f"{sweep.start:g} to {sweep.stop:g} Hz in {sweep.duration:g} s, open loop"
    rows = [
        ("load masses m2", "eight", f"{len(masses)}: {masses[0]:g} to {masses[-1]:g} kg"),
        ("link lengths l2", "five", f"{len(lengths)}: {lengths[0]:g} to {lengths[-1]:g} m"),
        ("pins a1, d1", "–", ", ".join(units.text(float(v), "m") for v in at.pins.values())),
        ("pose", "θ0 = γ = 90 deg", "the same; the piston is then at mid-stroke"),
        ("cylinder", "asymmetric", f"{sizes} mm, stroke {stroke}, dead {dead}"),
        ("supply", "constant", units.text(machine.supply.pressure, "Pa")),
        ("oil", "constant β", f"{machine.fluid.bulk_modulus / 1e6:g} MPa, no air"),
        ("sweep", "a sine sweep", sweeps),
        ("its amplitude", "–", f"{100 * sweep.amplitude:g} % of the spool's travel"),
        ("mass in (11)", "average static load", "static force at θ0 over 9.81 m/s²"),
        ("A, V0 in (11), (42)", "symmetric piston", "of the bore side; also means of both sides"),
    ]
    if valve is not None:
        flow, drop = units.text(valve.rated_flow, "m³/s"), units.text(valve.rated_drop, "Pa")
        words = f"{flow} at {drop} per edge, {valve.natural_frequency:g} Hz"
        rows.insert(5, ("4/3 valve", "commercial", words))
    return Sheet(
        title="Parameters: the paper's, and those used here",
        columns=("", "the paper", "here"),
        rows=tuple(rows),
        note="the paper gives no dimensions, so its curves cannot be reproduced in number",
        words=("here",),
    )


def _paper_frequencies(reproduction: Reproduction) -> Sheet:
    at = reproduction.mechanism
    masses, lengths = np.unique(at.load_mass), np.unique(at.link_length)
    exact, swept = reproduction.computed["joint_exact"], reproduction.swept
    by_place = {
        (m, n): f"{f:.2f} {100 * (peak / f - 1):+5.1f} %"
        for m, n, f, peak in zip(at.load_mass, at.link_length, exact, swept, strict=True)
    }
    drift = max(abs(one.drift) for one in reproduction.measurements)
    worst = float(np.abs(reproduction.identified / exact - 1).max())
    return Sheet(
        title="Exact natural frequency [Hz], and deviation of the sweep's spectral peak",
        columns=("m2", *(f"l2 = {length:g} m" for length in lengths)),
        rows=tuple((f"{m:g} kg", *(by_place.get((m, n), "") for n in lengths)) for m in masses),
        note=(
            f"fitted at small amplitude: within {100 * worst:.2g} %; in the sweep the oil"
            f" cavitated in {reproduction.cavitated} of {len(exact)} configurations and the piston"
            f" drifted by up to {1000 * drift:.0f} mm"
        ),
    )


def _sweep_bias(bias: pd.DataFrame) -> Sheet:
    rows = []
    for _, one in bias.iterrows():
        errors = (percent(one[name], 2) for name in BIASES)
        rows.append((f"{one.periods:g}", f"{one.damping:g}", *errors))
    return Sheet(
        title="Error of the sweep itself: spectral peaks and fit of a linear oscillator",
        columns=("periods in the sweep", "ζ", *BIASES.values()),
        rows=tuple(rows),
        note=(
            "a short record ends while the oscillator still rings; the position of a long one"
            " peaks at √(1 − 2ζ²) of the natural frequency, its resonance; spectral lines 1/T"
            " apart add up to half a line"
        ),
    )


def _paper_errors(reproduction: Reproduction) -> Sheet:
    from armdesign.paper.reproduction import WAYS

    errors = reproduction.errors
    rows = [
        (words, *(f"{errors[way][name]:.4g}" for way in WAYS)) for name, words in FORMULAS.items()
    ]
    return Sheet(
        title=f"Root mean square error over the {len(reproduction.swept)} configurations [rad/s]",
        columns=("formula", *WAYS.values()),
        rows=tuple(rows),
        note=f"the paper prints {PUBLISHED:g} rad/s for (11); its value for (42) is missing in our"
        " copy",
        bold=(len(rows) - 1,),
    )


def _paper_errata(errata: Sequence[Erratum]) -> Sheet:
    rows = []
    for item in errata:
        cells = ("none", "")
        if item.change is not None:
            low, high = (f"{100 * end:+.2f}" for end in (item.change.min(), item.change.max()))
            cells = (f"{low} %" if low == high else f"{low} to {high} %", f"{item.error:.3g}")
        rows.append((item.equation, item.printed, item.right, *cells))
    return Sheet(
        title="Errata of the paper: effect of each alone on the frequency",
        columns=("equation", "printed", "right", "change", "rms [rad/s]"),
        rows=tuple(rows),
        note="; ".join(f"{item.equation}: {item.remark}" for item in errata if item.remark)
        + "; x² = a1² + d1²",
    )


def _paper_scan(scan: pd.DataFrame) -> list[Sheet]:
    """Dimensions near the printed error, read in its unit and, as the formulas give Hz, in Hz."""
    hertz = 2 * np.pi * PUBLISHED
    units = {"rad/s": PUBLISHED, f"if that is in Hz, {hertz:.1f} rad/s": hertz}
    head = f"Dimensions with an error near the printed {PUBLISHED:g}"
    return [_paper_near(scan, f"{head} {words}", target) for words, target in units.items()]


def _paper_near(scan: pd.DataFrame, title: str, target: float) -> Sheet:
    """The three combinations closest to an error [rad/s] by each formula with the static mass."""
    static = ["static_11", "static_12", "static_12_as_printed"]
    off = (scan[static] / target - 1).abs()
    closest = {int(row) for name in static for row in off[name].to_numpy().argsort()[:3]}
    shown = scan.loc[sorted(closest, key=lambda row: float(scan["static_11"].iloc[row]))]
    rows = []
    for _, one in shown.iterrows():
        cells = [f"{one.bore_mm:g}/{one.rod_mm:g} × {one.stroke_mm:g}", f"{one.dead_volume_l:g}"]
        cells += [f"{one.bulk_modulus_MPa:g}", f"{one.mass_from_kg:g}–{one.mass_to_kg:g}"]
        cells += [f"{one.length_from_m:g}–{one.length_to_m:g}"]
        rows.append((*cells, *(f"{one[name]:.3g}" for name in SCANNED)))
    within = ", ".join(f"{int((off[name] < 0.05).sum())} by {SCANNED[name]}" for name in static)
    return Sheet(
        title=title,
        columns=("cylinder [mm]", "dead [l]", "β [MPa]", "m2 [kg]", "l2 [m]", *SCANNED.values()),
        rows=tuple(rows),
        note=(
            f"root mean square errors [rad/s] against the exact frequency; of {len(scan)}"
            f" combinations whose load the supply can hold, within 5 %: {within}"
        ),
    )


PAIRS = {  # formulas of the paper's pairs of figures, by file
    "paper_figures_3_4.png": "static_11",
    "paper_figures_5_6.png": "joint_42_as_printed",
    "paper_figures_5_6_exact.png": "joint_exact",
}
BIASES = {
    "speed_peak": "peak of speed",
    "position_peak": "peak of position",
    "speed_fit": "fit to speed",
}
NAME = 0.115  # [in] from the name of a curve to the next
SCANNED = {
    "static_11": "(11)",
    "static_12": "(12)",
    "static_12_as_printed": "(12) printed",
    "reflected_12": "J/r²",
    "joint_42_as_printed": "(42)",
}


def paper_chart(reproduction: Reproduction) -> Chart:
    """Exact and measured frequencies against the load mass, a curve for each link length."""
    at, exact = reproduction.mechanism, reproduction.computed["joint_exact"]
    measured: tuple[tuple[str, Array, Literal["dots", "rings"]], ...] = (
        ("identified in the sweep", reproduction.swept, "dots"),
        ("identified at small amplitude", reproduction.identified, "rings"),
    )
    curves, lengths = [], np.unique(at.link_length)
    for length in lengths:
        rows = np.flatnonzero(at.link_length == length)
        x = tuple(at.load_mass[rows].tolist())
        name, y = "computed, exact", tuple(exact[rows].tolist())
        curves.append(Curve(name=name, colour=COMPUTED, x=x, y=y, kind="line"))
        words = tuple(_at(reproduction, int(k)) for k in rows)
        for name, values, kind in measured:
            y = tuple(values[rows].tolist())
            curves.append(Curve(name=name, colour=MARK, x=x, y=y, kind=kind, words=words))
    return Chart(
        title=(
            "Frequency against the load mass, a curve for each link length:"
            f" {lengths[0]:g} m the highest, {lengths[-1]:g} m the lowest"
        ),
        x="load mass m2 [kg]",
        y="frequency [Hz]",
        heads=("load, link", "in the sweep", "at small amplitude", *FORMULAS.values()),
        curves=tuple(curves),
    )


def paper_sentence(reproduction: Reproduction) -> str:
    """Sentence on how far the paper's formula and the exact one are from what was measured."""
    errors = reproduction.errors
    paper, exact = (errors.loc[name] for name in ("static_11", "joint_exact"))
    return (
        f"Formula (11) is {paper['swept']:.3g} rad/s (root mean square) from the peaks of the"
        f" sweeps, the exact formula {exact['swept']:.3g} rad/s; from frequencies fitted at small"
        f" amplitude {paper['identified']:.3g} and {exact['identified']:.3g} rad/s."
    )


def _at(reproduction: Reproduction, row: int) -> tuple[str, ...]:
    """What the chart says of a configuration."""
    at = reproduction.mechanism
    values = (reproduction.swept, reproduction.identified, *reproduction.computed.values())
    place = f"m2 {at.load_mass[row]:g} kg, l2 {at.link_length[row]:g} m"
    return (place, *(f"{one[row]:.3f} Hz" for one in values))


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


def curve_family(ax: Axes, x: Array, family: Array, y: Array, *, label: str, **style: Any) -> None:
    """One curve of y (n,) over x (n,) for each value of ``family`` (n,), under one label."""
    for value in np.unique(family):
        rows = np.flatnonzero(family == value)
        rows = rows[np.argsort(x[rows])]
        ax.plot(x[rows], y[rows], "-", lw=1, ms=3, label=label, **style)
        label = "_nolegend_"


def name_ends(ax: Axes, x: Array, family: Array, y: Array, unit: str) -> None:
    """The value of each curve's ``family`` (n,) beside its left end, in a margin made for it."""
    low, high = float(x.min()), float(x.max())
    ax.set(xlim=(low - 0.16 * (high - low), high + 0.04 * (high - low)), ylim=ax.get_ylim())
    ends = np.flatnonzero(x == low)
    ends = ends[np.argsort(-y[ends])]
    top = ax.get_ylim()[1]
    inches = ax.get_window_extent().height / ax.figure.dpi
    heights = spread(y[ends] / top, NAME / inches, 0.0, 1.0) * top
    beside: Style = {"textcoords": "offset points", "ha": "right", "va": "center"}
    for row, height in zip(ends, heights, strict=True):
        words, at = f"{family[row]:g} {unit}", (low, float(height))
        ax.annotate(words, at, (-6, 0), **beside, fontsize=6.5, color=COMPUTED)
