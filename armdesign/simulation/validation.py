"""Is the linear answer so in the nonlinear model? A small slow sweep of one valve, the others shut: ``validate``.

The spool of one cylinder follows a sine whose frequency sweeps over the mode, while a slow loop
holds the piston's mean position. Natural frequency and damping are fitted to the response of the
cylinder's speed to the speed that the spool as it really stood asks for; so neither spool lag nor
loop is in it, but the damping of the open valve is. It shows all coupled modes that the cylinder
takes part in. Every sweep is run at full and at half amplitude: what belongs to amplitude shrinks
with it, a fault of the model does not.

The linear answer is one of the oil's spring alone; it knows no dry friction, which damps a small
motion more than a large one, and at last holds a piston fast. So like is compared with like: the
sweeps leave dry friction out. Where a machine has any, both are repeated with it, and what it
makes of them is told beside.

The linear answer takes the pressures that a shut valve leaves: the loaded chamber carries the
load, the other is at return pressure or at the preload that the machine file asks for. With air
the sweeps run about them; without air about a preload of their own, on which the frequency does
not depend: see ``experiment``. Behind a valve that leaks the flow makes others, and oil with air
has another stiffness under them; a large leak softens the spring as well. So the frequency of the
plant at its own rest is told beside it. Where no spool position makes up for the leaks there is no
rest: the load creeps.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from armdesign.arrays import Array
from armdesign.errors import SimulationError, raise_together
from armdesign.frequency.maps import FrequencyMap, frequency_map
from armdesign.frequency.modes import energy_shares, natural_modes
from armdesign.frequency.workspace import Workspace
from armdesign.machine.machine import Machine
from armdesign.machine.poses import Poses
from armdesign.simulation.experiment import Experiment
from armdesign.simulation.identification.modal_fit import Fit
from armdesign.simulation.linearization import without_dry_friction
from armdesign.simulation.simulate import Case, Simulation, attempt_all

if TYPE_CHECKING:
    import pandas as pd

AGREES = 0.005  # relative deviation
BALANCED = 1e-3  # relative error of a run's energy balance that its integration may leave
TOLERANCE = 1e-7  # of the integration


@dataclass(frozen=True, eq=False, kw_only=True)
class Sweep:
    """What one sweep is of; arrays are read-only.

    Attributes:
        pose: "worst", "median", "best", or the number of a pose that was asked for, from 1.
        payload: name of the load case.
        q: pose (nq,) [rad, m].
        cylinder: name of the one that moves.
        mode: number of the coupled mode, 1 is the lowest.
        linear_frequency: of that mode [Hz].
        frequency_at_rest: the same of the plant linearised at its own rest [Hz], see
            ``linearize``. It differs where oil with air is under other pressures there than its
            static load alone makes: behind a valve that leaks.
        linear_damping: damping ratio there.
        amplitude: mean opening of the valve in the sweep.
    """

    pose: str
    payload: str
    q: Array
    cylinder: str
    mode: int
    linear_frequency: float
    frequency_at_rest: float
    linear_damping: float
    amplitude: float

    def __post_init__(self) -> None:
        for value in vars(self).values():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)


@dataclass(frozen=True, eq=False, kw_only=True)
class Run(Sweep):
    """One sweep and what was found in it; arrays are read-only.

    Attributes:
        fit: the response, measured and fitted.
        found: which of the fit's modes it is.
        peak: where the plain spectrum of the speed is highest near the mode [Hz]. It has the bias
            of short sweeps, see ``bias``, and that of the modes beside it: to be known, not to be
                used.
        mean: mean pose during the sweep (nq,).
        span: largest less smallest joint position during it (nq,).
        energy_error: of the run's energy balance, see ``Simulation.energy_error``.
        remark: what to think of the deviation: "energy" if the run's balance does not close;
            "agrees"; "creep" if oil leaks away that no spool position makes up for; "leaks" if
            that from ``frequency_at_rest`` is small, or shrinks with the amplitude while this does
            not; "amplitude" if this shrinks; else "fault"; "not repeated" if the other amplitude's
            run failed.
        with_friction: the same sweep of the machine with its dry friction, which no linear answer
            knows; None where it has none.
    """

    fit: Fit
    found: int
    peak: float
    mean: Array
    span: Array
    energy_error: float
    remark: str = ""
    with_friction: Run | Failure | None = None

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


@dataclass(frozen=True, eq=False, kw_only=True)
class Failure(Sweep):
    """A sweep that came to nothing, and why: a load that cannot be held, a run that gave up, nothing that oscillates.

    Frequency at rest, damping and amplitude are nan where it did not come so far.
    """

    error: SimulationError


@dataclass(frozen=True, eq=False)
class Validation:
    """Sweeps of a machine.

    Attributes:
        joints: names of the coordinates.
        sweeps: all, in the order of poses, payloads, cylinders, amplitudes (full, half).
    """

    joints: tuple[str, ...]
    sweeps: tuple[Run | Failure, ...]

    @property
    def runs(self) -> tuple[Run, ...]:
        """Those in which something was found."""
        return tuple(one for one in self.sweeps if isinstance(one, Run))

    @property
    def failures(self) -> tuple[Failure, ...]:
        """The others."""
        return tuple(one for one in self.sweeps if isinstance(one, Failure))

    @property
    def frame(self) -> pd.DataFrame:
        """One row per sweep, as in ``validation.csv``; what a failure did not find is empty."""
        import pandas as pd

        return pd.DataFrame([self._row(one) for one in self.sweeps])

    def _row(self, sweep: Run | Failure) -> dict[str, object]:
        """All columns in their order; of a failure only what a sweep is known by."""
        run, rough = (sweep, sweep.with_friction) if isinstance(sweep, Run) else (None, None)
        remark = f"failed: {sweep.error}" if isinstance(sweep, Failure) else sweep.remark
        if isinstance(rough, Failure):
            remark += f"; with dry friction failed: {rough.error}"
        found: dict[str, object] = {
            "payload": sweep.payload,
            **dict(zip(self.joints, sweep.q.tolist(), strict=True)),
            "cylinder": sweep.cylinder,
            "mode": sweep.mode,
            "linear_hz": sweep.linear_frequency,
            "identified_hz": run.identified_frequency if run else math.nan,
            "deviation": run.deviation if run else math.nan,
            "linear_damping": sweep.linear_damping,
            "identified_damping": run.identified_damping if run else math.nan,
            "amplitude": sweep.amplitude,
            "pose": sweep.pose,
            "at_rest_hz": sweep.frequency_at_rest,
            "with_friction_hz": rough.identified_frequency if isinstance(rough, Run) else math.nan,
            "with_friction_damping": (
                rough.identified_damping if isinstance(rough, Run) else math.nan
            ),
            "remark": remark,
        }
        if run:
            found |= {
                "peak_hz": run.peak,
                "energy_error": run.energy_error,
                "identified_hz_sigma": float(run.fit.frequency_deviations[run.found]),
                "identified_damping_sigma": float(run.fit.damping_deviations[run.found]),
                **{
                    f"{joint}_mean": mean
                    for joint, mean in zip(self.joints, run.mean.tolist(), strict=True)
                },
                **{
                    f"{joint}_span": span
                    for joint, span in zip(self.joints, run.span.tolist(), strict=True)
                },
            }
        return found

    @property
    def by_pose(self) -> dict[str, Validation]:
        """The sweeps of every pose by its name."""
        names = dict.fromkeys(one.pose for one in self.sweeps)
        return {name: self._of(one for one in self.sweeps if one.pose == name) for name in names}

    @property
    def limiting(self) -> Validation:
        """The sweeps over the lowest mode alone."""
        least = min(one.mode for one in self.sweeps)
        return self._of(one for one in self.sweeps if one.mode == least)

    def _of(self, sweeps: Iterable[Run | Failure]) -> Validation:
        return Validation(self.joints, tuple(sweeps))

    def plot(self) -> Any:
        """Measured and fitted frequency response of every pose's first sweep.

        Returns the figure.
        """
        from armdesign import plots

        return plots.frequency_responses(self.by_pose)

    @property
    def worst_deviation(self) -> float:
        """Largest deviation without its sign; inf where a run failed."""
        return math.inf if self.failures else max(abs(run.deviation) for run in self.runs)


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
        q: pose (nq,) or poses (n, nq) [rad, m]. Default: the worst, the median and the best pose
            over the workspace and the load cases, each under its load case.
        payloads: names of load cases; default: all where poses are chosen, else the one at work.
        cylinders: names of the cylinders and motors that sweep, each over the mode in which it
            takes its largest share. Default: all, the lowest mode's first; the one that takes the
            largest share of that mode sweeps over it.
        amplitude: mean opening of the valve, 0…1; each sweep is run with it and with half of it.
            Default: see ``Experiment.default_amplitude``.
        workspace: where poses are chosen; default: ``Workspace.grid(machine)``.

    Raises:
        PoseError: a pose cannot be taken.
        SimulationError: a valve is missing, the load cannot be held, or no run at all can be made
            and fitted; those that can are worth having without the others, which are ``failures``.
    """
    if amplitude is not None and not 0 < amplitude <= 1:
        raise SimulationError(
            f"{machine.name}: amplitude", f"{amplitude:g} is not in (0, 1]", "give a valve opening"
        )
    for what, given in (("q", q), ("payloads", payloads), ("cylinders", cylinders)):
        if given is not None and np.size(given) == 0:
            raise SimulationError(
                f"{machine.name}: {what}", "is empty", "give some, or None for the default"
            )
    if q is None:
        places = _chosen(frequency_map(machine, workspace or Workspace.grid(machine)), payloads)
    else:
        loaded = (
            [machine] if payloads is None else [machine.with_payload(name) for name in payloads]
        )
        places = [
            (str(number), case, pose)
            for number, pose in enumerate(machine.at(q).q, 1)
            for case in loaded
        ]
    found = _measured([_trials(places, cylinders, amplitude)])[0]
    if not found.runs:
        raise_together([failure.error for failure in found.failures])
    return found


def validate_maps(maps: Sequence[FrequencyMap]) -> list[Validation]:
    """``validate`` for several machines at once, at the worst, the median and the best pose of the map of each.

    What cannot be run is a failure, even if that is all: so the other machines are not lost.
    """
    return _measured([_trials(_chosen(found, None), None, None) for found in maps])


def _chosen(
    found: FrequencyMap, payloads: Sequence[str] | None
) -> list[tuple[str, Machine, Array]]:
    """Name, machine under its load case, and pose of the worst, the median and the best place of a map."""
    machine, names = found.machine, found.worst_of if payloads is None else payloads
    worst = min(
        (found.worst_of[machine.with_payload(name).payload.name] for name in names),
        key=lambda w: w.frequency,
    )
    frame = found.frame[found.frame["payload"].isin(list(names))].sort_values(
        "f1_hz", kind="stable"
    )
    chosen = [("worst", worst.payload, worst.q)]
    for label, row in (("median", frame.iloc[len(frame) // 2]), ("best", frame.iloc[-1])):
        chosen.append(
            (label, str(row["payload"]), row[list(machine.joints)].to_numpy(dtype=float))
        )
    return [(label, machine.with_payload(payload), pose) for label, payload, pose in chosen]


def _choices(
    machine: Machine, poses: Poses, cylinders: Sequence[str] | None
) -> list[tuple[int, int]]:
    """Cylinder and mode (from 0) of each sweep."""
    shares, names = (
        energy_shares(poses, natural_modes(poses))[0],
        [actuator.name for actuator in machine.actuators],
    )
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
class _Trial:
    """A sweep to be, and the experiment that it is part of."""

    sweep: Sweep
    experiment: Experiment

    @property
    def case(self) -> Case:
        return self.experiment.case(self.experiment.sweep(self.sweep.amplitude))

    def result(self, motion: Simulation | SimulationError) -> Run | Failure:
        """What is found in the motion."""
        told = vars(self.sweep)
        if isinstance(motion, SimulationError):
            return Failure(**told, error=motion)
        try:
            fit, peak = self.experiment.fit(motion), self.experiment.peak(motion)
        except SimulationError as error:
            return Failure(**told, error=error)
        found = int(np.argmin(np.abs(fit.natural_frequencies - self.experiment.target)))
        mean, span = motion.q.mean(axis=0), np.ptp(motion.q, axis=0)
        return Run(
            **told,
            fit=fit,
            found=found,
            peak=peak,
            mean=mean,
            span=span,
            energy_error=motion.energy_error,
        )


def _trials(
    places: Sequence[tuple[str, Machine, Array]],
    cylinders: Sequence[str] | None,
    amplitude: float | None,
) -> tuple[tuple[str, ...], list[list[_Trial] | Failure]]:
    """Names of the joints; all trials, one list per pose and cylinder, or why there are none."""
    groups: list[list[_Trial] | Failure] = []
    for label, case, pose in places:
        poses = case.at(pose)
        for index, mode in _choices(case, poses, cylinders):
            sweep = Sweep(
                pose=label,
                payload=case.payload.name,
                q=poses.q[0].copy(),
                cylinder=case.actuators[index].name,
                mode=mode + 1,
                linear_frequency=float(natural_modes(poses).frequencies[0, mode]),
                frequency_at_rest=math.nan,
                linear_damping=math.nan,
                amplitude=math.nan,
            )
            try:
                groups.append(_group(sweep, Experiment.of(case, pose, index, mode), amplitude))
            except SimulationError as error:
                groups.append(Failure(**vars(sweep), error=error))
    return places[0][1].joints, groups


def _group(sweep: Sweep, experiment: Experiment, amplitude: float | None) -> list[_Trial]:
    """Full and half amplitude without dry friction; where there is any, the same with it."""
    machine, full = experiment.machine, amplitude or experiment.default_amplitude()
    linear = experiment.linear
    nearest = np.argsort(np.abs(linear.natural_frequencies - experiment.target))[:1]
    damping = (
        float(linear.damping_ratios[nearest[0]]) if len(nearest) else 1.0
    )  # no pair left: overdamped
    sweep = dataclasses.replace(sweep, frequency_at_rest=experiment.target, linear_damping=damping)
    versions = [experiment]
    if any(
        actuator.friction.coulomb or actuator.friction.static for actuator in machine.actuators
    ):
        versions = [experiment.of_machine(without_dry_friction(machine)), experiment]
    sizes = full, full / 2
    return [
        _Trial(dataclasses.replace(sweep, amplitude=size), version)
        for version in versions
        for size in sizes
    ]


def _measured(
    machines: Sequence[tuple[tuple[str, ...], list[list[_Trial] | Failure]]],
) -> list[Validation]:
    """All trials as one stacked run."""
    trials = [
        trial
        for _, groups in machines
        for group in groups
        if isinstance(group, list)
        for trial in group
    ]
    motions = iter(attempt_all([trial.case for trial in trials], tolerance=TOLERANCE))
    found = []
    for joints, groups in machines:
        results: list[Run | Failure] = []
        for group in groups:
            if isinstance(group, Failure):
                results.append(group)
            else:
                results += _judged(
                    [trial.result(next(motions)) for trial in group], group[0].experiment.creeps
                )
        found.append(Validation(joints, tuple(results)))
    return found


def _judged(group: Sequence[Run | Failure], creeps: bool = False) -> list[Run | Failure]:
    """Full and half amplitude with remarks on the deviations.

    The same with dry friction, if any, put beside.
    """
    smooth, rough = group[:2], group[2:] or (None, None)
    balanced = all(one.energy_error <= BALANCED for one in group if isinstance(one, Run))
    remark = _verdict(smooth, creeps) if balanced else "energy"
    return [
        (
            dataclasses.replace(one, remark=remark, with_friction=other)
            if isinstance(one, Run)
            else one
        )
        for one, other in zip(smooth, rough, strict=True)
    ]


def _verdict(pair: Sequence[Run | Failure], creeps: bool) -> str:
    """Of a sweep at full and at half amplitude."""
    linear = _trend([one.deviation for one in pair if isinstance(one, Run)])
    at_rest = _trend(
        [
            one.identified_frequency / one.frequency_at_rest - 1
            for one in pair
            if isinstance(one, Run)
        ]
    )
    if linear == "agrees":
        return linear
    if creeps:
        return "creep"
    if at_rest == "agrees":
        return "leaks"
    return "leaks" if linear == "fault" and at_rest == "amplitude" else linear


def _trend(deviations: Sequence[float]) -> str:
    """Of deviations at full and at half amplitude."""
    if all(abs(deviation) <= AGREES for deviation in deviations):
        return "agrees"
    if len(deviations) < 2:
        return "not repeated"
    return "amplitude" if abs(deviations[1]) < 0.75 * abs(deviations[0]) else "fault"
