"""A frequency measurement on one cylinder at one pose: band, duration and amplitude of sweeps.

The default amplitude comes from the linear plant: as large as pressures, strokes, the change of
geometry and the softness of air leave it a small motion.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

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
from armdesign.simulation.resting import BARELY, Resting
from armdesign.simulation.run import Simulation
from armdesign.simulation.simulate import SimulationCase
from armdesign.simulation.sweeps import AGREES
from armdesign.units import bar

BAND = (0.5, 1.6)  # of the sweep, relative to the mode
NEIGHBOUR = 1.25  # a mode this close to the band is taken into it, with as much room
CYCLES = 16.0  # of the mode in a sweep
SHARE = 0.5  # of what pressures and strokes leave
LOWEST_PRESSURE = -0.5 * bar  # gauge, above the vapour's
# Relative change of the linear frequency at the ends of the swing. A sine that begins at zero
# moves the piston to one side, so that its mean stands off by up to half of the swing.
DETUNING = 2 * AGREES
SOFTENING = 0.004  # relative change of the bulk modulus, with air
LARGEST_OPENING = 0.5
FINER = 32  # points of a spectrum for each of its lines, where its peak is looked for
CREEP = 0.01  # of the supply pressure: a chamber that drifts by more in a sweep
HOLD_SHARE = 0.25  # corner of the loop that holds the mean, of the lowest frequency of the band


@dataclass(frozen=True, eq=False)
class Experiment:
    """Common ground of the sweeps of one cylinder at one pose."""

    rest: Resting
    index: int  # of the cylinder that sweeps
    mode: int  # that it sweeps over, 0 is the lowest
    band: tuple[float, float]  # of the sweep [Hz]
    duration: float  # of the sweep [s]

    @classmethod
    def of(cls, machine: Machine, pose: Array, index: int, mode: int) -> Experiment:
        """The experiment for one cylinder and mode.

        Raises:
            PoseError, SimulationError: see ``Resting.of``.
        """
        return cls.on(Resting.of(machine, pose), index, mode)

    @classmethod
    def on(cls, rest: Resting, index: int, mode: int) -> Experiment:
        """The experiment on a machine at rest."""
        frequencies = rest.frequencies
        band = _band(frequencies, frequencies[mode])
        shortest = record_length(band, _count(frequencies, band))
        return cls(rest, index, mode, band, max(CYCLES / frequencies[mode], 1.5 * shortest))

    @property
    def valve(self) -> SymmetricValve:
        """Of the cylinder, with the same flow to both sides."""
        return self.rest.valves[self.index]

    @property
    def cylinder(self) -> str:
        """Name of the cylinder that sweeps."""
        return self.rest.machine.actuators[self.index].name

    @property
    def target(self) -> float:
        """Linear frequency of the mode at equilibrium [Hz]."""
        return float(self.rest.frequencies[self.mode])

    @property
    def creeps(self) -> bool:
        """Whether oil leaks that no spool position makes up for: there is no equilibrium then."""
        spool = self.rest.plant.split(self.rest.equilibrium)[4]
        rates = self.rest.plant.derivative(self.rest.equilibrium[None], spool[None])
        fastest = float(np.abs(self.rest.plant.pressures(rates)).max())
        return fastest * self.duration > CREEP * self.rest.machine.supply.pressure

    @property
    def leaks(self) -> bool:
        """Whether a valve leaks, which makes other pressures at rest."""
        return any(one.valve and one.valve.leaks for one in self.rest.machine.actuators)

    @property
    def modes(self) -> int:
        """Number of modes in the band."""
        return _count(self.rest.frequencies, self.band)

    @property
    def rate(self) -> float:
        """Records per second: 16 per period of the fastest mode and of the band's end."""
        return 16 * float(max(self.band[1], self.rest.frequencies.max()))

    def swept_sine(self, amplitude: float) -> SweptSine:
        """The sweep of the valve's mean opening."""
        return SweptSine(
            amplitude=amplitude, start=self.band[0], stop=self.band[1], duration=self.duration
        )

    def commands(
        self, excitation: Callable[[float], float]
    ) -> dict[str, Callable[[float], float]]:
        """Spool commands: the excitation for one valve; those that make up for leakage hold."""
        spools = self.rest.plant.split(self.rest.equilibrium)[4].tolist()
        centre = float(self.valve.opening(spools[self.index]))
        pairs = zip(self.rest.machine.actuators, spools, strict=True)
        commands: dict[str, Callable[[float], float]] = {
            cylinder.name: Step(size=spool) for cylinder, spool in pairs if spool != 0
        }
        return commands | {self.cylinder: SymmetricCommand(self.valve, centre, excitation)}

    def case(self, excitation: Callable[[float], float]) -> SimulationCase:
        """A run under an excitation of the mean opening; a slow loop holds the mean position.

        The excitation is ``swept_sine`` or another function of time.
        """
        return SimulationCase(
            machine=self.rest.swept_machine,
            q=self.rest.pose,
            command=self.commands(excitation),
            duration=self.duration,
            rate=self.rate,
            hold=HOLD_SHARE * self.band[0],
            preloaded=self.rest.preloaded,
        )

    def fit(self, motion: Simulation) -> ModalFit:
        """The modes in the response of the piston's speed to the speed that the spool asks for.

        Raises:
            SimulationError: see ``identify_forced_response``.
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
        return motion.time, asked, motion.speeds[:, self.index]

    @property
    def _part(self) -> str:
        return f"{self.rest.machine.name}: sweep of {self.cylinder}"

    def peak(self, motion: Simulation) -> float:
        """Frequency near the mode at which the spectrum of the piston's speed peaks [Hz]."""
        low, high = self.target / NEIGHBOUR, self.target * NEIGHBOUR
        near = max(self.band[0], low), min(self.band[1], high)
        speed, part = motion.speeds[:, self.index], f"{self.rest.machine.name}: {self.cylinder}"
        padded = np.concatenate([speed, np.zeros((FINER - 1) * len(speed))])
        return spectral_peak(float(motion.time[1]) * np.arange(len(padded)), padded, near, part)

    def default_amplitude(self) -> float:
        """Mean opening at which the linear response to the sweep is small in every respect."""
        joints, cap, annulus, pistons = self._swing(self.rest.linear)
        _, _, caps, annuli, _, _ = self.rest.plant.split(self.rest.equilibrium)
        room = np.concatenate([*map(self._pressure_room, (caps, annuli)), self._ends()])
        used = np.concatenate([cap, annulus, pistons])
        largest = min(float(np.min(room / np.maximum(used, 1e-12))), LARGEST_OPENING)
        return largest * self._undetuned(largest * joints)

    def _swing(self, linear: LinearModel) -> tuple[Array, Array, Array, Array]:
        """Largest swings of joints, pressures [Pa], pistons [m] in a linear sweep of opening 1."""
        plant, size = self.rest.plant, len(linear.A) - 2 * self.rest.plant.nc
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
        plant, column = self.rest.plant, np.zeros(self.rest.plant.size)
        for sign in (1.0, -1.0):
            state = self.rest.equilibrium.copy()
            plant.split(state)[4][self.index] = self.valve.spool(sign)
            rates = plant.derivative(state[None], np.zeros((1, plant.nc)))[0]
            column += sign / 2 * rates * plant.units
        return column

    def _pressure_room(self, pressures: Array) -> Array:
        """Room of pressures (nc,) to swing [Pa]: half of the way to vapour, supply or relief.

        With air little, as it changes the bulk modulus.
        """
        ways = np.minimum(
            pressures - LOWEST_PRESSURE, self.rest.machine.supply.pressure - pressures
        )
        ways = np.minimum(ways, self._relief_room(pressures))
        soft = [_softening(self.rest.machine.fluid, p) for p in pressures.tolist()]
        return np.minimum(SHARE * np.maximum(ways, 0.1 * bar), soft)

    def _relief_room(self, pressures: Array) -> Array:
        """Room of pressures (nc,) to rise [Pa] before a relief below the supply opens.

        Where the other chamber is at return pressure, its edges let in more than out, and both
        pressures climb from swing to swing.
        """
        supply, relief = (
            self.rest.machine.supply,
            self.rest.plant.parameters.actuators["relief"][0],
        )
        _, _, caps, annuli, _, _ = self.rest.plant.split(self.rest.equilibrium)
        climbs = np.minimum(caps, annuli) < supply.return_pressure + BARELY
        room = (relief - pressures) / np.where(climbs, CYCLES, 1.0)
        return np.where(relief < supply.pressure, room, np.inf)

    def _ends(self) -> Array:
        """Room of the pistons to swing (nc,) [m]; motors have no end."""
        no_speed, strokes = np.zeros((1, self.rest.plant.nc)), self.rest.machine.strokes
        places = self.rest.plant.evaluate(self.rest.equilibrium[None], no_speed).extensions[0]
        return SHARE * np.where(np.isinf(strokes), np.inf, np.minimum(places, strokes - places))

    def _undetuned(self, swing: Array) -> float:
        """Share of a swing (k,) that hardly changes the linear frequency of the mode.

        By no more than ``DETUNING``. Joints and springs swing as in the mode, so both ends of the
        swing lie along its shape.
        """
        modes = self.rest.modes
        shape, frequency = modes.shapes[0, :, self.mode], modes.frequencies[0, self.mode]
        way = shape[: len(self.rest.pose)] * np.max(np.abs(swing) / np.abs(shape).max())
        share = 1.0
        for _ in range(20):
            ends = self.rest.machine.rigid_poses(self.rest.pose + share * np.array([way, -way]))
            change = 1.0
            if np.all(self.rest.machine.margins(ends) > 0):
                frequencies = natural_modes(self.rest.machine.evaluate(ends)).frequencies[
                    :, self.mode
                ]
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


def _softening(fluid: Fluid, pressure: float) -> float:
    """Pressure change [Pa] that changes the bulk modulus by ``SOFTENING``; inf without air."""
    if fluid.air == 0:
        return math.inf
    step = 1e-3 * bar
    low, high = (
        math.log(bulk_modulus(pressure + h, fluid.bulk_modulus, fluid.air)) for h in (-step, step)
    )
    return SOFTENING * 2 * step / max(abs(high - low), 1e-15)
