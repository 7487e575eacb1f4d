"""Local searches over shares of ranges, with conditions: SLSQP of NLopt.

SciPy has the same method (Kraft 1988), but to import it takes a tenth of the time of a map.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np

from armdesign.arrays import Array

HELD = 1e-9  # by which conditions may be missed
Value: TypeAlias = Callable[[Array], tuple[float, Array]]  # and its gradient (n,), at shares (n,)
Conditions: TypeAlias = Callable[[Array], tuple[Array, Array]]  # values (m,) and slopes (m, n)


def local_minimum(
    value: Value,
    start: Array,
    accuracy: float,
    positive: Sequence[Conditions] = (),
    zero: Sequence[Conditions] = (),
    most: int = 100,
) -> Array:
    """Shares (n,) from 0 to 1 at which a descent from a start (n,) ends; conditions may be missed.

    Args:
        value: of which the least is sought, with its gradient.
        start: where the search begins.
        accuracy: change of the value at which it ends.
        positive: conditions whose values are to be 0 or more.
        zero: conditions whose values are to be 0.
        most: evaluations of the value.
    """
    import nlopt

    def valued(x: Array, gradient: Array) -> float:
        found, slopes = value(x)
        if gradient.size:
            gradient[:] = slopes
        return found

    search: Any = nlopt.opt(nlopt.LD_SLSQP, len(start))
    search.set_lower_bounds(0.0)
    search.set_upper_bounds(1.0)
    search.set_min_objective(valued)
    search.set_ftol_abs(accuracy)
    search.set_maxeval(most)
    for conditions in positive:
        count = len(conditions(start)[0])
        search.add_inequality_mconstraint(_negative(conditions), np.full(count, HELD))
    for conditions in zero:
        count = len(conditions(start)[0])
        search.add_equality_mconstraint(_negative(conditions), np.full(count, HELD))
    try:
        end = search.optimize(np.clip(start, 0.0, 1.0))
    except (nlopt.RoundoffLimited, RuntimeError):  # no step leads on
        return start
    return end if np.isfinite(end).all() else start


def _negative(conditions: Conditions) -> Callable[[Array, Array, Array], None]:
    """Conditions as NLopt has them: 0 or less."""

    def negative(values: Array, x: Array, slopes: Array) -> None:
        found, given = conditions(x)
        values[:] = -found
        if slopes.size:
            slopes[:] = -given

    return negative


def with_slopes(function: Callable[[Array], Array], step: float = 1e-7) -> Conditions:
    """Values (m,) of a function of many shares (k, n), as conditions: slopes by differences."""

    def conditions(x: Array) -> tuple[Array, Array]:
        ahead = np.where(x + step <= 1.0, step, -step)
        found = function(x + np.concatenate([np.zeros((1, len(x))), np.diag(ahead)]))
        return found[0], (found[1:] - found[0]).T / ahead

    return conditions
