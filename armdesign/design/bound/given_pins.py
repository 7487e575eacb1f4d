"""Upper bound for given pins: the worst frequency that no bores and rods can exceed.

Stiffness, convex in the areas, is replaced by its chord over the box of allowed areas, and so is
buckling, which is reverse-convex; the multipliers of that semidefinite programme certify the
bound, see ``dual_bound``. Own masses are affine in the areas: see ``bound_of_moving_mass``.
"""

from __future__ import annotations

import math

import numpy as np

from armdesign.arrays import Array
from armdesign.design.program.convex_relaxation import convex_relaxation
from armdesign.design.search.semidefinite import (
    bound_of_moving_mass,
    certificate,
    dual_bound,
    padded,
    programme,
)
from armdesign.design.search.sequential_sdp import Search
from armdesign.errors import InfeasibleError
from armdesign.frequency.modes import hertz

ROUNDS = 6  # of programmes with more poses each
JOINING = 8  # poses at a time
CLOSE = 1e-4  # of ω², between the bound and the lowest pose, where rounds end


def bound_of_areas(search: Search) -> float | None:
    """Worst frequency [Hz] that no areas can exceed with the pins of a search.

    None where no bound is known.
    """
    try:
        enclosed = convex_relaxation(search.problem)
    except InfeasibleError:  # by less than the search lets pass
        return None
    if enclosed is None:
        return None
    linear, low, high = enclosed
    bound = _lowest(
        search,
        (*padded(linear.values, linear.jacobian), np.zeros(len(low)), high - low),
        (low, high),
    )
    return hertz(bound * search.reference) if math.isfinite(bound) else None


def _lowest(search: Search, room: tuple[Array, ...], ends: tuple[Array, Array]) -> float:
    """The lowest bound on ω² over the reference of a few programmes of few poses each."""
    problem, x, rows, bound = search.problem, search.x, search.rows, math.inf
    squared = problem.dynamics.omega_squared(x, rows)
    near = squared.min() if problem.vector.moving_masses else 0.0
    base, slopes = (
        part / search.reference
        for part in problem.dynamics.scaled_stiffness_chords(*ends, rows, x, near)
    )
    light = problem.dynamics.scaled_fixed_mass(x, rows)
    chosen = np.flatnonzero(np.isin(rows, search.active(squared)))
    for _ in range(ROUNDS):
        one = programme(len(chosen), base.shape[1], len(room[0]), len(ends[0]))
        try:
            step = one.solve(base[chosen], slopes[:, chosen], *room)
        except InfeasibleError:  # the solver gave up: what is known so far still holds
            break
        of_chords = dual_bound(step, base[chosen], slopes[:, chosen], *room)
        moving = bound_of_moving_mass(
            of_chords, near / search.reference, certificate(step), light[chosen]
        )
        bound = min(bound, moving)
        lowest = np.linalg.eigvalsh(base + np.einsum("vnij,v->nij", slopes, step.change))[:, 0]
        worse = np.setdiff1d(np.argsort(lowest)[:JOINING], chosen)
        if len(worse) == 0 or lowest.min() > bound * (1 - CLOSE):
            break
        chosen = np.concatenate([chosen, worse])
    return bound
