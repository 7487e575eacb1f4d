"""Machines drawn to scale from the side, with named pins, joint ranges and the tool's range."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import wraps
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from armdesign.arrays import Array
from armdesign.drawing.colours import SPRING, actuator_colours
from armdesign.drawing.joint_arcs import middle_pose
from armdesign.drawing.side_view import SideView, side_view
from armdesign.drawing.tool_range import tool_range
from armdesign.plots.canvas import (
    COMPUTED,
    INK,
    MARK,
    WIDTH,
    P,
    Style,
    figure,
    literal,
    show_in_notebooks,
    style,
    title_of,
    wrapped,
)
from armdesign.plots.labels import place_labels, room_for
from armdesign.plots.machine_words import (
    IDLE,
    ends,
    faults,
    joint_labels,
    pin_labels,
    pose_words,
    sizes_legend,
)

if TYPE_CHECKING:
    from armdesign.machine.machine import Machine
    from armdesign.plots.canvas import Axes

BODY: Style = {"fc": "#e5e7eb", "ec": "#4b5563", "lw": 0.8}
ROD: Style = {"fc": "#cbd5e1", "ec": "#4b5563", "lw": 0.6}
EARTH = "#8b7355"
LINE = 0.15  # [in] of a line of words
HEADING = 9.0  # [pt] letters of the title and the words below it
BESIDE = 0.22  # of the width: the range of the tool


def without_white(draw: Callable[P, Axes]) -> Callable[P, Axes]:
    """The drawing, whose new figure ends below what it shows: equal scales leave white there."""

    @wraps(draw)
    def drawn(*words: P.args, **named: P.kwargs) -> Axes:
        ax = draw(*words, **named)
        if all(one is not ax for one in (*words, *named.values())):
            from armdesign.plots.layout import PAD

            fig: Any = ax.figure
            with style():
                fig.draw_without_rendering()
                white = fig.get_tightbbox(fig._get_renderer()).y0 - PAD
            width, height = fig.get_size_inches()
            fig.set_size_inches(width, height - max(white, 0.0))
        return ax

    return drawn


@without_white
@literal
def machine_drawing(machine: Machine, q: ArrayLike | None = None, ax: Axes | None = None) -> Axes:
    """Side view of a machine to scale, with its pins' names and coordinates; returns the axes.

    Bodies, cylinders as barrel and rod between their pins, four-bars, loads, ground, the ranges of
    the joints as arcs; beside it, in axes of its own, the range of the tool. A pin outside the
    outline of its link and a cylinder out of its stroke are red, and said in words.

    Args:
        machine: the machine.
        q: one pose (nq,) [rad, m]; the middle of the joint ranges if None.
        ax: axes to draw into; new ones if None.
    """
    view = side_view(machine, middle_pose(machine) if q is None else q)
    wrong = faults(view)
    labels = [*pin_labels(machine, view), *joint_labels(machine, view), *ends(machine, view)]
    width = axes_width(beside=True)
    room, limits = room_for(labels, extent([view]), width)
    if ax is None:
        lines = heading(machine, [pose_words(machine, view), *wrong], beside=True)
        ax, beside = new_axes(limits, len(lines), room, beside=True)
        _tool_range(beside, machine, view)
    draw_machine(ax, machine, view)
    _arcs(ax, view)
    frame(ax, limits, view, room)
    place_labels(ax, labels, width)
    head(ax, machine, [pose_words(machine, view), *wrong])
    sizes_legend(ax, [machine])
    return ax


def draw_machine(
    ax: Axes, machine: Machine, view: SideView, pose: int = 0, marked: bool = True, **style: Any
) -> None:
    """Bodies, bars, cylinders, pins and joints of a side view at a pose.

    Loads and tool are ``marked``, too. ``style``: of the bodies' patches, instead of the usual
    one.
    """
    colours = actuator_colours(machine)
    for body in view.polygons(pose):
        for corners in body:
            ax.fill(*corners.T, **{**BODY, "zorder": 2, **style})
    for bar in view.bars:
        ends = view.points[pose, list(bar.ends)]
        for width, colour in ((5.0, "#4b5563"), (3.4, "#9aa3af")):
            ax.plot(*ends.T, color=colour, lw=width, solid_capstyle="round", zorder=4)
    wrong = view.out_of_stroke[pose]
    for shape, pair, faulty in zip(view.cylinders, view.barrel_and_rod(pose), wrong, strict=True):
        if np.isfinite(pair).all():
            edge: Style = {"ec": MARK, "lw": 1.8} if faulty else {"ec": INK, "lw": 0.7}
            paint = IDLE if shape.idle else colours[shape.name]
            ax.fill(*pair[1].T, **{**ROD, **edge}, zorder=5)
            ax.fill(*pair[0].T, fc=paint, **edge, zorder=5)
    for name, joint in view.motors.items():
        ring: Style = {"ms": 15, "mfc": "none", "mew": 3.5, "mec": colours[name]}
        ax.plot(*view.pivots[pose, joint], "o", zorder=6, **ring)
    _points(ax, view, pose)
    if marked:
        _marks(ax, view, pose)


def _points(ax: Axes, view: SideView, pose: int) -> None:
    for pin, at in zip(view.pins, view.points[pose], strict=True):
        ax.plot(*at, "o", ms=4.5, mfc="white", mec=INK, mew=1.0, zorder=7)
        if pin.name in view.stray_pins:
            ax.plot(*at, "o", ms=15, mfc="none", mec=MARK, mew=2.2, zorder=8)
    joints = view.pivots[pose]
    hinges = joints[: len(joints) - view.springs][view.turning[: len(joints) - view.springs]]
    ax.plot(*hinges.T, "o", ms=6, mfc=INK, mec="white", mew=0.8, ls="", zorder=7)
    springs = joints[len(joints) - view.springs :]
    ax.plot(*springs.T, "D", ms=7, mfc=SPRING, mec="white", ls="", zorder=7)


def _marks(ax: Axes, view: SideView, pose: int) -> None:
    """Loads and tool."""
    for places in view.loads.values():
        ax.plot(*places[pose], "s", ms=8, mfc="#fde68a", mec=INK, alpha=0.9, zorder=6)
    ax.plot(*view.tool[pose], "*", ms=11, mfc=MARK, mec="white", mew=0.7, zorder=8)


def _arcs(ax: Axes, view: SideView) -> None:
    """Ranges of the joints: arcs between their ends, and where the joint stands."""
    for arc, line in zip(view.arcs, view.arc_lines(), strict=True):
        index = view.joints.index(arc.joint)
        ax.plot(*line.T, color=INK, lw=1.1, zorder=3)
        share = (view.coordinates[0, index] - arc.lower) / max(arc.upper - arc.lower, 1e-12)
        for at, marker in ((line[0], "|"), (line[-1], "|"), (_between(line, share), "o")):
            ax.plot(*at, marker, ms=4 if marker == "o" else 0, color=INK, zorder=3)
        if arc.revolute:
            for end in (line[0], line[-1]):
                ends = np.array([view.pivots[0, index], end])
                ax.plot(*ends.T, color=INK, lw=0.5, ls=":", zorder=3)


def _between(line: Array, share: float) -> Array:
    """Place (2,) on a line of even steps, by its share of the way."""
    at = float(np.clip(share, 0, 1)) * (len(line) - 1)
    return np.array([np.interp(at, np.arange(len(line)), column) for column in line.T])


# ------------------------------------------------------------------------------- axes and words


def extent(views: Sequence[SideView]) -> Array:
    """Corners (2, 2) [m], lower left and upper right, of all that is drawn."""
    drawn = [corners for view in views for body in view.polygons() for corners in body]
    drawn += [line for view in views for line in view.arc_lines()]
    points = [part for view in views for part in (view.points[0], view.tool[:1])]
    every = np.concatenate([*drawn, *points])
    grounds = [view.ground for view in views]
    low, high = np.nanmin(every, axis=0), np.nanmax(every, axis=0)
    low[1] = min(low[1], *grounds)
    margin = 0.03 * float(np.max(high - low))
    return np.array([low - margin, high + margin])


def axes_width(beside: bool = False) -> float:
    """Width [in] of the axes of a drawing, without or with others beside them."""
    return WIDTH * (1 - BESIDE if beside else 1) - 0.6


def new_axes(limits: Array, lines: int, room: float, beside: bool = False) -> list[Any]:
    """New axes as high as the drawing needs beside its labels; with others beside them.

    ``lines`` of words stand above the drawing, ``room`` is as in ``frame``.
    """
    wide, high = limits[1] - limits[0]
    height = float(np.clip(axes_width(beside) * high / (wide * (1 + 2 * room)), 2.4, 8.0))
    height += 1.0 + LINE * lines
    if not beside:
        return list(figure(1, WIDTH, height)[1])
    fig, _ = figure(1, WIDTH, height)
    fig.clf()
    axes = list(fig.subplots(1, 2, width_ratios=[1 - BESIDE, BESIDE]))
    show_in_notebooks(fig, axes)
    return axes


def frame(ax: Axes, limits: Array, view: SideView, room: float) -> None:
    """Limits, equal scales and ground; ``room`` for labels on either side, over the width."""
    (left, low), (right, high) = limits
    space = room * (right - left)
    left, right = left - space, right + space
    ax.set(xlim=(left, right), ylim=(low, high), xlabel="reach [m]", ylabel="height [m]")
    ax.set(aspect="equal", anchor="NW")
    ax.locator_params(steps=[1, 2, 5, 10])  # 0.25 is wider than there is room for
    _earth(ax, view)


def _earth(ax: Axes, view: SideView) -> None:
    """The ground, and a faint grid."""
    low, high = ax.get_ylim()
    deep = view.ground - 0.025 * (high - low)
    ax.axhline(view.ground, color=EARTH, lw=1.4, zorder=1)
    ax.axhspan(deep, view.ground, fc="none", ec=EARTH, alpha=0.5, hatch="////", lw=0, zorder=1)
    ax.set_ylim(low, high)
    ax.grid(alpha=0.15)


def _tool_range(ax: Axes, machine: Machine, view: SideView) -> None:
    """The range of the tool about the machine."""
    lines = tool_range(machine)
    for line in lines:
        ax.plot(*line.T, color=COMPUTED, lw=1.2, zorder=3)
        if np.array_equal(line[0], line[-1]) and len(line) > 2:
            ax.fill(*line.T, fc="#e0ecf8", ec="none", zorder=0)
    for body in view.polygons():
        for corners in body:
            ax.fill(*corners.T, **{**BODY, "lw": 0.5}, zorder=2)
    ax.plot(*view.tool[0], "*", ms=8, mfc=MARK, mec="white", mew=0.6, zorder=4)
    ax.set(xlabel="reach [m]", aspect="equal", anchor="N")
    ax.set_title("range of the tool", fontsize=9, loc="left")
    ax.tick_params(labelsize=8)
    _earth(ax, view)


def heading(machine: Machine, words: Sequence[str], beside: bool = False) -> list[str]:
    """Lines of the title and the words below it, on new axes alone or with others beside them."""
    share = 1 - BESIDE if beside else 1
    return wrapped("\n".join([title_of(machine), *words]), share * WIDTH, HEADING)


def head(ax: Axes, machine: Machine, words: Sequence[str]) -> None:
    """Title, and lines of words below it."""
    ax.set_title("\n".join([title_of(machine), *words]), fontsize=HEADING, loc="left")
