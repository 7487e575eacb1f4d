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
from armdesign.maps import frequency_map
from armdesign.modes import energy_shares, natural_modes
from armdesign.poses import Poses
from armdesign.simulation.experiment import Experiment
from armdesign.simulation.identification import Fit
from armdesign.simulation.motion import Simulation, simulate_all
from armdesign.workspace import Workspace

if TYPE_CHECKING:
    import pandas as pd

AGREES = 0.01  # relative deviation
TOLERANCE = 1e-7  # of the integration


@dataclass(frozen=True, eq=False)
class Run:
    """One sweep and what was found in it; arrays are read-only.

    Attributes:
        pose: "worst", "median", "best", or the number of a pose that was asked for, from 1.
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

    pose: str
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
                "pose": run.pose,
                "remark": run.remark,
                "identified_hz_sigma": float(run.fit.frequency_deviations[run.found]),
                "identified_damping_sigma": float(run.fit.damping_deviations[run.found]),
                **{f"{joint}_mean": mean for joint, mean in zip(self.joints, run.mean.tolist(), strict=True)},
                **{f"{joint}_span": span for joint, span in zip(self.joints, run.span.tolist(), strict=True)},
            }
            for run in self.runs
        ]
        return pd.DataFrame(rows)

    @property
    def by_pose(self) -> dict[str, Validation]:
        """The runs of every pose by its name."""
        names = dict.fromkeys(run.pose for run in self.runs)
        return {name: Validation(self.joints, tuple(run for run in self.runs if run.pose == name)) for name in names}

    def plot(self) -> Any:
        """Measured and fitted frequency response of every pose's first sweep; returns the figure."""
        from armdesign import plots

        return plots.frequency_responses(self.by_pose)

    @property
    def worst_deviation(self) -> float:
        """Largest deviation without its sign."""
        return max(abs(run.deviation) for run in self.runs)


def validate(
    machine: Machine,
    q: ArrayLike | None = None,
    *,
    payloads: Sequence[str] | None = None,
    cylinders: Sequence[str] | None = None,
    amplitude: float | None = None,
    workspace: Workspace | None = None,
) -> Validation:
    """Natural frequencies measured in the nonlinear model against the linear ones, all sweeps as one stacked run.

    Args:
        machine: the machine; every cylinder needs a valve.
        q: pose (nq,) or poses (n, nq) [rad, m]. Default: the worst, the median and the best pose over the workspace and
            the load cases, each under its load case.
        payloads: names of load cases; default: all where poses are chosen, else the one at work.
        cylinders: names of the cylinders and motors that sweep, each over the mode in which it takes its largest share.
            Default: all, the lowest mode's first; the one that takes the largest share of that mode sweeps over it.
        amplitude: mean opening of the valve, 0…1; each sweep is run with it and with half of it. Default: see
            ``Experiment.default_amplitude``.
        workspace: where poses are chosen; default: ``Workspace.grid(machine)``.

    Raises:
        PoseError: a pose cannot be taken.
        SimulationError: a valve is missing, a run gives up, or its response cannot be fitted.
    """
    if amplitude is not None and not 0 < amplitude <= 1:
        raise SimulationError(f"{machine.name}: amplitude", f"{amplitude:g} is not in (0, 1]", "give a valve opening")
    sweeps: list[_Sweep] = []
    for label, case, pose in _places(machine, q, payloads, workspace):
        for index, mode in _choices(case, case.at(pose), cylinders):
            sweeps += _sweeps(label, Experiment.of(case, pose, index, mode), amplitude)
    cases = [sweep.experiment.case(sweep.experiment.sweep(sweep.amplitude)) for sweep in sweeps]
    motions = simulate_all(cases, tolerance=TOLERANCE)
    runs = [_run(sweep, motion) for sweep, motion in zip(sweeps, motions, strict=True)]
    pairs = zip(sweeps[::2], runs[::2], runs[1::2], strict=True)
    return Validation(machine.joints, tuple(run for sweep, *pair in pairs for run in _judged(pair, sweep.experiment)))


def _places(
    machine: Machine, q: ArrayLike | None, payloads: Sequence[str] | None, workspace: Workspace | None
) -> list[tuple[str, Machine, Array]]:
    """Name, machine under its load case, and pose of every measurement."""
    if q is not None:
        loaded = [machine] if payloads is None else [machine.with_payload(name) for name in payloads]
        poses = machine.at(q).q
        return [(str(number), case, pose) for number, pose in enumerate(poses, 1) for case in loaded]
    found = frequency_map(machine, workspace or Workspace.grid(machine))
    names = found.worst_of if payloads is None else payloads
    worst = min((found.worst_of[machine.with_payload(name).payload.name] for name in names), key=lambda w: w.frequency)
    frame = found.frame[found.frame["payload"].isin(list(names))].sort_values("f1_hz", kind="stable")
    chosen = [("worst", worst.payload, worst.q)]
    for label, row in (("median", frame.iloc[len(frame) // 2]), ("best", frame.iloc[-1])):
        chosen.append((label, str(row["payload"]), row[list(machine.joints)].to_numpy(dtype=float)))
    return [(label, machine.with_payload(payload), pose) for label, payload, pose in chosen]


def _choices(machine: Machine, poses: Poses, cylinders: Sequence[str] | None) -> list[tuple[int, int]]:
    """Cylinder and mode (from 0) of each sweep."""
    shares, names = energy_shares(poses, natural_modes(poses))[0], [function.name for function in machine.functions]
    modes = np.argmax(shares, axis=0)
    if cylinders is None:
        first = int(np.argmax(shares[0]))
        modes[first] = 0
        order = sorted(range(len(names)), key=lambda index: (modes[index], index != first))
        return [(index, int(modes[index])) for index in order]
    for name in cylinders:
        if name not in names:
            part = f"{machine.name}: cylinder {name}"
            raise SimulationError(part, "does not exist", f"choose from: {', '.join(names)}")
    return [(names.index(name), int(modes[names.index(name)])) for name in cylinders]


@dataclass(frozen=True, eq=False)
class _Sweep:
    """One run to be: an experiment at a named pose and an amplitude, and the damping ratio of its linear mode."""

    pose: str
    experiment: Experiment
    amplitude: float
    damping: float


def _sweeps(pose: str, experiment: Experiment, amplitude: float | None) -> list[_Sweep]:
    """At full and half amplitude."""
    full = amplitude or experiment.default_amplitude()
    linear = linearize(experiment.machine, experiment.pose)
    nearest = np.argsort(np.abs(linear.natural_frequencies - experiment.target))[:1]
    damping = float(linear.damping_ratios[nearest[0]]) if len(nearest) else 1.0  # no pair left: overdamped
    return [_Sweep(pose, experiment, size, damping) for size in (full, full / 2)]


def _run(sweep: _Sweep, motion: Simulation) -> Run:
    """What is found in a sweep's motion."""
    experiment = sweep.experiment
    fit = experiment.fit(motion)
    return Run(
        pose=sweep.pose,
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
