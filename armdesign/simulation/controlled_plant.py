"""Plants, their commands, the slow loop that holds the pistons' mean places, and the energy book, as one system."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np

from armdesign.arrays import Array
from armdesign.errors import SimulationError
from armdesign.hydraulics.valve import opening, spool_position
from armdesign.simulation.excitation import SymmetricValve
from armdesign.simulation.integrator import Breaks
from armdesign.simulation.plant.compiled import compiled
from armdesign.simulation.plant.plant import Plant

Command: TypeAlias = Callable[[float], Sequence[float]]
ByName: TypeAlias = Mapping[str, Callable[[float], float]]

ENERGY = 1e5  # [J] unit of energy in the state: bar × m³


@dataclass(frozen=True, eq=False)
class ControlledPlant:
    """n cases of one plant under command.

    State: the plant's, two low-passes per cylinder of the slow loop, energy supplied, put into oil
    and dissipated.

    The loop adds K (s0 − s), low-passed twice at the corner ω_c, to the valve's opening; K makes
    its crossover ω_c/4. The two lags turn what it does at a resonance above ω_c into a little
    damping, where a plain proportional loop, K_v < 2 ζ ω_n (Merritt 1967), would drive an undamped
    arm unstable.

    Attributes:
        plant: of all cases.
        start: states at t = 0 (n, size).
        asked: commands by time.
        breaks: when these jump.
        corners: ω_c (n, 1) [rad/s], 0: no loop.
        gains: K (n, nc) [1/m].
        places: s0 (n, nc) [m].
    """

    plant: Plant
    start: Array
    asked: tuple[Command, ...]
    breaks: tuple[Breaks, ...]
    corners: Array
    gains: Array
    places: Array

    @classmethod
    def of(
        cls,
        plants: Sequence[Plant],
        rests: Sequence[Array],
        commands: Sequence[Command | ByName],
        holds: Sequence[float | None],
    ) -> ControlledPlant:
        """The system of some plants of one machine each, from rest.

        Raises:
            SimulationError: a command is no function, not one per cylinder, for a cylinder that
                does not exist, or its breakpoints are no ascending times.
        """
        asked, breaks, places, gains = [], [], [], []
        corners = 2 * math.pi * np.array([[hold or 0.0] for hold in holds])
        for plant, rest, command, corner in zip(plants, rests, commands, corners, strict=True):
            names = [actuator.name for actuator in plant.machine.actuators]
            asked.append(_by_order(command, names, plant.machine.name))
            breaks.append(_breaks(command, asked[-1], plant.machine.name))
            places.append(plant.evaluate(rest[None], np.zeros((1, plant.nc))).extensions[0])
            held = [not isinstance(command, Mapping) or name in command for name in names]
            speeds = np.array([even.speed for even in SymmetricValve.all(plant, rest)])
            gains.append(np.where(held, corner / 4 / speeds, 0.0))
        start = np.concatenate([rests, np.zeros((len(rests), 2 * plants[0].nc + 3))], axis=1)
        plant = Plant(*(plant.machine for plant in plants)) if len(plants) > 1 else plants[0]
        return cls(
            plant, start, tuple(asked), tuple(breaks), corners, np.array(gains), np.array(places)
        )

    def picked(self, cases: Sequence[int]) -> ControlledPlant:
        """The system of some of the cases."""
        rows, machines = list(cases), self.plant.machines
        plant = Plant(*(machines[row] for row in rows)) if len(machines) > 1 else self.plant
        asked, breaks = (
            tuple(self.asked[row] for row in rows),
            tuple(self.breaks[row] for row in rows),
        )
        return ControlledPlant(
            plant,
            self.start[rows],
            asked,
            breaks,
            self.corners[rows],
            self.gains[rows],
            self.places[rows],
        )

    @cached_property
    def _corrects(self) -> bool:
        return bool(self.gains.any())

    def commands(self, wanted: Array, state: Array) -> Array:
        """Spool commands (n, nc): those asked for, with the loop's correction of the opening."""
        if not self._corrects:
            return wanted
        corrected = np.empty_like(wanted)
        _correct(wanted, state, self.gains, self.plant.actuators, corrected)
        return corrected

    def rates(self, time: Array, state: Array) -> Array:
        """Rates of the plants' states, of the loop's two low-passes and of the energies."""
        wanted = np.array(
            [asked(t) for asked, t in zip(self.asked, time.tolist(), strict=True)], dtype=float
        )
        found = self.plant.evaluate(state, self.commands(wanted, state))
        _follow(
            state, self.gains, self.places, self.corners, found.outputs, found.powers, found.rates
        )
        return found.rates

    def energies(self, states: Array) -> Array:
        """Energy [J] supplied, put into oil and dissipated (3, m) since the start at states (m, …) of one case."""
        return np.asarray(states[:, -3:].T * ENERGY)


def _by_order(command: Command | ByName, names: Sequence[str], machine: str) -> Command:
    """The command as one call for all cylinders."""
    if not isinstance(command, Mapping):
        count = np.size(_function(command, f"{machine}: command")(0.0))
        if count != len(names) or np.ndim(command(0.0)) != 1:
            problem = f"gives {count} number{'s' * (count != 1)}"
            raise SimulationError(
                f"{machine}: command",
                problem,
                f"give a list, one per cylinder: {', '.join(names)}",
            )
        return command
    for name, part in command.items():
        if name not in names:
            raise SimulationError(
                f"command {name}", "no such cylinder", f"choose from: {', '.join(names)}"
            )
        _function(part, f"{machine}: command {name}")
    parts = [(names.index(name), part) for name, part in command.items()]

    def asked(time: float) -> list[float]:
        spools = [0.0] * len(names)
        for index, part in parts:
            spools[index] = part(time)
        return spools

    return asked


def _breaks(command: Command | ByName, asked: Command, machine: str) -> Breaks:
    """When a command may jump, by the ``breakpoints`` of its functions.

    ``asked`` is that command by order.
    """
    parts = (
        {f" {name}": part for name, part in command.items()}
        if isinstance(command, Mapping)
        else {"": command}
    )
    told = [
        _breakpoints(part, f"{machine}: command{name}: breakpoints")
        for name, part in parts.items()
    ]
    return Breaks(
        sorted({time for times in told for time in times or ()}), None not in told, asked
    )


def _breakpoints(command: object, part: str) -> list[float] | None:
    """The ``breakpoints`` of one function [s]; None if it has none to tell."""
    given = getattr(command, "breakpoints", None)
    if given is None:
        return None
    try:
        times = np.array(given, dtype=float)
    except (TypeError, ValueError):
        times = np.array(math.nan)
    if times.ndim != 1 or not np.all(np.isfinite(times)):
        raise SimulationError(
            part, f"{given!r} are not finite times", "give a list [s], like [0.1, 0.3]"
        )
    for early, late in pairwise(times.tolist()):
        if late < early:
            raise SimulationError(part, f"{late:g} s comes after {early:g} s", "sort them")
    return list(times.tolist())


def _function(given: Any, part: str) -> Any:
    """What is given, if it can be called."""
    if not callable(given):
        raise SimulationError(
            part, f"{given!r} is not a function of time", "give one, like lambda t: 0.1"
        )
    return given


@compiled
def _correct(wanted: Any, state: Any, gains: Any, actuators: Any, corrected: Any) -> None:
    """Spool positions that open a valve by what the loop adds; those without a loop as they are.

    One machine and one row of gains serve any number of states.
    """
    n, nc = wanted.shape
    for case in range(n):
        m, row = case if len(actuators) > 1 else 0, case if len(gains) > 1 else 0
        for i in range(nc):
            corrected[case, i] = wanted[case, i]
            if gains[row, i] > 0:
                share = (
                    opening(actuators[m, i], wanted[case, i])
                    + state[case, state.shape[1] - nc - 3 + i]
                )
                corrected[case, i] = spool_position(actuators[m, i], share)


@compiled
def _follow(
    state: Any, gains: Any, places: Any, corners: Any, told: Any, power: Any, rates: Any
) -> None:
    """Write the rates of both low-passes and of the energies."""
    n, nc = gains.shape
    second = state.shape[1] - nc - 3
    first = second - nc
    for case in range(n):
        for i in range(nc):
            error, once = (
                gains[case, i] * (places[case, i] - told[case, i].extension),
                state[case, first + i],
            )
            rates[case, first + i] = corners[case, 0] * (error - once)
            rates[case, second + i] = corners[case, 0] * (once - state[case, second + i])
        for k in range(3):
            rates[case, second + nc + k] = power[case, k] / ENERGY
