"""Records that are to be identified: signals at evenly spaced instants."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from armdesign.arrays import Array, unmasked
from armdesign.errors import SimulationError

JITTER = 0.1  # of an instant, relative to the interval: rounded time stamps


def signals_of(part: str, time: ArrayLike, *signals: ArrayLike) -> tuple[float, list[Array]]:
    """Interval [s] between the instants of a record, and its signals as arrays.

    Args:
        part: name of the record for messages.
        time: evenly spaced instants (n,) [s], n at least 2; they may be rounded.
        *signals: (n,) or (n, m) each.

    Raises:
        SimulationError: the instants are not evenly spaced, a signal has another length, or a
            value is not finite.
    """
    instants = _numbers(part, time)
    if instants.ndim != 1 or len(instants) < 2:
        raise SimulationError(part, f"time has shape {instants.shape}", "give (n,) instants [s]")
    step = float((instants[-1] - instants[0]) / (len(instants) - 1))
    expected = instants[0] + step * np.arange(len(instants))
    if not (step > 0 and np.abs(instants - expected).max() <= JITTER * step):
        raise SimulationError(part, "time is not evenly spaced", "interpolate the record")
    values = [_numbers(part, signal) for signal in signals]
    for signal in values:
        if signal.ndim not in (1, 2) or len(signal) != len(instants):
            fault = f"a signal of shape {signal.shape} does not fit {len(instants)} instants"
            raise SimulationError(part, fault, "give one value per instant")
    return step, values


def _numbers(part: str, values: ArrayLike) -> Array:
    try:
        numbers = unmasked(values)
    except (TypeError, ValueError):
        numbers = np.array(np.nan)
    if not np.all(np.isfinite(numbers)):
        raise SimulationError(part, "holds what is no finite number", "leave such values out")
    return numbers
