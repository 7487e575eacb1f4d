"""Validation of natural frequencies by small slow sweeps of the nonlinear model: ``validate``.

The spool of one cylinder follows a sine whose frequency sweeps over the mode, while a slow loop
holds the piston's mean position. Natural frequency and damping are fitted to the response of the
cylinder's speed to the speed that the spool's actual position asks for; so neither spool lag nor
loop is in it, but the damping of the open valve is. It shows all coupled modes that the cylinder
takes part in. Every sweep is run at full and at half amplitude: what belongs to amplitude shrinks
with it, a fault of the model does not.

The linear frequency holds for the oil's spring alone, without dry friction, which damps a small
motion more than a large one, and at last holds a piston fast. So the sweeps leave dry friction
out. Where a machine has any, both are repeated with it, and those results stand beside. Overlaps
of spools are left out, too: see ``resting``.

The linear frequency takes the pressures that a closed valve leaves: the loaded chamber carries the
load, the other is at return pressure or at the preload that the machine file asks for. With air
the sweeps run about them; without air about a preload of their own, on which the frequency does
not depend: see ``experiment``. Behind a valve that leaks the flow makes others, and oil with air
has another stiffness under them; a large leak softens the spring as well. So the frequency of the
plant at its own equilibrium stands beside it. Where no spool position makes up for the leaks there
is none: the load creeps.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from armdesign.arguments import checked
from armdesign.arrays import Array
from armdesign.errors import SimulationError, choose, raise_together
from armdesign.frequency.maps import FrequencyMap, frequency_map
from armdesign.frequency.modes import energy_shares, natural_modes
from armdesign.frequency.workspace import Workspace
from armdesign.journal.finished import all_finished
from armdesign.machine.machine import Machine
from armdesign.machine.poses import Poses
from armdesign.processes import in_processes
from armdesign.progress import counted
from armdesign.short_repr import short_repr
from armdesign.simulation.experiment import Experiment
from armdesign.simulation.kept_sweeps import form
from armdesign.simulation.linearization import without_dry_friction
from armdesign.simulation.resting import LEAST_END, Resting
from armdesign.simulation.run import Simulation
from armdesign.simulation.simulate import SimulationCase, attempt_all
from armdesign.simulation.sweeps import Failure, FittedMode, SweptMode, with_remarks

if TYPE_CHECKING:
    import pandas as pd

    from armdesign.plots.canvas import Figure

TOLERANCE = 1e-7  # of the integration
SEEN = 1e-3  # share of a mode's energy that an actuator must have, for its sweep to show the mode


@dataclass(frozen=True, eq=False)
class Validation:
    """Sweeps of a machine.

    Attributes:
        joints: names of the coordinates.
        sweeps: all, in the order of poses, payloads, cylinders, amplitudes (full, half).
    """

    __repr__ = short_repr

    joints: tuple[str, ...]
    sweeps: tuple[FittedMode | Failure, ...]

    @property
    def headline(self) -> str:
        """How many sweeps could be fitted, and how far the farthest is from its linear answer."""
        most = max((abs(run.deviation) for run in self.runs), default=math.nan)
        fitted = f"{len(self.runs)} of {len(self.sweeps)} sweeps fitted"
        return f"over {', '.join(self.joints)}: {fitted}, largest deviation {100 * most:.2g} %"

    @property
    def runs(self) -> tuple[FittedMode, ...]:
        """Sweeps with a result."""
        return tuple(one for one in self.sweeps if isinstance(one, FittedMode))

    @property
    def failures(self) -> tuple[Failure, ...]:
        """Sweeps without one."""
        return tuple(one for one in self.sweeps if isinstance(one, Failure))

    @property
    def rows(self) -> list[dict[str, object]]:
        """One row per sweep, as in ``validation.csv``, without what a failure did not find."""
        return [self._row(one) for one in self.sweeps]

    @property
    def frame(self) -> pd.DataFrame:
        """The rows as a frame of pandas; what a failure did not find is empty."""
        import pandas as pd

        return pd.DataFrame(self.rows)

    def _row(self, sweep: FittedMode | Failure) -> dict[str, object]:
        """All columns in their order; of a failure only what a sweep is known by."""
        run, rough = (
            (sweep, sweep.with_friction) if isinstance(sweep, FittedMode) else (None, None)
        )
        dry = rough if isinstance(rough, FittedMode) else None
        remark = f"failed: {sweep.error}" if isinstance(sweep, Failure) else sweep.remark
        if isinstance(rough, Failure):
            remark += f"; with dry friction failed: {rough.error}"
        row: dict[str, object] = {
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
            "with_friction_hz": dry.identified_frequency if dry else math.nan,
            "with_friction_damping": dry.identified_damping if dry else math.nan,
            "remark": remark,
        }
        return row | (self._details(run) if run else {})

    def _details(self, run: FittedMode) -> dict[str, object]:
        """The columns that only a result has."""
        means, spans = (zip(self.joints, x.tolist(), strict=True) for x in (run.mean, run.span))
        return {
            "peak_hz": run.peak,
            "energy_error": run.energy_error,
            "identified_hz_sigma": float(run.fit.frequency_deviations[run.fitted_mode]),
            "identified_damping_sigma": float(run.fit.damping_deviations[run.fitted_mode]),
            **{f"{joint}_mean": mean for joint, mean in means},
            **{f"{joint}_span": span for joint, span in spans},
        }

    @property
    def by_pose(self) -> dict[str, Validation]:
        """The sweeps of every pose by its name."""
        names = dict.fromkeys(one.pose for one in self.sweeps)
        return {name: self._of(one for one in self.sweeps if one.pose == name) for name in names}

    @property
    def limiting(self) -> Validation:
        """The sweeps over the lowest mode that any sweeps over."""
        least = min(one.mode for one in self.sweeps)
        return self._of(one for one in self.sweeps if one.mode == least)

    def _of(self, sweeps: Iterable[FittedMode | Failure]) -> Validation:
        return Validation(self.joints, tuple(sweeps))

    def plot(self) -> Figure:
        """Figure of the measured and fitted frequency response of every pose's first sweep."""
        from armdesign import plots

        return plots.frequency_responses(self.by_pose)

    def _repr_html_(self) -> str:
        from armdesign.report import notebook

        return notebook.of_validation(self)

    @property
    def worst_deviation(self) -> float:
        """Largest deviation without its sign; inf where a run failed."""
        return math.inf if self.failures else max(abs(run.deviation) for run in self.runs)


@checked
def validate(
    machine: Machine,
    q: ArrayLike | None = None,
    *,
    payloads: Sequence[str] | None = None,
    cylinders: Sequence[str] | None = None,
    amplitude: float | None = None,
    workspace: Workspace | None = None,
    workers: int = 1,
) -> Validation:
    """Natural frequencies measured in the nonlinear model against the linear ones.

    The sweeps at a pose are one stacked run.

    Args:
        machine: the machine; every cylinder needs a valve.
        q: pose (nq,) or poses (n, nq) [rad, m]. Default: the worst, the median and the best pose
            over the workspace and the load cases, each under its load case.
        payloads: names of load cases; default: all where poses are chosen, else the one at work.
        cylinders: names of the cylinders and motors that sweep, each over the mode in which it
            takes its largest share. Default: all, the lowest mode's first; the one that takes the
            largest share of that mode sweeps over it, unless that is below 0.1 %: structure that
            yields swings there alone, and no sweep shows it.
        amplitude: mean opening of the valve, 0…1; each sweep is run with it and with half of it.
            Default: see ``Experiment.default_amplitude``.
        workspace: where poses are chosen; default: ``Workspace.grid(machine)``.
        workers: processes that share the poses. The answer does not depend on it.

    Raises:
        PoseError: a pose cannot be taken.
        SimulationError: a valve is missing, the load cannot be held, or no run at all can be made
            and fitted; those that can are worth having without the others, which are ``failures``.

    Example:
        >>> import armdesign as ad
        >>> machine = ad.load("paper_1dof")
        >>> validation = ad.validate(machine, [0.0])
        >>> print(validation.frame[["linear_hz", "identified_hz"]].round(1).to_string(index=False))
         linear_hz  identified_hz
              10.8           10.8
              10.8           10.8
    """
    if amplitude is not None and not 0 < amplitude <= 1:
        part = f"{machine.name}: amplitude"
        raise SimulationError(part, f"{amplitude:g} is not in (0, 1]", "give a valve opening")
    _refuse_empty(machine, q=q, payloads=payloads, cylinders=cylinders)
    if q is None:
        map_ = frequency_map(machine, workspace or Workspace.grid(machine))
        places = _extreme_places(map_, payloads)
    else:
        names = [machine.payload.name] if payloads is None else payloads
        loaded = [machine if payloads is None else machine.with_payload(name) for name in names]
        poses = enumerate(machine.at(q).q, 1)
        places = [NamedPose(str(number), case, pose) for number, pose in poses for case in loaded]
    validation = _validations([places], Wanted(cylinders, amplitude), workers)[0]
    if not validation.runs:
        raise_together([failure.error for failure in validation.failures])
    return validation


def validate_maps(maps: Sequence[FrequencyMap], workers: int = 1) -> list[Validation]:
    """Validation of several machines at once, at worst, median and best pose of each map.

    What cannot be run is a failure, even if that is all: so the other machines are not lost.
    """
    return _validations([_extreme_places(each, None) for each in maps], Wanted(), workers)


def _refuse_empty(machine: Machine, **arguments: object) -> None:
    for name, given in arguments.items():
        if given is not None and np.size(given) == 0:  # type: ignore[arg-type]
            remedy = "give some, or None for the default"
            raise SimulationError(f"{machine.name}: {name}", "is empty", remedy)


class NamedPose(NamedTuple):
    """A pose (nq,) [rad, m] by its name, and the machine under its load case."""

    name: str
    machine: Machine
    pose: Array


def _extreme_places(map_: FrequencyMap, payloads: Sequence[str] | None) -> list[NamedPose]:
    """The worst, the median and the best place of a map, the latter two with room for sweeps."""
    machine, names = map_.machine, list(map_.worst_of if payloads is None else payloads)
    cases = {name: machine.with_payload(name).payload.name for name in names}
    worst = min((map_.worst_of[cases[name]] for name in names), key=lambda w: w.frequency)
    rows = np.flatnonzero(np.isin(map_.columns["payload"], names))
    rows = rows[np.argsort(map_.lowest[rows], kind="stable")]
    roomy = rows[(machine.margins(map_.q[rows]) >= 2 * LEAST_END).all(axis=1)]
    rows = roomy if len(roomy) else rows
    places = [NamedPose("worst", machine.with_payload(worst.payload), worst.q)]
    for name, row in (("median", rows[len(rows) // 2]), ("best", rows[-1])):
        loaded = machine.with_payload(str(map_.columns["payload"][row]))
        places.append(NamedPose(name, loaded, map_.q[row]))
    return places


def _cylinders_and_modes(
    machine: Machine, poses: Poses, cylinders: Sequence[str] | None
) -> list[tuple[int, int]]:
    """Cylinder and mode (from 0) of each sweep."""
    names = [actuator.name for actuator in machine.actuators]
    shares = energy_shares(poses, natural_modes(poses))[0, :, : len(names)]
    modes = np.argmax(shares, axis=0)
    if cylinders is None:
        first = int(np.argmax(shares[0]))
        if shares[0, first] >= SEEN:
            modes[first] = 0
        order = sorted(range(len(names)), key=lambda index: (modes[index], index != first))
        return [(index, int(modes[index])) for index in order]
    for name in cylinders:
        if name not in names:
            part = f"{machine.name}: cylinder {name}"
            raise SimulationError(part, "does not exist", choose(name, names))
    return [(names.index(name), int(modes[names.index(name)])) for name in cylinders]


@dataclass(frozen=True, eq=False)
class PlannedSweep:
    """A sweep to be run, and the experiment that it is part of."""

    sweep: SweptMode
    experiment: Experiment
    drawn: bool  # whether a picture shows it

    @property
    def case(self) -> SimulationCase:
        """Its run."""
        return self.experiment.case(self.experiment.swept_sine(self.sweep.amplitude))

    def result(self, motion: Simulation | SimulationError) -> FittedMode | Failure:
        """Identified modes of the motion."""
        sweep = vars(self.sweep)
        if isinstance(motion, SimulationError):
            return Failure(**sweep, error=motion)
        try:
            fit, peak = self.experiment.fit(motion), self.experiment.peak(motion)
        except SimulationError as error:
            return Failure(**sweep, error=error)
        mode = int(np.argmin(np.abs(fit.natural_frequencies - self.experiment.target)))
        frequency, on_resonance = float(fit.natural_frequencies[mode]), np.zeros((2, 0))
        if self.drawn:
            on_resonance = self.experiment.on_resonance(motion, fit, frequency)
        return FittedMode(
            **sweep,
            fit=fit,
            fitted_mode=mode,
            on_resonance=on_resonance,
            peak=peak,
            mean=motion.q.mean(axis=0),
            span=np.ptp(motion.q, axis=0),
            energy_error=motion.energy_error,
        )


class Wanted(NamedTuple):
    """Cylinders and amplitude of the sweeps at every pose; None: all of them, chosen."""

    cylinders: Sequence[str] | None = None
    amplitude: float | None = None


def _plan(place: NamedPose, wanted: Wanted) -> list[list[PlannedSweep] | Failure]:
    """The sweeps of every cylinder at a place, or why there are none."""
    name, machine, pose = place
    poses = machine.at(pose)
    frequencies = natural_modes(poses).frequencies[0].tolist()
    pairs = _cylinders_and_modes(machine, poses, wanted.cylinders)
    sweeps = [
        SweptMode(
            pose=name,
            payload=machine.payload.name,
            q=poses.q[0].copy(),
            cylinder=machine.actuators[index].name,
            mode=mode + 1,
            linear_frequency=frequencies[mode],
            frequency_at_rest=math.nan,
            linear_damping=math.nan,
            amplitude=math.nan,
        )
        for index, mode in pairs
    ]
    try:
        versions = _versions(Resting.of(machine, pose))
    except SimulationError as error:
        return [Failure(**vars(sweep), error=error) for sweep in sweeps]
    same = versions[0].counterparts
    experiments = [[Experiment.on(rest, k, same[mode]) for rest in versions] for k, mode in pairs]
    of_cylinders = zip(sweeps, experiments, strict=True)
    return [_group(sweep, of_one, wanted.amplitude) for sweep, of_one in of_cylinders]


def _versions(rest: Resting) -> list[Resting]:
    """The machine at rest without dry friction, and with it where it has any."""
    frictions = [actuator.friction for actuator in rest.machine.actuators]
    if not any(friction.coulomb or friction.static for friction in frictions):
        return [rest]
    return [rest.of_machine(without_dry_friction(rest.machine)), rest]


def _group(
    sweep: SweptMode, versions: Sequence[Experiment], amplitude: float | None
) -> list[PlannedSweep]:
    """Full and half amplitude of every version of an experiment."""
    experiment, linear = versions[-1], versions[-1].rest.linear
    full = amplitude or experiment.default_amplitude()
    nearest = np.argsort(np.abs(linear.natural_frequencies - experiment.target))[:1]
    # Without a pair left it is overdamped.
    damping = float(linear.damping_ratios[nearest[0]]) if len(nearest) else 1.0
    sweep = dataclasses.replace(sweep, frequency_at_rest=experiment.target, linear_damping=damping)
    return [
        PlannedSweep(dataclasses.replace(sweep, amplitude=size), version, version is versions[0])
        for version in versions
        for size in (full, full / 2)
    ]


def _validations(
    machines: Sequence[list[NamedPose]], wanted: Wanted, workers: int
) -> list[Validation]:
    """The sweeps at the places of some machines, each place a piece of a journal that is open."""
    places = [place for of_one in machines for place in of_one]

    def identity(k: int) -> Any:
        name, machine, pose = places[k]
        return [machine.identity, name, pose.tolist(), wanted.cylinders, wanted.amplitude]

    def swept(missing: list[int]) -> Iterator[tuple[int, list[FittedMode | Failure]]]:
        tasks = [partial(_numbered, k, places[k], wanted) for k in missing]
        yield from counted(in_processes(tasks, workers), "pose", len(tasks))

    pieces = iter(all_finished("sweeps at a pose", len(places), identity, swept, form()))
    return [
        Validation(of_one[0].machine.joints, tuple(one for _ in of_one for one in next(pieces)))
        for of_one in machines
    ]


def _numbered(k: int, place: NamedPose, wanted: Wanted) -> tuple[int, list[FittedMode | Failure]]:
    """The sweeps at a place, with its number."""
    return k, _swept(place, wanted)


def _swept(place: NamedPose, wanted: Wanted) -> list[FittedMode | Failure]:
    """The sweeps at a place as one stacked run."""
    groups = _plan(place, wanted)
    cases = [planned.case for group in groups if isinstance(group, list) for planned in group]
    motions = iter(attempt_all(cases, tolerance=TOLERANCE))
    sweeps: list[FittedMode | Failure] = []
    for group in groups:
        if isinstance(group, Failure):
            sweeps.append(group)
        else:
            results = [planned.result(next(motions)) for planned in group]
            first = group[0].experiment
            sweeps += with_remarks(results, first.creeps, first.leaks)
    return sweeps
