"""Elastic programme: the design that misses some requirements least while it meets the others.

Frequency is left aside. Sequential linear programmes in a trust region, from several starts:
local, because the problem is not convex in the pins. Bores and rods then go to the grid of a
drawing one after the other, while the rest follows.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np

from armdesign.arrays import Array
from armdesign.design.program.constraints import constraints_of, evaluations_at, holding_rows
from armdesign.design.program.gradient import STEP
from armdesign.design.program.problem import Problem
from armdesign.design.requirements.record import Evaluation
from armdesign.design.search.file_changes import grid_values
from armdesign.design.search.trust_region import Box, TrustRegion, ascend
from armdesign.errors import InfeasibleError

MET = 1e-6  # a share of its limit by which a requirement may be missed
PENALTY = (
    100.0  # of a requirement that must hold, against the largest share of those that may give
)
EACH = 1e-3  # of every other share that is given: what need not give does not
UNKNOWN = 1e3  # share that a requirement is missed by where it is not a number
STARTS = 3  # designs from which requirements are tried: the one at hand, today's, others drawn
DRAWN_SHARE = 0.7  # share of the bounds in which they are drawn
FINE, ROUGH = 1e-4, 1e-3  # shares of what is missed that a step must promise to be made
ANYWHERE, NEARBY = 0.3, 0.05  # trust; the latter for the rest when a size goes to the grid
STEPS, SMALLEST = 40, 1e-7  # of the trust region
LOOKS = 4  # at the whole workspace for poses of larger loads

Groups: TypeAlias = Sequence[Collection[str]]
Bounds: TypeAlias = tuple[Array, Array]  # of x


@dataclass(frozen=True, eq=False)
class Roles:
    """Requirements that may give, in groups of one largest share, and those that must hold.

    Attributes:
        soft: names of those that may, group by group.
        hard: names of those that must.
        most: room that one of the former may give, as a share of its limit, if not any.
    """

    soft: Groups
    hard: Collection[str]
    most: Mapping[str, float] = field(default_factory=dict)

    @cached_property
    def names(self) -> set[str]:
        """All of them."""
        return {*self.hard}.union(*self.soft)

    def most_of(self, name: str) -> float:
        """Room that a requirement may give beside what must hold."""
        return math.inf if name in self.hard else self.most.get(name, math.inf)

    def groups(self, names: Sequence[str]) -> Array:
        """The group of each name, by its number; −1 of what must hold."""
        numbers = {name: g for g, group in enumerate(self.soft) for name in group}
        return np.array([numbers.get(name, -1) for name in names], dtype=int)


@dataclass(frozen=True, eq=False)
class ElasticSolution:
    """The design that misses least.

    Attributes:
        x: the design.
        given: shares of their limits that requirements give.
        missed: shares that the others are missed by.
        tight: requirements that mattered.
    """

    x: Array
    given: float
    missed: float
    tight: frozenset[str] = frozenset()

    @property
    def met(self) -> bool:
        """Whether it misses nothing."""
        return max(self.given, self.missed) <= MET

    @property
    def cost(self) -> float:
        """Shares given and missed, by which solutions are compared."""
        return self.given + PENALTY * self.missed


@dataclass(frozen=True, eq=False)
class Rooms:
    """Room of a design's requirements, as a share of each limit, and its Jacobian."""

    x: Array
    names: list[str]  # of the requirements
    of: Array  # number of the requirement of every row (m,)
    room: Array  # (m,)
    jacobian: Array  # (m, nx)
    given: float
    short: float  # of what must hold

    @property
    def merit(self) -> float:
        """Less what is given and missed."""
        return -(self.given + PENALTY * self.short)

    @cached_property
    def missed(self) -> frozenset[str]:
        """Requirements that the design misses."""
        return frozenset(self.names[k] for k in self.of[~(self.room >= -MET)])

    def conflict(self, names: Collection[str], bounds: Bounds) -> frozenset[str]:
        """Those of some requirements, linearised here, that no design in the bounds meets.

        With multipliers that prove it; empty if one does.
        """
        if self.missed.isdisjoint(names):
            return frozenset()
        wanted = np.array([name in names for name in self.names])[self.of]
        kept = {name: getattr(self, name)[wanted] for name in ("of", "room", "jacobian")}
        part = replace(self, **kept)
        low, high = bounds
        _, cost, tight = _step(part, Roles((), names), (low - self.x, high - self.x))
        return tight if cost > PENALTY * MET else frozenset()


@dataclass(eq=False)
class ElasticProgramme:
    """The requirements of a problem, drawn in as it says, near a design.

    Attributes:
        problem: whose requirements count.
        x: the design at hand.
        holding: rows at which static forces are watched; more join.
        depth: share by which all limits are drawn in besides: what misses that least lies furthest
            inside.
    """

    problem: Problem
    x: Array
    holding: Array
    depth: float = 0.0

    @property
    def names(self) -> list[str]:
        """Names of all requirements."""
        return list(dict.fromkeys(self.rooms(self.x).names))

    def violated(self, x: Array) -> set[str]:
        """Requirements that x misses."""
        return set(self.rooms(x).missed)

    def feasible(self, names: Collection[str], starts: int = STARTS) -> bool:
        """Whether some design meets these requirements, sought from so many starts."""
        return not names or self.solve(Roles((), names), ROUGH, starts).met

    @np.errstate(invalid="ignore", divide="ignore")
    def amounts(self, x: Array) -> dict[str, tuple[Evaluation, float]]:
        """Each requirement evaluated at x, and by how much of its unit it is missed."""
        amounts = {}
        for c in evaluations_at(self.problem, x, holding_rows(self.problem, x)):
            missed = (c.limit - c.value[0].real) * (1 if c.at_least else -1)
            _, sensitivity, drawn_in = constraints_of(self.problem, [c])
            kept = np.broadcast_to(drawn_in, sensitivity.shape)[0].real
            size = abs(c.limit) if c.slack_scale is None else c.slack_scale
            amount = float(np.max(missed + kept / _constraint_per_slack([c], sensitivity) * size))
            amounts[c.name] = c, max(0.0, amount)
        return amounts

    def solve(
        self, roles: Roles, tolerance: float = FINE, starts: int = STARTS
    ) -> ElasticSolution:
        """The design that meets what must hold and misses the groups least.

        Each start is followed until a step promises less than a share ``tolerance`` of what is
        missed.
        """
        low, high = bounds = self.problem.bounds
        best: ElasticSolution | None = None
        for x in self._starts(starts):
            # sizes that are chosen are not today's
            solution = self._solve_from(np.clip(x, low, high), roles, bounds, ANYWHERE, tolerance)
            if best is None or solution.cost < best.cost - MET:
                best = solution
            if best.met:
                break
        assert best is not None
        return best

    def _starts(self, count: int) -> Iterator[Array]:
        """The design at hand, today's and designs with drawn pins, so many that differ."""
        random = np.random.default_rng(0)
        low, high = self.problem.bounds
        pins = np.array([v.pin is not None for v in self.problem.vector.variables])
        known = [self.x]
        if not np.array_equal(self.x, self.problem.vector.start):
            known.append(self.problem.vector.start)
        yield from known[:count]
        for _ in range(count - len(known) if pins.any() else 0):
            x = self.x.copy()
            x[pins] = random.uniform(DRAWN_SHARE * low[pins], DRAWN_SHARE * high[pins])
            yield x

    def on_grid(self, solution: ElasticSolution, roles: Roles) -> ElasticSolution:
        """From a solution to one on the grid: bores and rods, and pins where it is coarse."""
        bounds = self.problem.bounds
        for entry in range(len(self.x)):
            tried = list(self._with_size(solution, entry, roles, bounds))
            if tried:
                solution, bounds = min(tried, key=lambda pair: pair[0].cost)
        return solution

    def _with_size(
        self, solution: ElasticSolution, entry: int, roles: Roles, bounds: Bounds
    ) -> Iterator[tuple[ElasticSolution, Bounds]]:
        """Solutions with one area as the grid has it, and the bounds that hold it there.

        The first that costs nothing.
        """
        for value in grid_values(self.problem, solution.x, entry):
            low, high, x = (part.copy() for part in (*bounds, solution.x))
            low[entry] = high[entry] = x[entry] = value
            other = self._solve_from(x, roles, (low, high), NEARBY, ROUGH)
            yield other, (low, high)
            if other.cost < solution.cost + MET:
                break

    def _solve_from(
        self, x: Array, roles: Roles, bounds: Bounds, trust: float, tolerance: float
    ) -> ElasticSolution:
        """The solution near x; no pose of the workspace is loaded more than the watched ones."""
        with np.errstate(invalid="ignore", divide="ignore"):
            for _ in range(LOOKS):
                solution = self._descend(x, roles, bounds, trust, tolerance)
                if not any(name.startswith("holding.") for name in roles.names):
                    break
                rows = holding_rows(self.problem, solution.x)
                if np.isin(rows, self.holding).all():
                    break
                self.holding = np.union1d(self.holding, rows).astype(int)
                x = solution.x
        return solution

    def _descend(
        self, x: Array, roles: Roles, bounds: Bounds, trust: float, tolerance: float
    ) -> ElasticSolution:
        """Linear programmes in a trust region, by the watched rows."""
        tight: frozenset[str] = frozenset()

        def step(at: Rooms, box: Box, _: Sequence[Rooms]) -> tuple[Rooms, float] | None:
            nonlocal tight
            if at.given + at.short < 0.1 * MET:
                return None
            change, foreseen, tight = _step(at, roles, box)
            promised = -at.merit - foreseen
            if promised < -tolerance * at.merit:
                return None
            return self.rooms(at.x + change, roles), promised

        best = ascend(self.rooms(x, roles), step, bounds, TrustRegion(trust, SMALLEST, STEPS))
        return ElasticSolution(best.x, best.given, best.short, tight)

    # a dead centre or an open four-bar on the way is no better
    @np.errstate(invalid="ignore", divide="ignore")
    def rooms(self, x: Array, roles: Roles | None = None) -> Rooms:
        """Room of the requirements that have a role (all must hold if None) at x."""
        wanted = None if roles is None else roles.names
        at_x = evaluations_at(self.problem, x, self.holding, wanted)
        kept = [c for c in at_x if wanted is None or c.name in wanted]
        values, sensitivity, drawn = constraints_of(self.problem, kept)
        room = (values - drawn) / _constraint_per_slack(kept, sensitivity) - self.depth
        names = [c.name for c in kept]
        of = np.repeat(np.arange(len(kept)), [c.constraint.shape[1] for c in kept])
        if roles is not None:  # beyond what it may give it must hold
            most = np.array([roles.most_of(name) for name in names])
            limited = np.isfinite(most[of])
            room = np.concatenate([room, room[:, limited] + most[of[limited]]], axis=1)
            of = np.concatenate([of, len(names) + of[limited]])
            names = [*names, *(f"{name} at most" for name in names)]
        costs = _costs(room[0].real, of, names, roles or Roles((), ()))
        return Rooms(x, names, of, room[0].real, room.imag.T / STEP, *costs)


def _constraint_per_slack(evaluated: Sequence[Evaluation], sensitivity: Array) -> Array:
    """Room of conditions per relative slack (m,); of what nothing changes, one.

    ``sensitivity`` is their gain per 100 % of the limits (b, m).
    """
    counts = [c.constraint.shape[1] for c in evaluated]
    # room is a share of that scale already
    scaled = np.repeat([c.slack_scale is not None for c in evaluated], counts)
    gain = sensitivity[0].real
    return np.where(~scaled & (gain > 0), gain, 1.0)


def _costs(room: Array, of: Array, names: Sequence[str], roles: Roles) -> tuple[float, float]:
    """Shares that the groups give, and that the others miss.

    Groups give the sum of their largest shares, and a little of every share.
    """
    group = roles.groups(names)[of]
    short = np.where(np.isfinite(room), np.maximum(-room, 0.0), UNKNOWN)
    largest = sum(float(short[group == g].max(initial=0.0)) for g in range(len(roles.soft)))
    return largest + EACH * float(short[group >= 0].sum()), float(short[group < 0].sum())


def linear_programme(
    at: Rooms, roles: Roles, box: Box
) -> tuple[Array, Array, Array, Array, Array]:
    """Linear programme of one step: its rows of ``at``, costs, A and b of A y ≤ b, ends of y.

    least Σ t + Σ w e  with  c + C d + e ≥ 0,  e ≥ 0,  and e ≤ t of its group, w = EACH for the
    soft ones, w = PENALTY for the others, of y = (d, t, e) with the change d of x.
    """
    low, high = box
    reach = np.minimum(at.jacobian * low, at.jacobian * high).sum(axis=1)
    near = np.flatnonzero(np.isfinite(at.room) & (at.room + reach < 0))
    m, nx, count = len(near), len(low), len(roles.soft)
    group = roles.groups(at.names)[at.of[near]]
    gives = group >= 0
    slack, excess = np.zeros(count + m), np.eye(m)
    member = (group[:, None] == np.arange(count)).astype(float)
    limits = np.hstack([-at.jacobian[near], np.zeros((m, count)), -excess])
    shared = np.hstack([np.zeros((m, nx)), -member, excess])[gives]
    return (
        near,
        np.concatenate([np.zeros(nx), np.ones(count), np.where(gives, EACH, PENALTY)]),
        np.concatenate([limits, shared]),
        np.concatenate([at.room[near], np.zeros(int(gives.sum()))]),
        np.array([[*low, *slack], [*high, *(slack + np.inf)]]).T,
    )


def _step(at: Rooms, roles: Roles, box: Box) -> tuple[Array, float, frozenset[str]]:
    """The best step: change of x, cost foreseen, requirements with a multiplier."""
    from scipy.optimize import linprog

    near, costs, limits, least, ends = linear_programme(at, roles, box)
    answer = linprog(costs, A_ub=limits, b_ub=least, bounds=ends)
    if answer.status != 0:
        raise InfeasibleError(
            "design", f"the search for a conflict gave up ({answer.message})", "relax requirements"
        )
    held = near[np.abs(answer.ineqlin.marginals[: len(near)]) > 1e-9]
    return answer.x[: len(at.x)], float(answer.fun), frozenset(at.names[k] for k in at.of[held])
