"""A machine's motion in time under spool commands: ``simulate``, and many at once: ``simulate_all``."""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from armdesign.arrays import Array
from armdesign.errors import SimulationError, raise_together
from armdesign.frequency.modes import natural_modes
from armdesign.hydraulics.actuator import Cylinder, Motor
from armdesign.machine.machine import Machine
from armdesign.simulation.controlled_plant import ENERGY, ByName, Command, ControlledPlant
from armdesign.simulation.events import events, pump_events
from armdesign.simulation.integrator import NO_LIMIT, TOO_MANY, GaveUpError, integrate
from armdesign.simulation.plant.equilibrium import Holding
from armdesign.simulation.plant.plant import Plant, stack_shape

TOLERANCE = 1e-8  # relative, and absolute in rad, m, m/s, bar
MOST_STEPS = 500_000
INSTANT = 1e-9  # [s] beyond a state, where the next one could not be reached
FAR_BEYOND = 0.05  # of the stroke: no stop gives way so far
F = TypeVar("F", Cylinder, Motor)


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
        energy: kinetic and potential energy of links, bars and payload (n,) [J].
        supplied: energy since the start that the pump gave, less what oil took back to the tank
            (n,) [J].
        stored: growth of kinetic and potential energy and of that in compliances and stops, and
            the work that has compressed oil and hoses (n,) [J]. That oil enters or leaves a
            chamber compressed, with about p²/2β in each m³ (1 % of its work p Q at 300 bar), is
            left out here and in ``supplied``: see ``plant``.
        dissipated: by valves, reliefs, leakage, friction and stops (n,) [J].
        supply: pressure of the pump (n,) [Pa].
        events: what limited the motion, in words and in order: loads that cannot be held, stops,
            cavitation, reliefs, the pump.
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
    supplied: Array
    stored: Array
    dissipated: Array
    supply: Array
    joints: tuple[str, ...]
    cylinders: tuple[str, ...]
    events: tuple[str, ...]

    def __post_init__(self) -> None:
        for value in vars(self).values():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)

    @property
    def energy_error(self) -> float:
        """Largest difference of the balance, supplied = stored + dissipated, over the largest of its terms.

        A closed machine without damping exchanges energy within itself: there it is that of
        kinetic and potential.
        """
        gap = np.abs(self.supplied - self.stored - self.dissipated).max()
        terms = [np.abs(term).max() for term in (self.supplied, self.stored, self.dissipated)]
        least = TOLERANCE * (
            ENERGY + np.abs(self.energy).max()
        )  # at rest nothing is exchanged, but rounding
        return float(gap / max(*terms, np.ptp(self.energy), least))


@dataclass(frozen=True, eq=False, kw_only=True)
class Case:
    """One run of ``simulate_all``; its fields are the arguments of ``simulate``."""

    machine: Machine
    q: ArrayLike
    command: Command | ByName
    duration: float
    rate: float = 200.0
    velocity: ArrayLike | None = None
    hold: float | None = None
    preloaded: bool | None = None
    supply_pressure: float | None = None


def simulate(
    machine: Machine,
    q: ArrayLike,
    command: Command | ByName,
    *,
    duration: float,
    rate: float = 200.0,
    velocity: ArrayLike | None = None,
    hold: float | None = None,
    preloaded: bool | None = None,
    supply_pressure: float | None = None,
    tolerance: float = TOLERANCE,
) -> Simulation:
    """Motion of the machine under its payload from one pose, by the nonlinear model of ``Plant``.

    At rest the pressures hold the load: the loaded chamber carries it, the other is at return
    pressure or at the preload that the machine file asks for. Without leakage a machine with shut
    valves stays there. Valves start shut, or, with leakage, as far open as makes up for it. What
    cannot be held is told in ``events``. With ``velocity`` it starts as if struck: at the same
    pose and pressures, but moving. With all valves shut it then rings freely, for
    ``identify_ringdown``.

    Args:
        machine: the machine; every cylinder needs a valve.
        q: joint positions at the start (nq,) [rad, m].
        command: spool commands −1…1 at a time [s], one per cylinder (positive extends); or one
            function of time per cylinder name, the others shut. One that says by an attribute
            ``breakpoints`` [s], ascending, when it or its slope jumps, as ``Step`` and ``Table``
            do, is followed exactly, however short a pulse.
        duration: [s].
        rate: instants recorded per second. A command without ``breakpoints`` is looked at four
            times as often, and no step longer than half the interval goes across a bend of it:
                what is shorter than that may be missed.
        velocity: joint speeds at the start (nq,) [rad/s, m/s]; None: at rest.
        hold: corner frequency [Hz] of a slow loop that keeps the piston of each commanded cylinder
            near its place; None: no loop.
        preloaded: chamber pressures at rest, see ``Plant.rest``.
        supply_pressure: that the pump holds [Pa] instead of the machine's, to which its reliefs
            stay set. 0: a dead pump, open to whatever flows back.
        tolerance: of a step's error, relative, and absolute in rad, m, m/s, bar.

    Raises:
        PoseError: the pose cannot be taken.
        SimulationError: a valve is missing, or the integration gives up.
    """
    case = Case(
        machine=machine,
        q=q,
        command=command,
        duration=duration,
        rate=rate,
        velocity=velocity,
        hold=hold,
        preloaded=preloaded,
        supply_pressure=supply_pressure,
    )
    return simulate_all([case], tolerance=tolerance)[0]


def simulate_all(cases: Sequence[Case], *, tolerance: float = TOLERANCE) -> list[Simulation]:
    """Many runs as stacked systems, far faster than one by one and with the same results.

    Cases of one shape (the same joints, cylinders between them and motors) make one system, each
    with steps of its own.

    Args:
        cases: the runs; poses, payloads, commands, durations and machines may differ.
        tolerance: of a step's error, relative, and absolute in rad, m, m/s, bar.

    Raises:
        PoseError: a pose cannot be taken.
        SimulationError: a valve is missing, or the integration of some cases gives up: all of them
            are named.
    """
    found = attempt_all(cases, tolerance=tolerance)
    raise_together([run for run in found if isinstance(run, SimulationError)])
    return [run for run in found if isinstance(run, Simulation)]


def attempt_all(
    cases: Sequence[Case], *, tolerance: float = TOLERANCE
) -> list[Simulation | SimulationError]:
    """As ``simulate_all``.

    But a case whose integration gives up is an error in its place, and the others go on.

    Raises:
        PoseError: a pose cannot be taken.
        SimulationError: a valve is missing, or an argument is out of its range.
    """
    if not 0 < tolerance < 1:
        raise SimulationError("tolerance", f"{tolerance:g} is not in (0, 1)", "give one like 1e-6")
    stacks: dict[Hashable, list[int]] = {}
    cases = [_supplied(case) for case in cases]
    for index, case in enumerate(cases):
        _refuse(case)
        stacks.setdefault(stack_shape(case.machine), []).append(index)
    found: dict[int, Simulation | SimulationError] = {}
    for rows in stacks.values():
        found |= dict(zip(rows, _stacked([cases[row] for row in rows], tolerance), strict=True))
    return [found[index] for index in range(len(cases))]


def _supplied(case: Case) -> Case:
    """The case on a machine whose pump holds the pressure asked for, with the reliefs where they are today."""
    pressure, machine = case.supply_pressure, case.machine
    if pressure is None:
        return case
    if not (math.isfinite(pressure) and pressure >= 0):
        raise SimulationError(
            f"{machine.name}: supply_pressure", f"{pressure:g} Pa is not allowed", "give 0 or more"
        )

    def set_as_today(actuator: F) -> F:
        valve = actuator.valve
        if valve is None or valve.relief is not None:
            return actuator
        return replace(actuator, valve=replace(valve, relief=actuator.relief(machine.supply)))

    flow_limited = (
        machine.supply.flow_limited and pressure > 0
    )  # a dead pump has no share of its pressure to cut off at
    supplied = replace(
        machine,
        supply=replace(machine.supply, pressure=float(pressure), flow_limited=flow_limited),
        cylinders=tuple(map(set_as_today, machine.cylinders)),
        motors=tuple(map(set_as_today, machine.motors)),
    )
    return replace(case, machine=supplied)


def _refuse(case: Case) -> None:
    name, hold = case.machine.name, 1.0 if case.hold is None else case.hold
    for what, value in (("duration", case.duration), ("rate", case.rate), ("hold", hold)):
        if not (math.isfinite(value) and value > 0):
            raise SimulationError(
                f"{name}: {what}", f"{value:g} is not allowed", "give a positive number"
            )
    if case.velocity is not None:
        given, joints = np.asarray(case.velocity, dtype=float), case.machine.joints
        if given.shape != (len(joints),) or not np.all(np.isfinite(given)):
            problem = f"{given.tolist()} is not one finite number per joint"
            raise SimulationError(
                f"{name}: velocity", problem, f"give {', '.join(joints)} [rad/s, m/s]"
            )


def _stacked(cases: Sequence[Case], tolerance: float) -> list[Simulation | SimulationError]:
    """Runs of one shape."""
    plants = [Plant(case.machine) for case in cases]
    starts, held = zip(
        *(_start(plant, case) for plant, case in zip(plants, cases, strict=True)), strict=True
    )
    loop = ControlledPlant.of(plants, starts, [case.command for case in cases], [case.hold for case in cases])
    return [
        (
            _failure(loop.picked([row]), states, tolerance)
            if isinstance(states, GaveUpError)
            else _recorded(loop.picked([row]), float(case.duration), states, _unheld(held[row]))
        )
        for row, (case, states) in enumerate(
            zip(cases, _states(loop, cases, tolerance), strict=True)
        )
    ]


def _start(plant: Plant, case: Case) -> tuple[Array, tuple[Holding, ...]]:
    """State (size,) at t = 0: rest, but for the velocity.

    And how each actuator holds its load there.
    """
    state, held = plant.resting(case.q, case.preloaded)
    if case.velocity is not None:
        plant.split(state)[1][:] = case.velocity
    return state, held


def _unheld(held: Sequence[Holding]) -> list[str]:
    """What is not held at t = 0, in words: loads above a relief, leaks that no spool position makes up for."""
    overcome, creeps = (
        [getattr(one, what) for one in held if getattr(one, what)]
        for what in ("overcome", "creeps")
    )
    return [
        *(f"{words} at 0 s" for words in overcome),
        *(f"{words} from 0 s on" for words in creeps),
    ]


def _states(loop: ControlledPlant, cases: Sequence[Case], tolerance: float) -> list[Array | GaveUpError]:
    """States of all cases at their instants, or why there are none."""
    durations = np.array([case.duration for case in cases], dtype=float)
    fastest = np.array(
        [2 * math.pi * natural_modes(c.machine.at(c.q)).frequencies.max() for c in cases]
    )
    spools = [
        max(f.valve.natural_frequency for f in c.machine.actuators if f.valve) for c in cases
    ]
    swiftest = np.maximum(fastest, 2 * math.pi * np.array(spools))
    counts = np.array([max(round(case.duration * case.rate), 1) for case in cases])
    return integrate(
        loop, loop.start, durations, counts, fastest, tolerance, MOST_STEPS, swiftest, loop.breaks
    )


def _failure(loop: ControlledPlant, stop: GaveUpError, tolerance: float) -> SimulationError:
    machine, (q, velocity, *_) = (
        loop.plant.machine,
        loop.plant.split(stop.state[: loop.plant.size]),
    )
    where = ", ".join(f"{name} {value:.4g}" for name, value in zip(machine.joints, q, strict=True))
    return SimulationError(
        f"{machine.name}: simulation",
        f"gave up at {stop.time:.4g} s, last known at {where} ({stop.cause})",
        _likely_cause(
            machine,
            q + INSTANT * velocity,
            loop.asked[0](stop.time + INSTANT),
            stop.cause,
            tolerance,
        ),
    )


def _likely_cause(
    machine: Machine,
    q: Array,
    asked: Sequence[float],
    cause: str = "",
    tolerance: float = TOLERANCE,
) -> str:
    """What to look at when an integration has stopped at a pose under some commands, and said why."""
    for value in asked:
        if not math.isfinite(value):
            return f"the command gives {value:g} there: give −1…1"
    for cylinder, margin in zip(machine.actuators, machine.margins(q)[0], strict=True):
        if margin == -np.inf:
            return f"the four-bar of {cylinder.name} does not close there: command it less far"
        if margin < -FAR_BEYOND:
            return (
                f"{cylinder.name} is {-100 * margin:.0f} % of its stroke beyond a stop: command it"
                " less far"
            )
    fast = "a spool, friction or chamber a thousand times faster than the arm"
    if NO_LIMIT in cause:
        return f"smooth a command that jumps again and again, or slow down {fast}"
    if TOO_MANY in cause:
        remedy = (
            f"give a coarser tolerance than {tolerance:g}, a shorter duration or a smoother"
            " command"
        )
        return f"{remedy}, or slow down {fast}"
    return f"a joint driven out of its range, or {fast}"


def _recorded(loop: ControlledPlant, duration: float, states: Array, unheld: Sequence[str]) -> Simulation:
    """The run, and among its events what its rest does not hold, in words."""
    plant, machine = loop.plant, loop.plant.machine
    time, body = np.linspace(0.0, duration, len(states)), states[:, : plant.size]
    commands = loop.commands(
        np.array([loop.asked[0](t) for t in time.tolist()], dtype=float), states
    )
    found = plant.evaluate(body, commands)
    q, velocity, _, _, spool, _ = plant.split(body)
    pressures = plant.pressures(body)
    energy, supply, taken = (
        plant.forward_dynamics.energy(q, velocity),
        plant.supply_pressure(body),
        found.outputs["supplied"],
    )
    relief = plant.actuators["relief"][0]
    told = [*events(machine, relief, time, found.extensions, pressures, spool, taken)]
    told += pump_events(machine, time, supply, taken)
    told += [(0.0, words) for words in unheld]
    supplied, oil, dissipated = loop.energies(states)
    tool = machine.arm.point(
        machine.arm.kinematics(q), machine.tool.link, np.array(machine.tool.at)
    )
    return Simulation(
        time=time,
        q=q.copy(),
        velocity=velocity.copy(),
        pressures=np.swapaxes(pressures, 1, 2).copy(),
        spool=spool.copy(),
        command=commands,
        flows=found.valve_flows,
        extensions=found.extensions,
        speeds=found.outputs["speed"].copy(),
        tool=np.array(tool),
        energy=energy,
        supplied=supplied,
        stored=energy - energy[0] + found.springs - found.springs[0] + oil,
        dissipated=dissipated,
        supply=supply,
        events=tuple(words for _, words in sorted(told)),
        joints=machine.joints,
        cylinders=tuple(actuator.name for actuator in machine.actuators),
    )
