"""Many initial value problems at once, each with its own steps between its breakpoints.

All cases take a step of ``dormand_prince`` at the same time, but each one has its own instant,
step and error norm: so a case comes out as if it were alone, whatever its company, one that meets
a kink or a stop does not slow the others, and no error hides in a mean over cases. A case that has
come to its end, or cannot go on, is dropped. A case that turns stiff
(a wide open valve that passes hardly any drop, a fast spool, a piston in dry friction) is finished
by ``stiff`` alone.

No step sees a jump of the rates that is announced: it ends at a breakpoint, and the next one
begins there. Rates on the way are evaluated just inside of it, so it does not matter to which side
the instant itself counts. Where jumps may be unannounced, no step is longer than half the interval
between records; they are found by steps that fail until they are as short as time resolves, and
that one is taken.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from armdesign.arrays import Array
from armdesign.progress import rounds
from armdesign.simulation.dormand_prince import (
    BEGIN,
    FINISH,
    INSTANT,
    PLACE,
    Between,
    Records,
    Running,
    Stages,
    Steps,
    Tableau,
)
from armdesign.simulation.plant.compiled import resolved
from armdesign.simulation.stiff import FIRST_STEP, Limits, integrate_stiff


class Breaks(NamedTuple):
    """Instants at which the rates of a case, or a derivative of them, jump.

    Where they are not ``complete`` no step is longer than half the interval between records, so
    that nothing longer than half of that passes unseen, though the case be at rest.
    """

    instants: Sequence[float] = ()  # ascending [s]; those outside of the run do not matter
    complete: bool = False  # whether there are no others


class Stretch(NamedTuple):
    """Time without a breakpoint."""

    low: float  # when rates are evaluated first [s], just inside
    high: float  # when they are evaluated last [s]
    stop: float  # its end [s]


def stretches(instants: Sequence[float], end: float) -> list[Stretch]:
    """All stretches of a case, the first one last.

    Instants closer to each other than the resolution of time count as one.

    Args:
        instants: breakpoints, ascending [s].
        end: of the run [s].
    """
    parts, low = list[Stretch](), 0.0
    for instant in (float(t) for t in instants if 0 <= t <= end):
        room = INSTANT * max(instant, 1.0)
        if instant - low > 4 * room:
            parts.append(Stretch(low, instant - room, instant))
        low = instant + room
    if not parts or end - low > 4 * INSTANT * max(end, 1.0):
        parts.append(Stretch(low, math.inf, end))
    else:
        parts[-1] = parts[-1]._replace(stop=end)
    return parts[::-1]


WINDOW = 300  # steps over which a case is looked at
STIFF = 5.0  # so much shorter than stability asks are steps of a case that is stiff
FINER = 0.02  # of the tolerance, for LSODA: steps as stability asks are that exact
HELD = 4.0  # a case whose steps are held short is stiff when they are this much shorter still
LANDING = 8  # steps that growing again after a breakpoint may take
STABLE = 0.8  # ω h at which no undamped oscillation grows (the limit is 0.95), whatever its error
NOT_FINITE = (
    "the rates beyond are not finite: a four-bar has opened, a state grew without bound, or a"
    " command is not a number"
)
NO_LIMIT = "the rates grow, or jump again and again, whatever the step"
TOO_MANY = "more than"


class System(Protocol):
    """ẏ = f(t, y) of n cases; cases can be picked."""

    def rates(self, time: Array, state: Array) -> Array:
        """ẏ (n, m) at times (n,) [s] and states (n, m); not finite where there is none."""

    def picked(self, cases: Sequence[int]) -> System:
        """The system of some of the cases."""


@runtime_checkable
class Stepping(Protocol):
    """A system that takes steps itself, compiled."""

    @property
    def stiff(self) -> float:
        """As ``STIFF``: how much shorter steps must be, so that LSODA is faster."""

    def take_steps(self, most: int, steps: Steps) -> tuple[int, int]:
        """Take steps, at most so many, until a case has halted: how many, and cases halted."""


class Span(NamedTuple):
    """Durations of the cases (n,) [s], and the numbers of intervals between their records (n,)."""

    durations: Array
    counts: Array

    @classmethod
    def of(cls, durations: Sequence[float], rates: Sequence[float]) -> Span:
        """Durations [s] with so many records per second."""
        pairs = zip(durations, rates, strict=True)
        counts = [max(round(duration * rate), 1) for duration, rate in pairs]
        return cls(np.array(durations, dtype=float), np.array(counts))


class Pace(NamedTuple):
    """Largest ω of the oscillations of the cases."""

    undamped: Array  # largest ω of undamped oscillations (n,) [rad/s]; 0: none
    largest: Array  # ω of damped ones, too, that steps may have to follow (n,) [rad/s]


class GaveUpError(Exception):
    """A case cannot go on: at what time [s] and state, and why."""

    def __init__(self, time: float, state: Array, cause: str) -> None:
        super().__init__(cause)
        self.time, self.state, self.cause = time, state.copy(), cause


def integrate(
    system: System,
    start: Array,
    span: Span,
    pace: Pace,
    breaks: Sequence[Breaks],
    tolerance: float,
    most_steps: int,
) -> list[Array | GaveUpError]:
    """States (count + 1, m) of every case at evenly spaced instants from 0 to its duration.

    Where steps become too small or too many there is an error in their place, and the other cases
    go on.

    Args:
        system: the cases.
        start: states (n, m) at t = 0.
        span: durations and records.
        pace: largest frequencies.
        breaks: of every case.
        tolerance: of a step's error, root of the mean square over the states of a case: relative
            and absolute.
        most_steps: that a case may take.
    """
    stepper = _Stepper(system, start, span, pace, breaks, tolerance)
    # what is not finite is a step too far, and taken back
    with np.errstate(all="ignore"), rounds("run", len(start)) as finished:
        stepper.begin(range(len(start)))
        number = 0
        while number < most_steps:
            left = min(WINDOW - number % WINDOW, most_steps - number)
            taken, halted = stepper.advance(left)
            number += taken
            if number % WINDOW == 0:
                stepper.finish_stiff(7 * most_steps)
                finished(len(start) - len(stepper.under_way()))
                halted = True
            if halted and stepper.drop_finished():
                break
    for row in stepper.under_way():
        stepper.give_up(row, f"{TOO_MANY} {most_steps} steps")
    states = enumerate(stepper.records.split())
    return [stepper.errors.get(case, of_case) for case, of_case in states]


class _Stepper:
    """The cases that are still under way."""

    def __init__(
        self,
        system: System,
        start: Array,
        span: Span,
        pace: Pace,
        breaks: Sequence[Breaks],
        tolerance: float,
    ) -> None:
        n, self.system, self.tolerance = len(start), system, tolerance
        self._stiff = system.stiff if isinstance(system, Stepping) else STIFF
        self.records = Records.of(start, *span)
        self.errors: dict[int, GaveUpError] = {}
        ends = span.durations.tolist()
        self._left = [
            stretches(each.instants, end) for each, end in zip(breaks, ends, strict=True)
        ]
        end = np.array([parts[0].stop for parts in self._left])
        complete = [each.complete for each in breaks]
        longest = np.where(complete, np.inf, self.records.spacing / 2)
        most = STABLE / np.maximum(pace.undamped, STABLE / end)
        needed = np.minimum(most, STABLE / np.maximum(pace.largest, STABLE / end))
        needed = np.minimum(needed, self._stiff / HELD * longest)
        most = np.minimum(most, longest)
        time, low, high, stop, step, before = np.zeros((6, n))
        self.rows = Running(
            case=np.arange(n),
            end=end,
            longest=longest,
            most=most,
            needed=needed,
            time=time,
            state=start.copy(),
            slope=np.zeros_like(start),
            low=low,
            high=high,
            stop=stop,
            step=step,
            size=np.minimum(most, FIRST_STEP),
            jumps=np.zeros(n, dtype=int),
            landed=np.zeros(n, dtype=int),
            before=before,
        )
        self._evaluations = Counter[int]()
        self._tableau, self._stages = Tableau.of_scipy(), Stages.like(start)

    def begin(self, rows: Sequence[int]) -> None:
        """Let some rows enter their next stretch; with short steps if their rates jump."""
        at = self.rows
        for row in rows:
            at.low[row], at.high[row], at.stop[row] = self._left[at.case[row]].pop()
        slope = self.system.rates(np.maximum(at.time, at.low), at.state)
        for row in rows:
            change = at.size[row] * (slope[row] - at.slope[row]) / (1 + np.abs(at.state[row]))
            if not np.sqrt(np.mean(change**2)) < self.tolerance:
                at.size[row] = min(at.size[row], FIRST_STEP)
            at.slope[row] = slope[row]
            at.step[row] = min(at.size[row], at.stop[row] - at.time[row])

    @cached_property
    def _kernels(self) -> tuple[Callable[..., Any], ...]:
        """Compiled parts of a step, for the types that all calls here have."""
        steps = self._steps
        return (resolved(BEGIN, steps), resolved(PLACE, 0, steps), resolved(FINISH, steps))

    @property
    def _steps(self) -> Steps:
        return Steps(self._tableau, self.rows, self._stages, self.records, self.tolerance)

    def advance(self, most: int) -> tuple[int, bool]:
        """Steps of every case, each taken or refused, until one halts: how many, whether one has.

        At most so many; a system that does not take steps itself takes one.
        """
        if isinstance(self.system, Stepping):
            taken, halted = self.system.take_steps(most, self._steps)
        else:
            taken, halted = 1, self._take_one(self._steps)
        if halted:
            self._go_on()
        return taken, bool(halted)

    def _take_one(self, steps: Steps) -> int:
        """One step of every case, by rates that are not compiled: how many have halted."""
        begin, place, finish = self._kernels
        begin(steps)
        for stage, at in enumerate(steps.stages.at):
            place(stage, steps)
            steps.stages.slopes[stage + 1] = self.system.rates(at, steps.stages.ahead)
        halted: int = finish(steps)
        return halted

    def _go_on(self) -> None:
        """Let cases at a breakpoint enter their next stretch, and end those that are stuck."""
        at = self.rows
        halted = [row for row in self.under_way() if at.step[row] == 0]
        landed = [row for row in halted if at.time[row] == at.stop[row]]
        at.landed[landed] += 1
        self.begin(landed)
        for row in set(halted) - set(landed):
            cause = NO_LIMIT if at.jumps[row] else NOT_FINITE
            self.give_up(row, f"no step is small enough: {cause}")

    def finish_stiff(self, most: int) -> None:
        """Finish those whose steps of late were far below what their oscillations need."""
        at = self.rows
        steps = np.maximum(WINDOW - LANDING * at.landed, 0)
        gained = at.time - at.before
        slow = gained < steps * at.needed / self._stiff
        at.before[:], at.landed[:] = at.time, 0
        for row in (row for row in self.under_way() if slow[row]):
            try:
                self._finish(row, most, float(gained[row]))
            except GaveUpError as error:
                self.errors[int(at.case[row])] = error
                self._end(row)

    def _finish(self, row: int, most: int, gained: float) -> None:
        """The rest of a case by LSODA.

        The explicit pair takes over for a while where LSODA cannot go on, or gains less time in a
        window of steps than the explicit pair ``gained`` before [s].

        Raises:
            GaveUpError: it takes too many evaluations.
        """
        at, case = self.rows, int(self.rows.case[row])
        alone = self.system.picked([row])

        def rates(time: float, state: Array) -> Array:
            self._evaluations[case] += 1
            if self._evaluations[case] > most:
                raise GaveUpError(at.time[row], at.state[row], f"{TOO_MANY} {most} evaluations")
            inside = min(max(time, at.low[row]), at.high[row])
            return alone.rates(np.array([inside]), state[None])[0]

        def take(time: float, state: Array, between: Callable[[], Between]) -> None:
            at.time[row], at.state[row] = time, state
            self.records.fill(case, time, between)

        limits = Limits(at.longest[row], FINER * self.tolerance, gained, WINDOW)
        while integrate_stiff(rates, take, at.time[row], at.stop[row], at.state[row], limits):
            at.time[row] = at.stop[row]
            if at.time[row] == at.end[row]:
                break
            self.begin([row])
        else:
            at.slope[row] = rates(at.time[row], at.state[row])
            at.size[row], at.before[row] = min(FIRST_STEP, at.most[row]), at.time[row]
        at.step[row] = min(at.size[row], at.stop[row] - at.time[row])

    def under_way(self) -> list[int]:
        """Cases that are not at their end."""
        return [int(row) for row in np.flatnonzero(self.rows.under_way)]

    def drop_finished(self) -> bool:
        """Let go of cases at their end; whether all are."""
        left = self.under_way()
        if 0 < len(left) < len(self.rows.time):
            self.system = self.system.picked(left)
            self.rows = Running(*(values[left] for values in self.rows))
            self._stages = Stages.like(self.rows.state)
        return len(left) == 0

    def give_up(self, row: int, cause: str) -> None:
        """End a case that cannot go on with an error."""
        time, state = float(self.rows.time[row]), self.rows.state[row]
        self.errors[int(self.rows.case[row])] = GaveUpError(time, state, cause)
        self._end(row)

    def _end(self, row: int) -> None:
        self.rows.time[row], self.rows.step[row] = self.rows.end[row], 0.0
