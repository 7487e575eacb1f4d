"""Rounding: from the optimum in real numbers to a machine file that a drawing office can use.

Pins, bores, rods, strokes and closed lengths go to the 0.1 mm grid; the machine's file is written,
read again, and the machine that it says judged by ``check``, which knows nothing of the optimiser.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np

from armdesign.arrays import Array
from armdesign.design.catalogue.sizes import FINE, size_in_mm
from armdesign.design.program.moving_masses import weighed
from armdesign.design.program.problem import Problem
from armdesign.design.requirements.check import check, meets, static_loads
from armdesign.design.requirements.record import Check
from armdesign.design.requirements.settings import Requirements
from armdesign.design.search.file_changes import changes_of, diameters, neighbours, pin_changes
from armdesign.design.search.infeasibility.elastic_programme import STARTS, ElasticProgramme, Roles
from armdesign.design.search.lattice import on_lattice
from armdesign.design.search.sequential_sdp import Search
from armdesign.frequency.workspace import Workspace
from armdesign.hydraulics.actuator import Cylinder, areas_of
from armdesign.machine.machine import Machine
from armdesign.units import mm

COMBINATIONS = 128  # rounded combinations of bores and rods that are tried
ENUMERATED = 20_000  # combinations that are listed, of which the nearest are tried
CHECKED = 5  # best combinations after a first check that are judged on the whole workspace
LOWEST = 100  # rows on which they are compared
RETUNED_SIZES = 3  # sizes whose pins are tuned in earnest,
RETUNED = 4  # times each, with more in reserve each time
TIGHTENING = 1e-4  # share by which limits are drawn in for that
TIGHTENINGS = (2e-4, 5e-4, 1e-3, 2e-3, 5e-3)  # shares where pins follow only by their own rounding
DEPTH = 2e-3  # share of its limit by which a machine keeps inside where rounding is hard
TRUST, PROMISED = 0.02, 1e-5  # of searches near the optimum
TOLERANCE = 1e-9  # of a slack

SizesInRow: TypeAlias = tuple[float, ...]  # bore and rod of every cylinder [mm]


@dataclass(frozen=True, eq=False)
class CheckedMachine:
    """A machine read from its file, and every requirement of a problem judged on it."""

    machine: Machine
    checks: tuple[Check, ...]
    problem: Problem

    @classmethod
    def of(cls, machine: Machine, problem: Problem) -> CheckedMachine:
        """Judged on the whole workspace of a problem."""
        within = problem.machine, problem.workspace, problem.requirements
        return cls(machine, check(machine, *within), problem)

    @cached_property
    def judged(self) -> float:
        """The objective of the machine [Hz], see ``corners``."""
        return self.problem.dynamics.corners.judged(self.machine)

    @property
    def allowed(self) -> bool:
        """Whether it meets every requirement."""
        return not any(c.slack < -TOLERANCE for c in self.checks)


def rounded_machine(search: Search) -> CheckedMachine | None:
    """The best machine near the optimum that can be written and meets every requirement.

    Today's if none is better, None where all fails. Where pins vary, bores and rods, the coarser
    ones, are rounded first and the pins follow, see ``_tuned``. Where that fails, or no pin
    varies, limits are drawn in a little, the optimum is moved inside, pins are rounded, strokes
    made to cover the joint ranges, and of the bores and rods around it the best that pass are
    taken; if none passes, the limits are drawn in more. At last frequency is left aside, see
    ``inmost_machine``.
    """
    best = best_allowed(_tuned(search)) or _near_sizes(search) or inmost_machine(search)
    return or_today(best, search.problem) if _hardly_gained(search) else best


def best_allowed(machines: Iterable[CheckedMachine | None]) -> CheckedMachine | None:
    """The best of the machines that meet every requirement, of equals the first; None of none."""
    allowed = [one for one in machines if one and one.allowed]
    # of one alone nothing need be known
    return (
        max(allowed, key=lambda one: one.judged) if len(allowed) > 1 else next(iter(allowed), None)
    )


def or_today(best: CheckedMachine | None, problem: Problem) -> CheckedMachine | None:
    """Today's machine if it is allowed and the best one is no better, or there is none."""
    today = CheckedMachine.of(problem.machine, problem)
    if today.allowed and (best is None or best.judged <= today.judged):
        return today
    return best


def inmost_machine(search: Search, any_will_do: bool = False) -> CheckedMachine | None:
    """A machine near a search as far inside all limits as can be, sizes on the grid.

    None if it misses one even so. Its lengths are the best for frequency nearby, or the first
    that do if ``any_will_do``; the search alone is then started from.
    """
    problem = search.problem
    tightened = problem.tightened(TIGHTENING if problem.vector.moving else 0.0)
    elastic = ElasticProgramme(tightened, search.x, search.holding, DEPTH)
    roles = Roles((elastic.names,), ())
    fine = problem.grid == FINE or not problem.vector.moving
    solution = elastic.solve(roles, starts=1 if any_will_do and not fine else STARTS)
    if ElasticProgramme(problem, solution.x, elastic.holding).violated(solution.x):
        return None
    if fine:
        drawn = search.of(problem, elastic.on_grid(solution, roles).x)
    else:
        drawn = on_lattice(search.of(tightened, solution.x).look(), any_will_do)
    sizes = _options(search)[1] if problem.sizes else _on_grid(problem, drawn.x)
    machine = CheckedMachine.of(_machine(drawn, sizes), problem)
    return machine if machine.allowed else None


def nearest_misses(search: Search) -> list[Check]:
    """The requirements missed by the combination of sizes on the grid that misses least."""
    problem = search.problem
    placed, loads = _placed(search, problem.workspace)
    limits = _with_box(problem)
    missed = []
    for sizes in _nearest_sizes(search, COMBINATIONS):
        machine = _sized(problem, placed, sizes)
        checks = check(machine, problem.machine, problem.workspace, limits, loads)
        missed.append([c for c in checks if c.slack < -TOLERANCE])
    return min(missed, key=lambda some: (max((-c.slack for c in some), default=0.0), len(some)))


def _hardly_gained(search: Search) -> bool:
    """Whether the optimum is less than 1 % above today's machine: rounding may cost more.

    Not where sizes are of a catalogue, in which today's machine need not be.
    """
    problem = search.problem
    gained = search.squared > 1.02 * problem.dynamics.omega_squared_today
    return not (problem.sizes or gained)


# ----------------------------------------------------------------- sizes first, then pins for them


def _tuned(search: Search) -> Iterator[CheckedMachine]:
    """Machines with bores and rods on the grid and pins tuned for them, most promising first.

    Rounding the sizes costs almost nothing if the pins may follow. If pins and strokes on the grid
    then miss a limit, that amount is kept in reserve and the pins are tuned once more.
    """
    problem = search.problem
    if not problem.vector.moving:
        return
    today, light, limits = problem.machine, _light_workspace(search), _with_box(problem)
    inside = problem.tightened(TIGHTENING if problem.grid == FINE else 0.0)
    inner = search.of(inside, search.x).refine(TRUST, PROMISED)
    for sizes, x, within in _promising(inner):
        reserve: dict[str, float] = {}
        for _ in range(RETUNED):
            near = search.of(inside.with_reserve(reserve), x, within).refine(TRUST, PROMISED)
            x, drawn = near.x, on_lattice(near)
            if drawn.violation > PROMISED:  # not with these sizes
                break
            machine = _machine(drawn, sizes)
            slacks = {c.name: c.slack for c in check(machine, today, light, limits)}
            missed = {name: -1.1 * slack for name, slack in slacks.items() if slack < -TOLERANCE}
            if not missed:
                yield CheckedMachine.of(machine, problem)
                break
            reserve |= {name: 2 * reserve.get(name, 0.0) + more for name, more in missed.items()}


def _machine(search: Search, sizes: Sequence[float]) -> Machine:
    """The machine of a design, lengths rounded, with bores and rods in a row [mm]."""
    changes = changes_of(search.problem, search.x, sizes, search.x)
    return search.problem.machine.replace(changes)


def _promising(search: Search) -> list[tuple[SizesInRow, Array, tuple[Array, Array]]]:
    """Bores and rods on the grid that promise most: in a row [mm], as x, and as bounds.

    From the nearest each size in turn goes to what promises most beside the others, until none
    moves.
    """
    problem, (options, _) = search.problem, _options(search)
    entries = ~problem.vector.is_coordinate
    merit, designs = search.foreseen_merit(), {}
    merits: dict[SizesInRow, float] = {}

    def foreseen(sizes: SizesInRow) -> float:
        if sizes not in merits:
            designs[sizes] = _with_sizes(problem, search.x, _resized(problem.machine, sizes))
            merits[sizes] = merit(designs[sizes], entries)
        return merits[sizes]

    best, before = _nearest_sizes(search, 1)[0], None
    while best != before:
        before = best
        for k, some in enumerate(options):
            best = max(((*best[:k], size, *best[k + 1 :]) for size in some), key=foreseen)
    promising = []
    for sizes in sorted(merits, key=foreseen, reverse=True)[:RETUNED_SIZES]:
        low, high = (end.copy() for end in search.bounds)
        low[entries] = high[entries] = designs[sizes][entries]
        promising.append((sizes, designs[sizes], (low, high)))
    return promising


# -------------------------------------------------------------------- sizes for pins on the grid


def _near_sizes(search: Search) -> CheckedMachine | None:
    """The best sizes around the optimum moved inside limits that are drawn in more and more."""
    problem = search.problem
    if problem.grid != FINE and problem.vector.moving:
        return None
    for tightening in TIGHTENINGS:
        inner = search.of(problem.tightened(tightening), search.x).run(TRUST, PROMISED)
        for changes in _candidates(inner):
            machine = CheckedMachine.of(problem.machine.replace(changes), problem)
            if machine.allowed:
                return machine
    return None


def _candidates(search: Search) -> Iterator[dict[str, Any]]:
    """Changes to the file for rounded bores and rods that pass a first check, best first."""
    problem = search.problem
    today, light, limits = problem.machine, _light_workspace(search), _with_box(problem)
    placed, loads = _placed(search, light)
    low = search.rows[np.argsort(problem.dynamics.omega_squared(search.x, search.rows))[:LOWEST]]
    tried = []
    for sizes in _nearest_sizes(search, COMBINATIONS):
        trial = _sized(problem, placed, sizes)
        x = _with_sizes(problem, search.x, trial.cylinders)
        tried.append((float(problem.dynamics.omega_squared(x, low).min()), trial, sizes, x))
    tried.sort(key=lambda entry: -entry[0])
    passed = (
        changes_of(problem, search.x, sizes, x)
        for _, trial, sizes, x in tried
        if meets(trial, today, light, limits, loads, TOLERANCE)
    )
    yield from itertools.islice(passed, CHECKED)


def _placed(search: Search, workspace: Workspace) -> tuple[Machine, tuple[Array, Array] | None]:
    """Today's sizes on rounded pins and strokes, and static loads; None if these need sizes."""
    problem, changes = search.problem, pin_changes(search.problem, search.x)
    placed = problem.machine.replace(changes) if changes else problem.machine
    as_many = len(placed.actuators) == len(placed.joints)
    known = problem.vector.moving_masses is None and as_many
    return placed, static_loads(placed, workspace) if known else None


def _sized(problem: Problem, placed: Machine, sizes: Sequence[float]) -> Machine:
    """A machine with other bores and rods [mm], and the masses that go with them."""
    trial = replace(placed, cylinders=_resized(placed, sizes))
    return trial if problem.vector.moving_masses is None else weighed(trial, problem.machine)


def _with_box(problem: Problem) -> Requirements:
    """The requirements with the pin box of today's workspace, for use on any other."""
    return problem.requirements.with_box(problem.machine, problem.workspace)


def _light_workspace(search: Search) -> Workspace:
    """The workspace with only the poses of the largest static forces: enough for a first check."""
    rows = search.problem.dynamics.nominal_rows.pose[search.holding]
    return search.problem.workspace.subset(np.unique(rows))


# ----------------------------------------------------------------------------------- sizes in rows


def _options(search: Search) -> tuple[list[list[float]], list[float]]:
    """Candidates for every bore and rod, in a row, and the sizes of the optimum [mm].

    Sizes of a catalogue are the only candidates.
    """
    problem = search.problem
    if problem.sizes:
        chosen = [size_in_mm(size) for pair in problem.sizes if pair for size in pair]
        return [[size] for size in chosen], chosen
    options, wanted = [], []
    # motors stay
    for i, free in enumerate(problem.vector.resized[: len(problem.machine.cylinders)]):
        real = diameters(problem, search.x, i)
        wanted += real
        pairs = zip(real, free, strict=True)
        options += [neighbours(size) if varies else [size] for size, varies in pairs]
    return options, wanted


def _nearest_sizes(search: Search, count: int) -> list[SizesInRow]:
    """Bore and rod of every cylinder in a row [mm], the nearest first."""
    options, wanted = _options(search)
    some = itertools.islice(itertools.product(*options), ENUMERATED)
    return sorted(some, key=lambda s: float(np.abs(np.subtract(s, wanted)).sum()))[:count]


def _on_grid(problem: Problem, x: Array) -> list[float]:
    """Bores and rods in a row [mm] of a design that has them on the grid."""
    sizes = (diameters(problem, x, i) for i in range(len(problem.machine.cylinders)))
    return [round(size, 6) for pair in sizes for size in pair]


def _resized(machine: Machine, sizes: Sequence[float]) -> tuple[Cylinder, ...]:
    """The cylinders of a machine with other bores and rods [mm]."""
    triples = zip(machine.cylinders, sizes[::2], sizes[1::2], strict=True)
    return tuple(replace(c, bore=bore * mm, rod=rod * mm) for c, bore, rod in triples)


def _with_sizes(problem: Problem, x: Array, cylinders: Sequence[Cylinder]) -> Array:
    """The design x with the areas of cylinders."""
    areas = areas_of(cylinders)
    areas = areas / problem.vector.areas_today[: len(cylinders)]
    return np.concatenate([areas.ravel(), x[areas.size :]])
