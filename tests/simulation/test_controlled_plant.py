"""Plants under command: steps taken compiled, and commands that are not what they were."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest

from armdesign import Machine
from armdesign.errors import SimulationError
from armdesign.simulation.controlled_plant import Command, ControlledPlant
from armdesign.simulation.excitation import SweptSine, SymmetricCommand, SymmetricValve
from armdesign.simulation.integrator import Breaks, Pace, Span, System, integrate
from armdesign.simulation.plant.equilibrium import find_equilibrium
from armdesign.simulation.plant.plant import Plant
from armdesign.simulation.simulate import simulate
from tests.simulation.valves import WORST

OMEGA, TOLERANCE = 2 * math.pi * np.array([10.0, 10.0]), 1e-6


@dataclass
class OneByOne:
    """A plant that is asked for rates alone, stage by stage."""

    plant: ControlledPlant

    def rates(self, time: np.ndarray, state: np.ndarray) -> np.ndarray:
        return self.plant.rates(time, state)

    def picked(self, cases: Sequence[int]) -> OneByOne:
        return OneByOne(self.plant.picked(cases))


def plants(machine: Machine, swept: bool) -> ControlledPlant:
    """Two cases with the slow loop: swept sines, or a function without breakpoints."""
    plant = Plant(machine)
    start = find_equilibrium(plant, WORST).state
    valve = SymmetricValve.all(plant, start)[0]
    commands = []
    for amplitude in (0.01, 0.02):
        sweep = SweptSine(amplitude=amplitude, start=0.5, stop=2.0, duration=1.0)
        symmetric = SymmetricCommand(valve, 0.0, sweep)
        commands.append({machine.cylinders[0].name: symmetric if swept else symmetric.__call__})
    system = ControlledPlant.of([plant] * 2, [start] * 2, commands, [0.2, 0.2])
    return replace(system, breaks=(Breaks((0.3, 0.5), True), Breaks((0.4,), True)))


def states(system: System, plant: ControlledPlant) -> list[np.ndarray]:
    span, pace = Span.of([1.0, 0.8], [40.0, 25.0]), Pace(OMEGA, OMEGA)
    runs = integrate(system, plant.start, span, pace, plant.breaks, TOLERANCE, 100_000)
    return [np.asarray(run) for run in runs]


@pytest.mark.parametrize("swept", [True, False])
def test_compiled_steps_are_those_of_the_rates_to_the_last_bit(
    excavator: Machine, swept: bool
) -> None:
    """With breakpoints, other durations and records of each case, and commands of either kind."""
    plant = plants(excavator, swept)
    assert (plant.sweeps is not None) == swept
    one_by_one = states(OneByOne(plant), plant)
    for compiled, expected in zip(states(plant, plant), one_by_one, strict=True):
        assert compiled.tolist() == expected.tolist()
        assert np.ptp(compiled[:, 0]) > 1e-5  # it moves


@pytest.mark.parametrize("late", [[0.0, 0.0], [0.0, 0.0, 0.0, 0.0]])
def test_a_command_that_has_more_or_fewer_numbers_later(
    excavator: Machine, late: list[float]
) -> None:
    def command(time: float) -> list[float]:
        return [0.0, 0.0, 0.0] if time < 0.2 else late

    forms: Command = command
    with pytest.raises(SimulationError, match=f"command: gives {len(late)} numbers at 0.*give 3"):
        simulate(excavator, WORST, forms, duration=0.5)
