"""What moves a spool, as functions of time: steps and tables, and the excitations of frequency measurements.

A sine whose frequency sweeps slowly, faded in and out; many sines at once; one sine after the
other; a pulse, after which the arm rings by itself.

Each says by ``breakpoints`` [s], ascending, when it or one of its derivatives jumps. No step of an
integration goes across one. Any function of time may have such an attribute; one without it may
jump at any time.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from numbers import Real
from typing import Any

import numpy as np

from armdesign.arrays import Array
from armdesign.errors import SimulationError
from armdesign.hydraulics.valve import Valve, opening, spool_position
from armdesign.simulation.plant.plant import Plant


@dataclass(frozen=True, kw_only=True)
class Step:
    """``size`` from ``begin`` up to ``end`` [s], 0 before and afterwards: a step, or a pulse however short."""

    size: float
    begin: float = 0.0
    end: float = math.inf

    def __post_init__(self) -> None:
        for name, given in vars(self).items():
            if not isinstance(given, Real):
                raise SimulationError(f"step: {name}", f"{given!r} is not a number", "give one")
        if not (math.isfinite(self.size) and math.isfinite(self.begin) and self.begin < self.end):
            problem = f"of {self.size:g} from {self.begin:g} to {self.end:g} s is none"
            raise SimulationError(
                "step", problem, "give a finite size and begin, and an end after it"
            )

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Both edges [s]."""
        return tuple(edge for edge in (self.begin, self.end) if math.isfinite(edge))

    def __call__(self, time: float) -> float:
        """Value at a time [s]."""
        return self.size if self.begin <= time < self.end else 0.0


@dataclass(frozen=True)
class Table:
    """Straight lines between ``values`` at ``times`` [s], and the first and last value beyond them.

    Of a time given twice the last value counts from there on: that is a jump.
    """

    times: Sequence[float]
    values: Sequence[float]

    def __post_init__(self) -> None:
        for name in ("times", "values"):
            try:
                given = np.array(getattr(self, name), dtype=float)
            except (TypeError, ValueError):
                given = np.array(math.nan)
            if given.ndim != 1 or not len(given) or not np.all(np.isfinite(given)):
                problem = f"{getattr(self, name)!r} are not finite numbers"
                raise SimulationError(f"table: {name}", problem, "give a list, one or more")
            object.__setattr__(self, name, tuple(given.tolist()))
        if len(self.times) != len(self.values):
            problem = f"{len(self.times)} times for {len(self.values)} values"
            raise SimulationError("table", problem, "give one time per value")
        for early, late in pairwise(self.times):
            if late < early:
                raise SimulationError(
                    "table: times", f"{late:g} s comes after {early:g} s", "sort them"
                )

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """All times [s], each once."""
        return tuple(sorted(set(self.times)))

    def __call__(self, time: float) -> float:
        """Value at a time [s]."""
        after = bisect_right(self.times, time)
        if after in (0, len(self.times)):
            return self.values[min(after, len(self.times) - 1)]
        begin, first = self.times[after - 1], self.values[after - 1]
        return first + (self.values[after] - first) * (time - begin) / (self.times[after] - begin)


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """Sine of ``amplitude`` from ``start`` to ``stop`` [Hz] within ``duration`` [s], rising linearly; 0 afterwards.

    φ = 2π (f0 t + (f1 − f0) t²/2T); the first and last ``fade`` share of it rise and fall as a
    raised cosine.
    """

    amplitude: float
    start: float
    stop: float
    duration: float
    fade: float = 0.1

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Both ends, and where it has risen and begins to fall [s]."""
        return tuple(self.duration * share for share in (0.0, self.fade, 1 - self.fade, 1.0))

    def __call__(self, time: float) -> float:
        """Value at a time [s]."""
        share = time / self.duration
        if not 0 < share < 1:
            return 0.0
        edge = min(share, 1 - share) / self.fade
        envelope = 0.5 - 0.5 * math.cos(math.pi * edge) if edge < 1 else 1.0
        phase = 2 * math.pi * time * (self.start + (self.stop - self.start) * share / 2)
        return self.amplitude * envelope * math.sin(phase)


@dataclass(frozen=True, kw_only=True)
class Multisine:
    """Sines of all the lines k/``period`` from ``start`` to ``stop`` [Hz] at once, ``periods`` times; 0 outside.

    u = a √(1/N) Σ sin(2π k t/T + φ_k), with phases φ_k = −π k (k − 1)/N, k = 1…N, that keep its
    peaks low (Schroeder 1970): its mean square is that of one sine of ``amplitude`` a, its largest
    value about 1.3 a.
    """

    amplitude: float
    start: float
    stop: float
    period: float
    periods: int = 1

    def __post_init__(self) -> None:
        if not (self.start >= 0 and self.period > 0 and self.periods >= 1 and len(self.lines)):
            problem = (
                f"has no line from {self.start:.4g} to {self.stop:.4g} Hz in a period of"
                f" {self.period:g} s"
            )
            raise SimulationError("multisine", problem, "take a longer period or a wider band")

    @cached_property
    def lines(self) -> Array:
        """Frequencies of the sines (N,) [Hz]."""
        first, last = (
            math.ceil(max(self.start * self.period, 1) - 1e-9),
            math.floor(self.stop * self.period + 1e-9),
        )
        return np.arange(first, last + 1) / self.period

    @property
    def duration(self) -> float:
        """All periods [s]."""
        return self.period * self.periods

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Both ends [s]."""
        return 0.0, self.duration

    @cached_property
    def _phases(self) -> Array:
        number = np.arange(1, len(self.lines) + 1)
        return np.asarray(-math.pi * number * (number - 1) / len(self.lines))

    def __call__(self, time: float) -> float:
        """Value at a time [s]."""
        if not 0 <= time < self.duration:
            return 0.0
        sines = np.sin(2 * math.pi * self.lines * time + self._phases)
        return float(self.amplitude * sines.sum() / math.sqrt(len(self.lines)))


@dataclass(frozen=True, kw_only=True)
class SteppedSine:
    """Sine of ``amplitude`` at each of some ``frequencies`` [Hz] in turn, for whole ``cycles`` each; 0 afterwards."""

    amplitude: float
    frequencies: tuple[float, ...]
    cycles: int

    def __post_init__(self) -> None:
        if not self.frequencies or min(self.frequencies) <= 0 or self.cycles < 1:
            raise SimulationError(
                "stepped sine", "needs frequencies above 0 Hz and whole cycles", "give some"
            )

    @cached_property
    def edges(self) -> Array:
        """When each frequency begins, and the end of the last (n + 1,) [s]."""
        return np.concatenate([[0.0], np.cumsum(self.cycles / np.array(self.frequencies))])

    @property
    def duration(self) -> float:
        """Of all steps [s]."""
        return float(self.edges[-1])

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """``edges``."""
        return tuple(self.edges.tolist())

    def __call__(self, time: float) -> float:
        """Value at a time [s]."""
        step = int(np.searchsorted(self.edges, time, side="right")) - 1
        if not 0 <= step < len(self.frequencies):
            return 0.0
        return self.amplitude * math.sin(
            2 * math.pi * self.frequencies[step] * (time - float(self.edges[step]))
        )


@dataclass(frozen=True, kw_only=True)
class Pulse:
    """A raised cosine of height ``amplitude`` within ``duration`` [s], then 0: oil shut in, the arm decays freely."""

    amplitude: float
    duration: float

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Both ends [s]."""
        return 0.0, self.duration

    def __call__(self, time: float) -> float:
        """Value at a time [s]."""
        share = time / self.duration
        return (
            self.amplitude * (0.5 - 0.5 * math.cos(2 * math.pi * share)) if 0 < share < 1 else 0.0
        )


@dataclass(frozen=True)
class EvenOpening:
    """Spool command at which a valve passes the same flow to both sides, at the pressures of rest.

    Open by x, a valve lets more oil through on the side with the larger pressure drop: a sine of
    the spool would drive the piston away. The opening is therefore divided by its side's flow over
    the mean of both, as a pressure compensator does.
    """

    valve: Valve
    speed: float  # [m/s] of the piston with the valve wide open, the mean of both sides
    extend: float
    retract: float

    @classmethod
    def all(cls, plant: Plant, rest: Array) -> list[EvenOpening]:
        """For every cylinder of a plant of one machine at rest (size,)."""
        areas, still, speeds = plant.actuators["areas"][0], np.zeros((1, plant.nc)), []
        for spool in (1.0, -1.0):
            wide = plant.evaluate(plant.with_spools(rest[None], spool), still)
            share = (
                areas / wide.told["capacity"][0]
            )  # a piston whose force does not change: Σ A Q/C = v Σ A²/C
            free = (share * wide.valve_flows[0]).sum(axis=1) / (share * areas).sum(axis=1)
            speeds.append(np.maximum(np.abs(free), 1e-12))
        mean = (speeds[0] + speeds[1]) / 2
        valves = [actuator.valve for actuator in plant.machine.actuators]
        numbers = zip(
            valves,
            mean.tolist(),
            (mean / speeds[0]).tolist(),
            (mean / speeds[1]).tolist(),
            strict=True,
        )
        return [cls(valve, *row) for valve, *row in numbers if valve is not None]

    def spool(self, share: float) -> float:
        """Spool position −1…1 for a mean opening."""
        return float(
            spool_position(self.valve, share * (self.extend if share > 0 else self.retract))
        )

    def share(self, spool: Any) -> Any:
        """Mean opening −1…1 at spool positions: inverse of ``spool``."""
        wide = opening(self.valve, spool)
        return wide / np.where(wide > 0, self.extend, self.retract)


@dataclass(frozen=True)
class Moved:
    """Spool command that moves the even opening of a valve by an excitation about a mean opening."""

    even: EvenOpening
    mean: float
    excitation: Callable[[float], float]

    @property
    def breakpoints(self) -> Sequence[float] | None:
        """Those of the excitation [s]; None: it has none to tell."""
        return getattr(self.excitation, "breakpoints", None)

    def __call__(self, time: float) -> float:
        """Value at a time [s]."""
        return self.even.spool(self.mean + self.excitation(time))
