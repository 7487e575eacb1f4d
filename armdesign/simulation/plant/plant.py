"""The plant: the nonlinear model of machines as one function, ẏ = f(y, u), of n cases at once.

    M(q) q̈ + h(q, q̇) = Rᵀ(A1 p1 − A2 p2 − friction + stops)      joints: ``inertia``
                         + τ₀ − κ (z − z₀) − d ż                 springs: ``springs``
    C1 ṗ1 = Q1 − A1 ṡ,   C2 ṗ2 = Q2 + A2 ṡ                      chambers: ``hydraulics``
    ẍ = ω_v² (u − x) − 2 ζ_v ω_v ẋ                              spool x, its command u in [−1, 1]
    C_s ṗ_s = Q_pump(p_s) − Σ Q                                 line of a flow-limited pump

where q are the joints of poses and then the springs, z; with s = ℓ − ℓ_closed + c (A1 p1 − A2
p2 − k δ): the pins' compliance c in series lets the piston run ahead of the pins, under what oil
and the spring k of an end stop, pressed in by δ(s), put on it. A damping force, of friction or of
a stop, acts at the rate of the pins ℓ̇, beside c: through c it would need a mass of the piston, or
make energy, as it would then move with another speed than the one it depends on. An ideal pump
holds its pressure. Masses of barrels, rods, rockers and couplers are in M and h. Powers are booked
beside it: ``energy_book``.

Units inside the state: pressures in bar, everything else SI, so that all numbers are of one order.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from copy import copy
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from armdesign.arrays import Array
from armdesign.hydraulics.valve import spool_acceleration
from armdesign.machine.machine import Machine
from armdesign.simulation.plant.compiled import Record, Records, lent, resolved, within
from armdesign.simulation.plant.energy_book import book_powers
from armdesign.simulation.plant.hydraulics import (
    OUTPUT,
    actuate,
    actuators_of,
    pump_flow,
    system_of,
)
from armdesign.simulation.plant.inertia import (
    Inertia,
    add_bars,
    add_bodies,
    bodies_of,
    new_inertia,
    solve,
)
from armdesign.simulation.plant.kinematics import (
    Frames,
    PinMotion,
    drives_of,
    joints_of,
    new_frames,
    new_pin_motion,
    place_drive,
    place_joints,
)
from armdesign.simulation.plant.rigid_bodies import RigidBodies
from armdesign.simulation.plant.springs import add_springs, springs_of
from armdesign.units import bar


class PlantInstant(NamedTuple):
    """The plant at one instant of n cases."""

    rates: Array  # ẏ (n, size)
    outputs: Records  # of every actuator (n, nc), records ``OUTPUT``
    powers: Array  # supplied, into oil compression, dissipated (n, 3) [W]
    springs: Array  # energy in springs, end stops and series compliances (n,) [J]

    @property
    def extensions(self) -> Array:
        """Piston positions s (n, nc) [m]."""
        return np.array(self.outputs["extension"])

    @property
    def valve_flows(self) -> Array:
        """From the supply less to the return, into cap and annulus (n, nc, 2) [m³/s]."""
        return np.array(self.outputs["supplied"] - self.outputs["returned"])


class Parameters(NamedTuple):
    """The constants of the plant's equations: one row per machine, records."""

    actuators: Records  # ``ACTUATOR`` (n, nc)
    systems: Records  # ``SYSTEM`` (n,)
    joints: Records  # ``JOINT`` (n, nq), springs' last
    bodies: Records  # ``BODY`` (n, nq)
    drives: Records  # ``DRIVE`` (n, nc)
    springs: Records  # ``SPRING`` (n, ns)


class Layout(NamedTuple):
    """First indices of the parts of a state, after joint positions and speeds."""

    chambers: int  # pressures of caps, then of annuli
    line: int  # supply pressure, if the pump is limited in flow
    spools: int  # positions, then speeds
    size: int  # of the state


class Scratch(NamedTuple):
    """Arrays for intermediate values, written anew in every case: a plant serves one thread."""

    frames: Frames
    pins: PinMotion
    inertia: Inertia
    pressures: Array  # of caps, then of annuli (2 nc,) [Pa]


class Plant:
    """Machines of one shape under their payloads as one system of first-order equations.

    Axis 0 of every array is the case.

    State y: q, q̇, p1, p2 [bar], supply pressure [bar] of a flow-limited pump, spool, spool speed;
    joints in the order of q, springs after them, the rest in the order of ``Machine.actuators``.

    Args:
        machines: one per case; one alone serves any number of cases. Their springs are settled.

    Raises:
        SimulationError: a cylinder or motor has no valve.
    """

    def __init__(self, *machines: Machine) -> None:
        self.machines, self.machine = machines, machines[0]
        self.parameters = Parameters(
            np.stack([actuators_of(machine) for machine in machines]),
            np.stack([system_of(machine) for machine in machines]),
            np.stack([joints_of(machine.arm) for machine in machines]),
            np.stack([bodies_of(machine.loaded_arm) for machine in machines]),
            np.stack([drives_of(machine) for machine in machines]),
            np.stack([springs_of(machine) for machine in machines]),
        )
        self.nq, self.nc = nq, nc = len(self.machine.arm.coordinates), len(self.machine.actuators)
        self.has_line = self.machine.supply.flow_limited
        self.scratch = Scratch(
            new_frames(nq), new_pin_motion(nq), new_inertia(nq), np.empty(2 * nc)
        )
        self._kernel: Callable[..., None] | None = None
        edges = np.cumsum([0, nq, nq, nc, nc, int(self.has_line), nc, nc]).tolist()
        self._parts = tuple(slice(begin, end) for begin, end in pairwise(edges))
        self.layout = Layout(chambers=edges[2], line=edges[4], spools=edges[5], size=edges[7])
        self._chambers, self.size = slice(edges[2], edges[4]), edges[7]
        self.units = np.ones(self.size)  # SI value of each number of the state
        self.units[edges[2] : edges[5]] = bar

    def picked(self, rows: Sequence[int]) -> Plant:
        """The plant of the machines of some of the cases."""
        plant = copy(self)
        plant.machines = tuple(self.machines[row] for row in rows)
        plant.machine = plant.machines[0]
        plant.parameters = Parameters(*(values[rows] for values in self.parameters))
        vars(plant).pop("rigid_bodies", None)
        return plant

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the numbers of the state."""
        joints = [joint.name for joint in self.machine.arm.coordinates]
        actuators = [actuator.name for actuator in self.machine.actuators]
        kinds = [("position", joints), ("velocity", joints), ("cap pressure", actuators)]
        kinds += [("annulus pressure", actuators), ("pressure", ["supply"] * self.has_line)]
        kinds += [("spool", actuators), ("spool speed", actuators)]
        return tuple(f"{name} {kind}" for kind, names in kinds for name in names)

    @cached_property
    def rigid_bodies(self) -> RigidBodies:
        """Forces and energy of the first machine's links, payload and bars, by Pinocchio."""
        return RigidBodies(self.machine.loaded_arm)

    def split(self, state: Array) -> tuple[Array, ...]:
        """q, q̇, p1, p2 [Pa], spool and spool speed of states (..., size)."""
        q, velocity, cap, annulus, _, spool, spool_speed = (
            state[..., part] for part in self._parts
        )
        return q, velocity, cap * bar, annulus * bar, spool, spool_speed

    def spread(self, values: Sequence[float]) -> Array:
        """State (size,) with one value for each kind of its numbers, in their order."""
        return np.repeat(values, [part.stop - part.start for part in self._parts])

    def pressures(self, state: Array) -> Array:
        """Pressures (n, 2, nc) [Pa] of states (n, size)."""
        return np.asarray(state[:, self._chambers].reshape(-1, 2, self.nc) * bar)

    def supply_pressure(self, state: Array) -> Array:
        """Supply pressures (n,) [Pa] of states (n, size)."""
        if self.has_line:
            return np.asarray(state[:, self._parts[4]][:, 0] * bar)
        return np.resize(self.parameters.systems["pressure"], len(state))

    def with_spools(self, state: Array, position: float | Array) -> Array:
        """States (n, size) with all spools at a position −1…1, or at positions (n, nc)."""
        moved = state.copy()
        moved[:, self._parts[5]] = position
        return moved

    def with_pressures(self, state: Array, pressures: Array) -> Array:
        """States (n, size) with pressures (n, 2, nc) [Pa] in the chambers."""
        moved = state.copy()
        moved[:, self._chambers] = pressures.reshape(len(state), -1) / bar
        return moved

    def derivative(self, state: Array, command: Array) -> Array:
        """ẏ at states (n, size) under spool commands −1…1 (n, nc); NaN if a four-bar is open."""
        return self.evaluate(state, command).rates

    def state_at(self, q: Array, pressures: Array, line: float, spool: Sequence[float]) -> Array:
        """State (size,) without motion.

        Args:
            q: joint positions (nq,); springs stand where they rest.
            pressures: of caps and annuli (2, nc) [Pa].
            line: supply pressure [Pa], for a flow-limited pump.
            spool: positions (nc,).
        """
        return np.asarray(self.states_at(q[None], pressures[None], line, np.array(spool))[0])

    def states_at(
        self, q: Array, pressures: Array, line: Array | float, spool: Array | float
    ) -> Array:
        """States (n, size) without motion, of the same arguments with poses as axis 0."""
        states = np.zeros((len(q), self.size))
        states[:, self._parts[0]] = self.machine.arm.with_springs(q)
        states[:, self._chambers] = pressures.reshape(len(q), -1) / bar
        states[:, self._parts[4]], states[:, self._parts[5]] = line / bar, spool
        return states

    def evaluate(self, state: Array, command: Array) -> PlantInstant:
        """ẏ, and what it was made from.

        Args:
            state: (n, size), or more columns, which are left alone: their rates are not set.
            command: of the spools (n, nc).
        """
        state = np.ascontiguousarray(state, dtype=float)
        command = np.ascontiguousarray(command, dtype=float)
        n = len(state)
        if state.ndim != 2 or state.shape[1] < self.size or command.shape != (n, self.nc):
            shapes = f"states {state.shape}, commands {command.shape}"
            raise ValueError(f"{shapes}: not (n, {self.size}), (n, {self.nc})")
        evaluation = PlantInstant(
            np.empty_like(state), np.empty((n, self.nc), OUTPUT), np.empty((n, 3)), np.empty(n)
        )
        arguments = state, command, self.parameters, self.layout, self.scratch, evaluation
        if self._kernel is None:
            self._kernel = resolved(evaluate_cases, *arguments)
        self._kernel(*arguments)
        return evaluation


def stack_shape(machine: Machine) -> Hashable:
    """Properties that machines must share to be cases of one plant."""
    order = tuple(machine.arm.model_order.tolist())
    counts = len(machine.actuators), len(machine.springs)
    return order, counts, machine.has_bars, machine.supply.flow_limited


@lent
def evaluate_cases(
    state: Array,
    command: Array,
    parameters: Parameters,
    layout: Layout,
    scratch: Scratch,
    evaluation: PlantInstant,
) -> None:
    """Everything of an evaluation, case by case."""
    nq, nc = parameters.joints.shape[1], parameters.drives.shape[1]
    frames, pins, inertia, pressures = scratch
    for case in range(len(state)):
        m = case if len(parameters.systems) > 1 else 0
        system, y, rates = parameters.systems[m], state[case], evaluation.rates[case]
        has_line = layout.spools > layout.line
        supply = y[layout.line] * bar if has_line else system.pressure
        joints, speed, taken = parameters.joints[m], y[nq : 2 * nq], 0.0
        _place_links(m, parameters, y, scratch, rates)
        for i in range(2 * nc):
            pressures[i] = y[layout.chambers + i] * bar
        for i in range(nc):
            actuator, drive = parameters.actuators[m, i], parameters.drives[m, i]
            output = evaluation.outputs[case, i]
            spool, spool_speed = layout.spools + i, layout.spools + nc + i
            length = _place_actuator(drive, joints, y, frames, pins, inertia)
            moving = length, _sum_product(pins.arm, speed)
            both = pressures[i], pressures[nc + i]
            force, cap_rate, annulus_rate = actuate(
                actuator, system, moving, both, y[spool], supply, output
            )
            for j in range(nq):
                inertia.torque[j] += pins.arm[j] * force
            rates[layout.chambers + i] = cap_rate / bar
            rates[layout.chambers + nc + i] = annulus_rate / bar
            rates[spool] = y[spool_speed]
            rates[spool_speed] = spool_acceleration(
                actuator, y[spool], y[spool_speed], command[case, i]
            )
            taken = taken + output.supplied[0] + output.supplied[1]
        pump = taken
        if has_line:
            pump = pump_flow(system, supply)
            rates[layout.line] = (pump - taken) / system.line_capacity / bar
        actuators, outputs = parameters.actuators[m], evaluation.outputs[case]
        power, springs = evaluation.powers[case], parameters.springs[m]
        stored = book_powers(actuators, system, pressures, outputs, (supply, pump, taken), power)
        evaluation.springs[case] = stored + add_springs(springs, y, inertia.torque, power)
        solve(inertia, rates[nq : 2 * nq])


@within
def _place_links(
    machine: int, parameters: Parameters, state: Array, scratch: Scratch, rates: Array
) -> None:
    """Write frames, what links and payload have in M and h, and the rates of positions."""
    joints, inertia = parameters.joints[machine], scratch.inertia
    nq = len(joints)
    speed = state[nq : 2 * nq]
    inertia.mass[:], inertia.force[:], inertia.torque[:] = 0.0, 0.0, 0.0
    for j in range(nq):
        rates[j] = speed[j]
    place_joints(joints, state[:nq], scratch.frames)
    add_bodies(parameters.bodies[machine], joints, scratch.frames, speed, inertia)


@within
def _sum_product(a: Array, b: Array) -> float:
    """Scalar product of short arrays."""
    total = 0.0
    for j in range(len(a)):
        total += a[j] * b[j]
    return total


@within
def _place_actuator(
    drive: Record, joints: Records, state: Array, frames: Frames, pins: PinMotion, inertia: Inertia
) -> float:
    """Length of a cylinder [m] or angle of a motor [rad]; moment arms and bars are written."""
    nq = len(joints)
    if drive.joint >= 0:
        pins.arm[:] = 0.0
        pins.arm[drive.joint] = 1.0
        return state[drive.joint]
    speed = state[nq : 2 * nq]
    length, span = place_drive(drive, joints, frames, speed, pins)
    if drive.weighs:
        add_bars(drive, length, span, speed, pins, inertia)
    return length
