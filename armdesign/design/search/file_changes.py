"""Changes to a machine file that make a design of it, on the grid of a drawing."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from armdesign.arrays import Array
from armdesign.design.catalogue.sizes import FINE
from armdesign.design.program.moving_masses import weighed
from armdesign.design.program.problem import Problem
from armdesign.design.program.variables import SIZES
from armdesign.frequency.bands import Bands
from armdesign.machine.machine import Machine
from armdesign.units import litre, mm

GRID = 0.1  # [mm] of closed lengths, and of bores and rods where no catalogue has them
DIGITS = 6  # of shares
UNMOVED = 1e-12  # [m] of a coordinate


def neighbours(value: float) -> list[float]:
    """The grid values below and above, > 0 [mm]."""
    low = max(math.floor(value / GRID + 1e-6), 1) * GRID
    return [round(low, 1), round(low + GRID, 1)]


def diameters(problem: Problem, x: Array, i: int) -> list[float]:
    """Bore and rod of a cylinder at x [mm]."""
    (a1, a2), count = problem.vector.areas(x)[i], problem.machine.cylinders[i].count
    return [2 * math.sqrt(max(area, 0.0) / count / math.pi) / mm for area in (a1, a1 - a2)]


def grid_values(problem: Problem, x: Array, entry: int) -> list[float]:
    """Values of an entry of x at which it lies on the grid, the nearer first; empty if it stays.

    A bore or rod of no catalogue, the annulus taking the bore as it stands at x; or the coordinate
    of a pin or bar, where lengths are coarse.
    """
    variable = problem.vector.variables[entry]
    if variable.pin is not None:
        return _grid_coordinates(problem, x, entry)
    i, side = variable.cylinder, variable.axis
    chosen = bool(problem.sizes) and problem.sizes[i] is not None
    if i >= len(problem.machine.cylinders) or not problem.vector.resized[i][side] or chosen:
        return []
    size, own = diameters(problem, x, i)[side], problem.vector.areas_today[i, side]
    cap = problem.vector.areas(x)[i, 0]
    shares = []
    for value in sorted(neighbours(size), key=lambda near: abs(near - size)):
        area = problem.machine.cylinders[i].count * math.pi / 4 * (value * mm) ** 2
        shares.append(float((area if side == 0 else cap - area) / own))
    return shares


def grid_of(problem: Problem, x: Array, entry: int) -> tuple[float, float] | None:
    """Origin and step of the grid that a coordinate of a pin or bar lies on, in its unit of x.

    None where lengths are fine, or where it did not move.
    """
    v = problem.vector.variables[entry]
    if problem.grid == FINE or abs(x[entry]) * problem.vector.pin_box < UNMOVED:
        return None
    today = (problem.machine.linkages[v.cylinder].place(v.pin or "") or ())[v.axis]
    return -today / problem.vector.pin_box, problem.grid.lengths * mm / problem.vector.pin_box


def _grid_coordinates(problem: Problem, x: Array, entry: int) -> list[float]:
    """A coordinate that moved on the grid below and above, within its box; today's if none is."""
    grid = grid_of(problem, x, entry)
    if grid is None:
        return []
    (origin, step), (low, high) = grid, (end[entry] for end in problem.bounds)
    number = (x[entry] - origin) / step
    near = sorted((math.floor(number), math.ceil(number)), key=lambda k: abs(k - number))
    values = [origin + step * k for k in near]
    return [value for value in values if low <= value <= high] or [0.0]


def changes_of(
    problem: Problem, x: Array, sizes: Sequence[float], x_of_sizes: Array
) -> dict[str, Any]:
    """All changes that pins and bars of x, rounded, and bores and rods in a row [mm] make.

    ``x_of_sizes`` is a design with these sizes, for dead volumes that follow them.
    """
    changes = pin_changes(problem, x) | _size_changes(problem, sizes, x_of_sizes)
    return _with_masses(problem, changes)


def changes_of_sizes(problem: Problem, sizes: Sequence[float], x: Array) -> dict[str, Any]:
    """All changes that bores and rods in a row [mm] make where no pin moves, as ``changes_of``."""
    return _with_masses(problem, _size_changes(problem, sizes, x))


def pin_changes(problem: Problem, x: Array) -> dict[str, Any]:
    """Rounded pins and bars, with strokes and closed lengths that cover the joint ranges."""
    changes: dict[str, Any] = {}
    grid = problem.grid.lengths
    linkages = list(problem.vector.linkages(x))
    today, requirements = problem.machine, problem.requirements
    common = requirements.box(today, problem.workspace)
    for i in problem.vector.moving:
        name = f"cylinder.{today.cylinders[i].name}"
        for place in sorted({place for place, _ in problem.vector.moves(i).values()}):
            limit = requirements.box_of(today.cylinders[i].name, place, common) / mm
            both = (linkage.place(place) or () for linkage in (linkages[i], today.linkages[i]))
            pairs = zip(*both, strict=True)
            at = [_rounded(value / mm, before / mm, limit, grid) for value, before in pairs]
            changes[f"{name}.{linkages[i].key_of(place)}"] = at if len(at) > 1 else at[0]
            linkages[i] = linkages[i].with_places({place: [value * mm for value in at]})
        poses = problem.vector.range_poses[i]
        if poses is None:
            continue
        chosen = (problem.vector.chosen_lengths or {i: None})[i]
        lengths = chosen or _covering(problem, i, linkages[i].length(poses))
        for key, value in zip(("closed_length_mm", "stroke_mm"), lengths, strict=True):
            changes[f"{name}.{key}"] = round(value / mm, 1)
    return changes


def _covering(problem: Problem, i: int, length: Array) -> tuple[float, float]:
    """Closed length on the grid and stroke in steps that cover lengths over a range [m].

    A longer stroke keeps more of it free, so that the closed length may have to be less.
    """
    spare, step = problem.vector.spare[i], problem.grid.strokes * mm
    _, stroke = problem.vector.covering(i, length.min(), length.max())
    while True:
        least = length.min() - spare[0] * stroke
        closed = math.floor(least / (GRID * mm) + 1e-6) * GRID * mm
        needed = math.ceil((length.max() - closed) / (1 - spare[1]) / step - 1e-6) * step
        if needed <= stroke + 1e-6 * step:
            return closed, needed
        stroke = needed


def _rounded(value: float, before: float, limit: float, grid: float) -> float:
    """A pin coordinate on the grid and within the box [mm]; as it was where it did not move."""
    if abs(value - before) < UNMOVED / mm:
        return before
    low = math.ceil((before - limit) / grid - 1e-6) * grid
    high = math.floor((before + limit) / grid + 1e-6) * grid
    return round(min(max(round(value / grid) * grid, low), high), 1)


def _size_changes(problem: Problem, sizes: Sequence[float], x: Array) -> dict[str, Any]:
    """Bores and rods that vary, and dead volumes where they follow the areas."""
    changes: dict[str, Any] = {}
    pairs = zip(problem.machine.cylinders, problem.vector.resized, strict=False)
    for i, (cylinder, free) in enumerate(pairs):
        name = f"cylinder.{cylinder.name}"
        own = zip(SIZES, sizes[2 * i : 2 * i + 2], free, strict=True)
        changes |= {f"{name}.{key}": size for key, size, varies in own if varies}
        if problem.dynamics.corners.proportional and any(free):
            today = (cylinder.cap_dead_volume, cylinder.annulus_dead_volume)
            volumes = today * problem.vector.areas(x)[i] / problem.vector.areas_today[i] / litre
            changes[f"{name}.dead_volume_l.cap"] = round(float(volumes[0]), 4)
            changes[f"{name}.dead_volume_l.annulus"] = round(float(volumes[1]), 4)
    return changes


def with_todays_structure(machine: Machine, today: Machine) -> Machine:
    """The new machine with bands of structure as shares of its own oil: the steel is the same."""
    bands, changes = Bands.of(today), {}
    for old, new in zip(today.cylinders, machine.cylinders, strict=True):
        band = bands.structure_of(new.name)
        of_oil = new.oil_compliance(machine.fluid, machine.supply)
        share = old.oil_compliance(today.fluid, today.supply) / of_oil
        if band is not None and share != 1.0:
            own = [float(f"{share * end:.{DIGITS}g}") for end in band]
            changes[f"bands.structures.{new.name}"] = own
    return machine.replace(changes)


def _with_masses(problem: Problem, changes: dict[str, Any]) -> dict[str, Any]:
    """Changes with the own masses that sizes and pins make, to the gram."""
    if problem.vector.moving_masses is None:
        return changes
    new, changes = weighed(problem.machine.replace(changes), problem.machine), dict(changes)
    for i, names in problem.vector.moving_masses.bars.items():
        for name in names:
            key, mass = new.linkages[i].mass_key_of(name), new.cylinders[i].masses[name]
            changes[f"cylinder.{new.cylinders[i].name}.{key}"] = round(mass, 3)
    return changes
