"""Numbers pose by pose: natural frequencies and static forces; and those at the ends of bands."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from armdesign.arrays import Array
from armdesign.drawing.colours import actuator_colours
from armdesign.plots.canvas import COMPUTED, INK, MARK, figure, literal, plain_decades

if TYPE_CHECKING:
    from armdesign.frequency.bands import Corner, End
    from armdesign.frequency.frequency_band import FrequencyBand
    from armdesign.frequency.modes import Modes
    from armdesign.machine.poses import Poses
    from armdesign.plots.canvas import Axes

JOINED = 40  # poses whose dots are joined by lines: a path, say


@literal
def modes_by_pose(modes: Modes, ax: Axes | None = None) -> Any:
    """Axes with the coupled frequencies of every pose, and each cylinder's with the rest locked.

    The scale is logarithmic; what is 0 or inf is left out.
    """
    ax = figure(1, 7.0, 4.2)[1][0] if ax is None else ax
    for mode, frequencies in enumerate(modes.frequencies.T):
        colour = MARK if mode == 0 else COMPUTED
        label = ("lowest coupled mode", "higher modes")[mode] if mode < 2 else None
        _by_pose(ax, np.where(frequencies > 0, frequencies, np.nan), color=colour, label=label)
    for k, frequencies in enumerate(modes.locked_frequencies.T):
        known = np.where((frequencies > 0) & np.isfinite(frequencies), frequencies, np.nan)
        label = None if k else "one cylinder, the others locked"
        size = 9 if len(known) <= JOINED else 3
        ax.plot(np.arange(len(known)), known, "_", color=INK, ms=size, alpha=0.7, label=label)
    ax.set(ylabel="natural frequency [Hz]")
    if any(np.isfinite(line.get_ydata()).any() for line in ax.lines):
        plain_decades(ax)
    _finish(ax, len(modes.frequencies))
    return ax


@literal
def forces_by_pose(poses: Poses, ax: Axes | None = None) -> Any:
    """Axes with the static force of every actuator at every pose, torques of motors."""
    ax = figure(1, 7.0, 4.2)[1][0] if ax is None else ax
    colours = actuator_colours(poses.machine)
    for actuator, forces in zip(poses.machine.actuators, poses.cylinder_forces.T, strict=True):
        _by_pose(ax, forces / 1000, color=colours[actuator.name], label=actuator.name)
    ax.axhline(0, color=INK, lw=0.8)
    ax.set(ylabel="static force [kN], of a motor torque [kN m]; + pushes")
    _finish(ax, len(poses))
    return ax


@literal
def corners_of_bands(band: FrequencyBand, ax: Axes | None = None) -> Any:
    """Axes with the lowest frequency at every corner of the bands, and with the file's values."""
    count = len(band.scenarios)
    ax = figure(1, 7.0, 1.6 + 0.3 * count)[1][0] if ax is None else ax
    rows = np.arange(count)
    ax.plot([one.frequency for one in band.scenarios], rows, "o", color=COMPUTED, label="corners")
    ax.axvline(band.nominal, color=INK, label="with the file's values")
    softest = band.scenarios[0].corner.soft
    ax.set_yticks(rows, [_words(one.corner, softest) for one in band.scenarios])
    ax.set(xlabel="lowest frequency of the poses [Hz]", ylim=(count - 0.5, -0.5))
    ax.grid(alpha=0.3)
    _legend_above(ax)
    return ax


def _words(corner: Corner, softest: End) -> str:
    """A corner of the bands in words."""
    soft = ", ".join(f"soft {name.replace('_', ' ')}" for name in sorted(corner.soft))
    end = "soft end" if corner.soft == softest else soft or "stiff end"
    shares = {"payload": corner.payload_share, "links": corner.link_share}
    masses = (f"{name} × {share:.4g}" for name, share in shares.items() if share != 1)
    return ", ".join([end, *masses])


def _by_pose(ax: Axes, values: Array, **style: Any) -> None:
    """Values (n,) over the row of their pose."""
    few = len(values) <= JOINED
    ax.plot(
        np.arange(len(values)), values, "o-" if few else ".", ms=4 if few else 3, lw=1, **style
    )


def _finish(ax: Axes, count: int) -> None:
    ax.set(xlabel="pose, by its row", xlim=(-0.5, count - 0.5))
    if count <= JOINED:
        ax.set_xticks(range(0, count, 1 + count // 20))
    ax.grid(alpha=0.3)
    _legend_above(ax)


def _legend_above(ax: Axes) -> None:
    """Beside the axes no line is hidden."""
    ax.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=4, borderaxespad=0.2)
