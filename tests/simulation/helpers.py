"""What the tests of the nonlinear model share."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armdesign import Machine
from armdesign.valve import Friction, Valve

VALVE = Valve(rated_flow=2e-3, rated_drop=35e5, natural_frequency=30.0, damping_ratio=0.8)


def with_valves(machine: Machine, valve: Valve = VALVE, **changes: object) -> Machine:
    """The machine with a valve on every cylinder that has none, and other data of all cylinders."""
    cylinders = [replace(c, valve=c.valve or valve, **changes) for c in machine.cylinders]  # type: ignore[arg-type]
    return replace(machine, cylinders=tuple(cylinders))


def with_leakage(machine: Machine, leakage: float) -> Machine:
    """The machine with leakage [m³/s/Pa] across every piston."""
    cylinders = [replace(c, valve=replace(c.valve or VALVE, leakage=leakage)) for c in machine.cylinders]
    return replace(machine, cylinders=tuple(cylinders))


def with_friction(machine: Machine, friction: Friction) -> Machine:
    return replace(machine, cylinders=tuple(replace(c, friction=friction) for c in machine.cylinders))


def shut(machine: Machine):  # type: ignore[no-untyped-def]
    return lambda _: np.zeros(len(machine.cylinders))
