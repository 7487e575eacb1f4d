"""Frequency responses: measured, and that nonlinear runs have shown, beside their fits."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from armdesign.drawing.colours import actuator_colours
from armdesign.plots.canvas import COMPUTED, INK, MARK, Style, figure, literal

if TYPE_CHECKING:
    from armdesign.plots.canvas import Axes, Figure
    from armdesign.simulation.identification.frequency_response import FrequencyResponse
    from armdesign.simulation.identification.modal_fit import ModalFit
    from armdesign.simulation.linear_model import LinearModel, LinearModels
    from armdesign.simulation.validation import Validation

MARKERS = "os^vD"  # of modes


@literal
def frequency_responses(validations: Mapping[str, Validation]) -> Figure:
    """Figure of the simulated and the fitted response in each validation's first sweep."""
    runs = {label: one.runs[0] for label, one in validations.items() if one.runs}
    fig, axes = figure(max(len(runs), 1), 5.4, 2.6 + 0.6 * len(runs))
    for ax, (label, run) in zip(axes, runs.items(), strict=bool(runs)):
        size = np.abs(run.fit.response)
        ax.semilogy(run.fit.frequency, size, ".", color=INK, ms=5, label="nonlinear simulation")
        ax.semilogy(*run.on_resonance, ".", color=INK, ms=5)
        ax.semilogy(*run.fit.curve, "-", color=MARK, lw=1.5, label="fit")
        linear = {"color": COMPUTED, "label": "linear natural frequency"}
        ax.axvline(run.linear_frequency, ls="--", lw=1.2, **linear)
        ax.set(xlabel="frequency [Hz]")
        title = f"{label}: {run.cylinder}, fitted {run.identified_frequency:.3f} Hz"
        ax.set_title(title, fontsize=10)
        ax.grid(alpha=0.3)
    axes[0].set_ylabel("speed / commanded speed [–]")
    fig.legend(handles=axes[0].get_legend_handles_labels()[0], loc="outside lower center", ncols=3)
    return fig


@literal
def measured_response(measured: FrequencyResponse) -> Figure:
    """Figure of magnitude, within two standard deviations, phase and coherence."""
    fig, (size, phase, share) = figure(rows=3, height=1.9)
    lines, magnitude, spread = measured.frequency, np.abs(measured.response), measured.deviations
    low = np.maximum(magnitude - 2 * spread, magnitude / 100)
    size.fill_between(lines, low, magnitude + 2 * spread, color=COMPUTED, alpha=0.3, lw=0)
    size.semilogy(lines, magnitude, color=INK, lw=1.2)
    phase.plot(lines, np.degrees(np.angle(measured.response)), ".", color=INK, ms=3)
    share.plot(lines, measured.coherence, color=INK, lw=1.2)
    size.set_ylabel("output / input")
    phase.set(ylabel="phase [°]", ylim=(-190, 190), yticks=(-180, -90, 0, 90, 180))
    share.set(ylabel="coherence", ylim=(-0.05, 1.05), xlabel="frequency [Hz]")
    for ax in (size, phase, share):
        ax.grid(alpha=0.3)
        ax.set_xlim(lines[0], lines[-1])
    return fig


@literal
def modal_fit(fit: ModalFit) -> Figure:
    """Figure of the measured lines, the fitted curve and the natural frequencies."""
    fig, (ax,) = figure()
    ax.semilogy(fit.frequency, np.abs(fit.response), ".", color=INK, ms=5, label="measured")
    ax.semilogy(*fit.curve, "-", color=MARK, lw=1.5, label="fit")
    for frequency in fit.natural_frequencies:
        ax.axvline(frequency, ls="--", lw=1.2, color=COMPUTED)
    modes = zip(fit.natural_frequencies, fit.damping_ratios, strict=True)
    ax.set_title("; ".join(f"{f:.3f} Hz, ζ = {zeta:.3g}" for f, zeta in modes), fontsize=11)
    ax.set(xlabel="frequency [Hz]", ylabel="output / input")
    ax.legend(frameon=False)
    ax.grid(alpha=0.3)
    return fig


@literal
def linear_response(model: LinearModel) -> Figure:
    """Figure of each piston's speed over its own command, its phase, and natural frequencies.

    Raises:
        SimulationError: the model lacks the commands or the speeds of pistons.
    """
    known = model.natural_frequencies
    least, most = (known.min(), known.max()) if len(known) else (1.0, 1.0)
    lines = np.geomspace(0.2 * least, 3 * most, 600)
    own = model.select("commands", "piston speeds")
    fig, (size, phase) = figure(rows=2, height=2.6)
    colours, response = actuator_colours(model.machine), own.frequency_response(lines)
    for i, name in enumerate(own.inputs):
        style = {"color": colours[name], "label": name}
        size.loglog(lines, np.abs(response[:, i, i]), **style)
        phase.semilogx(lines, np.degrees(np.unwrap(np.angle(response[:, i, i]))), **style)
    for ax in (size, phase):
        ax.grid(alpha=0.3)
        for k, frequency in enumerate(known.tolist()):
            label = None if k else "natural frequency"
            ax.axvline(frequency, ls=":", lw=1.0, color=INK, label=label)
    size.set_ylabel("speed / command [m/s]" + " or [rad/s]" * bool(model.machine.motors))
    size.legend(frameon=False, fontsize=8)
    phase.set(ylabel="phase [°]", xlabel="frequency [Hz]")
    return fig


@literal
def linear_modes(models: LinearModels, ax: Axes | None = None) -> Axes:
    """Damping ratio over frequency of the oscillatory modes of all poses; returns the axes."""
    ax = figure()[1][0] if ax is None else ax
    each = [models[pose] for pose in range(len(models))]
    pairs = [np.stack([one.natural_frequencies, one.damping_ratios], axis=1) for one in each]
    for k in range(max(map(len, pairs), default=0)):
        frequency, damping = np.array([pair[k] for pair in pairs if len(pair) > k]).T
        style: Style = {"marker": MARKERS[k % len(MARKERS)], "color": (INK, MARK, COMPUTED)[k % 3]}
        ax.plot(frequency, damping, ls="", ms=4, label=f"mode {k + 1}", **style)
    ax.set(xlabel="natural frequency [Hz]", ylabel="damping ratio", xscale="log")
    ax.grid(alpha=0.3)
    ax.legend(frameon=False)
    return ax
