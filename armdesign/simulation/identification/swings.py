"""Frequency and damping of a ring-down against its amplitude.

Large swings ring lower where a chamber runs empty or air is compressed. Short pieces of a decay,
three periods each and a period apart, are fitted by one mode over a parabola, under the noise that
the fit of the whole has left. Where they scatter about a line over the amplitude by more than
their deviations, these are raised to the scatter.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from armdesign.arrays import Array, ReadOnly
from armdesign.simulation.identification.decaying_modes import Noise, autoregression, fit_modes

PERIODS = 3.0  # of a piece
LEAST = 12  # samples of it
SURE = 3.0  # deviations from which a difference is one
LEAST_PIECES = 4  # from which a change can be told
RISE, LARGE = 1.3, 0.3  # of a swing over an earlier one, of the largest: it is excited again
NOTABLE = 0.02  # relative difference of frequencies worth a word


@dataclass(frozen=True, eq=False)
class Swings(ReadOnly):
    """Pieces of a decay, in the order of time; arrays are read-only.

    Attributes:
        time: middle of each piece (k,) [s].
        amplitudes: swing of the signal there (k,), half of peak to peak.
        frequencies: natural frequencies (k,) [Hz].
        frequency_deviations: their standard deviations (k,) [Hz].
        damping_ratios: (k,).
        damping_deviations: (k,).
    """

    time: Array
    amplitudes: Array
    frequencies: Array
    frequency_deviations: Array
    damping_ratios: Array
    damping_deviations: Array

    @property
    def rise(self) -> float | None:
        """When the swing rises again [s], as in no free decay; None if it does not."""
        lowest = np.minimum.accumulate(self.amplitudes)
        most = self.amplitudes.max(initial=0.0)
        rises = (self.amplitudes > RISE * lowest) & (self.amplitudes > LARGE * most)
        return float(self.time[np.argmax(rises)]) if rises.any() else None

    @property
    def change(self) -> tuple[float, float, float, float] | None:
        """Frequencies [Hz] at the largest and the smallest swing, and these.

        On a line through all pieces; None if it does not fall or rise by more than chance and two
        per cent. Neighbours share two thirds of their samples.
        """
        if len(self.time) < LEAST_PIECES:
            return None
        ends = np.array([self.amplitudes.max(), self.amplitudes.min()])
        shares = self.amplitudes / ends[0]
        offset, slope, covariance, _ = _line(shares, self.frequencies, self.frequency_deviations)
        first, second = offset + slope * ends / ends[0]
        deviation = math.sqrt(PERIODS * covariance[1, 1]) * np.ptp(shares)
        if abs(second - first) < max(SURE * deviation, NOTABLE * abs(second)):
            return None
        return float(first), float(second), float(ends[0]), float(ends[1])


def _line(x: Array, y: Array, deviations: Array) -> tuple[float, float, Array, float]:
    """Offset and slope of y over x, their covariance, and the scatter over the deviations."""
    columns = np.stack([np.ones_like(x), x], axis=1) / deviations[:, None]
    line = np.linalg.lstsq(columns, y / deviations, rcond=None)[0]
    left = y / deviations - columns @ line
    scatter = math.sqrt(float(left @ left) / max(len(y) - 2, 1))
    covariance = np.linalg.pinv(columns.T @ columns)
    return float(line[0]), float(line[1]), covariance, scatter


def swings(time: Array, signal: Array, left: Array, frequency: float, damping: float) -> Swings:
    """Pieces of a decay with their amplitudes.

    Args:
        time: evenly spaced instants (n,) [s].
        signal: (n,).
        left: what the fit of the whole has left of it (n,).
        frequency: natural frequency of the whole [Hz].
        damping: its damping ratio.
    """
    scale = float(np.abs(signal).max())  # the squares of small numbers are none
    signal, left = signal / scale, left / scale
    step = float((time[-1] - time[0]) / (len(time) - 1))
    omega, zeta = 2 * math.pi * frequency * step, min(max(damping, 1e-4), 0.9)
    start = np.array([omega * (-zeta + 1j * math.sqrt(1 - zeta**2))])
    length, hop = round(PERIODS / frequency / step), round(1 / frequency / step)
    noise, rows = Noise(length, autoregression(left[:, None], 2), trend_degree=2), []
    for first in range(0, len(signal) - length + 1, max(hop, 1)) if length >= LEAST else ():
        piece = signal[first : first + length, None]
        fit = fit_modes(piece, start, noise)
        if not fit.rings[0] and not _near(fit.roots[0], start[0]):
            continue
        (size,), (ratio,) = fit.modes(1)
        of_size, of_ratio = np.sqrt(fit.variances(1))[:, 0]
        decay = np.exp(fit.roots[0].real * length / 2)
        row = [time[first] + length * step / 2, np.abs(fit.shapes[0, 0]) * decay]
        row += [v / (2 * math.pi * step) for v in (size, of_size)]
        rows.append([*row, ratio, of_ratio])
    table = np.array(rows, dtype=float).reshape(-1, 6)
    if len(table) >= LEAST_PIECES:
        for k in (2, 4):
            table[:, k + 1] *= max(_line(table[:, 1], table[:, k], table[:, k + 1])[3], 1.0)
    table[:, 1] *= scale
    return Swings(*table.T.copy())


def _near(root: complex, start: complex) -> bool:
    return bool(abs(root - start) < 0.5 * abs(start))
