"""Many initial value problems at once, each with its own steps: ``integrate``.

Dormand and Prince's pair of order 5(4) (1980), with the tableau and the interpolant of scipy's
RK45. All cases take a step at the same time, but each one has its own instant, step and error
norm: so a case comes out as if it were alone, whatever its company, one that meets a kink or a
stop does not slow the others, and no error hides in a mean over cases. A case that has come to its
end, or cannot go on, is dropped when half of its company has. A case that turns stiff (a wide open
valve that passes hardly any drop, a fast spool, a piston in dry friction) is finished by LSODA
alone.

No step sees a jump of the rates that is told beforehand: it ends at a ``Breaks`` instant, and the
next one begins there. Rates on the way are asked for just inside of it, so it does not matter to
which side the instant itself counts. A jump that nobody told is found by steps that fail until
they are as short as time can be told; that one is taken.
"""

from __future__ import annotations

import math
import warnings
from collections import Counter, deque
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from armdesign.arrays import Array
from armdesign.simulation.plant.compiled import compiled

WINDOW, STIFF = (
    300,
    20.0,
)  # a case is stiff when its steps over a window are this much shorter than stability asks
NOT_FINITE = (
    "the rates beyond are no numbers: a four-bar has opened, or numbers grew without bound, or a"
    " command is none"
)
NO_LIMIT = "the rates grow, or jump again and again, whatever the step"
TOO_MANY = "more than"
SAFETY, SHRINK, GROW = 0.9, 0.2, 5.0
FIRST_STEP = 1e-4  # [s], at most
INSTANT = 1e-14  # [s, relative beyond 1 s] of time, so short that rates may jump within
MOST_JUMPS = 50  # told by nobody, one right after the other
HELD = 4.0  # a case whose steps are held short is stiff when they are this much shorter still
LANDING = 8  # steps that growing again after a break may take
_ROWS = (
    *(
        "cases",
        "ends",
        "longest",
        "most",
        "needed",
        "time",
        "state",
        "slope",
        "low",
        "high",
        "stop",
        "step",
        "size",
    ),
    *("jumps", "landed", "_before"),
)  # arrays of a ``_Front`` that have a row per case
# ω h at which no undamped oscillation grows by itself (the limit is 0.95), though no error shows
STABLE = 0.8


class System(Protocol):
    """ẏ = f(t, y) of n cases; cases can be picked."""

    def rates(self, time: Array, state: Array) -> Array:
        """ẏ (n, m) at times (n,) [s] and states (n, m); not finite where there is none."""

    def picked(self, cases: Sequence[int]) -> System:
        """The system of some of the cases."""


class Breaks(NamedTuple):
    """When the rates of a case jump, or one of their derivatives does.

    Attributes:
        instants: ascending [s]; those outside of the run do not matter.
        complete: whether there are no others. Else steps are held to half the interval between
            records, so that nothing longer than half of that passes unseen, though the case be at
            rest.
        driver: what other breaks come from, as a function of time; steps then are held so only
            where it bends, seen at quarters of the interval. None: unknown, they always are.
    """

    instants: Sequence[float] = ()
    complete: bool = False
    driver: Callable[[float], Sequence[float]] | None = None


class GaveUpError(Exception):
    """A case cannot go on: at what time [s] and state, and why."""

    def __init__(self, time: float, state: Array, cause: str) -> None:
        super().__init__(cause)
        self.time, self.state, self.cause = time, state.copy(), cause


class _Records(NamedTuple):
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
        return [
            self.states[a : b + 1]
            for a, b in zip(self.first.tolist(), self.last.tolist(), strict=True)
        ]

    def fill(self, case: int, time: float, between: Callable[[Array], Array]) -> None:
        """Record a case up to a time [s], by its states (m, k) at times (k,) since the row filled last."""
        first, spacing, done = (
            int(self.first[case]),
            float(self.spacing[case]),
            int(self.done[case]),
        )
        passed = min(first + int(time / spacing * (1 + 1e-12)), int(self.last[case]))
        if passed > done:
            instants = np.minimum(spacing * np.arange(done + 1 - first, passed + 1 - first), time)
            self.states[done + 1 : passed + 1], self.done[case] = between(instants).T, passed


def integrate(
    system: System,
    start: Array,
    durations: Array,
    counts: Array,
    fastest: Array,
    tolerance: float,
    most_steps: int,
    swiftest: Array | None = None,
    breaks: Sequence[Breaks] | None = None,
) -> list[Array | GaveUpError]:
    """States (count + 1, m) of every case at evenly spaced instants from 0 to its duration.

    Where steps become too small or too many there is an error in their place, and the other cases
    go on.

    Args:
        system: the cases.
        start: states (n, m) at t = 0.
        durations: (n,) [s].
        counts: intervals between records (n,).
        fastest: largest ω of undamped oscillations (n,) [rad/s]; 0: none.
        tolerance: of a step's error, root of the mean square over the states of a case: relative
            and absolute.
        most_steps: that a case may take.
        swiftest: largest ω of damped ones, too, that steps may have to follow (n,) [rad/s]; None:
            ``fastest``.
        breaks: of every case; None: unknown.
    """
    records = _Records.of(start, durations, counts)
    breaks = [Breaks()] * len(start) if breaks is None else breaks
    longest = np.where([each.complete for each in breaks], np.inf, records.spacing / 2)
    stretches = [
        _stretches(each.instants, end)
        for each, end in zip(breaks, durations.tolist(), strict=True)
    ]
    drivers = [each.driver for each in breaks]
    pace = longest, fastest, fastest if swiftest is None else swiftest
    front = _Front(system, start, stretches, drivers, pace, tolerance)
    with np.errstate(all="ignore"):  # what is not finite is a step too far, and taken back
        front.begin(range(len(start)))
        for number in range(1, most_steps + 1):
            front.advance(records)
            if number % WINDOW == 0:
                front.finish_stiff(records, 7 * most_steps)
            if front.drop_finished():
                break
    for row in front.under_way():
        front.give_up(row, f"{TOO_MANY} {most_steps} steps")
    return [front.errors.get(case, states) for case, states in enumerate(records.split())]


class _Stretch(NamedTuple):
    """Time without a break."""

    low: float  # [s] where rates are asked for first
    high: float  # and last
    stop: float


def _stretches(instants: Sequence[float], end: float) -> list[_Stretch]:
    """All of a case, the first one last.

    Instants closer to each other than time can be told count as one.
    """
    found, low = [], 0.0
    for instant in (float(t) for t in instants if 0 <= t <= end):
        room = INSTANT * max(instant, 1.0)
        if instant - low > 4 * room:
            found.append(_Stretch(low, instant - room, instant))
        low = instant + room
    if not found or end - low > 4 * INSTANT * max(end, 1.0):
        found.append(_Stretch(low, math.inf, end))
    else:
        found[-1] = found[-1]._replace(stop=end)
    return found[::-1]


class _Front:
    """Where the cases are that are still under way."""

    def __init__(
        self,
        system: System,
        start: Array,
        stretches: list[list[_Stretch]],
        drivers: Sequence[Callable[[float], Sequence[float]] | None],
        pace: tuple[Array, Array, Array],
        tolerance: float,
    ) -> None:
        from scipy.integrate import RK45

        self.longest, fastest, swiftest = pace
        n, self.system, self.tolerance, self._drivers = len(start), system, tolerance, drivers
        self.cases, self.ends = np.arange(n), np.array([parts[0].stop for parts in stretches])
        self.errors: dict[int, GaveUpError] = {}
        self.most = STABLE / np.maximum(fastest, STABLE / self.ends)
        self.needed = np.minimum(self.most, STABLE / np.maximum(swiftest, STABLE / self.ends))
        self.needed = np.minimum(self.needed, STIFF / HELD * self.longest)
        self.most = np.where(
            [driver is None for driver in drivers], np.minimum(self.most, self.longest), self.most
        )
        self.time, self.state, self.slope = np.zeros(n), start.copy(), np.zeros_like(start)
        self.low, self.high, self.stop = np.zeros(n), np.zeros(n), np.zeros(n)
        self.step, self.size = (
            np.zeros(n),
            np.minimum(self.most, FIRST_STEP),
        )  # size: but for the next stop
        self.jumps, self.landed = np.zeros(n, dtype=int), np.zeros(n, dtype=int)
        self._before, self._left, self._asked = self.time.copy(), stretches, Counter[int]()
        weights = [np.ascontiguousarray(RK45.A[stage, :stage]) for stage in range(1, 6)]
        self._stages = [*zip(RK45.C[1:].tolist(), weights, strict=True), (1.0, np.asarray(RK45.B))]
        self._error, self._interpolant = np.asarray(RK45.E), np.asarray(RK45.P)

    def begin(self, rows: Sequence[int]) -> None:
        """Let some rows enter their next stretch: with rates anew, and with short steps if these have jumped."""
        for row in rows:
            self.low[row], self.high[row], self.stop[row] = self._left[self.cases[row]].pop()
        slope = self.system.rates(np.maximum(self.time, self.low), self.state)
        for row in rows:
            change = (
                self.size[row] * (slope[row] - self.slope[row]) / (1 + np.abs(self.state[row]))
            )
            if not np.sqrt(np.mean(change**2)) < self.tolerance:
                self.size[row] = min(self.size[row], FIRST_STEP)
            self.slope[row] = slope[row]
            self.step[row] = min(self.size[row], self.stop[row] - self.time[row])

    def advance(self, records: _Records) -> None:
        """One step of every case, taken or refused."""
        for row in np.flatnonzero(self.step > self.longest).tolist():
            self.step[row] = self._foreseen(row)
        slopes, ahead, at = (
            np.empty((7, *self.state.shape)),
            np.empty_like(self.state),
            np.empty_like(self.time),
        )
        slopes[0] = self.slope
        for stage, (share, weights) in enumerate(self._stages, start=1):
            _step_ahead(
                slopes,
                weights,
                self.state,
                self.step,
                ahead,
                share,
                self.time,
                self.low,
                self.high,
                at,
            )
            slopes[stage] = self.system.rates(at, ahead)
        own = (
            self.stop,
            self.most,
            self.time,
            self.state,
            self.slope,
            self.step,
            self.size,
            self.jumps,
        )
        if _settle(
            slopes,
            ahead,
            self.tolerance,
            self._error,
            self._interpolant,
            self.cases,
            *own,
            *records,
        ):
            self._go_on()

    def _foreseen(self, row: int) -> float:
        """The step, or as much of it as the driver is smooth in, but no less than the longest across a bend.

        Smooth is what differs from cubics by less than the tolerance, seen at quarters of the
        interval of records.
        """
        driver, own = (
            self._drivers[self.cases[row]],
            (self.time, self.step, self.longest, self.low, self.high),
        )
        begin, step, longest, low, high = (float(values[row]) for values in own)
        grid = longest / 2
        count = min(max(math.ceil(step / grid), 4), int((self.stop[row] - begin) / grid))
        seen = [
            tuple(driver(min(max(begin + k * grid, low), high))) if driver else ()
            for k in range(count + 1)
        ]
        if seen.count(seen[0]) == len(seen):
            return step
        bends = np.abs(np.diff(np.array(seen, dtype=float), 4, axis=0)).max(axis=1)
        bent = np.flatnonzero(~(bends <= self.tolerance))
        if len(bends) and not len(bent):
            return step
        return max((int(bent[0]) + 3) * grid, longest) if len(bent) and bent[0] else longest

    def _go_on(self) -> None:
        """What has come to a break enters the next stretch, what is stuck gives up."""
        halted = [row for row in self.under_way() if self.step[row] == 0]
        landed = [row for row in halted if self.time[row] == self.stop[row]]
        self.landed[landed] += 1
        self.begin(landed)
        for row in set(halted) - set(landed):
            self.give_up(
                row, f"no step is small enough: {NO_LIMIT if self.jumps[row] else NOT_FINITE}"
            )

    def finish_stiff(self, records: _Records, most: int) -> None:
        """Finish those whose steps of late were far below what their oscillations need."""
        steps = np.maximum(WINDOW - LANDING * self.landed, 0)
        gained = self.time - self._before
        slow = gained < steps * self.needed / STIFF
        self._before, self.landed[:] = self.time.copy(), 0
        for row in (row for row in self.under_way() if slow[row]):
            try:
                self._finish(row, records, most, float(gained[row]))
            except GaveUpError as error:
                self.errors[int(self.cases[row])] = error
                self._end(row)

    def _finish(self, row: int, records: _Records, most: int, gained: float) -> None:
        """The rest of a case by LSODA.

        Where that cannot go on the explicit pair takes over for a while.

        So it does where LSODA gains less time [s] in a window of steps than the explicit pair
        ``gained`` before.

        Raises:
            GaveUpError: it takes too many evaluations.
        """
        alone, case = self.system.picked([row]), int(self.cases[row])

        def rates(time: float, at: Array) -> Array:
            self._asked[case] += 1
            if self._asked[case] > most:
                raise GaveUpError(
                    self.time[row], self.state[row], f"{TOO_MANY} {most} evaluations"
                )
            inside = min(max(time, self.low[row]), self.high[row])
            return alone.rates(np.array([inside]), at[None])[0]

        def taken(time: float, state: Array, between: Callable[[Array], Array]) -> None:
            self.time[row], self.state[row] = time, state
            records.fill(case, time, between)

        limits = self.longest[row], self.tolerance, gained
        while _implicitly(rates, taken, self.time[row], self.stop[row], self.state[row], limits):
            self.time[row] = self.stop[row]
            if self.time[row] == self.ends[row]:
                break
            self.begin([row])
        else:
            self.slope[row] = rates(self.time[row], self.state[row])
            self.size[row], self._before[row] = min(FIRST_STEP, self.most[row]), self.time[row]
        self.step[row] = min(self.size[row], self.stop[row] - self.time[row])

    def under_way(self) -> list[int]:
        """Rows that are not at their end."""
        return [int(row) for row in np.flatnonzero(self.time < self.ends)]

    def drop_finished(self) -> bool:
        """Let go of cases at their end once they are half of all; whether all are."""
        left = self.under_way()
        if 0 < 2 * len(left) <= len(self.time):
            self.system = self.system.picked(left)
            for name in _ROWS:
                setattr(self, name, getattr(self, name)[left])
        return len(left) == 0

    def give_up(self, row: int, cause: str) -> None:
        """End a case that cannot go on with an error."""
        self.errors[int(self.cases[row])] = GaveUpError(
            float(self.time[row]), self.state[row], cause
        )
        self._end(row)

    def _end(self, row: int) -> None:
        self.time[row], self.step[row] = self.ends[row], 0.0


@compiled
def _step_ahead(
    slopes: Any,
    weights: Any,
    state: Any,
    step: Any,
    ahead: Any,
    share: float,
    time: Any,
    low: Any,
    high: Any,
    at: Any,
) -> None:
    """Y + h Σ_k a_k K_k of every case, and its time t + c h within its stretch."""
    n, m = state.shape
    for case in range(n):
        at[case] = min(max(time[case] + share * step[case], low[case]), high[case])
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
    stops: Any,
    most: Any,
    time: Any,
    state: Any,
    slope: Any,
    step: Any,
    size: Any,
    jumps: Any,
    records: Any,
    first: Any,
    last: Any,
    spacing: Any,
    done: Any,
) -> int:
    """Take or refuse the step of every case, by the estimate of its error, and choose the next one's size.

    What lies within a step is recorded by y(t + θ h) = y + h Σ_k K_k Σ_j P_kj θ^j. A step as short
    as an instant is taken whatever its error, as the rates jump within; ``jumps`` counts how many
    such were taken on end. Returns how many cases have no next step, as they have come to their
    stop, or are stuck.
    """
    n, m = state.shape
    halted = 0
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
        begin = time[case]
        instant = INSTANT * max(begin, 1.0)
        jumps[case] = (
            jumps[case] + 1 if norm >= 1 and math.isfinite(norm) and h <= 2 * instant else 0
        )
        taken = norm < 1 or 0 < jumps[case] <= MOST_JUMPS
        if taken:
            row = cases[case]
            reached = stops[case] - (begin + h) < 1e-14 * stops[case]
            time[case] = stops[case] if reached else begin + h
            passed = first[row] + int(time[case] / spacing[row] * (1 + 1e-12))
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
            state[case], slope[case] = ahead[case], slopes[6, case]
        factor = (
            min(max(SAFETY * max(norm, 1e-10) ** -0.2, SHRINK), GROW)
            if math.isfinite(norm)
            else SHRINK
        )
        wanted = min(h * factor, most[case])
        if math.isfinite(norm):
            wanted = max(wanted, instant)
        stuck = not taken and (
            jumps[case] > 0 or not (math.isfinite(norm) or h * factor >= instant)
        )
        size[case] = max(wanted, size[case]) if taken and h < size[case] else wanted
        step[case] = 0.0 if stuck else min(size[case], stops[case] - time[case])
        if step[case] == 0.0:
            halted += 1
    return halted


def _implicitly(
    rates: Callable[[float, Array], Array],
    taken: Callable[[float, Array, Callable[[Array], Array]], None],
    begin: float,
    end: float,
    state: Array,
    limits: tuple[float, float, float],
) -> bool:
    """One case from ``begin`` to ``end`` by LSODA (Petzold 1983), which turns implicit by itself, and back.

    Every step is told to ``taken``: its end, the state there and what gives states (m, k) at times
    within it. ``limits``: longest step [s], tolerance, and the time [s] to gain in a window of
    steps. Returns whether ``end`` was reached; if not, LSODA has failed, met a jump or rates that
    are no numbers, or gained too little: a jump taken for steep rates keeps its steps short for
    ever.
    """
    from scipy.integrate import LSODA

    longest, tolerance, gained = limits

    def finite(time: float, at: Array) -> Array:
        found = rates(time, at)
        if not np.all(np.isfinite(found)):
            raise FloatingPointError
        return found

    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore"
        )  # LSODA warns and fails; what comes of it is told by who goes on
        try:
            first, marks = min(FIRST_STEP, longest, end - begin), deque[float](maxlen=WINDOW)
            solver = LSODA(
                finite, begin, state, end, first, max_step=longest, rtol=tolerance, atol=tolerance
            )
            while solver.status == "running":
                marks.append(solver.t)
                solver.step()
                if solver.status == "failed" or solver.t - solver.t_old < INSTANT * max(
                    solver.t, 1.0
                ):
                    return False
                taken(solver.t, solver.y.copy(), solver.dense_output())
                if (
                    len(marks) == WINDOW
                    and solver.status == "running"
                    and solver.t - marks[0] < gained
                ):
                    return False
        except FloatingPointError:
            return False
    return True
