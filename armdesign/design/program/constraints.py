"""Requirements as constraints c(x) ≥ 0 of the design problem, with exact derivatives.

What they are is in ``design/requirements``; here they are stated for the design x, stepped along
each of its entries (``gradient.py``), and moved by the problem's margins.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from armdesign.arrays import Array
from armdesign.design.program.design_vector import RANGE_POSES
from armdesign.design.program.gradient import STEP
from armdesign.design.program.problem import Problem
from armdesign.design.requirements.candidate import reference_of
from armdesign.design.requirements.record import Evaluation
from armdesign.design.requirements.settings import evaluations

CONSTRAINT_TOLERANCE = 1e-5  # relative, of every requirement: what a search may miss it by
HOLDING_POSES = 6  # per cylinder, load case and direction


@dataclass(frozen=True, eq=False)
class Constraints:
    """Constraints c(x) ≥ 0 at one x: values (m,), Jacobian (m, nx), names of requirements.

    ``per_percent`` (m,) is what each value gains where its limit is relaxed by 1 %.
    """

    names: list[str]
    values: Array
    jacobian: Array
    per_percent: Array


def constraints_at(problem: Problem, x: Array, holding: Array | None = None) -> Constraints:
    """Every requirement at x; holding at the rows given, or at ``holding_rows``."""
    evaluated, margins = list(evaluations_at(problem, x, holding)), problem.margins
    values = np.concatenate([e.constraint - drawn_in(problem, e) for e in evaluated], axis=1)
    sensitivity = np.concatenate([e.limit_sensitivity for e in evaluated], axis=1)
    names = [e.name for e in evaluated for _ in range(e.constraint.shape[1])]
    if margins.relaxed:
        relaxed = np.array([margins.relaxed.get(name, 0.0) for name in names])
        values = values + relaxed * sensitivity
    reserve = np.array([margins.reserve.get(name, 0.0) for name in names])
    return Constraints(
        names, values[0].real - reserve, values.imag.T / STEP, 0.01 * sensitivity[0].real
    )


def drawn_in(problem: Problem, evaluation: Evaluation) -> Array | float:
    """By how much the problem's tightening draws a constraint in (b, k).

    What no variable moves, no rounding moves.
    """
    tightening = problem.margins.tightening
    if not tightening:
        return 0.0
    factor, moved = evaluation.tightening_factor, evaluation.constraint.imag != 0
    whole = tightening * factor * evaluation.limit_sensitivity + evaluation.rounding_loss
    return np.where(np.any(moved, axis=0), whole, 0.0)


def evaluations_at(
    problem: Problem, x: Array, holding: Array | None = None
) -> Iterator[Evaluation]:
    """Every requirement at x; holding at the rows given, or at ``holding_rows``."""
    rows = holding_rows(problem, x) if holding is None else holding
    dynamics, new = problem.dynamics, problem.dynamics.stepped(x)
    reference = reference_of(problem.machine, problem.requirements, RANGE_POSES)
    arm = new.moment_arms(problem.workspace.rigid[dynamics.nominal_rows.pose[rows]])
    gravity = dynamics.stepped_inertia_and_gravity(x, dynamics.nominal_rows, rows)[1]
    forces = dynamics.static_forces(arm, gravity, new.areas[:, None])
    return evaluations(new, reference, forces)


def holding_rows(problem: Problem, x: Array, forces: Array | None = None) -> Array:
    """Of the nominal rows those at which some cylinder carries most.

    A few per cylinder, load case and direction. ``forces`` (n, nc) are the static forces of all
    those rows at x, if known.
    """
    forces = problem.dynamics.nominal_forces(x) if forces is None else forces
    payload, chosen = problem.dynamics.nominal_rows.payload, []
    for k in range(len(problem.machine.payloads)):
        of_case = np.flatnonzero(payload == k)
        few = min(HOLDING_POSES, len(of_case))
        for i in range(forces.shape[1] if few else 0):
            ends = [few - 1, len(of_case) - few]
            order = of_case[np.argpartition(forces[of_case, i], ends)]
            chosen += [order[:few], order[-few:]]
    return np.unique(np.concatenate(chosen))
