"""Optimisation: the public door ``optimize``, whatever is to be made large.

Frequencies are what programmes of the design know. The bandwidth of the loops goes with the
frequency, but not alike at all poses: where a load is held or a valve is slow it is a smaller part
of it, which depends on areas and pins too. So frequencies count in proportion to that part, with
its slopes by the design vector; both are renewed at each new machine. Of all machines on the way
the one of the largest least bandwidth is the answer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Unpack

import numpy as np

from armdesign.arguments import checked, with_options
from armdesign.arrays import Array
from armdesign.control.least_bandwidth import (
    Places,
    bandwidths,
    least_bandwidth,
    narrowest,
    sample_of,
    spread,
)
from armdesign.design.design import Design
from armdesign.design.optimize import USUAL_SEARCH, AimedSearch, SearchOptions, best_frequency
from armdesign.design.program.corners import Emphasis
from armdesign.design.program.problem import Problem
from armdesign.design.provenance import call
from armdesign.design.requirements.settings import Requirements
from armdesign.design.search.file_changes import diameters
from armdesign.design.search.multistart import OBJECTIVES
from armdesign.errors import ArmDesignError, choose
from armdesign.frequency.bands import Bands
from armdesign.frequency.workspace import Workspace
from armdesign.machine.machine import Machine
from armdesign.units import mm

RENEWALS = 4  # of the emphasis
FEW = 30  # narrowest poses of each load case, at which slopes of the emphasis are found
RESERVE = 1.1  # times the ratio of the nearest pose, at poses where it is not known
LEAST_RATIO = 1e-3  # of the median: bandwidths over frequency below it count as this
MOVED, RESIZED = 5 * mm, 0.03  # steps of pins [m] and relative areas, by which it is differenced
RISEN = 2e-3  # share by which the bandwidth must rise for another


@checked
@with_options(SearchOptions, USUAL_SEARCH)
def optimize(
    machine: Machine,
    workspace: Workspace | None = None,
    requirements: Requirements | None = None,
    vary: Sequence[str] = ("areas", "pins"),
    *,
    start: Design | None = None,
    objective: str = "gain",
    damping: float | None = None,
    **options: Unpack[SearchOptions],
) -> Design:
    """Cylinder areas and pins that raise the worst frequency over workspace and load cases.

    Within bands of what is not known exactly the least gain over today's machine counts, so that
    no corner of them pays for another.

    Args:
        machine: today's machine.
        workspace: poses that count; default grid if None.
        requirements: limits; None: the machine's file states them.
        vary: words ("areas"; "pins"; "linkages": pins and all of the four-bars) and key paths of
            the machine file ("cylinder.boom.bore_mm", "cylinder.bucket.four_bar",
            "cylinder.stick.base.at_mm.0").
        starts: how many starts the search makes; the first is today's machine, the others are
            drawn in the pin box. None: 3, or 6 where four-bars move.
        seed: of the drawn starts. The same seed gives the same answer.
        workers: processes that share the starts. The answer does not depend on it; a process takes
            some seconds to set up, so that it pays from about ten starts, or three with four-bars.
        start: a design of the same machine under other limits, where the first start is then made.
        bands: what is not known exactly; the machine file's bands if None, ``Bands()`` for the
            file's values alone. Requirements are judged at the values of the file. Structure in
            series with a cylinder stays as it is [m/N], whatever the new cylinder.
        objective: what rises: within bands "gain", the least of f_new/f_today over their corners,
            or "worst", the worst frequency within them; or "bandwidth", the least bandwidth of the
            position loops with pressure feedback, by a local search without a ``bound`` that
            starts from the design of the highest worst frequency.
        catalogue: "iso", "5mm" or pairs of bore and rod [m] of which every cylinder has one; pins
            then lie on whole millimetres and strokes on 5 mm. None: as ``requirements.catalogue``
            of the machine's file says. "free", or where the file says nothing: any size, pin and
            stroke on the 0.1 mm grid. From the best free sizes one cylinder after the other
            takes a size of the catalogue while the rest follows; then the best sizes for the pins
            and the best pins for the sizes are found in turn, and one size after the other is
            chosen again, until nothing is better. ``bound`` is for sizes of the catalogue, with
            pins and strokes on no grid. A bore or rod that does not vary stays: then only pairs
            that have it are offered.
        damping: ratio of all modes in place of the file's damping, on which bandwidths rest.

    Raises:
        ArmDesignError: an objective that there is not; a word or path of ``vary`` that names
            nothing that can vary; a start from another machine; no catalogue, or one of no use.
        InfeasibleError: no design meets the requirements. Granted what it asks for, the same call
            gives one: that was tried.

    Example:
        >>> import armdesign as ad
        >>> machine = ad.load("paper_1dof")
        >>> workspace = ad.Workspace.grid(machine, points=3)
        >>> limits = ad.Requirements.of(machine, oil_total_share=1.05)
        >>> design = ad.optimize(machine, workspace, limits, vary=["areas"], starts=1)
        >>> print(f"{design.before.worst.frequency:.2f} to {design.after.worst.frequency:.2f} Hz")
        7.45 to 7.77 Hz
    """
    aimed = AimedSearch(vary=vary, objective=objective, start=start, options=options)
    if objective not in (names := [*OBJECTIVES, "bandwidth"]):
        fault = f"{objective!r} is not allowed"
        raise ArmDesignError("objective", fault, choose(str(objective), names))
    if objective != "bandwidth":
        if damping is not None:
            fault = f'means nothing where "{objective}" is to rise'
            raise ArmDesignError("damping", fault, 'leave it out, or give objective="bandwidth"')
        return best_frequency(machine, workspace, requirements, aimed)
    if options["bands"] not in (None, Bands()):
        fault = '"bandwidth" counts with the values of the file alone'
        raise ArmDesignError("objective", fault, "leave bands out, or give another objective")
    return best_bandwidth(machine, workspace, requirements, aimed, damping)


def only_sizes(vary: Sequence[str], objective: str, damping: float | None = None) -> bool:
    """Whether ``size_cylinders`` answers: sizes alone vary, for a frequency."""
    return tuple(vary) == ("areas",) and objective in OBJECTIVES and damping is None


def best_bandwidth(
    machine: Machine,
    workspace: Workspace | None,
    requirements: Requirements | None,
    aimed: AimedSearch,
    damping: float | None = None,
) -> Design:
    """The design of the largest least bandwidth that was found, with the values of the file.

    A local search, without a bound. It starts from the design of the highest worst frequency, so
    that it is never worse than this; today's machine may have more. Bandwidths are reached with
    gains common to all joints, at ``least_bandwidth.POSES`` poses of the workspace, where today's
    machine has one.

    Args:
        machine: today's machine; every actuator needs a valve.
        workspace: as in ``optimize``.
        requirements: as in ``optimize``.
        aimed: the search, of which bands and objective do not count.
        damping: as in ``bandwidth_map``.

    Raises:
        ArmDesignError: as ``optimize``; no valve, no damping, or no pose where a controller works.
        InfeasibleError: no design meets the requirements.
    """
    requirements = requirements or Requirements.of(machine)
    workspace = workspace or Workspace.grid(machine, end_margin=requirements.end_margin)
    look = _Bandwidths.of(machine, workspace, damping)
    within = (machine, workspace, requirements)
    aimed = replace(aimed, options={**aimed.options, "bands": Bands()})
    design = best_frequency(*within, replace(aimed, objective="worst"))
    best, reached = design, [least_bandwidth(look.today, look.today), look.least(design.machine)]
    for _ in range(RENEWALS):
        near = replace(
            aimed,
            start=design,
            objective=look.emphasis(design),
            options={**aimed.options, "starts": 1},
        )
        design = best_frequency(*within, near)
        risen = look.least(design.machine)
        if risen <= (1 + RISEN) * reached[-1]:
            break
        best, reached = design, [*reached[:2], risen]
    options = aimed.options
    command = call(
        "optimize", vary=tuple(aimed.vary), seed=options["seed"], starts=options["starts"],
        catalogue=options["catalogue"], objective="bandwidth", damping=damping,
    )  # fmt: skip
    return replace(
        best, machine=best.written_by(command), bandwidths=(reached[0], reached[1], reached[-1])
    )


@dataclass(frozen=True, eq=False)
class _Bandwidths:
    """Bandwidths of machines at the places of a workspace where today's machine has one."""

    workspace: Workspace
    sample: Workspace
    today: Places
    damping: float | None

    @classmethod
    def of(cls, machine: Machine, workspace: Workspace, damping: float | None) -> _Bandwidths:
        sample = sample_of(workspace)
        return cls(workspace, sample, bandwidths(machine, sample, damping)[0], damping)

    def least(self, machine: Machine) -> float:
        """The least of a machine [Hz]."""
        return least_bandwidth(bandwidths(machine, self.sample, self.damping)[0], self.today)

    def emphasis(self, design: Design) -> Emphasis:
        """By how much frequencies count towards bandwidth around a design."""
        problem, x = design.problem, design.x
        machine = _at(problem, x)
        widths, ratios = bandwidths(machine, self.sample, self.damping)
        few = narrowest(widths, self.today, FEW)
        about = {name: ratio[few] for name, ratio in ratios.items()}
        growth = self._growth(problem, x, few, about)
        known = np.concatenate([ratio[np.isfinite(ratio)] for ratio in ratios.values()])
        least, most = LEAST_RATIO * float(np.median(known)), float(known.max())
        return Emphasis(
            ratio={
                name: np.nan_to_num(np.maximum(ratio, least), nan=most)
                for name, ratio in spread(ratios, self.sample, self.workspace, RESERVE).items()
            },
            growth={
                name: np.nan_to_num(slope)
                for name, slope in spread(growth, self.sample, self.workspace).items()
            },
            about=x,
            judge=self.least,
        )

    def _growth(self, problem: Problem, x: Array, few: Array, about: Places) -> Places:
        """Slopes by x of the logarithm of bandwidth over frequency (n, nx); 0 but at a few.

        The smaller of the slopes to either side of what is known ``about`` x, as gains leap
        somewhere.
        """
        sample = self.sample.subset(few)
        growth = {name: np.zeros((len(each), len(x))) for name, each in self.today.items()}
        for k, v in enumerate(problem.vector.variables):
            if not v.free:
                continue
            step = MOVED / problem.vector.pin_box if v.pin is not None else RESIZED
            beside = []
            for sign in (1, -1):
                moved = x.copy()
                moved[k] += sign * step
                beside.append(bandwidths(_at(problem, moved), sample, self.damping)[1])
            for name, slopes in growth.items():
                with np.errstate(divide="ignore", invalid="ignore"):
                    after, before, here = np.log([at[name] for at in (*beside, about)])
                    sides = np.nan_to_num([after - here, here - before], posinf=0.0, neginf=0.0)
                gentler = np.abs(sides).argmin(axis=0)
                slopes[few, k] = np.take_along_axis(sides, gentler[None], axis=0)[0] / step
        return growth


def _at(problem: Problem, x: Array) -> Machine:
    """The machine of a design vector, in real numbers."""
    placed = problem.vector.with_pins(x)
    cylinders = [
        replace(cylinder, bore=bore * mm, rod=rod * mm)
        for i, cylinder in enumerate(placed.cylinders)
        for bore, rod in [diameters(problem, x, i)]
    ]
    return replace(placed, cylinders=tuple(cylinders))
