"""Elastic limits: the design that misses some requirements least while it meets the others.

Frequency is left aside. Sequential linear programmes in a trust region, from several starts:
local, because the problem is not convex in the pins. Bores and rods then go to the grid of a
drawing one after the other, while the rest follows.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from armdesign.arrays import Array
from armdesign.design.program.constraints import drawn_in, evaluations_at, holding_rows
from armdesign.design.program.gradient import STEP
from armdesign.design.program.problem import Problem
from armdesign.design.requirements.record import Evaluation
from armdesign.design.search.grid import grid_sizes
from armdesign.errors import InfeasibleError

MET = 1e-6  # a share of its limit by which a requirement may be missed
STEPS = 40
PRICE = 100.0  # of a requirement that must hold, against the largest share of those that may give
EACH = 1e-3  # of every other share that is given: what need not give does not
STARTS = 3  # designs from which requirements are tried: the one at hand, today's, others drawn
FINE, ROUGH = 1e-4, 1e-3  # shares of what is missed that a step must promise to be made
NEARBY = 0.05  # how far the rest may go at first when a size goes to the grid

Groups: TypeAlias = Sequence[
    Collection[str]
]  # requirements that give, those of a group by a common share at most


@dataclass(frozen=True, eq=False)
class _Missed:
    """Requirements at one x: room as a share of the limit, its Jacobian, and the requirement of each row."""

    names: list[str]
    room: Array  # (m,)
    jacobian: Array  # (m, nx)


@dataclass(frozen=True, eq=False)
class Answer:
    """The design that misses least: shares given, what is missed besides, and requirements that mattered."""

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
        """What answers are compared by."""
        return self.given + PRICE * self.missed


@dataclass(eq=False)
class Elastic:
    """The limits of a problem, drawn in as it says, near the design ``x``.

    ``holding`` rows are watched.

    ``depth`` is a share by which all limits are drawn in besides: what misses that least lies
    furthest inside.
    """

    problem: Problem
    x: Array
    holding: Array
    depth: float = 0.0
    bounds: tuple[Array, Array] = field(init=False)  # of x

    def __post_init__(self) -> None:
        self.bounds = self.problem.bounds

    @property
    def names(self) -> list[str]:
        """Of all requirements."""
        return list(dict.fromkeys(self._at(self.x, None).names))

    def violated(self, x: Array) -> set[str]:
        """Requirements that x misses."""
        at = self._at(x, None)
        return {name for name, room in zip(at.names, at.room, strict=True) if room < -MET}

    def can(self, names: Collection[str]) -> bool:
        """Whether some design meets these requirements."""
        return not names or self.least((), names, ROUGH).met

    @np.errstate(invalid="ignore", divide="ignore")
    def amounts(self, x: Array) -> dict[str, tuple[Evaluation, float]]:
        """Each requirement's condition at x, and by how much of its unit it is missed, drawn in as it is."""
        found = {}
        for c in evaluations_at(self.problem, x, holding_rows(self.problem, x)):
            missed = (c.limit - c.value[0].real) * (1 if c.at_least else -1)
            kept = np.broadcast_to(drawn_in(self.problem, c), c.constraint.shape)[
                0
            ].real / _constraint_per_slack(c)
            size = abs(c.limit) if c.slack_scale is None else c.slack_scale
            found[c.name] = c, max(0.0, float(np.max(missed + kept * size)))
        return found

    def least(
        self, soft: Groups, hard: Collection[str], tolerance: float = FINE, starts: int = STARTS
    ) -> Answer:
        """The design that meets ``hard`` and of whose ``soft`` groups the largest shares missed are least in sum.

        Each start is followed until a step promises less than a share ``tolerance`` of what is
        missed.
        """
        random = np.random.default_rng(0)
        low, high = self.bounds
        pins = np.array([v.pin is not None for v in self.problem.vector.variables])
        best: Answer | None = None
        for k in range(starts if pins.any() else min(starts, 2)):
            x = (self.x, self.problem.vector.start)[k].copy() if k < 2 else self.x.copy()
            if k >= 2:
                x[pins] = random.uniform(0.7 * low[pins], 0.7 * high[pins])
            answer = self._watched(
                np.clip(x, low, high), soft, hard, tolerance=tolerance
            )  # sizes that are chosen are not today's
            if best is None or answer.cost < best.cost - MET:
                best = answer
            if best.met:
                break
        assert best is not None
        return best

    def on_grid(self, answer: Answer, soft: Groups, hard: Collection[str]) -> Answer:
        """From an answer of ``least`` to one whose bores and rods lie on the grid.

        ``bounds`` then hold them there.
        """
        for entry in range(2 * len(self.problem.machine.cylinders)):
            tried = list(self._with_size(answer, entry, soft, hard))
            if tried:
                answer, self.bounds = min(tried, key=lambda found: found[0].cost)
        return answer

    def _with_size(
        self, answer: Answer, entry: int, soft: Groups, hard: Collection[str]
    ) -> Iterator[tuple[Answer, tuple[Array, Array]]]:
        """Answers with one area as the grid has it, and the bounds that hold it there.

        The first that costs nothing.
        """
        before = self.bounds
        for value in grid_sizes(self.problem, answer.x, entry):
            low, high, x = (part.copy() for part in (*before, answer.x))
            low[entry] = high[entry] = x[entry] = value
            self.bounds = low, high
            found = self._watched(x, soft, hard, NEARBY, ROUGH)
            yield found, self.bounds
            self.bounds = before
            if found.cost < answer.cost + MET:
                break

    @np.errstate(
        invalid="ignore", divide="ignore"
    )  # a dead centre or an open four-bar on the way is no better
    def _at(self, x: Array, names: Collection[str] | None) -> _Missed:
        """Requirements of some names (all if None) at x."""
        watched = names is None or any(name.startswith("holding.") for name in names)
        rows = self.holding if watched else self.holding[:0]
        kept = [
            c for c in evaluations_at(self.problem, x, rows) if names is None or c.name in names
        ]
        share = [
            (c.constraint - drawn_in(self.problem, c)) / _constraint_per_slack(c) - self.depth
            for c in kept
        ]
        room = np.concatenate(share, axis=1)
        labels = [
            c.name for c, part in zip(kept, share, strict=True) for _ in range(part.shape[1])
        ]
        return _Missed(labels, room[0].real, room.imag.T / STEP)

    @np.errstate(invalid="ignore", divide="ignore")
    def _watched(
        self,
        x: Array,
        soft: Groups,
        hard: Collection[str],
        trust: float = 0.3,
        tolerance: float = FINE,
    ) -> Answer:
        """As ``_descend``, until no pose of the workspace is loaded more than those that are watched."""
        for _ in range(4):
            answer = self._descend(x, soft, hard, trust, tolerance)
            if not any(name.startswith("holding.") for name in {*hard}.union(*soft)):
                break
            rows = holding_rows(self.problem, answer.x)
            if np.isin(rows, self.holding).all():
                break
            self.holding, x = np.union1d(self.holding, rows).astype(int), answer.x
        return answer

    def _descend(
        self, x: Array, soft: Groups, hard: Collection[str], trust: float, tolerance: float
    ) -> Answer:
        names = {*hard}.union(*soft)
        low, high = self.bounds
        at = self._at(x, names)
        tight: frozenset[str] = frozenset()
        for _ in range(STEPS):
            given, missed = _least_of(at, soft)
            if given + missed < 0.1 * MET:
                break
            box = np.maximum(low - x, -trust), np.minimum(high - x, trust)
            change, foreseen, tight = _step(at, soft, *box)
            merit = given + PRICE * missed
            promised = merit - foreseen
            if promised < tolerance * merit:
                break
            trial = self._at(x + change, names)
            moved = _least_of(trial, soft)
            gained = merit - moved[0] - PRICE * moved[1]
            if gained > 0.1 * promised:
                x, at = x + change, trial
                trust = min(trust * (2.0 if gained > 0.6 * promised else 1.0), 0.5)
            else:
                trust *= 0.35
            if trust < 1e-7:
                break
        return Answer(x, *_least_of(at, soft), tight)


def _constraint_per_slack(evaluation: Evaluation) -> Array:
    """Room of a condition per relative slack (k,); of what nothing changes, one."""
    if evaluation.slack_scale is not None:
        return np.ones(evaluation.constraint.shape[1])  # its room is a share of that scale already
    sensitivity = evaluation.limit_sensitivity[0].real
    return np.where(sensitivity > 0, sensitivity, 1.0)


def _least_of(at: _Missed, soft: Groups) -> tuple[float, float]:
    """Largest shares that the groups are missed by, in sum (and a little of every share).

    The sum of the others'.
    """
    group = _groups(at.names, soft)
    short = np.where(np.isfinite(at.room), np.maximum(-at.room, 0.0), 1e3)
    largest = sum(float(short[group == g].max(initial=0.0)) for g in range(len(soft)))
    return largest + EACH * float(short[group >= 0].sum()), float(short[group < 0].sum())


def _groups(names: Sequence[str], soft: Groups) -> Array:
    """The group of each name, by its number; −1 of what must hold."""
    of = {name: g for g, group in enumerate(soft) for name in group}
    return np.array([of.get(name, -1) for name in names], dtype=int)


def _step(
    at: _Missed, soft: Groups, low: Array, high: Array
) -> tuple[Array, float, frozenset[str]]:
    """Linear programme of one step: change of x, merit foreseen, requirements with a multiplier.

    least Σ t + Σ w e  with  c + C d + e ≥ 0,  e ≥ 0,  and e ≤ t of its group, w = EACH for the
    soft ones, w = PRICE for the others.
    """
    from scipy.optimize import linprog
    from scipy.sparse import csr_array, eye_array, hstack, vstack

    reach = np.minimum(at.jacobian * low, at.jacobian * high).sum(axis=1)
    near = np.flatnonzero(np.isfinite(at.room) & (at.room + reach < 0))
    m, nx, count = len(near), len(low), len(soft)
    group = _groups([at.names[k] for k in near], soft)
    gives = group >= 0
    excess = eye_array(m, format="csr")
    limits = hstack([csr_array(-at.jacobian[near]), csr_array((m, count)), -excess])
    member = csr_array((group[:, None] == np.arange(count)).astype(float).reshape(m, count))
    shared = hstack([csr_array((m, nx)), -member, excess], format="csr")[gives]
    answer = linprog(
        np.concatenate([np.zeros(nx), np.ones(count), np.where(gives, EACH, PRICE)]),
        A_ub=vstack([limits, shared]),
        b_ub=np.concatenate([at.room[near], np.zeros(int(gives.sum()))]),
        bounds=[*zip(low, high, strict=True), *[(0.0, None)] * (count + m)],
    )
    if answer.status != 0:
        raise InfeasibleError(
            "design",
            f"the search for a conflict gave up ({answer.message})",
            "loosen requirements",
        )
    held = near[np.abs(answer.ineqlin.marginals[:m]) > 1e-9]
    return answer.x[:nx], float(answer.fun), frozenset(at.names[k] for k in held)
