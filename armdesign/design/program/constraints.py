"""Requirements as constraints c(x) ≥ 0 of the design problem, with exact derivatives.

What they are is in ``conditions.py``; here a design vector becomes a candidate, complex-stepped
along each entry.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armdesign.arrays import Array
from armdesign.design.program.design_vector import RANGE_POSES, STEP
from armdesign.design.program.dynamics import Problem
from armdesign.design.requirements.candidate import Condition, frame_of
from armdesign.design.requirements.lifting import unloaded
from armdesign.design.requirements.relative import conditions, rod_area_factor, static_loads_held
from armdesign.errors import InfeasibleError
from armdesign.hydraulics.buckling import euler_safety
from armdesign.machine.machine import Machine
from armdesign.machine.poses import static_forces
from armdesign.mechanism.arm import RigidPoses
from armdesign.mechanism.linkage.base import Linkage

SLACK = 1e-5  # relative, of every requirement: what a search may miss it by
HOLDING_POSES = 6  # per cylinder, load case and direction
CURVED = ("buckling", "clearance")  # not linear, and not below their tangents, in the areas


@dataclass(frozen=True, eq=False)
class Limits:
    """Constraints c(x) ≥ 0 at one x: names, values, Jacobian, and what each gains from relaxing its limit by 1 %."""

    names: list[str]
    values: Array  # (m,)
    jacobian: Array  # (m, nx)
    relaxation: Array  # (m,)


@dataclass(frozen=True, eq=False)
class Stepped:
    """The design at x as a candidate: a variant for each entry of x, with a complex step along it."""

    problem: Problem
    x: Array

    @property
    def machine(self) -> Machine:
        """See ``Candidate``."""
        return self.problem.machine

    @cached_property
    def areas(self) -> Array:
        """See ``Candidate``."""
        return self.problem.stepped_areas(self.x)

    @cached_property
    def _lengths(self) -> tuple[Array, Array]:
        return self.problem.stepped_strokes(self.x)

    @property
    def closed(self) -> Array:
        """See ``Candidate``."""
        return self._lengths[0]

    @property
    def stroke(self) -> Array:
        """See ``Candidate``."""
        return self._lengths[1]

    @property
    def linkages(self) -> tuple[Linkage, ...]:
        """Every cylinder's pins at x."""
        return self.problem.linkages(self.x)

    @property
    def sweeps(self) -> list[tuple[Array, Array] | None]:
        """See ``Candidate``."""
        return self.problem.stepped_sweeps(self.x)

    def place(self, i: int, name: str) -> Array | None:
        """See ``Candidate``."""
        place = self.linkages[i].place(name)
        if place is None:
            return None
        at = np.tile(np.array(place, dtype=complex), (len(self.x), 1))
        for index, move in self.problem.moves(i).items():
            if move[0] == name:
                at[index, move[1]] += 1j * STEP * self.problem.box
        return at

    def transmission(self, i: int) -> Array:
        """See ``Candidate``."""
        poses, moves = self.problem.ranges[i], self.problem.moves(i)
        assert poses is not None
        cosine, slopes = self.linkages[i].transmission(poses, list(moves.values()))
        stepped = np.tile(cosine.astype(complex), (len(self.x), 1))
        for index, slope in zip(moves, slopes, strict=True):
            stepped[index] += 1j * STEP * slope * self.problem.box
        return stepped

    def moment_arms(self, rigid: RigidPoses) -> Array:
        """See ``Candidate``."""
        return self.problem.geometry(self.x, rigid, derivatives=True).stepped()[1]

    def span(self, i: int, rigid: RigidPoses) -> tuple[Array, Array]:
        """See ``Candidate``."""
        ends = np.tile(
            np.stack(self.linkages[i].ends(rigid))[:, None].astype(complex), (1, len(self.x), 1, 1)
        )
        for index in self.problem.moves(i):
            ends[:, index] = np.stack(self.problem.variant(self.linkages[i], index).ends(rigid))
        return ends[0], ends[1]

    def bare_gravity(self, rigid: RigidPoses) -> Array:
        """See ``Candidate``."""
        known = unloaded(self.problem.bare, rigid)[None]
        return (
            known
            if self.problem.own is None
            else known + self.problem.stepped_own(self.x, rigid)[1]
        )


def limits(problem: Problem, x: Array, holding: Array | None = None) -> Limits:
    """Every requirement at x; holding at the rows given, or at ``holding_rows``."""
    found = list(conditions_at(problem, x, holding))
    room = np.concatenate([c.room - drawn_in(problem, c) for c in found], axis=1)
    easing = np.concatenate([np.broadcast_to(c.easing, c.room.shape) for c in found], axis=1)
    names = [c.name for c in found for _ in range(c.room.shape[1])]
    if problem.ease:
        room = room + np.array([problem.ease.get(name, 0.0) for name in names]) * easing
    kept = np.array([problem.reserve.get(name, 0.0) for name in names])
    return Limits(names, room[0].real - kept, room.imag.T / STEP, 0.01 * easing[0].real)


def drawn_in(problem: Problem, condition: Condition) -> Array | float:
    """Room (b, k) by which the problem's tightening draws a condition in.

    What no variable moves, no rounding moves.
    """
    if not problem.tightening:
        return 0.0
    whole = problem.tightening * condition.care * condition.easing + condition.rounding
    return np.where(
        np.any(condition.room.imag != 0, axis=0), np.broadcast_to(whole, condition.room.shape), 0.0
    )


def conditions_at(problem: Problem, x: Array, holding: Array | None = None) -> Iterator[Condition]:
    """Every requirement at x as its condition.

    Holding at the rows given, or at ``holding_rows``.
    """
    rows = holding_rows(problem, x) if holding is None else holding
    new, frame = Stepped(problem, x), frame_of(problem.machine, problem.requirements, RANGE_POSES)
    yield from conditions(new, frame)
    arm = new.moment_arms(problem.workspace.rigid[problem.held.pose[rows]])
    gravity = problem.stepped_loads(x, problem.held, rows)[1]
    yield from static_loads_held(new, frame, static_forces(arm, gravity, new.areas[:, None, :, 0]))


def buckling_factor(problem: Problem, i: int) -> float:
    """C in rod area ≥ L √(c A1), which keeps the share asked of today's Euler safety."""
    cylinder, pressure = problem.machine.cylinders[i], problem.machine.supply.pressure
    safety = euler_safety(cylinder.bore, cylinder.rod, cylinder.open_length, pressure)
    return rod_area_factor(cylinder.count, pressure, problem.requirements.buckling_share * safety)


def holding_rows(problem: Problem, x: Array, forces: Array | None = None) -> Array:
    """Of the rows ``problem.held`` those at which some cylinder carries most, a few per cylinder, case and direction.

    ``forces`` (n, nc) are the static forces of all those rows at x, if known.
    """
    forces = problem.held_forces(x) if forces is None else forces
    chosen: list[Array] = []
    for k in range(len(problem.machine.payloads)):
        mine = np.flatnonzero(problem.held.payload == k)
        for i in range(forces.shape[1]):
            few = min(HOLDING_POSES, len(mine))
            if few == 0:
                continue
            ends = [few - 1, len(mine) - few]
            order = mine[np.argpartition(forces[mine, i], ends)]
            chosen += [order[:few], order[-few:]]
    return np.unique(np.concatenate(chosen))


# -------------------------------------------------------------------------- relaxation, areas only


def relaxation(problem: Problem) -> tuple[Limits, Array, Array] | None:
    """Linear constraints that every allowed choice of areas meets, and the box of areas that they leave.

    Constraints are given at the box's lower end. Buckling, A1 − A2 ≥ L √(c A1), is reverse-convex:
    the root is replaced by its chord over the box, which lies below it. None where stiffness is
    not a sum of convex functions of one area each (air, compliance, more cylinders than joints) or
    something moves.
    """
    plain = problem.machine.fluid.air == 0 and all(
        f.compliance == 0 for f in problem.machine.actuators
    )
    if (
        not plain
        or problem.moving
        or len(problem.machine.actuators) != len(problem.machine.joints)
    ):
        return None
    x = problem.start
    exact = limits(problem, x)
    linear = np.array([not name.startswith(CURVED) for name in exact.names])
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
        low, high = _box_of(values, jacobian, low, high)
    return Limits(names, values + jacobian @ low, jacobian, np.zeros(len(values))), low, high


def _buckling_chord(problem: Problem, i: int, low: float, high: float) -> tuple[float, Array]:
    """Constant and slopes by x of A1 − A2 − L·chord(√(c A1)) ≥ 0 over the box, relative to today's bore area."""
    cylinder, today = problem.machine.cylinders[i], problem.areas_today[i, 0]
    factor = cylinder.open_length * math.sqrt(buckling_factor(problem, i) / today)
    slope = (
        (math.sqrt(high) - math.sqrt(low)) / (high - low) if high > low else 0.5 / math.sqrt(low)
    )
    areas = problem.stepped_areas(problem.start)[:, i]
    rod = (areas[:, 0] - areas[:, 1]) / today  # linear in x
    row = rod.imag / STEP
    constant = float(rod[0].real - row @ problem.start)
    row[2 * i] -= factor * slope
    return constant - factor * (math.sqrt(low) - slope * low), row


def _box_of(values: Array, jacobian: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """The smallest box around {low ≤ x ≤ high, values + jacobian x ≥ 0}, by a linear programme per side."""
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
