"""What jobs cost in counts, which are the same on every machine: ``Counts`` of whatever runs.

Poses whose inertia is computed, rows of the design problem, semidefinite programmes, factorised
matrices (Cholesky, eigenvalues, and one for every iteration of an interior point), cells of the
upper bound, and evaluations of the plant's right-hand side.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import prod
from typing import Any
from unittest import mock

import clarabel
import numpy as np

from armdesign.design.bound.cylinder_term import CylinderTerm
from armdesign.design.program.dynamics import Dynamics
from armdesign.machine.machine import Machine
from armdesign.simulation.controlled_plant import ControlledPlant
from armdesign.simulation.dormand_prince import Steps
from armdesign.simulation.plant.plant import Plant

FACTORISATIONS = ("cholesky", "eigh", "eigvalsh")


@contextmanager
def counting() -> Iterator[Counter[str]]:
    """Counts of what runs inside, in this process."""
    counts: Counter[str] = Counter()

    def counted(owner: Any, method: str, name: str, size: Callable[..., int]) -> Any:
        original = getattr(owner, method)

        def wrapped(*args: Any, **options: Any) -> Any:
            counts[name] += size(*args)
            return original(*args, **options)

        return mock.patch.object(owner, method, wrapped)

    def solver(*data: Any) -> Any:
        counts["programmes"] += 1
        return mock.Mock(solve=lambda: solved(original_solver(*data)))

    def solved(one: Any) -> Any:
        answer = one.solve()
        counts["factorisations"] += answer.iterations
        return answer

    original_solver = clarabel.DefaultSolver
    patches = [
        counted(Machine, "evaluate", "poses", lambda _, rigid: len(rigid)),
        counted(Dynamics, "_of_rows", "rows", _rows),
        counted(CylinderTerm, "upper", "cells", lambda _, low, high: len(low)),
        counted(Plant, "evaluate", "right_hand_sides", lambda _, state, command: len(state)),
        counted(ControlledPlant, "rates", "right_hand_sides", lambda _, time, state: len(state)),
        _counting_steps(counts),
        mock.patch.object(clarabel, "DefaultSolver", solver),
        *(counted(np.linalg, name, "factorisations", _matrices) for name in FACTORISATIONS),
    ]
    for patch in patches:
        patch.start()
    try:
        yield counts
    finally:
        for patch in patches:
            patch.stop()


def _counting_steps(counts: Counter[str]) -> Any:
    """Counts the right-hand sides of compiled steps: six of each case and step."""
    original = ControlledPlant.take_steps

    def counted(plant: ControlledPlant, most: int, steps: Steps) -> tuple[int, int]:
        taken, halted = original(plant, most, steps)
        counts["right_hand_sides"] += 6 * taken * len(plant.start)
        return taken, halted

    return mock.patch.object(ControlledPlant, "take_steps", counted)


def _rows(dynamics: Dynamics, x: Any, rows: Any) -> int:
    return len(range(len(dynamics.rows))[rows]) if isinstance(rows, slice) else len(rows)


def _matrices(matrix: Any) -> int:
    """Matrices in a stack."""
    return prod(np.shape(matrix)[:-2])
