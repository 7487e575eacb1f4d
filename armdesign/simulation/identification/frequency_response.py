"""Frequency response of a long or periodic record: measured line by line, with its coherence.

Spectra are averaged over segments of the record (Welch 1967); the coherence says how much of the
response the excitation explains.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from armdesign.arguments import checked
from armdesign.arrays import Array, ReadOnly
from armdesign.errors import SimulationError
from armdesign.short_repr import short_repr
from armdesign.simulation.identification.modal_fit import ModalFit, identify_frequency_response
from armdesign.simulation.identification.records import signals_of

if TYPE_CHECKING:
    from armdesign.plots.canvas import Figure

LEAST_COHERENCE = 1e-6  # of lines that count


@dataclass(frozen=True, eq=False)
class FrequencyResponse(ReadOnly):
    """Output over input, measured line by line; arrays are read-only.

    Attributes:
        frequency: lines (k,) [Hz].
        response: output over input (k,), complex.
        coherence: share of the output's power that the input explains (k,), 0…1.
        averages: number of independent segments behind it.
    """

    __repr__ = short_repr

    frequency: Array
    response: Array
    coherence: Array
    averages: float

    @property
    def deviations(self) -> Array:
        """Standard deviation of the response (k,): |H| √((1 − γ²)/(2 n γ²)).

        Bendat & Piersol 2010, ch. 9; γ² is the coherence, n the number of averages.
        """
        unexplained = np.maximum(1 - self.coherence, 1e-12)
        coherence = np.maximum(self.coherence, LEAST_COHERENCE)
        return np.asarray(
            np.abs(self.response) * np.sqrt(unexplained / (2 * self.averages * coherence))
        )

    def plot(self) -> Figure:
        """Magnitude with its deviation, phase and coherence over frequency; returns the figure."""
        from armdesign import plots

        return plots.measured_response(self)

    def fit(self, modes: int = 1, part: str = "response") -> ModalFit:
        """Natural frequencies and damping ratios; lines with little coherence count little.

        Args:
            modes: how many modes lie between the lines.
            part: name of the response for messages.

        Raises:
            SimulationError: too few lines, or no oscillation in them.
        """
        return identify_frequency_response(
            self.frequency, self.response, modes, self.deviations, part
        )


@checked
def frequency_response(
    time: ArrayLike,
    excitation: ArrayLike,
    response: ArrayLike,
    band: tuple[float, float],
    segment: float,
    *,
    periodic: bool = False,
    part: str = "response",
) -> FrequencyResponse:
    """Frequency response H = S_uy/S_uu of a record, with its coherence γ² = |S_uy|²/(S_uu S_yy).

    Segments under a Hann window overlap by half. A mode sharper than 1/``segment`` comes out too
    broad: for that take ``identify_forced_response``, or a periodic excitation that has settled,
    which needs no window.

    Args:
        time: evenly spaced instants (n,) [s].
        excitation: input u (n,).
        response: output y (n,).
        band: lowest and highest frequency that counts [Hz].
        segment: length of the segments [s].
        periodic: a segment is a period of a settled record: no window, no overlap.
        part: name of the record for messages.

    Raises:
        SimulationError: the record is shorter than two segments or has no even instants, or
            nothing moves.

    Example:
        White noise through a gain of 2, with as much noise of its own:

        >>> import numpy as np, armdesign as ad
        >>> random = np.random.default_rng(1)
        >>> time, force = np.arange(20_000) / 100, random.normal(size=20_000)
        >>> speed = 2 * force + 2 * random.normal(size=20_000)
        >>> measured = ad.frequency_response(time, force, speed, (5.0, 45.0), segment=2.0)
        >>> print(abs(measured.response).mean().round(1), measured.coherence.mean().round(1))
        2.0 0.5
    """
    from scipy.signal import coherence, csd, welch

    step, (u, y) = signals_of(part, time, excitation, response)
    count = round(segment / step)
    if len(u) < 2 * count:
        raise SimulationError(
            part, f"{len(u) * step:.3g} s are less than two segments", "record longer"
        )
    used = len(u) // count * count
    u, y = u[-used:], y[-used:]
    if not (np.ptp(u) > 0 and np.ptp(y) > 0):
        raise SimulationError(
            part, "nothing moves", "raise the amplitude, or choose a cylinder that moves this mode"
        )
    options = {"fs": 1 / step, "nperseg": count, "window": "boxcar" if periodic else "hann"}
    options |= {"noverlap": 0 if periodic else count // 2}
    lines, cross = csd(u, y, **options)
    power = welch(u, **options)[1]
    explained = coherence(u, y, **options)[1]
    inside = (lines >= band[0] - 1e-9) & (lines <= band[1] + 1e-9) & (power > 1e-9 * power.max())
    # Hann windows that overlap by half are not independent: 2K² / (…) of them count (Welch 1967),
    # about 0.95 per half.
    averages = used / count if periodic else 0.95 * (2 * used / count - 1)
    return FrequencyResponse(
        lines[inside], cross[inside] / power[inside], explained[inside], averages
    )
