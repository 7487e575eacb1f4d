"""Colour bars beside axes, exactly as high as they are; one where several have the same."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from armdesign.plots.canvas import plain_ticks

if TYPE_CHECKING:
    from armdesign.plots.canvas import Axes


LEVELS = 160  # of a colour scale: finer than is seen, and so few that files have all of them


def colour_bar(ax: Axes, mesh: Any, label: str) -> Any:
    """Colour bar beside axes, exactly as high as they are, whatever their aspect."""
    mesh.set_cmap(mesh.cmap.resampled(LEVELS))
    place = ax.inset_axes((1.02, 0.0, 0.035, 1.0))
    bar = ax.figure.colorbar(mesh, cax=place)
    bar.set_label(label)
    bar.outline.set_visible(False)
    if place.get_yscale() == "log":
        plain_ticks(bar.ax.yaxis, mesh.norm.vmin, mesh.norm.vmax)
    return bar


def hide_colour_bar(ax: Axes) -> None:
    """Take away the colour bar of axes whose neighbours have the same one."""
    bar = ax.child_axes[0]
    bar.set_visible(False)
    bar.set_in_layout(False)
