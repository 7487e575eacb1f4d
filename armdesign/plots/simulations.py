"""Simulations: joints, spools, pressures and the path of the tool over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from armdesign.drawing.colours import actuator_colours
from armdesign.plots.canvas import INK, MARK, figure, literal, title_of
from armdesign.units import bar

if TYPE_CHECKING:
    from armdesign.plots.canvas import Axes, Figure
    from armdesign.simulation.run import Simulation


@literal
def simulation_figure(simulation: Simulation) -> Figure:
    """Figure of a run: positions of the joints, spools, pressures, and where the tool goes."""
    fig, axes = figure(2, 7.6, 3.6, rows=2)
    _joints(axes[0], simulation)
    _spools(axes[1], simulation)
    _pressures(axes[2], simulation)
    _path(axes[3], simulation)
    for ax in axes:
        ax.grid(alpha=0.3)
    for ax in axes[:3]:
        ax.set(xlabel="time [s]")
        ax.legend(loc="upper left", bbox_to_anchor=(1.0, 1.02))
    machine = simulation.machine
    fig.suptitle(f"{title_of(machine)}, payload {machine.payload.name}")
    return fig


def _joints(ax: Axes, simulation: Simulation) -> None:
    """Positions of the joints away from those at the start."""
    for k, joint in enumerate(simulation.machine.arm.joints):
        unit, factor = joint.file_unit
        moved = (simulation.q[:, k] - simulation.q[0, k]) / factor
        ax.plot(simulation.time, moved, color=INK, ls=("-", "--", "-.", ":")[k % 4],
                label=f"{joint.name} [{unit}]")  # fmt: skip
    ax.set(ylabel="joints, from the start")


def _spools(ax: Axes, simulation: Simulation) -> None:
    colours = actuator_colours(simulation.machine)
    for k, name in enumerate(simulation.cylinders):
        ax.plot(simulation.time, 100 * simulation.spool[:, k], color=colours[name], label=name)
        command = 100 * simulation.command[:, k]
        ax.plot(simulation.time, command, color=colours[name], ls=":", lw=1.0)
    ax.set(ylabel="spool, dotted: command [%]")


def _pressures(ax: Axes, simulation: Simulation) -> None:
    colours = actuator_colours(simulation.machine)
    for k, actuator in enumerate(simulation.machine.actuators):
        for side, style in enumerate(("-", "--")):
            p, colour = simulation.pressures[:, k, side] / bar, colours[actuator.name]
            label = actuator.chamber(side)
            ax.plot(simulation.time, p, color=colour, ls=style, lw=1.4, label=label)
    supply = simulation.machine.supply
    for level, words in ((supply.pressure, "supply"), (supply.return_pressure, "return")):
        ax.axhline(level / bar, color=MARK, lw=0.9, ls=":", label=words)
    ax.set(ylabel="pressure [bar]")


def _path(ax: Axes, simulation: Simulation) -> None:
    reach = simulation.machine.heading.reach(simulation.q, simulation.tool)
    height = simulation.tool[:, 2]
    ax.plot(reach, height, color=INK)
    ax.plot(reach[:1], height[:1], "o", color=INK, ms=5)
    ax.annotate("start", (float(reach[0]), float(height[0])), xytext=(6, 6),
                textcoords="offset points")  # fmt: skip
    ax.set(xlabel="reach of the tool [m]", ylabel="height [m]")
    if max(np.ptp(reach), np.ptp(height)) > 0:
        ax.set_aspect("equal", adjustable="datalim")
