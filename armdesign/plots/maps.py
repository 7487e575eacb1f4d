"""Frequencies and static pressures over a workspace: over two joints, or by place of the tool."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from armdesign.arrays import Array
from armdesign.drawing.colours import actuator_colours
from armdesign.drawing.side_view import side_view
from armdesign.frequency.joint_grid import cell_edges, nearest
from armdesign.plots.canvas import (
    COLOURS,
    COMPUTED,
    INK,
    MARK,
    Style,
    figure,
    joint_label,
    joint_values,
    literal,
    title_of,
)
from armdesign.plots.colour_bars import colour_bar, hide_colour_bar
from armdesign.plots.machines import draw_machine

if TYPE_CHECKING:
    from armdesign.control.bandwidth_map import BandwidthMap
    from armdesign.frequency.maps import FrequencyMap
    from armdesign.frequency.reach_map import ReachMap
    from armdesign.frequency.worst_frequency import WorstPose
    from armdesign.machine.machine import Machine
    from armdesign.mechanism.urdf import Joint
    from armdesign.plots.canvas import Axes, Figure

FREQUENCY = "lowest coupled natural frequency [Hz]"
LOADS = (INK, "#8a95a1", COMPUTED)  # of load cases: colours of no actuator
TALLEST = 8.5  # [in] of a figure
ASIDE = 0.05  # of a machine's size: how far from its place a tool may be seen
PRESSURE = "largest static pressure / supply pressure"


@literal
def frequency_map(
    frequencies: FrequencyMap, ax: Axes | None = None, plane: str = "joints", **limits: float
) -> Axes:
    """Lowest coupled frequency over two joints, or over reach and height, its worst pose marked.

    Args:
        frequencies: the map.
        ax: axes to draw into; new ones if None.
        plane: "joints" (the first two, slewing apart; a machine with one joint gets curves) or
            "reach".
        limits: ``vmin`` and ``vmax`` [Hz] of the colours, so that two maps share one scale.

    Returns:
        The axes.
    """
    ax = figure()[1][0] if ax is None else ax
    machine, worst = frequencies.machine, frequencies.worst
    drawn = drawn_joints(machine)
    if plane == "reach":
        silhouette(reach_map(frequencies.reach_map(), ax, **limits), machine, worst)
        ax.set_title(f"{ax.get_title()}{_steps(machine)}")
    elif len(drawn) == 1:
        _frequency_curves(ax, frequencies)
        ax.set_title("natural frequencies over the joint")
    else:
        joint_cells(ax, *_labelled_plane(ax, frequencies, frequencies.lowest), limits)
        ax.set_title(f"lowest over {_others(machine)}{_steps(machine)}")
        x, y = (float(joint_values(machine.arm.joints[j], worst.q[j])) for j in drawn)
        mark(ax, x, y, worst.frequency)
    return ax


@literal
def reach_map(lowest: ReachMap, ax: Axes | None = None, **limits: float) -> Axes:
    """Lowest frequency by place of the tool; returns the axes. ``limits`` as in the map's own."""
    ax = figure()[1][0] if ax is None else ax
    heatmap(ax, lowest.reach, lowest.height, lowest.frequency, limits)
    ax.use_sticky_edges = False  # the region ends by itself, not at the frame
    ax.margins(0.02)
    ax.set(xlabel="reach [m]", ylabel="height [m]", aspect="equal")
    ax.set_title("lowest over all poses that bring the tool there")
    return ax


@literal
def map_figure(frequencies: FrequencyMap, plane: str) -> Figure:
    """Figure of one map with its machine's title: "joints", "reach", or "holding" pressures."""
    fig, (ax,) = figure()
    if plane == "holding":
        holding_pressure(frequencies, ax)
    else:
        frequency_map(frequencies, ax, plane)
    if plane == "reach":
        _fit_height(fig, float(np.ptp(ax.get_xlim()) / np.ptp(ax.get_ylim())), 1)
    ax.set_title(f"{title_of(frequencies.machine)}\n{ax.get_title()}")
    return fig


@literal
def side_by_side(maps: Mapping[str, FrequencyMap], plane: str = "joints") -> Figure:
    """Figure of maps in a row on one colour scale, each under its label and worst frequency."""
    fig, axes = figure(len(maps), *((6.6, 5.2) if plane == "joints" else (6.0, 6.6)))
    for ax, (label, frequencies) in zip(axes, maps.items(), strict=True):
        frequencies.plot(ax, plane=plane)
        steps = _steps(frequencies.machine) if len(drawn_joints(frequencies.machine)) > 1 else ""
        ax.set_title(f"{label}: worst {frequencies.worst.frequency:.3f} Hz{steps}")
    meshes = [mesh for ax in axes for mesh in ax.collections if mesh.get_array() is not None]
    ends = [mesh.get_clim() for mesh in meshes]
    if plane == "reach" or len({(ax.get_xlabel(), ax.get_ylabel()) for ax in axes}) == 1:
        spans = [(*ax.get_xlim(), *ax.get_ylim()) for ax in axes]  # to one scale, of one size
        (left, _, low, _), (_, right, _, high) = np.min(spans, axis=0), np.max(spans, axis=0)
        for ax in axes:
            ax.set(xlim=(left, right), ylim=(low, high))
        if plane == "reach":
            _fit_height(fig, (right - left) / (high - low), len(axes))
    for mesh in meshes:  # a machine with one joint has curves instead
        mesh.set_clim(min(low for low, _ in ends), max(high for _, high in ends))
    if len(meshes) == len(axes):  # one colour bar says it for all
        for ax in axes[:-1]:
            hide_colour_bar(ax)
    return fig


def _fit_height(fig: Any, proportion: float, count: int) -> None:
    """Height of a figure whose axes in a row have equal scales: no room above and below them."""
    width = (fig.get_size_inches()[0] - 1.2) / count - 0.7
    fig.set_size_inches(fig.get_size_inches()[0], min(width / proportion + 1.4, TALLEST))


@literal
def holding_pressure(frequencies: FrequencyMap, ax: Axes | None = None) -> Axes:
    """Largest static chamber pressure of all cylinders over the supply's; returns the axes.

    Above one the pump cannot hold the load there. A machine with one joint gets a curve per load
    case.
    """
    ax = figure()[1][0] if ax is None else ax
    share = frequencies.holding_pressures.max(axis=1)
    if len(drawn_joints(frequencies.machine)) == 1:
        _pressure_curves(ax, frequencies, share)
        return ax
    x, y, negative = _labelled_plane(ax, frequencies, -share)
    top = max(1.0, float(np.nanmax(-negative)))  # dark red is where the pump is at its end
    joint_cells(ax, x, y, -negative, {"vmin": 0.0, "vmax": top, "cmap": "YlOrRd"}, PRESSURE)
    if np.nanmax(-negative) > 1:
        ax.contour(x, y, -negative.T, levels=[1.0], colors=[MARK])
    ax.set_title(f"largest over {_others(frequencies.machine)}{_steps(frequencies.machine)}")
    return ax


def heatmap(
    ax: Axes, x: Array, y: Array, values: Array, style: Mapping[str, Any], label: str = FREQUENCY
) -> None:
    """Cells of values (nx, ny) around x (nx,) and y (ny,) or between edges; NaN stays blank."""
    style = {"cmap": COLOURS, "shading": "auto", "rasterized": True, **style}
    colour_bar(ax, ax.pcolormesh(x, y, values.T, **style), label)


def joint_cells(ax: Axes, x: Array, y: Array, *cells: Any) -> None:
    """A ``heatmap`` over positions of two joints (nx,) and (ny,), which ends where these do."""
    heatmap(ax, cell_edges(x), cell_edges(y), *cells)


def mark(ax: Axes, x: float, y: float, frequency: float) -> None:
    """Mark the worst pose: a ring and its frequency, written on the side where there is room."""
    for edge, width, order in (("white", 3.5, 9), (MARK, 2, 10)):  # whole at the axes' edge, too
        ring: Style = {"ms": 10, "mfc": "none", "mec": edge, "mew": width}
        ax.plot(x, y, "o", **ring, zorder=order, clip_on=False)
    right, top = x > sum(ax.get_xlim()) / 2, y > sum(ax.get_ylim()) / 2
    sides: Style = {"ha": "right" if right else "left", "va": "top" if top else "bottom"}
    place: Style = {
        "xytext": (-12 if right else 12, -12 if top else 12),
        "textcoords": "offset points",
    }
    box = {"boxstyle": "round,pad=0.25", "fc": "white", "ec": MARK, "alpha": 0.9}
    words = f"{frequency:.3f} Hz"
    ax.annotate(words, (x, y), **place, **sides, color=INK, bbox=box, zorder=11)


def joint_plane(mapped: FrequencyMap | BandwidthMap, values: Array) -> tuple[Array, Array, Array]:
    """Least value on the grid of the two ``drawn_joints``: positions of both [rad, m], (n1, n2).

    ``values`` is one number for each row of the map.
    """
    drawn = drawn_joints(mapped.machine)
    axes = [mapped.workspace.axes[j] for j in drawn]
    cells = tuple(nearest(axis, mapped.q[:, j]) for axis, j in zip(axes, drawn, strict=True))
    least = np.full([len(axis) for axis in axes], np.inf)
    np.minimum.at(least, cells, values)
    return axes[0], axes[1], np.where(np.isinf(least), np.nan, least)


def drawn_joints(machine: Machine) -> list[int]:
    """Indices of the joints that a picture shows: the first one or two that do not slew."""
    still = machine.joints_without_effect
    return [j for j in range(len(machine.joints)) if j not in still][:2] or [0]


def _labelled_plane(
    ax: Axes, frequencies: FrequencyMap, values: Array
) -> tuple[Array, Array, Array]:
    """The ``joint_plane`` in the units of the axes, which are labelled."""
    x, y, least = joint_plane(frequencies, values)
    first, second = (frequencies.machine.arm.joints[j] for j in drawn_joints(frequencies.machine))
    ax.set(xlabel=joint_label(first), ylabel=joint_label(second))
    return joint_values(first, x), joint_values(second, y), least


def _others(machine: Machine) -> str:
    """Words on what a picture over the drawn joints does not show."""
    shown = len(drawn_joints(machine))
    return "all loads" if len(machine.joints) == shown else "all other joints and loads"


def _steps(machine: Machine) -> str:
    """Words on staircases in a map: ends of load cases that exist within a pitch range only."""
    tilting = [case for case in machine.payloads if case.limits and case.mass > 0]
    names = " and ".join(case.name for case in tilting)
    links = " and ".join(dict.fromkeys(str(case.link) for case in tilting))
    return f"\nsteps: where the pitch of {links} ends load case {names}" if tilting else ""


def _frequency_curves(ax: Axes, frequencies: FrequencyMap) -> None:
    """Coupled and rigid-load frequency per load case of a machine with one joint."""
    (index,) = drawn_joints(frequencies.machine)
    joint, worst, top = frequencies.machine.arm.joints[index], frequencies.worst, 0.0
    colours, cases = actuator_colours(frequencies.machine), list(frequencies.worst_of)
    for case, payload in enumerate(cases):
        q, rows = _along(joint, frequencies, payload)
        coupled = frequencies.lowest[rows]
        ax.plot(q, coupled, color=LOADS[case % len(LOADS)], label=f"{payload}: coupled")
        top = max(top, 2.5 * coupled.max())
        for actuator in frequencies.machine.actuators:
            label = f"{payload}: {actuator.name}, rigid load"
            style: Style = {"color": colours[actuator.name], "lw": 1, "label": label}
            style["ls"] = ("--", ":", "-.")[case % 3]
            ax.plot(q, frequencies.columns[f"rigid_{actuator.name}_hz"][rows], **style)
    ax.set(xlabel=joint_label(joint), ylabel="natural frequency [Hz]", ylim=(0, top))
    ax.legend(frameon=False)
    mark(ax, float(joint_values(joint, worst.q[index])), worst.frequency, worst.frequency)


def _along(joint: Joint, frequencies: FrequencyMap, payload: str) -> tuple[Array, Array]:
    """Positions of a joint in a load case in the unit of its axis, ascending, and their rows."""
    q, rows = frequencies.columns[joint.name], np.flatnonzero(frequencies.rows_of(payload))
    rows = rows[np.argsort(q[rows], kind="stable")]
    return joint_values(joint, q[rows]), rows


def _pressure_curves(ax: Axes, frequencies: FrequencyMap, share: Array) -> None:
    """Static over supply pressure (n,), row by row, per load case, with one joint."""
    (index,) = drawn_joints(frequencies.machine)
    joint = frequencies.machine.arm.joints[index]
    for case, name in enumerate(frequencies.worst_of):
        q, rows = _along(joint, frequencies, name)
        ax.plot(q, share[rows], LOADS[case % len(LOADS)], label=name)
    ax.axhline(1.0, color=MARK, lw=1, ls="--", label="supply")
    ax.set(xlabel=joint_label(joint), ylabel=PRESSURE, ylim=(0, None))
    ax.set_title("static pressures over the joint")
    ax.legend(frameon=False)


def silhouette(ax: Axes, machine: Machine, worst: WorstPose) -> None:
    """The machine at its worst pose, seen from the side, and the mark of its tool.

    A machine whose slew axis stands so far from the root's that its tool is seen elsewhere than at
    its reach is left out.
    """
    view = side_view(machine, worst.q)
    reach = machine.heading.reach(worst.q[None], worst.tool[None])
    if abs(view.tool[0, 0] - reach[0]) < ASIDE * view.size:
        draw_machine(ax, machine, view, 0, fc=(1, 1, 1, 0.6), ec=INK, lw=0.9)
    mark(ax, float(reach[0]), float(worst.tool[2]), worst.frequency)
