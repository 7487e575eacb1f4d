"""Requirements as constraints c(x) ≥ 0 of the design problem, and their convex relaxation.

What they are is in ``design/requirements``; here they are stated for the design x, stepped along
each of its entries (``gradient.py``), and moved by the problem's margins.

The relaxation is what every allowed choice of areas meets; it bounds what sizes can reach
(``bound/certificate.py``). Buckling, of ``requirements/strength.py``, is not convex in the areas
and is stated again, as a chord; ``tests/design/program/test_constraints.py`` and
``tests/design/search/test_semidefinite.py`` tie the two.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from armdesign.arrays import Array
from armdesign.design.program.design_vector import PROGRAMME_POSES
from armdesign.design.program.gradient import STEP
from armdesign.design.program.problem import Problem
from armdesign.design.requirements.candidate import reference_of
from armdesign.design.requirements.record import Evaluation
from armdesign.design.requirements.settings import evaluations
from armdesign.design.requirements.strength import rod_area_factor
from armdesign.design.requirements.strokes_and_boxes import range_covered
from armdesign.errors import InfeasibleError
from armdesign.hydraulics.cylinder_build import euler_safety
from armdesign.machine.file.schema import share_of

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
    values, sensitivity, drawn_in = constraints_of(problem, evaluated)
    values = values - drawn_in
    names = [e.name for e in evaluated for _ in range(e.constraint.shape[1])]
    if margins.relaxed:
        relaxed = np.array([margins.relaxed.get(name, 0.0) for name in names])
        values = values + relaxed * sensitivity
    reserve = np.array([margins.reserve.get(name, 0.0) for name in names])
    return Constraints(
        names, values[0].real - reserve, values.imag.T / STEP, 0.01 * sensitivity[0].real
    )


def constraints_of(
    problem: Problem, evaluated: Sequence[Evaluation]
) -> tuple[Array, Array, Array | float]:
    """Constraints of requirements side by side (b, m), their gain per 100 % of the limits.

    And by how much a problem draws them in: what no variable moves, no rounding moves.
    """
    values, sensitivity = (
        np.concatenate([getattr(e, name) for e in evaluated], axis=1)
        for name in ("constraint", "limit_sensitivity")
    )
    tightening = problem.margins.tightening
    if not tightening:
        return values, sensitivity, 0.0
    counts = [e.constraint.shape[1] for e in evaluated]
    factor, loss = (
        np.repeat([getattr(e, name) for e in evaluated], counts)
        for name in ("tightening_factor", "rounding_loss")
    )
    moved = np.any(values.imag != 0, axis=0)
    return values, sensitivity, np.where(moved, tightening * factor * sensitivity + loss, 0.0)


def evaluations_at(
    problem: Problem, x: Array, holding: Array | None = None, wanted: Collection[str] | None = None
) -> Iterator[Evaluation]:
    """Every requirement at x; holding at the rows given, or at ``holding_rows``.

    If names are ``wanted``, these, and others of their families.
    """
    dynamics, new = problem.dynamics, problem.dynamics.stepped(x)
    reference = reference_of(problem.machine, problem.requirements, PROGRAMME_POSES)

    def forces() -> Array:
        rows = holding_rows(problem, x) if holding is None else holding
        arm = new.moment_arms(dynamics.loaded(rows))
        gravity = dynamics.stepped_nominal_gravity(x, rows)
        return dynamics.static_forces(arm, gravity, new.areas[:, None])

    yield from evaluations(new, reference, forces, wanted)
    for i, lengths in enumerate(problem.vector.chosen_lengths):
        if lengths is not None:
            yield from range_covered(new, reference, i)


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


def least_rod_area_factor(problem: Problem, i: int) -> float:
    """The c in rod area ≥ L √(c A1) that keeps the required share of today's Euler safety."""
    cylinder = problem.machine.cylinders[i]
    pressure = cylinder.available_pressure(problem.machine.supply)
    share = share_of(problem.requirements.buckling_share, cylinder.name)
    safety = euler_safety(cylinder.bore, cylinder.rod, cylinder.open_length, pressure)
    return rod_area_factor(cylinder.count, pressure, share * safety)


def convex_relaxation(problem: Problem) -> tuple[Constraints, Array, Array] | None:
    """Linear constraints that every allowed choice of areas meets, and bounds of the areas.

    Constraints are given at the lower bounds. Buckling, A1 − A2 ≥ L √(c A1), is reverse-convex:
    the root is replaced by its chord between the bounds, below it. None where stiffness is
    not a sum of convex functions of one area each (air, compliance, more cylinders than joints) or
    something moves.
    """
    plain = problem.machine.fluid.air == 0 and all(
        one.compliance == 0 for one in problem.machine.actuators
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
    factor = cylinder.open_length * math.sqrt(least_rod_area_factor(problem, i) / today)
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
