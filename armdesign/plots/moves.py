"""Moves: commands, flow, pressures, path and what is left; and how exact a shaper must be."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from armdesign.arrays import Array
from armdesign.drawing.colours import actuator_colours
from armdesign.plots.canvas import (
    COMPUTED,
    CYLINDER,
    INK,
    MARK,
    Style,
    figure,
    legend_below,
    literal,
    title_of,
)
from armdesign.units import bar, l_per_min, mm

if TYPE_CHECKING:
    from armdesign.motion.move import Move
    from armdesign.motion.outcome import MoveRun
    from armdesign.motion.shapers import Shaper
    from armdesign.plots.canvas import Axes, Figure

COLOURS = (INK, MARK, COMPUTED, CYLINDER)
THICK: Style = {"lw": 1.6}
FAINT: Style = {"lw": 1.0, "alpha": 0.45}
TOLERATED = 5.0  # [%] of a step's vibration, by which widths of shapers are compared
NEAR = 2.5  # times the lowest frequency, up to which shapers are compared
LEAST = 1e-4  # of the largest line that a spectrum shows, or
SHOWN = 0.05  # of the smaller peak, where that is less


@literal
def move_figure(move: Move) -> Figure:
    """Figure of a move: shaped in full colour, unshaped faint."""
    fig, axes = figure(2, 7.6, 3.4, rows=3)
    _commands(axes[0], move)
    _flow(axes[1], move)
    _pressures(axes[2], move)
    _path(axes[3], move)
    _left(axes[4], move)
    _spectrum(axes[5], move)
    for ax in axes:
        ax.grid(alpha=0.3)
        if ax.get_legend_handles_labels()[0]:
            ax.legend(
                fontsize="small", frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.02)
            )
    name = title_of(move.machine)
    fig.suptitle(f"{name}, payload {move.machine.payload.name}: {move.shaper.words}")
    return fig


@literal
def shaper_figure(move: Move) -> Figure:
    """Figure of what a move's shaper leaves at other frequencies, beside the usual ones."""
    lowest = float(move.frequencies[0])
    far = max(move.shaper.high, lowest)
    fig, axes = figure(2 if far > NEAR * lowest else 1, 7.2, 5.6)
    sensitivity_curves(move.shapers, axes[0], NEAR * lowest)
    for ax in axes[1:]:
        sensitivity_curves([move.shaper], ax, 1.5 * far)
    for ax in axes:
        top = ax.get_xlim()[1]
        for k, frequency in enumerate(move.frequencies[move.frequencies < top].tolist()):
            label = "natural, at the end of the move" if k == 0 else None
            ax.axvline(frequency, color=INK, ls=":", lw=1.0, label=label)
        legend_below(ax, fontsize="small")
    return fig


@literal
def sensitivity_curves(
    shapers: Sequence[Shaper], ax: Axes | None = None, top: float = 0.0
) -> Axes:
    """Axes with the residual vibration of shapers against frequency, and 5 % to compare them.

    Each at the damping that it is made for, of several modes that of the nearest.

    ``top``: highest frequency [Hz]; 0: 1.5 times the highest that they are made for.
    """
    if ax is None:
        _, (ax,) = figure(1, 7.2, 5.6)
    top = top or 1.5 * max(max(shaper.high for shaper in shapers), 1e-3)
    frequency = np.linspace(0.0, top, 2000)
    for k, shaper in enumerate(shapers):
        width, colour = (2.0 if k == 0 else 1.2), COLOURS[(k + 1) % len(COLOURS)]
        left = 100 * shaper.residual(frequency)
        ratios = {part.damping for part in shaper.parts}
        more = "\ndamping of the nearest mode" if len(ratios) > 1 else ""
        ax.plot(frequency, left, color=colour, lw=width, label=shaper.words + more)
    ax.axhline(TOLERATED, color=INK, lw=0.8, ls="--", label=f"{TOLERATED:g} %")
    ax.set(xlabel="frequency [Hz]", ylabel="residual vibration [% of a step's]")
    ax.set(xlim=(0, top), ylim=(0, 105))
    ax.grid(alpha=0.3)
    legend_below(ax, fontsize="small")
    return ax


def _moving(move: Move) -> list[int]:
    """Actuators whose pistons move."""
    return np.flatnonzero(np.abs(move.plan.speeds).max(axis=0) > 0).tolist()


def _kinds(move: Move) -> str:
    """What moves, in one word."""
    kinds = {move.machine.actuators[i].kind for i in _moving(move)}
    return f"{kinds.pop()}s" if len(kinds) == 1 else "actuators"


def _commands(ax: Axes, move: Move) -> None:
    names, colours = list(move.commands), actuator_colours(move.machine)
    for i in _moving(move):
        colour, pair = colours[names[i]], (move.commands, move.unshaped_commands)
        for commands, style in zip(pair, (THICK, FAINT), strict=True):
            table = commands[names[i]]
            label = names[i] if commands is move.commands else f"{names[i]}, unshaped"
            percent = 100 * np.array(table.values)
            ax.plot(table.times, percent, color=colour, label=label, **style)
    ax.set(xlabel="time [s]", ylabel="spool command [%]", title="Commands")


def _flow(ax: Axes, move: Move) -> None:
    moving = _moving(move)
    for run, style in ((move.shaped, THICK), (move.unshaped, FAINT)):
        flows = run.simulation.flows[:, moving]
        taken = np.maximum(flows, 0.0).sum(axis=(1, 2)) / l_per_min
        label = "shaped, simulated" if run.shaped else "unshaped, simulated"
        ax.plot(run.simulation.time, taken, color=INK, label=label, **style)
    planned = move.lead + move.planned.time, move.plan.flow / l_per_min
    ax.plot(*planned, color=COMPUTED, ls="--", lw=1.2, label="planned")
    pump = move.machine.supply.flow / l_per_min
    ax.axhline(pump, color=MARK, lw=1.0, label=f"pump, {pump:.0f} l/min")
    ax.set(xlabel="time [s]", ylabel="flow [l/min]", title=f"Flow into moving {_kinds(move)}")


def _pressures(ax: Axes, move: Move) -> None:
    supply, relief = move.machine.supply, 0.0
    colours = actuator_colours(move.machine)
    for i in _moving(move):
        actuator = move.machine.actuators[i]
        relief = max(relief, actuator.relief(supply) / bar)
        for side, line in ((0, "-"), (1, "--")):
            label = actuator.chamber(side)
            for run, style in ((move.shaped, {"lw": 1.4, "label": label}), (move.unshaped, FAINT)):
                values = run.simulation.pressures[:, i, side] / bar
                colour = colours[actuator.name]
                ax.plot(run.simulation.time, values, color=colour, ls=line, **style)
    tank = supply.return_pressure / bar
    for level, words, line in ((relief, "relief", "-."), (tank, "tank", ":")):
        ax.axhline(level, color=INK, ls=line, lw=1.0, label=f"{words}, {level:.0f} bar")
    ax.set(xlabel="time [s]", ylabel="pressure [bar]", title=f"Pressures of moving {_kinds(move)}")


def _path(ax: Axes, move: Move) -> None:
    machine = move.machine
    at = np.array(machine.tool.at)
    planned = machine.arm.point(machine.rigid_poses(move.planned.q), machine.tool.link, at)
    unshaped, shaped = move.unshaped.simulation, move.shaped.simulation
    paths: tuple[tuple[Array, Array, Style], ...] = (
        (unshaped.q, unshaped.tool, {"color": INK, "label": "unshaped", **FAINT}),
        (shaped.q, shaped.tool, {"color": INK, "label": "shaped", **THICK}),
        (move.planned.q, planned, {"color": COMPUTED, "ls": "--", "lw": 1.2, "label": "planned"}),
    )
    for q, tool, style in paths:
        reach = machine.heading.reach(q, tool)
        ax.plot(reach, tool[:, 2], **style)
    ax.plot(reach[-1], planned[-1, 2], "o", color=MARK, label="planned end")
    ax.set(xlabel="reach [m]", ylabel="height [m]", title="Path of the tool", aspect="equal")
    ax.set_adjustable("datalim")


def _left(ax: Axes, move: Move) -> None:
    for run, style in ((move.shaped, THICK), (move.unshaped, FAINT)):
        residual_oscillation(run, ax, **style)


@literal
def residual_oscillation(run: MoveRun, ax: Axes | None = None, **style: Any) -> Axes:
    """Axes with the tool's oscillation after a move, along its largest swing."""
    ax = figure()[1][0] if ax is None else ax
    _, _, axes = np.linalg.svd(run.deviation, full_matrices=False)
    label = f"{'shaped' if run.shaped else 'unshaped'}, {run.residual / mm:.3g} mm"
    ax.plot(run.time, run.deviation @ axes[0] / mm, color=INK, label=label, **style)
    ax.set(xlabel="time [s]", ylabel="tool about its drift [mm]", title="Residual oscillation")
    ax.legend(frameon=False)
    ax.grid(alpha=0.3)
    return ax


def _spectrum(ax: Axes, move: Move) -> None:
    runs: tuple[tuple[MoveRun, dict[str, float]], ...]
    runs = ((move.shaped, THICK), (move.unshaped, FAINT))
    peaks = [float(run.spectrum[1].max()) / mm for run, _ in runs]
    for run, style in runs:
        frequency, size = run.spectrum
        label = "shaped" if run.shaped else "unshaped"
        ax.semilogy(frequency, size / mm, color=INK, label=label, **style)
    top = min(1.5 * float(move.frequencies.max()), 8 * float(move.frequencies[0]))
    for k, natural in enumerate(move.frequencies[move.frequencies < top].tolist()):
        label = "natural, linear" if k == 0 else ""
        ax.axvline(natural, color=COMPUTED, ls=":", label=label)
    least = min(LEAST * max(peaks), SHOWN * min(peaks))
    ax.set(xlim=(0, top), ylim=(max(least, 1e-9), 2 * max(peaks)))
    ax.set(xlabel="frequency [Hz]", ylabel="amplitude [mm]", title="Spectrum of what is left")
