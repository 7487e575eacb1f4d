"""The convex relaxation of the constraints on areas: what every allowed choice of areas meets.

It bounds what any sizes can reach (``bound/given_pins.py``). Buckling, stated by
``requirements/strength.py``, is not convex in the areas and is stated again here, as a chord;
``tests/design/program/test_constraints.py`` and ``tests/design/search/test_semidefinite.py`` tie
the two.
"""

from __future__ import annotations

import math

import numpy as np

from armdesign.arrays import Array
from armdesign.design.program.constraints import Constraints, constraints_at, evaluations_at
from armdesign.design.program.gradient import STEP
from armdesign.design.program.problem import Problem
from armdesign.design.requirements.strength import rod_area_factor
from armdesign.errors import InfeasibleError
from armdesign.hydraulics.buckling import euler_safety


def buckling_factor(problem: Problem, i: int) -> float:
    """The c in rod area ≥ L √(c A1) that keeps the required share of today's Euler safety."""
    cylinder, pressure = problem.machine.cylinders[i], problem.machine.supply.pressure
    safety = euler_safety(cylinder.bore, cylinder.rod, cylinder.open_length, pressure)
    return rod_area_factor(cylinder.count, pressure, problem.requirements.buckling_share * safety)


def convex_relaxation(problem: Problem) -> tuple[Constraints, Array, Array] | None:
    """Linear constraints that every allowed choice of areas meets, and bounds of the areas.

    Constraints are given at the lower bounds. Buckling, A1 − A2 ≥ L √(c A1), is reverse-convex:
    the root is replaced by its chord between the bounds, below it. None where stiffness is
    not a sum of convex functions of one area each (air, compliance, more cylinders than joints) or
    something moves.
    """
    plain = problem.machine.fluid.air == 0 and all(
        f.compliance == 0 for f in problem.machine.actuators
    )
    if (
        not plain
        or problem.vector.moving
        or len(problem.machine.actuators) != len(problem.machine.joints)
    ):
        return None
    x = problem.vector.start
    exact = constraints_at(problem, x)
    curved = {e.name for e in evaluations_at(problem, x) if e.curved}
    linear = np.array([name not in curved for name in exact.names])
    names = [name for name, keep in zip(exact.names, linear, strict=True) if keep]
    names += [f"buckling.{cylinder.name}" for cylinder in problem.machine.cylinders]
    low, high = problem.bounds
    for _ in range(4):
        chords = [
            _buckling_chord(problem, i, low[2 * i], high[2 * i])
            for i in range(len(problem.machine.cylinders))
        ]
        values = np.concatenate(
            [exact.values[linear] - exact.jacobian[linear] @ x, [c for c, _ in chords]]
        )
        jacobian = np.concatenate([exact.jacobian[linear], [slope for _, slope in chords]])
        low, high = _least_bounds(values, jacobian, low, high)
    return Constraints(names, values + jacobian @ low, jacobian, np.zeros(len(values))), low, high


def _buckling_chord(problem: Problem, i: int, low: float, high: float) -> tuple[float, Array]:
    """Constant and slopes by x of (A1 − A2 − L·chord(√(c A1)))/A1 today, for A1 in [low, high]."""
    cylinder, today = problem.machine.cylinders[i], problem.vector.areas_today[i, 0]
    factor = cylinder.open_length * math.sqrt(buckling_factor(problem, i) / today)
    slope = (
        (math.sqrt(high) - math.sqrt(low)) / (high - low) if high > low else 0.5 / math.sqrt(low)
    )
    areas = problem.dynamics.stepped(problem.vector.start).areas[:, i]
    rod = (areas[:, 0] - areas[:, 1]) / today  # linear in x
    row = rod.imag / STEP
    constant = float(rod[0].real - row @ problem.vector.start)
    row[2 * i] -= factor * slope
    return constant - factor * (math.sqrt(low) - slope * low), row


def _least_bounds(values: Array, jacobian: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """The least bounds of {low ≤ x ≤ high, values + jacobian x ≥ 0}, a linear programme each."""
    from scipy.optimize import linprog

    ends = [low.copy(), high.copy()]
    for v in range(len(low)):
        for end, sign in enumerate((1.0, -1.0)):
            cost = np.zeros(len(low))
            cost[v] = sign
            answer = linprog(
                cost, A_ub=-jacobian, b_ub=values, bounds=list(zip(low, high, strict=True))
            )
            if answer.status != 0:
                raise InfeasibleError("areas", "no sizes meet the requirements", "loosen them")
            ends[end][v] = min(max(answer.x[v] - sign * 1e-9, low[v]), high[v])
    return ends[0], ends[1]
