"""The plant: the nonlinear model of a machine as one function, ẏ = f(y, u).

    M(q) q̈ + h(q, q̇) = Rᵀ(A1 p1 − A2 p2 − friction + stops)          joints, by Pinocchio
    C1 ṗ1 = Q1 − A1 ṡ − C_L (p1 − p2),   C2 ṗ2 = Q2 + A2 ṡ + C_L (p1 − p2)   chambers; Q1, Q2 flow into them
    ẍ = ω_v² (u − x) − 2 ζ_v ω_v ẋ                                          spool, x and its command u in [−1, 1]

with s = ℓ − ℓ_closed + c (A1 p1 − A2 p2): the pins' compliance c in series lets the piston run ahead of the pins. The
capacity C = V/β(p) + V_hose/β_hose grows without bound near a vacuum: there vapour fills the chamber. Supply and return
pressure are constant (an ideal pump); port reliefs open above 1.1 × supply pressure. A stop is a stiff spring that
damps by Hunt and Crossley's law (1975), k δ (1 + a δ̇), so that its force begins at 0.

Units inside the state: pressures in bar, everything else SI, so that all numbers are of one order.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from armdesign.arrays import Array
from armdesign.cylinder import Actuator, Fluid, Supply, kind, static_pressures
from armdesign.errors import PoseError, SimulationError
from armdesign.fluid import bulk_modulus
from armdesign.machine import Machine
from armdesign.simulation.reach import reach
from armdesign.units import bar
from armdesign.valve import Valve, friction_force, opening, orifice_flow, port_flows, spool_position

RELIEF_SHARE = 1.1  # of the supply pressure, where port reliefs open
VAPOUR_PRESSURE, VAPOUR_WIDTH = -0.7 * bar, 0.02 * bar  # gauge; a chamber of pure vapour then has −0.97 bar
STOP_SHARE = 1e-3  # of the stroke that supply pressure on the bore presses an end stop in
STOP_DAMPING = 12.0  # [s/m] of the end stops, a
LEAST_VOLUME_SHARE = 1e-3  # of a chamber's swept volume, when the piston is beyond its stop and there is no dead volume


@dataclass(frozen=True, eq=False)
class Function:
    """A cylinder or motor with its valve at work in a machine: everything about one piston, in plain numbers.

    Of a motor the "piston" is the joint, its position and speed are angles.
    """

    cylinder: Actuator
    valve: Valve
    fluid: Fluid
    supply: Supply
    areas: tuple[float, float]
    stop_stiffness: float

    @classmethod
    def of(cls, machine: Machine, cylinder: Actuator) -> Function:
        """The cylinder or motor as it stands in its machine.

        Raises:
            SimulationError: it has no valve.
        """
        if cylinder.valve is None:
            part = f"{machine.name}: {kind(cylinder)}.{cylinder.name}.valve"
            raise SimulationError(part, "missing", "add rated_flow_l_per_min, rated_drop_bar and the spool's dynamics")
        thrust = machine.supply.pressure * cylinder.bore_area
        stop = thrust / (STOP_SHARE * cylinder.stroke)
        areas = (cylinder.bore_area, cylinder.annulus_area)
        return cls(cylinder, cylinder.valve, machine.fluid, machine.supply, areas, stop)

    def capacities(self, extension: float, cap: float, annulus: float) -> tuple[float, float]:
        """C1 and C2 [m³/Pa] at a piston position [m] and pressures [Pa]: oil, its air and vapour, hoses."""
        cylinder, (bore, ring) = self.cylinder, self.areas
        v1, v2 = cylinder.volumes(extension)
        least = LEAST_VOLUME_SHARE * cylinder.stroke if math.isfinite(cylinder.stroke) else 0.0
        return (
            max(v1, least * bore) / self._modulus(cap) + cylinder.cap_hose_volume / cylinder.hose_modulus,
            max(v2, least * ring) / self._modulus(annulus) + cylinder.annulus_hose_volume / cylinder.hose_modulus,
        )

    def _modulus(self, pressure: float) -> float:
        fluid = self.fluid
        oil = float(bulk_modulus(pressure, fluid.bulk_modulus, fluid.air)) if fluid.air > 0 else fluid.bulk_modulus
        void = (VAPOUR_PRESSURE - pressure) / VAPOUR_WIDTH
        return oil / (1 + math.exp(min(void, 200.0))) if void > -40 else oil

    def flows(self, cap: float, annulus: float, spool: float) -> tuple[float, float]:
        """Flows [m³/s] into cap and annulus: the valve's and, above their pressure, the port reliefs'."""
        supply, valve = self.supply, self.valve
        limit = RELIEF_SHARE * supply.pressure
        q1, q2 = port_flows(valve, opening(valve, spool), cap, annulus, supply.pressure, supply.return_pressure)
        if cap > limit:
            q1 -= orifice_flow(valve, 1.0, cap - limit)
        if annulus > limit:
            q2 -= orifice_flow(valve, 1.0, annulus - limit)
        return q1, q2

    def extension(self, length: float, cap: float, annulus: float) -> float:
        """Piston position s [m] at a pin-to-pin length [m] and pressures [Pa]."""
        cylinder, (bore, ring) = self.cylinder, self.areas
        return length - cylinder.closed_length + cylinder.compliance * (bore * cap - ring * annulus)

    def rates(
        self, extension: float, speed: float, cap: float, annulus: float, spool: float
    ) -> tuple[float, float, float]:
        """Force on the pins [N, + pushes] and rates of both pressures [Pa/s] when the pins part at a speed ℓ̇ [m/s].

        The chambers and the series compliance make three linear equations in ṗ1, ṗ2 and ṡ; ṡ is solved first:
        ṡ = (ℓ̇ + c (A1 Q1/C1 − A2 Q2/C2)) / (1 + c k), k = A1²/C1 + A2²/C2, with leakage counted in Q1 and Q2.
        """
        (bore, ring), compliance = self.areas, self.cylinder.compliance
        c1, c2 = self.capacities(extension, cap, annulus)
        q1, q2 = self.flows(cap, annulus, spool)
        leak = self.valve.leakage * (cap - annulus)
        free1, free2 = (q1 - leak) / c1, (q2 + leak) / c2
        if compliance > 0:
            stiffness = bore * bore / c1 + ring * ring / c2
            speed = (speed + compliance * (bore * free1 - ring * free2)) / (1 + compliance * stiffness)
        friction = self.cylinder.count * friction_force(self.cylinder.friction, speed)
        force = bore * cap - ring * annulus - friction + self._stop(extension, speed)
        return force, free1 - bore * speed / c1, free2 + ring * speed / c2

    def _stop(self, extension: float, speed: float) -> float:
        """Force of the end stops on the piston [N, + pushes out]; they never pull."""
        if extension < 0:
            return self.stop_stiffness * -extension * max(1 - STOP_DAMPING * speed, 0.0)
        beyond = extension - self.cylinder.stroke
        return -self.stop_stiffness * beyond * max(1 + STOP_DAMPING * speed, 0.0) if beyond > 0 else 0.0

    def free_speed(self, extension: float, cap: float, annulus: float, flows: tuple[Any, Any]) -> Any:
        """Speed [m/s] that flows into cap and annulus give a piston whose force does not change.

        v = (A1 Q1/C1 − A2 Q2/C2)/(A1²/C1 + A2²/C2).
        """
        (bore, ring), (c1, c2) = self.areas, self.capacities(extension, cap, annulus)
        return (bore * flows[0] / c1 - ring * flows[1] / c2) / (bore * bore / c1 + ring * ring / c2)

    def trim(self, cap: float, annulus: float) -> float:
        """Spool position that makes up for the leakage across the piston at rest; 0 without leakage.

        At p1 + p2 = supply + return the same opening feeds one chamber and drains the other by the leakage; at other
        pressures no opening does, and the valve is taken as shut.
        """
        supply, leak = self.supply, self.valve.leakage * (cap - annulus)
        if leak == 0 or abs(cap + annulus - supply.pressure - supply.return_pressure) > 1e-6 * supply.pressure:
            return 0.0
        full = port_flows(self.valve, math.copysign(1.0, leak), cap, annulus, supply.pressure, supply.return_pressure)
        return spool_position(self.valve, leak / abs(full[0]))

    def pressures(self, force: float, preloaded: bool) -> tuple[float, float]:
        """Pressures of cap and annulus [Pa] that hold a static force [N].

        One more condition is needed. ``preloaded``: p1 + p2 = supply + return, what a matched symmetric valve leaves
        when it moves about its middle (Merritt 1967, ch. 5), with neither chamber below return pressure. Else the
        chamber without load is at return pressure.
        """
        bore, ring = self.areas
        cap, annulus = (float(p) for p in static_pressures(force, bore, ring, self.supply.return_pressure))
        if not preloaded:
            return cap, annulus
        total = self.supply.pressure + self.supply.return_pressure
        middle = (force + ring * total) / (bore + ring)
        return (middle, total - middle) if middle > cap and total - middle > annulus else (cap, annulus)


class Plant:
    """A machine under its payload as a system of first-order equations.

    State y: q, q̇, p1, p2 [bar], spool, spool speed; joints in the order of q, the rest in that of the cylinders.

    Raises:
        SimulationError: a cylinder has no valve.
    """

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        self.functions = tuple(Function.of(machine, function) for function in machine.functions)
        self.dynamics = machine.dynamics()
        self._reaches = tuple(reach(drive) for drive in machine.drives)
        self.nq, self.nc = len(machine.joints), len(self.functions)
        edges = np.cumsum([0, self.nq, self.nq, self.nc, self.nc, self.nc, self.nc])
        self._parts = tuple(slice(int(a), int(b)) for a, b in pairwise(edges))
        self.size = int(edges[-1])
        self.units = np.ones(self.size)  # SI value of each number of the state
        self.units[int(edges[2]) : int(edges[4])] = bar

    @property
    def state_names(self) -> tuple[str, ...]:
        """What each number of the state is."""
        joints, cylinders = self.machine.joints, [f.name for f in self.machine.functions]
        kinds = [("position", joints), ("velocity", joints), ("cap pressure", cylinders)]
        kinds += [("annulus pressure", cylinders), ("spool", cylinders), ("spool speed", cylinders)]
        return tuple(f"{name} {kind}" for kind, names in kinds for name in names)

    def split(self, state: Array) -> tuple[Array, ...]:
        """q, q̇, p1, p2 [Pa], spool and spool speed of states (..., size)."""
        q, velocity, cap, annulus, spool, spool_speed = (state[..., part] for part in self._parts)
        return q, velocity, cap * bar, annulus * bar, spool, spool_speed

    def rest(self, q: ArrayLike, preloaded: bool | None = None) -> Array:
        """State of static equilibrium at a pose (nq,), the valves shut but for what makes up for leakage.

        Args:
            q: joint positions [rad, m].
            preloaded: what fixes the chambers' common pressure, see ``Function.pressures``. None: preloaded if the
                oil has no air. Its stiffness then does not depend on the pressure, and both chambers stay far from
                cavitation. With air the stiffness does, so the pressures are those of ``Machine.at``.

        Raises:
            PoseError: the pose cannot be taken.
        """
        preloaded = self.machine.fluid.air == 0 if preloaded is None else preloaded
        poses = self.machine.at(q)
        if len(poses) != 1:
            raise PoseError(f"{self.machine.name}: q", f"holds {len(poses)} poses", "give one")
        forces = poses.cylinder_forces[0]
        held = [f.pressures(float(force), preloaded) for f, force in zip(self.functions, forces, strict=True)]
        state = np.zeros(self.size)
        state[self._parts[0]] = poses.q[0]
        state[self._parts[2]] = [cap / bar for cap, _ in held]
        state[self._parts[3]] = [annulus / bar for _, annulus in held]
        state[self._parts[4]] = [f.trim(*pressures) for f, pressures in zip(self.functions, held, strict=True)]
        return state

    def derivative(self, state: Sequence[float], command: Sequence[float]) -> list[float]:
        """ẏ at a state under spool commands −1…1, one per cylinder.

        Raises:
            ValueError: a four-bar does not close.
        """
        return self.evaluate(state, command)[0]

    def evaluate(self, state: Sequence[float], command: Sequence[float]) -> tuple[list[float], list[float]]:
        """ẏ, and the piston positions s [m]."""
        q, velocity, caps, annuli, spools, spool_speeds = (list(state[part]) for part in self._parts)
        torque = [0.0] * self.nq
        extensions, cap_rates, annulus_rates = [], [], []
        frames = self.dynamics.frames(q)
        for i, function in enumerate(self.functions):
            length, moments = self._reaches[i](q, frames)
            speed = sum(arm * velocity[j] for j, arm in moments)
            cap, annulus = caps[i] * bar, annuli[i] * bar
            extensions.append(function.extension(length, cap, annulus))
            force, cap_rate, annulus_rate = function.rates(extensions[-1], speed, cap, annulus, spools[i])
            cap_rates.append(cap_rate / bar)
            annulus_rates.append(annulus_rate / bar)
            for j, arm in moments:
                torque[j] += arm * force
        acceleration = self.dynamics.acceleration(q, velocity, torque)
        pulls = [
            _spool_acceleration(f.valve, x, speed, u)
            for f, x, speed, u in zip(self.functions, spools, spool_speeds, command, strict=True)
        ]
        rates = [*velocity, *acceleration, *cap_rates, *annulus_rates, *spool_speeds, *pulls]
        return rates, extensions

    def lengths(self, state: Sequence[float]) -> tuple[list[float], list[float]]:
        """Pin-to-pin lengths [m] and their rates [m/s]."""
        frames, velocity = self.dynamics.frames(list(state[self._parts[0]])), state[self._parts[1]]
        found = [reach(state[self._parts[0]], frames) for reach in self._reaches]
        return [length for length, _ in found], [sum(arm * velocity[j] for j, arm in moments) for _, moments in found]


def _spool_acceleration(valve: Valve, position: float, speed: float, command: float) -> float:
    omega = 2 * math.pi * valve.natural_frequency
    wanted = min(max(command, -1.0), 1.0)
    return omega * (omega * (wanted - position) - 2 * valve.damping_ratio * speed)
