"""Rounding: from the optimum in real numbers to a machine file that a drawing office can use.

Pins, bores, rods, strokes and closed lengths go to the 0.1 mm grid; the machine is written, read back, and judged by
``requirements.check``, which knows nothing of the optimiser.
"""

from __future__ import annotations

import itertools
import math
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from armdesign.arrays import Array
from armdesign.design.catalogue import size_in_mm
from armdesign.design.codesign import Search
from armdesign.design.problem import Problem
from armdesign.design.requirements import Check, check, static_loads
from armdesign.errors import InfeasibleError
from armdesign.machine import Machine, load
from armdesign.modes import lowest_frequency
from armdesign.units import litre, mm
from armdesign.workspace import Workspace

GRID = 0.1  # [mm] what a drawing can say
COMBINATIONS = 128  # of rounded bores and rods that are tried
TOLERANCE = 1e-9  # of a slack


def rounded(search: Search) -> tuple[Machine, tuple[Check, ...]]:
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
    if problem.sizes:  # today's machine need not be in the catalogue
        return False
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
    if problem.sizes:
        wanted = [size_in_mm(size) for pair in problem.sizes if pair for size in pair]
        options = [[size] for size in wanted]
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
