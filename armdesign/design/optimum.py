"""The doors of the design: ``optimize`` and ``size_cylinders``, and the ``Design`` they answer with.

The optimum is found in real numbers, then rounded to what a drawing can say (0.1 mm), written to a machine file, read
back and judged by ``requirements.check``, which knows nothing of the optimiser.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from armdesign.arrays import Array
from armdesign.bands import Bands, FrequencyBand, frequency_band
from armdesign.design.bound import Bound, upper_bound
from armdesign.design.check import Check
from armdesign.design.codesign import Search, hertz
from armdesign.design.conflict import Conflict, sentence
from armdesign.design.problem import Problem
from armdesign.design.requirements import Requirements
from armdesign.design.rounding import rounded
from armdesign.design.settling import settled
from armdesign.design.variables import chosen
from armdesign.errors import ArmDesignError, InfeasibleError
from armdesign.machine import Machine
from armdesign.maps import FrequencyMap, frequency_map
from armdesign.units import WORKSHOP
from armdesign.workspace import Workspace

STARTS = 3
BAR_ROUNDS = 3  # times that the cylinders' own masses are moved with the pins
MISSED = 1e-5  # by which a search may miss a requirement
NEAR = 0.2  # of today's lowest ω²: starts that end this far below the best are left there
BINDING = 2e-3  # a requirement with less slack than this binds


@dataclass(frozen=True, eq=False, kw_only=True)
class Design:
    """A new machine, why it is allowed, and what it gains.

    Attributes:
        machine: the new machine, rounded and read back from its file.
        today: the machine it was made from.
        requirements: the limits it was made under.
        checks: every requirement judged on the new machine.
        worth: for each requirement, the relative gain in the worst frequency if it were relaxed by 1 %.
        unrounded: worst frequency of the optimum before rounding, on the workspace's poses, within the bands that it
            was made for [Hz].
        starts: worst frequency that each start of the search reached [Hz].
        workspace: today's workspace.
        problem: the problem that was solved.
        x: the optimum before rounding.
        watched: rows of the problem that the search kept an eye on.
    """

    machine: Machine
    today: Machine
    requirements: Requirements
    checks: tuple[Check, ...]
    worth: dict[str, float]
    unrounded: float
    starts: tuple[float, ...]
    workspace: Workspace
    problem: Problem
    x: Array
    watched: Array

    @cached_property
    def before(self) -> FrequencyMap:
        """Today's machine over its workspace."""
        return frequency_map(self.today, self.workspace)

    @cached_property
    def after(self) -> FrequencyMap:
        """The new machine over the same workspace."""
        return frequency_map(self.machine, self.workspace)

    @cached_property
    def in_own_workspace(self) -> FrequencyMap:
        """The new machine over its own workspace: end margins are shares of its own strokes."""
        counts = [len(axis) for axis in self.workspace.axes]
        own = Workspace.grid(self.machine, counts, end_margin=self.workspace.end_margin)
        return frequency_map(self.machine, own)

    @property
    def bands(self) -> Bands:
        """What is not known exactly: the bands it was made for; those of the machine's file if it was made for none."""
        return Bands.of(self.today) if self.problem.bands == Bands() else self.problem.bands

    @cached_property
    def band_before(self) -> FrequencyBand:
        """Today's worst frequency within the bands, on the workspace's poses."""
        return frequency_band(self.today, self.workspace, self.bands)

    @cached_property
    def band_after(self) -> FrequencyBand:
        """The new machine's worst frequency within the bands, on the same poses."""
        return frequency_band(self.machine, self.workspace, self.bands)

    def plot(self, plane: str = "joints") -> Any:
        """Maps before and after on one colour scale over two joints or over reach and height; returns the figure."""
        from armdesign import plots

        return plots.before_after(self, plane)

    @cached_property
    def certificate(self) -> Bound | None:
        """What no design of this kind can exceed, and what that assumes; where pins vary it takes seconds to find."""
        return upper_bound(self.problem.softened, self.x, self.watched)

    @property
    def bound(self) -> float | None:
        """Worst frequency that no design of this kind can exceed on the workspace's poses [Hz]; None: none is known."""
        return self.certificate.frequency if self.certificate else None

    @property
    def gap(self) -> float | None:
        """Share by which the bound exceeds the optimum before rounding; None where no bound is known."""
        return None if self.bound is None else self.bound / self.unrounded - 1

    @property
    def slacks(self) -> dict[str, float]:
        """Relative slack of every requirement, ≥ 0 where it is met."""
        return {c.name: c.slack for c in self.checks}

    @property
    def binding(self) -> list[Check]:
        """Requirements that bind and cost frequency, the dearest first."""
        held = [c for c in self.checks if c.slack < BINDING and self.worth.get(c.name, 0.0) > 1e-6]
        return sorted(held, key=lambda c: -self.worth[c.name])

    @property
    def sentences(self) -> list[str]:
        """What binds and what relaxing it by 1 % would buy, in plain words, the dearest first."""
        return [c.sentence(self.worth[c.name], WORKSHOP) for c in self.binding]


def optimize(
    machine: Machine,
    workspace: Workspace | None = None,
    requirements: Requirements | None = None,
    vary: Sequence[str] = ("areas", "pins"),
    *,
    starts: int = STARTS,
    seed: int = 0,
    workers: int = 1,
    start: Design | None = None,
    bands: Bands | None = None,
) -> Design:
    """Cylinder areas and pins that raise the lowest coupled frequency over the workspace and all load cases.

    Args:
        machine: today's machine.
        workspace: poses that count; default grid if None.
        requirements: limits; those of the machine's file if None.
        vary: words ("areas"; "pins"; "linkages": pins and all of the four-bars) and key paths of the machine file
            ("cylinder.boom.bore_mm", "cylinder.bucket.four_bar", "cylinder.stick.base.at_mm.0").
        starts: how many starts the search makes; the first is today's machine, the others are drawn in the pin box.
        seed: of the drawn starts. The same seed gives the same answer.
        workers: processes that share the starts. The answer does not hang on it; a process takes some seconds to set
            up, so that it pays from about ten starts, or three with four-bars.
        start: a design of the same machine under other limits, where the first start is then made.
        bands: what is not known exactly. The frequency that rises is then the worst within them; requirements are
            judged at the values of the file. None: all is exact, whatever bands the file states.

    Raises:
        ArmDesignError: a word or path of ``vary`` that names nothing that can vary; a start from another machine.
        InfeasibleError: no design meets the requirements.
    """
    chosen(machine, vary)
    workspace, requirements = _defaults(machine, workspace, requirements)
    problem = Problem(
        machine=machine, workspace=workspace, requirements=requirements, vary=tuple(vary), bands=bands or Bands()
    )
    if start is not None and _names(start.today) != _names(machine):
        raise ArmDesignError("start", f"is a design of {start.today.name}, not of {machine.name}", "give one of it")
    given = None if start is None else problem.like(start.x, start.problem)
    best, reached = _multistart(problem, starts if problem.moving else 1, seed, workers, given)
    return _design(best, reached)


def size_cylinders(
    machine: Machine,
    workspace: Workspace | None = None,
    requirements: Requirements | None = None,
    *,
    dead_volume: str = "fixed",
) -> Design:
    """Bore and rod of every cylinder for given pins, with an upper bound on what any sizes can reach.

    With ``dead_volume="proportional"`` (dead volumes grow with the areas) stiffness is linear in the areas: one
    semidefinite programme is the global optimum and ``bound`` its dual certificate (where buckling binds, which is
    reverse-convex, the bound may stay above the value). With "fixed" each step replaces
    the convex stiffness by its tangent, so frequencies rise from step to step; ``bound`` comes from its chord over all
    areas that are allowed.

    Raises:
        InfeasibleError: no sizes meet the requirements.
    """
    if dead_volume not in ("fixed", "proportional"):
        raise ArmDesignError("dead_volume", f'"{dead_volume}" is not allowed', 'give "fixed" or "proportional"')
    workspace, requirements = _defaults(machine, workspace, requirements)
    problem = Problem(
        machine=machine,
        workspace=workspace,
        requirements=requirements,
        vary=("areas",),
        proportional=dead_volume == "proportional",
    )
    search = Search(problem=problem, x=problem.start).run(trust=1.0, tolerance=1e-6)
    return _design(search, (hertz(search.squared),))


def _defaults(
    machine: Machine, workspace: Workspace | None, requirements: Requirements | None
) -> tuple[Workspace, Requirements]:
    requirements = requirements or Requirements.of(machine)
    requirements.refuse_unknown(machine)
    return workspace or Workspace.grid(machine, end_margin=requirements.end_margin), requirements


def _names(machine: Machine) -> tuple[str, ...]:
    """Joints and functions."""
    return (*machine.joints, *(function.name for function in machine.functions))


def _multistart(
    problem: Problem, starts: int, seed: int, workers: int, given: Array | None = None
) -> tuple[Search, tuple[float, ...]]:
    """The best of several starts, finished; and what each start reached [Hz].

    They are the one given, if any, today's machine and random pins.

    Every start is followed roughly; those that come near the best are finished.
    """
    random = np.random.default_rng(seed)
    moving = np.array([v.pin is not None for v in problem.variables])
    searches = [] if given is None else [Search(problem=problem, x=given)]
    for k in range(max(starts, 1) - len(searches)):
        x = problem.start.copy()
        x[moving] = random.uniform(-0.7, 0.7, moving.sum()) if k > 0 else 0.0
        x = np.clip(x, *problem.bounds)
        while not problem.closes(x):
            x[moving] *= 0.7
        searches.append(Search(problem=problem, x=x))
    _run(searches, workers, trust=0.2, tolerance=2e-3, looks=3)
    near = max(s.merit for s in searches) - NEAR
    _run([s for s in searches if s.merit >= near], workers, trust=0.05, tolerance=1e-5)
    best = max(searches, key=lambda s: (s.violation < 1e-3, s.merit))
    best.x = settled(problem, best.x)
    best.look()
    for _ in range(BAR_ROUNDS if problem.moves_masses else 0):
        # barrels, rods and four-bars weigh a little and follow the pins: take them along, and look again
        best.problem = replace(problem, bars_at=best.x)
        best.run(trust=0.02, tolerance=1e-5)
    return best, tuple(hertz(s.squared) for s in searches)


def _run(searches: list[Search], workers: int, **settings: Any) -> None:
    """Run searches of one problem: in this process with one programme, or in several that set up their own."""
    if workers <= 1 or len(searches) < 2:
        for search in searches:
            search.programme = searches[0].programme
            search.run(**settings)
        return
    from joblib import Parallel, delayed

    tasks = [delayed(_outcome)(s.problem, s.x, s.rows, s.holding, settings) for s in searches]
    for search, found in zip(searches, Parallel(workers)(tasks), strict=True):
        search.x, search.rows, search.holding = found
        search.look()


def _outcome(
    problem: Problem, x: Array, rows: Array, holding: Array, settings: dict[str, Any]
) -> tuple[Array, Array, Array]:
    """Where a search ends, and which rows it watches then: what crosses from one process to another."""
    search = Search(problem=problem, x=x, rows=rows, holding=holding).run(**settings)
    return search.x, search.rows, search.holding


def _design(search: Search, starts: tuple[float, ...]) -> Design:
    problem = search.problem
    if search.violation > MISSED:
        if error := _conflict_of(search):
            raise error
        search.run(trust=0.02, tolerance=1e-5)  # a design that meets them all was found: on from there
        if search.violation > MISSED:
            raise InfeasibleError(
                problem.machine.name, "no design was found that meets all requirements", "loosen them"
            )
    worth = search.worth()
    machine, checks = rounded(search)
    return Design(
        machine=machine,
        today=problem.machine,
        requirements=problem.requirements,
        checks=checks,
        worth=worth,
        unrounded=hertz(search.squared),
        starts=starts,
        workspace=problem.workspace,
        problem=problem,
        x=search.x,
        watched=search.rows,
    )


def _conflict_of(search: Search) -> InfeasibleError | None:
    """The error that says which requirements conflict; None where a design meets all: ``search`` then stands there."""
    conflict = Conflict(search.problem, search.x, search.holding)
    names = conflict.smallest()
    if not names:
        search.x = conflict.x
        return None
    given, settles = conflict.concessions(names)
    return InfeasibleError(search.problem.machine.name, sentence(given, settles), "loosen them", given)
