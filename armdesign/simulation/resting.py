"""A machine at rest at a pose: the common ground of the experiments there.

A closed valve leaves a chamber at return pressure, at whose edge there is no pressure drop to
sweep with. Oil without air is as stiff under any pressure, so there the sweeps run about a preload
instead: p1 + p2 = supply + return, or less where a relief would open. Oil with air rests as the
machine file says, like the linear answer.

A pump of limited flow fills the line to its valves again within a millisecond or so, and no step
of an explicit integration may be much longer, though nothing in a sweep is as fast. So the sweeps
have a line of more oil, filled again at ``REFILL`` times ω of the fastest mode. What the pump
gives at every pressure is the machine's.

The spools have no overlap: at each turn of a sweep they would have to leap over it, and overshoot
by more than a small sweep asks for. A spool that rests shut is shut without it as well.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from armdesign.arrays import Array
from armdesign.errors import SimulationError
from armdesign.frequency.modes import Modes, natural_modes
from armdesign.machine.actuators import F, with_each
from armdesign.machine.machine import Machine
from armdesign.simulation.excitation import SymmetricValve
from armdesign.simulation.linear_model import LinearModel
from armdesign.simulation.linearization import linearize
from armdesign.simulation.plant.equilibrium import find_equilibrium
from armdesign.simulation.plant.plant import Plant
from armdesign.simulation.plant.springs import settled
from armdesign.units import bar, mm

BARELY = 0.5 * bar  # above return pressure, or below a relief
LEAST_END = 1e-3  # of the stroke
REFILL = 4.0  # least rate at which the pump fills its line, relative to ω of the fastest mode


@dataclass(frozen=True, eq=False)
class Resting:
    """A machine under the payload at work, in equilibrium at a pose.

    If damping leaves fewer pairs than joints and springs, ``frequencies`` are the modes' on
    trapped oil. The two differ where oil with air rests under other pressures than the load alone
    makes.
    """

    machine: Machine
    swept_machine: Machine  # with no less oil between pump and valves than ``REFILL`` asks for
    pose: Array  # (nq,) [rad, m]
    modes: Modes  # on trapped oil there
    linear: LinearModel  # the plant linearised at its equilibrium
    frequencies: Array  # its natural frequencies (k,) [Hz]
    plant: Plant  # the nonlinear model
    preloaded: bool | None  # pressures of the equilibrium, see ``find_equilibrium``
    equilibrium: Array  # its state there (size,)
    valves: tuple[SymmetricValve, ...]  # of the actuators, with the same flow to both sides

    @property
    def counterparts(self) -> list[int]:
        """Index among ``frequencies`` of each mode on trapped oil (k,): of the same motion.

        Other pressures, as behind a valve that leaks, change modes unlike and so their order.
        """
        from scipy.optimize import linear_sum_assignment

        damped = self.linear.damped_modes.shapes
        if damped.shape[1] != len(self.frequencies):
            return list(range(len(self.frequencies)))
        alike = np.abs(self.modes.shapes[0].T @ self.linear.mass_matrix @ damped) ** 2
        return linear_sum_assignment(alike, maximize=True)[1].tolist()

    @classmethod
    def of(cls, machine: Machine, pose: Array) -> Self:
        """The machine at rest at a pose (nq,).

        Raises:
            PoseError: the pose cannot be taken.
            SimulationError: a valve is missing, trapped oil does not hold the pose, a load cannot
                be held or a piston is at its end.
        """
        machine = _without_overlap(settled(machine, pose))
        plant, preloaded = Plant(machine), True if machine.fluid.air == 0 else None
        equilibrium = find_equilibrium(plant, pose, preloaded).state
        _refuse_limits(plant, equilibrium)
        linear, modes = (
            linearize(machine, pose, preloaded=preloaded),
            natural_modes(machine.at(pose)),
        )
        frequencies, trapped = linear.natural_frequencies, modes.frequencies[0]
        if len(frequencies) != len(trapped):
            frequencies = trapped
        return cls(
            machine=machine,
            swept_machine=_with_line(machine, float(frequencies.max())),
            pose=pose,
            modes=modes,
            linear=linear,
            frequencies=frequencies,
            plant=plant,
            preloaded=preloaded,
            equilibrium=equilibrium,
            valves=tuple(SymmetricValve.all(plant, equilibrium)),
        )

    def of_machine(self, machine: Machine) -> Self:
        """The same of a version of its machine with the same equilibrium and linear model."""
        swept = _with_line(machine, float(self.frequencies.max()))
        return replace(self, machine=machine, swept_machine=swept, plant=Plant(machine))


def _without_overlap(machine: Machine) -> Machine:
    """The machine whose spools have none."""

    def edged(actuator: F) -> F:
        valve = actuator.valve
        return replace(actuator, valve=None if valve is None else valve.without_overlap)

    return with_each(machine, edged)


def _with_line(machine: Machine, fastest: float) -> Machine:
    """The machine with a line filled no faster than sweeps about modes up to a ``fastest`` need.

    That is ``REFILL`` times the mode's ω, its frequency in Hz.
    """
    supply = machine.supply
    if not supply.flow_limited:
        return machine
    slope = supply.flow / (supply.cut_off * supply.pressure)
    enough = slope * machine.fluid.bulk_modulus / (REFILL * 2 * math.pi * fastest)
    volume = max(supply.line_volume, enough)
    return replace(machine, supply=replace(supply, line_volume=volume))


def _refuse_limits(plant: Plant, equilibrium: Array) -> None:
    """Refuse where nothing can oscillate: a load above supply or relief, a piston on its stop."""
    pressures = plant.pressures(equilibrium[None])[0].max(axis=0)
    places = plant.evaluate(equilibrium[None], np.zeros((1, plant.nc))).extensions[0].tolist()
    supply = plant.machine.supply
    for cylinder, place, pressure in zip(plant.machine.actuators, places, pressures, strict=True):
        part = f"{plant.machine.name}: {cylinder.name} {cylinder.kind}"
        relief, end = cylinder.relief(supply), min(place, cylinder.stroke - place)
        leaks = cylinder.valve is not None and cylinder.valve.leaks
        # Behind a valve that leaks the flow makes the pressure, too.
        stands = f"rests at {pressure / bar:.4g} bar"
        if not leaks:
            stands = f"needs {pressure / bar:.4g} bar to hold the load"
        if pressure >= supply.pressure:
            fault = f"{stands}, supply is {supply.pressure / bar:.4g}"
            remedy = "choose a lighter load, a larger cylinder or another pose"
            raise SimulationError(part, f"{fault} bar", remedy)
        if pressure > relief - BARELY:
            fault = f"{stands}, its relief opens at"
            remedy = "raise relief_bar, or choose a lighter load or another pose"
            raise SimulationError(part, f"{fault} {relief / bar:.4g} bar", remedy)
        if math.isfinite(cylinder.stroke) and end < LEAST_END * cylinder.stroke:
            fault = f"is {end / mm:.2f} mm from its end stop"
            raise SimulationError(part, fault, "choose a pose inside its stroke")
