"""Frequency responses that are measured first and fitted afterwards, with ``fit_response``.

Of a long or a periodic record, averaged over segments (Welch 1967), with the coherence that says
how much of the answer comes from the excitation; and of a stepped sine, frequency by frequency.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from armdesign.arrays import Array
from armdesign.errors import SimulationError
from armdesign.simulation.excitation import SteppedSine
from armdesign.simulation.identification.modal_fit import Fit, fit_response

LEAST_COHERENCE = 1e-6  # of lines that count


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """Answer over excitation, measured line by line; arrays are read-only.

    Attributes:
        frequency: lines (k,) [Hz].
        response: (k,), complex.
        coherence: share of the answer's power that the excitation explains (k,), 0…1.
        averages: number of independent segments behind it.
    """

    frequency: Array
    response: Array
    coherence: Array
    averages: float

    def __post_init__(self) -> None:
        for value in (self.frequency, self.response, self.coherence):
            value.setflags(write=False)

    @property
    def deviations(self) -> Array:
        """Standard deviation of the response (k,): |H| √((1 − γ²)/(2 n γ²)) (Bendat & Piersol 2010, ch. 9)."""
        unexplained = np.maximum(1 - self.coherence, 1e-12)
        coherence = np.maximum(self.coherence, LEAST_COHERENCE)
        return np.asarray(
            np.abs(self.response) * np.sqrt(unexplained / (2 * self.averages * coherence))
        )

    def fit(self, modes: int = 1, part: str = "response") -> Fit:
        """Natural frequencies and damping ratios, lines with little coherence counting little.

        Raises:
            SimulationError: too few lines, or no oscillation in them.
        """
        return fit_response(self.frequency, self.response, modes, self.deviations, part)


def frequency_response(
    time: Array,
    excitation: Array,
    answer: Array,
    band: tuple[float, float],
    segment: float,
    *,
    periodic: bool = False,
    part: str = "response",
) -> FrequencyResponse:
    """H = S_uy/S_uu over segments of a record, and the coherence γ² = |S_uy|²/(S_uu S_yy).

    Segments under a Hann window overlap by half. A mode sharper than 1/``segment`` comes out too
    broad: there ``fit_modes`` is the way, or a periodic excitation that has settled, which needs
    no window at all.

    Args:
        time: even instants (n,) [s].
        excitation: input (n,).
        answer: output (n,).
        band: lowest and highest frequency that counts [Hz].
        segment: length of the segments [s].
        periodic: a segment is a period of a settled record: no window, no overlap.
        part: name of the record for messages.

    Raises:
        SimulationError: the record is shorter than two segments, or nothing moves.
    """
    from scipy.signal import coherence, csd, welch

    step = time[1] - time[0]
    count = round(segment / step)
    if len(time) < 2 * count:
        raise SimulationError(
            part, f"{len(time) * step:.3g} s are less than two segments", "record longer"
        )
    used = len(time) // count * count
    u, y = excitation[-used:], answer[-used:]
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


def stepped_response(
    time: Array,
    excitation: Array,
    answer: Array,
    sine: SteppedSine,
    *,
    settled: float = 0.5,
    part: str = "response",
) -> FrequencyResponse:
    """Answer over excitation at every frequency of a stepped sine, fitted to the last ``settled`` share of each step.

    Sine, cosine and a constant are fitted to both; the coherence is the share of the answer's
    power that they explain. What rings on from the step before is not separated: the steps have to
    outlast it.

    Args:
        time: instants (n,) [s].
        excitation: input (n,).
        answer: output (n,).
        sine: the excitation that was asked for.
        settled: share of every step that counts, from its end.
        part: name of the record for messages.

    Raises:
        SimulationError: too few records within a step, or nothing moves.
    """
    rows = [_line(time, excitation, answer, *step, settled, part) for step in _steps(sine)]
    response, coherence, counts = np.array(rows).T
    return FrequencyResponse(
        np.array(sine.frequencies),
        response,
        np.asarray(coherence.real),
        float(np.median(counts.real)) / 2,
    )


def _steps(sine: SteppedSine) -> list[tuple[float, float, float]]:
    """Frequency [Hz], begin and end [s] of each."""
    return list(
        zip(sine.frequencies, sine.edges[:-1].tolist(), sine.edges[1:].tolist(), strict=True)
    )


def _line(
    time: Array,
    u: Array,
    y: Array,
    frequency: float,
    begin: float,
    end: float,
    settled: float,
    part: str,
) -> tuple[complex, float, int]:
    """Response at one frequency, the share of power explained, and the number of records behind it."""
    inside = (time >= end - settled * (end - begin)) & (time < end)
    if inside.sum() < 8:
        raise SimulationError(
            part,
            f"has {inside.sum()} records at {frequency:.3g} Hz",
            "record faster, or step longer",
        )
    angle = 2 * math.pi * frequency * time[inside]
    basis = np.stack([np.cos(angle), np.sin(angle), np.ones_like(angle)], axis=1)
    signals = np.stack([u[inside], y[inside]], axis=1)
    found = np.linalg.lstsq(basis, signals, rcond=None)[0]
    asked, answered = found[0] - 1j * found[1]
    power = float(np.sum((signals[:, 1] - found[2, 1]) ** 2))
    if abs(asked) == 0 or power == 0:
        raise SimulationError(part, f"nothing moves at {frequency:.3g} Hz", "raise the amplitude")
    left = float(np.sum((signals[:, 1] - basis @ found[:, 1]) ** 2))
    return answered / asked, 1 - left / power, int(inside.sum())
