"""Conflicts: which requirements no design meets together, and how much they must give.

Frequency is left aside. Sequential linear programmes in a trust region look for the least by which some requirements
are missed; a requirement without which the others can be met belongs to the conflict (deletion filter, Chinneck and
Dravnieks 1991). All of it is local, from several starts: the problem is not convex in the pins.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from armdesign.arrays import Array
from armdesign.design.candidates import Condition
from armdesign.design.check import Check
from armdesign.design.limits import conditions_at, holding_rows
from armdesign.design.problem import Problem
from armdesign.design.space import STEP
from armdesign.errors import Concession, InfeasibleError
from armdesign.units import WORKSHOP

MET = 1e-6  # a share of its limit by which a requirement may be missed
STEPS = 40
PRICE = 100.0  # of a requirement that must hold, against the largest share of those that may give
EACH = 1e-3  # of every other share that is given: what need not give does not
PAIRS = 60  # of requirements that are tried for a smaller conflict
STARTS = 1  # drawn designs from which requirements are tried, besides those at hand


@dataclass(frozen=True, eq=False)
class _Missed:
    """Requirements at one x: room as a share of the limit, its Jacobian, and the requirement of each row."""

    names: list[str]
    room: Array  # (m,)
    jacobian: Array  # (m, nx)


@dataclass(frozen=True, eq=False)
class _Answer:
    """The design that misses least: largest share given, what is missed besides, and requirements that mattered."""

    x: Array
    given: float
    missed: float
    tight: frozenset[str]

    @property
    def met(self) -> bool:
        return max(self.given, self.missed) <= MET


@dataclass(eq=False)
class Conflict:
    """The search for a conflict from the design ``x`` that a search ended with; ``holding`` rows are watched."""

    problem: Problem
    x: Array
    holding: Array

    def smallest(self) -> tuple[str, ...]:
        """Names of requirements that cannot be met together, and can without any one of them; empty if all can.

        The smallest such set that was found: single requirements are tried first, and pairs where it has more than two.
        """
        everything = list(dict.fromkeys(self._at(self.x, None).names))
        elastic = self._least((), everything)
        if elastic.met:
            self.x = elastic.x
            return ()
        self.x = elastic.x
        missed = [n for n in everything if n in self._violated(elastic.x)]
        for name in missed:
            if not self._can((name,)):
                return (name,)
        suspects = [n for n in everything if n in elastic.tight or n in missed]
        if self._can(suspects):
            suspects = everything
        found = self._filtered(suspects, missed)
        pairs = [(a, b) for a in missed for b in suspects if a != b]
        if len(found) > 2 and len(pairs) <= PAIRS:
            found = next((pair for pair in pairs if not self._can(pair)), found)
        return tuple(sorted(found, key=everything.index))

    def _filtered(self, suspects: Sequence[str], missed: Collection[str]) -> tuple[str, ...]:
        """Deletion filter: what can go while the rest still conflicts, goes; what is missed goes last."""
        kept = list(suspects)
        for name in sorted(suspects, key=lambda n: n in missed):
            rest = [n for n in kept if n != name]
            if not self._can(rest):
                kept = rest
        return tuple(kept)

    def concessions(self, names: Sequence[str]) -> tuple[tuple[Concession, ...], bool]:
        """What the requirements of a conflict must give, all of them or each alone, and whether that settles all.

        Where other conflicts remain, it is what these must give to be met by themselves.
        """
        everything = list(dict.fromkeys(self._at(self.x, None).names))
        others = [n for n in everything if n not in names]
        together = self._least(names, others)
        if together.missed > MET:
            together, others = self._least(names, ()), []
        given = self._amounts(together.x)
        found = []
        for name in names:
            condition, amount = given[name]
            rest = [n for n in names if n != name]
            alone = self._least((name,), [*others, *rest]) if rest else together
            own, limit = self._amounts(alone.x)[name][1], condition.limit
            helps = alone.missed <= MET and not (condition.at_least and own >= abs(limit) > 0)
            found.append(concession(condition, amount, own if helps else None))
        return tuple(found), bool(others) or len(names) == len(everything)

    def _amounts(self, x: Array) -> dict[str, tuple[Condition, float]]:
        """Each requirement's condition at x, and by how much it is missed in its unit."""
        found = {}
        for c in conditions_at(self.problem, x, holding_rows(self.problem, x)):
            missed = (c.limit - c.value[0].real) * (1 if c.at_least else -1)
            found[c.name] = c, max(0.0, float(np.max(np.real(missed))))
        return found

    def _violated(self, x: Array) -> set[str]:
        at = self._at(x, None)
        return {name for name, room in zip(at.names, at.room, strict=True) if room < -MET}

    def _at(self, x: Array, names: Collection[str] | None) -> _Missed:
        """Requirements of some names (all if None) at x."""
        watched = names is None or any(name.startswith("holding.") for name in names)
        rows = self.holding if watched else self.holding[:0]
        kept = [c for c in conditions_at(self.problem, x, rows) if names is None or c.name in names]
        share = [c.room / _room_per_limit(c) for c in kept]
        room = np.concatenate(share, axis=1)
        labels = [c.name for c, part in zip(kept, share, strict=True) for _ in range(part.shape[1])]
        return _Missed(labels, room[0].real, room.imag.T / STEP)

    def _can(self, names: Collection[str]) -> bool:
        """Whether some design meets these requirements."""
        return not names or self._least((), names).met

    def _least(self, soft: Collection[str], hard: Collection[str]) -> _Answer:
        """The design that meets ``hard`` and misses the limits of ``soft`` by the least common share, of all starts."""
        random = np.random.default_rng(0)
        low, high = self.problem.bounds
        pins = np.array([v.pin is not None for v in self.problem.variables])
        best: _Answer | None = None
        for k in range(2 + (STARTS if pins.any() else 0)):
            x = (self.x, self.problem.start)[k].copy() if k < 2 else self.x.copy()
            if k >= 2:
                x[pins] = random.uniform(0.7 * low[pins], 0.7 * high[pins])
            answer = self._watched(np.clip(x, low, high), soft, hard)  # sizes that are chosen are not today's
            if best is None or answer.given + PRICE * answer.missed < best.given + PRICE * best.missed - MET:
                best = answer
            if best.met:
                break
        assert best is not None
        return best

    def _watched(self, x: Array, soft: Collection[str], hard: Collection[str]) -> _Answer:
        """As ``_descend``, until no pose of the workspace is loaded more than those that are watched."""
        for _ in range(4):
            answer = self._descend(x, soft, hard)
            if not any(name.startswith("holding.") for name in (*soft, *hard)):
                break
            rows = holding_rows(self.problem, answer.x)
            if np.isin(rows, self.holding).all():
                break
            self.holding, x = np.union1d(self.holding, rows).astype(int), answer.x
        return answer

    def _descend(self, x: Array, soft: Collection[str], hard: Collection[str]) -> _Answer:
        names = {*soft, *hard}
        low, high = self.problem.bounds
        at, trust = self._at(x, names), 0.3
        tight: frozenset[str] = frozenset()
        for _ in range(STEPS):
            given, missed = _least_of(at, soft)
            if given + missed < 0.1 * MET:
                break
            box = np.maximum(low - x, -trust), np.minimum(high - x, trust)
            change, foreseen, tight = _step(at, soft, *box)
            merit = given + PRICE * missed
            promised = merit - foreseen
            if promised < 1e-5 * merit:
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
        return _Answer(x, *_least_of(at, soft), tight)


def _room_per_limit(condition: Condition) -> Array:
    """Room of a condition per relative slack (k,); of what hangs on nothing, one."""
    if condition.slack_scale is not None:
        return np.ones(condition.room.shape[1])  # its room is a share of that scale already
    easing = np.broadcast_to(condition.easing, condition.room.shape)[0].real
    return np.where(easing > 0, easing, 1.0)


def _least_of(at: _Missed, soft: Collection[str]) -> tuple[float, float]:
    """Largest share that soft requirements are missed by (and a little of their sum), and the sum of the others'."""
    may_give = np.isin(at.names, list(soft))
    short = np.where(np.isfinite(at.room), np.maximum(-at.room, 0.0), 1e3)
    return float(short[may_give].max(initial=0.0) + EACH * short[may_give].sum()), float(short[~may_give].sum())


def _step(at: _Missed, soft: Collection[str], low: Array, high: Array) -> tuple[Array, float, frozenset[str]]:
    """Linear programme of one step: change of x, merit foreseen, requirements with a multiplier.

    least t + Σ w e  with  c + C d + e ≥ 0,  e ≥ 0,  and e ≤ t, w = EACH for the soft ones, w = PRICE for the others.
    """
    from scipy.optimize import linprog
    from scipy.sparse import csr_array, eye_array, hstack, vstack

    reach = np.minimum(at.jacobian * low, at.jacobian * high).sum(axis=1)
    near = np.flatnonzero(np.isfinite(at.room) & (at.room + reach < 0))
    m, nx = len(near), len(low)
    may_give = np.isin(np.array(at.names)[near], list(soft))
    excess = eye_array(m, format="csr")
    limits = hstack([csr_array(-at.jacobian[near]), csr_array((m, 1)), -excess])
    shared = hstack([csr_array((m, nx)), csr_array(-np.ones((m, 1))), excess], format="csr")[may_give]
    answer = linprog(
        np.concatenate([np.zeros(nx), [1.0], np.where(may_give, EACH, PRICE)]),
        A_ub=vstack([limits, shared]),
        b_ub=np.concatenate([at.room[near], np.zeros(int(may_give.sum()))]),
        bounds=[*zip(low, high, strict=True), *[(0.0, None)] * (1 + m)],
    )
    if answer.status != 0:
        raise InfeasibleError("design", f"the search for a conflict gave up ({answer.message})", "loosen requirements")
    held = near[np.abs(answer.ineqlin.marginals[:m]) > 1e-9]
    return answer.x[:nx], float(answer.fun), frozenset(at.names[k] for k in held)


def concession(of: Check | Condition, together: float, alone: float | None) -> Concession:
    """What a requirement must give, with the others of a conflict or alone."""
    return Concession(
        name=of.name,
        words=of.words,
        unit=of.unit,
        limit=of.limit,
        at_least=of.at_least,
        together=together,
        alone=alone,
    )


def sentence(conflict: Sequence[Concession], settles: bool, none_meets: str = "no design meets") -> str:
    """A conflict in plain words; ``settles``: what it gives is enough for all requirements to be met."""
    more = "" if settles else "; others conflict besides"
    if len(conflict) == 1:
        only = conflict[0]
        return f"{none_meets} {_named(only)}: it must give {_given(only, only.together)}{more}"
    names = " together with ".join(_named(c) for c in conflict)
    each = ", ".join(f"{c.name} {_given(c, c.together)}" for c in conflict if c.together > 0)
    single = [f"{c.name} {_given(c, c.alone)}" for c in conflict if c.alone is not None]
    alone = f", or one alone {' or '.join(single)}" if single else ", no one alone is enough"
    return f"{none_meets} {names}: they must give {each}{alone}{more}"


def nearest(missed: Sequence[Concession]) -> str:
    """What the nearest of some designs misses, in plain words; nothing if that is not known."""
    words = " and ".join(f"{_named(c)} by {_given(c, c.together)}" for c in missed)
    return f": the nearest misses {words}" if words else ""


def _named(c: Concession) -> str:
    return f"{c.name} ({c.words} {'at least' if c.at_least else 'at most'} {WORKSHOP.short(c.limit, c.unit)})"


def _given(c: Concession, amount: float) -> str:
    """An amount in its unit and as a share."""
    percent = 100 * amount / abs(c.limit) if c.limit else 0.0
    share = f" ({percent:{'.0f' if percent >= 10 else '.2g'}} %)" if c.limit else ""
    return f"{WORKSHOP.short(amount, c.unit)}{share}"
