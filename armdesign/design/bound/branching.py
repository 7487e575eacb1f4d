"""The most that one cylinder's term can be, by branch and bound.

Cells are halved until none can exceed the best design that is found. No local optimum can fool it:
what is cut off is enclosed from above (``cylinder_term``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from armdesign.arrays import Array
from armdesign.design.bound.cylinder_term import Cells, CylinderTerm, together

BATCH = 1500  # cells branched at a time
TRIALS = 50  # middles of cells tried as designs
PASS = 60  # cells that cost little more together than a few
WITHIN = 1e-9  # by which vertices of volumes are drawn in: rounding

Cover: TypeAlias = tuple[Array, Array]  # corners (m, 3 or 5) of cells
Best: TypeAlias = tuple[float, Array, Array]  # value, place and volume as in ``Maximum``
NOTHING: Best = -math.inf, np.zeros(5), np.zeros(2)


@dataclass(frozen=True, eq=False, kw_only=True)
class Maximum:
    """The most that a term can be: ``upper`` for sure; ``value`` is reached at ``place``."""

    upper: float
    value: float
    place: Array  # (5,) b and scale, and swept volumes or areas of a catalogue
    volume: Array  # (2,) [m³]
    cells: int  # looked at
    leaves: Cells  # all that were not halved

    @property
    def cover(self) -> Cover:
        """Cells that hold all that is allowed."""
        return self.leaves.low, self.leaves.high


def whole_region(term: CylinderTerm) -> Cover:
    """The region of a term cut evenly, by volumes or areas too where its cells are of them."""
    low, high = term.shape.cut()
    if term.air or term.structure or term.limits.areas.pairs is not None:
        least, most = (np.tile(end, (len(low), 1)) for end in term.limits.others)
        low, high = np.column_stack([low, least]), np.column_stack([high, most])
    return low, high


def part_of(cover: Cover, region: Cover) -> Cover:
    """What of some cells lies in a region, of corners (5,)."""
    low, high = cover
    low, high = (
        np.maximum(low, region[0][: low.shape[1]]),
        np.minimum(high, region[1][: low.shape[1]]),
    )
    inside = np.all(low <= high, axis=1)
    return low[inside], high[inside]


def first_look(
    term: CylinderTerm, known: Array | None = None, cover: Cover | None = None
) -> Maximum:
    """What is known of a term by cells that hold all that is allowed; None: the region's.

    Designs at ``known`` places (m, 5) are tried too: where few are allowed, halving finds none.
    """
    low, high = cover or whole_region(term)
    places = np.empty((0, low.shape[1])) if known is None else known[:, : low.shape[1]]
    cells, best = _looked_at(term, NOTHING, low, high, places)
    return _maximum(best, cells, len(low))


def nearer(term: CylinderTerm, begun: Maximum, tolerance: float, most_cells: int) -> Maximum:
    """Branch and bound until upper − value ≤ tolerance or so many cells have been looked at.

    From what has been ``begun`` of the same term.
    """
    best: Best = begun.value, begun.place, begun.volume
    cells, looked, done = begun.leaves, begun.cells, []
    while True:
        open_cells = cells.bound > best[0] + tolerance
        done.append(cells[~open_cells])
        cells = cells[open_cells]
        if len(cells.bound) == 0 or looked >= most_cells:
            break
        order = np.argsort(-cells.bound)
        parents, waiting = cells[order[:BATCH]], cells[order[BATCH:]]
        count, children, best = _children(term, best, parents)
        looked += count
        cells = together(waiting, children)
    return _maximum(best, together(*done, cells), looked)


def _maximum(best: Best, leaves: Cells, looked: int) -> Maximum:
    """The most by leaves and by the best design of them."""
    value, place, volume = best
    upper = max(float(leaves.bound.max(initial=-math.inf)), value)
    return Maximum(
        upper=upper, value=value, place=place, volume=volume, cells=looked, leaves=leaves
    )


def _children(term: CylinderTerm, best: Best, parents: Cells) -> tuple[int, Cells, Best]:
    """How many parts of cells have been looked at, those left, and the best of their designs.

    Only angles count that may in some of the cells.
    """
    angles = np.flatnonzero(parents.useful.any(axis=0))
    near = replace(term, limits=term.limits.at(angles))
    low, high, source = _parts(parents)
    children, best = _looked_at(near, best, low, high, _middles(near, parents))
    useful = np.zeros((len(children.bound), parents.useful.shape[1]), dtype=bool)
    useful[:, angles] = children.useful
    bound = np.minimum(children.bound, parents.bound[source[children.source]])
    return len(low), replace(children, bound=bound, useful=useful), best


def _parts(cells: Cells) -> tuple[Array, Array, Array]:
    """Corners of the parts of every cell, and which it is: halves, or more to fill a pass."""
    source = np.arange(len(cells.bound))
    while True:
        (low, high), added = halves(cells), cells.added.copy()
        added[np.arange(len(added)), _cut_axes(cells)] /= 2
        source = np.tile(source, 2)
        if 2 * len(low) > PASS:
            return low, high, source
        twice = cells[np.tile(np.arange(len(added)), 2)]
        cells = replace(twice, low=low, high=high, added=np.tile(added, (2, 1)))


def _cut_axes(cells: Cells) -> Array:
    """The axis (m,) of every cell that adds most to its bound."""
    return np.asarray(np.where(cells.high > cells.low, cells.added, -1.0).argmax(axis=1))


def halves(cells: Cells) -> tuple[Array, Array]:
    """Both halves of every cell, cut across the axis that adds most to its bound."""
    rows, axis = np.arange(len(cells.bound)), _cut_axes(cells)
    first_high, second_low = cells.high.copy(), cells.low.copy()
    first_high[rows, axis] = second_low[rows, axis] = (
        cells.low[rows, axis] + cells.high[rows, axis]
    ) / 2
    return np.concatenate([cells.low, second_low]), np.concatenate([first_high, cells.high])


def _looked_at(
    term: CylinderTerm, best: Best, low: Array, high: Array, places: Array
) -> tuple[Cells, Best]:
    """Cells bounded, and the best of the designs at places too, which are cells of no width."""
    corners = np.concatenate([low, places]), np.concatenate([high, places])
    drawn = term.limits.drawn
    if drawn is None:
        both = term.upper(*corners)
    else:
        first, last = drawn.shrunk(*corners)
        whole = np.flatnonzero(np.all(first <= last, axis=1))
        both = term.upper(first[whole], last[whole])
        both = replace(both, source=whole[both.source])
    cells, designs = both[both.source < len(low)], both[both.source >= len(low)]
    if drawn is not None:  # a cell of no width is a design
        designs = together(designs, cells[np.all(cells.low == cells.high, axis=1)])
    designs = designs[np.isfinite(designs.bound)]
    if len(designs.bound) == 0 or designs.bound.max() <= best[0]:
        return cells, best
    k = int(designs.bound.argmax())
    place, volume = designs.low[k], designs.volume[k]
    place = np.append(place[:3], volume if term.limits.areas.pairs is None else place[3:])
    return cells, (float(designs.bound[k]), place, volume)


def _middles(term: CylinderTerm, cells: Cells) -> Array:
    """Places in the middle of the first cells; of their volumes all vertices allowed there.

    Of the pairs of areas in them the one nearest to their middle.
    """
    low, high = cells.low[:TRIALS].copy(), cells.high[:TRIALS].copy()
    low[:, :3] = high[:, :3] = (low[:, :3] + high[:, :3]) / 2
    if low.shape[1] == 3:
        return low
    if term.limits.areas.pairs is not None:
        low[:, 3:] = term.limits.areas.nearest((low[:, 3:] + high[:, 3:]) / 2)
        if drawn := term.limits.drawn:
            low = drawn.nearest(low, *term.shape.region)
            return np.clip(low, cells.low[:TRIALS], cells.high[:TRIALS])
        return low
    allowed = term.limits.allowed(low, high)
    volume = allowed.volume
    volume = volume + WITHIN * (volume.mean(axis=1, keepdims=True) - volume)
    middle = np.repeat(low[allowed.kept, :3], volume.shape[1], axis=0)
    return np.column_stack([middle, volume.reshape(-1, 2)])
