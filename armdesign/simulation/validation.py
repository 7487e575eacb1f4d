"""Is the linear answer so in the nonlinear model? A small slow sweep of one valve, the others shut: ``validate``.

The spool of one cylinder follows a sine whose frequency sweeps over the mode, while a slow loop holds the piston's mean
position. Natural frequency and damping are fitted to the response of the cylinder's speed to the speed that the spool
as it really stood asks for; so neither spool lag nor loop is in it, but the damping of the open valve is. It shows all
coupled modes that the cylinder takes part in. Every sweep is run at full and at half amplitude: what belongs to
amplitude shrinks with it, a fault of the model does not.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from armdesign.arrays import Array
from armdesign.cylinder import Fluid
from armdesign.errors import SimulationError
from armdesign.fluid import bulk_modulus
from armdesign.linearization import LinearModel, linearize
from armdesign.machine import Machine
from armdesign.modes import natural_modes
from armdesign.poses import Poses
from armdesign.simulation.excitation import EvenOpening, Sweep
from armdesign.simulation.identification import Fit, fit_modes, record_length
from armdesign.simulation.motion import simulate
from armdesign.simulation.plant import RELIEF_SHARE, Plant
from armdesign.units import bar, mm

if TYPE_CHECKING:
    import pandas as pd

BAND = (0.5, 1.6)  # of the sweep, relative to the mode
NEIGHBOUR = 1.25  # a mode this close to the band is taken into it, with as much room
CYCLES = 16.0  # of the mode in a sweep
HOLD_SHARE = 0.25  # corner of the slow loop, of the lowest frequency of the band
SWING_SHARE = 0.5  # of what pressures and strokes leave, used by the default amplitude
LOWEST_PRESSURE = -0.5 * bar  # gauge, above the vapour's
DETUNING = 0.02  # relative change of the linear frequency at the ends of the swing
SOFTENING = 0.008  # relative change of the bulk modulus that counts as all the room there is, with air
LARGEST_OPENING = 0.5
LEAST_END = 1e-3  # of the stroke
AGREES = 0.01  # relative deviation


@dataclass(frozen=True, eq=False)
class Run:
    """One sweep and what was found in it; arrays are read-only.

    Attributes:
        payload: name of the load case.
        q: pose (nq,) [rad, m].
        cylinder: name of the one that moves.
        mode: number of the coupled mode, 1 is the lowest.
        linear_frequency: of that mode [Hz].
        linear_damping: damping ratio of the linear plant with valves shut.
        amplitude: mean opening of the valve in the sweep.
        fit: the response, measured and fitted.
        found: which of the fit's modes it is.
        mean: mean pose during the sweep (nq,).
        span: largest less smallest joint position during it (nq,).
        remark: in a word, what to think of the deviation.
    """

    payload: str
    q: Array
    cylinder: str
    mode: int
    linear_frequency: float
    linear_damping: float
    amplitude: float
    fit: Fit
    found: int
    mean: Array
    span: Array
    remark: str = ""

    @property
    def identified_frequency(self) -> float:
        """Natural frequency of the fit [Hz]."""
        return float(self.fit.natural_frequencies[self.found])

    @property
    def identified_damping(self) -> float:
        """Damping ratio of the fit."""
        return float(self.fit.damping_ratios[self.found])

    @property
    def deviation(self) -> float:
        """Identified over linear natural frequency, less 1."""
        return self.identified_frequency / self.linear_frequency - 1


@dataclass(frozen=True, eq=False)
class Validation:
    """Sweeps of a machine: ``runs`` in the order of poses, payloads, cylinders, amplitudes (full, half)."""

    joints: tuple[str, ...]
    runs: tuple[Run, ...]

    @property
    def frame(self) -> pd.DataFrame:
        """One row per run, as in ``validation.csv``."""
        import pandas as pd

        rows = [
            {
                "payload": run.payload,
                **dict(zip(self.joints, run.q.tolist(), strict=True)),
                "cylinder": run.cylinder,
                "mode": run.mode,
                "linear_hz": run.linear_frequency,
                "identified_hz": run.identified_frequency,
                "deviation": run.deviation,
                "linear_damping": run.linear_damping,
                "identified_damping": run.identified_damping,
                "amplitude": run.amplitude,
            }
            for run in self.runs
        ]
        return pd.DataFrame(rows)

    @property
    def worst_deviation(self) -> float:
        """Largest deviation without its sign."""
        return max(abs(run.deviation) for run in self.runs)


def validate(
    machine: Machine,
    q: ArrayLike,
    *,
    payloads: Sequence[str] | None = None,
    cylinders: Sequence[str] | None = None,
    amplitude: float | None = None,
) -> Validation:
    """Natural frequencies measured in the nonlinear model against the linear ones.

    Args:
        machine: the machine; every cylinder needs a valve.
        q: pose (nq,) or poses (n, nq) [rad, m].
        payloads: names of load cases; default: the one at work.
        cylinders: names of the cylinders that sweep, each over the mode in which it takes its largest share;
            default: the one that takes the largest share of the lowest mode, over that mode.
        amplitude: mean opening of the valve, 0…1; each sweep is run with it and with half of it. Default: what makes
            a chamber's pressure swing by half of what separates it from a vacuum or the relief, by the linear model.

    Raises:
        PoseError: a pose cannot be taken.
        SimulationError: a valve is missing, a run gives up, or its response cannot be fitted.
    """
    if amplitude is not None and not 0 < amplitude <= 1:
        raise SimulationError(f"{machine.name}: amplitude", f"{amplitude:g} is not in (0, 1]", "give a valve opening")
    loaded = [machine] if payloads is None else [machine.with_payload(name) for name in payloads]
    runs: list[Run] = []
    for pose in np.atleast_2d(np.asarray(q, dtype=float)):
        for case in loaded:
            for index, mode in _choices(case, case.at(pose), cylinders):
                runs += _judged(_sweeps(case, pose, index, mode, amplitude), case, index)
    return Validation(machine.joints, tuple(runs))


def oil_shares(poses: Poses) -> Array:
    """Share of each cylinder in the oil-spring energy of each mode (n, nq modes, nc): k_i (r_i v)² over their sum."""
    motion = poses.moment_arms @ natural_modes(poses).shapes
    energy = poses.oil_stiffness[:, :, None] * motion**2
    return np.asarray(np.swapaxes(energy / energy.sum(axis=1, keepdims=True), 1, 2))


def _choices(machine: Machine, poses: Poses, cylinders: Sequence[str] | None) -> list[tuple[int, int]]:
    """Cylinder and mode (from 0) of each sweep."""
    shares, names = oil_shares(poses)[0], [cylinder.name for cylinder in machine.cylinders]
    if cylinders is None:
        return [(int(np.argmax(shares[0])), 0)]
    for name in cylinders:
        if name not in names:
            part = f"{machine.name}: cylinder {name}"
            raise SimulationError(part, "does not exist", f"choose from: {', '.join(names)}")
    return [(names.index(name), int(np.argmax(shares[:, names.index(name)]))) for name in cylinders]


@dataclass(frozen=True, eq=False)
class _Test:
    """What both sweeps of one cylinder have in common."""

    machine: Machine
    pose: Array
    index: int
    mode: int
    frequencies: Array  # of the linear modes (nq,) [Hz]
    band: tuple[float, float]
    duration: float
    even: EvenOpening
    trims: list[float]  # spool positions at rest (nc,)

    @property
    def cylinder(self) -> str:
        """Name of the cylinder that sweeps."""
        return self.machine.cylinders[self.index].name

    @property
    def modes(self) -> int:
        """How many modes lie in the band."""
        return int(np.sum((self.frequencies >= self.band[0]) & (self.frequencies <= self.band[1])))

    def sweep(self, amplitude: float) -> Sweep:
        """The sweep of the valve's opening."""
        return Sweep(amplitude=amplitude, start=self.band[0], stop=self.band[1], duration=self.duration)

    @property
    def rate(self) -> float:
        """Records per second: 16 per period of the fastest mode and of the band's end."""
        return 16 * float(max(self.band[1], self.frequencies.max()))


def _sweeps(machine: Machine, pose: Array, index: int, mode: int, amplitude: float | None) -> list[Run]:
    """The runs at full and half amplitude."""
    frequencies = natural_modes(machine.at(pose)).frequencies[0]
    if frequencies[mode] == 0:
        raise SimulationError(
            f"{machine.name}: mode {mode + 1}", "is unstable on its trapped oil", "choose another pose"
        )
    band = _band(frequencies, frequencies[mode])
    inside = int(np.sum((frequencies >= band[0]) & (frequencies <= band[1])))
    duration = max(CYCLES / frequencies[mode], 1.5 * record_length(band, inside))
    plant = Plant(machine)
    rest = plant.rest(pose)
    even, trims = EvenOpening.all(plant, rest)[index], plant.split(rest)[4].tolist()
    test = _Test(machine, pose, index, mode, frequencies, band, duration, even, trims)
    linear = linearize(machine, pose)
    full = amplitude or _default_amplitude(test, plant, rest, linear)
    return [_run(test, linear, size) for size in (full, full / 2)]


def _band(frequencies: Array, target: float) -> tuple[float, float]:
    """Band [Hz] about a mode, widened so that no neighbour sits on its edge."""
    low, high = BAND[0] * target, BAND[1] * target
    for other in np.sort(frequencies):
        if low / NEIGHBOUR < other < high * NEIGHBOUR:
            low, high = min(low, other / NEIGHBOUR), max(high, other * NEIGHBOUR)
    return float(low), float(high)


def _run(test: _Test, linear: LinearModel, amplitude: float) -> Run:
    target = float(test.frequencies[test.mode])
    motion = simulate(
        test.machine,
        test.pose,
        _commands(test, amplitude),
        duration=test.duration,
        rate=test.rate,
        hold=HOLD_SHARE * test.band[0],
    )
    wanted = test.even.speed * np.array([test.even.share(x) for x in motion.spool[:, test.index].tolist()])
    part = f"{test.machine.name}: sweep of {test.cylinder}"
    fit = fit_modes(motion.time, wanted, motion.speeds[:, test.index], test.band, test.modes, part)
    nearest = int(np.argmin(np.abs(linear.natural_frequencies - target))) if len(linear.modes) else -1
    return Run(
        payload=test.machine.payload.name,
        q=test.pose,
        cylinder=test.cylinder,
        mode=test.mode + 1,
        linear_frequency=target,
        linear_damping=float(linear.damping_ratios[nearest]) if nearest >= 0 else 1.0,
        amplitude=amplitude,
        fit=fit,
        found=int(np.argmin(np.abs(fit.natural_frequencies - target))),
        mean=motion.q.mean(axis=0),
        span=np.ptp(motion.q, axis=0),
    )


def _commands(test: _Test, amplitude: float) -> dict[str, Callable[[float], float]]:
    """The sweep of one valve; of the others, those that make up for a leakage hold their place."""
    sweep, trims = test.sweep(amplitude), test.trims
    centre = test.even.share(trims[test.index])
    commands: dict[str, Callable[[float], float]] = {
        cylinder.name: partial(_held, trim)
        for cylinder, trim in zip(test.machine.cylinders, trims, strict=True)
        if trim != 0
    }
    return commands | {test.cylinder: lambda time: test.even.spool(centre + sweep(time))}


def _held(trim: float, _: float) -> float:
    return trim


def _default_amplitude(test: _Test, plant: Plant, rest: Array, linear: LinearModel) -> float:
    """Opening at which the linear response stays within ``SWING_SHARE`` of what pressures and strokes leave.

    Raises:
        SimulationError: the piston stands on an end stop.
    """
    from scipy.signal import StateSpace, lsim

    size = len(linear.A) - 2 * plant.nc
    time = np.arange(0, test.duration, 1 / test.rate)
    outputs = np.vstack([np.eye(size), linear.C[:, :size]])
    column = _opening_column(test, plant, rest)[:size, None]
    system = StateSpace(linear.A[:size, :size], column, outputs, np.zeros((len(outputs), 1)))
    swing = np.abs(lsim(system, [test.sweep(1.0)(t) for t in time], time)[1]).max(axis=0)
    caps, annuli = plant.split(rest)[2:4]
    _, _, cap_swing, annulus_swing, _, _ = plant.split(
        np.concatenate([swing[:size], np.zeros(2 * plant.nc)]) / plant.units
    )
    places = np.array(plant.evaluate(rest.tolist(), [0.0] * plant.nc)[1])
    ends = np.minimum(places, [c.stroke for c in test.machine.cylinders] - places)
    for cylinder, end in zip(test.machine.cylinders, ends, strict=True):
        if end < LEAST_END * cylinder.stroke:
            part = f"{test.machine.name}: {cylinder.name} cylinder"
            raise SimulationError(
                part, f"stands {end / mm:.2f} mm from its end stop", "choose a pose inside its stroke"
            )
    pressures, limit = np.concatenate([caps, annuli]), RELIEF_SHARE * test.machine.supply.pressure
    softening = [_softening(test.machine.fluid, p) for p in pressures.tolist()]
    room = np.minimum(np.minimum(pressures - LOWEST_PRESSURE, limit - pressures), softening)
    room = np.concatenate([room, ends])
    used = np.concatenate([cap_swing, annulus_swing, swing[size:]])
    largest = float(min(SWING_SHARE * np.min(room / np.maximum(used, 1e-12)), LARGEST_OPENING))
    return largest * _undetuned(test, largest * swing[: plant.nq])


def _undetuned(test: _Test, swing: Array) -> float:
    """Share of a joint swing (nq,) that changes the mode's linear frequency by no more than ``DETUNING``.

    The joints swing as in the mode, so both ends of the swing lie along its shape.
    """
    shape = natural_modes(test.machine.at(test.pose)).shapes[0, :, test.mode]
    way = shape * np.max(np.abs(swing) / np.abs(shape).max())
    share = 1.0
    for _ in range(12):
        ends = test.machine.rigid_poses(test.pose + share * np.array([way, -way]))
        if np.all(test.machine.margins(ends) > 0):
            found = natural_modes(test.machine.evaluate(ends)).frequencies[:, test.mode]
            change = float(np.abs(found / test.frequencies[test.mode] - 1).max())
            if change <= DETUNING:
                break
            share *= max(0.9 * DETUNING / change, 0.2)
        else:
            share /= 2
    return share


def _softening(fluid: Fluid, pressure: float) -> float:
    """Change of a pressure [Pa] that changes the bulk modulus by ``SOFTENING``; inf without air."""
    if fluid.air == 0:
        return math.inf
    step = 1e-3 * bar
    moduli = [math.log(bulk_modulus(pressure + h, fluid.bulk_modulus, fluid.air)) for h in (-step, step)]
    return SOFTENING * 2 * step / (moduli[1] - moduli[0])


def _opening_column(test: _Test, plant: Plant, rest: Array) -> Array:
    """What a unit of mean opening adds to ẏ at rest (size,), SI: B of the arm with the spool as it stands."""
    column = np.zeros(plant.size)
    for sign in (1.0, -1.0):
        state = rest.copy()
        plant.split(state)[4][test.index] = test.even.spool(sign)
        column += sign / 2 * np.array(plant.derivative(state.tolist(), [0.0] * plant.nc)) * plant.units
    return column


def _judged(runs: list[Run], machine: Machine, index: int) -> list[Run]:
    """The runs with a remark on their deviation, which the half amplitude explains or does not."""
    full, half = (abs(run.deviation) for run in runs)
    dry = machine.cylinders[index].friction.coulomb > 0
    if full <= AGREES and half <= AGREES:
        remark = "agrees"
    elif half < 0.75 * full:
        remark = "amplitude"
    else:
        remark = "friction" if dry else "fault"
    return [dataclasses.replace(run, remark=remark) for run in runs]
