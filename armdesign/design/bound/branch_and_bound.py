"""Branch and bound of one cylinder's term: cells are halved until none can exceed the best.

No local optimum can fool it: what is cut off is enclosed from above.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

import numpy as np

from armdesign.arrays import Array
from armdesign.design.bound.cylinder_shape import Shape
from armdesign.design.bound.cylinder_term import Cells, CylinderTerm

BATCH = 1500  # cells branched at a time
TRIALS = 200  # middles of cells tried as designs
FIRST = (8, 8, 2)  # cells to begin with, along b and scale


@dataclass(frozen=True, eq=False, kw_only=True)
class Maximum:
    """The most that a term can be: ``upper`` for sure; ``value`` is reached by ``design``."""

    upper: float
    value: float
    design: Array  # (3,) b and scale
    volume: Array  # (2,) [m³]
    cells: int  # looked at


def maximum(term: CylinderTerm, tolerance: float, most_cells: int) -> Maximum:
    """Branch and bound until upper − value ≤ tolerance or so many cells have been looked at."""
    low, high = first_cells(term.shape)
    if term.air is not None:
        zero, most = np.zeros((len(low), 2)), np.tile(term.limits.volume, (len(low), 1))
        low, high = np.column_stack([low, zero]), np.column_stack([high, most])
    cells, looked, pruned = term.upper(low, high), len(low), -math.inf
    best = Maximum(
        upper=math.inf, value=-math.inf, design=np.zeros(3), volume=np.zeros(2), cells=0
    )
    while True:
        best = _better(term, best, cells)
        open_cells = cells.bound > best.value + tolerance
        pruned = max(pruned, float(cells.bound[~open_cells].max(initial=-math.inf)))
        cells = cells[open_cells]
        if len(cells.bound) == 0 or looked >= most_cells:
            break
        order = np.argsort(-cells.bound)
        parents, waiting = cells[order[:BATCH]], cells[order[BATCH:]]
        children = term.upper(*_halves(parents))
        looked += 2 * len(parents.bound)
        inherited = np.tile(parents.bound, 2)[children.source]
        cells = _together(waiting, replace(children, bound=np.minimum(children.bound, inherited)))
    upper = max(pruned, float(cells.bound.max(initial=-math.inf)), best.value)
    return replace(best, upper=upper, cells=looked)


def first_cells(shape: Shape) -> tuple[Array, Array]:
    """The region of a shape cut evenly: corners (m, 3) of cells of b and scale."""
    cuts = zip(*shape.region, FIRST, strict=True)
    edges = [np.linspace(a, b, n + 1) if b > a else np.array([a, b]) for a, b, n in cuts]
    grids = [
        np.meshgrid(*[e[part] for e in edges], indexing="ij")
        for part in (slice(None, -1), slice(1, None))
    ]
    low, high = (np.stack([g.ravel() for g in grid], axis=1) for grid in grids)
    return low, high


def _halves(cells: Cells) -> tuple[Array, Array]:
    """Both halves of every cell, cut across the axis that adds most to its bound."""
    rows = np.arange(len(cells.bound))
    axis = np.where(cells.high > cells.low, cells.added, -1.0).argmax(axis=1)
    first_high, second_low = cells.high.copy(), cells.low.copy()
    first_high[rows, axis] = second_low[rows, axis] = (
        cells.low[rows, axis] + cells.high[rows, axis]
    ) / 2
    return np.concatenate([cells.low, second_low]), np.concatenate([first_high, cells.high])


def _together(some: Cells, more: Cells) -> Cells:
    return Cells(
        **{
            f.name: np.concatenate([getattr(some, f.name), getattr(more, f.name)])
            for f in fields(Cells)
        }
    )


def _better(term: CylinderTerm, best: Maximum, cells: Cells) -> Maximum:
    """The best of the cells' middles, if better: a cell of no width is one design."""
    promising = np.argsort(-cells.bound)[:TRIALS]
    promising = promising[cells.bound[promising] > best.value]
    middle = (cells.low[promising] + cells.high[promising]) / 2
    designs = term.upper(middle, middle)
    designs = designs[np.isfinite(designs.bound)]
    if len(designs.bound) == 0 or designs.bound.max() <= best.value:
        return best
    k = int(designs.bound.argmax())
    return replace(
        best, value=float(designs.bound[k]), design=designs.low[k, :3], volume=designs.volume[k]
    )
