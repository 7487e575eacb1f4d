"""What moves the spool in a frequency measurement: a sine whose frequency sweeps slowly, faded in and out."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from armdesign.arrays import Array
from armdesign.simulation.plant import Plant
from armdesign.valve import Valve, opening, spool_position


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """Sine of ``amplitude`` from ``start`` to ``stop`` [Hz] within ``duration`` [s], rising linearly; 0 afterwards.

    φ = 2π (f0 t + (f1 − f0) t²/2T); the first and last ``fade`` share of it rise and fall as a raised cosine.
    """

    amplitude: float
    start: float
    stop: float
    duration: float
    fade: float = 0.1

    def __call__(self, time: float) -> float:
        """Value at a time [s]."""
        share = time / self.duration
        if not 0 < share < 1:
            return 0.0
        edge = min(share, 1 - share) / self.fade
        envelope = 0.5 - 0.5 * math.cos(math.pi * edge) if edge < 1 else 1.0
        phase = 2 * math.pi * time * (self.start + (self.stop - self.start) * share / 2)
        return self.amplitude * envelope * math.sin(phase)


@dataclass(frozen=True)
class EvenOpening:
    """Spool command at which a valve passes the same flow to both sides, at the pressures of rest.

    Open by x, a valve lets more oil through on the side with the larger pressure drop: a sine of the spool would
    drive the piston away. The opening is therefore divided by its side's flow over the mean of both, as a pressure
    compensator does.
    """

    valve: Valve
    speed: float  # [m/s] of the piston with the valve wide open, the mean of both sides
    extend: float
    retract: float

    @classmethod
    def all(cls, plant: Plant, rest: Array) -> list[EvenOpening]:
        """For every cylinder of a plant of one machine at rest (size,)."""
        state, hydraulics = rest[None], plant.hydraulics
        places, pressures = plant.evaluate(state, np.zeros((1, plant.nc))).extensions, plant.pressures(state)
        speeds = []
        for spool in (1.0, -1.0):
            wide = np.full((1, plant.nc), spool)
            flows = hydraulics.flows(pressures, wide, plant.supply_pressure(state))
            free = hydraulics.free_speed(places, pressures, flows.from_supply - flows.to_return)
            speeds.append(np.maximum(np.abs(free[0]), 1e-12))
        mean = (speeds[0] + speeds[1]) / 2
        valves = [function.valve for function in plant.machine.functions]
        numbers = zip(valves, mean.tolist(), (mean / speeds[0]).tolist(), (mean / speeds[1]).tolist(), strict=True)
        return [cls(valve, *row) for valve, *row in numbers if valve is not None]

    def spool(self, share: float) -> float:
        """Spool position −1…1 for a mean opening."""
        return float(spool_position(self.valve, share * (self.extend if share > 0 else self.retract)))

    def share(self, spool: Any) -> Any:
        """Mean opening −1…1 at spool positions: inverse of ``spool``."""
        wide = opening(self.valve, spool)
        return wide / np.where(wide > 0, self.extend, self.retract)
