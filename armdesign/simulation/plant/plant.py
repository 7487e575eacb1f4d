"""The plant: the nonlinear model of machines as one function, ẏ = f(y, u), of n cases side by side.

    M(q) q̈ + h(q, q̇) = Rᵀ(A1 p1 − A2 p2 − friction + stops)                  joints, see
    ``bodies`` C1 ṗ1 = Q1 − A1 ṡ,   C2 ṗ2 = Q2 + A2 ṡ
    chambers, see ``hydraulics`` ẍ = ω_v² (u − x) − 2 ζ_v ω_v ẋ
         spool, x and its command u in [−1, 1] C_s ṗ_s = Q_pump(p_s) − Σ Q
                           supply line of a flow-limited pump

with s = ℓ − ℓ_closed + c (A1 p1 − A2 p2 − k δ): the pins' compliance c in series lets the piston
run ahead of the pins, under what oil and the spring k of an end stop, pressed in by δ(s), put on
it. A damping force, of friction or of a stop, acts at the rate of the pins ℓ̇, beside c: through c
it would need a mass of the piston, or make energy, as it would then move with another speed than
the one it depends on. An ideal pump holds its pressure. Masses of barrels, rods, rockers and
couplers are in M and h.

Energy is booked with it: what pumps supply (less what returns to the tank under return pressure),
what compresses oil (Σ p C ṗ), and what edges, leakage, friction and stops dissipate. Kinetic,
potential and spring energy are functions of the state. The balance is exact for these equations,
as p Q = p C ṗ + p V̇ at every port. Compression inside is not all that the oil's own energy V ε
changes by: with ρ'/ρ = 1/β, oil at p holds ε = ρ ∫ p dρ/ρ² in each m³, about p²/2β, and (V ε)˙ = ε
Q + p C ṗ. What crosses a port brings or takes ε Q, about p/2β of its work p Q. Valve laws and
pumps count volumes and know nothing of it, so it is left out of what is supplied and of what is
stored alike.

Units inside the state: pressures in bar, everything else SI, so that all numbers are of one order.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from armdesign.arrays import Array
from armdesign.errors import PoseError, SimulationError
from armdesign.hydraulics.valve import spool_acceleration
from armdesign.machine.machine import Machine
from armdesign.machine.poses import Poses
from armdesign.simulation.plant.bodies import Bodies
from armdesign.simulation.plant.compiled import compiled, resolved
from armdesign.simulation.plant.equilibrium import Holding, holding_pressures
from armdesign.simulation.plant.hydraulics import (
    actuators_of,
    beyond_stop,
    capacity,
    friction,
    piston_speed,
    port,
    pressed,
    pump_flow,
    stop_force,
    system_of,
)
from armdesign.simulation.plant.kinematics import (
    GEAR,
    POINTS,
    add_bars,
    drives_of,
    joints_of,
    place_drive,
    place_joints,
)
from armdesign.units import bar

TOLD = np.dtype(  # what an actuator does at an instant; of cap and annulus
    [
        ("extension", "f8"),  # of the piston, s [m]
        ("speed", "f8"),  # rate of the pin-to-pin length [m/s]
        *(
            (name, "f8", 2) for name in ("supplied", "returned", "leaked")
        ),  # from supply, to return, into it [m³/s]
        ("capacity", "f8", 2),  # C [m³/Pa]
    ],
    align=True,
)


class Evaluation(NamedTuple):
    """The plant at one instant of n cases.

    Attributes:
        rates: ẏ (n, size).
        told: of every actuator (n, nc), records ``TOLD``.
        powers: supplied, into oil compression, dissipated (n, 3) [W].
        springs: energy in end stops and series compliances, ½ k δ² + ½ c (A1 p1 − A2 p2 − k δ)²
            (n,) [J].
    """

    rates: Array
    told: Array
    powers: Array
    springs: Array

    @property
    def extensions(self) -> Array:
        """Piston positions s (n, nc) [m]."""
        return np.array(self.told["extension"])

    @property
    def valve_flows(self) -> Array:
        """From the supply less to the return, into cap and annulus (n, nc, 2) [m³/s]."""
        return np.array(self.told["supplied"] - self.told["returned"])


class Plant:
    """Machines of one shape under their payloads as one system of first-order equations.

    Axis 0 is the case.

    State y: q, q̇, p1, p2 [bar], supply pressure [bar] of a flow-limited pump, spool, spool speed;
    joints in the order of q, the rest in that of ``Machine.actuators``.

    Args:
        machines: one per case; one alone serves any number of cases.

    Raises:
        SimulationError: a cylinder or motor has no valve.
    """

    def __init__(self, *machines: Machine) -> None:
        self.machines, self.machine = machines, machines[0]
        self.bodies = Bodies([machine.loaded_arm for machine in machines])
        self.actuators = np.stack([actuators_of(machine) for machine in machines])
        self._systems = np.stack([system_of(machine) for machine in machines])
        joints = np.stack([joints_of(machine.arm) for machine in machines])
        drives = np.stack([drives_of(machine) for machine in machines])
        self._numbers = (self.actuators, self._systems, joints, drives)
        self.nq, self.nc = len(self.machine.joints), len(self.machine.actuators)
        self.has_line, self._weighs = self.machine.supply.flow_limited, self.machine.has_bars
        self._no_bars = np.zeros((0, self.nq, self.nq)), np.zeros((0, self.nq))
        self._kernel: Any = None
        edges = np.cumsum(
            [0, self.nq, self.nq, self.nc, self.nc, int(self.has_line), self.nc, self.nc]
        )
        self._parts = tuple(slice(int(a), int(b)) for a, b in pairwise(edges))
        self._chambers = slice(int(edges[2]), int(edges[4]))
        self.size = int(edges[-1])
        self.units = np.ones(self.size)  # SI value of each number of the state
        self.units[int(edges[2]) : int(edges[5])] = bar

    @property
    def state_names(self) -> tuple[str, ...]:
        """What each number of the state is."""
        joints, cylinders = self.machine.joints, [f.name for f in self.machine.actuators]
        kinds = [("position", joints), ("velocity", joints), ("cap pressure", cylinders)]
        kinds += [
            ("annulus pressure", cylinders),
            ("pressure", ["supply"] if self.has_line else []),
        ]
        kinds += [("spool", cylinders), ("spool speed", cylinders)]
        return tuple(f"{name} {kind}" for kind, names in kinds for name in names)

    def split(self, state: Array) -> tuple[Array, ...]:
        """q, q̇, p1, p2 [Pa], spool and spool speed of states (..., size)."""
        q, velocity, cap, annulus, _, spool, spool_speed = (
            state[..., part] for part in self._parts
        )
        return q, velocity, cap * bar, annulus * bar, spool, spool_speed

    def spread(self, values: Sequence[float]) -> Array:
        """One number for each kind of state, in the order of the state, for every number of it (size,)."""
        return np.repeat(values, [part.stop - part.start for part in self._parts])

    def pressures(self, state: Array) -> Array:
        """Pressures (n, 2, nc) [Pa] of states (n, size)."""
        return np.asarray(state[:, self._chambers].reshape(-1, 2, self.nc) * bar)

    def supply_pressure(self, state: Array) -> Array:
        """Supply pressures (n,) [Pa] of states (n, size)."""
        if self.has_line:
            return np.asarray(state[:, self._parts[4]][:, 0] * bar)
        return np.resize(self._systems["pressure"], len(state))

    def with_spools(self, state: Array, position: float) -> Array:
        """States (n, size) with all spools at a position −1…1."""
        moved = state.copy()
        moved[:, self._parts[5]] = position
        return moved

    def rest(self, q: ArrayLike, preloaded: bool | None = None) -> Array:
        """State (size,) of static equilibrium of one machine at a pose (nq,).

        The valves are shut, but for what makes up for leakage and underlap: see
        ``rest.holding_pressures``. What cannot be held starts from there, too: see ``holdings``.

        Args:
            q: joint positions [rad, m].
            preloaded: what fixes the pressures that shut valves leave. None: the loaded chamber
                carries the load, the other is at return pressure or at the preload that the
                machine file asks for; so ``check``, maps and ``Machine.at`` have it. True: p1 + p2
                = supply + return, which keeps both chambers far from cavitation, for measurements;
                less where a relief would open. False: the chamber without load at return pressure
                whatever the file asks for, and valves shut even if they leak: then the load
                    creeps.

        Raises:
            PoseError: the pose cannot be taken.
        """
        return self.resting(q, preloaded)[0]

    def holdings(self, q: ArrayLike, preloaded: bool | None = None) -> tuple[Holding, ...]:
        """How every actuator of one machine holds its load at rest at a pose (nq,), or why not: see ``rest``."""
        return self.resting(q, preloaded)[1]

    def refuse_overcome(self, q: ArrayLike) -> None:
        """Refuse a pose (nq,) of one machine at which a load presses a relief open.

        Raises:
            SimulationError: names all such actuators.
        """
        if words := "; ".join(one.overcome for one in self.holdings(q, False) if one.overcome):
            remedy = (
                "raise relief_bar, or choose a lighter load, a larger cylinder or another pose"
            )
            raise SimulationError(f"{self.machine.name}: rest", words, remedy)

    def resting(
        self, q: ArrayLike, preloaded: bool | None = None
    ) -> tuple[Array, tuple[Holding, ...]]:
        """``rest`` and ``holdings`` at once, which take one search.

        Where a flow-limited pump has to make up for leaks, its pressure falls until it gives as
        much.
        """
        from scipy.optimize import brentq

        poses, pump = self.machine.at(q), self._systems[0]
        if len(poses) != 1:
            raise PoseError(f"{self.machine.name}: q", f"holds {len(poses)} poses", "give one")

        def excess(line: float) -> float:
            state, _ = self._standing(poses, preloaded, line)
            told = self.evaluate(state[None], self.split(state)[4][None]).told
            return float(pump_flow(pump, line) - told["supplied"].sum())

        line = float(pump["pressure"])
        state, held = self._standing(poses, preloaded, line)
        if preloaded is False or not self.has_line or excess(line) >= 0:
            return state, held
        least = max(max(one.cap, one.annulus) for one in self._standing(poses, False, line)[1])
        if least < line and excess(least) > 0:
            return self._standing(poses, preloaded, float(brentq(excess, least, line, xtol=1e-6)))
        words = "the pump gives less than what the valves let through at rest: its pressure falls"
        return state, (held[0]._replace(creeps=words), *held[1:])

    def _standing(
        self, poses: Poses, preloaded: bool | None, line: float
    ) -> tuple[Array, tuple[Holding, ...]]:
        """State (size,) of rest at one pose under a supply pressure [Pa], and how each actuator holds its load."""
        rows = zip(
            self.machine.actuators,
            self.actuators[0],
            poses.cylinder_forces[0].tolist(),
            strict=True,
        )
        held = tuple(
            holding_pressures(
                actuator, self.machine.supply, force, preloaded, (row, self._systems[0], line)
            )
            for actuator, row, force in rows
        )
        state = np.zeros(self.size)
        state[self._parts[0]] = poses.q[0]
        state[self._chambers] = (
            np.array([[one.cap for one in held], [one.annulus for one in held]]).ravel() / bar
        )
        state[self._parts[4]] = line / bar
        state[self._parts[5]] = [one.spool for one in held]
        return state, held

    def derivative(self, state: Array, command: Array) -> Array:
        """ẏ at states (n, size) under spool commands −1…1 (n, nc).

        NaN where a four-bar does not close.
        """
        return self.evaluate(state, command).rates

    def evaluate(self, state: Array, command: Array) -> Evaluation:
        """ẏ, and what it was made from.

        Args:
            state: (n, size), or more columns, which are left alone: their rates are not set.
            command: of the spools (n, nc).
        """
        state, command = (
            np.ascontiguousarray(state, dtype=float),
            np.ascontiguousarray(command, dtype=float),
        )
        n, nq = len(state), self.nq
        if state.ndim != 2 or state.shape[1] < self.size or command.shape != (n, self.nc):
            raise ValueError(
                f"states {state.shape}, commands {command.shape}: not (n, {self.size}), (n,"
                f" {self.nc})"
            )
        found = Evaluation(
            np.empty_like(state), np.empty((n, self.nc), TOLD), np.empty((n, 3)), np.empty(n)
        )
        torque = np.empty((n, nq))
        bars = (np.zeros((n, nq, nq)), np.zeros((n, nq))) if self._weighs else self._no_bars
        arguments = (state, command, *self._numbers, self.has_line, *found, torque, *bars)
        if self._kernel is None:
            self._kernel = resolved(_evaluate, *arguments)
        self._kernel(*arguments)
        q, velocity = state[:, :nq], state[:, nq : 2 * nq]
        heavy = bars if self._weighs else None
        found.rates[:, nq : 2 * nq] = self.bodies.acceleration(q, velocity, torque, heavy)
        return found


def stack_shape(machine: Machine) -> Hashable:
    """What machines must have in common to be cases of one plant."""
    order = tuple(machine.arm.model_order.tolist())
    return order, len(machine.actuators), machine.has_bars, machine.supply.flow_limited


@compiled
def _evaluate(
    state: Any,
    command: Any,
    actuators: Any,
    systems: Any,
    joints: Any,
    drives: Any,
    has_line: bool,
    rates: Any,
    told: Any,
    power: Any,
    spring: Any,
    torque: Any,
    bar_mass: Any,
    bar_force: Any,
) -> None:
    """All of a case but its accelerations: see ``Evaluation``.

    Torques (n, nq), and bars' shares of M and h.
    """
    n, nq, nc = len(state), joints.shape[1], drives.shape[1]
    rotation, origin, axis = np.empty((nq, 3, 3)), np.empty((nq, 3)), np.empty((nq, 3))
    slope, bias, arm = np.empty((POINTS, nq, 3)), np.empty((POINTS, 3)), np.empty(nq)
    chambers, line = 2 * nq, 2 * nq + 2 * nc
    spools = line + int(has_line)
    for case in range(n):
        m = case if len(actuators) > 1 else 0
        system, q, velocity = systems[m], state[case, :nq], state[case, nq : 2 * nq]
        supply = state[case, line] * bar if has_line else system.pressure
        rates[case, :nq], torque[case], spring[case] = velocity, 0.0, 0.0
        place_joints(joints[m], q, rotation, origin, axis)
        taken, returned, passed, oil, rubbed = 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(nc):
            actuator, drive = actuators[m, i], drives[m, i]
            if drive.kind == GEAR:
                arm[:] = 0.0
                arm[drive.joint] = 1.0
                length = q[drive.joint]
            else:
                length, span = place_drive(
                    drive, joints[m], rotation, origin, axis, velocity, slope, bias, arm
                )
                if len(bar_mass):
                    add_bars(
                        drive, length, span, velocity, slope, bias, bar_mass[case], bar_force[case]
                    )
            pins = 0.0
            for j in range(nq):
                pins += arm[j] * velocity[j]
            p1, p2 = state[case, chambers + i] * bar, state[case, chambers + nc + i] * bar
            spool, spool_speed = state[case, spools + i], state[case, spools + nc + i]
            a1, a2 = actuator.areas[0], actuator.areas[1]
            oil_force = a1 * p1 + a2 * p2
            free = length - actuator.closed_length + actuator.compliance * oil_force
            beyond = pressed(actuator, beyond_stop(actuator, free))
            place = free - actuator.compliance * actuator.stop * beyond
            s1, r1, l1 = port(actuator, system, 0, p1, p2, spool, supply)
            s2, r2, l2 = port(actuator, system, 1, p2, p1, spool, supply)
            c1, c2 = (
                capacity(actuator, system, 0, place, p1),
                capacity(actuator, system, 1, place, p2),
            )
            q1, q2 = s1 - r1 + l1, s2 - r2 + l2
            piston = piston_speed(
                actuator, beyond, pins, a1 * q1 / c1 + a2 * q2 / c2, a1 * a1 / c1 + a2 * a2 / c2
            )
            fill1, fill2 = q1 - a1 * piston, q2 - a2 * piston
            spring_force, rub = -actuator.stop * beyond, friction(actuator, pins)
            stop = stop_force(actuator, beyond, pins) if beyond != 0.0 else 0.0
            force = oil_force - rub + stop
            for j in range(nq):
                torque[case, j] += arm[j] * force
            rates[case, chambers + i], rates[case, chambers + nc + i] = (
                fill1 / c1 / bar,
                fill2 / c2 / bar,
            )
            rates[case, spools + i] = spool_speed
            rates[case, spools + nc + i] = spool_acceleration(
                actuator, spool, spool_speed, command[case, i]
            )
            row = told[case, i]
            row.extension, row.speed = place, pins
            row.supplied[0], row.returned[0], row.leaked[0], row.capacity[0] = s1, r1, l1, c1
            row.supplied[1], row.returned[1], row.leaked[1], row.capacity[1] = s2, r2, l2, c2
            leaked = actuator.tank_leakage * (p1 + p2 - 2 * system.return_pressure)
            taken, returned = taken + s1 + s2, returned + r1 + r2 + leaked
            passed, oil = passed + p1 * q1 + p2 * q2, oil + p1 * fill1 + p2 * fill2
            rubbed += (rub - stop + spring_force) * pins
            carried = oil_force + spring_force
            spring[case] += (actuator.stop * beyond**2 + actuator.compliance * carried**2) / 2
        pump = taken
        if has_line:
            pump = pump_flow(system, supply)
            rates[case, line] = (pump - taken) / system.line_capacity / bar
        stored = supply * (pump - taken)
        power[case, 0] = supply * pump - system.return_pressure * returned
        power[case, 1] = oil + stored
        power[case, 2] = (
            power[case, 0] - stored - passed + rubbed
        )  # edges dissipate what enters less what leaves
