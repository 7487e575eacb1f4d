"""Search for the design of the largest least bandwidth of the loops.

Frequencies are what programmes of the design know. The bandwidth of the loops goes with the
frequency, but not alike at all poses: where a load is held or a valve is slow it is a smaller part
of it, which depends on areas and pins too. So frequencies count in proportion to that part, with
its slopes by the design vector, within a trust region about the machine at which both were found.
A machine with more bandwidth takes its place; else the region shrinks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

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
from armdesign.design.optimize import AimedSearch, SearchOptions, best_frequency
from armdesign.design.program.corners import Emphasis
from armdesign.design.program.problem import Problem
from armdesign.design.provenance import call
from armdesign.design.requirements.check import meets
from armdesign.design.requirements.settings import Requirements
from armdesign.design.search.file_changes import diameters
from armdesign.design.search.trust_region import Box, TrustRegion, ascend
from armdesign.frequency.bands import Bands
from armdesign.frequency.workspace import Workspace
from armdesign.machine.machine import Machine
from armdesign.units import mm

REGION = TrustRegion(radius=0.25, smallest=0.02, steps=8)  # relative areas, shares of pin boxes
FEW = 30  # narrowest poses of each load case, at which slopes of the emphasis are found
RESERVE = 1.1  # times the ratio of the nearest pose, at poses where it is not known
LEAST_RATIO = 1e-3  # of the median: bandwidths over frequency below it count as this
MOVED, RESIZED = 5 * mm, 0.03  # steps of pins [m] and relative areas, by which it is differenced
RISEN = 2e-3  # share by which the bandwidth is promised to rise, or the search ends


def best_bandwidth(
    machine: Machine,
    workspace: Workspace | None,
    requirements: Requirements | None,
    aimed: AimedSearch,
    damping: float | None = None,
) -> Design:
    """The design of the largest least bandwidth that was found, with the values of the file.

    A local search, without a bound, from the design of the highest worst frequency, so that it is
    never worse than this; or from today's machine, where that has more and meets the requirements.
    Bandwidths are reached with gains common to all joints, at ``least_bandwidth.POSES`` poses of
    the workspace, where today's machine has one.

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
    fastest = best_frequency(*within, replace(aimed, objective="worst"))
    highest = _Found.of(fastest, look)
    start, today = highest, least_bandwidth(look.today, look.today)
    if today > highest.merit and meets(machine, machine, workspace, requirements):
        start = _Found(look, highest.problem, highest.problem.vector.start, today)

    def step(found: _Found, box: Box, _: Sequence[_Found]) -> tuple[_Found, float] | None:
        once: SearchOptions = {**aimed.options, "starts": 1}
        near = replace(aimed, start=found.design, objective=found.emphasis(box), options=once)
        trial = best_frequency(*within, near)
        promised = trial.unrounded - found.merit
        return (_Found.of(trial, look), promised) if promised > RISEN * found.merit else None

    best = ascend(start, step, highest.problem.bounds, REGION)
    new, reached = (best.design, best.merit) if best.design else (fastest, highest.merit)
    options = aimed.options
    command = call(
        "optimize", vary=tuple(aimed.vary), seed=options["seed"], starts=options["starts"],
        catalogue=options["catalogue"], objective="bandwidth", damping=damping,
    )  # fmt: skip
    return replace(
        new, machine=new.written_by(command), bandwidths=(today, highest.merit, reached)
    )


@dataclass(frozen=True, eq=False)
class _Found:
    """A machine of the search.

    Attributes:
        look: what it is judged by.
        problem: in which it is the design vector.
        x: its design vector.
        merit: its least bandwidth [Hz].
        design: it, written; None of today's machine.
    """

    look: _Bandwidths
    problem: Problem
    x: Array
    merit: float
    design: Design | None = None

    @classmethod
    def of(cls, design: Design, look: _Bandwidths) -> _Found:
        return cls(look, design.problem, design.x, look.least(design.machine), design)

    @cached_property
    def _emphasis(self) -> Emphasis:
        return self.look.emphasis(self.problem, self.x)

    def emphasis(self, box: Box) -> Emphasis:
        """By how much frequencies count within a box; sizes that a catalogue has are all near."""
        low, high = box
        least, most = (
            np.where(high > low, self.x + end, sign * np.inf)
            for end, sign in ((low, -1), (high, 1))
        )
        return replace(self._emphasis, ends=(least, most))


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

    def emphasis(self, problem: Problem, x: Array) -> Emphasis:
        """By how much frequencies count towards bandwidth around a design."""
        widths, ratios = bandwidths(_at(problem, x), self.sample, self.damping)
        few = narrowest(widths, self.today, FEW)
        about = {name: ratio[few] for name, ratio in ratios.items()}
        growth = self._growth(problem, x, few, about)
        known = np.concatenate([ratio[np.isfinite(ratio)] for ratio in ratios.values()])
        least, most = LEAST_RATIO * float(np.median(known)), float(known.max())
        counting = {
            name: np.where(today > 0, np.fmax(ratios[name], least), most)
            for name, today in self.today.items()
        }
        return Emphasis(
            ratio=spread(counting, self.sample, self.workspace, RESERVE),
            growth={
                name: np.nan_to_num(slope)
                for name, slope in spread(growth, self.sample, self.workspace).items()
            },
            about=x,
            ends=(np.full(len(x), -np.inf), np.full(len(x), np.inf)),
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
