"""The grid of a drawing: bores and rods, like pins, in steps of 0.1 mm."""

from __future__ import annotations

import math

from armdesign.arrays import Array
from armdesign.design.program.problem import Problem
from armdesign.units import mm

GRID = 0.1  # [mm] what a drawing can say


def neighbours(value: float) -> list[float]:
    """The grid values below and above [mm]."""
    low = math.floor(value / GRID + 1e-6) * GRID
    return [round(low, 1), round(low + GRID, 1)]


def diameters(problem: Problem, x: Array, i: int) -> list[float]:
    """Bore and rod of a cylinder at x [mm]."""
    (a1, a2), count = problem.vector.areas(x)[i], problem.machine.cylinders[i].count
    return [2 * math.sqrt(max(area, 0.0) / count / math.pi) / mm for area in (a1, a1 - a2)]


def grid_sizes(problem: Problem, x: Array, entry: int) -> list[float]:
    """Values of an area of x at which its bore or rod lies on the grid, the nearer first.

    The annulus takes the bore as it stands at x. Empty where that size does not vary.
    """
    i, side = divmod(entry, 2)
    if not problem.vector.resized[i][side] or (problem.sizes and problem.sizes[i] is not None):
        return []
    size, own = diameters(problem, x, i)[side], problem.vector.areas_today[i, side]
    cap = problem.vector.areas(x)[i, 0]
    found = []
    for value in sorted(neighbours(size), key=lambda near: abs(near - size)):
        area = problem.machine.cylinders[i].count * math.pi / 4 * (value * mm) ** 2
        found.append(float((area if side == 0 else cap - area) / own))
    return found
