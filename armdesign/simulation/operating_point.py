"""Operating points of machines: at rest, or in steady motion under constant spool positions.

In steady motion joints turn at constant speed, pressures stay, and so does all but the pose, which
is the one at hand: forces hold gravity, Coriolis and centrifugal forces and viscous friction.
Actuators that are not told to move hold their load as at rest. Springs stand where they rest, and
carry what holds them there in this motion: not gravity alone, which is their preload in runs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from armdesign.arrays import Array, Flags
from armdesign.errors import SimulationError, choose
from armdesign.machine.poses import Poses, pose_text, static_forces
from armdesign.mechanism.rigid_poses import RigidPoses
from armdesign.simulation.plant import slopes
from armdesign.simulation.plant.equilibrium import (
    PortLaw,
    closed_pressures,
    holding,
    refuse_overcome,
    rest_states,
)
from armdesign.simulation.plant.plant import Plant
from armdesign.simulation.plant.steady_flow import (
    LOWEST,
    Load,
    SteadyFlow,
    at_speed,
    falling_root,
    under_spool,
)
from armdesign.units import bar, l_per_min, outward

Openings: TypeAlias = ArrayLike | Mapping[str, float] | None
ROUNDS = 60
EXACT_FLOW = 1e-6  # of the pump's flow
EXACT = 1e-12  # change of the pistons' speeds, relative
# Shares of a motion that cannot be, evenly and below; of which the largest that can is told.
SHARES, LEAST_SHARE = 64, 1e-4


class OperatingPoints(NamedTuple):
    """Operating points of a plant."""

    poses: Poses
    states: Array  # (n, size), in the plant's units
    resistance_stiffness: Array  # ∂h/∂q (n, k, k)
    resistance_damping: Array | float = 0.0  # ∂h/∂q̇ (n, k, k); none at rest


def at_rest(plant: Plant, rigid: RigidPoses, preloaded: bool | None = None) -> OperatingPoints:
    """Equilibria at poses, see ``find_equilibrium``.

    Raises:
        PoseError: a pose cannot be taken.
        SimulationError: a relief cannot hold its load.
    """
    poses = plant.machine.at(rigid)
    refuse_overcome(plant, poses)
    states = rest_states(plant, poses, preloaded)
    return OperatingPoints(poses, states, poses.gravity_stiffness)


@dataclass(frozen=True, eq=False)
class Motion:
    """Commands at n poses: spool positions, or else speeds of joints and pistons."""

    opening: Array  # (n, nc), NaN where a speed is wanted instead
    velocity: Array  # of joints (n, nq) [rad/s, m/s]; 0 where openings make it

    def of(self, rows: Array | slice | list[int], share: Array | float = 1.0) -> Motion:
        """The motion at some poses, or shares (m, 1) of it."""
        return Motion(self.opening[rows] * share, self.velocity[rows] * share)


def motion_of(plant: Plant, n: int, opening: Openings, speed: ArrayLike | None) -> Motion | None:
    """Commands at n poses; None: rest.

    Raises:
        SimulationError: both are given, an opening is beyond ±1, an actuator is unknown, or there
            are numbers for other poses, actuators or joints.
    """
    machine, nq = plant.machine, len(plant.machine.joints)
    part = f"{machine.name}: operating point"
    if opening is not None and speed is not None:
        raise SimulationError(part, "has openings and joint speeds", "give one of the two")
    names = [actuator.name for actuator in machine.actuators]
    if isinstance(opening, Mapping):
        for name in opening:
            if name not in names:
                raise SimulationError(part, f'no actuator "{name}"', choose(name, names))
        opening = [opening.get(name, 0.0) for name in names]
    if opening is not None:
        openings = _filled(part, "opening", opening, (n, plant.nc), names)
        beyond = np.argwhere(np.abs(openings) > 1)
        if len(beyond):
            row, i = beyond[0]
            fault = f"{names[i]}: an opening of {openings[row, i]:g} is beyond ±1"
            raise SimulationError(part, fault, f"give {np.sign(openings[row, i]):g} at most")
        if plant.nc != nq:
            fault = f"{plant.nc} actuators move {nq} joints: openings leave their forces open"
            raise SimulationError(part, fault, "give joint speeds instead")
        return Motion(openings, np.zeros((n, nq))) if openings.any() else None
    if speed is None:
        return None
    speeds = _filled(part, "speed", speed, (n, nq), machine.joints)
    return Motion(np.full((n, plant.nc), np.nan), speeds) if speeds.any() else None


def _filled(
    part: str, what: str, values: ArrayLike, shape: tuple[int, int], names: Sequence[str]
) -> Array:
    """Numbers as an array of a shape.

    Raises:
        SimulationError: they are none, or have another shape.
    """
    remedy = f"give {shape[1]} numbers ({', '.join(names)}), or one row for each pose"
    try:
        array = np.broadcast_to(np.array(values, dtype=float), shape)
    except (TypeError, ValueError):
        fault = f"{what} is no array of {shape[1]} numbers or of the shape {shape}"
        raise SimulationError(part, fault, remedy) from None
    if not np.all(np.isfinite(array)):
        raise SimulationError(part, f"{what} holds a number that is not finite", remedy)
    return array


def in_motion(
    plant: Plant, rigid: RigidPoses, motion: Motion, preloaded: bool | None = None
) -> OperatingPoints:
    """Steady motion at poses.

    Raises:
        PoseError: a pose cannot be taken.
        SimulationError: pump, valves or vapour do not allow the motion; with what they allow.
    """
    poses = plant.machine.at(rigid)
    refuse_overcome(plant, poses)
    steady = _Steady(plant, poses, motion, preloaded)
    if not steady.possible.all():
        row = int(np.argmin(steady.possible))
        raise _impossible(
            plant, poses[row : row + 1], motion.of([row]), preloaded, steady.why(row)
        )
    k = len(plant.machine.arm.coordinates)
    q, velocity = steady.states[:, :k], steady.states[:, k : 2 * k]
    terms = plant.rigid_bodies.resistance_slopes(q, velocity)
    return OperatingPoints(poses, steady.states, *terms)


def _impossible(
    plant: Plant, pose: Poses, motion: Motion, preloaded: bool | None, why: str
) -> SimulationError:
    """Why a motion at one pose is beyond what the machine can do, and what share of it is not."""
    even = np.arange(1, SHARES + 1) / SHARES
    shares = np.append(np.geomspace(LEAST_SHARE, even[0], SHARES, endpoint=False), even)[:, None]
    rows = np.zeros(len(shares), dtype=int)
    possible = _Steady(plant, pose[rows], motion.of(rows, shares), preloaded).possible
    machine, remedy = plant.machine, "choose another direction, pose or load case"
    if possible.any():
        what, names, values = "speeds", machine.joints, motion.velocity[0]
        if not values.any():
            what, values = "openings", motion.opening[0]
            names = tuple(actuator.name for actuator in machine.actuators)
        share = float(shares[possible].max())
        pairs = zip(names, (share * values).tolist(), strict=True)
        words = ", ".join(f"{name} {_inwards(value):g}" for name, value in pairs if value)
        remedy = f"{share:.2g} of it can be: give {what} {words}"
    fault = f"no steady motion at {pose_text(machine, pose.q[0])}: {why}"
    return SimulationError(f"{machine.name}: operating point", fault, remedy)


def _inwards(value: float) -> float:
    """A number with three digits, not beyond the value."""
    return math.copysign(outward(abs(value), 3, up=False), value)


class _Steady:
    """Steady motion of a plant at poses.

    Attributes:
        states: of the plant (n, size).
        possible: whether the motion is (n,).
    """

    def __init__(self, plant: Plant, poses: Poses, motion: Motion, preloaded: bool | None) -> None:
        self._plant, self._poses, self._preloaded = plant, poses, preloaded
        self._system = plant.parameters.systems[0]
        self._actuators = rows = plant.parameters.actuators[0]
        self._arms = poses.moment_arms[..., : len(plant.machine.joints)]
        wanted = (self._arms @ motion.velocity[:, :, None])[..., 0]
        leaks = np.array(
            [one.valve is not None and one.valve.leaks for one in plant.machine.actuators]
        )
        opening = np.nan_to_num(motion.opening)
        self._driven = (opening != 0) & (leaks | (np.abs(opening) > rows["overlap"]))
        untold = ~self._driven & (wanted == 0)
        self._closed = untold & (~leaks | (preloaded is False))
        self._held = untold & ~self._closed
        self._opening, self._wanted = opening, wanted
        beyond = self._demand() > (float(self._system["flow"]) if plant.has_line else np.inf)
        possible = ~beyond[:, None]
        self._driven, self._held = self._driven & possible, self._held & possible
        self._closed |= beyond[:, None]
        self._line = self._full = np.full((len(poses), 1), float(self._system["pressure"]))
        velocity, settled = self._settle(motion.velocity)
        self._excess = self._supply_excess(self._line)[0]
        limit = EXACT_FLOW * max(float(self._system["flow"]), 1e-9)
        fed = np.abs(self._excess[:, 0]) < limit if plant.has_line else np.ones(len(poses), bool)
        self.possible = (
            settled & fed & ~beyond & np.all(self._closed | self._flow.balanced, axis=1)
        )
        self.states = self._states(velocity)

    def _demand(self) -> Array:
        """Oil that the wanted speeds of the pistons take (n,) [m³/s]."""
        areas = np.where(self._wanted > 0, *(np.abs(a) for a in self._actuators["areas"].T))
        return np.asarray((areas * np.abs(self._wanted)).sum(axis=1))

    def _settle(self, velocity: Array) -> tuple[Array, Flags]:
        """Speeds of the joints (n, nq), and whether they have settled (n,)."""
        plant, poses = self._plant, self._poses
        friction = self._actuators["count"] * self._actuators["viscous"]
        q, nq = plant.machine.arm.with_springs(poses.q), len(plant.machine.joints)
        speeds, rates = np.zeros_like(q), np.where(self._driven, 0.0, self._wanted)
        settled = np.ones(len(q), dtype=bool)
        for _ in range(ROUNDS):
            speeds[:, :nq] = velocity
            resistance = plant.rigid_bodies.resistance(q, speeds)
            load = static_forces(self._arms, resistance, plant.machine.bore_areas, nq)
            self._force = load + friction * rates
            self._near = self._holding(self._line)
            self._line = self._supply()
            self._flow = self._flow_at(self._line)
            if not self._driven.any():
                break
            softness = 1 - self._flow.by_force * friction
            change = np.where(self._driven, (self._flow.speed - rates) / softness, 0.0)
            rates = rates + change
            velocity = np.linalg.solve(self._arms, rates[:, :, None])[..., 0]
            settled = np.abs(change).max(axis=1) <= EXACT * np.abs(rates).max(axis=1)
            if settled.all():
                break
        return velocity, settled

    def _supply(self) -> Array:
        """Pressure of the supply (n, 1) [Pa], at which a limited pump gives what is taken."""
        if not self._plant.has_line:
            return self._full
        return falling_root(self._supply_excess, np.full_like(self._full, LOWEST), self._full)

    def _supply_excess(self, line: Array) -> tuple[Array, Array]:
        """Flow of a limited pump beyond what is taken (n, 1) [m³/s], and its slope."""
        given, slope = slopes.pump(self._system, line)
        flow = self._flow_at(line)
        taken, steep = (
            np.where(self._closed, 0.0, one).sum(axis=1, keepdims=True)
            for one in (flow.supplied, flow.supplied_by_supply)
        )
        return given - taken, slope - steep

    def _flow_at(self, line: Array) -> SteadyFlow:
        """Steady flow of all actuators at a supply pressure (n, 1) [Pa]."""
        data, load = (self._actuators, self._system), Load(self._force, self._closed, line)
        if np.all(self._driven | self._closed):
            return under_spool(*data, load, self._opening)
        others = load._replace(closed=self._closed | self._driven)
        moved = at_speed(*data, others, self._wanted, self._near)
        if not self._driven.any():
            return moved
        flow = under_spool(*data, load, np.where(self._driven, self._opening, moved.spool))
        return flow._replace(balanced=flow.balanced & (self._driven | moved.balanced))

    def _holding(self, line: Array) -> Array:
        """Spools (n, nc) of valves that leak and hold loads as at rest; NaN of others."""
        spools, machine = np.full(self._held.shape, np.nan), self._plant.machine
        for row, i in np.argwhere(self._held):
            law = PortLaw(self._actuators[i], self._system, float(line[row, 0]))
            load = machine.supply, float(self._force[row, i]), self._preloaded
            hold = holding(machine.actuators[i], *load, law)
            if not (hold.overcome or hold.creeps):
                spools[row, i] = hold.spool
        return spools

    def _states(self, velocity: Array) -> Array:
        """States of the plant (n, size)."""
        plant, flow, supply = self._plant, self._flow, self._plant.machine.supply
        pairs = zip(plant.machine.actuators, self._force.T, strict=True)
        shut = np.array([closed_pressures(a, supply, f, self._preloaded) for a, f in pairs])
        moving = np.stack([flow.cap, flow.annulus], axis=1)
        pressures = np.where(self._closed[:, None], shut.transpose(2, 1, 0), moving)
        spool = np.where(self._closed, self._opening, flow.spool)
        states = plant.states_at(self._poses.q, pressures, self._line, spool)
        k = len(plant.machine.arm.coordinates)
        states[:, k : k + velocity.shape[1]] = velocity
        return states

    def why(self, row: int) -> str:
        """Why the motion of a pose is not possible, in words."""
        flow, machine = self._flow, self._plant.machine
        stuck = np.flatnonzero(~(self._closed | flow.balanced)[row])
        pump = float(self._system["flow"]) if self._plant.has_line else np.inf
        needed = float(self._demand()[row])
        if needed > pump:
            return (
                f"it needs {needed / l_per_min:.1f} l/min, the pump gives {pump / l_per_min:.1f}"
            )
        if not len(stuck):
            return "no speed of the pistons at which forces are in balance"
        i = int(stuck[0])
        actuator, cap, annulus = machine.actuators[i], flow.cap[row, i], flow.annulus[row, i]
        if min(cap, annulus) <= LOWEST + bar:
            return f"vapour would fill {actuator.chamber(int(annulus < cap))}"
        if abs(flow.spool[row, i]) > 1 - 1e-9:
            return f"{actuator.name}'s valve, fully open, passes less"
        return f"{actuator.name}'s reliefs open under its load"
