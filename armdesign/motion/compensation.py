"""Pressure compensation, computed ahead: spools that pass planned oil while pressures swing.

A valve that opens as the static load asks for passes less oil while inertia presses on the piston
and more while it pulls: that damps the arm as long as the valve is open, and a shaper, which
counts on a mode that rings alike from its first impulse to its last, leaves more than it should.
And at the start an unloaded chamber has first to be filled. So the spools are those with which, in
the model of the plant itself and at each instant's pressures, a piston whose force does not change
would move as planned:

    Σ A_i Q_i(x, p)/C_i = v Σ A_i²/C_i,

as behind a pressure compensator. The force then follows Ḟ = k (v − ℓ̇): the arm rings on its oil
spring alone, and linear theory of shapers holds. The plant is integrated with spools that stand
where they should at once; the commands lead by the lag 2ζ/ω of each spool. What is assumed is the
model's own load, oil and friction.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armdesign.arrays import Array
from armdesign.errors import SimulationError
from armdesign.frequency.modes import natural_modes
from armdesign.hydraulics.valve import opening, spool_position
from armdesign.machine.machine import Machine
from armdesign.motion.feed_forward import SLOW, SpoolPlan
from armdesign.motion.trajectory import Trajectory
from armdesign.simulation.excitation import Table
from armdesign.simulation.integrator import Breaks, GaveUpError, Pace, Span, integrate
from armdesign.simulation.plant.equilibrium import find_equilibrium
from armdesign.simulation.plant.plant import Plant
from armdesign.simulation.plant.springs import settled

TOLERANCE = 1e-5
MOST_STEPS = 200_000
ROUNDS = 4  # in which openings are found where flow is not proportional to them
NEARLY_SHUT = 1e-6  # opening
FURTHER = 1.5  # at most, over the opening that the planned motion asks for of a stiff arm


@dataclass(frozen=True, eq=False)
class CompensatedPlant:
    """n plans of one machine, with spools that stand where they should."""

    plant: Plant
    plans: tuple[tuple[Array, SpoolPlan], ...]  # instants [s] and what is planned then

    def picked(self, cases: Sequence[int]) -> CompensatedPlant:
        """Some of the plans."""
        return replace(self, plans=tuple(self.plans[case] for case in cases))

    def rates(self, time: Array, state: Array) -> Array:
        """ẏ (n, size) at times (n,) [s] and states; spools stay where the state has them."""
        spools = self.spools(time, state)
        return self.plant.evaluate(self.plant.with_spools(state, spools), spools).rates

    def spools(self, time: Array, state: Array) -> Array:
        """Spool positions (n, nc) at times (n,) [s] and states."""
        pairs = list(zip(time.tolist(), self.plans, strict=True))
        speed = np.array([_at(t, instants, plan.speeds) for t, (instants, plan) in pairs])
        widest = np.array([_at(t, instants, plan.widest) for t, (instants, plan) in pairs])
        way, moves = np.sign(speed), np.abs(speed) > SLOW
        spools = np.where(moves, way, widest)
        for _ in range(self._rounds):
            spools = np.where(moves, self._corrected(state, spools, speed, widest), widest)
        return spools

    @property
    def _rounds(self) -> int:
        """Flow is proportional to the opening, but for a load-holding valve in series."""
        holding = any(actuator.load_holding for actuator in self.plant.machine.actuators)
        return ROUNDS if holding else 1

    def _corrected(self, state: Array, spools: Array, speed: Array, widest: Array) -> Array:
        """Spools that pass the oil if flow is proportional to the opening from here on."""
        now = self.plant.evaluate(self.plant.with_spools(state, spools), spools)
        areas, way = self.plant.parameters.actuators["areas"][0], np.sign(speed)
        share = areas / now.outputs["capacity"]
        stiffness = (share * areas).sum(axis=-1)
        passed = (share * now.valve_flows).sum(axis=-1) / stiffness
        leaked = (share * now.outputs["leaked"]).sum(axis=-1) / stiffness
        corrected = spools.copy()
        for i, actuator in enumerate(self.plant.machine.actuators):
            valve = actuator.valve
            assert valve is not None
            open_now = np.maximum(np.abs(opening(valve, spools[:, i])), NEARLY_SHUT)
            most = np.minimum(FURTHER * np.abs(opening(valve, widest[:, i])), 1.0)
            able = np.maximum(passed[:, i] * way[:, i] / open_now, 1e-12)
            wanted = (speed[:, i] - leaked[:, i]) * way[:, i]
            share_open = np.clip(wanted / able, NEARLY_SHUT, np.maximum(most, NEARLY_SHUT))
            corrected[:, i] = spool_position(valve, share_open * way[:, i])
        return corrected


def compensated_commands(
    machine: Machine, trajectories: Sequence[Trajectory], plans: Sequence[SpoolPlan]
) -> list[dict[str, Table]]:
    """Spool commands by actuator of some trajectories from one pose, leading by the spools' lags.

    They begin to move when the slowest valve's lag has passed.

    Raises:
        SimulationError: the model of the plant cannot follow.
    """
    settled_machine = settled(machine, trajectories[0].q[0])
    plant = Plant(settled_machine)
    start = find_equilibrium(plant, trajectories[0].q[0]).state
    pairs = zip(trajectories, plans, strict=True)
    system = CompensatedPlant(plant, tuple((one.time, plan) for one, plan in pairs))
    durations = [one.duration for one in trajectories]
    omega = 2 * math.pi * natural_modes(machine.at(trajectories[0].q[0])).frequencies.max()
    pace = np.full(len(plans), omega)
    runs = integrate(
        system,
        np.tile(start, (len(plans), 1)),
        Span(np.array(durations), np.array([len(one.time) - 1 for one in trajectories])),
        Pace(pace, pace),
        tuple(Breaks((), complete=True) for _ in plans),
        TOLERANCE,
        MOST_STEPS,
    )
    return [
        _tables(machine, system.picked([case]), one, states)
        for case, (one, states) in enumerate(zip(trajectories, runs, strict=True))
    ]


def command_lead(machine: Machine) -> float:
    """Lag of the slowest spool [s], after which planned motion begins."""
    return max(_lags(machine))


def _lags(machine: Machine) -> list[float]:
    valves = [actuator.valve for actuator in machine.actuators]
    return [
        valve.damping_ratio / (math.pi * valve.natural_frequency)
        for valve in valves
        if valve is not None
    ]


def _tables(
    machine: Machine, system: CompensatedPlant, planned: Trajectory, states: Array | GaveUpError
) -> dict[str, Table]:
    if isinstance(states, GaveUpError):
        fault = f"the arm cannot follow the plan beyond {states.time:.3g} s ({states.cause})"
        raise SimulationError(f"{machine.name}: move", fault, "give a longer duration")
    many = replace(system, plans=system.plans * len(states))
    spools, lags = many.spools(planned.time, states), _lags(machine)
    spools[-1] = system.plans[0][1].spools[-1]
    late = planned.time[:, None] + max(lags) - np.array(lags)
    names = [actuator.name for actuator in machine.actuators]
    return {
        name: Table(late[:, i].tolist(), spools[:, i].tolist()) for i, name in enumerate(names)
    }


def _at(time: float, instants: Array, values: Array) -> Array:
    """Values (nc,) between even instants."""
    place = min(time / instants[-1], 1.0) * (len(instants) - 1)
    k = min(int(place), len(instants) - 2)
    return np.asarray(values[k] + (place - k) * (values[k + 1] - values[k]))
