"""Is the linear answer so in the nonlinear model? A small slow sweep of one valve, the others shut: ``validate``.

The spool of one cylinder follows a sine whose frequency sweeps over the mode, while a slow loop holds the piston's mean
position. Natural frequency and damping are fitted to the response of the cylinder's speed to the speed that the spool
as it really stood asks for; so neither spool lag nor loop is in it, but the damping of the open valve is. It shows all
coupled modes that the cylinder takes part in. Every sweep is run at full and at half amplitude: what belongs to
amplitude shrinks with it, a fault of the model does not.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from armdesign.arrays import Array
from armdesign.errors import SimulationError
from armdesign.linearization import linearize
from armdesign.machine import Machine
from armdesign.modes import energy_shares, natural_modes
from armdesign.poses import Poses
from armdesign.simulation.experiment import Experiment
from armdesign.simulation.identification import Fit
from armdesign.simulation.motion import Simulation, simulate_all

if TYPE_CHECKING:
    import pandas as pd

AGREES = 0.01  # relative deviation
TOLERANCE = 1e-7  # of the integration


@dataclass(frozen=True, eq=False)
class Run:
    """One sweep and what was found in it; arrays are read-only.

    Attributes:
        payload: name of the load case.
        q: pose (nq,) [rad, m].
        cylinder: name of the one that moves.
        mode: number of the coupled mode, 1 is the lowest.
        linear_frequency: of that mode [Hz].
        linear_damping: damping ratio of the plant linearised at rest, see ``linearize``.
        amplitude: mean opening of the valve in the sweep.
        fit: the response, measured and fitted.
        found: which of the fit's modes it is.
        mean: mean pose during the sweep (nq,).
        span: largest less smallest joint position during it (nq,).
        remark: what to think of the deviation: "agrees"; "amplitude" if it shrinks with it; "friction" if it does not,
            but the cylinder has dry friction; else "fault".
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

    def __post_init__(self) -> None:
        for value in (self.q, self.mean, self.span):
            value.setflags(write=False)

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

    def plot(self) -> Any:
        """Measured and fitted frequency response of the first sweep; returns the figure."""
        from armdesign import plots

        return plots.frequency_responses({f"payload {self.runs[0].payload}": self})

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
        amplitude: mean opening of the valve, 0…1; each sweep is run with it and with half of it. Default: see
            ``Experiment.default_amplitude``.

    Raises:
        PoseError: a pose cannot be taken.
        SimulationError: a valve is missing, a run gives up, or its response cannot be fitted.
    """
    if amplitude is not None and not 0 < amplitude <= 1:
        raise SimulationError(f"{machine.name}: amplitude", f"{amplitude:g} is not in (0, 1]", "give a valve opening")
    loaded = [machine] if payloads is None else [machine.with_payload(name) for name in payloads]
    sweeps: list[_Sweep] = []
    for pose in machine.at(q).q:
        for case in loaded:
            for index, mode in _choices(case, case.at(pose), cylinders):
                sweeps += _sweeps(Experiment.of(case, pose, index, mode), amplitude)
    motions = simulate_all([sweep.experiment.case(sweep.amplitude) for sweep in sweeps], tolerance=TOLERANCE)
    runs = [_run(sweep, motion) for sweep, motion in zip(sweeps, motions, strict=True)]
    pairs = zip(sweeps[::2], runs[::2], runs[1::2], strict=True)
    return Validation(machine.joints, tuple(run for sweep, *pair in pairs for run in _judged(pair, sweep.experiment)))


def _choices(machine: Machine, poses: Poses, cylinders: Sequence[str] | None) -> list[tuple[int, int]]:
    """Cylinder and mode (from 0) of each sweep."""
    shares, names = energy_shares(poses, natural_modes(poses))[0], [function.name for function in machine.functions]
    if cylinders is None:
        return [(int(np.argmax(shares[0])), 0)]
    for name in cylinders:
        if name not in names:
            part = f"{machine.name}: cylinder {name}"
            raise SimulationError(part, "does not exist", f"choose from: {', '.join(names)}")
    return [(names.index(name), int(np.argmax(shares[:, names.index(name)]))) for name in cylinders]


@dataclass(frozen=True, eq=False)
class _Sweep:
    """One run to be: an experiment at an amplitude, and the damping ratio of its linear mode."""

    experiment: Experiment
    amplitude: float
    damping: float


def _sweeps(experiment: Experiment, amplitude: float | None) -> list[_Sweep]:
    """At full and half amplitude."""
    full = amplitude or experiment.default_amplitude()
    linear = linearize(experiment.machine, experiment.pose)
    nearest = np.argsort(np.abs(linear.natural_frequencies - experiment.target))[:1]
    damping = float(linear.damping_ratios[nearest[0]]) if len(nearest) else 1.0  # no pair left: overdamped
    return [_Sweep(experiment, size, damping) for size in (full, full / 2)]


def _run(sweep: _Sweep, motion: Simulation) -> Run:
    """What is found in a sweep's motion."""
    experiment = sweep.experiment
    fit = experiment.fit(motion)
    return Run(
        payload=experiment.machine.payload.name,
        q=np.array(experiment.pose),
        cylinder=experiment.cylinder,
        mode=experiment.mode + 1,
        linear_frequency=experiment.target,
        linear_damping=sweep.damping,
        amplitude=sweep.amplitude,
        fit=fit,
        found=int(np.argmin(np.abs(fit.natural_frequencies - experiment.target))),
        mean=motion.q.mean(axis=0),
        span=np.ptp(motion.q, axis=0),
    )


def _judged(runs: list[Run], experiment: Experiment) -> list[Run]:
    """The runs with a remark on their deviation, which the half amplitude explains or does not."""
    full, half = (abs(run.deviation) for run in runs)
    dry = experiment.machine.functions[experiment.index].friction.coulomb > 0
    if full <= AGREES and half <= AGREES:
        remark = "agrees"
    elif half < 0.75 * full:
        remark = "amplitude"
    else:
        remark = "friction" if dry else "fault"
    return [dataclasses.replace(run, remark=remark) for run in runs]
