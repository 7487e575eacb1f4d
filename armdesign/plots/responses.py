"""Frequency responses that nonlinear runs have shown."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from armdesign.plots.canvas import COMPUTED, INK, MARK, figure, literal

if TYPE_CHECKING:
    from armdesign.simulation.validation import Validation


@literal
def frequency_responses(validations: Mapping[str, Validation]) -> Any:
    """Figure of the simulated and the fitted response in each validation's first sweep."""
    runs = {label: one.runs[0] for label, one in validations.items() if one.runs}
    fig, axes = figure(max(len(runs), 1), 5.4, 3.8)
    for ax, (label, run) in zip(axes, runs.items(), strict=bool(runs)):
        size = np.abs(run.fit.response)
        ax.semilogy(run.fit.frequency, size, ".", color=INK, ms=5, label="nonlinear simulation")
        ax.semilogy(*run.on_resonance, ".", color=INK, ms=5)
        ax.semilogy(*run.fit.curve, "-", color=MARK, lw=1.5, label="fit")
        linear = {"color": COMPUTED, "label": "linear natural frequency"}
        ax.axvline(run.linear_frequency, ls="--", lw=1.2, **linear)
        ax.set(xlabel="frequency [Hz]")
        title = f"{label}: {run.cylinder} cylinder, {run.identified_frequency:.3f} Hz"
        ax.set_title(title, fontsize=10)
        ax.grid(alpha=0.3)
    axes[0].set_ylabel("cylinder speed / command")
    if runs:
        axes[0].legend(frameon=False, loc="lower center", fontsize=8)
    return fig
