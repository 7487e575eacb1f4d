"""Bias of the spectral peak of a swept linear oscillator, by the length of the sweep.

    x'' + 2ζω x' + ω² x = ω² u(t)

u is the ``SweptSine`` over half to 1.6 times the natural frequency. The
peaks of the piston's speed and of its position are read off spectra so finely interpolated
that no line width is in them (in a plain spectrum up to half a line, 1/2T, comes on top), and the
speed's response is fitted as ``validate`` does it.

After some ten periods a peak is low by 1.5 % to 5 %, since the record ends while the oscillator
still rings. After 300 nothing of that is left. Position then still peaks below the natural
frequency, at ω √(1 − 2ζ²): 0.25 % for ζ = 0.05. That is no bias of the sweep but the difference of
a resonance from a natural frequency; speed has none.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from armdesign.arrays import Array
from armdesign.simulation.excitation import SweptSine
from armdesign.simulation.identification.modal_fit import identify_forced_response, spectral_peak

if TYPE_CHECKING:
    import pandas as pd

BAND = (0.5, 1.6)  # relative to the natural frequency
RATE = 50  # records per period
PADDED = 6000  # periods, zeros after the record: that many lines per natural frequency
PERIODS, DAMPING = (10, 30, 100, 300), (0.0, 0.05, 0.1)


def sweep_bias(
    periods: Sequence[float] = PERIODS, damping: Sequence[float] = DAMPING
) -> pd.DataFrame:
    """Relative deviations of what a sweep says from the natural frequency.

    Args:
        periods: of the natural frequency that the sweep lasts.
        damping: damping ratios ζ.

    Returns:
        One row per length and ζ: ``periods``, ``damping``, ``speed_peak``, ``position_peak``,
            ``speed_fit``.
    """
    import pandas as pd

    return pd.DataFrame([_row(length, zeta) for length in periods for zeta in damping])


def _row(periods: float, zeta: float) -> dict[str, float]:
    time = np.arange(0, periods, 1 / RATE)
    sweep = SweptSine(amplitude=1.0, start=BAND[0], stop=BAND[1], duration=periods)
    command = np.array([sweep(t) for t in time])
    position, speed = _answer(zeta, time, command)
    peaks = [_peak(answer) for answer in (speed, position)]
    fitted = float(identify_forced_response(time, command, speed, BAND).natural_frequencies[0])
    deviations = dict(
        zip(
            ("speed_peak", "position_peak", "speed_fit"),
            np.array([*peaks, fitted]) - 1,
            strict=True,
        )
    )
    return {"periods": periods, "damping": zeta, **deviations}


def _answer(zeta: float, time: Array, command: Array) -> Array:
    """Position and speed (2, n) of an oscillator of 1 Hz."""
    from scipy.signal import StateSpace, lsim

    omega = 2 * math.pi
    system = StateSpace(
        [[0, 1], [-(omega**2), -2 * zeta * omega]], [[0], [omega**2]], np.eye(2), np.zeros((2, 1))
    )
    return np.asarray(lsim(system, command, time)[1].T)


def _peak(answer: Array) -> float:
    padded = np.concatenate([answer, np.zeros(PADDED * RATE - len(answer))])
    return spectral_peak(np.arange(len(padded)) / RATE, padded, BAND)
