"""Many initial value problems at once, each with its own steps: ``integrate``.

Dormand and Prince's pair of order 5(4) (1980), with the tableau and the interpolant of scipy's RK45. All cases take a
step at the same time, but each one has its own instant, step and error norm: so a case comes out as if it were alone,
whatever its company, one that meets a kink or a stop does not slow the others, and no error hides in a mean over cases.
A case that has come to its end is dropped when half of its company has. A case that turns stiff (a wide open valve that
passes hardly any pressure drop, a fast spool, a piston in dry friction) is finished by LSODA alone.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from armdesign.arrays import Array

WINDOW, STIFF = 300, 20.0  # a case is stiff when its steps over a window are this much shorter than stability asks
NOT_FINITE = "a four-bar has opened, or numbers grew without bound"
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
    system: System,
    start: Array,
    durations: Array,
    counts: Array,
    fastest: Array,
    tolerance: float,
    most_steps: int,
    swiftest: Array | None = None,
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
        swiftest: largest ω of damped ones, too, that steps may have to follow (n,) [rad/s]; None: ``fastest``.

    Raises:
        GaveUpError: steps became too small or too many.
    """
    front = _Front(system, start, durations, fastest, fastest if swiftest is None else swiftest)
    records = _Records.of(start, durations, counts)
    with np.errstate(all="ignore"):  # what is not finite is a step too far, and taken back
        front.slope = system.rates(front.time, front.state)
        for number in range(1, most_steps + 1):
            front.advance(records, tolerance)
            if number % WINDOW == 0:
                for row in front.stiff():
                    case, begin, at = int(front.cases[row]), float(front.time[row]), front.state[row]
                    _implicitly(front.system.picked([row]), case, begin, at, records, tolerance, 7 * most_steps)
                    front.time[row] = front.ends[row]
            if front.drop_finished():
                return records.states
    row = int(np.argmin(front.time / front.ends))
    raise front.gave_up(row, f"more than {most_steps} steps")


class _Front:
    """Where the cases are that are still under way."""

    def __init__(self, system: System, start: Array, durations: Array, fastest: Array, swiftest: Array) -> None:
        self.system, self.cases, self.ends = system, np.arange(len(start)), durations.astype(float)
        self.most = STABLE / np.maximum(fastest, STABLE / durations)
        self.needed = np.minimum(self.most, STABLE / np.maximum(swiftest, STABLE / durations))
        self.time, self.state, self.slope = np.zeros(len(start)), start.copy(), start
        self.step, self.alive = np.minimum(FIRST_STEP, durations), np.ones(len(start), dtype=bool)
        self._before = self.time.copy()

    def advance(self, records: _Records, tolerance: float) -> None:
        """One step of every case, taken or refused."""
        from scipy.integrate import RK45

        limit = np.minimum(self.most, self.ends - self.time)
        step = np.where(self.alive, np.minimum(self.step, limit), 0.0)
        slopes, after, error = _attempt(self.system, self.time, self.state, self.slope, step, RK45)
        scale = tolerance * (1 + np.maximum(np.abs(self.state), np.abs(after)))
        norm = np.sqrt(np.mean((error / scale) ** 2, axis=1))
        good = (norm < 1) & self.alive
        taken = np.flatnonzero(good)
        records.keep(self.cases[taken], self.time[taken], step[taken], self.state[taken], slopes[:, taken], RK45.P)
        self.time[taken] += step[taken]
        self.state[taken], self.slope[taken] = after[taken], slopes[-1][taken]
        factor = SAFETY * np.maximum(norm, 1e-10) ** -0.2
        self.step = step * np.where(np.isfinite(norm), np.clip(factor, SHRINK, GROW), SHRINK)
        stuck = self.alive & ~good & (self.step < 1e-14 * np.maximum(self.time, 1.0))
        if stuck.any():
            raise self.gave_up(int(np.argmax(stuck)), f"no step is small enough: {NOT_FINITE}")

    def stiff(self) -> list[int]:
        """Cases whose steps of late were far below what their oscillations need."""
        slow = self.alive & (self.time - self._before < WINDOW * self.needed / STIFF)
        self._before = self.time.copy()
        return [int(row) for row in np.flatnonzero(slow & (self.time < self.ends))]

    def drop_finished(self) -> bool:
        """Let go of cases at their end once they are half of all; whether all are."""
        self.alive = self.time < self.ends * (1 - 1e-14)
        if 2 * self.alive.sum() <= len(self.alive) and self.alive.any():
            left = np.flatnonzero(self.alive)
            self.system = self.system.picked(left.tolist())
            for name in ("cases", "ends", "most", "needed", "time", "state", "slope", "step", "alive", "_before"):
                setattr(self, name, getattr(self, name)[left])
        return not self.alive.any()

    def gave_up(self, row: int, cause: str) -> GaveUpError:
        """The error of a case that cannot go on."""
        return GaveUpError(int(self.cases[row]), float(self.time[row]), self.state[row], cause)


def _attempt(
    system: System, time: Array, state: Array, slope: Array, step: Array, tableau: Any
) -> tuple[Array, Array, Array]:
    """Slopes (7, n, m) of a step, the state after it and the estimate of its error."""
    n, m = state.shape
    slopes = np.empty((7, n, m))
    flat, height = slopes.reshape(7, -1), step[:, None]
    slopes[0] = slope
    for stage in range(1, 6):
        change = (tableau.A[stage, :stage] @ flat[:stage]).reshape(n, m)
        slopes[stage] = system.rates(time + tableau.C[stage] * step, state + height * change)
    after = state + height * (tableau.B @ flat[:6]).reshape(n, m)
    slopes[6] = system.rates(time + step, after)
    return slopes, after, height * (tableau.E @ flat).reshape(n, m)


def _implicitly(
    system: System, case: int, begin: float, state: Array, records: _Records, tolerance: float, most: int
) -> None:
    """The rest of one stiff case by LSODA (Petzold 1983), which turns implicit by itself, and back."""
    from scipy.integrate import solve_ivp

    states, done, spacing = records.states[case], int(records.done[case]), float(records.spacing[case])
    end, last, count = spacing * (len(states) - 1), (begin, state), 0

    def rates(time: float, at: Array) -> Array:
        nonlocal last, count
        found, count = system.rates(np.array([time]), at[None])[0], count + 1
        if count > most or not np.all(np.isfinite(found)):
            raise GaveUpError(case, *last, f"more than {most} evaluations" if count > most else NOT_FINITE)
        last = (time, at)
        return found

    instants = np.minimum(spacing * np.arange(done + 1, len(states)), end)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # LSODA warns and fails; the failure is reported
        run = solve_ivp(rates, (begin, end), state, method="LSODA", t_eval=instants, rtol=tolerance, atol=tolerance)
    if not run.success:
        raise GaveUpError(case, *last, str(run.message))
    states[done + 1 :], records.done[case] = run.y.T, len(states) - 1
