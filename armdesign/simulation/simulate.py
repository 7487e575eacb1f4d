"""A machine's motion in time under spool commands: ``simulate``, and many: ``simulate_all``."""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike

from armdesign.arguments import checked, with_options
from armdesign.arrays import Array
from armdesign.errors import SimulationError, raise_together
from armdesign.frequency.modes import natural_modes
from armdesign.machine.actuators import F, with_each
from armdesign.machine.machine import Machine
from armdesign.machine.poses import pose_text, refuse_unheld
from armdesign.short_repr import short_repr
from armdesign.simulation.controlled_plant import ByName, Command, ControlledPlant
from armdesign.simulation.events import events, pose_events, pump_events
from armdesign.simulation.integrator import NO_LIMIT, TOO_MANY, GaveUpError, Pace, Span, integrate
from armdesign.simulation.plant.equilibrium import Equilibrium, StaticHold, find_equilibrium
from armdesign.simulation.plant.plant import Plant, stack_shape
from armdesign.simulation.plant.springs import settled
from armdesign.simulation.run import Simulation

TOLERANCE = 1e-8  # relative, and absolute in rad, m, m/s, bar
MOST_STEPS = 500_000
MOST_RECORDS = 10_000_000  # instants of a run: some gigabytes
INSTANT = 1e-9  # [s] beyond a state, where the next one could not be reached
FAR_BEYOND = 0.05  # of the stroke: no stop gives way so far


@dataclass(frozen=True, eq=False, kw_only=True)
class SimulationCase:
    """One run of ``simulate_all``; its fields are the arguments of ``simulate``."""

    __repr__ = short_repr

    machine: Machine
    q: ArrayLike
    command: Command | ByName
    duration: float
    payload: str | float | None = None
    rate: float = 200.0
    velocity: ArrayLike | None = None
    hold: float | None = None
    preloaded: bool | None = None
    supply_pressure: float | None = None


class RunConditions(TypedDict, total=False):
    """Fields of ``SimulationCase`` that few runs need: how it starts, and what is held."""

    velocity: ArrayLike | None
    hold: float | None
    preloaded: bool | None
    supply_pressure: float | None


@checked
@with_options(RunConditions, dict.fromkeys(RunConditions.__annotations__))
def simulate(
    machine: Machine,
    q: ArrayLike,
    command: Command | ByName,
    *,
    duration: float,
    payload: str | float | None = None,
    rate: float = 200.0,
    tolerance: float = TOLERANCE,
    **conditions: Unpack[RunConditions],
) -> Simulation:
    """Motion of the machine under a load case from one pose, by the nonlinear model of ``Plant``.

    It starts from equilibrium: the loaded chamber carries the load, the other is at return
    pressure or at the preload that the machine file asks for. Without leakage a machine with
    closed valves stays there. Valves start closed, or, with leakage, as far open as makes up for
    it. Springs stand where the file has them. What cannot be held is said in ``events``. With
    ``velocity`` it starts as if struck: at the same pose and pressures, but moving. With all
    valves closed it then rings freely, for ``identify_ringdown``.

    Args:
        machine: the machine; every cylinder needs a valve.
        q: joint positions at the start (nq,) [rad, m].
        command: spool commands −1…1 at a time [s], one per cylinder (positive extends); or one
            function of time per cylinder name, the others closed. One that says by an attribute
            ``breakpoints`` [s], ascending, when it or its slope jumps, as ``Step`` and ``Table``
            do, is followed exactly, however short a pulse.
        duration: [s].
        payload: a load case by name, which must exist at the pose, or a mass [kg]; None: the
            machine's own. ``Simulation.payload`` says which it was.
        rate: instants recorded per second. Under a command without ``breakpoints`` no step is
            longer than half the interval between them: a pulse that is shorter may be missed.
        velocity: joint speeds at the start (nq,) [rad/s, m/s]; None: at rest.
        hold: corner frequency [Hz] of a slow loop that keeps the piston of each commanded cylinder
            near its place; None: no loop.
        preloaded: chamber pressures at the start. None: as above. True: p1 + p2 = supply + return
            (less where a relief would open), which keeps both chambers far from cavitation. False:
            the unloaded chamber at return pressure whatever the file asks for, and valves closed
            even if they leak: then the load creeps.
        supply_pressure: that the pump holds [Pa] instead of the machine's, to which its reliefs
            stay set. 0: a dead pump, open to whatever flows back.
        tolerance: of a step's error, relative, and absolute in rad, m, m/s, bar.

    Raises:
        ArmDesignError: there is no such load case.
        PoseError: the pose cannot be taken, or the load case does not exist there.
        SimulationError: a valve is missing, or the integration gives up.

    Example:
        >>> import armdesign as ad
        >>> machine = ad.load("paper_1dof")
        >>> run = ad.simulate(machine, [0.0], {"lift": ad.Step(size=0.05)}, duration=0.2)
        >>> print(f"{run.q[-1, 0]:.4f} rad")
        -0.0345 rad
    """
    case = SimulationCase(
        machine=machine,
        q=q,
        command=command,
        duration=duration,
        payload=payload,
        rate=rate,
        **conditions,
    )
    return simulate_all([case], tolerance=tolerance)[0]


@checked
def simulate_all(
    cases: Sequence[SimulationCase], *, tolerance: float = TOLERANCE
) -> list[Simulation]:
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

    Example:
        >>> import armdesign as ad
        >>> machine, command = ad.load("paper_1dof"), {"lift": ad.Step(size=0.05)}
        >>> case = ad.SimulationCase(machine=machine, q=[0.0], command=command, duration=0.2)
        >>> print([f"{run.q[-1, 0]:.4f} rad" for run in ad.simulate_all([case, case])])
        ['-0.0345 rad', '-0.0345 rad']
    """
    runs = attempt_all(cases, tolerance=tolerance)
    raise_together([run for run in runs if isinstance(run, SimulationError)])
    return [run for run in runs if isinstance(run, Simulation)]


def attempt_all(
    cases: Sequence[SimulationCase], *, tolerance: float = TOLERANCE
) -> list[Simulation | SimulationError]:
    """The runs of ``simulate_all``, with an error in place of a case that gives up.

    Raises:
        PoseError: a pose cannot be taken.
        SimulationError: a valve is missing, or an argument is out of its range.
    """
    if not 0 < tolerance < 1:
        raise SimulationError("tolerance", f"{tolerance:g} is not in (0, 1)", "give one like 1e-6")
    stacks: dict[Hashable, list[int]] = {}
    cases = [_settled(_supplied(_loaded(case))) for case in cases]
    for index, case in enumerate(cases):
        _refuse(case)
        stacks.setdefault(stack_shape(case.machine), []).append(index)
    runs: dict[int, Simulation | SimulationError] = {}
    for rows in stacks.values():
        runs |= dict(zip(rows, _stacked([cases[row] for row in rows], tolerance), strict=True))
    return [runs[index] for index in range(len(cases))]


def _loaded(case: SimulationCase) -> SimulationCase:
    """The case with its machine under the load case that it names."""
    if case.payload is None:
        return case
    machine = case.machine.with_payload(case.payload)
    refuse_unheld(machine, case.q)
    return replace(case, machine=machine)


def _settled(case: SimulationCase) -> SimulationCase:
    """The case with its machine's springs at rest at its pose."""
    return replace(case, machine=settled(case.machine, case.q)) if case.machine.springs else case


def _supplied(case: SimulationCase) -> SimulationCase:
    """The case with the pump pressure that it asks for, and the reliefs where they are today."""
    pressure, machine = case.supply_pressure, case.machine
    if pressure is None:
        return case
    if not (math.isfinite(pressure) and pressure >= 0):
        part = f"{machine.name}: supply_pressure"
        raise SimulationError(part, f"{pressure:g} Pa is not allowed", "give 0 or more")

    def set_as_today(actuator: F) -> F:
        valve = actuator.valve
        if valve is None or valve.relief is not None:
            return actuator
        return replace(actuator, valve=replace(valve, relief=actuator.relief(machine.supply)))

    # A dead pump has no share of its pressure to cut off at.
    flow_limited = machine.supply.flow_limited and pressure > 0
    supplied = replace(
        with_each(machine, set_as_today),
        supply=replace(machine.supply, pressure=float(pressure), flow_limited=flow_limited),
    )
    return replace(case, machine=supplied)


def _refuse(case: SimulationCase) -> None:
    name, hold = case.machine.name, 1.0 if case.hold is None else case.hold
    rate = ("rate", case.rate, " per second")
    for what, value, unit in (("duration", case.duration, " s"), rate, ("hold", hold, " Hz")):
        if not (math.isfinite(value) and value > 0):
            fault = f"{value:g}{unit} is not allowed"
            raise SimulationError(f"{name}: {what}", fault, "give a positive number")
    if (records := case.duration * case.rate) > MOST_RECORDS:
        fault = f"{case.duration:g} s at {case.rate:g} per second are {records:.2g} instants"
        remedy = f"give {MOST_RECORDS / case.rate:g} s or less, or a lower rate"
        raise SimulationError(f"{name}: duration", fault, remedy)
    if case.velocity is not None:
        joints = case.machine.joints
        try:
            given = np.asarray(case.velocity, dtype=float)
        except (TypeError, ValueError):
            given = np.array(math.nan)
        if given.shape != (len(joints),) or not np.all(np.isfinite(given)):
            fault = f"{given.tolist()} is not one finite number per joint"
            remedy = f"give {', '.join(joints)} [rad/s, m/s]"
            raise SimulationError(f"{name}: velocity", fault, remedy)


def _stacked(
    cases: Sequence[SimulationCase], tolerance: float
) -> list[Simulation | SimulationError]:
    """Runs of one shape."""
    ready = _ready(cases)
    plants, starts = [one.plant for one in ready], list(map(_start, ready, cases))
    commands, holds = [case.command for case in cases], [case.hold for case in cases]
    system = ControlledPlant.of(plants, starts, commands, holds)
    runs: list[Simulation | SimulationError] = []
    fastest = np.array([one.fastest for one in ready])
    for row, states in enumerate(_states(system, cases, fastest, tolerance)):
        alone = system.picked([row])
        if isinstance(states, GaveUpError):
            runs.append(_failure(alone, states, tolerance))
        else:
            unheld = _unheld(ready[row].equilibrium.holdings)
            runs.append(_recorded(alone, float(cases[row].duration), states, unheld))
    return runs


class _Ready(NamedTuple):
    """A plant in equilibrium at a pose, ready to start."""

    plant: Plant
    equilibrium: Equilibrium
    fastest: float  # largest ω of its undamped oscillations [rad/s]


def _ready(cases: Sequence[SimulationCase]) -> list[_Ready]:
    """The plants of all cases in equilibrium; one for those that share machine and pose."""
    known: dict[Hashable, _Ready] = {}
    keys = [(id(case.machine), id(case.q), case.preloaded) for case in cases]
    for key, case in zip(keys, cases, strict=True):
        if key not in known:
            plant = Plant(case.machine)
            equilibrium = find_equilibrium(plant, case.q, case.preloaded)
            fastest = float(natural_modes(case.machine.at(case.q)).frequencies.max())
            known[key] = _Ready(plant, equilibrium, 2 * math.pi * fastest)
    return [known[key] for key in keys]


def _start(ready: _Ready, case: SimulationCase) -> Array:
    """State at t = 0: equilibrium, but for the velocity."""
    state = ready.equilibrium.state.copy()
    if case.velocity is not None:
        ready.plant.split(state)[1][: len(case.machine.joints)] = case.velocity
    return state


def _unheld(holdings: Sequence[StaticHold]) -> list[tuple[float, str]]:
    """Loads above a relief, and leaks that no spool position makes up for, as events at 0 s."""
    overcome = [f"{one.overcome} at 0 s" for one in holdings if one.overcome]
    creeps = [f"{one.creeps} from 0 s on" for one in holdings if one.creeps]
    return [(0.0, words) for words in (*overcome, *creeps)]


def _states(
    system: ControlledPlant, cases: Sequence[SimulationCase], fastest: Array, tolerance: float
) -> list[Array | GaveUpError]:
    """States of all cases at their instants, or why there are none.

    ``fastest``: largest ω of their undamped oscillations (n,) [rad/s].
    """
    spools = []
    for case in cases:
        valves = [actuator.valve for actuator in case.machine.actuators if actuator.valve]
        spools.append(max(valve.natural_frequency for valve in valves))
    largest = np.maximum(fastest, 2 * math.pi * np.array(spools))
    span = Span.of([case.duration for case in cases], [case.rate for case in cases])
    pace, breaks = Pace(fastest, largest), system.breaks
    return integrate(system, system.start, span, pace, breaks, tolerance, MOST_STEPS)


def _failure(system: ControlledPlant, stop: GaveUpError, tolerance: float) -> SimulationError:
    plant, machine = system.plant, system.plant.machine
    q, velocity = (x[: len(machine.joints)] for x in plant.split(stop.state[: plant.size])[:2])
    command = np.array(system.demands[0](stop.time + INSTANT), dtype=float).tolist()
    return SimulationError(
        f"{machine.name}: simulation",
        f"gave up at {stop.time:.4g} s, last known at {pose_text(machine, q)} ({stop.cause})",
        likely_cause(machine, q + INSTANT * velocity, command, stop.cause, tolerance),
    )


def likely_cause(
    machine: Machine,
    q: Array,
    command: Sequence[float],
    cause: str = "",
    tolerance: float = TOLERANCE,
) -> str:
    """Likely cause, for a remedy, of an integration that stopped at a pose under a command."""
    for value in command:
        if not math.isfinite(value):
            return f"the command gives {value:g} there: give −1…1"
    for cylinder, margin in zip(machine.actuators, machine.margins(q)[0], strict=True):
        if margin == -np.inf:
            return f"the four-bar of {cylinder.name} does not close there: command it less far"
        if margin < -FAR_BEYOND:
            beyond = f"{-100 * margin:.0f} % of its stroke beyond a stop"
            return f"{cylinder.name} is {beyond}: command it less far"
    fast = "a spool, friction or chamber a thousand times faster than the arm"
    if NO_LIMIT in cause:
        return f"smooth a command that jumps again and again, or slow down {fast}"
    if TOO_MANY in cause:
        remedy = f"give a coarser tolerance than {tolerance:g}, a shorter duration"
        return f"{remedy} or a smoother command, or slow down {fast}"
    return f"a joint driven out of its range, or {fast}"


def _recorded(
    system: ControlledPlant, duration: float, states: Array, unheld: list[tuple[float, str]]
) -> Simulation:
    """The run, with what its equilibrium does not hold among its events."""
    plant, machine = system.plant, system.plant.machine
    time, body = np.linspace(0.0, duration, len(states)), states[:, : plant.size]
    commands = system.commands_at(time, states)
    evaluation = plant.evaluate(body, commands)
    q, velocity, _, _, spool, _ = plant.split(body)
    energy = plant.rigid_bodies.energy(q, velocity)
    supplied, oil, dissipated = system.energies(states)
    elastic, frames, nq = evaluation.springs, machine.arm.kinematics(q), len(machine.joints)
    run = Simulation(
        time=time,
        q=q[:, :nq].copy(),
        velocity=velocity[:, :nq].copy(),
        springs=q[:, nq:].copy(),
        spring_speeds=velocity[:, nq:].copy(),
        pressures=np.swapaxes(plant.pressures(body), 1, 2).copy(),
        spool=spool.copy(),
        command=commands,
        flows=evaluation.valve_flows,
        extensions=evaluation.extensions,
        speeds=evaluation.outputs["speed"].copy(),
        tool=np.array(machine.arm.point(frames, machine.tool.link, np.array(machine.tool.at))),
        energy=energy,
        supplied=supplied,
        stored=energy - energy[0] + elastic - elastic[0] + oil,
        dissipated=dissipated,
        supply=plant.supply_pressure(body),
        events=(),
        joints=machine.joints,
        cylinders=tuple(actuator.name for actuator in machine.actuators),
        machine=machine,
    )
    taken, relief = evaluation.outputs["supplied"], plant.parameters.actuators["relief"][0]
    timed = [
        *events(machine, relief, time, run.extensions, plant.pressures(body), spool, taken),
        *pump_events(machine, time, run.supply, taken),
        *pose_events(machine, time, frames),
        *unheld,
    ]
    return replace(run, events=tuple(words for _, words in sorted(timed)))
