"""Recordings: signals of a machine over time, read from a CSV file, and what spoils them.

One column for each signal, named with its unit at the end: ``lift_cap_bar``,
``boom_gyro_deg_per_s``. Time is ``time_s`` (or ``time_ms``, ``t``, ``time``). Lines that begin
with ``#`` are comments; semicolons with decimal commas are understood. A field may be blank.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from armdesign.arrays import Array, ReadOnly, unmasked
from armdesign.csv_rows import read_rows
from armdesign.errors import SimulationError, choose

TIMES = {"time_s": 1.0, "t_s": 1.0, "time": 1.0, "t": 1.0, "time_ms": 1e-3, "t_ms": 1e-3}
GAP = 1.5  # intervals without a sample
STUCK = 0.5  # share of a window in which a signal does not move at all
LIMITED = 3  # equal samples at a signal's own limit
SHORTEST = 1e-8  # interval [s] that is told: clocks since 1970 have no shorter ones
ROUNDING = 1e-4  # of a decimal: of numbers that a computer rounds
LARGEST = 1e50  # of any signal in any unit: squares of it are numbers too
QUANTA = 4.0  # by which a signal falls from a limit in one interval if it was cut there
NEARLY = 8  # samples at a limit with noise: two further, a peak has fallen 2.5 times as far
STEPS = 1.5  # quanta between neighbouring values: a slow signal changes by one
THIRD = 0.6745 * math.sqrt(20)  # median third difference of white noise, in its deviations


@dataclass(frozen=True, eq=False)
class Recording(ReadOnly):
    """Signals over time; arrays are read-only.

    Attributes:
        source: file or other origin, for messages.
        time: instants (n,) [s].
        columns: signals (n,) by name, NaN where a field is blank.
    """

    source: str
    time: Array
    columns: Mapping[str, Array]

    @property
    def step(self) -> float:
        """Mean time between samples [s]."""
        return float((self.time[-1] - self.time[0]) / (len(self.time) - 1))

    @property
    def decimals(self) -> int:
        """Of instants in words: a tenth of an interval is told, whatever the clock counts from."""
        step = self.step if len(self.time) > 1 else 0.0
        return max(math.ceil(-math.log10(max(step, SHORTEST) / 10) - ROUNDING), 0)

    def time_text(self, instant: float) -> str:
        """An instant [s] in words, from which ``between`` finds its sample again."""
        return np.format_float_positional(round(float(instant), self.decimals) + 0.0, trim="-")

    def span_text(self, begin: float, end: float) -> str:
        """Two instants [s] in words."""
        return f"{self.time_text(begin)}–{self.time_text(end)}"

    def column(self, name: str) -> Array:
        """A signal (n,).

        Raises:
            SimulationError: there is none of that name.
        """
        if name not in self.columns:
            fault = f'has no column "{name}"'
            raise SimulationError(self.source, fault, choose(name, list(self.columns)))
        return self.columns[name]

    def between(self, begin: float, end: float) -> Recording:
        """The part from one instant to another [s], both included, as ``time_text`` tells them."""
        told = (0.5 + ROUNDING) * 0.1**self.decimals
        inside = (self.time >= begin - told) & (self.time <= end + told)
        some = {name: values[inside] for name, values in self.columns.items()}
        source = f"{self.source}: {self.span_text(begin, end)} s"
        return Recording(source, self.time[inside], some)

    def sampled(self, name: str) -> Array:
        """A signal without blanks, at instants without gaps (n,).

        Raises:
            SimulationError: it is blank somewhere, or time has gaps, double stamps or steps back.
        """
        values, time = self.column(name), self.time
        self.refuse_single("choose another window")
        self.refuse_uneven()
        if not np.all(np.isfinite(values)):
            k = int(np.argmin(np.isfinite(values)))
            what = "blank" if np.isnan(values[k]) else "infinite"
            remedy = "choose a window without it, or fill it in"
            fault = f"{name} is {what} at {self.time_text(time[k])} s"
            raise SimulationError(self.source, fault, remedy)
        return values

    def excitation(self, name: str) -> Array:
        """A signal that can be taken as an input (n,): it may stand still, or at a limit.

        Raises:
            SimulationError: see ``sampled``; or it is constant, or no measurement.
        """
        values = self.sampled(name)
        if (largest := float(np.abs(values).max())) > LARGEST:
            fault, remedy = f"{name} holds {largest:g}", "give values in the unit of its name"
            raise SimulationError(self.source, fault, remedy)
        if np.ptp(values) == 0:
            remedy = "choose another column or window"
            raise SimulationError(self.source, f"{name} is constant ({values[0]:g})", remedy)
        return values

    def signal(self, name: str) -> Array:
        """A signal that can be fitted (n,).

        Raises:
            SimulationError: see ``excitation``; or it is stuck, repeated or clipped.
        """
        values, time = self.excitation(name), self.time
        begins, counts = _runs(values)
        if counts.max() > STUCK * len(values):
            k = int(begins[np.argmax(counts)])
            fault = f"{name} is stuck at {values[k]:g} from {self.time_text(time[k])} s"
            raise SimulationError(self.source, fault, "choose another column or window")
        usual, change = int(np.median(counts)), np.median(np.abs(np.diff(values[begins])))
        if usual >= LIMITED and change > STEPS * _quantum(values):
            fault = f"each value of {name} stands for {usual} samples"
            raise SimulationError(self.source, fault, "keep one of each, with its instant")
        for limit in (float(values.max()), float(values.min())):
            if _clipped(values, limit):
                fault = f"{name} is clipped at {limit:g}"
                remedy = "choose a window of smaller swings, or a sensor of more range"
                raise SimulationError(self.source, fault, remedy)
        return values

    def refuse_single(self, remedy: str) -> None:
        """Raise a ``SimulationError`` where there are less than two samples."""
        if (count := len(self.time)) < 2:
            fault = f"holds {count or 'no'} sample{'s' * (count != 1)}"
            raise SimulationError(self.source, fault, remedy)

    def refuse_uneven(self) -> None:
        """Raise a ``SimulationError`` where time has gaps, double stamps or steps back."""
        steps = np.diff(self.time)
        usual = float(np.median(steps))
        for bad, what in (
            (steps == 0, "the same time stamp twice, at {0} s"),
            (steps < 0, "time steps back after {0} s"),
            (steps > GAP * usual, "a gap of {1:g} s at {0} s"),
        ):
            if bad.any():
                k = int(np.argmax(bad))
                fault = what.format(self.time_text(self.time[k]), steps[k])
                remedy = "choose a window without it, or mend the recording"
                raise SimulationError(self.source, fault, remedy)


def _runs(values: Array) -> tuple[Array, Array]:
    """Where each run of equal values begins, and how many they are."""
    ends = np.flatnonzero(np.append(np.diff(values) != 0, True))
    begins = np.append(0, ends[:-1] + 1)
    return begins, ends - begins + 1


def _quantum(values: Array) -> float:
    """The least difference of values that are not all equal."""
    return float(np.diff(np.unique(values)).min())


def _clipped(values: Array, limit: float) -> bool:
    """Whether values stay at their limit, but for noise, and leave it at once: no peak does."""
    quantum, noise = _quantum(values), _noise(values)
    near = QUANTA * max(quantum, noise)
    return _cut(values, limit, quantum, LIMITED, 1) or _cut(values, limit, near, NEARLY, 2)


def _noise(values: Array) -> float:
    """Standard deviation of white noise, by third differences: little of a ring is in them."""
    return float(np.median(np.abs(np.convolve(values, (1, -3, 3, -1), "same")))) / THIRD


def _cut(values: Array, limit: float, near: float, least: int, beyond: int) -> bool:
    """Whether so many values in a row are near their limit, and those so far beyond are not."""
    there = np.append(np.append(False, np.abs(values - limit) < near), False)
    turns = np.flatnonzero(np.diff(there.astype(int)))
    for begin, end in zip(turns[::2], turns[1::2], strict=True):
        if end - begin >= least and begin >= beyond and end + beyond <= len(values):
            drops = np.abs(values[[begin - beyond, end + beyond - 1]] - limit)
            if drops.min() > QUANTA * near:
                return True
    return False


def recording_of(columns: Mapping[str, ArrayLike], source: str = "recording") -> Recording:
    """A recording from columns, of which one is time; blank is what NumPy masks, too.

    Raises:
        SimulationError: no column is time, time is blank somewhere, columns differ in length, or
            one holds no numbers.
    """
    given = [name for name in TIMES if name in columns]
    if not given:
        remedy = f"name the column of time {' or '.join(TIMES)}"
        raise SimulationError(source, f"has no time ({', '.join(columns)})", remedy)
    time = _numbers(source, given[0], columns[given[0]]) * TIMES[given[0]]
    if not np.all(np.isfinite(time)):
        row = int(np.argmax(~np.isfinite(time))) + 1
        raise SimulationError(source, f"{given[0]} is blank in row {row}", "give every instant")
    others = {n: _numbers(source, n, v) for n, v in columns.items() if n != given[0]}
    for name, values in others.items():
        if values.shape != time.shape or time.ndim != 1:
            fault = f"{name} holds {values.size} values, {given[0]} {time.size}"
            raise SimulationError(source, fault, "give a value of every column at every instant")
    if not others:
        raise SimulationError(source, "has no signal beside time", "add columns")
    return Recording(source, time, others)


def _numbers(source: str, name: str, values: ArrayLike) -> Array:
    try:
        return unmasked(values).copy()
    except (TypeError, ValueError) as error:
        remedy = "give numbers, or leave the column out"
        raise SimulationError(source, f"{name} holds no numbers ({error})", remedy) from None


def read_recording(path: str | Path) -> Recording:
    """The recording of a CSV file, see the module.

    Raises:
        SimulationError: a file that cannot be read, a field that is no number, or no time.
    """
    names, rows = read_rows(path, SimulationError)
    if not rows:
        raise SimulationError(str(path), "holds no samples", "give names and a row per instant")
    table = np.array(
        [
            [_number(str(path), line, *pair) for pair in zip(names, fields, strict=True)]
            for line, fields in rows
        ]
    )
    return recording_of(dict(zip(names, table.T, strict=True)), str(path))


def _number(source: str, line: int, name: str, word: str) -> float:
    if word == "" or word.lower() == "nan":
        return math.nan
    try:
        return float(word)
    except ValueError:
        fault = f'"{word:.40}" in line {line} is no number ({name})'
        raise SimulationError(source, fault, "give numbers, or leave the field blank") from None
