"""The doors of the design: ``optimize`` and ``size_cylinders``, and the ``Design`` they answer with.

The optimum is found in real numbers, then rounded to what a drawing can say (0.1 mm), written to a machine file, read
back and judged by ``requirements.check``, which knows nothing of the optimiser.
"""

from __future__ import annotations

import itertools
import math
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from armdesign.arrays import Array
from armdesign.design.codesign import Search, hertz
from armdesign.design.problem import Problem
from armdesign.design.requirements import Check, Requirements, check, static_loads
from armdesign.errors import ArmDesignError, InfeasibleError
from armdesign.machine import Machine, load
from armdesign.maps import FrequencyMap, frequency_map
from armdesign.modes import lowest_frequency
from armdesign.units import litre, mm
from armdesign.workspace import Workspace

GRID = 0.1  # [mm] what a drawing can say
STARTS = 3
COMBINATIONS = 128  # of rounded bores and rods that are tried
BAR_ROUNDS = 3  # times that the cylinders' own masses are moved with the pins
TOLERANCE = 1e-9  # of a slack
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

    @cached_property
    def before(self) -> FrequencyMap:
        """Today's machine over its workspace."""
        return frequency_map(self.today, self.workspace)

    @cached_property
    def after(self) -> FrequencyMap:
        """The new machine over the same workspace."""
        return frequency_map(self.machine, self.workspace)

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
) -> Design:
    """Cylinder areas and pins that raise the lowest coupled frequency over the workspace and all load cases.

    Args:
        machine: today's machine.
        workspace: poses that count; default grid if None.
        requirements: limits; those of the machine's file if None.
        vary: "areas", "pins" or both.
        starts: how many starts the search makes; the first is today's machine, the others are drawn in the pin box.
        seed: of the drawn starts. The same seed gives the same answer.

    Raises:
        InfeasibleError: no design meets the requirements.
    """
    unknown = [word for word in vary if word not in ("areas", "pins")]
    if unknown or not vary:
        raise ArmDesignError("vary", f"{list(vary)} is not allowed", 'give "areas", "pins" or both')
    workspace, requirements = _defaults(machine, workspace, requirements)
    problem = Problem(machine=machine, workspace=workspace, requirements=requirements, vary=tuple(vary))
    best, reached = _multistart(problem, starts if any(v.pin for v in problem.variables) else 1, seed)
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
    best.run(trust=0.05, tolerance=1e-5)
    for _ in range(BAR_ROUNDS if problem.machine.has_bars and "pins" in problem.vary else 0):
        # barrels, rods and four-bars weigh a little and follow the pins: take them along, and look again
        best.problem = replace(problem, bars_at=best.x)
        best.run(trust=0.02, tolerance=1e-5)
    return best, tuple(hertz(s.squared) for s in searches)


def _design(search: Search, starts: tuple[float, ...]) -> Design:
    problem = search.problem
    if search.violation > 1e-5:
        raise InfeasibleError(problem.machine.name, f"no design meets {_missed(search)}", "loosen one of them")
    bound = search.upper_bound()
    worth = search.worth()
    machine, checks = _rounded(search)
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
    )


def _missed(search: Search) -> str:
    worst: dict[str, float] = {}
    for name, value in zip(search.limits.names, search.limits.values, strict=True):
        if value < -1e-5:
            worst[name] = max(worst.get(name, 0.0), -float(value))
    return " together with ".join(f"{name} (missed by {100 * value:.2g} %)" for name, value in worst.items())


# --------------------------------------------------------------------------------------------------------- rounding


def _rounded(search: Search) -> tuple[Machine, tuple[Check, ...]]:
    """The nearest machine that can be written and meets every requirement; today's if rounding leaves none better.

    Limits are drawn in a little, the optimum is moved inside, pins are rounded, strokes made to cover the joint ranges,
    and of the bores and rods around it the best that pass are taken; if none passes, the limits are drawn in more.
    """
    today, workspace, requirements = search.problem.machine, search.problem.workspace, search.problem.requirements
    failed: list[Check] = []
    for tightening in (2e-4, 5e-4, 1e-3, 2e-3, 5e-3):
        problem = search.problem.tightened(tightening)
        inner = Search(problem=problem, x=search.x, programme=search.programme)
        inner.rows, inner.holding = search.rows, search.holding
        inner.run(trust=0.02, tolerance=1e-4)
        for changes in _candidates(inner):
            machine = _through_file(today, changes)
            checks = check(machine, today, workspace, requirements)
            failed = [c for c in checks if c.slack < -TOLERANCE] or failed
            if min(c.slack for c in checks) >= -TOLERANCE:
                return _better(machine, checks, search)
    if not _hardly_gained(search):
        names = ", ".join(c.name for c in failed) or "all requirements"
        raise InfeasibleError(today.name, f"no sizes on the 0.1 mm grid meet {names}", "loosen them")
    return today, check(today, today, workspace, requirements)


def _better(machine: Machine, checks: tuple[Check, ...], search: Search) -> tuple[Machine, tuple[Check, ...]]:
    """The rounded machine; or today's, if what the search gained is less than what rounding cost."""
    today, workspace = search.problem.machine, search.problem.workspace
    if not _hardly_gained(search) or _worst(machine, workspace) > _worst(today, workspace):
        return machine, checks
    return today, check(today, today, workspace, search.problem.requirements)


def _hardly_gained(search: Search) -> bool:
    """Whether today's machine is allowed and the optimum less than 1 % above it, which rounding may eat up."""
    problem = search.problem
    if search.squared > 1.02 * problem.frequencies(problem.start).min():
        return False
    checks = check(problem.machine, problem.machine, problem.workspace, problem.requirements)
    return min(c.slack for c in checks) >= -TOLERANCE


def _worst(machine: Machine, workspace: Workspace) -> float:
    """Lowest coupled frequency over the workspace's poses and all load cases [Hz]."""
    cases = [machine.with_payload(payload.name) for payload in machine.payloads]
    held = [(case, workspace.rigid[case.holds(workspace.rigid)]) for case in cases]
    return min(float(lowest_frequency(case.evaluate(rigid)).min()) for case, rigid in held if len(rigid) > 0)


def _candidates(search: Search) -> Iterator[dict[str, Any]]:
    """Changes to the machine file for roundings of the bores and rods that pass a first check, best first."""
    problem = search.problem
    today = problem.machine
    changes = _pin_changes(problem, search.x)
    frame = today.replace(changes) if changes else today  # pins and strokes as they will be, sizes of today
    options, wanted = [], []
    for cylinder, (a1, a2) in zip(today.cylinders, problem.areas(search.x), strict=True):
        bore = 2 * math.sqrt(a1 / cylinder.count / math.pi) / mm
        rod = 2 * math.sqrt((a1 - a2) / cylinder.count / math.pi) / mm
        wanted += [bore, rod]
        options += [_neighbours(bore), _neighbours(rod)] if "areas" in problem.vary else [[bore], [rod]]
    choices = sorted(
        itertools.islice(itertools.product(*options), 20_000), key=lambda c: float(np.abs(np.subtract(c, wanted)).sum())
    )[:COMBINATIONS]
    low = search.rows[np.argsort(problem.frequencies(search.x, search.rows))[:100]]
    found = []
    for choice in choices:
        sizes = [(bore * mm, rod * mm) for bore, rod in zip(choice[::2], choice[1::2], strict=True)]
        cylinders = tuple(replace(c, bore=b, rod=r) for c, (b, r) in zip(frame.cylinders, sizes, strict=True))
        x = search.x.copy()
        areas = np.array([[c.bore_area, c.annulus_area] for c in cylinders])
        x[: areas.size] = (areas / problem.areas_today).ravel()
        found.append((float(problem.frequencies(x, low).min()), cylinders, choice, x))
    found.sort(key=lambda entry: -entry[0])
    light, limits = _light_workspace(search), replace(problem.requirements, pin_box=problem.box)
    loads = static_loads(frame, light) if len(frame.cylinders) == len(frame.joints) else None  # else they hang on areas
    passed = 0
    for _, cylinders, choice, x in found:
        trial = replace(frame, cylinders=cylinders)
        if min(c.slack for c in check(trial, today, light, limits, loads)) >= -TOLERANCE:
            yield changes | _size_changes(problem, choice, x)
            passed += 1
        if passed == 5:
            return


def _light_workspace(search: Search) -> Workspace:
    """The workspace with only the poses of the largest static forces: enough for a first check."""
    whole = search.problem.workspace
    q = whole.q[np.unique(search.problem.rows.pose[search.holding])]
    return Workspace(q, whole.axes, whole.end_margin, whole.machine)


def _neighbours(value: float) -> list[float]:
    """The grid values below and above [mm]."""
    low = math.floor(value / GRID + 1e-6) * GRID
    return [round(low, 1), round(low + GRID, 1)]


def _pin_changes(problem: Problem, x: Array) -> dict[str, Any]:
    """Rounded pins of the cylinders whose pins vary, with strokes and closed lengths that cover the joint ranges."""
    changes: dict[str, Any] = {}
    moved = {(v.cylinder, v.pin) for v in problem.variables if v.pin is not None}
    linkages = problem.linkages(x)
    today = problem.machine
    for i, pin in sorted(moved, key=str):
        place = getattr(linkages[i], pin)
        before = getattr(today.linkages[i], pin)
        limit = problem.box / mm
        at = [_within(a / mm, b / mm, limit) for a, b in zip(place.at, before.at, strict=True)]
        changes[f"cylinder.{today.cylinders[i].name}.{pin}.at_mm"] = at
        linkages[i] = linkages[i].with_pin(pin, (at[0] * mm, at[1] * mm, at[2] * mm))
    for i in sorted({i for i, _ in moved}):
        poses = problem.ranges[i]
        if poses is None:
            continue
        length = linkages[i].length(poses) / mm
        closed = math.floor(length.min() / GRID + 1e-9) * GRID
        stroke = math.ceil((length.max() - closed) / GRID - 1e-9) * GRID
        name = f"cylinder.{today.cylinders[i].name}"
        changes |= {f"{name}.closed_length_mm": round(closed, 1), f"{name}.stroke_mm": round(stroke, 1)}
    return changes


def _within(value: float, before: float, limit: float) -> float:
    """A pin coordinate on the grid and within the box [mm]; as it was where it did not move."""
    if abs(value - before) < 1e-9:
        return before
    low, high = math.ceil((before - limit) / GRID - 1e-6) * GRID, math.floor((before + limit) / GRID + 1e-6) * GRID
    return round(min(max(round(value / GRID) * GRID, low), high), 1)


def _size_changes(problem: Problem, choice: Sequence[float], x: Array) -> dict[str, Any]:
    changes: dict[str, Any] = {}
    if "areas" not in problem.vary:
        return changes
    for i, cylinder in enumerate(problem.machine.cylinders):
        name = f"cylinder.{cylinder.name}"
        changes |= {f"{name}.bore_mm": choice[2 * i], f"{name}.rod_mm": choice[2 * i + 1]}
        if problem.proportional:
            volumes = np.array([cylinder.cap_dead_volume, cylinder.annulus_dead_volume]) * x[2 * i : 2 * i + 2] / litre
            changes[f"{name}.dead_volume_l.cap"] = round(float(volumes[0]), 4)
            changes[f"{name}.dead_volume_l.annulus"] = round(float(volumes[1]), 4)
    return changes


def _through_file(machine: Machine, changes: dict[str, Any]) -> Machine:
    """The changed machine, saved and loaded again."""
    with tempfile.TemporaryDirectory() as folder:
        path = machine.replace(changes).save(Path(folder) / machine.source.name)
        return replace(load(path), source=machine.source).loaded_like(machine)
