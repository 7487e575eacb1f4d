"""Plants under command: with the slow loop that holds pistons' mean positions, and energies."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TypeAlias

import numpy as np

from armdesign.arrays import Array
from armdesign.errors import SimulationError, choose
from armdesign.hydraulics.valve import opening, spool_position
from armdesign.simulation.excitation import SymmetricValve, sweeps_of, write_sweeps
from armdesign.simulation.integrator import Breaks
from armdesign.simulation.plant.compiled import Records, compiled, resolved
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
    """

    plant: Plant  # of all cases
    start: Array  # states at t = 0 (n, size)
    demands: tuple[Command, ...]  # spool commands by time
    sweeps: Records | None  # the same as records (n,), where each is one swept sine
    breaks: tuple[Breaks, ...]  # when these jump
    corners: Array  # ω_c (n, 1) [rad/s], 0: no loop
    gains: Array  # K (n, nc) [1/m]
    places: Array  # s0 (n, nc) [m]

    @classmethod
    def of(
        cls,
        plants: Sequence[Plant],
        starts: Sequence[Array],
        commands: Sequence[Command | ByName],
        holds: Sequence[float | None],
    ) -> ControlledPlant:
        """The system of some plants of one machine each, from their states at t = 0.

        Raises:
            SimulationError: a command is no function, not one per cylinder, for a cylinder that
                does not exist, or its breakpoints are no ascending times.
        """
        demands, breaks, places, gains = [], [], [], []
        corners = 2 * math.pi * np.array([[hold or 0.0] for hold in holds])
        for plant, start, command, corner in zip(plants, starts, commands, corners, strict=True):
            names = [actuator.name for actuator in plant.machine.actuators]
            demands.append(_by_order(command, names, plant.machine.name))
            breaks.append(breaks_of(command, plant.machine.name))
            places.append(plant.evaluate(start[None], np.zeros((1, plant.nc))).extensions[0])
            held = [not isinstance(command, Mapping) or name in command for name in names]
            speeds = np.array([valve.speed for valve in SymmetricValve.all(plant, start)])
            gains.append(np.where(held, corner / 4 / speeds, 0.0))
        own = np.zeros((len(starts), 2 * plants[0].nc + 3))
        return cls(
            plant=Plant(*(plant.machine for plant in plants)) if len(plants) > 1 else plants[0],
            start=np.concatenate([starts, own], axis=1),
            demands=tuple(demands),
            sweeps=sweeps_of(commands, [plant.machine for plant in plants]),
            breaks=tuple(breaks),
            corners=corners,
            gains=np.array(gains),
            places=np.array(places),
        )

    def picked(self, cases: Sequence[int]) -> ControlledPlant:
        """The system of some of the cases."""
        rows, machines = list(cases), self.plant.machines
        plant = Plant(*(machines[row] for row in rows)) if len(machines) > 1 else self.plant
        return replace(
            self,
            plant=plant,
            start=self.start[rows],
            demands=tuple(self.demands[row] for row in rows),
            sweeps=None if self.sweeps is None else self.sweeps[rows],
            breaks=tuple(self.breaks[row] for row in rows),
            corners=self.corners[rows],
            gains=self.gains[rows],
            places=self.places[rows],
        )

    @cached_property
    def _corrects(self) -> bool:
        return bool(self.gains.any())

    @cached_property
    def _kernels(self) -> dict[str, Callable[..., None]]:
        """Compiled functions by name, each for the types that all its calls here have."""
        return {}

    def _run(self, kernel: Callable[..., None], *arguments: object) -> None:
        """Call a compiled function, whose types are looked at once."""
        name = kernel.__name__
        if name not in self._kernels:
            self._kernels[name] = resolved(kernel, *arguments)
        self._kernels[name](*arguments)

    def commands(self, demand: Array, state: Array) -> Array:
        """Spool commands (n, nc): the demands, with the loop's correction of the opening.

        Args:
            demand: (n, nc).
            state: (n, size), without gaps in memory.
        """
        if not self._corrects:
            return demand
        corrected, actuators = np.empty(demand.shape), self.plant.parameters.actuators
        self._run(_correct, demand, state, self.gains, actuators, corrected)
        return corrected

    def commands_at(self, time: Array, states: Array) -> Array:
        """Spool commands (m, nc) of one case at its instants (m,) [s] and states there."""
        demands = self._demands(time, self.demands * len(time))
        return self.commands(demands, np.ascontiguousarray(states))

    def _demands(self, time: Array, demands: Sequence[Command]) -> Array:
        """Spool commands (n, nc) at times (n,) [s], one of each function."""
        if self.sweeps is None:
            pairs = zip(demands, time.tolist(), strict=True)
            return np.array([demand(t) for demand, t in pairs], dtype=float)
        time, spools = np.array(time, dtype=float), np.zeros((len(time), self.plant.nc))
        self._run(write_sweeps, time, self.sweeps, spools)
        return spools

    def rates(self, time: Array, state: Array) -> Array:
        """Rates of the plants' states, of the loop's two low-passes and of the energies."""
        state = np.ascontiguousarray(state, dtype=float)
        command = self.commands(self._demands(time, self.demands), state)
        evaluation = self.plant.evaluate(state, command)
        rates, outputs, powers, _ = evaluation
        loop = self.gains, self.places, self.corners
        self._run(_follow, state, *loop, outputs, powers, rates)
        return rates

    def energies(self, states: Array) -> Array:
        """Energy [J] supplied, put into oil and dissipated (3, m) since the start of one case."""
        return np.asarray(states[:, -3:].T * ENERGY)


def _by_order(command: Command | ByName, names: Sequence[str], machine: str) -> Command:
    """The command as one call for all cylinders."""
    if not isinstance(command, Mapping):
        _refuse_no_function(command, f"{machine}: command")
        count = np.size(command(0.0))
        if count != len(names) or np.ndim(command(0.0)) != 1:
            fault = f"gives {count} number{'s' * (count != 1)}"
            remedy = f"give a list, one per cylinder: {', '.join(names)}"
            raise SimulationError(f"{machine}: command", fault, remedy)
        return command
    for name, part in command.items():
        if name not in names:
            raise SimulationError(f"command {name}", "no such cylinder", choose(name, names))
        _refuse_no_function(part, f"{machine}: command {name}")
    parts = [(names.index(name), part) for name, part in command.items()]

    def demand(time: float) -> list[float]:
        spools = [0.0] * len(names)
        for index, part in parts:
            spools[index] = part(time)
        return spools

    return demand


def breaks_of(command: Command | ByName, machine: str) -> Breaks:
    """Instants at which a command may jump, by the ``breakpoints`` of its functions.

    Raises:
        SimulationError: breakpoints are no ascending times.
    """
    functions: Mapping[str, object] = {"": command}
    if isinstance(command, Mapping):
        functions = {f" {name}": function for name, function in command.items()}
    stated = [
        _breakpoints(function, f"{machine}: command{name}: breakpoints")
        for name, function in functions.items()
    ]
    instants = {time for times in stated for time in times or ()}
    return Breaks(sorted(instants), complete=None not in stated)


def _breakpoints(command: object, part: str) -> list[float] | None:
    """The ``breakpoints`` of one function [s]; None if it states none."""
    given = getattr(command, "breakpoints", None)
    if given is None:
        return None
    try:
        times = np.array(given, dtype=float)
    except (TypeError, ValueError):
        times = np.array(math.nan)
    if times.ndim != 1 or not np.all(np.isfinite(times)):
        fault = f"{given!r} are not finite times"
        raise SimulationError(part, fault, "give a list [s], like [0.1, 0.3]")
    for early, late in pairwise(times.tolist()):
        if late < early:
            raise SimulationError(part, f"{late:g} s comes after {early:g} s", "sort them")
    return list(times.tolist())


def _refuse_no_function(given: object, part: str) -> None:
    if not callable(given):
        fault = f"{given!r} is not a function of time"
        raise SimulationError(part, fault, "give one, like lambda t: 0.1")


@compiled
def _correct(
    demand: Array, state: Array, gains: Array, actuators: Records, corrected: Array
) -> None:
    """Write spool positions that open a valve by what the loop adds, with any number of states."""
    n, nc = demand.shape
    for case in range(n):
        m, row = case if len(actuators) > 1 else 0, case if len(gains) > 1 else 0
        for i in range(nc):
            corrected[case, i] = demand[case, i]
            if gains[row, i] > 0:
                correction = state[case, state.shape[1] - nc - 3 + i]
                share = opening(actuators[m, i], demand[case, i]) + correction
                corrected[case, i] = spool_position(actuators[m, i], share)


@compiled
def _follow(
    state: Array,
    gains: Array,
    places: Array,
    corners: Array,
    outputs: Records,
    powers: Array,
    rates: Array,
) -> None:
    """Write the rates of both low-passes and of the energies."""
    n, nc = gains.shape
    second = state.shape[1] - nc - 3
    first = second - nc
    for case in range(n):
        for i in range(nc):
            error = gains[case, i] * (places[case, i] - outputs[case, i].extension)
            once = state[case, first + i]
            rates[case, first + i] = corners[case, 0] * (error - once)
            rates[case, second + i] = corners[case, 0] * (once - state[case, second + i])
        for k in range(3):
            rates[case, second + nc + k] = powers[case, k] / ENERGY
