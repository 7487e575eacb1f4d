"""Drawing: frequency maps as heatmaps. The only door to matplotlib."""

from __future__ import annotations

import contextlib
import math
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

import numpy as np

from armdesign import user_folders as folders
from armdesign.arrays import Array
from armdesign.errors import printable
from armdesign.frequency.workspace import nearest

if TYPE_CHECKING:
    from armdesign.design.design import Design
    from armdesign.design.pareto import Pareto
    from armdesign.frequency.maps import FrequencyMap
    from armdesign.frequency.worst_frequency import WorstPose
    from armdesign.machine.machine import Machine
    from armdesign.mechanism.urdf import Joint
    from armdesign.paper.reproduction import Reproduction
    from armdesign.simulation.validation import Validation

P = ParamSpec("P")
T = TypeVar("T")

COLOURS = "viridis"
INK = "#20262e"
MARK = "#e5484d"
COMPUTED = "#3b82c4"
CYLINDER = "#f5a524"
STYLES = (
    ("--", INK),
    ("-", MARK),
    ("-.", COMPUTED),
    (":", CYLINDER),
)  # of curves, one machine each


def figure(columns: int = 1, width: float = 7.0, height: float = 5.2) -> tuple[Any, Any]:
    """Figure with one row of axes, drawn without a display."""
    _give_matplotlib_a_folder()
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    fig = Figure(figsize=(width * columns, height), layout="constrained")
    FigureCanvasAgg(fig)
    return fig, fig.subplots(1, columns, squeeze=False)[0]


def _give_matplotlib_a_folder() -> None:
    """A folder that stays, where the user's home cannot be written.

    Else matplotlib complains and starts anew.
    """
    home = Path(os.path.expanduser(os.environ.get("XDG_CONFIG_HOME") or "~/.config"))
    there = next((place for place in (home, *home.parents) if place.is_dir()), home)
    if (
        "matplotlib" in sys.modules
        or "MPLCONFIGDIR" in os.environ
        or (home.is_absolute() and folders.writable(there))
    ):
        return
    for place in folders.temporary():
        with contextlib.suppress(OSError):
            if folders.made(place / "matplotlib") and folders.writable(place / "matplotlib"):
                os.environ["MPLCONFIGDIR"] = str(place / "matplotlib")
                return


def literal(draw: Callable[P, T]) -> Callable[P, T]:
    """A drawing of axes or a figure in which names stand as they are: no formula, no control character."""

    @wraps(draw)
    def drawn(*args: P.args, **kwargs: P.kwargs) -> T:
        made = draw(*args, **kwargs)
        _make_literal(made)
        return made

    return drawn


def _make_literal(drawn: Any) -> None:
    """All words but those on the ticks, whose powers of ten are formulas."""
    words = list(drawn.texts)
    for ax in drawn.axes if hasattr(drawn, "savefig") else [drawn]:
        legend = ax.get_legend()
        words += [
            ax.title,
            ax.xaxis.label,
            ax.yaxis.label,
            *ax.texts,
            *(legend.get_texts() if legend else []),
        ]
    for text in words:
        text.set_text(printable(text.get_text()))
        text.set_parse_math(False)


def save(fig: Any, path: Path) -> Path:
    """Write a figure as PNG."""
    _make_literal(fig)
    fig.savefig(path, dpi=150)
    return path


@literal
def frequency_map(
    frequencies: FrequencyMap, ax: Any = None, plane: str = "joints", **limits: float
) -> Any:
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
    if plane == "reach":
        heatmap(ax, *reach_plane(frequencies), limits)
        silhouette(ax, frequencies.machine, frequencies.worst)
        ax.set(xlabel="reach [m]", ylabel="height [m]", aspect="equal")
        ax.set_title("worst of all ways to bring the tool there", fontsize=10)
    elif len(drawn_joints(frequencies.machine)) == 1:
        curves(ax, frequencies)
        ax.set_title("natural frequencies over the joint", fontsize=10)
    else:
        drawn = drawn_joints(frequencies.machine)
        joints = [frequencies.machine.arm.joints[j] for j in drawn]
        x, z, values = joint_plane(frequencies)
        scale = [_scale(joint) for joint in joints]
        heatmap(ax, x * scale[0], z * scale[1], values, limits)
        ax.set(xlabel=_label(joints[0]), ylabel=_label(joints[1]))
        ax.set_title(f"worst over {_others(frequencies.machine)}", fontsize=10)
        worst = frequencies.worst
        mark(ax, worst.q[drawn[0]] * scale[0], worst.q[drawn[1]] * scale[1], worst.frequency)
    return ax


@literal
def side_by_side(maps: Mapping[str, FrequencyMap], plane: str = "joints") -> Any:
    """Maps in a row on one colour scale, each under its label and worst frequency.

    Returns the figure.
    """
    fig, axes = figure(len(maps), *((6.6, 5.2) if plane == "joints" else (6.0, 6.6)))
    for ax, (label, frequencies) in zip(axes, maps.items(), strict=True):
        frequencies.plot(ax, plane=plane)
        ax.set_title(f"{label}: worst {frequencies.worst.frequency:.3f} Hz", fontsize=11)
    heatmaps = [drawn for ax in axes for drawn in ax.collections if drawn.get_array() is not None]
    ends = [drawn.get_clim() for drawn in heatmaps]
    for drawn in heatmaps:  # a machine with one joint has curves instead
        drawn.set_clim(min(low for low, _ in ends), max(high for _, high in ends))
    return fig


@literal
def before_after(design: Design, plane: str = "joints") -> Any:
    """Today's map and the new one side by side on one colour scale; returns the figure."""
    fig = side_by_side({"today": design.before, "new": design.after}, plane)
    fig.suptitle(design.today.section.title or design.today.name)
    return fig


def moment_arms(design: Design) -> Any:
    """Moment arm of every cylinder over its joint, today and new: what the pins buy.

    Returns the figure.
    """
    return moment_arm_curves({"today": design.today, "new": design.machine})


@literal
def moment_arm_curves(machines: Mapping[str, Machine]) -> Any:
    """Moment arm of every cylinder about every joint that it spans, over that joint's range.

    Returns the figure.

    A cylinder across several joints is drawn with the others in the middle of their ranges. The
    first machine says which cylinders and joints; of the other machines those of the same names
    are drawn beside them.
    """
    first = next(iter(machines.values()))
    spans = [
        (c.name, j, k)
        for c, k in zip(first.cylinders, first.linkages, strict=True)
        for j in k.joints
    ]
    styles = STYLES if len(machines) > 1 else (("-", INK),)
    fig, axes = figure(len(spans), 4.4, 3.6)
    for ax, (name, j, linkage) in zip(axes, spans, strict=True):
        joint = first.arm.joints[j]
        for (label, machine), (style, colour) in zip(
            machines.items(), cycle(styles), strict=False
        ):
            if (curve := _moment_arm(machine, name, joint.name)) is not None:
                ax.plot(*curve, style, color=colour, label=label)
        ax.set(
            xlabel=_label(joint),
            ylabel="moment arm [mm]" if joint.revolute else "cylinder per joint [m/m]",
        )
        ax.set_ylim(0, 1.08 * max(line.get_ydata().max() for line in ax.lines))
        ax.set_title(
            f"{name} cylinder" + (f" about {joint.name}" if len(linkage.joints) > 1 else ""),
            fontsize=10,
        )
        ax.grid(alpha=0.3)
    if len(machines) > 1:
        axes[0].legend(frameon=False)
    return fig


def _moment_arm(machine: Machine, cylinder: str, joint: str) -> tuple[Array, Array] | None:
    """Joint positions and sizes of a cylinder's moment arm there, in the labels' units.

    None if there is none.
    """
    from armdesign.mechanism.joint_ranges import over

    linkage = {c.name: k for c, k in zip(machine.cylinders, machine.linkages, strict=True)}.get(
        cylinder
    )
    if linkage is None or joint not in [machine.joints[j] for j in linkage.joints]:
        return None
    j = machine.joints.index(joint)
    q = np.tile(machine.ranges.mean(axis=1), (121, 1))
    q[:, j] = over(machine.ranges[j], len(q))
    arm = np.abs(linkage.actuation(machine.arm.kinematics(q)).moment_arm[:, j])
    return q[:, j] * _scale(machine.arm.joints[j]), arm * (
        1000 if machine.arm.joints[j].revolute else 1
    )


@literal
def holding_pressure(frequencies: FrequencyMap, ax: Any = None) -> Any:
    """Largest static chamber pressure over the supply's, of all cylinders, over the first two joints; returns the axes.

    Above one the pump cannot hold the load there. A machine with one joint gets a curve per load
    case.
    """
    ax = figure()[1][0] if ax is None else ax
    share = frequencies.holding_pressures.max(axis=1)
    joints = [frequencies.machine.arm.joints[j] for j in drawn_joints(frequencies.machine)]
    scale = [_scale(joint) for joint in joints]
    if len(joints) == 1:
        q, payload = (
            frequencies.frame[joints[0].name].to_numpy(),
            frequencies.frame["payload"].to_numpy(),
        )
        for name in frequencies.worst_of:
            rows = np.flatnonzero(payload == name)
            rows = rows[np.argsort(q[rows])]
            ax.plot(q[rows] * scale[0], share[rows], label=name)
        ax.axhline(1.0, color=MARK, lw=1, ls="--")
        ax.set(
            xlabel=_label(joints[0]),
            ylabel="largest static pressure / supply pressure",
            ylim=(0, None),
        )
        ax.legend(frameon=False)
        return ax
    x, y, values = joint_plane(frequencies, -share)
    heatmap(
        ax,
        x * scale[0],
        y * scale[1],
        -values,
        {"vmin": 0.0},
        "largest static pressure / supply pressure",
        "YlOrRd",
    )
    if np.nanmax(-values) > 1:
        ax.contour(x * scale[0], y * scale[1], -values.T, levels=[1.0], colors=[MARK])
    ax.set(xlabel=_label(joints[0]), ylabel=_label(joints[1]))
    ax.set_title(f"largest over {_others(frequencies.machine)}", fontsize=10)
    return ax


@literal
def trade_off(found: Pareto, ax: Any = None) -> Any:
    """Worst frequency over the limit that it trades against, today's machine beside it.

    Returns the axes.
    """
    ax = figure()[1][0] if ax is None else ax
    label, scale, now = {
        "oil": ("swept oil allowed, over today's (joint speed falls with it)", 1.0, 1.0),
        "thrust": ("thrust allowed, over today's", 1.0, 1.0),
        "digging": ("digging torque to keep, over today's", 1.0, 1.0),
        "pin_box": ("how far each pin coordinate may move [mm]", 1000.0, 0.0),
    }[found.against]
    limits = scale * np.array(found.limits)
    today = found.designs[0].before.worst.frequency
    style = (
        "steps-post" if found.designs[0].catalogue else "default"
    )  # between limits the same sizes stay the best
    ax.plot(
        limits, found.frame["frequency_hz"], "o-", color=MARK, label="best design", drawstyle=style
    )
    ax.plot(now, today, "*", ms=15, color=INK, label="today's machine")
    if found.robust:
        ax.plot(
            limits,
            found.frame["banded_hz"],
            "o:",
            color=MARK,
            label="best design, worst within the bands",
        )
        ax.plot(now, found.designs[0].band_before.low.frequency, "*", ms=9, color=INK)
    if found.against == "oil":
        shares = np.linspace(min(*limits, now), max(*limits, now), 60)
        ax.plot(
            shares,
            today * np.sqrt(shares),
            "--",
            color=COMPUTED,
            label="frequency² × joint speed as today",
        )
    ax.set(xlabel=label, ylabel="worst natural frequency [Hz]", ylim=(0, None))
    ax.set_title(found.today.section.title or found.today.name, fontsize=11)
    ax.grid(alpha=0.3)
    ax.legend(frameon=False)
    return ax


@literal
def frequency_responses(validations: dict[str, Validation]) -> Any:
    """Measured and fitted response of the first sweep of every validation that has one.

    Returns the figure.
    """
    shown = {
        label: validation.runs[0] for label, validation in validations.items() if validation.runs
    }
    fig, axes = figure(max(len(shown), 1), 5.4, 3.8)
    for ax, (label, run) in zip(axes, shown.items(), strict=bool(shown)):
        ax.semilogy(
            run.fit.frequency,
            np.abs(run.fit.response),
            ".",
            color=INK,
            ms=5,
            label="nonlinear simulation",
        )
        ax.semilogy(*run.fit.curve, "-", color=MARK, lw=1.5, label="fit")
        ax.axvline(
            run.linear_frequency, color=COMPUTED, ls="--", lw=1.2, label="linear natural frequency"
        )
        ax.set(xlabel="frequency [Hz]")
        ax.set_title(
            f"{label}: {run.cylinder} cylinder, {run.identified_frequency:.3f} Hz", fontsize=10
        )
        ax.grid(alpha=0.3)
    axes[0].set_ylabel("cylinder speed / speed the spool asks for")
    if shown:
        axes[0].legend(frameon=False)
    return fig


def heatmap(
    ax: Any,
    x: Array,
    y: Array,
    values: Array,
    limits: Mapping[str, float],
    label: str = "lowest coupled natural frequency [Hz]",
    colours: str = COLOURS,
) -> None:
    """Cells of values (nx, ny) around x (nx,) and y (ny,); NaN stays blank."""
    mesh = ax.pcolormesh(
        x, y, values.T, cmap=colours, shading="nearest", rasterized=True, **limits
    )
    bar = ax.figure.colorbar(mesh, ax=ax, pad=0.02)
    bar.set_label(label)
    bar.outline.set_visible(False)
    ax.set_facecolor("white")


def mark(ax: Any, x: float, y: float, frequency: float) -> None:
    """The worst pose: a ring and its frequency, written on the side where there is room."""
    ax.plot(x, y, "o", ms=10, mfc="none", mec="white", mew=3.5, zorder=5)
    ax.plot(x, y, "o", ms=10, mfc="none", mec=MARK, mew=2, zorder=6)
    x_low, x_high = ax.get_xlim()
    y_low, y_high = ax.get_ylim()
    right, top = x > (x_low + x_high) / 2, y > (y_low + y_high) / 2
    ax.annotate(
        f"{frequency:.3f} Hz",
        (x, y),
        xytext=(-12 if right else 12, -12 if top else 12),
        textcoords="offset points",
        ha="right" if right else "left",
        va="top" if top else "bottom",
        color=INK,
        bbox={"boxstyle": "round,pad=0.25", "fc": "white", "ec": MARK, "alpha": 0.9},
        zorder=7,
    )


def curves(ax: Any, frequencies: FrequencyMap) -> None:
    """Natural frequency of a machine with one joint over that joint: coupled and rigid load, per load case."""
    (index,) = drawn_joints(frequencies.machine)
    joint = frequencies.machine.arm.joints[index]
    scale = _scale(joint)
    top = 0.0
    for payload, rows in frequencies.frame.groupby("payload", sort=False):
        rows = rows.sort_values(joint.name)
        ax.plot(rows[joint.name] * scale, rows["f1_hz"], label=f"{payload}: coupled")
        top = max(top, 2.5 * rows["f1_hz"].max())
        for cylinder in frequencies.machine.actuators:
            name = f"{payload}: {cylinder.name}, rigid load"
            ax.plot(
                rows[joint.name] * scale, rows[f"rigid_{cylinder.name}_hz"], "--", lw=1, label=name
            )
    ax.set(xlabel=_label(joint), ylabel="natural frequency [Hz]", ylim=(0, top))
    ax.legend(frameon=False)
    mark(
        ax,
        frequencies.worst.q[index] * scale,
        frequencies.worst.frequency,
        frequencies.worst.frequency,
    )


def joint_plane(
    frequencies: FrequencyMap, values: Array | None = None
) -> tuple[Array, Array, Array]:
    """Least value over all else on the grid of ``drawn_joints``: values of both and (n1, n2).

    ``values`` is one number for each row of the map's frame; the lowest coupled frequency [Hz] if
    None.
    """
    drawn, frame = drawn_joints(frequencies.machine), frequencies.frame
    x, y = (frequencies.workspace.axes[j] for j in drawn)
    names = [frequencies.machine.joints[j] for j in drawn]
    cells = [
        nearest(axis, frame[name].to_numpy()) for axis, name in zip((x, y), names, strict=True)
    ]
    least = np.full((len(x), len(y)), np.inf)
    np.minimum.at(least, tuple(cells), frame["f1_hz"].to_numpy() if values is None else values)
    return x, y, np.where(np.isinf(least), np.nan, least)


def drawn_joints(machine: Machine) -> list[int]:
    """The coordinates of pictures: the first two that do not merely slew the whole arm.

    One if there is but one.
    """
    return [j for j in range(len(machine.joints)) if j not in machine.idle_joints][:2] or [0]


def _others(machine: Machine) -> str:
    """What a picture over the drawn joints does not show."""
    return (
        "all loads"
        if len(machine.joints) == len(drawn_joints(machine))
        else "all other joints and loads"
    )


def reach_plane(frequencies: FrequencyMap) -> tuple[Array, Array, Array]:
    """Least frequency at each place of the tool: reach, height and (nx, nz) [Hz].

    NaN where no pose brings it there.
    """
    found = frequencies.reach_map()
    return found.reach, found.height, found.frequency


def _scale(joint: Joint) -> float:
    """From SI to the labels' unit."""
    return math.degrees(1) if joint.revolute else 1.0


def _label(joint: Joint) -> str:
    return f"{joint.name} [{'deg' if joint.revolute else 'm'}]"


def silhouette(ax: Any, machine: Machine, worst: WorstPose) -> None:
    """The arm at its worst pose, seen square to the tool's direction: links as lines, cylinders as bars."""
    arm, poses = machine.arm, machine.arm.kinematics(worst.q[None])
    azimuth = math.atan2(worst.tool[1], worst.tool[0])
    forward = np.array([math.cos(azimuth), math.sin(azimuth)])
    forward = forward * math.copysign(1.0, float(forward @ arm.heading(worst.q[None])[0]))

    def draw(points: Sequence[Array], **style: Any) -> None:
        places = np.array(points).reshape(-1, 3)
        ax.plot(places[:, :2] @ forward, places[:, 2], "-", solid_capstyle="round", **style)

    line = [*(poses.translation[0, j] for j in arm.chain(machine.tool.link)), worst.tool]
    draw(line, color="white", lw=6, zorder=3)
    draw(line, color=INK, lw=3, zorder=4)
    for linkage in machine.linkages:
        base, rod_end, *bars = (pin[0] for pin in linkage.pins(poses))
        draw([base, rod_end], color=CYLINDER, lw=4, zorder=4)
        draw(bars, color=INK, lw=1.5, zorder=4)
    mark(ax, float(worst.tool[:2] @ forward), worst.tool[2], worst.frequency)


# --------------------------------------------------------------------------------------- the paper


@literal
def paper_pair(found: Reproduction, formula: str) -> Any:
    """Identified (red) and computed (blue) frequencies against load mass and link length, in the paper's form.

    Dots: identified in the sweep, the paper's way; rings: at small amplitude. Returns the figure.
    """
    from armdesign.paper.reproduction import FORMULAS

    mass, length = found.mechanism.load_mass, found.mechanism.link_length
    fig, axes = figure(2, 6.2, 5.4)
    pairs = (("load mass m2 [kg]", mass, length, "m"), ("link length l2 [m]", length, mass, "kg"))
    for ax, (label, across, beside, unit) in zip(axes, pairs, strict=True):
        curve_family(
            ax,
            across,
            beside,
            found.computed[formula],
            color=COMPUTED,
            marker="s",
            label="computed",
        )
        curve_family(
            ax,
            across,
            beside,
            found.swept,
            color=MARK,
            marker="o",
            label="identified in the sweep",
        )
        ax.plot(
            across,
            found.identified,
            "o",
            mfc="none",
            mec=MARK,
            ms=6,
            label="identified at small amplitude",
        )
        ax.set(
            xlabel=label,
            ylim=(0, None),
            title=f"a curve for each {'length' if unit == 'm' else 'mass'}",
        )
        name_ends(ax, across, beside, found.computed[formula], unit)
        ax.grid(alpha=0.3)
    axes[0].set_ylabel("frequency [Hz]")
    axes[0].legend(frameon=False)
    error = float(found.errors["swept"][formula])
    fig.suptitle(f"{FORMULAS[formula]}: {error:.3g} rad/s from what the sweep shows")
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
