"""Many initial value problems at once, each with its own steps: ``integrate``.

Dormand and Prince's pair of order 5(4) (1980), with the tableau and the interpolant of scipy's RK45. All cases take a
step at the same time, but each one has its own instant, step and error norm: so a case comes out as if it were alone,
whatever its company, one that meets a kink or a stop does not slow the others, and no error hides in a mean over cases.
A case that has come to its end is dropped when half of its company has.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from armdesign.arrays import Array

SAFETY, SHRINK, GROW = 0.9, 0.2, 5.0
FIRST_STEP = 1e-4  # [s], at most
STABLE = (
    0.8  # ω h up to which an undamped oscillation does not grow by itself (the limit is 0.95), though no error shows
)


class System(Protocol):
    """ẏ = f(t, y) of n cases; cases can be picked."""

    def rates(self, time: Array, state: Array) -> Array:
        """ẏ (n, m) at times (n,) [s] and states (n, m); not finite where there is none."""

    def picked(self, cases: Sequence[int]) -> System:
        """The system of some of the cases."""


class GaveUpError(Exception):
    """A case cannot go on: which, at what time [s] and state, and why."""

    def __init__(self, case: int, time: float, state: Array, cause: str) -> None:
        super().__init__(cause)
        self.case, self.time, self.state, self.cause = case, time, state.copy(), cause


@dataclass
class _Records:
    """States at evenly spaced instants of every case."""

    states: list[Array]
    spacing: Array
    done: Array

    @classmethod
    def of(cls, start: Array, durations: Array, counts: Array) -> _Records:
        states = [np.empty((int(count) + 1, start.shape[1])) for count in counts]
        for rows, state in zip(states, start, strict=True):
            rows[0] = state
        return cls(states, durations / counts, np.zeros(len(counts), dtype=int))

    def keep(self, cases: Array, time: Array, step: Array, state: Array, slopes: Array, interpolant: Array) -> None:
        """Record what lies within a step of some cases: y(t + θ h) = y + h Σ_k K_k P_kj θ^j."""
        passed = np.minimum(np.floor((time + step) / self.spacing[cases] * (1 + 1e-12)), self._last(cases)).astype(int)
        count = passed - self.done[cases]
        if not count.any():
            return
        rows = np.repeat(np.arange(len(cases)), count)
        number = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count) + self.done[cases][rows] + 1
        share = (number * self.spacing[cases][rows] - time[rows]) / step[rows]
        weights = (share[:, None] ** np.arange(1, interpolant.shape[1] + 1)) @ interpolant.T
        values = state[rows] + step[rows, None] * np.einsum("rk,krm->rm", weights, slopes[:, rows])
        start = 0
        for case, first, n in zip(cases.tolist(), self.done[cases].tolist(), count.tolist(), strict=True):
            self.states[case][first + 1 : first + 1 + n] = values[start : start + n]
            start += n
        self.done[cases] = passed

    def _last(self, cases: Array) -> Array:
        return np.array([len(self.states[case]) - 1 for case in cases])


def integrate(
    system: System, start: Array, durations: Array, counts: Array, fastest: Array, tolerance: float, most_steps: int
) -> list[Array]:
    """States (count + 1, m) of every case at evenly spaced instants from 0 to its duration.

    Args:
        system: the cases.
        start: states (n, m) at t = 0.
        durations: (n,) [s].
        counts: intervals between records (n,).
        fastest: largest ω of undamped oscillations (n,) [rad/s]; 0: none.
        tolerance: of a step's error, root of the mean square over the states of a case: relative and absolute.
        most_steps: that a case may take.

    Raises:
        GaveUpError: steps became too small or too many.
    """
    from scipy.integrate import RK45

    most = STABLE / np.maximum(fastest, STABLE / durations)
    records, cases = _Records.of(start, durations, counts), np.arange(len(start))
    time, state, alive = np.zeros(len(start)), start.copy(), np.ones(len(start), dtype=bool)
    with np.errstate(all="ignore"):  # what is not finite is a step too far, and taken back
        slope = system.rates(time, state)
        step = np.minimum(FIRST_STEP, durations)
        for _ in range(most_steps):
            step = np.where(alive, np.minimum(np.minimum(step, most), durations[cases] - time), 0.0)
            slopes, after, error = _attempt(system, time, state, slope, step, RK45)
            scale = tolerance * (1 + np.maximum(np.abs(state), np.abs(after)))
            norm = np.sqrt(np.mean((error / scale) ** 2, axis=1))
            taken = np.flatnonzero((norm < 1) & alive)
            records.keep(cases[taken], time[taken], step[taken], state[taken], slopes[:, taken], RK45.P)
            time[taken] += step[taken]
            state[taken], slope[taken] = after[taken], slopes[-1][taken]
            factor = SAFETY * np.maximum(norm, 1e-10) ** -0.2
            step = step * np.where(np.isfinite(norm), np.clip(factor, SHRINK, GROW), SHRINK)
            _refuse_standstill(cases, time, state, step, alive & (norm >= 1) | ~np.isfinite(norm) & alive)
            alive = time < durations[cases] * (1 - 1e-14)
            if not alive.any():
                return records.states
            if 2 * alive.sum() <= len(alive):
                left = np.flatnonzero(alive)
                system, cases = system.picked(left.tolist()), cases[left]
                time, state, slope, step = time[left], state[left], slope[left], step[left]
                alive, most = alive[left], most[left]
    worst = int(np.argmin(time / durations[cases]))
    raise GaveUpError(int(cases[worst]), float(time[worst]), state[worst], f"more than {most_steps} steps")


def _attempt(
    system: System, time: Array, state: Array, slope: Array, step: Array, tableau: Callable[..., object]
) -> tuple[Array, Array, Array]:
    """Slopes (7, n, m) of a step, the state after it and the estimate of its error."""
    n, m = state.shape
    slopes = np.empty((7, n, m))
    flat, height = slopes.reshape(7, -1), step[:, None]
    slopes[0] = slope
    for stage in range(1, 6):
        change = (tableau.A[stage, :stage] @ flat[:stage]).reshape(n, m)  # type: ignore[attr-defined]
        slopes[stage] = system.rates(time + tableau.C[stage] * step, state + height * change)  # type: ignore[attr-defined]
    after = state + height * (tableau.B @ flat[:6]).reshape(n, m)  # type: ignore[attr-defined]
    slopes[6] = system.rates(time + step, after)
    return slopes, after, height * (tableau.E @ flat).reshape(n, m)  # type: ignore[attr-defined]


def _refuse_standstill(cases: Array, time: Array, state: Array, step: Array, refused: Array) -> None:
    small = refused & (step < 1e-14 * np.maximum(time, 1.0))
    if small.any():
        worst = int(np.argmax(small))
        raise GaveUpError(int(cases[worst]), float(time[worst]), state[worst], "no step is small enough")
