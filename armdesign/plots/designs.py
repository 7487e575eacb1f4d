"""A new design beside today's machine: maps, moment arms, and what frequency costs."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np

from armdesign.arrays import Array
from armdesign.mechanism.joint_ranges import over
from armdesign.plots.canvas import (
    COMPUTED,
    INK,
    MARK,
    STYLES,
    figure,
    joint_label,
    joint_values,
    literal,
)
from armdesign.plots.maps import side_by_side

if TYPE_CHECKING:
    from armdesign.design.design import Design
    from armdesign.design.pareto import Pareto
    from armdesign.machine.machine import Machine

TRADED = {  # limit of a trade-off: label of its axis, axis unit over SI, today's value
    "oil": ("allowed oil volume / today's (joint speed falls with it)", 1.0, 1.0),
    "thrust": ("allowed thrust / today's", 1.0, 1.0),
    "digging": ("required digging torque / today's", 1.0, 1.0),
    "lift": ("lift kept at every point of the chart / today's", 1.0, 1.0),
    "pin_box": ("largest move of each pin coordinate [mm]", 1000.0, 0.0),
}


@literal
def before_after(design: Design, plane: str = "joints") -> Any:
    """Figure of today's map and the new one on one colour scale."""
    fig = side_by_side({"today": design.before, "new": design.after}, plane)
    fig.suptitle(design.today.section.title or design.today.name)
    return fig


def moment_arms(design: Design) -> Any:
    """Figure of every cylinder's moment arm over its joint, today and new."""
    return moment_arm_curves({"today": design.today, "new": design.machine})


@literal
def moment_arm_curves(machines: Mapping[str, Machine]) -> Any:
    """Figure of every cylinder's moment arm about every joint that it spans, over its range.

    A cylinder across several joints is drawn with the others in the middle of their ranges. The
    first machine says which cylinders and joints; the other machines are drawn beside it where
    they have cylinders and joints of these names.
    """
    first = next(iter(machines.values()))
    spans = [
        (cylinder.name, first.arm.joints[j], len(linkage.joints))
        for cylinder, linkage in zip(first.cylinders, first.linkages, strict=True)
        for j in linkage.joints
    ]
    fig, axes = figure(len(spans), 4.4, 3.6)
    for ax, (name, joint, spanned) in zip(axes, spans, strict=True):
        styles = cycle(STYLES) if len(machines) > 1 else [("-", INK)]
        for (label, machine), (style, colour) in zip(machines.items(), styles, strict=False):
            if (curve := _moment_arm(machine, name, joint.name)) is not None:
                ax.plot(*curve, style, color=colour, label=label)
        ylabel = "moment arm [mm]" if joint.revolute else "cylinder per joint [m/m]"
        ax.set(xlabel=joint_label(joint), ylabel=ylabel)
        ax.set_ylim(0, 1.08 * max(line.get_ydata().max() for line in ax.lines))
        about = f" about {joint.name}" if spanned > 1 else ""
        ax.set_title(f"{name} cylinder{about}", fontsize=10)
        ax.grid(alpha=0.3)
    if len(machines) > 1:
        axes[0].legend(frameon=False)
    return fig


def _moment_arm(machine: Machine, cylinder: str, joint: str) -> tuple[Array, Array] | None:
    """Joint positions and sizes of a cylinder's moment arm in axes' units; None without it."""
    names = [c.name for c in machine.cylinders]
    if cylinder not in names or joint not in machine.joints:
        return None
    linkage, j = machine.linkages[names.index(cylinder)], machine.joints.index(joint)
    if j not in linkage.joints:
        return None
    q = np.tile(machine.ranges.mean(axis=1), (121, 1))
    q[:, j] = over(machine.ranges[j], len(q))
    size = np.abs(linkage.actuation(machine.arm.kinematics(q)).moment_arm[:, j])
    unit = 1000 if machine.arm.joints[j].revolute else 1
    return joint_values(machine.arm.joints[j], q[:, j]), size * unit


@literal
def trade_off(front: Pareto, ax: Any = None) -> Any:
    """Worst frequency over the limit that is varied, with today's machine; returns the axes."""
    ax = figure()[1][0] if ax is None else ax
    label, unit, now = TRADED[front.against]
    first, limits = front.designs[0], unit * np.array(front.limits)
    today = first.before.worst.frequency
    # between limits the same sizes of a catalogue stay the best
    style = "steps-post" if first.catalogue else "default"
    frequencies = front.frame["frequency_hz"]
    ax.plot(limits, frequencies, "o-", color=MARK, label="best design", drawstyle=style)
    ax.plot(now, today, "*", ms=15, color=INK, label="today's machine")
    if front.robust:
        banded = front.frame["banded_hz"]
        ax.plot(limits, banded, "o:", color=MARK, label="best design, worst within the bands")
        ax.plot(now, first.band_before.low.frequency, "*", ms=9, color=INK)
    if front.against == "oil":
        shares = np.linspace(min(*limits, now), max(*limits, now), 60)
        equal = "frequency² × joint speed as today"
        ax.plot(shares, today * np.sqrt(shares), "--", color=COMPUTED, label=equal)
    ax.set(xlabel=label, ylabel="worst natural frequency [Hz]", ylim=(0, None))
    ax.set_title(front.today.section.title or front.today.name, fontsize=11)
    ax.grid(alpha=0.3)
    ax.legend(frameon=False)
    return ax
