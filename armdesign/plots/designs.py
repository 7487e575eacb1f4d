"""A new design beside today's machine: maps, moment arms, and what frequency costs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import count, cycle
from typing import TYPE_CHECKING, Any

import numpy as np

from armdesign.plots.canvas import (
    COMPUTED,
    INK,
    MARK,
    STYLES,
    Style,
    figure,
    joint_label,
    joint_values,
    literal,
    title_of,
)
from armdesign.plots.maps import side_by_side
from armdesign.units import percent

if TYPE_CHECKING:
    from armdesign.design.design import Design
    from armdesign.design.pareto import Pareto
    from armdesign.design.requirements.performance import Performance
    from armdesign.design.steps import Steps
    from armdesign.machine.machine import Machine
    from armdesign.plots.canvas import Axes, Figure

ACROSS = 3  # actuators in a row
TRADED = {  # limit of a trade-off: label of its axis, axis unit over SI, today's value
    "oil": ("allowed oil volume / today's (joint speed falls with it)", 1.0, 1.0),
    "thrust": ("allowed thrust / today's", 1.0, 1.0),
    "digging": ("required digging torque / today's", 1.0, 1.0),
    "lift": ("lift kept at every point of the chart / today's", 1.0, 1.0),
    "pin_box": ("largest move of each pin coordinate [mm]", 1000.0, 0.0),
}


@literal
def before_after(design: Design, plane: str = "joints") -> Figure:
    """Figure of today's map and the new one on one colour scale."""
    fig = side_by_side({"today": design.before, "new": design.after}, plane)
    fig.suptitle(title_of(design.today))
    return fig


def moment_arms(design: Design) -> Figure:
    """Figure of every actuator's moment arm and torques over its joint, today and new."""
    return moment_arm_curves({"today": design.today, "new": design.machine})


@literal
def moment_arm_curves(machines: Mapping[str, Machine]) -> Figure:
    """Figure of every actuator's moment arm and torques about every joint, over its range.

    A cylinder across several joints is drawn with the others in the middle of their ranges, where
    it has a length there; motors are not: their arm is 1 and their torque the same everywhere. The
    first machine says which actuators and joints; the other machines are drawn beside it where
    they have actuators and joints of these names.
    """
    curves = {label: _curves(machine) for label, machine in machines.items()}
    first = next(iter(machines.values()))
    spans = list(next(iter(curves.values())))
    across = min(len(spans), ACROSS)
    height = min(3.2, 1.6 * across)
    fig, axes = figure(across, 4.4, height, rows=2 * math.ceil(len(spans) / across))
    pairs = axes.reshape(-1, 2, across).swapaxes(1, 2).reshape(-1, 2)  # torque below moment arm
    for unused in pairs[len(spans) :].ravel():
        unused.set_visible(False)
    for (name, joint), (arms, torques) in zip(spans, pairs, strict=False):
        styles = cycle(STYLES) if len(machines) > 1 else [("-", INK)]
        torques.sharex(arms)
        arms.tick_params(labelbottom=False)
        known = first.arm.joints[first.joints.index(joint)]
        above = count(3.0, -0.1)  # the first above others that are the same
        for (label, of), (style, colour), z in zip(curves.items(), styles, above, strict=False):
            if (at := of.get((name, joint))) is None:
                continue
            q, unit = joint_values(known, at.q), 1000 if known.revolute else 1
            arms.plot(q, unit * at.arm, style, color=colour, label=label, zorder=z)
            for side, width in enumerate((1.8, 0.9)):
                torques.plot(q, at.torque[side] / 1000, style, color=colour, lw=width, zorder=z)
        actuator = next(a for a in first.actuators if a.name == name)
        arms.set_ylabel("moment arm [mm]" if known.revolute else "cylinder per joint [m/m]")
        torques.set_ylabel("torque [kN m]" if known.revolute else "force [kN]")
        torques.set_xlabel(f"{joint_label(known)}; thin: retracting")
        about = f" about {joint}" if sum(name == other for other, _ in spans) > 1 else ""
        for ax in (arms, torques):
            top = max(np.nanmax(line.get_ydata(), initial=0.0) for line in ax.lines)
            ax.set_ylim(0, 1.08 * top or 1.0)
            ax.grid(alpha=0.3)
        arms.set_title(f"{name} {actuator.kind}{about}", fontsize=10)
    if len(machines) > 1:
        axes[0].legend(frameon=False)
    fig.suptitle(title_of(first))
    return fig


def _curves(machine: Machine) -> dict[tuple[str, str], Performance]:
    """Performance by the names of actuator and joint."""
    from armdesign.design.requirements.performance import performances

    every = [(machine.actuators[at.actuator], at) for at in performances(machine)]
    drawn = [pair for pair in every if pair[0].kind == "cylinder"] or every
    return {(actuator.name, machine.joints[at.joint]): at for actuator, at in drawn}


@literal
def design_steps(steps: Steps, ax: Axes | None = None) -> Any:
    """Gain by number of pins moved, with their names; returns the axes."""
    count = len(steps.steps)
    ax = figure(height=max(1.2 + 0.5 * count, 2.2))[1][0] if ax is None else ax
    gains, places = [step.gain for step in steps.steps], range(count)
    lengths = [100 * gain if math.isfinite(gain) else 0.0 for gain in gains]
    ax.barh(places, lengths, color=MARK, height=0.6)
    names = [
        ", ".join(pin.removeprefix("cylinder.").replace("_", "-") for pin in step.pins)
        for step in steps.steps
    ]
    labels = [f"{len(step.pins) or 'no'} pin{'s' * (len(step.pins) > 1)}" for step in steps.steps]
    ax.set_yticks(places, labels)
    ax.invert_yaxis()  # fewest above
    for place, length, gain, words in zip(places, lengths, gains, names, strict=True):
        shown = f"{percent(gain)}   {words or 'cylinders alone'}"
        end = max(length, 0), place
        ax.annotate(shown, end, (4, 0), textcoords="offset points", va="center")
    label = "gain of the worst frequency"
    ax.set(xlabel=f"{f'least {label} within the bands' if steps.robust else label} [%]")
    ax.set_xlim(min(0.0, *lengths), 2.2 * max(*lengths, 1.0))
    ax.set_title(title_of(steps.today), fontsize=11)
    return ax


@literal
def trade_off(front: Pareto, ax: Axes | None = None) -> Any:
    """Worst frequency over the limit that is varied, with today's machine; returns the axes."""
    ax = figure()[1][0] if ax is None else ax
    label, unit, now = TRADED[front.against]
    first, limits = front.designs[0], unit * np.array(front.limits)
    today = first.before.worst.frequency
    # between limits the same sizes of a catalogue stay the best
    style = "steps-post" if first.catalogue else "default"
    lines = [("frequency_hz", "best design", "o-", today)]
    if front.robust:
        lowest = first.band_before.low.frequency
        lines.append(("banded_hz", "best design, lowest of the poses in the bands", "o:", lowest))
    above: Style = {"textcoords": "offset points", "ha": "center", "size": 8, "zorder": 3}
    paper: Style = {"fc": "white", "ec": "none", "pad": 1}  # that lines end beside the words
    for column, words, line, start in lines:
        frequencies = front.frame[column]
        ax.plot(limits, frequencies, line, color=MARK, label=words, drawstyle=style)
        ax.plot(
            now, start, "*", ms=12, color=INK, label="_" if start < today else "today's machine"
        )
        for limit, frequency in zip(limits, frequencies, strict=True):
            gain = percent(frequency / start - 1 if start > 0 else math.inf)
            ax.annotate(gain, (limit, frequency), (0, 8), bbox=paper, **above)
    if front.against == "oil":
        shares = np.linspace(min(*limits, now), max(*limits, now), 60)
        equal = "frequency² × joint speed as today"
        ax.plot(shares, today * np.sqrt(shares), "--", color=COMPUTED, label=equal)
    ax.set(xlabel=label, ylabel="worst natural frequency [Hz]")
    ax.margins(0.08, 0.12)
    shown = np.concatenate([front.frame[column].to_numpy() for column, *_ in lines])
    known = np.append(shown[np.isfinite(shown) & (shown > 0)], [start for *_, start in lines])
    room = 0.15 * (float(np.ptp(known)) or 0.1 * today)
    ax.set_ylim(known.min() - room, known.max() + room)
    ax.set_title(title_of(front.today), fontsize=11)
    ax.grid(alpha=0.3)
    ax.legend(frameon=False)
    return ax
