"""Many initial value problems at once, each with its own steps: ``integrate``.

Dormand and Prince's pair of order 5(4) (1980), with the tableau and the interpolant of scipy's RK45. All cases take a
step at the same time, but each one has its own instant, step and error norm: so a case comes out as if it were alone,
whatever its company, one that meets a kink or a stop does not slow the others, and no error hides in a mean over cases.
A case that has come to its end, or cannot go on, is dropped when half of its company has. A case that turns stiff
(a wide open valve that passes hardly any drop, a fast spool, a piston in dry friction) is finished by LSODA alone.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from armdesign.arrays import Array
from armdesign.simulation.compiled import compiled

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
    """A case cannot go on: at what time [s] and state, and why."""

    def __init__(self, time: float, state: Array, cause: str) -> None:
        super().__init__(cause)
        self.time, self.state, self.cause = time, state.copy(), cause


@dataclass
class _Records:
    """States at evenly spaced instants of every case, one case below the other."""

    states: Array  # (rows, m)
    first: Array  # row of each case's start
    last: Array
    spacing: Array  # [s]
    done: Array  # row filled last

    @classmethod
    def of(cls, start: Array, durations: Array, counts: Array) -> _Records:
        ends = np.cumsum(counts + 1)
        first = ends - counts - 1
        states = np.empty((ends[-1], start.shape[1]))
        states[first] = start
        return cls(states, first, ends - 1, durations / counts, first.copy())

    def split(self) -> list[Array]:
        """States of each case."""
        return [self.states[a : b + 1] for a, b in zip(self.first.tolist(), self.last.tolist(), strict=True)]


def integrate(
    system: System,
    start: Array,
    durations: Array,
    counts: Array,
    fastest: Array,
    tolerance: float,
    most_steps: int,
    swiftest: Array | None = None,
) -> list[Array | GaveUpError]:
    """States (count + 1, m) of every case at evenly spaced instants from 0 to its duration.

    Where steps become too small or too many there is an error in their place, and the other cases go on.

    Args:
        system: the cases.
        start: states (n, m) at t = 0.
        durations: (n,) [s].
        counts: intervals between records (n,).
        fastest: largest ω of undamped oscillations (n,) [rad/s]; 0: none.
        tolerance: of a step's error, root of the mean square over the states of a case: relative and absolute.
        most_steps: that a case may take.
        swiftest: largest ω of damped ones, too, that steps may have to follow (n,) [rad/s]; None: ``fastest``.
    """
    front = _Front(system, start, durations, fastest, fastest if swiftest is None else swiftest)
    records = _Records.of(start, durations, counts)
    with np.errstate(all="ignore"):  # what is not finite is a step too far, and taken back
        front.slope = system.rates(front.time, front.state)
        for number in range(1, most_steps + 1):
            front.advance(records, tolerance)
            if number % WINDOW == 0:
                front.finish_stiff(records, tolerance, 7 * most_steps)
            if front.drop_finished():
                break
    for row in front.under_way():
        front.give_up(row, f"more than {most_steps} steps")
    return [front.errors.get(case, states) for case, states in enumerate(records.split())]


class _Front:
    """Where the cases are that are still under way."""

    def __init__(self, system: System, start: Array, durations: Array, fastest: Array, swiftest: Array) -> None:
        from scipy.integrate import RK45

        self.system, self.cases, self.ends = system, np.arange(len(start)), durations.astype(float)
        self.errors: dict[int, GaveUpError] = {}
        self.most = STABLE / np.maximum(fastest, STABLE / durations)
        self.needed = np.minimum(self.most, STABLE / np.maximum(swiftest, STABLE / durations))
        self.time, self.state, self.slope = np.zeros(len(start)), start.copy(), start
        self.step = np.minimum(np.minimum(FIRST_STEP, self.most), durations)
        self._before = self.time.copy()
        weights = [np.ascontiguousarray(RK45.A[stage, :stage]) for stage in range(1, 6)]
        self._stages = [*zip(RK45.C[1:].tolist(), weights, strict=True), (1.0, np.asarray(RK45.B))]
        self._error, self._interpolant = np.asarray(RK45.E), np.asarray(RK45.P)

    def advance(self, records: _Records, tolerance: float) -> None:
        """One step of every case, taken or refused."""
        slopes, ahead = np.empty((7, *self.state.shape)), np.empty_like(self.state)
        slopes[0] = self.slope
        for stage, (share, weights) in enumerate(self._stages, start=1):
            _step_ahead(slopes, weights, self.state, self.step, ahead)
            slopes[stage] = self.system.rates(self.time + share * self.step, ahead)
        stuck = _settle(
            slopes,
            ahead,
            tolerance,
            self._error,
            self._interpolant,
            self.cases,
            self.ends,
            self.most,
            self.time,
            self.state,
            self.slope,
            self.step,
            records.states,
            records.first,
            records.last,
            records.spacing,
            records.done,
        )
        if stuck:
            for row in np.flatnonzero((self.step == 0) & (self.time < self.ends)).tolist():
                self.give_up(row, f"no step is small enough: {NOT_FINITE}")

    def finish_stiff(self, records: _Records, tolerance: float, most: int) -> None:
        """Finish those whose steps of late were far below what their oscillations need."""
        slow = self.time - self._before < WINDOW * self.needed / STIFF
        self._before = self.time.copy()
        for row in (row for row in self.under_way() if slow[row]):
            case, begin = int(self.cases[row]), float(self.time[row])
            try:
                _implicitly(self.system.picked([row]), case, begin, self.state[row], records, tolerance, most)
            except GaveUpError as error:
                self.errors[case] = error
            self._end(row)

    def under_way(self) -> list[int]:
        """Rows that are not at their end."""
        return [int(row) for row in np.flatnonzero(self.time < self.ends)]

    def drop_finished(self) -> bool:
        """Let go of cases at their end once they are half of all; whether all are."""
        left = self.under_way()
        if 0 < 2 * len(left) <= len(self.time):
            self.system = self.system.picked(left)
            for name in ("cases", "ends", "most", "needed", "time", "state", "slope", "step", "_before"):
                setattr(self, name, getattr(self, name)[left])
        return len(left) == 0

    def give_up(self, row: int, cause: str) -> None:
        """End a case that cannot go on with an error."""
        self.errors[int(self.cases[row])] = GaveUpError(float(self.time[row]), self.state[row], cause)
        self._end(row)

    def _end(self, row: int) -> None:
        self.time[row], self.step[row] = self.ends[row], 0.0


@compiled
def _step_ahead(slopes: Any, weights: Any, state: Any, step: Any, ahead: Any) -> None:
    """Y + h Σ_k a_k K_k of every case."""
    n, m = state.shape
    for case in range(n):
        for i in range(m):
            change = 0.0
            for k in range(len(weights)):
                change += weights[k] * slopes[k, case, i]
            ahead[case, i] = state[case, i] + step[case] * change


@compiled
def _settle(
    slopes: Any,
    ahead: Any,
    tolerance: float,
    error_weights: Any,
    interpolant: Any,
    cases: Any,
    ends: Any,
    most: Any,
    time: Any,
    state: Any,
    slope: Any,
    step: Any,
    records: Any,
    first: Any,
    last: Any,
    spacing: Any,
    done: Any,
) -> int:
    """Take or refuse the step of every case, by the estimate of its error, and choose the next one's size.

    What lies within a step is recorded by y(t + θ h) = y + h Σ_k K_k Σ_j P_kj θ^j. Returns how many cases are stuck:
    before their end no step is left to them.
    """
    n, m = state.shape
    stuck = 0
    for case in range(n):
        h = step[case]
        if h == 0.0:
            continue
        total = 0.0
        for i in range(m):
            error = 0.0
            for k in range(7):
                error += error_weights[k] * slopes[k, case, i]
            total += (h * error / (1 + max(abs(state[case, i]), abs(ahead[case, i])))) ** 2
        norm = math.sqrt(total / m) / tolerance
        if norm < 1:
            row, begin = cases[case], time[case]
            reached = ends[case] - (begin + h) < 1e-14 * ends[case]
            passed = last[row] if reached else first[row] + int((begin + h) / spacing[row] * (1 + 1e-12))
            for record in range(done[row] + 1, min(passed, last[row]) + 1):
                share = ((record - first[row]) * spacing[row] - begin) / h
                for i in range(m):
                    change = 0.0
                    for k in range(7):
                        weight = interpolant[k, 3]
                        for power in range(2, -1, -1):
                            weight = weight * share + interpolant[k, power]
                        change += weight * share * slopes[k, case, i]
                    records[record, i] = state[case, i] + h * change
                done[row] = record
            time[case] = ends[case] if reached else begin + h
            state[case], slope[case] = ahead[case], slopes[6, case]
        factor = min(max(SAFETY * max(norm, 1e-10) ** -0.2, SHRINK), GROW) if math.isfinite(norm) else SHRINK
        if not norm < 1 and h * factor < 1e-14 * max(time[case], 1.0):
            step[case], stuck = 0.0, stuck + 1
        else:
            step[case] = min(h * factor, most[case], ends[case] - time[case])
    return stuck


def _implicitly(
    system: System, case: int, begin: float, state: Array, records: _Records, tolerance: float, most: int
) -> None:
    """The rest of one stiff case by LSODA (Petzold 1983), which turns implicit by itself, and back.

    Raises:
        GaveUpError: it takes too many evaluations, or LSODA fails.
    """
    from scipy.integrate import solve_ivp

    states, spacing = records.split()[case], float(records.spacing[case])
    done = int(records.done[case] - records.first[case])
    end, last, count = spacing * (len(states) - 1), (begin, state), 0

    def rates(time: float, at: Array) -> Array:
        nonlocal last, count
        found, count = system.rates(np.array([time]), at[None])[0], count + 1
        if count > most or not np.all(np.isfinite(found)):
            raise GaveUpError(*last, f"more than {most} evaluations" if count > most else NOT_FINITE)
        last = (time, at)
        return found

    instants = np.minimum(spacing * np.arange(done + 1, len(states)), end)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # LSODA warns and fails; the failure is reported
        run = solve_ivp(rates, (begin, end), state, method="LSODA", t_eval=instants, rtol=tolerance, atol=tolerance)
    if not run.success:
        raise GaveUpError(*last, str(run.message))
    states[done + 1 :], records.done[case] = run.y.T, records.last[case]
