"""Windows of a recording in which it rings: where the envelope of a band decays.

The signal is filtered to the neighbourhood of its strongest oscillation. Its envelope, the modulus
of the analytic signal, rises where something excites and decays where the machine rings freely. A
window begins half a period after a peak of the envelope and ends where the envelope has sunk into
the noise or is excited again; long ones are divided, since a machine that moves changes its
frequency.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import pairwise

import numpy as np

from armdesign.arrays import Array
from armdesign.errors import SimulationError

LOWEST, HIGHEST = 0.3, 20.0  # [Hz] where booms oscillate, with a margin
PER_PERIOD = 8  # fewest samples
PERIODS = 7.0  # most in a window that is found
LEAST = 3.0  # fewest in one
RISE = 1.3  # of the envelope within a decay, which ends it
QUIET = 4.0  # envelope above its lowest tenth where a window ends, if that tenth is noise
DECIMALS = 2  # of an end [s]
RISES = 8.0  # of a line over the median of all: noise alone reached it in 1 of 360 recordings
SUNK = 0.08  # of its peak, where it ends at the latest


def stated_windows(part: str, windows: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
    """Windows as given: begin and end [s] of every one.

    Args:
        part: name of the recording for messages.
        windows: pairs of numbers.

    Raises:
        SimulationError: no pair of numbers, no begin before its end, or one is there twice.
    """
    given, remedy = [], "give begin < end [s]"
    for ends in windows:
        try:
            begin, end = map(float, ends)
        except (TypeError, ValueError):
            raise SimulationError(part, f"{ends!r} is no window", remedy) from None
        if not (math.isfinite(begin) and begin < end):
            raise SimulationError(part, f"{begin:.15g}:{end:.15g} is no window", remedy)
        if (begin, end) in given:
            fault = f"the window {begin:.15g}:{end:.15g} is there twice"
            raise SimulationError(part, fault, "leave one out")
        given.append((begin, end))
    return given


def refuse_slow_sampling(part: str, step: float) -> None:
    """Raise where the fewest samples in a period are not had at any frequency of a boom."""
    if PER_PERIOD * step * LOWEST > 1:
        fault = f"a sample every {step:.3g} s shows no oscillation of {LOWEST:g} Hz or more"
        remedy = f"record {PER_PERIOD} in a period; name time in milliseconds time_ms"
        raise SimulationError(part, fault, remedy)


def found_windows(part: str, time: Array, signal: Array) -> list[tuple[float, float]]:
    """Where a signal rings freely: begin and end [s] of every window.

    Args:
        part: name of the recording for messages.
        time: evenly spaced instants (n,) [s].
        signal: what rings about a trend (n,).

    Raises:
        SimulationError: it rings nowhere.
    """
    from scipy.signal import butter, hilbert, sosfiltfilt

    step = float(np.median(np.diff(time)))
    frequency, _ = strongest(step, signal)
    length = float(time[-1] - time[0])
    if frequency * length < 2 * LEAST:
        fault = f"windows are found in {2 * LEAST:g} periods or more; {length:.3g} s hold"
        fault += f" {frequency * length:.2g} of what is strongest (about {frequency:.2g} Hz)"
        held = "give windows of two periods or more, or " if frequency * length >= 2 else ""
        raise SimulationError(part, fault, f"{held}record longer")
    edges = np.array([frequency / 1.6, min(1.6 * frequency, 0.45 / step)])
    band = butter(2, edges, "bandpass", fs=1 / step, output="sos")
    envelope = np.abs(hilbert(sosfiltfilt(band, signal - signal.mean())))
    floor, period = float(np.quantile(envelope, 0.1)), 1 / frequency
    # a recording that rings from begin to end shows no noise
    windows = _decays(time, envelope, period, floor) or _decays(time, envelope, period, 0.0)
    if not windows:
        most = min(HIGHEST, 1 / (PER_PERIOD * step))
        fault = f"shows no free decay of {LEAST:g} periods between {LOWEST:g} and {most:.2g} Hz"
        fault += f", where {1 / step:.3g} samples a second can show one"
        raise SimulationError(part, fault, "give windows, or record faster or louder")
    return windows


def _decays(
    time: Array, envelope: Array, period: float, floor: float
) -> list[tuple[float, float]]:
    """Windows after the peaks of an envelope over a floor of noise."""
    windows, begin, step = list[tuple[float, float]](), 0, (time[-1] - time[0]) / (len(time) - 1)
    for peak in _peaks(envelope, round(1.5 * period / step)):
        if peak < begin:
            continue
        end = _end_of_decay(envelope[peak:], max(QUIET * floor, SUNK * envelope[peak])) + peak
        first, last = time[peak] + period / 2, time[min(end, len(time) - 1)]
        count = max(round((last - first) / (PERIODS * period)), 1)
        if last - first >= LEAST * period:
            marks = np.linspace(first, last, count + 1).round(DECIMALS).tolist()
            windows += pairwise(marks)
        begin = end
    return windows


def strongest(step: float, signal: Array, lowest: float = LOWEST) -> tuple[float, float]:
    """Frequency [Hz] and height of the highest line in the spectrum of a signal's slope over √f.

    The slope leaves little of steps and trends; the root keeps it from favouring ripple. Lines
    have ``PER_PERIOD`` samples in a period at least.
    """
    return _highest_line(step, signal, lowest, 1 / (PER_PERIOD * step))


def strongest_beyond(step: float, signal: Array) -> tuple[float, float]:
    """As ``strongest``, of the lines that have fewer samples in a period."""
    return _highest_line(step, signal, 1 / (PER_PERIOD * step), 0.5 / step)


def fast_line(step: float, signal: Array) -> float | None:
    """Frequency [Hz] of a line above ``HIGHEST`` that rises over all others and over noise.

    Spectrum of the slope over f: white noise is level in it. None if there is no such line.
    """
    lines, heights = _slope_spectrum(step, signal)
    heights = heights / np.maximum(lines, LOWEST) * (lines >= LOWEST)
    highest = int(np.argmax(heights))
    if lines[highest] <= HIGHEST or heights[highest] < RISES * np.median(heights):
        return None
    return float(lines[highest])


def _highest_line(step: float, signal: Array, low: float, high: float) -> tuple[float, float]:
    lines, heights = _slope_spectrum(step, signal)
    inside = (lines >= low) & (lines <= min(HIGHEST, high))
    if not inside.any():
        return low, 0.0
    heights = heights * inside / np.sqrt(np.maximum(lines, low))
    return float(lines[np.argmax(heights)]), float(heights.max())


def _slope_spectrum(step: float, signal: Array) -> tuple[Array, Array]:
    """Lines (k,) [Hz] of a signal's slope under a Hann window, and their heights."""
    slope = np.diff(signal) * np.hanning(len(signal) - 1)
    count = 4 * len(slope)  # zeros beside it: lines closer to each other
    return np.fft.rfftfreq(count, step), np.abs(np.fft.rfft(slope, count))


def _peaks(envelope: Array, apart: int) -> list[int]:
    from scipy.signal import find_peaks

    ends = np.concatenate([[0.0], envelope, [0.0]])  # it may be highest where it begins
    peaks = find_peaks(ends, distance=max(apart, 1), height=0.05 * envelope.max())[0]
    return [int(peak) - 1 for peak in peaks]


def _end_of_decay(envelope: Array, quiet: float) -> int:
    """Index at which an envelope that begins at its peak sinks below ``quiet`` or rises again."""
    lowest = np.minimum.accumulate(envelope)
    over = (envelope < quiet) | (envelope > RISE * lowest)
    return int(np.argmax(over)) if over.any() else len(envelope)
