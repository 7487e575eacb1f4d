"""A machine's motion in time under spool commands: ``simulate``.

Integrated by LSODA (Petzold 1983), which needs few evaluations, bears the kinks of a valve that passes its middle and
turns implicit by itself when a fast spool makes the plant stiff.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from armdesign.arrays import Array
from armdesign.errors import SimulationError
from armdesign.machine import Machine
from armdesign.simulation.excitation import EvenOpening
from armdesign.simulation.plant import Plant
from armdesign.valve import opening, spool_position

Command: TypeAlias = Callable[[float], Sequence[float]]
ByName: TypeAlias = Mapping[str, Callable[[float], float]]

TOLERANCE = 1e-8  # relative, and absolute in rad, m, m/s, bar
MOST_EVALUATIONS = 3_000_000


@dataclass(frozen=True, eq=False)
class Simulation:
    """What happened, at n times over nq joints and nc cylinders; arrays are read-only.

    Attributes:
        time: (n,) [s].
        q: joint positions (n, nq) [rad, m].
        velocity: joint speeds (n, nq) [rad/s, m/s].
        pressures: of cap and annulus (n, nc, 2) [Pa].
        spool: positions (n, nc), −1…1.
        command: what the spools were asked for, the slow loop included (n, nc).
        flows: into cap and annulus (n, nc, 2) [m³/s].
        extensions: piston positions (n, nc) [m].
        speeds: rates of the pin-to-pin lengths (n, nc) [m/s].
        tool: position of the tool in the root link (n, 3) [m].
        cylinders: names, in order.
        joints: names, in order.
        energy: kinetic and potential energy of the links and the payload (n,) [J].
    """

    time: Array
    q: Array
    velocity: Array
    pressures: Array
    spool: Array
    command: Array
    flows: Array
    extensions: Array
    speeds: Array
    tool: Array
    energy: Array
    joints: tuple[str, ...]
    cylinders: tuple[str, ...]

    def __post_init__(self) -> None:
        for value in vars(self).values():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)


def simulate(
    machine: Machine,
    q: ArrayLike,
    command: Command | ByName,
    *,
    duration: float,
    rate: float = 200.0,
    hold: float | None = None,
    preloaded: bool | None = None,
) -> Simulation:
    """Motion of the machine under its payload from rest at one pose, by the nonlinear model of ``Plant``.

    At rest the pressures hold the load; without leakage a machine with shut valves stays there. Valves start shut,
    or, with leakage, as far open as makes up for it.

    Args:
        machine: the machine; every cylinder needs a valve.
        q: joint positions at rest (nq,) [rad, m].
        command: spool commands −1…1 at a time [s], one per cylinder (positive extends); or one function of time per
            cylinder name, the others shut.
        duration: [s].
        rate: instants recorded per second.
        hold: corner frequency [Hz] of a slow loop that keeps the piston of each commanded cylinder near its place;
            None: no loop.
        preloaded: chamber pressures at rest, see ``Plant.rest``.

    Raises:
        PoseError: the pose cannot be taken.
        SimulationError: a valve is missing, or the integration gives up.
    """
    for name, value in (("duration", duration), ("rate", rate), ("hold", 1.0 if hold is None else hold)):
        if not (math.isfinite(value) and value > 0):
            raise SimulationError(f"{machine.name}: {name}", f"{value:g} is not allowed", "give a positive number")
    plant = Plant(machine)
    loop = _Loop(plant, plant.rest(q, preloaded), command, hold)
    time = np.linspace(0.0, duration, max(round(duration * rate), 1) + 1)
    return _recorded(loop, time, _integrated(loop, time))


class _Loop:
    """Plant, command and the slow loop, as one system.

    The loop adds K (s0 − s), low-passed twice at the corner ω_c, to the valve's opening; K makes its crossover ω_c/4.
    The two lags turn what it does at a resonance above ω_c into a little damping, where a plain proportional loop,
    K_v < 2 ζ ω_n (Merritt 1967), would drive an undamped arm unstable.
    """

    def __init__(self, plant: Plant, rest: Array, command: Command | ByName, hold: float | None) -> None:
        names = [function.name for function in plant.machine.functions]
        self.plant, self._command = plant, _by_order(command, names)
        self._corner = 2 * math.pi * (hold or 0.0)
        self._place = plant.evaluate(rest.tolist(), [0.0] * plant.nc)[1]
        held = [name in command for name in names] if isinstance(command, Mapping) else [True] * plant.nc
        speeds = [even.speed for even in EvenOpening.all(plant, rest)]
        self._gains = [self._corner / 4 / v if ok else 0.0 for v, ok in zip(speeds, held, strict=True)]
        self.start = np.concatenate([rest, np.zeros(2 * plant.nc)])
        self.evaluations = 0
        if len(self._command(0.0)) != plant.nc:
            problem = f"gives {len(self._command(0.0))} numbers"
            raise SimulationError(
                f"{plant.machine.name}: command", problem, f"give one per cylinder: {', '.join(names)}"
            )

    def commands(self, time: float, corrections: Sequence[float]) -> list[float]:
        """Spool commands with the loop's correction of the opening."""
        wanted = self._command(time)
        if self._corner == 0:
            return [float(u) for u in wanted]
        return [
            spool_position(f.valve, opening(f.valve, u) + c) if gain else float(u)
            for f, u, c, gain in zip(self.plant.functions, wanted, corrections, self._gains, strict=True)
        ]

    def derivative(self, time: float, state: Array) -> list[float]:
        """Rates of the plant's state and of the loop's two low-passes."""
        self.evaluations += 1
        if self.evaluations > MOST_EVALUATIONS:
            raise _GaveUpError(time, state, f"more than {MOST_EVALUATIONS} evaluations")
        values, nc = state.tolist(), self.plant.nc
        body, first, second = values[: -2 * nc], values[-2 * nc : -nc], values[-nc:]
        try:
            rates, extensions = self.plant.evaluate(body, self.commands(time, second))
        except (ValueError, ArithmeticError):
            raise _GaveUpError(time, state, "a four-bar has opened") from None
        errors = [gain * (s0 - s) for gain, s0, s in zip(self._gains, self._place, extensions, strict=True)]
        rates += [self._corner * (e - h) for e, h in zip(errors, first, strict=True)]
        return rates + [self._corner * (h1 - h2) for h1, h2 in zip(first, second, strict=True)]


class _GaveUpError(Exception):
    """The right-hand side cannot go on, at a time [s] and state."""

    def __init__(self, time: float, state: Array, cause: str) -> None:
        super().__init__(cause)
        self.time, self.state = time, state.copy()


def _by_order(command: Command | ByName, names: Sequence[str]) -> Command:
    """The command as one call for all cylinders."""
    if not isinstance(command, Mapping):
        return command
    for name in command:
        if name not in names:
            raise SimulationError(f"command {name}", "no such cylinder", f"choose from: {', '.join(names)}")
    parts = [command.get(name, _shut) for name in names]
    return lambda time: [part(time) for part in parts]


def _shut(_: float) -> float:
    return 0.0


def _integrated(loop: _Loop, time: Array) -> Array:
    """States (n, size + 2 nc) at the times.

    Raises:
        SimulationError: with the time, the state there and a likely cause.
    """
    from scipy.integrate import solve_ivp

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # LSODA warns and fails; the failure is reported below
        try:
            run = solve_ivp(
                loop.derivative,
                (time[0], time[-1]),
                loop.start,
                method="LSODA",
                t_eval=time,
                rtol=TOLERANCE,
                atol=TOLERANCE,
            )
        except _GaveUpError as stop:
            raise _failure(loop.plant, stop.time, stop.state, str(stop)) from None
    if not run.success or not np.all(np.isfinite(run.y)):
        raise _failure(loop.plant, float(run.t[-1]), run.y[:, -1], str(run.message))
    return np.asarray(run.y.T)


def _failure(plant: Plant, time: float, state: Array, message: str) -> SimulationError:
    machine, q = plant.machine, plant.split(state[: plant.size])[0]
    where = ", ".join(f"{name} {value:.4g}" for name, value in zip(machine.joints, q, strict=True))
    return SimulationError(
        f"{machine.name}: simulation",
        f"gave up at {time:.4g} s, last known at {where} ({message})",
        "a joint driven out of its range, or a spool, friction or chamber a thousand times faster than the arm",
    )


def _recorded(loop: _Loop, time: Array, states: Array) -> Simulation:
    plant, machine = loop.plant, loop.plant.machine
    body, corrections = states[:, : plant.size], states[:, -plant.nc :]
    q, velocity, cap, annulus, spool, _ = plant.split(body)
    pressures = np.stack([cap, annulus], axis=2)
    rows = [plant.lengths(row) for row in body.tolist()]
    lengths, speeds = (np.array(column) for column in zip(*rows, strict=True))
    flows, extensions = np.empty_like(pressures), np.empty_like(lengths)
    for i, function in enumerate(plant.functions):
        records = zip(lengths[:, i].tolist(), pressures[:, i].tolist(), spool[:, i].tolist(), strict=True)
        for row, (length, (p1, p2), x) in enumerate(records):
            extensions[row, i] = function.extension(length, p1, p2)
            flows[row, i] = function.flows(p1, p2, x)
    tool = machine.arm.point(machine.arm.kinematics(q), machine.tool.link, np.array(machine.tool.at))
    pairs = zip(q.tolist(), velocity.tolist(), strict=True)
    return Simulation(
        time=time,
        q=q.copy(),
        velocity=velocity.copy(),
        pressures=pressures,
        spool=spool.copy(),
        command=np.array([loop.commands(t, c) for t, c in zip(time, corrections.tolist(), strict=True)]),
        flows=flows,
        extensions=extensions,
        speeds=speeds,
        tool=np.array(tool),
        energy=np.array([plant.dynamics.energy(a, b) for a, b in pairs]),
        joints=machine.joints,
        cylinders=tuple(function.name for function in machine.functions),
    )
