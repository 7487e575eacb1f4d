"""Gains of their own of position loops alone, without pressure feedback.

What bounds position loops alone is a mode, in which every joint has a share. All gains weigh there
together, so that the slowest loop is hardly faster with gains of their own than with one for all:
raised are the others, which have a small share in the mode. From the largest common gain all loops
that can be raised are raised together, until one can no more; it stays, the rest goes on. This is
done twice, then on a grid that has the frequencies at which the loops found are decided. A finer
grid takes a little of it back, so that a loop here and there could still be faster.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armdesign.arrays import Array, Flags
from armdesign.control.loop_sight import margins_hold
from armdesign.control.loops import Loops
from armdesign.control.tuning import CLOSE, Task, Tuned, safe

NEAR = (0, 0, 25)  # frequencies about each mode alone: margins of so slow loops are missed there
ALONE = 1.05  # factor by which a loop is raised to see whether it can be


def individual(task: Task, common: Tuned) -> Tuned:
    """Controllers (n) with position gains of their own, from the common ones; no smaller."""
    kappa = task.without_units(common.controller)[0]
    near, none = replace(task, loops=Loops.of(task.plant, NEAR)), np.zeros(task.shapes[1])
    grown = near.grown(task.controller(_raised(near, kappa), none))
    raised = _raised(grown, kappa)
    return safe(task, task.controller(raised, none), common)


def _raised(task: Task, kappa: Array) -> Array:
    """Gains κ (n, nq), each as large as the margin allows."""
    free = kappa > 0
    for _ in range(kappa.shape[1]):
        for j in range(kappa.shape[1]):
            alone = kappa.copy()
            alone[:, j] *= ALONE
            free[:, j] = _holds(task, alone, free[:, j])
        if not free.any():
            break
        kappa = _raised_together(task, kappa, free)
    return kappa


def _raised_together(task: Task, kappa: Array, free: Flags) -> Array:
    """Gains κ (n, nq) of which the ``free`` are larger by the largest factor of each pose."""
    low = np.ones(len(kappa))
    slowest = np.where(free, kappa, np.inf).min(axis=1)
    high = np.where(free.any(axis=1), task.highest_alone / slowest, 1.0).clip(1.0)
    while (searched := high > CLOSE * low).any():
        middle = np.sqrt(low * high)
        holds = _holds(task, np.where(free, kappa * middle[:, None], kappa), searched)
        low, high = np.where(holds, middle, low), np.where(searched & ~holds, middle, high)
    return np.where(free, kappa * low[:, None], kappa)


def _holds(task: Task, kappa: Array, asked: Flags) -> Flags:
    """Whether the margin holds at the poses (n,) that are asked for; False at the others."""
    rows, holds = np.flatnonzero(asked), np.zeros(len(asked), dtype=bool)
    controller = task.controller(kappa, np.zeros(task.shapes[1]))
    holds[rows] = margins_hold(task.loops, controller, task.aim.margin, rows)
    return holds
