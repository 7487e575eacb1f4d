"""A frequency measurement on one cylinder at one pose: band, duration and amplitude of sweeps.

The default amplitude comes from the linear plant: as large as pressures, strokes, the change of
geometry and the softness of air leave it a small motion.

A closed valve leaves a chamber at return pressure, at whose edge there is no pressure drop to
sweep with. Oil without air is as stiff under any pressure, so there the sweeps run about a preload
instead: p1 + p2 = supply + return, or less where a relief would open. Oil with air rests as the
machine file says, like the linear answer.

A pump of limited flow fills the line to its valves again within a millisecond or so, and no step
of an explicit integration may be much longer, though nothing in a sweep is as fast. So the sweeps
have a line of more oil, filled again at ``REFILL`` times ω of the fastest mode. What the pump
gives at every pressure is the machine's.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from armdesign.arrays import Array
from armdesign.errors import SimulationError
from armdesign.frequency.modes import natural_modes
from armdesign.hydraulics.fluid import Fluid, bulk_modulus
from armdesign.machine.machine import Machine
from armdesign.simulation.excitation import Step, SweptSine, SymmetricCommand, SymmetricValve
from armdesign.simulation.identification.modal_fit import (
    ModalFit,
    identify_forced_response,
    record_length,
    response_by_modes,
    spectral_peak,
)
from armdesign.simulation.linear_model import LinearModel
from armdesign.simulation.linearization import linearize
from armdesign.simulation.plant.equilibrium import find_equilibrium
from armdesign.simulation.plant.plant import Plant
from armdesign.simulation.plant.springs import settled
from armdesign.simulation.run import Simulation
from armdesign.simulation.simulate import SimulationCase
from armdesign.simulation.sweeps import AGREES
from armdesign.units import bar, mm

BAND = (0.5, 1.6)  # of the sweep, relative to the mode
NEIGHBOUR = 1.25  # a mode this close to the band is taken into it, with as much room
CYCLES = 16.0  # of the mode in a sweep
SHARE = 0.5  # of what pressures and strokes leave
LOWEST_PRESSURE = -0.5 * bar  # gauge, above the vapour's
# Relative change of the linear frequency at the ends of the swing. A sine that begins at zero
# moves the piston to one side, so that its mean stands off by up to half of the swing.
DETUNING = 2 * AGREES
SOFTENING = 0.004  # relative change of the bulk modulus, with air
BARELY = 0.5 * bar  # above return pressure, or below a relief
LARGEST_OPENING = 0.5
LEAST_END = 1e-3  # of the stroke
FINER = 32  # points of a spectrum for each of its lines, where its peak is looked for
CREEP = 0.01  # of the supply pressure: a chamber that drifts by more in a sweep
REFILL = 4.0  # least rate at which the pump fills its line, relative to ω of the fastest mode
HOLD_SHARE = 0.25  # corner of the loop that holds the mean, of the lowest frequency of the band


@dataclass(frozen=True, eq=False)
class Experiment:
    """Common ground of the sweeps of one cylinder at one pose.

    If damping leaves fewer pairs than joints and springs, ``frequencies`` are the modes' on
    trapped oil. The two differ where oil with air rests under other pressures than the load alone
    makes.
    """

    machine: Machine  # under the payload at work
    pose: Array  # (nq,) [rad, m]
    index: int  # of the cylinder that sweeps
    mode: int  # that it sweeps over, 0 is the lowest
    linear: LinearModel  # the plant linearised at its equilibrium
    frequencies: Array  # its natural frequencies (k,) [Hz]
    band: tuple[float, float]  # of the sweep [Hz]
    duration: float  # of the sweep [s]
    plant: Plant  # the nonlinear model
    preloaded: bool | None  # pressures that the sweeps run about, see ``find_equilibrium``
    equilibrium: Array  # its state there (size,)
    valve: SymmetricValve  # of the cylinder, with the same flow to both sides

    @classmethod
    def of(cls, machine: Machine, pose: Array, index: int, mode: int) -> Experiment:
        """The experiment for one cylinder and mode.

        Raises:
            PoseError: the pose cannot be taken.
            SimulationError: a valve is missing, the mode is unstable, a load cannot be held or a
                piston is at its end.
        """
        machine = settled(machine, pose)
        plant, preloaded = Plant(machine), True if machine.fluid.air == 0 else None
        equilibrium = find_equilibrium(plant, pose, preloaded).state
        trapped = natural_modes(machine.at(pose)).frequencies[0]
        if trapped[mode] == 0:
            part = f"{machine.name}: mode {mode + 1}"
            raise SimulationError(part, "is unstable on its trapped oil", "choose another pose")
        _refuse_limits(plant, equilibrium)
        linear = linearize(machine, pose, preloaded=preloaded)
        frequencies = linear.natural_frequencies if len(linear.modes) == len(trapped) else trapped
        band = _band(frequencies, frequencies[mode])
        shortest = record_length(band, _count(frequencies, band))
        return cls(
            machine=machine,
            pose=pose,
            index=index,
            mode=mode,
            linear=linear,
            frequencies=frequencies,
            band=band,
            duration=max(CYCLES / frequencies[mode], 1.5 * shortest),
            plant=plant,
            preloaded=preloaded,
            equilibrium=equilibrium,
            valve=SymmetricValve.all(plant, equilibrium)[index],
        )

    def of_machine(self, machine: Machine) -> Experiment:
        """The same experiment on a version of the machine with the same equilibrium."""
        return replace(self, machine=machine, plant=Plant(machine))

    @property
    def cylinder(self) -> str:
        """Name of the cylinder that sweeps."""
        return self.machine.actuators[self.index].name

    @property
    def target(self) -> float:
        """Linear frequency of the mode at equilibrium [Hz]."""
        return float(self.frequencies[self.mode])

    @property
    def creeps(self) -> bool:
        """Whether oil leaks that no spool position makes up for: there is no equilibrium then."""
        spool = self.plant.split(self.equilibrium)[4]
        rates = self.plant.derivative(self.equilibrium[None], spool[None])
        fastest = float(np.abs(self.plant.pressures(rates)).max())
        return fastest * self.duration > CREEP * self.machine.supply.pressure

    @property
    def modes(self) -> int:
        """Number of modes in the band."""
        return _count(self.frequencies, self.band)

    @property
    def rate(self) -> float:
        """Records per second: 16 per period of the fastest mode and of the band's end."""
        return 16 * float(max(self.band[1], self.frequencies.max()))

    def swept_sine(self, amplitude: float) -> SweptSine:
        """The sweep of the valve's mean opening."""
        return SweptSine(
            amplitude=amplitude, start=self.band[0], stop=self.band[1], duration=self.duration
        )

    def commands(
        self, excitation: Callable[[float], float]
    ) -> dict[str, Callable[[float], float]]:
        """Spool commands: the excitation for one valve; those that make up for leakage hold."""
        spools = self.plant.split(self.equilibrium)[4].tolist()
        centre = float(self.valve.opening(spools[self.index]))
        pairs = zip(self.machine.actuators, spools, strict=True)
        commands: dict[str, Callable[[float], float]] = {
            cylinder.name: Step(size=spool) for cylinder, spool in pairs if spool != 0
        }
        return commands | {self.cylinder: SymmetricCommand(self.valve, centre, excitation)}

    def case(
        self, excitation: Callable[[float], float], duration: float | None = None
    ) -> SimulationCase:
        """A run under an excitation of the mean opening; a slow loop holds the mean position.

        The excitation is ``swept_sine`` or another function of time, the duration the sweep's
        unless one is given [s].
        """
        return SimulationCase(
            machine=self._swept_machine,
            q=self.pose,
            command=self.commands(excitation),
            duration=duration or self.duration,
            rate=self.rate,
            hold=HOLD_SHARE * self.band[0],
            preloaded=self.preloaded,
        )

    @cached_property
    def _swept_machine(self) -> Machine:
        """The machine with no less oil between pump and valves than ``REFILL`` asks for."""
        machine, supply = self.machine, self.machine.supply
        if not supply.flow_limited:
            return machine
        slope = supply.flow / (supply.cut_off * supply.pressure)
        rate = REFILL * 2 * math.pi * float(self.frequencies.max())
        volume = max(supply.line_volume, slope * machine.fluid.bulk_modulus / rate)
        return replace(machine, supply=replace(supply, line_volume=volume))

    def fit(self, motion: Simulation) -> ModalFit:
        """The modes in the response of the piston's speed to the speed that the spool asks for.

        Raises:
            SimulationError: the spool opened nothing, or see ``identify_forced_response``.
        """
        record, modes = self._record(motion), self.modes
        return identify_forced_response(*record, self.band, modes, self._part, noisy_input=False)

    def on_resonance(self, motion: Simulation, fit: ModalFit, frequency: float) -> Array:
        """Response at a natural frequency and the lines beside it (2, m): [Hz] and magnitude.

        Lines of the whole record may all lie beside a sharp peak; cut to a whole number of the
        mode's periods it has a line there. None (2, 0) where the shorter record is too short.
        """
        step = float(motion.time[1] - motion.time[0])
        periods = math.floor(len(motion.time) * step * frequency)
        count = round(periods / (frequency * step))
        time, asked, speed = (signal[:count] for signal in self._record(motion))
        try:
            lines, response = response_by_modes(fit, time, asked, speed, self.band)
        except SimulationError:
            return np.zeros((2, 0))
        near = np.abs(lines - frequency) < 1.5 / (count * step)
        return np.stack([lines, np.abs(response)])[:, near]

    def _record(self, motion: Simulation) -> tuple[Array, Array, Array]:
        """Instants [s], speeds of the piston that the spool asks for, and its own (n,) [m/s]."""
        asked = np.asarray(self.valve.speed * self.valve.opening(motion.spool[:, self.index]))
        if not np.any(asked):
            overlap = 100 * self.valve.valve.overlap
            fault = f"the spool stays within its overlap of {overlap:g} %"
            raise SimulationError(self._part, fault, "raise the amplitude, or give a faster spool")
        return motion.time, asked, motion.speeds[:, self.index]

    @property
    def _part(self) -> str:
        return f"{self.machine.name}: sweep of {self.cylinder}"

    def peak(self, motion: Simulation) -> float:
        """Frequency near the mode at which the spectrum of the piston's speed peaks [Hz]."""
        low, high = self.target / NEIGHBOUR, self.target * NEIGHBOUR
        near = max(self.band[0], low), min(self.band[1], high)
        speed, part = motion.speeds[:, self.index], f"{self.machine.name}: {self.cylinder}"
        padded = np.concatenate([speed, np.zeros((FINER - 1) * len(speed))])
        return spectral_peak(float(motion.time[1]) * np.arange(len(padded)), padded, near, part)

    def default_amplitude(self) -> float:
        """Mean opening at which the linear response to the sweep is small in every respect."""
        joints, cap, annulus, pistons = self._swing(self.linear)
        _, _, caps, annuli, _, _ = self.plant.split(self.equilibrium)
        room = np.concatenate([*map(self._pressure_room, (caps, annuli)), self._ends()])
        used = np.concatenate([cap, annulus, pistons])
        largest = min(float(np.min(room / np.maximum(used, 1e-12))), LARGEST_OPENING)
        return largest * self._undetuned(largest * joints)

    def _swing(self, linear: LinearModel) -> tuple[Array, Array, Array, Array]:
        """Largest swings of joints, pressures [Pa], pistons [m] in a linear sweep of opening 1."""
        plant, size = self.plant, len(linear.A) - 2 * self.plant.nc
        time = np.arange(0, self.duration, 1 / self.rate)
        pistons = linear.select(outputs="piston positions").C
        outputs = np.vstack([np.eye(size), pistons[:, :size]])
        opening = np.array(list(map(self.swept_sine(1.0), time.tolist())))
        column = self._opening_column()[:size]
        states = linear_answer(linear.A[:size, :size], column, opening, 1 / self.rate)
        swing = np.abs(states @ outputs.T).max(axis=0)
        edges = np.cumsum([plant.nq, plant.nq, plant.nc, plant.nc, int(plant.has_line)])
        joints, _, cap, annulus, _, pistons = np.split(swing, edges)
        return joints, cap, annulus, pistons

    def _opening_column(self) -> Array:
        """Change of ẏ (size,) by a unit of mean opening at equilibrium, SI: a column of B."""
        plant, column = self.plant, np.zeros(self.plant.size)
        for sign in (1.0, -1.0):
            state = self.equilibrium.copy()
            plant.split(state)[4][self.index] = self.valve.spool(sign)
            rates = plant.derivative(state[None], np.zeros((1, plant.nc)))[0]
            column += sign / 2 * rates * plant.units
        return column

    def _pressure_room(self, pressures: Array) -> Array:
        """Room of pressures (nc,) to swing [Pa]: half of the way to vapour, supply or relief.

        With air little, as it changes the bulk modulus.
        """
        ways = np.minimum(pressures - LOWEST_PRESSURE, self.machine.supply.pressure - pressures)
        ways = np.minimum(ways, self._relief_room(pressures))
        soft = [_softening(self.machine.fluid, p) for p in pressures.tolist()]
        return np.minimum(SHARE * np.maximum(ways, 0.1 * bar), soft)

    def _relief_room(self, pressures: Array) -> Array:
        """Room of pressures (nc,) to rise [Pa] before a relief below the supply opens.

        Where the other chamber is at return pressure, its edges let in more than out, and both
        pressures climb from swing to swing.
        """
        supply, relief = self.machine.supply, self.plant.parameters.actuators["relief"][0]
        _, _, caps, annuli, _, _ = self.plant.split(self.equilibrium)
        climbs = np.minimum(caps, annuli) < supply.return_pressure + BARELY
        room = (relief - pressures) / np.where(climbs, CYCLES, 1.0)
        return np.where(relief < supply.pressure, room, np.inf)

    def _ends(self) -> Array:
        """Room of the pistons to swing (nc,) [m]; motors have no end."""
        no_speed, strokes = np.zeros((1, self.plant.nc)), self.machine.strokes
        places = self.plant.evaluate(self.equilibrium[None], no_speed).extensions[0]
        return SHARE * np.where(np.isinf(strokes), np.inf, np.minimum(places, strokes - places))

    def _undetuned(self, swing: Array) -> float:
        """Share of a swing (k,) that hardly changes the linear frequency of the mode.

        By no more than ``DETUNING``. Joints and springs swing as in the mode, so both ends of the
        swing lie along its shape.
        """
        modes = natural_modes(self.machine.at(self.pose))
        shape, frequency = modes.shapes[0, :, self.mode], modes.frequencies[0, self.mode]
        way = shape[: len(self.pose)] * np.max(np.abs(swing) / np.abs(shape).max())
        share = 1.0
        for _ in range(20):
            ends = self.machine.rigid_poses(self.pose + share * np.array([way, -way]))
            change = 1.0
            if np.all(self.machine.margins(ends) > 0):
                frequencies = natural_modes(self.machine.evaluate(ends)).frequencies[:, self.mode]
                change = float(np.abs(frequencies / frequency - 1).max())
            if change <= DETUNING:
                break
            share *= max(0.9 * DETUNING / change, 0.2)
        return share


def linear_answer(A: Array, column: Array, values: Array, step: float) -> Array:
    """States (n, ns) of ẋ = A x + b u from rest, exact for u straight between its values (n,).

    Args:
        A: (ns, ns).
        column: b (ns,).
        values: of u, ``step`` [s] apart.
        step: [s].
    """
    from scipy.linalg import expm

    size, n = len(A), len(values)
    extended = np.zeros((size + 2, size + 2))  # by u and by its change within a step
    extended[:size, :size], extended[:size, size] = A * step, column * step
    extended[size, size + 1] = 1.0
    grown = expm(extended)
    power, by_value, by_change = grown[:size, :size].T, grown[:size, size], grown[:size, size + 1]
    states = np.zeros((n, size))
    states[1:] = np.outer(values[:-1], by_value) + np.outer(np.diff(values), by_change)
    reach = 1  # steps over which the answers to all values are summed by now
    while reach < n:
        states[reach:] += states[:-reach] @ power
        power, reach = power @ power, 2 * reach
    return states


def _count(frequencies: Array, band: tuple[float, float]) -> int:
    return int(np.sum((frequencies >= band[0]) & (frequencies <= band[1])))


def _band(frequencies: Array, target: float) -> tuple[float, float]:
    """Band [Hz] about a mode, widened so that no neighbour sits on its edge."""
    low, high = BAND[0] * target, BAND[1] * target
    for other in np.sort(frequencies):
        if low / NEIGHBOUR < other < high * NEIGHBOUR:
            low, high = min(low, other / NEIGHBOUR), max(high, other * NEIGHBOUR)
    return float(low), float(high)


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
        stands = "rests at {:.{}f} bar" if leaks else "needs {:.{}f} bar to hold the load"
        if pressure >= supply.pressure:
            fault = f"{stands.format(pressure / bar, 0)}, supply is {supply.pressure / bar:.0f}"
            remedy = "choose a lighter load, a larger cylinder or another pose"
            raise SimulationError(part, f"{fault} bar", remedy)
        if pressure > relief - BARELY:
            fault = f"{stands.format(pressure / bar, 1)}, its relief opens at"
            remedy = "raise relief_bar, or choose a lighter load or another pose"
            raise SimulationError(part, f"{fault} {relief / bar:.1f} bar", remedy)
        if math.isfinite(cylinder.stroke) and end < LEAST_END * cylinder.stroke:
            fault = f"is {end / mm:.2f} mm from its end stop"
            raise SimulationError(part, fault, "choose a pose inside its stroke")


def _softening(fluid: Fluid, pressure: float) -> float:
    """Pressure change [Pa] that changes the bulk modulus by ``SOFTENING``; inf without air."""
    if fluid.air == 0:
        return math.inf
    step = 1e-3 * bar
    low, high = (
        math.log(bulk_modulus(pressure + h, fluid.bulk_modulus, fluid.air)) for h in (-step, step)
    )
    return SOFTENING * 2 * step / max(abs(high - low), 1e-15)
