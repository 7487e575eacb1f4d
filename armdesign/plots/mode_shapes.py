"""Mode shapes: the lowest modes of a pose as displaced outlines, and their swing at the tool."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from armdesign.arrays import Array
from armdesign.drawing.joint_arcs import middle_pose
from armdesign.drawing.side_view import SideView, side_view
from armdesign.drawing.swing import Swing, Swings
from armdesign.frequency.modes import energy_shares, natural_modes
from armdesign.machine.poses import joint_positions
from armdesign.plots.canvas import (
    COMPUTED,
    INK,
    MARK,
    WIDTH,
    Style,
    figure,
    literal,
    title_of,
    wrapped,
)
from armdesign.plots.machine_words import pose_words
from armdesign.plots.machines import draw_machine, extent, frame
from armdesign.units import mm

if TYPE_CHECKING:
    from armdesign.machine.machine import Machine
    from armdesign.plots.canvas import Axes, Figure

FADED = {"fc": "#f3f4f6", "ec": "#d1d5db"}
ENDS = MARK, COMPUTED  # of a swing
SIZE = "drawn size of the swing: the point that moves furthest goes 5 % of the machine's size"
UNSEEN = 0.5  # share of the tool's way in the picture, below which its words say so
SHOWN = 3  # lowest modes
TALLEST = 7.0  # [in] of axes
HEADING, LINE = 10.0, 0.2  # letters [pt] and height [in] of a line above all modes


@literal
def mode_shapes(machine: Machine, q: ArrayLike | None = None) -> Figure:
    """Figure of the lowest modes of a pose: the machine at rest and at both ends of its swing.

    The load case at work counts. A mode has no amplitude of its own: the point that moves furthest
    is drawn to go a twentieth of the machine's size. How far the tool then goes is written above,
    with the frequency and what limits it.

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
    swings = Swings(machine=machine, bodies=view.bodies, size=view.size)
    low, high = extent([view])
    wide, tall = (high - low).tolist()
    width = WIDTH / count
    heading = wrapped(f"{_title(machine)}\n{pose_words(machine, view)}", WIDTH, HEADING)
    around = 1.3 + LINE * len(heading)  # of one size of the machine, however long its title is
    fig, axes = figure(count, width, min((width - 0.6) * tall / wide * 1.08, TALLEST) + around)
    shown = [swings.of(pose, natural.shapes[:, :, mode]) for mode in range(count)]
    ends = [_ends(ax, machine, view, swing) for ax, swing in zip(axes, shown, strict=True)]
    seen = extent([view, *(end for both in ends for end in both)])
    for mode, (ax, swing) in enumerate(zip(axes, shown, strict=True)):
        frame(ax, seen, view, 0.0)
        words = _words(machine, natural.frequencies[0, mode], shares[mode])
        amplitude = f"± {swing.tool[0] / mm:.0f} mm at the tool{_across(swing, ends[mode])}"
        ax.set_title(f"mode {mode + 1}: {words}\n{amplitude}", fontsize=9, loc="left")
    fig.suptitle("\n".join(heading), fontsize=HEADING)
    stars = [line for line in axes[0].lines if line.get_marker() == "*"]
    names = ["at rest", "one end of the swing", "the other end, half a period later"]
    place: Style = {"loc": "outside lower left", "ncols": 3, "title": SIZE, "alignment": "left"}
    fig.legend(stars, names, title_fontsize=8, **place)
    return fig


def _ends(ax: Axes, machine: Machine, view: SideView, swing: Swing) -> list[SideView]:
    """Machine at rest, and its outlines at both ends of a mode's swing; what they cover."""
    draw_machine(ax, machine, view, 0, marked=False, **FADED)
    ax.plot(*view.tool[0], "*", ms=9, mfc="white", mec=INK, mew=0.8, zorder=8)
    if machine.payload.name in view.loads:
        load: Style = {"ms": 7, "mfc": "none", "mec": INK, "mew": 0.8}
        ax.plot(*view.loads[machine.payload.name][0], "s", **load, zorder=7)
    sides = [view.coordinates + side * swing.steps for side in (1, -1)]
    ends = [side_view(machine, z, known=view) for z in sides]
    for end, colour in zip(ends, ENDS, strict=True):
        cylinders = [corners for both in end.barrel_and_rod() for corners in both]
        for corners in (one for body in end.polygons()[1:] for one in body):
            ax.fill(*corners.T, fc="none", ec=colour, lw=1.1, zorder=8)
        for corners in cylinders:
            ax.fill(*corners.T, fc="none", ec=colour, lw=0.6, zorder=8)
        for bar in end.bars:
            ax.plot(*end.points[0, list(bar.ends)].T, color=colour, lw=1.1, zorder=8)
        ax.plot(*end.tool[0], "*", color=colour, ms=9, zorder=9)
    return ends


def _words(machine: Machine, frequency: float, shares: Array) -> str:
    """Frequency [Hz] of a mode, and what limits it; of one that does not ring, that."""
    if frequency == 0:
        return "unstable on trapped oil"
    most = int(np.argmax(shares))
    return f"{frequency:.3f} Hz, {100 * shares[most]:.0f} % in {machine.yielding[most].name}"


def _across(swing: Swing, ends: list[SideView]) -> str:
    """Words on a swing of the tool that the picture does not show, as that of a slewing joint."""
    shown = float(np.hypot(*(ends[1].tool[0] - ends[0].tool[0]))) / 2
    return ", across the picture" if shown < UNSEEN * swing.tool[0] else ""


def _title(machine: Machine) -> str:
    return f"{title_of(machine)}, load case {machine.payload.name}"
