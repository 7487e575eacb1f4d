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
from armdesign.design.requirements.candidate import Condition, frame_of
from armdesign.design.requirements.relative import conditions, static_loads_held
from armdesign.machine.poses import static_forces

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
    conditions = list(conditions_at(problem, x, holding))
    margins = problem.margins
    value = np.concatenate([c.room - drawn_in(problem, c) for c in conditions], axis=1)
    gain = np.concatenate([np.broadcast_to(c.easing, c.room.shape) for c in conditions], axis=1)
    names = [c.name for c in conditions for _ in range(c.room.shape[1])]
    if margins.relaxed:
        value = value + np.array([margins.relaxed.get(name, 0.0) for name in names]) * gain
    reserve = np.array([margins.reserve.get(name, 0.0) for name in names])
    return Constraints(names, value[0].real - reserve, value.imag.T / STEP, 0.01 * gain[0].real)


def drawn_in(problem: Problem, condition: Condition) -> Array | float:
    """Room (b, k) by which the problem's tightening draws a condition in.

    What no variable moves, no rounding moves.
    """
    tightening = problem.margins.tightening
    if not tightening:
        return 0.0
    whole = tightening * condition.care * condition.easing + condition.rounding
    return np.where(
        np.any(condition.room.imag != 0, axis=0), np.broadcast_to(whole, condition.room.shape), 0.0
    )


def conditions_at(problem: Problem, x: Array, holding: Array | None = None) -> Iterator[Condition]:
    """Every requirement at x as its condition.

    Holding at the rows given, or at ``holding_rows``.
    """
    rows = holding_rows(problem, x) if holding is None else holding
    dynamics = problem.dynamics
    new = dynamics.stepped(x)
    frame = frame_of(problem.machine, problem.requirements, RANGE_POSES)
    yield from conditions(new, frame)
    arm = new.moment_arms(problem.workspace.rigid[dynamics.nominal_rows.pose[rows]])
    gravity = dynamics.stepped_inertia_and_gravity(x, dynamics.nominal_rows, rows)[1]
    yield from static_loads_held(new, frame, static_forces(arm, gravity, new.areas[:, None, :, 0]))


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
