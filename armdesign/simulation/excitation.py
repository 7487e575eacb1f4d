"""Spool commands as functions of time: steps, tables, and the swept sine of measurements.

Each says by ``breakpoints`` [s], ascending, when it or one of its derivatives jumps. No step of an
integration goes across one. Any function of time may have such an attribute; one without it may
jump at any time.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from itertools import pairwise
from numbers import Real
from typing import Any

import numpy as np

from armdesign.arrays import Array, Numbers, unmasked
from armdesign.errors import SimulationError
from armdesign.hydraulics.valve import Valve, opening, spool_position
from armdesign.machine.machine import Machine
from armdesign.simulation.plant.compiled import (
    Record,
    Records,
    borrowing,
    callable_within,
    new_records,
)
from armdesign.simulation.plant.plant import Plant


def _refuse_no_number(kind: str, command: Step | SweptSine, *, finite: bool = False) -> None:
    for name, given in vars(command).items():
        if not isinstance(given, Real) or (finite and not math.isfinite(given)):
            fault = f"{given!r} is not a {'finite ' * finite}number"
            raise SimulationError(f"{kind}: {name}", fault, "give one")


@dataclass(frozen=True, kw_only=True)
class Step:
    """A step or pulse: ``size`` from ``begin`` up to ``end`` [s], 0 before and afterwards."""

    size: float
    begin: float = 0.0
    end: float = math.inf

    def __post_init__(self) -> None:
        _refuse_no_number("step", self)
        if not (math.isfinite(self.size) and math.isfinite(self.begin) and self.begin < self.end):
            fault = f"of {self.size:g} from {self.begin:g} to {self.end:g} s is none"
            remedy = "give a finite size and begin, and an end after it"
            raise SimulationError("step", fault, remedy)

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Both edges [s]."""
        return tuple(edge for edge in (self.begin, self.end) if math.isfinite(edge))

    def __call__(self, time: float) -> float:
        """Value at a time [s]."""
        return self.size if self.begin <= time < self.end else 0.0


@dataclass(frozen=True)
class Table:
    """Straight lines between ``values`` at ``times`` [s], constant before and after them.

    A time given twice is a jump: the last of its values counts from there on.
    """

    times: Sequence[float]
    values: Sequence[float]

    def __post_init__(self) -> None:
        for name in ("times", "values"):
            try:
                given = unmasked(getattr(self, name))
            except (TypeError, ValueError):
                given = np.array(math.nan)
            if given.ndim != 1 or not len(given) or not np.all(np.isfinite(given)):
                fault = f"{getattr(self, name)!r} are not finite numbers"
                raise SimulationError(f"table: {name}", fault, "give a list, one or more")
            object.__setattr__(self, name, tuple(given.tolist()))
        if len(self.times) != len(self.values):
            fault = f"{len(self.times)} times for {len(self.values)} values"
            raise SimulationError("table", fault, "give one time per value")
        for early, late in pairwise(self.times):
            if late < early:
                fault = f"{late:g} s comes after {early:g} s"
                raise SimulationError("table: times", fault, "sort them")

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
class SweptSine:
    """A sine whose frequency rises linearly, from ``start`` to ``stop`` [Hz]; 0 afterwards.

    Its phase is 2π (f0 t + (f1 − f0) t²/2T), T the ``duration`` [s]. It fades in and out as a
    raised cosine, over the first and the last ``fade`` share of T.
    """

    amplitude: float
    start: float
    stop: float
    duration: float
    fade: float = 0.1

    def __post_init__(self) -> None:
        _refuse_no_number("swept sine", self, finite=True)
        if min(self.start, self.stop) < 0 or self.duration <= 0 or not 0 < self.fade <= 0.5:
            fault = (
                f"of {self.start:g} to {self.stop:g} Hz in {self.duration:g} s, fade {self.fade:g}"
            )
            remedy = "give frequencies from 0 up, a duration above 0 s and a fade in (0, 0.5]"
            raise SimulationError("swept sine", f"{fault} is none", remedy)

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Both ends, and where it has risen and begins to fall [s]."""
        return tuple(self.duration * share for share in (0.0, self.fade, 1 - self.fade, 1.0))

    def __call__(self, time: float) -> float:
        """Value at a time [s]."""
        return swept_sine(self, time)


@callable_within
def swept_sine(sweep: SweptSine | Record, time: float) -> float:
    """Value of a swept sine at a time [s]; for compiled code, too."""
    share = time / sweep.duration
    if not 0 < share < 1:
        return 0.0
    edge = min(share, 1 - share) / sweep.fade
    envelope = 0.5 - 0.5 * math.cos(math.pi * edge) if edge < 1 else 1.0
    phase = 2 * math.pi * time * (sweep.start + (sweep.stop - sweep.start) * share / 2)
    return sweep.amplitude * envelope * math.sin(phase)


@dataclass(frozen=True)
class SymmetricValve:
    """A valve whose commands are scaled so that it passes the same flow to both sides at rest.

    Open by x, a valve passes more oil on the side with the larger pressure drop: a sine of the
    spool would drive the piston away. The opening is therefore divided by its side's flow over
    the mean of both, as a pressure compensator does.
    """

    valve: Valve  # of the actuator
    speed: float  # of the piston with the valve wide open, mean of both sides [m/s]
    extend: float  # factor of the openings that extend
    retract: float  # factor of those that retract

    @classmethod
    def all(cls, plant: Plant, equilibrium: Array) -> list[SymmetricValve]:
        """The valves of all actuators of one machine, at its equilibrium state (size,)."""
        areas, zero, speeds = plant.parameters.actuators["areas"][0], np.zeros((1, plant.nc)), []
        for spool in (1.0, -1.0):
            wide = plant.evaluate(plant.with_spools(equilibrium[None], spool), zero)
            # A piston whose force does not change moves with v: Σ A Q/C = v Σ A²/C.
            share = areas / wide.outputs["capacity"][0]
            free = (share * wide.valve_flows[0]).sum(axis=1) / (share * areas).sum(axis=1)
            speeds.append(np.maximum(np.abs(free), 1e-12))
        mean = (speeds[0] + speeds[1]) / 2
        valves = [actuator.valve for actuator in plant.machine.actuators]
        columns = mean.tolist(), (mean / speeds[0]).tolist(), (mean / speeds[1]).tolist()
        rows = zip(valves, *columns, strict=True)
        return [cls(valve, *numbers) for valve, *numbers in rows if valve is not None]

    def spool(self, opening: float) -> float:
        """Spool position −1…1 for a mean opening −1…1."""
        return float(symmetric_spool(self, self.valve, opening))

    def opening(self, spool: Numbers) -> Numbers:
        """Mean opening −1…1 at spool positions: inverse of ``spool``."""
        wide = opening(self.valve, spool)
        return wide / np.where(wide > 0, self.extend, self.retract)


@callable_within
def symmetric_spool(factors: SymmetricValve | Record, valve: Any, opening: float) -> float:
    """Spool position −1…1 of a symmetric valve for a mean opening; for compiled code, too."""
    scale = factors.extend if opening > 0 else factors.retract
    return spool_position(valve, opening * scale)


@dataclass(frozen=True)
class SymmetricCommand:
    """Spool command that moves the opening of a symmetric valve by an excitation about a mean."""

    valve: SymmetricValve
    mean: float
    excitation: Callable[[float], float]

    @property
    def breakpoints(self) -> Sequence[float] | None:
        """Breakpoints of the excitation [s]; None if it does not state any."""
        return getattr(self.excitation, "breakpoints", None)

    def __call__(self, time: float) -> float:
        """Value at a time [s]."""
        return self.valve.spool(self.mean + self.excitation(time))


SWEEP = np.dtype(  # a ``SymmetricCommand`` of a swept sine to actuator ``index``
    [
        ("index", "i8"),
        *((field.name, "f8") for field in fields(SweptSine)),
        *((name, "f8") for name in ("mean", "extend", "retract", "overlap")),
    ],
    align=True,
)


def sweeps_of(commands: Sequence[object], machines: Sequence[Machine]) -> Records | None:
    """Records ``SWEEP`` (n,) of commands to machines; None if one is no single swept sine."""
    records = new_records(len(commands), SWEEP)
    for record, command, machine in zip(records, commands, machines, strict=True):
        if not isinstance(command, Mapping) or len(command) != 1:
            return None
        ((name, part),) = command.items()
        if not isinstance(part, SymmetricCommand) or not isinstance(part.excitation, SweptSine):
            return None
        index = [actuator.name for actuator in machine.actuators].index(name)
        numbers = {"index": index, "mean": part.mean, **vars(part.excitation)}
        numbers |= {"extend": part.valve.extend, "retract": part.valve.retract}
        for field, value in {**numbers, "overlap": part.valve.valve.overlap}.items():
            record[field] = value
    return records


@borrowing
def write_sweeps(time: Array, sweeps: Records, spools: Array) -> None:
    """Write the spool commands (n, nc) of ``SymmetricCommand`` at times (n,) [s]."""
    for case in range(len(time)):
        sweep = sweeps[case if len(sweeps) > 1 else 0]
        opening = sweep.mean + swept_sine(sweep, time[case])
        spools[case, sweep.index] = symmetric_spool(sweep, sweep, opening)
