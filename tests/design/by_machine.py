"""Derivatives by differences, and frequencies of the machine that a design vector describes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from armdesign.design.program.problem import Problem
from armdesign.frequency.modes import lowest_frequency
from tests.checks import DIFFERENCE
from tests.design.designs import as_machine

STEP = 1e-4  # of x; rounding ~1e-11; so small that no sampled extreme changes place


def slopes(function: Callable[[np.ndarray], np.ndarray], x: np.ndarray) -> np.ndarray:
    """∂function/∂x, x in front, by eighth-order central differences."""
    columns = []
    for unit in STEP * np.eye(len(x)):
        pairs = [
            c * (function(x + k * unit) - function(x - k * unit))
            for k, c in enumerate(DIFFERENCE, start=1)
        ]
        columns.append(sum(pairs) / STEP)
    return np.stack(columns)


def true_frequencies(problem: Problem, x: np.ndarray) -> np.ndarray:
    """Lowest coupled frequency [Hz] of every row, by ``Machine`` as x describes it."""
    machine = as_machine(problem, x)
    lowest = np.empty(len(problem.dynamics.rows))
    for k, payload in enumerate(machine.payloads):
        chosen = problem.dynamics.rows.payload == k
        rigid = problem.workspace.rigid[problem.dynamics.rows.pose[chosen]]
        lowest[chosen] = lowest_frequency(machine.with_payload(payload.name).evaluate(rigid))
    return lowest
