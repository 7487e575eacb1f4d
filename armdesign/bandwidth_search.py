"""Search for the design of the largest least bandwidth of the loops.

Frequencies are what programmes of the design know. The bandwidth of the loops goes with the
frequency, but not alike at all poses: where a load is held or a valve is slow it is a smaller part
of it, which depends on areas and pins too. So frequencies count in proportion to that part, with
its slopes by the design vector; both are renewed at each new machine. Of all machines on the way
the one of the largest least bandwidth is the answer.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

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
from armdesign.design.optimize import AimedSearch, best_frequency
from armdesign.design.program.corners import Emphasis
from armdesign.design.program.problem import Problem
from armdesign.design.provenance import call
from armdesign.design.requirements.settings import Requirements
from armdesign.design.search.file_changes import diameters
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
