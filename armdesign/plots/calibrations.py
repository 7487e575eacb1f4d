"""Measured frequencies beside a machine's own before and after its calibration."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from armdesign.plots.canvas import COMPUTED, INK, MARK, Style, figure, legend_below, literal

if TYPE_CHECKING:
    from armdesign.calibration.calibrate import Calibration
    from armdesign.plots.canvas import Axes, Figure

TICKS = 20  # numbers of measurements that are written out, at most


@literal
def measured_and_computed(calibration: Calibration, ax: Axes | None = None) -> Axes:
    """Axes with the frequencies of every measurement: measured, before, calibrated, left out."""
    ax = figure(1, 7.0, 4.6)[1][0] if ax is None else ax
    frame = calibration.frame.dropna(subset=["measured_hz"])
    numbers, measured = frame.index + 1, frame["measured_hz"]
    left_out = measured * (1 + frame["left_out_error"])
    ax.plot(numbers, frame["before_hz"], "s", color=INK, mfc="none", label="machine file before")
    ax.plot(numbers, frame["calibrated_hz"], "o", color=MARK, label="calibrated")
    ax.plot(numbers, left_out, "x", color=COMPUTED, label="predicted with it left out of the fit")
    deviations = 2 * frame["deviation_hz"]
    style: Style = {"fmt": "_", "color": INK, "capsize": 3, "ms": 14}
    ax.errorbar(numbers, measured, deviations, **style, label="measured, ± 2 deviations")
    ax.set(xlabel="measurement", ylabel="frequency [Hz]", ylim=(0, 1.06 * ax.dataLim.y1))
    _finish(ax, numbers)
    return ax


@literal
def errors_and_deviations(calibration: Calibration, ax: Axes) -> Axes:
    """Axes with the errors of every measurement, calibrated and left out."""
    frame = calibration.frame.dropna(subset=["measured_hz"])
    numbers = frame.index + 1
    style: Style = {"fmt": "_", "color": INK, "capsize": 3}
    deviations = 200 * frame["deviation_hz"] / frame["measured_hz"]
    ax.errorbar(numbers, 0 * deviations, deviations, **style, label="± 2 deviations")
    ax.plot(numbers, 100 * frame["calibrated_error"], "o", color=MARK, label="calibrated")
    ax.plot(numbers, 100 * frame["left_out_error"], "x", color=COMPUTED, label="left out")
    ax.set(xlabel="measurement", ylabel="computed over measured, less one [%]")
    _finish(ax, numbers)
    return ax


def calibration_figure(calibration: Calibration) -> Figure:
    """Figure of frequencies, and beside them the errors that are left."""
    fig, (left, right) = figure(2, 6.0, 4.4)
    measured_and_computed(calibration, left)
    errors_and_deviations(calibration, right)
    return fig


def _finish(ax: Axes, numbers: Any) -> None:
    ax.set_xticks(np.asarray(numbers)[:: 1 + len(numbers) // TICKS])
    ax.grid(alpha=0.3)
    legend_below(ax, ncols=2)
