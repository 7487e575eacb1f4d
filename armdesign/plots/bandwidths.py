"""Bandwidths of position loops over a workspace, on one colour scale for all controllers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from armdesign.arrays import Array
from armdesign.plots.canvas import (
    COMPUTED,
    INK,
    MARK,
    Style,
    figure,
    joint_label,
    joint_values,
    legend_below,
    literal,
    plain_decades,
    title_of,
)
from armdesign.plots.colour_bars import colour_bar, hide_colour_bar
from armdesign.plots.maps import LOADS, drawn_joints, joint_cells, joint_plane

if TYPE_CHECKING:
    from armdesign.control.bandwidth_map import BandwidthMap
    from armdesign.control.gain_schedule import GainSchedule
    from armdesign.plots.canvas import Axes, Figure

BANDWIDTH = "bandwidth of narrowest loop [Hz]"
GAIN = "position gain [1/s]"
TITLES = {
    "proportional": "position loops alone",
    "individual": "position loops alone,\nown gains",
    "damped": "+ pressure feedback,\ncommon gains",
    "own": "+ pressure feedback,\nown gains",
}
MAPPED = ("proportional", "damped", "own")  # the individual map hardly differs: slowest loops


@literal
def bandwidth_map(
    bandwidths: BandwidthMap, ax: Axes | None = None, scheme: str = "own", **limits: float
) -> Any:
    """Least bandwidth over two joints, with the worst poses of bandwidth and of frequency.

    A machine with one joint gets curves.

    Args:
        bandwidths: the map.
        ax: axes to draw into; new ones if None.
        scheme: "proportional", "individual", "damped" or "own".
        limits: ``vmin`` and ``vmax`` [Hz] of the colours, which are logarithmic.

    Returns:
        The axes.

    Raises:
        ArmDesignError: there is no such scheme.
    """
    worst, machine = bandwidths.worst(scheme), bandwidths.machine
    ax = figure()[1][0] if ax is None else ax
    drawn = drawn_joints(machine)
    ax.set_title(TITLES[scheme], fontsize=11)
    if len(drawn) == 1:
        _curves(ax, bandwidths, scheme)
        return ax
    x, y, least = _least(bandwidths, scheme)
    first, second = (machine.arm.joints[j] for j in drawn)
    ax.set(xlabel=joint_label(first), ylabel=joint_label(second))
    low, high = limits.get("vmin", np.nanmin(least)), limits.get("vmax", np.nanmax(least))
    style = {"norm": "log", "vmin": max(low, 1e-3 * high), "vmax": high}
    joint_cells(ax, joint_values(first, x), joint_values(second, y), least, style, BANDWIDTH)
    for row, colour, size, words in (  # rings that are both seen where the poses are one
        (worst, MARK, 15, "worst bandwidth"),
        (bandwidths.softest, COMPUTED, 9, "at the lowest frequency"),
    ):
        at = [float(joint_values(one, row[one.name])) for one in (first, second)]
        label = f"{words}: {row[f'{scheme}_hz']:.3g} Hz"
        ring: Style = {"ms": size, "mfc": "none", "clip_on": False}  # whole at the axes' edge, too
        ax.plot(*at, "o", mec="white", mew=4, **ring)
        ax.plot(*at, "o", mec=colour, mew=2, label=label, **ring)
    legend_below(ax, labelspacing=1.1)  # rings apart
    return ax


@literal
def bandwidth_maps(bandwidths: BandwidthMap) -> Figure:
    """Figure of the controllers of a map in a row, on one colour scale."""
    values = np.concatenate([_least(bandwidths, scheme)[2].ravel() for scheme in MAPPED])
    low, high = float(values[values > 0].min()), float(np.nanmax(values))
    fig, axes = figure(len(MAPPED), 5.6, 6.6)
    for ax, scheme in zip(axes, MAPPED, strict=True):
        bandwidth_map(bandwidths, ax, scheme, vmin=low, vmax=high)
        if len(drawn_joints(bandwidths.machine)) == 1:
            ax.set_ylim(0.8 * low, 2 * high)
            plain_decades(ax)
    for ax in axes[:-1]:
        if ax.child_axes:
            hide_colour_bar(ax)
    if len(drawn_joints(bandwidths.machine)) == 1:  # curves, which are the same in all
        for ax in axes[1:]:
            ax.set_ylabel("")
            ax.get_legend().remove()
    fig.suptitle(title_of(bandwidths.machine))
    return fig


@literal
def gain_schedule(schedule: GainSchedule) -> Figure:
    """Figure of the position gain of each loop at the poses at which gains are known."""
    machine = schedule.machine
    drawn, gains = drawn_joints(machine), schedule.gains[:, : len(machine.joints)]
    joints = [machine.arm.joints[j] for j in drawn]
    at = [joint_values(machine.arm.joints[j], schedule.poses[:, j]) for j in drawn]
    fig, axes = figure(len(machine.joints), 5.6, 5.0)
    for ax, name, own in zip(axes, machine.joints, gains.T, strict=True):
        ax.set(title=f"loop of {name}", xlabel=joint_label(joints[0]))
        if len(joints) == 1:
            ax.plot(at[0], own, "o", color=INK)
            ax.set_ylabel(GAIN)
            ax.grid(alpha=0.3)
        else:
            order = np.argsort(-own)  # the smallest on top, where poses differ in other joints
            places = [one[order] for one in at]
            ends = max(float(gains.min()), 1e-3 * float(gains.max())), float(gains.max())
            colours: Style = {"norm": "log", "vmin": ends[0], "vmax": ends[1]}
            dots = ax.scatter(*places, c=own[order], s=40, **colours)
            ax.set_ylabel(joint_label(joints[1]))
            colour_bar(ax, dots, GAIN)
    for ax in axes[:-1] if len(joints) > 1 else ():
        hide_colour_bar(ax)
    fig.suptitle(title_of(machine))
    return fig


def _least(bandwidths: BandwidthMap, scheme: str) -> tuple[Array, Array, Array]:
    """Positions of the drawn joints, and the least bandwidth there (n1, n2) [Hz].

    Of a machine with one joint the bandwidths of all rows.
    """
    frame = bandwidths.frame
    value = np.where(frame["works"], frame[f"{scheme}_hz"], np.inf)
    if len(drawn_joints(bandwidths.machine)) == 1:
        return value, value, value[np.isfinite(value)]
    return joint_plane(bandwidths, value)


def _curves(ax: Axes, bandwidths: BandwidthMap, scheme: str) -> None:
    """Bandwidth by load case, and f/3, over the only joint."""
    (index,) = drawn_joints(bandwidths.machine)
    joint = bandwidths.machine.arm.joints[index]
    works = bandwidths.frame[bandwidths.frame["works"]]
    for case, (payload, rows) in enumerate(works.groupby("payload", sort=False)):
        rows, colour = rows.sort_values(joint.name), LOADS[case % len(LOADS)]
        q = joint_values(joint, rows[joint.name].to_numpy())
        ax.plot(q, rows[f"{scheme}_hz"], color=colour, label=str(payload))
        ax.plot(q, rows["rule_hz"], "--", lw=1, color=colour, label=f"{payload}: f/3")
    ax.set(xlabel=joint_label(joint), ylabel=BANDWIDTH)
    plain_decades(ax)
    legend_below(ax)
