"""What the tests of the nonlinear model share."""

from __future__ import annotations

from collections.abc import Callable
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


def without_losses(machine: Machine) -> Machine:
    """The machine whose file states neither friction nor leakage; a test may state them anew."""
    friction = ("coulomb_N", "static_N", "viscous_N_s_per_m")
    changes = {
        f"cylinder.{name}.friction.{key}": 0.0
        for name in machine.section.cylinder
        for key in friction
    }
    leaks = ("leakage_l_per_min_per_bar", "tank_leakage_l_per_min_per_bar")
    changes |= {
        f"cylinder.{name}.valve.{key}": 0.0
        for name, table in machine.section.cylinder.items()
        if table.valve
        for key in leaks
    }
    return machine.replace(changes)


def ideally_fed(machine: Machine) -> Machine:
    """The machine without losses, at a pump that holds its pressure."""
    return without_losses(machine).replace({"supply.pump": "ideal"})


def pulse(size: float, until: float = 0.3) -> Callable[[float], float]:
    """A command of a size until a time [s]; its jump is not announced."""
    return lambda time: size if time < until else 0.0


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
