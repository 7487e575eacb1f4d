"""The doors of the design: ``optimize`` and ``size_cylinders``, and the ``Design`` they answer with.

The optimum is found in real numbers, then rounded to what a drawing can say (0.1 mm), written to a machine file, read
back and judged by ``requirements.check``, which knows nothing of the optimiser.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from armdesign.arrays import Array
from armdesign.design.catalogue import Sizes, relative_areas, sizes_of
from armdesign.design.choices import TOLERANCE
from armdesign.design.codesign import Search, hertz
from armdesign.design.problem import Problem
from armdesign.design.requirements import Check, Requirements
from armdesign.design.rounding import rounded
from armdesign.design.selection import Selection, select
from armdesign.design.sizing import StepProgramme
from armdesign.errors import ArmDesignError, InfeasibleError
from armdesign.machine import Machine
from armdesign.maps import FrequencyMap, frequency_map
from armdesign.workspace import Workspace

STARTS = 3
BAR_ROUNDS = 3  # times that the cylinders' own masses are moved with the pins
TURNS = 5  # of choosing sizes for pins and pins for sizes
NEAREST = 4  # sizes that are tried on a cylinder while the pins follow
ALLOWED = 1e-5  # by which a search may miss a requirement
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
        unrounded: worst frequency of the optimum before rounding, on the workspace's poses [Hz].
        bound: worst frequency that no design of this kind can exceed on the workspace's poses [Hz]; None where none is
            known.
        starts: worst frequency that each start of the search reached [Hz].
        workspace: today's workspace.
        catalogue: whether bores and rods are those of a catalogue.
    """

    machine: Machine
    today: Machine
    requirements: Requirements
    checks: tuple[Check, ...]
    worth: dict[str, float]
    unrounded: float
    bound: float | None
    starts: tuple[float, ...]
    workspace: Workspace
    catalogue: bool = False

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

    def plot(self, plane: str = "joints") -> Any:
        """Maps before and after on one colour scale over two joints or over reach and height; returns the figure."""
        from armdesign import plots

        return plots.before_after(self, plane)

    @property
    def slacks(self) -> dict[str, float]:
        """Relative slack of every requirement, ≥ 0 where it is met."""
        return {c.name: c.slack for c in self.checks}

    @property
    def binding(self) -> list[Check]:
        """Requirements that bind and cost frequency, the dearest first."""
        held = [c for c in self.checks if c.slack < BINDING and self.worth.get(c.name, 0.0) > 1e-6]
        return sorted(held, key=lambda c: -self.worth[c.name])


def optimize(
    machine: Machine,
    workspace: Workspace | None = None,
    requirements: Requirements | None = None,
    vary: Sequence[str] = ("areas", "pins"),
    *,
    starts: int = STARTS,
    seed: int = 0,
    catalogue: str | Iterable[Sequence[float]] | None = None,
) -> Design:
    """Cylinder areas and pins that raise the lowest coupled frequency over the workspace and all load cases.

    Args:
        machine: today's machine.
        workspace: poses that count; default grid if None.
        requirements: limits; those of the machine's file if None.
        vary: "areas", "pins" or both.
        starts: how many starts the search makes; the first is today's machine, the others are drawn in the pin box.
        seed: of the drawn starts. The same seed gives the same answer.
        catalogue: "iso", "5mm" or pairs of bore and rod [m] of which every cylinder has one; None: any size on the
            0.1 mm grid. From the best free sizes one cylinder after the other takes a size of the catalogue while the
            rest follows; then the best sizes for the pins and the best pins for the sizes are found in turn until
            neither changes. Proved is the choice of sizes for the final pins, not the pins.

    Raises:
        InfeasibleError: no design meets the requirements.
    """
    unknown = [word for word in vary if word not in ("areas", "pins")]
    if unknown or not vary:
        raise ArmDesignError("vary", f"{list(vary)} is not allowed", 'give "areas", "pins" or both')
    workspace, requirements = _defaults(machine, workspace, requirements)
    problem = Problem(machine=machine, workspace=workspace, requirements=requirements, vary=tuple(vary))
    if catalogue is not None:
        return _from_catalogue(problem, sizes_of(catalogue), starts, seed)
    best, reached = _multistart(problem, starts if any(v.pin for v in problem.variables) else 1, seed)
    return _design(best, reached)


def size_cylinders(
    machine: Machine,
    workspace: Workspace | None = None,
    requirements: Requirements | None = None,
    *,
    dead_volume: str = "fixed",
    catalogue: str | Iterable[Sequence[float]] | None = None,
) -> Design:
    """Bore and rod of every cylinder for given pins, with an upper bound on what any sizes can reach.

    With ``dead_volume="proportional"`` (dead volumes grow with the areas) stiffness is linear in the areas: one
    semidefinite programme is the global optimum and ``bound`` its dual certificate (where buckling binds, which is
    reverse-convex, the bound may stay above the value). With "fixed" each step replaces
    the convex stiffness by its tangent, so frequencies rise from step to step; ``bound`` comes from its chord over all
    areas that are allowed.

    With a ``catalogue`` ("iso", "5mm" or pairs of bore and rod [m]) every cylinder has one of its sizes, and the
    combination is the best of all; ``bound`` equals ``unrounded`` where that is proved, and lies above it by the gap
    that is left where the combinations are too many.

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
    if catalogue is not None:
        return _from_catalogue(problem, sizes_of(catalogue), 1, 0)
    search = Search(problem=problem, x=problem.start).run(trust=1.0, tolerance=1e-6)
    return _design(search, (hertz(search.squared),))


def _defaults(
    machine: Machine, workspace: Workspace | None, requirements: Requirements | None
) -> tuple[Workspace, Requirements]:
    requirements = requirements or Requirements.of(machine)
    unknown = [name for name in requirements.digging if name not in {c.name for c in machine.cylinders}]
    if unknown:
        raise ArmDesignError("requirements.digging", f'no cylinder "{unknown[0]}"', "name cylinders of the machine")
    return workspace or Workspace.grid(machine, end_margin=requirements.end_margin), requirements


def _multistart(problem: Problem, starts: int, seed: int) -> tuple[Search, tuple[float, ...]]:
    """The best of several starts, today's machine and random pins, finished; and what each start reached [Hz]."""
    random = np.random.default_rng(seed)
    searches = []
    programme = None
    for k in range(max(starts, 1)):
        x = problem.start.copy()
        if k > 0:
            pins = np.array([v.pin is not None for v in problem.variables])
            x[pins] = random.uniform(-0.7, 0.7, pins.sum())
        search = Search(problem=problem, x=x, programme=programme)
        searches.append(search.run(trust=0.2, tolerance=2e-3, looks=3))
        programme = search.programme
    best = max(searches, key=lambda s: (s.violation < 1e-3, s.merit))
    return _finished(best, trust=0.05), tuple(hertz(s.squared) for s in searches)


def _finished(search: Search, trust: float) -> Search:
    """The search run to its end."""
    search.run(trust=trust, tolerance=1e-5)
    for _ in range(BAR_ROUNDS if search.problem.machine.has_bars and "pins" in search.problem.vary else 0):
        # barrels, rods and four-bars weigh a little and follow the pins: take them along, and look again
        search.problem = replace(search.problem, bars_at=search.x)
        search.run(trust=0.02, tolerance=1e-5)
    return search


def _from_catalogue(problem: Problem, sizes: Sizes, starts: int, seed: int) -> Design:
    """The best sizes of a catalogue; with pins that vary, sizes and pins in turn."""
    if "areas" not in problem.vary:
        raise ArmDesignError("catalogue", "has no use where sizes stay as they are", 'add "areas" to what varies')
    if not any(v.pin for v in problem.variables):
        chosen = _selected(problem, problem.start, sizes)
        search = _sized(problem, problem.start, chosen.sizes).run(trust=0.02, looks=1)
        return _design(search, (chosen.frequency,), chosen)
    best, reached = _multistart(problem, starts, seed)
    found = [_finished(_settled(best, sizes), trust=0.05)]
    try:
        chosen = _selected(problem, problem.start, sizes)
        found.append(_finished(_sized(problem, problem.start, chosen.sizes), trust=0.1))
    except InfeasibleError:
        if found[0].violation > ALLOWED:
            raise
    return _design(_in_turn(max(found, key=_rank), sizes), reached)


def _settled(search: Search, sizes: Sizes) -> Search:
    """Sizes of the catalogue near those of a search, cylinder by cylinder, the largest first; the rest follows."""
    cylinders = search.problem.machine.cylinders
    for i in sorted(range(len(cylinders)), key=lambda i: -cylinders[i].bore_area * cylinders[i].stroke):
        areas = np.array([relative_areas(cylinders[i], *size) for size in sizes])
        nearest = np.argsort(np.abs(areas - search.x[2 * i : 2 * i + 2]).sum(axis=1), kind="stable")[:NEAREST]
        tried = []
        for size in (sizes[k] for k in nearest):
            chosen = list(search.problem.sizes or [None] * len(cylinders))
            chosen[i] = size
            tried.append(_sized(search.problem, search.x, tuple(chosen), search.programme))
            tried[-1].run(trust=0.1, tolerance=1e-3, looks=2)
        search = max(tried, key=_rank)
    return search


def _in_turn(search: Search, sizes: Sizes) -> Search:
    """Sizes chosen anew for the pins and pins tuned for these sizes, until neither changes."""
    for _ in range(TURNS):
        try:
            chosen = _selected(search.problem, search.x, sizes)
        except InfeasibleError:  # by less than the search lets pass
            break
        if chosen.sizes == search.problem.sizes:
            break
        other = _finished(_sized(search.problem, search.x, chosen.sizes), trust=0.1)
        if _rank(other) <= _rank(search):
            break
        search = other
    return search


def _rank(search: Search) -> tuple[bool, float]:
    return search.violation < ALLOWED, search.merit


def _selected(problem: Problem, x: Array, sizes: Sizes) -> Selection:
    """The best sizes for the pins of x."""
    moved = any(v.pin for v in problem.variables)
    given = (problem.machine, problem.workspace, problem.requirements, sizes, problem.proportional)
    return select(problem.placed(x), *given, tolerance=ALLOWED if moved else TOLERANCE)


def _sized(
    problem: Problem, x: Array, sizes: tuple[tuple[float, float] | None, ...], programme: StepProgramme | None = None
) -> Search:
    """A search from the pins of x with sizes that are chosen."""
    fixed = replace(problem, sizes=sizes)
    return Search(problem=fixed, x=np.clip(x, *fixed.bounds), programme=programme)


def _design(search: Search, starts: tuple[float, ...], chosen: Selection | None = None) -> Design:
    """The design of a finished search; of ``chosen`` sizes where nothing else varied."""
    problem = search.problem
    if search.violation > ALLOWED:
        raise InfeasibleError(problem.machine.name, f"no design meets {_conflict(search)}", "loosen one of them")
    bound = max(chosen.bound, hertz(search.squared)) if chosen else search.upper_bound()
    worth = {} if chosen else search.worth()
    machine, checks = rounded(search)
    return Design(
        machine=machine,
        today=problem.machine,
        requirements=problem.requirements,
        checks=checks,
        worth=worth,
        unrounded=hertz(search.squared),
        bound=bound,
        starts=starts,
        workspace=problem.workspace,
        catalogue=bool(problem.sizes),
    )


def _conflict(search: Search) -> str:
    worst: dict[str, float] = {}
    for name, value in zip(search.limits.names, search.limits.values, strict=True):
        if value < -ALLOWED:
            worst[name] = max(worst.get(name, 0.0), -float(value))
    return " together with ".join(f"{name} (missed by {100 * value:.2g} %)" for name, value in worst.items())
