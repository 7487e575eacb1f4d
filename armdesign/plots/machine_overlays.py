"""Two machines drawn over each other: the old one dashed, moved pins as arrows with their way."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from armdesign.drawing.colours import actuator_colours
from armdesign.drawing.joint_arcs import middle_pose, refuse_other_joints
from armdesign.drawing.moved_pins import PinMove, changed_bars, moved_pins
from armdesign.drawing.side_view import SideView, side_view
from armdesign.plots.canvas import INK, MARK, Style, literal
from armdesign.plots.labels import Label, place_labels, room_for
from armdesign.plots.machine_words import faults, number, pose_words, sizes_legend
from armdesign.plots.machines import (
    axes_width,
    draw_machine,
    extent,
    frame,
    head,
    heading,
    new_axes,
    without_white,
)
from armdesign.units import mm

if TYPE_CHECKING:
    from armdesign.machine.machine import Machine
    from armdesign.plots.canvas import Axes

SEEN = 0.06  # of the drawn size: how long an arrow may be made
GHOST: Style = {"fc": "none", "ec": "#6b7280", "lw": 0.8, "ls": (0, (4, 2))}


@without_white
@literal
def machine_overlay(
    old: Machine,
    new: Machine,
    q: ArrayLike | None = None,
    labels: tuple[str, str] = ("today", "new"),
) -> Axes:
    """Two machines over each other in one pose, moved pins as arrows with their way in mm.

    The old one is dashed. Machines with other joints cannot take one pose and are refused.

    Args:
        old: today's machine.
        new: the other one.
        q: one pose (nq,) [rad, m]; the middle of the old one's joint ranges if None.
        labels: what the two are called.

    Returns:
        The axes.
    """
    refuse_other_joints(old, new)
    pose = middle_pose(old) if q is None else q
    before, after = side_view(old, pose), side_view(new, pose)
    limits = extent([before, after])
    bars = [
        f"{one.name} {one.length / mm:.1f} → {other.length / mm:.1f} mm"
        for one, other in changed_bars(before, after)
    ]
    said = [*bars, *faults(after)]
    moves, colours = moved_pins(before, after), actuator_colours(new)
    labels_of_moves = [_move_label(move, colours) for move in moves]
    room, limits = room_for(labels_of_moves, limits, axes_width())
    times = _magnification(moves, after.size)
    long = "" if times == 1 else f", drawn {times} times as long"
    words = f"solid: {labels[1]}, dashed: {labels[0]}"
    words += f"; arrows: moved pins{long}" if moves else "; no pin moved"
    if moves and not _at_one_place(before, after):
        words += "; frames of the links move, too, and numbers are in these frames"
    below = [words, pose_words(new, after), *said]
    ax = new_axes(limits, len(heading(new, below)), room)[0]
    draw_machine(ax, new, after)
    _ghost(ax, before, _alike(before, after))
    frame(ax, limits, after, room)
    for move in moves:
        end = move.before[0] + times * (move.after[0] - move.before[0])
        arrow = {"arrowstyle": "-|>", "color": MARK, "lw": 1.5, "shrinkA": 0, "shrinkB": 0}
        arrow |= {"mutation_scale": 7}
        ax.annotate("", end, move.before[0], arrowprops=arrow, zorder=9)
    place_labels(ax, labels_of_moves, axes_width())
    head(ax, new, below)
    sizes_legend(ax, [old, new])
    return ax


def _magnification(moves: Sequence[PinMove], size: float) -> int:
    """Times that arrows are longer than the ways, so that the longest one is seen."""
    longest = max((move.distance for move in moves), default=size)
    return next((n for n in (10, 5, 2) if n * longest <= SEEN * size), 1)


def _alike(one: SideView, other: SideView) -> bool:
    """Whether two views have the same bodies at the same places."""
    pairs = list(zip(one.polygons(), other.polygons(), strict=False))
    flat = [(a, b) for first, second in pairs for a, b in zip(first, second, strict=False)]
    return all(a.shape == b.shape and np.allclose(a, b, atol=1e-6) for a, b in flat)


def _at_one_place(one: SideView, other: SideView) -> bool:
    """Whether the frames of the links of two views are at the same places."""
    pair = one.placements, other.placements
    return pair[0].shape == pair[1].shape and np.allclose(*pair, atol=1e-6)


def _ghost(ax: Axes, view: SideView, same: bool) -> None:
    """Outlines of a machine that another one is drawn over; without bodies that are the same."""
    for corners in [] if same else [corners for body in view.polygons() for corners in body]:
        ax.fill(*corners.T, **GHOST, zorder=3)
    for pair in view.barrel_and_rod():
        for corners in pair:
            ax.fill(*corners.T, **{**GHOST, "ec": INK}, zorder=6)
    for bar in view.bars:
        ax.plot(*view.points[0, list(bar.ends)].T, color=INK, lw=0.9, ls=(0, (4, 2)), zorder=6)
    ax.plot(*view.points[0].T, "o", ms=4, mfc="none", mec=INK, mew=0.8, ls="", zorder=6)


def _move_label(move: PinMove, colours: Mapping[str, str]) -> Label:
    x, y, z = move.by / mm
    way = f"x {x:+.1f}, z {z:+.1f}" + (f", y {y:+.1f}" if abs(y) > 0.05 else "")
    return Label(
        at=move.after[0],
        head=f"{move.name}: {move.distance / mm:.0f} mm",
        below=f"{number(way)} mm in {move.link}",
        colour=colours[move.name.rpartition(".")[0]],
    )
