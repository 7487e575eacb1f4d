"""Recorded signals with what was fitted to them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import numpy as np

from armdesign.plots.canvas import COMPUTED, INK, MARK, Style, figure, literal

if TYPE_CHECKING:
    from armdesign.plots.canvas import Axes, Figure
    from armdesign.simulation.identification.modal_fit import ModalFit
    from armdesign.simulation.identification.ringdown import Ringdown
    from armdesign.simulation.identified import Identified, IdentifiedWindow


@literal
def identified_figure(identified: Identified) -> Figure:
    """Figure of signal, fit and residual over time, and of frequency against amplitude.

    Of forced responses: the response of every window.
    """
    decays = [window for window in identified.windows if window.fitted is not None]
    if not decays:
        return _responses(identified)
    fig, _ = figure(1, 9.0, 9.0)
    fig.clf()
    grid = fig.add_gridspec(3, 1, height_ratios=(3, 1.3, 2))
    top = fig.add_subplot(grid[0])
    below, last = fig.add_subplot(grid[1], sharex=top), fig.add_subplot(grid[2])
    whole = identified.recording
    top.plot(whole.time, whole.column(identified.signal), color=INK, lw=0.7, label="recorded")
    for k, window in enumerate(decays):
        colour = (MARK, COMPUTED)[k % 2]
        label = "fit: damped oscillation and trend" if k == 0 else None
        top.plot(window.time, np.asarray(window.fitted), color=colour, lw=1.3, label=label)
        below.plot(window.time, window.signal - window.fitted, color=colour, lw=0.7)
    _swings(last, decays)
    top.set(ylabel=identified.signal, title=whole.source)
    below.set(xlabel="time [s]", ylabel="residual")
    last.set(xlabel=f"swing of {identified.signal}, half of peak to peak", ylabel="frequency [Hz]")
    motion = identified.motion(*decays)
    last.set_title(motion and f"{motion}, too", fontsize="small")
    for ax in (top, below, last):
        ax.grid(alpha=0.3)
    top.legend(frameon=False)
    return fig


@literal
def ringdown(decay: Ringdown) -> Figure:
    """Figure of a free decay's outputs with the modes fitted to them, and of what these leave."""
    fig, (signal, left) = figure(rows=2, height=2.6)
    for k, (recorded, fitted) in enumerate(zip(decay.response.T, decay.fitted.T, strict=True)):
        labels = ("recorded", "fit") if k == 0 else (None, None)
        signal.plot(decay.time, recorded, color=INK, lw=0.8, label=labels[0])
        signal.plot(decay.time, fitted, color=MARK, lw=1.3, label=labels[1])
        left.plot(decay.time, recorded - fitted, color=INK, lw=0.8)
    modes = zip(decay.natural_frequencies, decay.damping_ratios, strict=True)
    signal.set_title("; ".join(f"{f:.3f} Hz, ζ = {zeta:.3g}" for f, zeta in modes), fontsize=11)
    signal.set_ylabel("response")
    left.set(xlabel="time [s]", ylabel="residual")
    signal.legend(frameon=False)
    for ax in (signal, left):
        ax.grid(alpha=0.3)
    return fig


def _swings(ax: Axes, decays: list[IdentifiedWindow]) -> None:
    """Frequencies of pieces and of whole windows against the amplitude."""
    style: Style = {"fmt": ".", "color": INK, "alpha": 0.5, "lw": 0.8}
    for window in decays:
        pieces = window.swings
        if pieces is not None and len(pieces.time):
            points = pieces.amplitudes, pieces.frequencies, pieces.frequency_deviations
            ax.errorbar(*points, **style)
            whole = window.fit.natural_frequencies[:1], window.fit.frequency_deviations[:1]
            middle = [float(np.median(pieces.amplitudes))]
            ax.errorbar(middle, *whole, fmt="o", color=MARK, capsize=3)
    ax.plot([], [], ".", color=INK, alpha=0.5, label="three periods")
    ax.plot([], [], "o", color=MARK, label="whole window, ± 1 deviation")
    ax.legend(frameon=False)


def _responses(identified: Identified) -> Any:
    """Figure of measured and fitted responses, one pair of axes for each window."""
    fig, axes = figure(len(identified.windows), 5.4, 3.8)
    for ax, window in zip(axes, identified.windows, strict=True):
        fit = cast("ModalFit", window.fit)
        ax.semilogy(fit.frequency, np.abs(fit.response), ".", color=INK, label="recorded")
        ax.semilogy(*fit.curve, "-", color=MARK, lw=1.5, label="fit")
        left = np.abs(fit.response - fit.fitted)
        ax.semilogy(fit.frequency, left, "x", color=COMPUTED, ms=4, label="residual")
        title = f"{identified.span(window)} s: {fit.natural_frequencies[0]:.3f} Hz"
        ax.set(xlabel="frequency [Hz]", ylabel=identified.signal, title=title)
        ax.grid(alpha=0.3)
    axes[0].legend(frameon=False)
    return fig
