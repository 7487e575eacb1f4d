"""Steps of many cases at once by Dormand and Prince's pair of order 5(4) (1980), compiled.

The tableau and the interpolant are scipy's RK45. Each case has its own instant, step and error
norm, so it comes out as if it were alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np

from armdesign.arrays import Array, Flags
from armdesign.simulation.plant.compiled import borrowing, within

Between: TypeAlias = Callable[[Array], Array]  # states (m, k) at times (k,) [s]
INSTANT = 1e-14  # [s, relative beyond 1 s] of time, so short that rates may jump within
SAFETY, SHRINK, GROW = 0.9, 0.2, 5.0
MOST_JUMPS = 50  # unannounced, one right after the other


class Running(NamedTuple):
    """Cases under way: one row of every array each."""

    case: Array  # number of the case
    end: Array  # of its run [s]
    longest: Array  # step wherever its command may jump unannounced [s]
    most: Array  # step at all, by stability [s]
    needed: Array  # step that its oscillations need [s]
    time: Array  # reached [s]
    state: Array  # there (n, m)
    slope: Array  # rates there (n, m)
    low: Array  # when rates of its stretch are evaluated first [s]
    high: Array  # and last [s]
    stop: Array  # end of its stretch [s]
    step: Array  # next step [s]; 0: halted
    size: Array  # next step but for the stop [s]
    jumps: Array  # steps as short as an instant, one right after the other
    landed: Array  # stops reached since the last look at stiffness
    before: Array  # time then [s]

    @property
    def under_way(self) -> Flags:
        """Flags of cases that are not at their end (n,)."""
        return np.asarray(self.time < self.end)


class Tableau(NamedTuple):
    """Coefficients of the pair."""

    nodes: Array  # c of the stages after the first (6,)
    weights: Array  # a of these stages (6, 6), below the diagonal; the last row is b
    error: Array  # b less the weights of order 4 (7,)
    interpolant: Array  # P (7, 4)

    @classmethod
    def of_scipy(cls) -> Tableau:
        """The tableau of scipy's RK45."""
        from scipy.integrate import RK45

        weights = np.zeros((6, 6))
        weights[:5, :5], weights[5] = np.asarray(RK45.A)[1:], RK45.B
        nodes = np.array([*RK45.C[1:], 1.0])
        return cls(nodes, weights, np.array(RK45.E), np.array(RK45.P))


class Stages(NamedTuple):
    """Scratch of a step of n cases, whose slopes at its beginning are the first ones."""

    slopes: Array  # K (7, n, m)
    ahead: Array  # state of the stage at work (n, m)
    at: Array  # instants of the stages after the first (6, n) [s]

    @classmethod
    def like(cls, state: Array) -> Stages:
        """Scratch for states (n, m)."""
        n = len(state)
        return cls(np.empty((7, *state.shape)), np.empty_like(state), np.empty((6, n)))


class Steps(NamedTuple):
    """Everything that steps read and write."""

    tableau: Tableau
    rows: Running
    stages: Stages
    records: Records
    tolerance: float  # of a step's error, relative and absolute


class Records(NamedTuple):
    """States at evenly spaced instants of every case, one case below the other."""

    states: Array  # (rows, m)
    first: Array  # row of each case's start
    last: Array  # row of its end
    spacing: Array  # between its records [s]
    done: Array  # row filled last

    @classmethod
    def of(cls, start: Array, durations: Array, counts: Array) -> Records:
        """Empty but for the start."""
        ends = np.cumsum(counts + 1)
        first = ends - counts - 1
        states = np.empty((ends[-1], start.shape[1]))
        states[first] = start
        return cls(states, first, ends - 1, durations / counts, first.copy())

    def split(self) -> list[Array]:
        """States of each case."""
        rows = zip(self.first.tolist(), self.last.tolist(), strict=True)
        return [self.states[first : last + 1] for first, last in rows]

    def fill(self, case: int, time: float, between: Callable[[], Between]) -> None:
        """Record a case up to a time [s].

        Args:
            case: its number.
            time: reached [s].
            between: gives its states at times since the row filled last.
        """
        first, spacing = int(self.first[case]), float(self.spacing[case])
        done = int(self.done[case])
        passed = min(first + int(time / spacing * (1 + 1e-12)), int(self.last[case]))
        if passed > done:
            instants = np.minimum(spacing * np.arange(done + 1 - first, passed + 1 - first), time)
            self.states[done + 1 : passed + 1], self.done[case] = between()(instants).T, passed


@within
def begin_steps(steps: Steps) -> None:
    """Write the first slopes, and the instants t + c h of the stages, within their stretches."""
    rows, stages = steps.rows, steps.stages
    n, m = rows.state.shape
    for case in range(n):
        for stage in range(6):
            time = rows.time[case] + steps.tableau.nodes[stage] * rows.step[case]
            stages.at[stage, case] = min(max(time, rows.low[case]), rows.high[case])
        for i in range(m):
            stages.slopes[0, case, i] = rows.slope[case, i]


@within
def place_stage(stage: int, steps: Steps) -> None:
    """Write y + h Σ_k a_k K_k of every case, the state of a stage 0…5 after the first."""
    tableau, rows, stages = steps.tableau, steps.rows, steps.stages
    n, m = rows.state.shape
    for case in range(n):
        for i in range(m):
            change = 0.0
            for k in range(stage + 1):
                change += tableau.weights[stage, k] * stages.slopes[k, case, i]
            stages.ahead[case, i] = rows.state[case, i] + rows.step[case] * change


@within
def finish_steps(steps: Steps) -> int:
    """Take or refuse the step of every case by its error, and choose the size of the next one.

    A step as short as an instant is taken whatever its error, as the rates jump within; ``jumps``
    counts how many such were taken on end. Returns how many cases have halted: they have come to
    their stop, or are stuck.
    """
    rows, halted = steps.rows, 0
    for row in range(len(rows.step)):
        h = rows.step[row]
        if h == 0.0:
            continue
        norm = _error_norm(row, steps) / steps.tolerance
        finite, instant = math.isfinite(norm), INSTANT * max(rows.time[row], 1.0)
        jumping = norm >= 1 and finite and h <= 2 * instant
        rows.jumps[row] = rows.jumps[row] + 1 if jumping else 0
        taken = norm < 1 or 0 < rows.jumps[row] <= MOST_JUMPS
        if taken:
            _take_step(row, steps)
        factor = SHRINK
        if finite:
            factor = min(max(SAFETY * max(norm, 1e-10) ** -0.2, SHRINK), GROW)
        wanted = min(h * factor, rows.most[row])
        if finite:
            wanted = max(wanted, instant)
        stuck = not taken and (rows.jumps[row] > 0 or not (finite or h * factor >= instant))
        rows.size[row] = max(wanted, rows.size[row]) if taken and h < rows.size[row] else wanted
        rows.step[row] = 0.0 if stuck else min(rows.size[row], rows.stop[row] - rows.time[row])
        if rows.step[row] == 0.0:
            halted += 1
    return halted


@within
def _error_norm(row: int, steps: Steps) -> float:
    """Root mean square of a step's error, relative and absolute."""
    tableau, rows, stages = steps.tableau, steps.rows, steps.stages
    total, m = 0.0, rows.state.shape[1]
    for i in range(m):
        error = 0.0
        for k in range(7):
            error += tableau.error[k] * stages.slopes[k, row, i]
        largest = max(abs(rows.state[row, i]), abs(stages.ahead[row, i]))
        total += (rows.step[row] * error / (1 + largest)) ** 2
    return math.sqrt(total / m)


@within
def _take_step(row: int, steps: Steps) -> None:
    """Move a case ahead, and record what lies within: y(t + θ h) = y + h Σ_k K_k Σ_j P_kj θ^j."""
    tableau, rows, stages, records = steps.tableau, steps.rows, steps.stages, steps.records
    begin, h, case = rows.time[row], rows.step[row], rows.case[row]
    reached = rows.stop[row] - (begin + h) < 1e-14 * rows.stop[row]
    rows.time[row] = rows.stop[row] if reached else begin + h
    first, spacing = records.first[case], records.spacing[case]
    passed = first + int(rows.time[row] / spacing * (1 + 1e-12))
    for record in range(records.done[case] + 1, min(passed, records.last[case]) + 1):
        share = ((record - first) * spacing - begin) / h
        for i in range(rows.state.shape[1]):
            change = 0.0
            for k in range(7):
                weight = tableau.interpolant[k, 3]
                for power in range(2, -1, -1):
                    weight = weight * share + tableau.interpolant[k, power]
                change += weight * share * stages.slopes[k, row, i]
            records.states[record, i] = rows.state[row, i] + h * change
        records.done[case] = record
    for i in range(rows.state.shape[1]):
        rows.state[row, i], rows.slope[row, i] = stages.ahead[row, i], stages.slopes[6, row, i]


# for systems whose rates are not compiled
BEGIN, PLACE, FINISH = borrowing(begin_steps), borrowing(place_stage), borrowing(finish_steps)
