"""Labels beside a drawing: two columns, left and right of it, each with a line to its point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations
from typing import TYPE_CHECKING

import numpy as np

from armdesign.arrays import Array
from armdesign.machine.file.polygons import cross
from armdesign.plots.canvas import INK, Style, line_width

if TYPE_CHECKING:
    from armdesign.plots.canvas import Axes

EDGE = 0.012  # of the axes' width, between its side and a column
ASIDE = 0.8  # [pt] of each line of a label: the white of neither covers the other
LABEL_ROOM = 0.34  # of a drawing's width, the least on either side of it
APART, CLOSEST = 0.33, 0.31  # [in] from label to label, where there is room, and at least
BOLD = 1.12  # width of bold letters over that of others
LETTER, SPARE = 0.056, 0.25  # [in] of a line's letters, and of what a column needs besides
BELOW, ABOVE = 0.15, 0.2  # [in] of the axes below and above all labels


@dataclass(frozen=True, eq=False, kw_only=True)
class Label:
    """Two lines of words for a point.

    Attributes:
        at: the point (2,); one that is NaN gets no label.
        head: first line, in the colour.
        below: second line.
        colour: of the first line and the leader.
    """

    at: Array
    head: str
    below: str
    colour: str


def room_for(labels: Sequence[Label], limits: Array, width: float) -> tuple[float, Array]:
    """Room that labels need beside a drawing, as share of its width; its limits, with room above.

    Args:
        labels: in two columns.
        limits: of the drawing, lower left and upper right (2, 2).
        width: of its axes [in].
    """
    letters = max((len(one.below) for one in labels), default=0)
    column = min(LETTER * letters + SPARE, width / 3)
    share = max(LABEL_ROOM, column / (width - 2 * column))
    (left, low), (right, high) = limits
    lines = CLOSEST * ((len(labels) - 1) // 2) + BELOW + ABOVE
    tall = lines / width * (1 + 2 * share) * (right - left)
    return share, np.array([[left, low], [right, max(high, low + tall)]])


def place_labels(ax: Axes, labels: Sequence[Label], width: float) -> None:
    """Write labels in two columns, each near the height of its point, lines that do not cross.

    The half of the points further left goes to the left. ``width`` [in] is what the axes have
    when they are drawn.
    """
    shown = sorted((one for one in labels if np.isfinite(one.at).all()), key=lambda one: one.at[0])
    half = (len(shown) + 1) // 2
    for side, column in (("left", shown[:half]), ("right", shown[half:])):
        column = sorted(column, key=lambda one: -one.at[1])
        rows = _rows(ax, column)
        order = _order(_line_begins(column, side, width), rows, _shares(ax, column))
        for label, height in zip(order, rows, strict=True):
            _write(ax, column[label], side, float(height))


def _rows(ax: Axes, column: Sequence[Label]) -> Array:
    """Heights of labels in a column, from its top, each as near to its point as room allows."""
    low, high = ax.get_ylim()
    left, right = ax.get_xlim()
    box = ax.get_window_extent()
    height = min(box.height, box.width * (high - low) / (right - left)) / ax.figure.dpi
    begin, end = BELOW / height, max(1 - ABOVE / height, BELOW / height)
    apart = min(APART / height, (end - begin) / max(len(column) - 1, 1))
    return spread(_shares(ax, column)[:, 1], apart, begin, end)


def spread(rows: Array, apart: float, begin: float, end: float) -> Array:
    """Heights (n,), falling, pushed so far that neighbours are ``apart``, between two ends."""
    rows = rows.copy()
    for _ in range(200):  # neighbours push each other apart
        rows = np.clip(rows, begin, end)
        gaps = rows[:-1] - rows[1:] - apart
        if len(gaps) == 0 or gaps.min() > -1e-4:
            break
        push = np.where(gaps < 0, -gaps / 2 + 1e-5, 0.0)
        rows[:-1] += push
        rows[1:] -= push
    return np.asarray(rows)


def _shares(ax: Axes, column: Sequence[Label]) -> Array:
    """Places of the points (n, 2), as shares of the axes' width and height."""
    (left, right), (low, high) = ax.get_xlim(), ax.get_ylim()
    at = np.array([one.at for one in column]).reshape(-1, 2)
    return np.asarray((at - [left, low]) / [right - left, high - low])


def _line_begins(column: Sequence[Label], side: str, width: float) -> Array:
    """Where the words of each label end and its line begins (n,), as share of the axes' width."""
    wide = [max(BOLD * line_width(one.head, 8), line_width(one.below, 7)) for one in column]
    words = EDGE + np.array(wide) / width
    return np.asarray(words if side == "left" else 1 - words)


def _order(begins: Array, rows: Array, points: Array) -> list[int]:
    """Which label (n,) stands in each row: lines cross least, and are then least steep.

    A label moves to another row, and those between make room, as long as that is better.

    Args:
        begins: where the line of each label begins, across (n,).
        rows: heights (n,).
        points: the labels' points (n, 2).
    """
    order = list(range(len(rows)))

    def cost(order: list[int]) -> tuple[int, float]:
        starts, ends = np.stack([begins[order], rows], axis=1), points[order]
        return _crossings(starts, ends), float(np.square(ends - starts)[:, 1].sum())

    best, improved = cost(order), True
    while improved:
        improved = False
        for one, other in permutations(range(len(rows)), 2):
            tried = order.copy()
            tried.insert(other, tried.pop(one))
            if (now := cost(tried)) < best:
                order, best, improved = tried, now, True
    return order


def _crossings(starts: Array, ends: Array) -> int:
    """Number of pairs among lines (n, 2) → (n, 2) that cross."""
    return int(cross(starts[:, None], ends[:, None], starts, ends).sum()) // 2


def _write(ax: Axes, label: Label, side: str, height: float) -> None:
    x = EDGE if side == "left" else 1 - EDGE
    text: Style = {"xycoords": ax.transAxes, "ha": side, "zorder": 10, "annotation_clip": False}
    text["parse_math"] = False
    text["textcoords"] = "offset points"
    text["bbox"] = {"fc": "white", "ec": "none", "pad": 0.4, "alpha": 0.8}  # lines end there
    place = x, height
    bold: Style = {"fontsize": 8, "fontweight": "bold", "color": label.colour, "va": "bottom"}
    head = ax.annotate(label.head, place, (0, ASIDE), **text, **bold)
    below = ax.annotate(label.below, place, (0, -ASIDE), va="top", color=INK, fontsize=7, **text)
    wide = [one.get_window_extent().width for one in (head, below)]
    longer, edge = (head, 0.0) if wide[0] >= wide[1] else (below, 1.0)
    inner = (1.0 if side == "left" else 0.0, edge)
    leader = {"arrowstyle": "-", "color": label.colour, "lw": 0.6, "shrinkA": 3, "shrinkB": 3}
    way: Style = {"textcoords": longer, "arrowprops": leader, "annotation_clip": False}
    ax.annotate("", tuple(label.at), inner, **way, zorder=6)
