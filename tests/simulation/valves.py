"""What the tests of the nonlinear model share."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armdesign import Machine
from armdesign.hydraulics.friction import Friction
from armdesign.hydraulics.valve import Valve

WORST = (1.154, -1.199, -2.191)  # near the 20 t machine's worst pose with a full bucket
VALVE = Valve(rated_flow=2e-3, rated_drop=35e5, natural_frequency=30.0, damping_ratio=0.8)


def with_valves(machine: Machine, valve: Valve = VALVE, **changes: object) -> Machine:
    """The machine with a valve on every actuator that has none, and other data of all
    actuators.
    """
    return _each(machine, lambda f: replace(f, valve=f.valve or valve, **changes))


def with_leakage(machine: Machine, leakage: float) -> Machine:
    """The machine with leakage [m³/s/Pa] across every piston."""
    return _each(machine, lambda f: replace(f, valve=replace(f.valve or VALVE, leakage=leakage)))


def with_friction(machine: Machine, friction: Friction) -> Machine:
    return _each(machine, lambda f: replace(f, friction=friction))


def _each(machine: Machine, change):  # type: ignore[no-untyped-def]
    cylinders, motors = (
        tuple(map(change, actuators)) for actuators in (machine.cylinders, machine.motors)
    )
    return replace(machine, cylinders=cylinders, motors=motors)


def shut(machine: Machine):  # type: ignore[no-untyped-def]
    return lambda _: np.zeros(len(machine.actuators))
