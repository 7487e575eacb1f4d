"""What moves the spool in a frequency measurement: a sine whose frequency sweeps slowly, faded in and out."""

from __future__ import annotations

import math
from dataclasses import dataclass

from armdesign.arrays import Array
from armdesign.simulation.plant import Function, Plant
from armdesign.valve import opening, port_flows, spool_position


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

    function: Function
    speed: float  # [m/s] of the piston with the valve wide open, the mean of both sides
    extend: float
    retract: float

    @classmethod
    def of(cls, function: Function, extension: float, cap: float, annulus: float) -> EvenOpening:
        """For a cylinder at rest with its piston at an extension [m] and pressures [Pa]."""
        supply, valve = function.supply, function.valve
        speeds = []
        for share in (1.0, -1.0):
            flows = port_flows(valve, share, cap, annulus, supply.pressure, supply.return_pressure)
            speeds.append(max(abs(function.free_speed(extension, cap, annulus, flows)), 1e-12))
        mean = sum(speeds) / 2
        return cls(function, mean, mean / speeds[0], mean / speeds[1])

    @classmethod
    def all(cls, plant: Plant, rest: Array) -> list[EvenOpening]:
        """For every cylinder of a plant at rest."""
        _, _, caps, annuli, _, _ = plant.split(rest)
        places = plant.evaluate(rest.tolist(), [0.0] * plant.nc)[1]
        return [cls.of(*at) for at in zip(plant.functions, places, caps.tolist(), annuli.tolist(), strict=True)]

    def spool(self, share: float) -> float:
        """Spool position −1…1 for a mean opening."""
        return spool_position(self.function.valve, share * (self.extend if share > 0 else self.retract))

    def share(self, spool: float) -> float:
        """Mean opening −1…1 at a spool position: inverse of ``spool``."""
        wide = opening(self.function.valve, spool)
        return wide / (self.extend if wide > 0 else self.retract)
