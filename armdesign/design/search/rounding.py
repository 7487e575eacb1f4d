"""Rounding: from the optimum in real numbers to a machine file that a drawing office can use.

Pins, bores, rods, strokes and closed lengths go to the 0.1 mm grid; the machine's file is written,
read again, and the machine that it says judged by ``check``, which knows nothing of the optimiser.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np

from armdesign.arrays import Array
from armdesign.design.catalogue.sizes import size_in_mm
from armdesign.design.program.moving_masses import weighed
from armdesign.design.program.problem import Problem
from armdesign.design.program.variables import SIZES
from armdesign.design.requirements.check import check, meets, static_loads
from armdesign.design.requirements.record import Check
from armdesign.design.search.elastic import Elastic
from armdesign.design.search.grid import GRID, diameters, neighbours
from armdesign.design.search.sequential_sdp import Search
from armdesign.frequency.bands import Bands, worst_within
from armdesign.frequency.workspace import Workspace
from armdesign.frequency.worst_frequency import worst_frequency
from armdesign.hydraulics.actuator import Cylinder
from armdesign.machine.machine import Machine
from armdesign.units import litre, mm

DEPTH = 2e-3  # share of its limit by which a machine keeps inside where rounding is hard
COMBINATIONS = 128  # of rounded bores and rods that are tried
TUNED = 3  # sizes whose pins are tuned in earnest
TIGHTENING = 1e-4  # share by which limits are drawn in for that
RETUNED = 4  # times that pins are tuned again, with more in reserve each time
TOLERANCE = 1e-9  # of a slack

Judged: TypeAlias = tuple[Machine, tuple[Check, ...]]


def written(search: Search) -> Judged | None:
    """The best machine near the optimum that can be written and meets every requirement.

    Today's if none is better.

    Where pins vary, bores and rods, the coarser ones, are rounded first and the pins follow, see
    ``_tuned``. Where that fails, or no pin varies, limits are drawn in a little, the optimum is
    moved inside, pins are rounded, strokes made to cover the joint ranges, and of the bores and
    rods around it the best that pass are taken; if none passes, the limits are drawn in more. At
    last frequency is left aside, see ``inmost``. None where all of that fails.
    """
    today = search.problem.machine
    passed = [
        judged
        for judged in (_judged(machine, search) for machine in _tuned(search))
        if not _failed(judged)
    ]
    for tightening in (2e-4, 5e-4, 1e-3, 2e-3, 5e-3) if not passed else ():
        inner = _near(search, search.problem.tightened(tightening), search.x, search.bounds).run(
            0.02, 1e-5
        )
        for changes in _candidates(inner):
            judged = _judged(today.replace(changes), search)
            if not _failed(judged):
                passed.append(judged)
                break
        if passed:
            break
    if not passed and (deep := inmost(search)) is not None:
        passed.append(deep)
    if len(passed) > 1:  # of one alone nothing need be known
        passed = [max(passed, key=lambda judged: worst_on_poses(judged[0], search.problem))]
    if passed:
        return _better(passed[0], search)
    return _judged(today, search) if _hardly_gained(search) else None


def inmost(search: Search) -> Judged | None:
    """A machine near a search as far inside all limits as can be, sizes on the grid.

    None if it misses one even so.
    """
    problem = search.problem
    drawn_in = problem.tightened(TIGHTENING if problem.vector.moving else 0.0)
    elastic = Elastic(drawn_in, search.x, search.holding, DEPTH)
    soft = (elastic.names,)
    x = elastic.on_grid(elastic.least(soft, ()), soft, ()).x
    choice = _options(search)[1] if problem.sizes else _on_grid(problem, x)
    changes = _weighed(problem, _pin_changes(problem, x) | _size_changes(problem, choice, x))
    judged = _judged(problem.machine.replace(changes), search)
    return None if _failed(judged) else judged


def _on_grid(problem: Problem, x: Array) -> list[float]:
    """Bores and rods in a row [mm] of a design that has them on the grid, without the arithmetic's last digits."""
    return [
        round(size, 6)
        for i in range(len(problem.machine.cylinders))
        for size in diameters(problem, x, i)
    ]


def _judged(machine: Machine, search: Search) -> Judged:
    problem = search.problem
    return machine, check(machine, problem.machine, problem.workspace, problem.requirements)


def _failed(judged: Judged) -> list[Check]:
    return [c for c in judged[1] if c.slack < -TOLERANCE]


def _near(search: Search, problem: Problem, x: Array, bounds: tuple[Array, Array]) -> Search:
    """A search of a problem much like that of another, from x within bounds."""
    other = Search(problem=problem, x=x, programme=search.programme, strictness=search.strictness)
    other.rows, other.holding, other.bounds, other.reference = (
        search.rows,
        search.holding,
        bounds,
        search.reference,
    )
    return other


def _tuned(search: Search) -> Iterator[Machine]:
    """Machines with bores and rods on the grid and pins tuned again for them.

    For the most promising sizes.

    Sizes a little off cost next to nothing where the pins may follow. What pins and strokes on the
    grid then miss a limit by is kept in reserve, and the pins are tuned once more.
    """
    problem = search.problem
    if not problem.vector.moving:
        return
    today, light = problem.machine, _light_workspace(search)
    requirements = replace(problem.requirements, pin_box=problem.vector.pin_box)
    inside = problem.tightened(TIGHTENING)
    inner = _near(search, inside, search.x, search.bounds).refine(0.02, 1e-5)
    for choice, x, bounds in _promising(inner):
        reserve: dict[str, float] = {}
        for _ in range(RETUNED):
            near = _near(search, inside.with_reserve(reserve), x, bounds).refine(0.02, 1e-5)
            if near.violation > 1e-5:  # not with these sizes
                break
            x = near.x
            changes = _weighed(
                problem, _pin_changes(problem, near.x) | _size_changes(problem, choice, near.x)
            )
            machine = today.replace(changes)
            slacks = {c.name: c.slack for c in check(machine, today, light, requirements)}
            missed = {name: -1.1 * slack for name, slack in slacks.items() if slack < -TOLERANCE}
            if not missed:
                yield machine
                break
            reserve |= {name: 2 * reserve.get(name, 0.0) + more for name, more in missed.items()}


def _promising(search: Search) -> list[tuple[tuple[float, ...], Array, tuple[Array, Array]]]:
    """Bores and rods on the grid from which most is hoped: in a row [mm], as x, and as bounds that hold them.

    From the nearest each size in turn goes to what promises most beside the others, until none
    moves.
    """
    problem, (options, _) = search.problem, _options(search)
    sizes = slice(0, problem.vector.areas_today.size)
    promised, designs = search.foresight(sizes), {}
    hopes: dict[tuple[float, ...], float] = {}

    def hope(choice: tuple[float, ...]) -> float:
        if choice not in hopes:
            designs[choice] = _with_sizes(problem, search.x, _resized(problem.machine, choice))
            hopes[choice] = promised(designs[choice])
        return hopes[choice]

    best, before = _choices(search, 1)[0], None
    while best != before:
        before = best
        for k, some in enumerate(options):
            best = max(((*best[:k], size, *best[k + 1 :]) for size in some), key=hope)
    found = []
    for choice in sorted(hopes, key=hope, reverse=True)[:TUNED]:
        low, high = (end.copy() for end in search.bounds)
        low[sizes] = high[sizes] = designs[choice][sizes]
        found.append((choice, designs[choice], (low, high)))
    return found


def _better(judged: Judged, search: Search) -> Judged:
    """The rounded machine.

    Or today's, if what the search gained is less than what rounding cost.
    """
    today = search.problem.machine
    if not _hardly_gained(search):
        return judged
    new, old = (worst_on_poses(machine, search.problem) for machine in (judged[0], today))
    return judged if new > old else _judged(today, search)


def _hardly_gained(search: Search) -> bool:
    """Whether today's machine is allowed and the optimum less than 1 % above it, which rounding may eat up."""
    problem = search.problem
    if problem.sizes:  # today's machine need not be in the catalogue
        return False
    if search.squared > 1.02 * problem.dynamics.omega_squared_today:
        return False
    checks = check(problem.machine, problem.machine, problem.workspace, problem.requirements)
    return min(c.slack for c in checks) >= -TOLERANCE


def worst_on_poses(machine: Machine, problem: Problem) -> float:
    """Lowest coupled frequency over the workspace's poses and all load cases, and within the problem's bands [Hz]."""
    workspace = problem.workspace
    if problem.dynamics.bands != Bands():
        return worst_within(machine, workspace, problem.dynamics.bands).frequency
    return worst_frequency(machine, workspace).frequency


def nearest_misses(search: Search) -> list[Check]:
    """The requirements that the sizes on the grid that miss least miss."""
    problem = search.problem
    frame, loads = _placed(search, problem.workspace)
    limits = replace(
        problem.requirements, pin_box=problem.requirements.box(problem.machine, problem.workspace)
    )
    tried = [_sized(problem, frame, choice) for choice in _choices(search, COMBINATIONS)]
    judged = [
        check(machine, problem.machine, problem.workspace, limits, loads) for machine in tried
    ]
    failed = [[c for c in checks if c.slack < -TOLERANCE] for checks in judged]
    return min(
        failed, key=lambda checks: (max((-c.slack for c in checks), default=0.0), len(checks))
    )


def _placed(search: Search, workspace: Workspace) -> tuple[Machine, tuple[Array, Array] | None]:
    """Today's sizes on pins and strokes on the grid, and its static loads.

    None where they depend on the sizes.
    """
    changes = _pin_changes(search.problem, search.x)
    frame = search.problem.machine.replace(changes) if changes else search.problem.machine
    still = search.problem.vector.moving_masses is None and len(frame.actuators) == len(
        frame.joints
    )
    return frame, static_loads(frame, workspace) if still else None


def _sized(problem: Problem, frame: Machine, choice: Sequence[float]) -> Machine:
    """A machine with other bores and rods [mm], and the masses that go with them."""
    trial = replace(frame, cylinders=_resized(frame, choice))
    return trial if problem.vector.moving_masses is None else weighed(trial, problem.machine)


def _candidates(search: Search) -> Iterator[dict[str, Any]]:
    """Changes to the machine file for roundings of the bores and rods that pass a first check, best first."""
    problem = search.problem
    today, light = problem.machine, _light_workspace(search)
    frame, loads = _placed(search, light)
    low = search.rows[np.argsort(problem.dynamics.omega_squared(search.x, search.rows))[:100]]
    found = []
    for choice in _choices(search, COMBINATIONS):
        trial = _sized(problem, frame, choice)
        x = _with_sizes(problem, search.x, trial.cylinders)
        found.append((float(problem.dynamics.omega_squared(x, low).min()), trial, choice, x))
    found.sort(key=lambda entry: -entry[0])
    limits = replace(
        problem.requirements, pin_box=problem.requirements.box(today, problem.workspace)
    )
    passed = 0
    for _, trial, choice, x in found:
        if meets(trial, today, light, limits, loads, TOLERANCE):
            yield _weighed(
                problem, _pin_changes(problem, search.x) | _size_changes(problem, choice, x)
            )
            passed += 1
        if passed == 5:
            return


def _options(search: Search) -> tuple[list[list[float]], list[float]]:
    """For bore and rod of every cylinder in a row what it may be, up or down where it varies, and what it is [mm].

    Those of a catalogue stay what they are.
    """
    problem = search.problem
    if problem.sizes:
        chosen = [size_in_mm(size) for pair in problem.sizes if pair for size in pair]
        return [[size] for size in chosen], chosen
    options, wanted = [], []
    for i, free in enumerate(
        problem.vector.resized[: len(problem.machine.cylinders)]
    ):  # motors stay
        real = diameters(problem, search.x, i)
        wanted += real
        options += [
            neighbours(size) if may else [size] for size, may in zip(real, free, strict=True)
        ]
    return options, wanted


def _choices(search: Search, count: int) -> list[tuple[float, ...]]:
    """Bore and rod of every cylinder in a row [mm], the nearest first."""
    options, wanted = _options(search)
    some = itertools.islice(itertools.product(*options), 20_000)
    return sorted(some, key=lambda c: float(np.abs(np.subtract(c, wanted)).sum()))[:count]


def _resized(machine: Machine, choice: Sequence[float]) -> tuple[Cylinder, ...]:
    """The cylinders of a machine with other bores and rods [mm]."""
    sizes = zip(machine.cylinders, choice[::2], choice[1::2], strict=True)
    return tuple(replace(c, bore=bore * mm, rod=rod * mm) for c, bore, rod in sizes)


def _with_sizes(problem: Problem, x: Array, cylinders: Sequence[Cylinder]) -> Array:
    """The design x with the areas of cylinders."""
    areas = (
        np.array([[c.bore_area, c.annulus_area] for c in cylinders])
        / problem.vector.areas_today[: len(cylinders)]
    )
    return np.concatenate([areas.ravel(), x[areas.size :]])


def _light_workspace(search: Search) -> Workspace:
    """The workspace with only the poses of the largest static forces: enough for a first check."""
    whole = search.problem.workspace
    q = whole.q[np.unique(search.problem.dynamics.nominal_rows.pose[search.holding])]
    return Workspace(q, whole.axes, whole.end_margin, whole.machine)


def _pin_changes(problem: Problem, x: Array) -> dict[str, Any]:
    """Rounded pins and bars that vary, with strokes and closed lengths that cover the joint ranges."""
    changes: dict[str, Any] = {}
    linkages = list(problem.vector.linkages(x))
    today, requirements = problem.machine, problem.requirements
    common = requirements.box(today, problem.workspace)
    for i in problem.vector.moving:
        name = f"cylinder.{today.cylinders[i].name}"
        for place in sorted({place for place, _ in problem.vector.moves(i).values()}):
            limit = requirements.box_of(today.cylinders[i].name, place, common) / mm
            pairs = zip(
                linkages[i].place(place) or (), today.linkages[i].place(place) or (), strict=True
            )
            at = [_within(value / mm, before / mm, limit) for value, before in pairs]
            changes[f"{name}.{linkages[i].key_of(place)}"] = at if len(at) > 1 else at[0]
            linkages[i] = linkages[i].with_place(place, [value * mm for value in at])
        poses = problem.vector.range_poses[i]
        if poses is None:
            continue
        length = linkages[i].length(poses) / mm
        closed = math.floor(length.min() / GRID + 1e-9) * GRID
        stroke = math.ceil((length.max() - closed) / GRID - 1e-9) * GRID
        changes |= {
            f"{name}.closed_length_mm": round(closed, 1),
            f"{name}.stroke_mm": round(stroke, 1),
        }
    return changes


def _within(value: float, before: float, limit: float) -> float:
    """A pin coordinate on the grid and within the box [mm]; as it was where it did not move."""
    if abs(value - before) < 1e-9:
        return before
    low, high = (
        math.ceil((before - limit) / GRID - 1e-6) * GRID,
        math.floor((before + limit) / GRID + 1e-6) * GRID,
    )
    return round(min(max(round(value / GRID) * GRID, low), high), 1)


def _size_changes(problem: Problem, choice: Sequence[float], x: Array) -> dict[str, Any]:
    changes: dict[str, Any] = {}
    for i, (cylinder, free) in enumerate(
        zip(problem.machine.cylinders, problem.vector.resized, strict=False)
    ):
        name = f"cylinder.{cylinder.name}"
        sizes = zip(SIZES, choice[2 * i : 2 * i + 2], free, strict=True)
        changes |= {f"{name}.{key}": size for key, size, may in sizes if may}
        if problem.dynamics.proportional and any(free):
            today = (cylinder.cap_dead_volume, cylinder.annulus_dead_volume)
            volumes = today * problem.vector.areas(x)[i] / problem.vector.areas_today[i] / litre
            changes[f"{name}.dead_volume_l.cap"] = round(float(volumes[0]), 4)
            changes[f"{name}.dead_volume_l.annulus"] = round(float(volumes[1]), 4)
    return changes


def _weighed(problem: Problem, changes: dict[str, Any]) -> dict[str, Any]:
    """Changes with the own masses that sizes and pins make, to the gram."""
    if problem.vector.moving_masses is None:
        return changes
    new, found = weighed(problem.machine.replace(changes), problem.machine), dict(changes)
    for i, names in problem.vector.moving_masses.bars.items():
        for name in names:
            key, mass = new.linkages[i].mass_key_of(name), new.cylinders[i].masses[name]
            found[f"cylinder.{new.cylinders[i].name}.{key}"] = round(mass, 3)
    return found
