"""Outcome of a simulated move: oscillation of the tool about its drift, and when it has settled.

A commanded arm stops a little beside its plan and, with leaks, goes on creeping. Oscillation is
therefore counted about a straight line in time, by least squares over ``PERIODS`` of the lowest
mode from the instant at which all spools rest; weights sin² of the window make the line blind to
the oscillation itself. The residual is the tool's largest distance from that line within the first
period. It has settled when it stays within a tolerance of the line to the end.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from armdesign.arrays import Array, ReadOnly
from armdesign.machine.machine import Machine
from armdesign.short_repr import short_repr
from armdesign.simulation.plant.hydraulics import VAPOUR_PRESSURE
from armdesign.simulation.run import SETTLED, Simulation
from armdesign.units import bar

if TYPE_CHECKING:
    from armdesign.plots.canvas import Axes

PERIODS = 6.0  # of the lowest mode that are looked at after the spools have come to rest


@dataclass(frozen=True, eq=False, kw_only=True)
class MoveRun(ReadOnly):
    """A simulated move; arrays are read-only.

    Attributes:
        shaped: whether its commands were.
        mass: of the payload [kg].
        simulation: the nonlinear run.
        end: of the commands [s].
        begin: from when on all spools rest [s].
        time: from then on (m,) [s].
        deviation: of the tool from its drift (m, 3) [m].
        residual: the largest distance from it within a period of the lowest mode [m].
        drift: speed of the tool along its line [m/s].
        settled: when the tool is within the tolerance for good [s]; inf: not within the run.
        refilled: chambers that ran empty and filled again before that, and how often.
        miss: of the joints' planned end, by the middle of what is left (nq,) [rad, m].
    """

    __repr__ = short_repr

    shaped: bool
    mass: float
    simulation: Simulation
    end: float
    begin: float
    time: Array
    deviation: Array
    residual: float
    drift: float
    settled: float
    refilled: dict[str, int]
    miss: Array

    @property
    def spectrum(self) -> tuple[Array, Array]:
        """Frequencies [Hz] and amplitudes [m] of the tool's deviation, Hann's window over it."""
        window = np.hanning(len(self.time))[:, None]
        lines = np.fft.rfft(window * self.deviation, axis=0) * 2 / window.sum()
        frequency = np.fft.rfftfreq(len(self.time), self.time[1] - self.time[0])
        return frequency, np.linalg.norm(lines, axis=1)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Residual oscillation of the tool; returns the axes."""
        from armdesign import plots

        return plots.residual_oscillation(self, ax)


def move_run(
    run: Simulation, shaped: bool, end: float, frequency: float, tolerance: float, goal: Array
) -> MoveRun:
    """Residual oscillation of a run.

    Args:
        run: of the move, ``ring_time`` longer than its commands.
        shaped: whether its commands were.
        end: of the commands [s].
        frequency: lowest of the arm at the end [Hz].
        tolerance: in which the tool has settled [m].
        goal: planned joint positions at the end (nq,) [rad, m].
    """
    moves = (np.abs(run.spool - run.spool[-1]) > SETTLED).any(axis=1) | (run.time < end)
    first = min(int(np.flatnonzero(moves)[-1]) + 1, len(run.time) - 3)
    inside = run.time[first:] <= run.time[first] + PERIODS / frequency
    time, tool = run.time[first:][inside], run.tool[first:][inside]
    line, drift = _drift(time, tool)
    deviation = tool - line
    distance = np.linalg.norm(deviation, axis=1)
    within_period = time <= time[0] + 1 / frequency
    # the drift goes back to the end of the commands, before the spools rest
    away = np.linalg.norm(run.tool - (line[0] + (run.time - time[0])[:, None] * drift), axis=1)
    outside = np.flatnonzero((away > tolerance) & (run.time <= time[-1]))
    last = min(int(outside[-1]) + 1, len(run.time) - 1) if len(outside) else 0
    settled = float(run.time[last]) if run.time[last] <= time[-1 - len(time) // 6] else math.inf
    return MoveRun(
        shaped=shaped,
        mass=run.machine.payload.mass,
        simulation=run,
        end=end,
        begin=float(time[0]),
        time=time.copy(),
        deviation=deviation,
        residual=float(distance[within_period].max()),
        drift=float(np.linalg.norm(drift)),
        settled=settled,
        refilled=_refilled(run, first),
        miss=run.q[first:][inside].mean(axis=0) - goal,
    )


def _refilled(run: Simulation, count: int) -> dict[str, int]:
    """How often chambers filled again within the first instants, to more than return pressure."""
    full, times = max(run.machine.supply.return_pressure, bar), {}
    for i, actuator in enumerate(run.machine.actuators):
        for side, pressure in enumerate(run.pressures[:count, i].T):
            sign = np.where(pressure <= VAPOUR_PRESSURE, -1, np.where(pressure >= full, 1, 0))
            if often := int((np.diff(sign[sign != 0]) > 0).sum()):
                times[actuator.chamber(side)] = often
    return times


def ring_time(machine: Machine, frequency: float) -> float:
    """Time after the end of commands that is simulated [s], for a lowest frequency [Hz].

    The slowest spool comes to rest first: it decays by its slower pole.
    """
    decays = []
    for valve in (actuator.valve for actuator in machine.actuators):
        if valve is not None:
            zeta = valve.damping_ratio
            slower = zeta - math.sqrt(max(zeta**2 - 1, 0.0))
            decays.append(2 * math.pi * valve.natural_frequency * slower)
    return -math.log(SETTLED) / min(decays) + (PERIODS + 0.5) / frequency


def _drift(time: Array, tool: Array) -> tuple[Array, Array]:
    """Straight line (m, 3) [m] through an oscillating place, and its speed (3,) [m/s]."""
    since = time - time[0]
    weight = np.sin(np.pi * since / since[-1])[:, None]
    basis = np.stack([np.ones(len(time)), since], axis=1)
    factors = np.linalg.lstsq(weight * basis, weight * tool, rcond=None)[0]
    return basis @ factors, factors[1]
