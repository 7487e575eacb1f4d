"""Machines with other valves, and their states of equilibrium."""

from __future__ import annotations

import numpy as np

from armdesign import Machine
from armdesign.simulation.plant.equilibrium import find_equilibrium
from armdesign.simulation.plant.plant import Plant
from armdesign.simulation.simulate import simulate
from armdesign.units import bar

LIGHT = (0.228865, -1.64707, -0.867145)


CYLINDERS = ("boom", "stick", "bucket")


HOLDING = {
    "pilot_ratio": 4.0,
    "setting_bar": 250.0,
    "rated_flow_l_per_min": 429,
    "rated_drop_bar": 14,
}


def valves(machine: Machine, names: tuple[str, ...] = CYLINDERS, **keys: object) -> Machine:
    """The machine with other keys of the valves of some cylinders."""
    return machine.replace(
        {f"cylinder.{name}.valve.{key}": value for name in names for key, value in keys.items()}
    )


def holding(machine: Machine, name: str, **keys: object) -> Machine:
    return machine.replace(
        {f"cylinder.{name}.load_holding.{key}": value for key, value in (HOLDING | keys).items()}
    )


def started(machine: Machine, pose: object, preloaded: bool | None = None) -> np.ndarray:
    """Pressures (nc, 2) [Pa] at which a run starts."""
    run = simulate(machine, pose, {}, duration=0.01, preloaded=preloaded)  # type: ignore[arg-type]
    return run.pressures[0]


def rates(machine: Machine, pose: object) -> np.ndarray:
    """Pressure rates (nc,) [bar/s] at rest, the larger of both chambers."""
    plant = Plant(machine)
    equilibrium = find_equilibrium(plant, pose).state  # type: ignore[arg-type]
    _, _, cap, annulus, _, _ = plant.split(
        plant.derivative(equilibrium[None], plant.split(equilibrium)[4][None])[0]
    )
    return np.maximum(np.abs(cap), np.abs(annulus)) / bar
