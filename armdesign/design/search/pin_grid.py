"""Pins on a coarse drawing grid: a mixed-integer linear programme about a design.

Coordinates move by at most a few steps of the grid, so that stiffness and requirements are almost
linear there. Of

    max t − penalty · Σ e   with   uᵀ(A_j + Σ x_v B_jv) u ≥ t,   c + C x + e ≥ 0,   e ≥ 0

for poses j, directions u and coordinates x on the grid HiGHS finds the optimum. Directions are
added until t is the lowest eigenvalue (Kelley's cutting planes), and the programme is set up again
where the answer lies until no answer is better.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from armdesign.arrays import Array
from armdesign.design.search.file_changes import grid_of
from armdesign.design.search.sequential_sdp import PENALTY, Linearised, Search, Trial
from armdesign.errors import InfeasibleError

REACH = 2  # steps of the grid that a coordinate may move to either side
ROUNDS = 4  # of setting up again where the answer lies
CUTS = 8  # of adding directions, until t is
CLOSE = 1e-6  # that near to the lowest eigenvalue
NODES, GAP = 2_000, 1e-5  # of branch and bound


def with_pins_on_grid(search: Search) -> Search:
    """The search with all coordinates that moved on the drawing grid, where lengths are coarse."""
    grid = DesignGrid.of(search)
    if not grid.entries:
        return search
    best = _solved(search, search.trial(), grid)
    for _ in range(ROUNDS):
        answer = _solved(search, best, grid)
        if answer.merit <= best.merit:
            break
        best = answer
    return search.taking(best)


@dataclass(frozen=True, eq=False)
class DesignGrid:
    """Entries of x that lie on a grid, x = origin + step · k, and the box of the whole numbers k.

    All other entries stay.
    """

    entries: list[int]
    origin: Array
    step: Array
    low: Array
    high: Array

    @classmethod
    def of(cls, search: Search) -> DesignGrid:
        """The grid around a search, within its bounds; today's place where no point is within."""
        rows = []
        for entry in map(int, np.flatnonzero(search.problem.vector.is_coordinate)):
            of_entry = grid_of(search.problem, search.x, entry)
            if of_entry is None:
                continue
            origin, step = of_entry
            at = (search.x[entry] - origin) / step
            low, high = ((end[entry] - origin) / step for end in search.bounds)
            least = max(math.ceil(low - 1e-9), math.floor(at) - REACH + 1)
            most = min(math.floor(high + 1e-9), math.ceil(at) + REACH - 1)
            known = (entry, origin, step, least, most)
            rows.append(known if least <= most else (entry, 0.0, 1.0, 0, 0))
        entries, *columns = zip(*rows, strict=True) if rows else ((), *4 * ((),))
        return cls(list(entries), *(np.array(column, dtype=float) for column in columns))


def _solved(search: Search, about: Trial, grid: DesignGrid) -> Trial:
    """The best design on the grid by stiffness and requirements linear about a trial."""
    offset = np.zeros(len(about.x))
    offset[grid.entries] = grid.origin - about.x[grid.entries]
    ends = [offset.copy(), offset.copy()]
    for end, numbers in zip(ends, (grid.low, grid.high), strict=True):
        end[grid.entries] += grid.step * numbers
    model = search.linearised(about, search.active(about.squared), (ends[0], ends[1]))
    return search.trial(about.x + _integer_step(model, offset, grid))


def _integer_step(model: Linearised, offset: Array, grid: DesignGrid) -> Array:
    """The best change of x to a point of the grid in a linearised problem.

    Raises:
        InfeasibleError: branch and bound gave up.
    """
    from scipy.optimize import Bounds, LinearConstraint, milp

    entries, count, m = grid.entries, len(grid.entries), len(model.value)
    base = model.base + np.einsum("v,vnij->nij", offset, model.slopes)
    slopes = grid.step[:, None, None, None] * model.slopes[entries]
    value = model.value + model.jacobian @ offset
    columns = [model.jacobian[:, entries] * grid.step, np.zeros((m, 1)), np.eye(m)]
    limits = LinearConstraint(np.hstack(columns), -value, np.inf)
    rows, bounds_of_rows = np.empty((0, count + 1 + m)), np.empty(0)
    directions = np.linalg.eigh(base)[1].swapaxes(1, 2)  # (n, direction, nq)
    for _ in range(CUTS):
        constant = np.einsum("nki,nij,nkj->nk", directions, base, directions).ravel()
        slope = np.einsum("nki,vnij,nkj->nkv", directions, slopes, directions).reshape(-1, count)
        further_columns = np.hstack([-np.ones((len(slope), 1)), np.zeros((len(slope), m))])
        rows = np.concatenate([rows, np.hstack([slope, further_columns])])
        bounds_of_rows = np.concatenate([bounds_of_rows, -constant])
        answer = milp(
            np.concatenate([np.zeros(count), [-1.0], np.full(m, PENALTY)]),
            integrality=np.concatenate([np.ones(count), np.zeros(1 + m)]),
            bounds=Bounds(
                np.concatenate([grid.low, [-np.inf], np.zeros(m)]),
                np.concatenate([grid.high, np.full(1 + m, np.inf)]),
            ),
            constraints=[limits, LinearConstraint(rows, bounds_of_rows, np.inf)],
            options={"node_limit": NODES, "mip_rel_gap": GAP},
        )
        if answer.x is None:
            raise InfeasibleError("design step", answer.message, "loosen the requirements")
        numbers, reached = np.round(answer.x[:count]), answer.x[count]
        size, vectors = np.linalg.eigh(base + np.einsum("v,vnij->nij", numbers, slopes))
        if size.min() > reached - CLOSE:
            break
        directions = vectors[:, :, :1].swapaxes(1, 2)
    change = offset.copy()
    change[entries] += grid.step * numbers
    return change
