"""Sweeps of a validation: pose and mode, the result, and a remark on the cause of a deviation."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armdesign.arrays import Array, ReadOnly
from armdesign.errors import SimulationError
from armdesign.simulation.identification.modal_fit import ModalFit

AGREES = 0.005  # relative deviation
BALANCED = 1e-3  # relative error of a run's energy balance that its integration may leave
SHRINKS = 0.75  # largest deviation at half amplitude, over full, that counts as shrinking
SIGMAS = 3.0  # standard deviations of a fit within which it leaves a frequency open


@dataclass(frozen=True, eq=False, kw_only=True)
class SweptMode(ReadOnly):
    """Machine, pose and mode of one sweep; arrays are read-only.

    Attributes:
        pose: "worst", "median", "best", or the number of a given pose, from 1.
        payload: name of the load case.
        q: pose (nq,) [rad, m].
        cylinder: name of the one that moves.
        mode: number of the coupled mode, 1 is the lowest.
        linear_frequency: of that mode [Hz].
        frequency_at_rest: of that mode, of the plant linearised at its own equilibrium [Hz], see
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


@dataclass(frozen=True, eq=False, kw_only=True)
class FittedMode(SweptMode):
    """One sweep and its result; arrays are read-only.

    Attributes:
        fit: the response, measured and fitted.
        fitted_mode: index of this mode among the modes of the fit.
        on_resonance: measured response at the identified frequency and the lines beside it (2, m),
            [Hz] and magnitude; to draw. None (2, 0) with friction, which no picture shows.
        peak: where the plain spectrum of the speed is highest near the mode [Hz]. For comparison
            only: short sweeps (see ``sweep_bias``) and neighbouring modes bias it.
        mean: mean pose during the sweep (nq,).
        span: largest less smallest joint position during it (nq,).
        energy_error: of the run's energy balance, see ``Simulation.energy_error``.
        remark: likely cause of the deviation: "energy" if the run's energy balance does not close;
            "agrees" if it is small; "creep" if oil leaks away that no spool position makes up for;
            "leaks" if the deviation from ``frequency_at_rest`` is small, or alone lies within what
            the fit leaves open, or alone shrinks with the amplitude, and "damping" if nothing
            leaks then; "amplitude" if the deviation shrinks with the amplitude; else "fault"; "not
            repeated" if the other amplitude's run failed.
        with_friction: the same sweep of the machine with its dry friction, which no linear answer
            knows; None where it has none.
    """

    fit: ModalFit
    fitted_mode: int
    on_resonance: Array
    peak: float
    mean: Array
    span: Array
    energy_error: float
    remark: str = ""
    with_friction: FittedMode | Failure | None = None

    @property
    def identified_frequency(self) -> float:
        """Natural frequency of the fit [Hz]."""
        return float(self.fit.natural_frequencies[self.fitted_mode])

    @property
    def identified_damping(self) -> float:
        """Damping ratio of the fit."""
        return float(self.fit.damping_ratios[self.fitted_mode])

    @property
    def deviation(self) -> float:
        """Identified over linear natural frequency, less 1."""
        return self.identified_frequency / self.linear_frequency - 1

    def leaves_open(self, frequency: float) -> bool:
        """Whether the fit cannot tell a frequency [Hz] from its own."""
        deviation = float(self.fit.frequency_deviations[self.fitted_mode])
        return abs(self.identified_frequency - frequency) <= SIGMAS * deviation


@dataclass(frozen=True, eq=False, kw_only=True)
class Failure(SweptMode):
    """A sweep without a result, and why.

    A load cannot be held, the run gave up, or nothing oscillates. Frequency at rest, damping and
    amplitude are NaN where it did not come so far.
    """

    error: SimulationError


def with_remarks(
    group: Sequence[FittedMode | Failure], creeps: bool = False, leaks: bool = True
) -> list[FittedMode | Failure]:
    """Full and half amplitude with remarks on their deviations, of each that does not agree.

    Args:
        group: full and half amplitude without dry friction; then both with it, if there is any,
            which become ``with_friction``.
        creeps: oil leaks that no spool position makes up for.
        leaks: a valve leaks; else strong damping alone makes other frequencies at rest.
    """
    smooth, rough = group[:2], group[2:] or (None, None)
    balanced = all(one.energy_error <= BALANCED for one in group if isinstance(one, FittedMode))
    runs = [one for one in smooth if isinstance(one, FittedMode)]
    remark = _remark(runs, creeps, "leaks" if leaks else "damping")
    said = []
    for one, other in zip(smooth, rough, strict=True):
        if isinstance(one, FittedMode):
            own = "agrees" if abs(one.deviation) <= AGREES else remark
            words = own if balanced else "energy"
            one = dataclasses.replace(one, remark=words, with_friction=other)
        said.append(one)
    return said


def _remark(runs: Sequence[FittedMode], creeps: bool, at_rest_so: str) -> str:
    """Remark on runs at full and at half amplitude; or what makes other frequencies at rest."""
    linear = _trend([run.deviation for run in runs])
    at_rest = _trend([run.identified_frequency / run.frequency_at_rest - 1 for run in runs])
    if linear == "agrees":
        return linear
    if creeps:
        return "creep"
    if at_rest == "agrees" or all(
        run.leaves_open(run.frequency_at_rest) and not run.leaves_open(run.linear_frequency)
        for run in runs
    ):
        return at_rest_so
    return at_rest_so if linear == "fault" and at_rest == "amplitude" else linear


def _trend(deviations: Sequence[float]) -> str:
    """Kind of the deviations at full and at half amplitude."""
    if all(abs(deviation) <= AGREES for deviation in deviations):
        return "agrees"
    if len(deviations) < 2:
        return "not repeated"
    full, half = np.abs(deviations)
    return "amplitude" if half < SHRINKS * full else "fault"
