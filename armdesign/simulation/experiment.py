"""A frequency measurement on one cylinder at one pose: over which band, how long and how hard to sweep.

The default amplitude comes from the linear plant: as large as pressures, strokes, the change of
geometry and the softness of air leave it a small motion.

A shut valve leaves a chamber at return pressure, at whose edge there is no pressure drop to sweep
with. Oil without air is as stiff under any pressure, so there the sweeps run about a preload
instead: p1 + p2 = supply + return, or less where a relief would open. Oil with air rests as the
machine file says, like the linear answer.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from armdesign.arrays import Array
from armdesign.errors import SimulationError
from armdesign.frequency.modes import natural_modes
from armdesign.hydraulics.fluid import Fluid, bulk_modulus
from armdesign.machine.machine import Machine
from armdesign.simulation.excitation import EvenOpening, Moved, Step, Sweep
from armdesign.simulation.identification.modal_fit import (
    Fit,
    fit_modes,
    record_length,
    spectral_peak,
)
from armdesign.simulation.linearization import LinearModel, linearize
from armdesign.simulation.plant.plant import Plant
from armdesign.simulation.simulate import Case, Simulation
from armdesign.units import bar, mm

BAND = (0.5, 1.6)  # of the sweep, relative to the mode
NEIGHBOUR = 1.25  # a mode this close to the band is taken into it, with as much room
CYCLES = 16.0  # of the mode in a sweep
SHARE = 0.5  # of what pressures and strokes leave
LOWEST_PRESSURE = -0.5 * bar  # gauge, above the vapour's
DETUNING = 0.02  # relative change of the linear frequency at the ends of the swing
SOFTENING = 0.004  # relative change of the bulk modulus, with air
BARELY = 0.5 * bar  # above return pressure, or below a relief
LARGEST_OPENING = 0.5
LEAST_END = 1e-3  # of the stroke
FINER = 32  # points of a spectrum for each of its lines, where its peak is looked for
CREEP = 0.01  # of the supply pressure: a chamber that drifts by more in a sweep
HOLD_SHARE = (
    0.25  # corner of the slow loop that holds the mean, of the lowest frequency of the band
)


@dataclass(frozen=True, eq=False)
class Experiment:
    """What the sweeps of one cylinder at one pose have in common.

    Attributes:
        machine: under the payload at work.
        pose: (nq,) [rad, m].
        index: of the cylinder that sweeps.
        mode: that it sweeps over, 0 is the lowest.
        linear: the plant linearised at its rest.
        frequencies: its natural frequencies (nq,) [Hz]; if damping leaves fewer pairs than joints,
            those of the modes on trapped oil. The two differ where oil with air rests under other
            pressures than the load alone makes.
        band: of the sweep [Hz].
        duration: of the sweep [s].
        plant: the nonlinear model.
        preloaded: the rest that the sweeps run about, see ``Plant.rest``.
        rest: its state there.
        even: the cylinder's valve, made even.
    """

    machine: Machine
    pose: Array
    index: int
    mode: int
    linear: LinearModel
    frequencies: Array
    band: tuple[float, float]
    duration: float
    plant: Plant
    preloaded: bool | None
    rest: Array
    even: EvenOpening

    @classmethod
    def of(cls, machine: Machine, pose: Array, index: int, mode: int) -> Experiment:
        """The experiment for one cylinder and mode.

        Raises:
            PoseError: the pose cannot be taken.
            SimulationError: a valve is missing, the mode is unstable, a load cannot be held or a
                piston is at its end.
        """
        plant, preloaded = Plant(machine), True if machine.fluid.air == 0 else None
        rest = plant.rest(pose, preloaded)
        trapped = natural_modes(machine.at(pose)).frequencies[0]
        if trapped[mode] == 0:
            part = f"{machine.name}: mode {mode + 1}"
            raise SimulationError(part, "is unstable on its trapped oil", "choose another pose")
        _refuse_limits(plant, rest)
        linear = linearize(machine, pose, preloaded=preloaded)
        frequencies = linear.natural_frequencies if len(linear.modes) == len(trapped) else trapped
        band = _band(frequencies, frequencies[mode])
        duration = max(
            CYCLES / frequencies[mode], 1.5 * record_length(band, _count(frequencies, band))
        )
        even = EvenOpening.all(plant, rest)[index]
        return cls(
            machine,
            pose,
            index,
            mode,
            linear,
            frequencies,
            band,
            duration,
            plant,
            preloaded,
            rest,
            even,
        )

    def of_machine(self, machine: Machine) -> Experiment:
        """The same experiment on a version of the machine that rests alike."""
        return replace(self, machine=machine, plant=Plant(machine))

    @property
    def cylinder(self) -> str:
        """Name of the cylinder that sweeps."""
        return self.machine.actuators[self.index].name

    @property
    def target(self) -> float:
        """Linear frequency of the mode at rest [Hz]."""
        return float(self.frequencies[self.mode])

    @property
    def creeps(self) -> bool:
        """Whether oil leaks away that no spool position makes up for: then there is no rest to sweep about."""
        held = self.plant.split(self.rest)[4]
        _, _, cap, annulus, _, _ = self.plant.split(
            self.plant.derivative(self.rest[None], held[None])[0]
        )
        fastest = float(np.abs(np.concatenate([cap, annulus])).max())
        return fastest * self.duration > CREEP * self.machine.supply.pressure

    @property
    def modes(self) -> int:
        """How many modes lie in the band."""
        return _count(self.frequencies, self.band)

    @property
    def rate(self) -> float:
        """Records per second: 16 per period of the fastest mode and of the band's end."""
        return 16 * float(max(self.band[1], self.frequencies.max()))

    def sweep(self, amplitude: float) -> Sweep:
        """The sweep of the valve's mean opening."""
        return Sweep(
            amplitude=amplitude, start=self.band[0], stop=self.band[1], duration=self.duration
        )

    def commands(
        self, excitation: Callable[[float], float]
    ) -> dict[str, Callable[[float], float]]:
        """What moves one valve's opening.

        Of the others, those that make up for a leakage hold their place.
        """
        trims = self.plant.split(self.rest)[4].tolist()
        centre = float(self.even.share(trims[self.index]))
        commands: dict[str, Callable[[float], float]] = {
            cylinder.name: Step(size=trim)
            for cylinder, trim in zip(self.machine.actuators, trims, strict=True)
            if trim != 0
        }
        return commands | {self.cylinder: Moved(self.even, centre, excitation)}

    def case(self, excitation: Callable[[float], float], duration: float | None = None) -> Case:
        """A run of the nonlinear model under an excitation of the opening, a slow loop holding the mean.

        Args:
            excitation: ``sweep``, or another function of time.
            duration: [s]; default: the sweep's.
        """
        return Case(
            machine=self.machine,
            q=self.pose,
            command=self.commands(excitation),
            duration=duration or self.duration,
            rate=self.rate,
            hold=HOLD_SHARE * self.band[0],
            preloaded=self.preloaded,
        )

    def fit(self, motion: Simulation) -> Fit:
        """The modes in the response of the piston's speed to the speed that the spool asks for, in a run.

        Raises:
            SimulationError: the spool opened nothing, or see ``fit_modes``.
        """
        asked = np.asarray(self.even.speed * self.even.share(motion.spool[:, self.index]))
        part = f"{self.machine.name}: sweep of {self.cylinder}"
        if not np.any(asked):
            problem = f"the spool stays within its overlap of {100 * self.even.valve.overlap:g} %"
            raise SimulationError(part, problem, "raise the amplitude, or give a faster spool")
        return fit_modes(
            motion.time, asked, motion.speeds[:, self.index], self.band, self.modes, part
        )

    def peak(self, motion: Simulation) -> float:
        """Where the spectrum of the piston's speed is highest near the mode in a run [Hz], between its lines, too."""
        near = (
            max(self.band[0], self.target / NEIGHBOUR),
            min(self.band[1], self.target * NEIGHBOUR),
        )
        speed, step = motion.speeds[:, self.index], float(motion.time[1])
        padded = np.concatenate([speed, np.zeros((FINER - 1) * len(speed))])
        return spectral_peak(
            step * np.arange(len(padded)), padded, near, f"{self.machine.name}: {self.cylinder}"
        )

    def default_amplitude(self) -> float:
        """Mean opening at which the linear response to the sweep is small in every respect."""
        joints, cap, annulus, pistons = self._swing(self.linear)
        _, _, caps, annuli, _, _ = self.plant.split(self.rest)
        room = np.concatenate(
            [self._pressure_room(caps), self._pressure_room(annuli), self._ends()]
        )
        used = np.concatenate([cap, annulus, pistons])
        largest = min(float(np.min(room / np.maximum(used, 1e-12))), LARGEST_OPENING)
        return largest * self._undetuned(largest * joints)

    def _swing(self, linear: LinearModel) -> tuple[Array, Array, Array, Array]:
        """Largest swings of joints, cap and annulus pressures [Pa] and pistons [m] in a sweep of opening 1, linear."""
        from scipy.signal import StateSpace, lsim

        plant, size = self.plant, len(linear.A) - 2 * self.plant.nc
        time = np.arange(0, self.duration, 1 / self.rate)
        outputs = np.vstack([np.eye(size), linear.C[:, :size]])
        column = self._opening_column()[:size, None]
        system = StateSpace(linear.A[:size, :size], column, outputs, np.zeros((len(outputs), 1)))
        opening = [self.sweep(1.0)(t) for t in time]
        swing = np.abs(lsim(system, opening, time)[1]).max(axis=0)
        edges = np.cumsum([plant.nq, plant.nq, plant.nc, plant.nc, int(plant.has_line)])
        joints, _, cap, annulus, _, pistons = np.split(swing, edges)
        return joints, cap, annulus, pistons

    def _opening_column(self) -> Array:
        """What a unit of mean opening adds to ẏ at rest (size,), SI: B of the arm, with the spool as it stands."""
        plant, column = self.plant, np.zeros(self.plant.size)
        for sign in (1.0, -1.0):
            state = self.rest.copy()
            plant.split(state)[4][self.index] = self.even.spool(sign)
            column += (
                sign / 2 * plant.derivative(state[None], np.zeros((1, plant.nc)))[0] * plant.units
            )
        return column

    def _pressure_room(self, pressures: Array) -> Array:
        """How far pressures (nc,) may swing [Pa]: half of the way to vapour, supply or relief, little with air."""
        ways = np.minimum(pressures - LOWEST_PRESSURE, self.machine.supply.pressure - pressures)
        ways = np.minimum(ways, self._relief_room(pressures))
        soft = [_softening(self.machine.fluid, p) for p in pressures.tolist()]
        return np.minimum(SHARE * np.maximum(ways, 0.1 * bar), soft)

    def _relief_room(self, pressures: Array) -> Array:
        """How far pressures (nc,) may rise [Pa] before a relief below the supply opens.

        Where the other chamber is at return pressure, its edges let in more than out, and both
        pressures climb from swing to swing.
        """
        supply, relief = self.machine.supply, self.plant.actuators["relief"][0]
        _, _, caps, annuli, _, _ = self.plant.split(self.rest)
        climbs = np.minimum(caps, annuli) < supply.return_pressure + BARELY
        room = (relief - pressures) / np.where(climbs, CYCLES, 1.0)
        return np.where(relief < supply.pressure, room, np.inf)

    def _ends(self) -> Array:
        """How far the pistons may swing (nc,) [m]; motors without end."""
        places = self.plant.evaluate(self.rest[None], np.zeros((1, self.plant.nc))).extensions[0]
        strokes = np.array([actuator.stroke for actuator in self.machine.actuators])
        return SHARE * np.where(np.isinf(strokes), np.inf, np.minimum(places, strokes - places))

    def _undetuned(self, swing: Array) -> float:
        """Share of a joint swing (nq,) that changes the mode's linear frequency by no more than ``DETUNING``.

        The joints swing as in the mode, so both ends of the swing lie along its shape.
        """
        here = natural_modes(self.machine.at(self.pose))
        shape, frequency = here.shapes[0, :, self.mode], here.frequencies[0, self.mode]
        way = shape * np.max(np.abs(swing) / np.abs(shape).max())
        share = 1.0
        for _ in range(20):
            ends = self.machine.rigid_poses(self.pose + share * np.array([way, -way]))
            change = 1.0
            if np.all(self.machine.margins(ends) > 0):
                found = natural_modes(self.machine.evaluate(ends)).frequencies[:, self.mode]
                change = float(np.abs(found / frequency - 1).max())
            if change <= DETUNING:
                break
            share *= max(0.9 * DETUNING / change, 0.2)
        return share


def _count(frequencies: Array, band: tuple[float, float]) -> int:
    return int(np.sum((frequencies >= band[0]) & (frequencies <= band[1])))


def _band(frequencies: Array, target: float) -> tuple[float, float]:
    """Band [Hz] about a mode, widened so that no neighbour sits on its edge."""
    low, high = BAND[0] * target, BAND[1] * target
    for other in np.sort(frequencies):
        if low / NEIGHBOUR < other < high * NEIGHBOUR:
            low, high = min(low, other / NEIGHBOUR), max(high, other * NEIGHBOUR)
    return float(low), float(high)


def _refuse_limits(plant: Plant, rest: Array) -> None:
    """Where nothing can oscillate freely: a load above supply pressure or at a relief, a piston on its stop."""
    _, _, caps, annuli, _, _ = plant.split(rest)
    places = plant.evaluate(rest[None], np.zeros((1, plant.nc))).extensions[0].tolist()
    supply = plant.machine.supply.pressure
    for cylinder, place, pressure in zip(
        plant.machine.actuators, places, np.maximum(caps, annuli), strict=True
    ):
        part, end = (
            f"{plant.machine.name}: {cylinder.name} {cylinder.kind}",
            min(place, cylinder.stroke - place),
        )
        leaks = (
            cylinder.valve is not None and cylinder.valve.leaks
        )  # then the flow makes the pressure, too
        stands = "rests at {:.{}f} bar" if leaks else "needs {:.{}f} bar to hold the load"
        if pressure >= supply:
            problem = f"{stands.format(pressure / bar, 0)}, supply is {supply / bar:.0f} bar"
            raise SimulationError(
                part, problem, "choose a lighter load, a larger cylinder or another pose"
            )
        if pressure > (relief := cylinder.relief(plant.machine.supply)) - BARELY:
            problem = (
                f"{stands.format(pressure / bar, 1)}, its relief opens at {relief / bar:.1f} bar"
            )
            raise SimulationError(
                part, problem, "raise relief_bar, or choose a lighter load or another pose"
            )
        if math.isfinite(cylinder.stroke) and end < LEAST_END * cylinder.stroke:
            raise SimulationError(
                part, f"is {end / mm:.2f} mm from its end stop", "choose a pose inside its stroke"
            )


def _softening(fluid: Fluid, pressure: float) -> float:
    """Change of a pressure [Pa] that changes the bulk modulus by ``SOFTENING``.

    Inf without air.
    """
    if fluid.air == 0:
        return math.inf
    step = 1e-3 * bar
    low, high = (
        math.log(bulk_modulus(pressure + h, fluid.bulk_modulus, fluid.air)) for h in (-step, step)
    )
    return SOFTENING * 2 * step / max(abs(high - low), 1e-15)
