"""Places of axes in a figure: as large as what stands around them permits.

Measured are ticks, labels, titles, colour bars and legends, not what is drawn; the axes of a
column have one width, those of a row one height, in the proportions of their grid. Matplotlib's
own layout measures all that is drawn, twice, and takes longer than drawing it. Here one pass is
enough where the axes become about as large as they were taken to be at first.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.layout_engine import LayoutEngine
from matplotlib.transforms import Bbox

from armdesign.arrays import Array

if TYPE_CHECKING:
    from armdesign.plots.canvas import Axes, Figure

PAD = 0.042  # [in] around each of the axes with what stands around them
PASSES = 4  # at most
ALIKE = 0.05  # change of size that hardly changes ticks


class Places(LayoutEngine):
    """Layout of figures whose axes are in one grid; titles of the figure above, legends below."""

    _adjust_compatible = False
    _colorbar_gridspec = False

    def execute(self, fig: Any) -> None:
        """Place all axes; measured anew where their size changes, and with it perhaps ticks."""
        axes = [ax for ax in fig.axes if ax.get_visible() and ax.get_subplotspec() is not None]
        if not axes:
            return
        renderer = fig._get_renderer()
        outside = _title_and_legends(fig, renderer)
        rooms = np.array([_usual_room(ax) for ax in axes])
        sizes, ticks = np.zeros((len(axes), 2)), list[int]()
        for _ in range(PASSES):
            _place(fig, axes, rooms, outside)
            for ax in axes:
                ax.apply_aspect()
            before, sizes = sizes, np.array([ax.get_window_extent(renderer).size for ax in axes])
            earlier, ticks = ticks, [len(axis.get_majorticklocs()) for axis in _axles(axes)]
            if ticks == earlier and np.all(np.abs(sizes - before) < ALIKE * sizes):
                break
            rooms = np.array([_room(ax, renderer) for ax in axes]) / fig.dpi


def _axles(axes: Sequence[Any]) -> Iterator[Any]:
    """The axes along and up."""
    for ax in axes:
        yield from (ax.xaxis, ax.yaxis)


def _place(fig: Figure, axes: Sequence[Any], rooms: Array, outside: tuple[float, float]) -> None:
    """Place axes with rooms (n, 4) about them [in], left, right, below and above."""
    (width, height), (above, below) = fig.get_size_inches(), outside
    specs: list[Any] = [ax.get_subplotspec() for ax in axes]
    grid, padded = specs[0].get_gridspec(), rooms + PAD
    columns, rows = ([getattr(s, span) for s in specs] for span in ("colspan", "rowspan"))
    across = _ends(columns, padded[:, :2], grid.get_width_ratios(), width)
    down = _ends(rows, padded[:, :1:-1], grid.get_height_ratios(), height - above - below)
    for ax, (left, right), (top, bottom) in zip(axes, across, down + above, strict=True):
        corners = np.array([[left, height - bottom], [right, height - top]])
        ax._set_position(Bbox(corners / (width, height)), which="original")


def _usual_room(ax: Axes) -> tuple[float, float, float, float]:
    """Room [in] about axes, left, right, below and above, before it is measured."""
    bars = any(child.get_visible() for child in ax.child_axes)
    lines = max(
        title.get_text().count("\n") + 1 if title.get_text() else 0 for title in _titles(ax)
    )
    left, below = (0.18 * bool(label) for label in (ax.get_ylabel(), ax.get_xlabel()))
    return 0.34 + left, 0.9 if bars else 0.02, 0.21 + below, 0.03 + 0.16 * lines


def _titles(ax: Any) -> tuple[Any, ...]:
    return ax.title, ax._left_title, ax._right_title


def _room(ax: Axes, renderer: Any) -> tuple[float, float, float, float]:
    """Room beside axes, left, right, below and above [px], that what stands around them takes."""
    for child in ax.child_axes:
        locator: Any = child.get_axes_locator()
        child.apply_aspect(locator(child, renderer) if locator else None)
    box = ax.get_window_extent(renderer)
    around = Bbox.union([box, *_around(ax, renderer)])
    titles = (text.get_window_extent(renderer).y1 for text in _titles(ax) if text.get_text())
    top = max([around.y1, *titles])
    return box.x0 - around.x0, around.x1 - box.x1, box.y0 - around.y0, top - box.y1


def _around(ax: Axes, renderer: Any) -> Iterator[Bbox]:
    """Boxes of ticks with their labels, of colour bars and of a legend."""
    for part in (ax, *(child for child in ax.child_axes if child.get_visible())):
        for axis in (part.xaxis, part.yaxis) if part.axison else ():
            if axis.get_visible():
                yield _with_label(axis, part.get_window_extent(renderer), renderer)
    if (legend := ax.get_legend()) is not None:
        yield legend.get_window_extent(renderer)


def _with_label(axis: Any, box: Bbox, renderer: Any) -> Bbox:
    """Box of axes, of the numbers along one axis, and of its label beyond them."""
    numbers = axis._get_ticklabel_bboxes(axis._update_ticks(), renderer)
    if axis.major.formatter.get_offset():  # a power of ten stands beside it
        return Bbox.union([box, axis.get_tightbbox(renderer, for_layout_only=True)])
    box = Bbox.union([box, *numbers[0], *numbers[1]])
    if not axis.label.get_text():
        return box
    across = int(axis.axis_name == "x")
    size = axis.label.get_window_extent(renderer).size[across]
    away, corners = renderer.points_to_pixels(axis.labelpad) + size, box.get_points().copy()
    beyond = axis.get_label_position() in ("right", "top")
    corners[int(beyond), across] += away if beyond else -away
    return Bbox(corners)


def _title_and_legends(fig: Any, renderer: Any) -> tuple[float, float]:
    """Height [in] above all axes for the figure's title, which is put there, and below them."""
    above = below = 0.0
    if (title := fig._suptitle) is not None:
        title.set_y(1 - PAD / fig.get_size_inches()[1])
        above = title.get_window_extent(renderer).height / fig.dpi + 2 * PAD
    for legend in fig.legends:
        below = max(below, legend.get_window_extent(renderer).height / fig.dpi + 2 * PAD)
    return above, below


def _ends(spans: Sequence[range], rooms: Array, ratios: Sequence[float], size: float) -> Array:
    """Begin and end (n, 2) [in] of axes in one direction.

    Args:
        spans: columns or rows of the grid that each of the axes fill.
        rooms: before and after them (n, 2) [in].
        ratios: of the columns' or rows' sizes.
        size: of the figure [in].
    """
    room = np.zeros((len(ratios), 2))
    for span, (before, after) in zip(spans, rooms, strict=True):
        room[span[0], 0] = max(room[span[0], 0], before)
        room[span[-1], 1] = max(room[span[-1], 1], after)
    sizes = np.array(ratios) / np.sum(ratios) * (size - room.sum())
    ends = np.cumsum(room.sum(axis=1) + sizes) - room[:, 1]
    begins = ends - sizes
    return np.array([[begins[span[0]], ends[span[-1]]] for span in spans])
