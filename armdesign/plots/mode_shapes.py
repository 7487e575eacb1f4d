"""Mode shapes: the lowest modes of a pose as displaced outlines, and their swing at the tool."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from armdesign.drawing.joint_arcs import middle_pose
from armdesign.drawing.side_view import SideView, side_view
from armdesign.drawing.swing import round_amplitude, swung
from armdesign.frequency.modes import Modes, energy_shares, natural_modes
from armdesign.machine.poses import joint_positions
from armdesign.plots.canvas import COMPUTED, MARK, WIDTH, figure, literal, title_of
from armdesign.plots.machine_words import pose_words
from armdesign.plots.machines import draw_machine, extent, frame

if TYPE_CHECKING:
    from armdesign.machine.machine import Machine
    from armdesign.plots.canvas import Axes, Figure

FADED = {"fc": "#f3f4f6", "ec": "#d1d5db"}
SHOWN = 3  # lowest modes


@literal
def mode_shapes(machine: Machine, q: ArrayLike | None = None) -> Figure:
    """Figure of the lowest modes of a pose: the machine at rest and at both ends of its swing.

    The load case at work counts. A mode has no amplitude of its own: what is drawn at the tool is
    written above it, with the frequency and what limits it.

    Args:
        machine: the machine with its load case.
        q: one pose (nq,) [rad, m]; the middle of the joint ranges if None.

    Raises:
        PoseError: a pose that the machine cannot take.
    """
    pose = joint_positions(machine, middle_pose(machine) if q is None else q)[:1]
    poses = machine.at(pose)
    natural = natural_modes(poses)
    shares = energy_shares(poses, natural)[0]
    count = min(SHOWN, natural.frequencies.shape[1])
    view = side_view(machine, pose)
    amplitude = round_amplitude(view.size)
    low, high = extent([view])
    wide, tall = high - low
    width = WIDTH / count
    fig, axes = figure(count, width, (width - 0.6) * float(tall / wide) * 1.08 + 1.5)
    for mode, ax in enumerate(axes):
        ends = _swing(ax, machine, view, natural, mode, amplitude)
        frame(ax, extent([view, *ends]), view, 0.0)
        share = int(np.argmax(shares[mode]))
        limiting = f"{100 * shares[mode][share]:.0f} % in {machine.yielding[share].name}"
        words = f"mode {mode + 1}: {natural.frequencies[0, mode]:.3f} Hz, {limiting}"
        ax.set_title(f"{words}\n± {1000 * amplitude:.0f} mm at the tool", fontsize=9, loc="left")
    fig.suptitle(f"{_title(machine)}\n{pose_words(machine, view)}", fontsize=10)
    return fig


def _swing(
    ax: Axes, machine: Machine, view: SideView, natural: Modes, mode: int, amplitude: float
) -> list[SideView]:
    """Machine at rest, and its outlines at both ends of a mode's swing; what they cover."""
    draw_machine(ax, machine, view, 0, **FADED)
    pose, shape = view.coordinates, natural.shapes[:, :, mode]
    ends = [side_view(machine, swung(machine, pose, shape, side * amplitude)) for side in (1, -1)]
    for end, colour in zip(ends, (MARK, COMPUTED), strict=True):
        for body in end.polygons()[1:]:
            for corners in body:
                ax.fill(*corners.T, fc="none", ec=colour, lw=1.1, zorder=8)
        ax.plot(*end.tool[0], "*", color=colour, ms=9, zorder=9)
    return ends


def _title(machine: Machine) -> str:
    return f"{title_of(machine)}, load case {machine.payload.name}"
