"""The plant: the nonlinear model of machines as one function, ẏ = f(y, u), of n cases side by side.

    M(q) q̈ + h(q, q̇) = Rᵀ(A1 p1 − A2 p2 − friction + stops)                  joints, by Pinocchio
    C1 ṗ1 = Q1 − A1 ṡ,   C2 ṗ2 = Q2 + A2 ṡ                                      chambers, see ``hydraulics``
    ẍ = ω_v² (u − x) − 2 ζ_v ω_v ẋ                                          spool, x and its command u in [−1, 1]
    C_s ṗ_s = Q_pump(p_s) − Σ Q                                            supply line of a flow-limited pump

with s = ℓ − ℓ_closed + c (A1 p1 − A2 p2): the pins' compliance c in series lets the piston run ahead of the pins. An
ideal pump holds its pressure. Masses of barrels, rods, rockers and couplers are in M and h.

Energy is booked with it: what pumps supply (less what returns to the tank under return pressure), what compresses oil
(Σ p C ṗ: oil that leaves takes with it the energy of its compression, p/2β of its pressure's work, about 1 %), and what
edges, leakage, friction and stops dissipate. Kinetic, potential and spring energy are functions of the state.

Units inside the state: pressures in bar, everything else SI, so that all numbers are of one order.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from armdesign.arm import Dynamics
from armdesign.arrays import Array
from armdesign.errors import PoseError
from armdesign.linkage import Gear
from armdesign.machine import Machine
from armdesign.simulation.hydraulics import Flows, Hydraulics, Rates
from armdesign.simulation.reach import Reach, shape
from armdesign.simulation.rest import holding_pressures
from armdesign.units import bar
from armdesign.valve import spool_acceleration


@dataclass(frozen=True, eq=False)
class Evaluation:
    """The plant at one instant of n cases.

    Attributes:
        rates: ẏ (n, size).
        extensions: piston positions s (n, nc) [m].
        speeds: rates of the pin-to-pin lengths (n, nc) [m/s].
        flows: of the oil.
        powers: supplied, into oil compression, dissipated (n, 3) [W].
    """

    rates: Array
    extensions: Array
    speeds: Array
    flows: Flows
    powers: Array


class Plant:
    """Machines of one shape under their payloads as one system of first-order equations; axis 0 is the case.

    State y: q, q̇, p1, p2 [bar], supply pressure [bar] of a flow-limited pump, spool, spool speed; joints in the order
    of q, the rest in that of ``Machine.functions``.

    Args:
        machines: one per case; one alone serves any number of cases.

    Raises:
        SimulationError: a cylinder or motor has no valve.
    """

    def __init__(self, *machines: Machine) -> None:
        self.machines, self.machine = machines, machines[0]
        self.hydraulics = Hydraulics(machines)
        self.dynamics = Dynamics([machine.loaded_arm for machine in machines])
        self._reach = Reach([machine.linkages for machine in machines])
        self.nq, self.nc = len(self.machine.joints), len(self.machine.functions)
        self._turned = [drive.joint for drive in self.machine.drives[self._reach.count :] if isinstance(drive, Gear)]
        self.has_line = self.machine.supply.flow_limited
        edges = np.cumsum([0, self.nq, self.nq, self.nc, self.nc, int(self.has_line), self.nc, self.nc])
        self._parts = tuple(slice(int(a), int(b)) for a, b in pairwise(edges))
        self._chambers = slice(int(edges[2]), int(edges[4]))
        self.size = int(edges[-1])
        self.units = np.ones(self.size)  # SI value of each number of the state
        self.units[int(edges[2]) : int(edges[5])] = bar

    @property
    def state_names(self) -> tuple[str, ...]:
        """What each number of the state is."""
        joints, cylinders = self.machine.joints, [f.name for f in self.machine.functions]
        kinds = [("position", joints), ("velocity", joints), ("cap pressure", cylinders)]
        kinds += [("annulus pressure", cylinders), ("pressure", ["supply"] if self.has_line else [])]
        kinds += [("spool", cylinders), ("spool speed", cylinders)]
        return tuple(f"{name} {kind}" for kind, names in kinds for name in names)

    def split(self, state: Array) -> tuple[Array, ...]:
        """q, q̇, p1, p2 [Pa], spool and spool speed of states (..., size)."""
        q, velocity, cap, annulus, _, spool, spool_speed = (state[..., part] for part in self._parts)
        return q, velocity, cap * bar, annulus * bar, spool, spool_speed

    def spread(self, values: Sequence[float]) -> Array:
        """One number for each kind of state, in the order of the state, for every number of it (size,)."""
        return np.repeat(values, [part.stop - part.start for part in self._parts])

    def pressures(self, state: Array) -> Array:
        """Pressures (n, 2, nc) [Pa] of states (n, size)."""
        return np.asarray(state[:, self._chambers].reshape(-1, 2, self.nc) * bar)

    def supply_pressure(self, state: Array) -> Array:
        """Supply pressures (n, 1) [Pa] of states (n, size); (1, 1) where one ideal pump serves all."""
        return np.asarray(state[:, self._parts[4]] * bar if self.has_line else self.hydraulics.supply.pressure)

    def rest(self, q: ArrayLike, preloaded: bool | None = None) -> Array:
        """State (size,) of static equilibrium of one machine at a pose (nq,).

        The valves are shut, but for what makes up for leakage and underlap: see ``rest.holding_pressures``.

        Args:
            q: joint positions [rad, m].
            preloaded: what fixes the chambers' common pressure. None: preloaded if the oil has no air. Its stiffness
                then does not depend on the pressure, and both chambers stay far from cavitation. With air the stiffness
                does, so the pressures are those of ``Machine.at``.

        Raises:
            PoseError: the pose cannot be taken.
        """
        machine = self.machine
        poses = machine.at(q)
        if len(poses) != 1:
            raise PoseError(f"{machine.name}: q", f"holds {len(poses)} poses", "give one")
        preloaded = machine.fluid.air == 0 if preloaded is None else preloaded
        held = [
            holding_pressures(function, machine.supply, float(force), preloaded)
            for function, force in zip(machine.functions, poses.cylinder_forces[0], strict=True)
        ]
        state = np.zeros(self.size)
        state[self._parts[0]] = poses.q[0]
        state[self._chambers] = (
            np.array([[cap for cap, _, _ in held], [annulus for _, annulus, _ in held]]).ravel() / bar
        )
        state[self._parts[4]] = machine.supply.pressure / bar
        state[self._parts[5]] = [spool for _, _, spool in held]
        return state

    def derivative(self, state: Array, command: Array) -> Array:
        """ẏ at states (n, size) under spool commands −1…1 (n, nc); NaN where a four-bar does not close."""
        return self.evaluate(state, command).rates

    def evaluate(self, state: Array, command: Array) -> Evaluation:
        """ẏ, and what it was made from."""
        q, velocity, _, _, _, spool, spool_speed = (state[:, part] for part in self._parts)
        pressures, supply = self.pressures(state), self.supply_pressure(state)
        lengths, moment_arms = self._geometry(q)
        speeds = (moment_arms @ velocity[:, :, None])[:, :, 0]
        extensions = self.hydraulics.extension(lengths, pressures)
        found = self.hydraulics.rates(extensions, speeds, pressures, spool, supply)
        rates = np.empty_like(state)
        parts = self._parts
        rates[:, parts[0]], rates[:, parts[5]] = velocity, spool_speed
        torque = (found.force[:, None] @ moment_arms)[:, 0]
        rates[:, parts[1]] = self.dynamics.acceleration(q, velocity, torque)
        rates[:, self._chambers] = found.pressure_rates.reshape(len(state), -1) / bar
        taken = found.flows.from_supply.sum(axis=(1, 2))[:, None]
        pump = self.hydraulics.pump_flow(supply, taken) if self.has_line else taken
        if self.has_line:
            rates[:, parts[4]] = (pump - taken) / self.hydraulics.line_capacity / bar
        rates[:, parts[6]] = spool_acceleration(self.hydraulics.valve, spool, spool_speed, command)
        powers = self._powers(pressures, supply, pump, taken, found)
        return Evaluation(rates, extensions, speeds, found.flows, powers)

    def _geometry(self, q: Array) -> tuple[Array, Array]:
        """Lengths (n, nc) [m] and moment arms (n, nc, nq) at joint positions; of a motor the joint's angle and 1."""
        lengths, moment_arms = self._reach(self.dynamics.frames(q))
        if not self._turned:
            return lengths, moment_arms
        gears = np.broadcast_to(np.eye(self.nq)[self._turned], (len(q), len(self._turned), self.nq))
        lengths = np.concatenate([lengths, q[:, self._turned]], axis=1)
        return lengths, np.concatenate([moment_arms, gears], axis=1)

    def _powers(self, pressures: Array, supply: Array, pump: Array, taken: Array, found: Rates) -> Array:
        """Supplied, into oil compression and dissipated (n, 3) [W]; orifices dissipate what enters less what leaves."""
        flows, back = found.flows, self.hydraulics.supply.return_pressure
        line = (supply * (pump - taken))[:, 0]
        supplied = (supply * pump)[:, 0] - back[:, 0] * flows.to_return.sum(axis=(1, 2))
        throttled = supplied - line - (pressures * flows.net).sum(axis=(1, 2))
        return np.stack([supplied, found.oil_power + line, throttled + found.rubbed_off], axis=1)


def stack_shape(machine: Machine) -> Hashable:
    """What machines must have in common to be cases of one plant."""
    tree = tuple((joint.parent, joint.revolute) for joint in machine.arm.joints)
    turned = tuple(motor.joint for motor in machine.motors)
    return tree, shape(machine.linkages), turned, machine.has_bars, machine.supply.flow_limited
