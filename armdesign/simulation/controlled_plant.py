"""Plants under command: with the slow loop that holds pistons' mean positions, and energies."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from armdesign.arrays import Array
from armdesign.errors import SimulationError, choose
from armdesign.hydraulics.valve import opening, spool_position
from armdesign.simulation.dormand_prince import (
    BEGIN,
    Steps,
    begin_steps,
    finish_steps,
    place_stage,
)
from armdesign.simulation.excitation import SWEEP, SymmetricValve, sweeps_of, write_sweeps
from armdesign.simulation.integrator import STIFF, Breaks
from armdesign.simulation.plant.compiled import (
    Records,
    as_argument,
    borrowing,
    new_records,
    resolved,
    within,
)
from armdesign.simulation.plant.hydraulics import OUTPUT
from armdesign.simulation.plant.plant import (
    Layout,
    Parameters,
    Plant,
    PlantInstant,
    Scratch,
    evaluate_cases,
)

Command: TypeAlias = Callable[[float], Sequence[float]]
ByName: TypeAlias = Mapping[str, Callable[[float], float]]

ENERGY = 1e5  # [J] unit of energy in the state: bar × m³
STIFF_SWEEPS = 15.0  # as ``STIFF`` where commands are compiled sweeps, whose steps cost a third


class Cases(NamedTuple):
    """Everything that compiled functions need of n cases."""

    evaluate: Callable[..., None]  # ``evaluate_cases``
    equations: tuple[Parameters, Layout, Scratch]  # of the plant
    gains: Array  # of the slow loop (n, nc)
    places: Array  # that it holds (n, nc)
    corners: Array  # of its low-passes (n, 1)
    sweeps: Records  # commands (n,); none: they are not compiled
    commands: Array  # of the spools (n, nc), to be written
    outputs: tuple[Records, Array, Array]  # of ``PlantInstant``, to be written


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
        rows, plant = list(cases), self.plant
        return replace(
            self,
            plant=plant.picked(rows) if len(plant.machines) > 1 else plant,
            start=self.start[rows],
            demands=tuple(self.demands[row] for row in rows),
            sweeps=None if self.sweeps is None else self.sweeps[rows],
            breaks=tuple(self.breaks[row] for row in rows),
            corners=self.corners[rows],
            gains=self.gains[rows],
            places=self.places[rows],
        )

    @property
    def stiff(self) -> float:
        """How much shorter than stability asks steps must be, so that LSODA is faster."""
        return STIFF if self.sweeps is None else STIFF_SWEEPS

    @cached_property
    def _kernels(self) -> dict[str, Callable[..., Any]]:
        """Compiled functions by name, each for the types that all its calls here have."""
        return {}

    def _run(self, kernel: Callable[..., Any], *arguments: object) -> Any:
        """Call a compiled function, whose types are looked at once."""
        name = kernel.__name__
        if name not in self._kernels:
            self._kernels[name] = resolved(kernel, *arguments)
        return self._kernels[name](*arguments)

    @cached_property
    def _cases(self) -> Cases:
        """Everything that compiled functions need."""
        plant, sweeps, n = self.plant, self.sweeps, self.gains.shape
        equations, commands = (plant.parameters, plant.layout, plant.scratch), np.empty(n)
        outputs: tuple[Records, Array, Array]
        outputs = (np.empty(n, OUTPUT), np.empty((n[0], 3)), np.empty(n[0]))
        instant = PlantInstant(np.empty_like(self.start), *outputs)
        return Cases(
            evaluate=as_argument(evaluate_cases, self.start, commands, *equations, instant),
            equations=equations,
            gains=self.gains,
            places=self.places,
            corners=self.corners,
            sweeps=new_records(0, SWEEP) if sweeps is None else sweeps,
            commands=commands,
            outputs=outputs,
        )

    def commands_at(self, time: Array, states: Array) -> Array:
        """Spool commands (m, nc) of one case at its instants (m,) [s] and states there.

        They are the demands, with the loop's correction of the opening.
        """
        demands = self._demands(time, self.demands * len(time))
        commands, actuators = np.empty_like(demands), self.plant.parameters.actuators
        states = np.ascontiguousarray(states)
        self._run(_correct, demands, states, actuators, self.gains, commands)
        return commands

    def _demands(self, time: Array, demands: Sequence[Command]) -> Array:
        """Spool commands (n, nc) at times (n,) [s], one of each function."""
        if self.sweeps is None:
            pairs = zip(demands, time.tolist(), strict=True)
            given = [demand(t) for demand, t in pairs]
            spools = _as_numbers(given)
            if spools.shape != (len(time), self.plant.nc):
                count = np.size(_as_numbers(given[0]))
                fault = f"gives {count} number{'s' * (count != 1)} at {time[0]:g} s"
                remedy = f"give {self.plant.nc} at all times"
                raise SimulationError(f"{self.plant.machine.name}: command", fault, remedy)
            return spools
        time, spools = np.array(time, dtype=float), np.zeros((len(time), self.plant.nc))
        self._run(write_sweeps, time, self.sweeps, spools)
        return spools

    def rates(self, time: Array, state: Array) -> Array:
        """Rates of the plants' states, of the loop's two low-passes and of the energies."""
        state = np.ascontiguousarray(state, dtype=float)
        if state.shape != self.start.shape:
            raise ValueError(f"states {state.shape}: not {self.start.shape}")
        rates = np.empty_like(state)
        self._run(_evaluate, state, self._demands(time, self.demands), self._cases, rates)
        return rates

    def take_steps(self, most: int, steps: Steps) -> tuple[int, int]:
        """Take steps, at most so many, until a case has halted: how many, and cases halted.

        Commands that are not compiled allow one at a time.
        """
        if self.sweeps is None:
            self._run(BEGIN, steps)
            demands = np.array([self._demands(time, self.demands) for time in steps.stages.at])
            most = 1
        else:
            demands = np.zeros((6, len(self.start), self.plant.nc))
        taken, halted = self._run(_take_steps, most, steps, demands, self._cases)
        return taken, halted

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


def _as_numbers(given: object) -> Array:
    """What commands give as an array; without numbers where it is words or uneven lists."""
    try:
        return np.array(given, dtype=float)
    except (TypeError, ValueError):
        return np.zeros(0)


def _refuse_no_function(given: object, part: str) -> None:
    if not callable(given):
        fault = f"{given!r} is not a function of time"
        raise SimulationError(part, fault, "give one, like lambda t: 0.1")


@borrowing
def _take_steps(most: int, steps: Steps, demands: Array, cases: Cases) -> tuple[int, int]:
    """As ``take_steps``; demands (6, n, nc) of the stages are written where they are sweeps."""
    stages = steps.stages
    for taken in range(1, most + 1):
        begin_steps(steps)
        for stage in range(6):
            if len(cases.sweeps) > 0:
                write_sweeps(stages.at[stage], cases.sweeps, demands[stage])
            place_stage(stage, steps)
            _write_rates(stages.ahead, demands[stage], cases, stages.slopes[stage + 1])
        halted = finish_steps(steps)
        if halted > 0:
            return taken, halted
    return most, 0


@borrowing
def _evaluate(state: Array, demand: Array, cases: Cases, rates: Array) -> None:
    """As ``_write_rates``, to be called from Python."""
    _write_rates(state, demand, cases, rates)


@within
def _write_rates(state: Array, demand: Array, cases: Cases, rates: Array) -> None:
    """Write the rates of all cases at states (n, size), under demands (n, nc)."""
    outputs, powers, springs = cases.outputs
    parameters, layout, scratch = cases.equations
    _correct(demand, state, parameters.actuators, cases.gains, cases.commands)
    instant = PlantInstant(rates, outputs, powers, springs)
    cases.evaluate(state, cases.commands, parameters, layout, scratch, instant)
    _follow(state, cases.gains, cases.places, cases.corners, instant)


@borrowing
def _correct(
    demand: Array, state: Array, actuators: Records, gains: Array, corrected: Array
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


@within
def _follow(
    state: Array, gains: Array, places: Array, corners: Array, instant: PlantInstant
) -> None:
    """Write the rates of both low-passes and of the energies."""
    n, nc = gains.shape
    rates, outputs = instant.rates, instant.outputs
    second = state.shape[1] - nc - 3
    first = second - nc
    for case in range(n):
        for i in range(nc):
            error = gains[case, i] * (places[case, i] - outputs[case, i].extension)
            once = state[case, first + i]
            rates[case, first + i] = corners[case, 0] * (error - once)
            rates[case, second + i] = corners[case, 0] * (once - state[case, second + i])
        for k in range(3):
            rates[case, second + nc + k] = instant.powers[case, k] / ENERGY
