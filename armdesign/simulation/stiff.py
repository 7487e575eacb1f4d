"""A stiff case alone, by LSODA (Petzold 1983), which turns implicit by itself, and back."""

from __future__ import annotations

import warnings
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from armdesign.arrays import Array
from armdesign.simulation.dormand_prince import INSTANT, Between

FIRST_STEP = 1e-4  # [s], at most


class Limits(NamedTuple):
    """Settings of a case that is finished alone."""

    longest: float  # step [s]
    tolerance: float  # of a step's error, relative and absolute
    gain: float  # least time [s] to gain in a ``window``
    window: int  # steps


def integrate_stiff(
    rates: Callable[[float, Array], Array],
    take: Callable[[float, Array, Callable[[], Between]], None],
    begin: float,
    end: float,
    state: Array,
    limits: Limits,
) -> bool:
    """Whether LSODA takes a case from ``begin`` to ``end`` [s].

    If not, it has failed, met a jump or rates that are no numbers, or gained too little: a jump
    taken for steep rates keeps its steps short for ever.

    Args:
        rates: ẏ at a time and state (m,).
        take: is called with every step: its end, the state there, and a function that gives the
            states (m, k) at times within it.
        begin: [s].
        end: [s].
        state: at ``begin`` (m,).
        limits: of steps.
    """
    from scipy.integrate import LSODA

    def finite(time: float, at: Array) -> Array:
        slope = rates(time, at)
        if not np.isfinite(slope).all():
            raise FloatingPointError
        return slope

    tolerance, marks = limits.tolerance, deque[float](maxlen=limits.window)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # LSODA warns and fails; the caller goes on otherwise
        try:
            first = min(FIRST_STEP, limits.longest, end - begin)
            steps = {"max_step": limits.longest, "rtol": tolerance, "atol": tolerance}
            solver = LSODA(finite, begin, state, end, first, **steps)
            while solver.status == "running":
                marks.append(solver.t)
                solver.step()
                stalled = solver.t - solver.t_old < INSTANT * max(solver.t, 1.0)
                if solver.status == "failed" or stalled:
                    return False
                take(solver.t, solver.y, solver.dense_output)
                slow = len(marks) == limits.window and solver.t - marks[0] < limits.gain
                if slow and solver.status == "running":
                    return False
        except FloatingPointError:
            return False
    return True
