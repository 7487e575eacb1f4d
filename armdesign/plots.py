"""Drawing: frequency maps as heatmaps. The only door to matplotlib."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from armdesign.arrays import Array

if TYPE_CHECKING:
    from armdesign.design.optimum import Design
    from armdesign.machine import Machine
    from armdesign.maps import FrequencyMap, WorstPose
    from armdesign.simulation.validation import Validation

COLOURS = "viridis"
INK = "#20262e"
MARK = "#e5484d"
CYLINDER = "#f5a524"


def figure(columns: int = 1, width: float = 7.0, height: float = 5.2) -> tuple[Any, Any]:
    """Figure with one row of axes, drawn without a display."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    fig = Figure(figsize=(width * columns, height), layout="constrained")
    FigureCanvasAgg(fig)
    return fig, fig.subplots(1, columns, squeeze=False)[0]


def save(fig: Any, path: Path) -> Path:
    """Write a figure as PNG."""
    fig.savefig(path, dpi=150)
    return path


def frequency_map(frequencies: FrequencyMap, ax: Any = None, plane: str = "joints", **limits: float) -> Any:
    """Lowest coupled frequency over two joints, or over reach and height, its worst pose marked.

    Args:
        frequencies: the map.
        ax: axes to draw into; new ones if None.
        plane: "joints" (the first two; a machine with one joint gets curves) or "reach".
        limits: ``vmin`` and ``vmax`` [Hz] of the colours, so that two maps share one scale.

    Returns:
        The axes.
    """
    ax = figure()[1][0] if ax is None else ax
    if plane == "reach":
        x, z, values = reach_plane(frequencies)
        heatmap(ax, x, z, values, **limits)
        silhouette(ax, frequencies.machine, frequencies.worst)
        ax.set(xlabel="reach [m]", ylabel="height [m]", aspect="equal")
        ax.set_title("worst of all ways to bring the tool there", fontsize=10)
    elif len(frequencies.machine.joints) == 1:
        curves(ax, frequencies)
        ax.set_title("natural frequencies over the joint", fontsize=10)
    else:
        joints = frequencies.machine.arm.joints[:2]
        x, z, values = joint_plane(frequencies)
        scale = [math.degrees(1) if joint.revolute else 1.0 for joint in joints]
        heatmap(ax, x * scale[0], z * scale[1], values, **limits)
        labels = [f"{joint.name} [{'deg' if joint.revolute else 'm'}]" for joint in joints]
        ax.set(xlabel=labels[0], ylabel=labels[1])
        ax.set_title("worst over all other joints and loads", fontsize=10)
        worst = frequencies.worst
        mark(ax, worst.q[0] * scale[0], worst.q[1] * scale[1], worst.frequency)
    return ax


def before_after(design: Design, plane: str = "joints") -> Any:
    """Today's map and the new one side by side on one colour scale; returns the figure."""
    pair = (("today", design.before), ("new", design.after))
    planes = [joint_plane(m)[2] if plane == "joints" and len(m.machine.joints) > 1 else None for _, m in pair]
    values = [p if p is not None else reach_plane(m)[2] for p, (_, m) in zip(planes, pair, strict=True)]
    limits = {"vmin": min(float(np.nanmin(v)) for v in values), "vmax": max(float(np.nanmax(v)) for v in values)}
    fig, axes = figure(2, *((6.6, 5.2) if plane == "joints" else (6.0, 6.6)))
    for ax, (label, frequencies) in zip(axes, pair, strict=True):
        frequencies.plot(ax, plane=plane, **limits)
        ax.set_title(f"{label}: worst {frequencies.worst.frequency:.3f} Hz", fontsize=11)
    fig.suptitle(design.today.section.title or design.today.name)
    return fig


def moment_arms(design: Design) -> Any:
    """Moment arm of every cylinder over its joint, today and new: what the pins buy; returns the figure."""
    from armdesign.ranges import over, sweep

    pairs = [(i, linkage.joints[0]) for i, linkage in enumerate(design.today.linkages) if len(linkage.joints) == 1]
    fig, axes = figure(len(pairs), 4.4, 3.6)
    for ax, (i, j) in zip(axes, pairs, strict=True):
        joint = design.today.arm.joints[j]
        poses = sweep(design.today.arm, j, over(design.today.ranges[j], 121))
        x = poses.q[:, j] * (math.degrees(1) if joint.revolute else 1.0)
        for label, machine, style in (("today", design.today, "--"), ("new", design.machine, "-")):
            arm = np.abs(machine.linkages[i].actuation(poses).moment_arm[:, j])
            ax.plot(x, arm * 1000, style, color=INK if label == "today" else MARK, label=label)
        ax.set(xlabel=f"{joint.name} [{'deg' if joint.revolute else 'm'}]", ylim=(0, None))
        ax.set_title(f"{design.today.cylinders[i].name} cylinder", fontsize=10)
        ax.grid(alpha=0.3)
    axes[0].set_ylabel("moment arm [mm]")
    axes[0].legend(frameon=False)
    return fig


def frequency_responses(validations: dict[str, Validation]) -> Any:
    """Measured and fitted response of every validation's first sweep; returns the figure."""
    fig, axes = figure(len(validations), 5.4, 3.8)
    for ax, (label, validation) in zip(axes, validations.items(), strict=True):
        run = validation.runs[0]
        ax.semilogy(run.fit.frequency, np.abs(run.fit.response), ".", color=INK, ms=5, label="nonlinear simulation")
        ax.semilogy(*run.fit.curve, "-", color=MARK, lw=1.5, label="fit")
        ax.axvline(run.linear_frequency, color="#3b82c4", ls="--", lw=1.2, label="linear natural frequency")
        ax.set(xlabel="frequency [Hz]")
        ax.set_title(f"{label}: {run.cylinder} cylinder, {run.identified_frequency:.3f} Hz", fontsize=10)
        ax.grid(alpha=0.3)
    axes[0].set_ylabel("cylinder speed / speed the spool asks for")
    axes[0].legend(frameon=False)
    return fig


def heatmap(ax: Any, x: Array, y: Array, values: Array, **limits: float) -> None:
    """Cells of values (nx, ny) [Hz] around x (nx,) and y (ny,); NaN stays blank."""
    mesh = ax.pcolormesh(x, y, values.T, cmap=COLOURS, shading="nearest", rasterized=True, **limits)
    bar = ax.figure.colorbar(mesh, ax=ax, pad=0.02)
    bar.set_label("lowest coupled natural frequency [Hz]")
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
    joint = frequencies.machine.arm.joints[0]
    scale = math.degrees(1) if joint.revolute else 1.0
    top = 0.0
    for payload, rows in frequencies.frame.groupby("payload", sort=False):
        rows = rows.sort_values(joint.name)
        ax.plot(rows[joint.name] * scale, rows["f1_hz"], label=f"{payload}: coupled")
        top = max(top, 2.5 * rows["f1_hz"].max())
        for cylinder in frequencies.machine.cylinders:
            name = f"{payload}: {cylinder.name}, rigid load"
            ax.plot(rows[joint.name] * scale, rows[f"rigid_{cylinder.name}_hz"], "--", lw=1, label=name)
    ax.set(xlabel=f"{joint.name} [{'deg' if joint.revolute else 'm'}]", ylabel="natural frequency [Hz]", ylim=(0, top))
    ax.legend(frameon=False)
    mark(ax, frequencies.worst.q[0] * scale, frequencies.worst.frequency, frequencies.worst.frequency)


def joint_plane(frequencies: FrequencyMap) -> tuple[Array, Array, Array]:
    """Least frequency over all else on the grid of the first two joints: values of both and (n1, n2) [Hz]."""
    x, y = frequencies.workspace.axes[:2]
    frame = frequencies.frame
    cells = [
        _nearest(axis, frame[name].to_numpy()) for axis, name in zip((x, y), frequencies.machine.joints, strict=False)
    ]
    values = np.full((len(x), len(y)), np.inf)
    np.minimum.at(values, tuple(cells), frame["f1_hz"].to_numpy())
    return x, y, np.where(np.isinf(values), np.nan, values)


def reach_plane(frequencies: FrequencyMap, cells: int = 90) -> tuple[Array, Array, Array]:
    """Least frequency over all poses that bring the tool to a cell of the reach/height plane; NaN where none does.

    The joint grid is refined by interpolation (tool place and frequency), so that cells between its points are not
    blank. Reach is measured from the root's z axis, forward positive.
    """
    frame = frequencies.frame
    forward, aside, height, lowest = (frame[name].to_numpy() for name in ("tool_x_m", "tool_y_m", "tool_z_m", "f1_hz"))
    reach = np.copysign(np.hypot(forward, aside), forward)
    points = [np.stack([reach, height, lowest], axis=1)]
    points += [_interpolated(frequencies, payload, points[0]) for payload in frame["payload"].unique()]
    reach, height, lowest = np.concatenate(points).T
    size = max(np.ptp(reach), np.ptp(height)) / cells
    x = np.arange(reach.min(), reach.max() + size, size)
    z = np.arange(height.min(), height.max() + size, size)
    values = np.full((len(x), len(z)), np.inf)
    np.minimum.at(values, (_nearest(x, reach), _nearest(z, height)), lowest)
    return x, z, np.where(np.isinf(values), np.nan, values)


def _interpolated(frequencies: FrequencyMap, payload: str, points: Array) -> Array:
    """Points (reach, height, frequency) of one load case on a finer joint grid, where all corners exist."""
    from scipy.ndimage import map_coordinates

    workspace, rows = frequencies.workspace, (frequencies.frame["payload"] == payload).to_numpy()
    shape = tuple(len(axis) for axis in workspace.axes)
    names = list(frequencies.machine.joints)
    q = frequencies.frame.loc[rows, names].to_numpy()
    index = [_nearest(axis, q[:, j]) for j, axis in enumerate(workspace.axes)]
    on_grid = np.all(
        [np.abs(axis[i] - q[:, j]) < 1e-9 for j, (axis, i) in enumerate(zip(workspace.axes, index, strict=True))],
        axis=0,
    )
    grid = np.full((3, *shape), np.nan)
    cells = np.ravel_multi_index([i[on_grid] for i in index], shape)
    grid.reshape(3, -1)[:, cells] = points[rows][on_grid].T
    budget = 600_000 ** (1 / len(shape))
    fine = [np.linspace(0, count - 1, max(count, int(budget))) for count in shape]
    coordinates = np.stack(np.meshgrid(*fine, indexing="ij")).reshape(len(shape), -1)
    values = np.stack([map_coordinates(layer, coordinates, order=1, mode="nearest") for layer in grid], axis=1)
    return np.asarray(values[np.isfinite(values).all(axis=1)])


def _nearest(axis: Array, values: Array) -> Array:
    step = (axis[-1] - axis[0]) / max(len(axis) - 1, 1) or 1.0
    return np.clip(np.rint((values - axis[0]) / step).astype(int), 0, len(axis) - 1)


def silhouette(ax: Any, machine: Machine, worst: WorstPose) -> None:
    """The arm at its worst pose: links as lines, cylinders as bars, the tool marked."""
    arm, poses = machine.arm, machine.arm.kinematics(worst.q[None])
    frames = poses.translation[0]
    chain = [frames[j] for j in arm.chain(machine.tool.link)]
    line = np.array([*chain, worst.tool])
    ax.plot(line[:, 0], line[:, 2], "-", color="white", lw=6, solid_capstyle="round", zorder=3)
    ax.plot(line[:, 0], line[:, 2], "-", color=INK, lw=3, solid_capstyle="round", zorder=4)
    for linkage in machine.linkages:
        base, rod_end, *bars = (pin[0] for pin in linkage.pins(poses))
        for pins, style in (((base, rod_end), {"color": CYLINDER, "lw": 4}), (bars, {"color": INK, "lw": 1.5})):
            ax.plot([pin[0] for pin in pins], [pin[2] for pin in pins], "-", zorder=4, **style)
    mark(ax, worst.tool[0], worst.tool[2], worst.frequency)
