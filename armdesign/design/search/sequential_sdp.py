"""Sequential semidefinite programming: from a design to a better one, until none is near.

Each step maximises the lowest ω² of a few poses, their stiffness and the requirements linearised.
Whole matrices enter, not single eigenvalues, so modes that cross stay together. The poses are an
active set: a step is tried on all poses that have ever been low, the whole workspace is looked at
in the end, and the worst violators join.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from armdesign.arrays import Array, Flags
from armdesign.design.program.constraints import Constraints, constraints_at, holding_rows
from armdesign.design.program.problem import Problem
from armdesign.design.search.semidefinite import ProgrammeStep, padded, programme
from armdesign.design.search.trust_region import Box, TrustRegion, ascend, box_around
from armdesign.errors import InfeasibleError

ACTIVE = 24  # poses in one programme
LIMITS = 100  # requirements in one programme
MEMORY = 300  # lowest poses watched between looks at the whole workspace,
SPREAD = 1200  # and about so many all over it
STEPS, SMALLEST = 60, 1e-6  # of the trust region
AHEAD = 0.02  # how far a single step may go whose merit is foreseen
# by which a search that is not at its end may miss a requirement, and still meet it there
NEARLY = 1e-3
MISSED = 1e-5  # by which a finished search may
PENALTY = 30.0  # of ω² (relative) per unit of violated requirement when steps are compared


@dataclass(frozen=True, eq=False)
class Trial:
    """A design, ω² of the watched rows [rad²/s²], its limits and merit."""

    x: Array
    squared: Array
    limits: Constraints
    merit: float


@dataclass(frozen=True, eq=False)
class Linearised:
    """The design problem near a trial: stiffness over the reference of some rows, and limits.

    ``kept`` numbers the limits; ``value`` and ``jacobian`` are padded with some that always hold.
    """

    rows: Array
    base: Array
    slopes: Array
    kept: Array
    value: Array
    jacobian: Array

    def solve(self, box: Box) -> ProgrammeStep:
        """The best step within a box; entries of x that cannot change are no variables.

        Unless none can: a programme has some.

        Raises:
            InfeasibleError: the solver gave up.
        """
        low, high = box
        free = high > low
        if not free.any():
            free[:] = True
        given = np.where(free, 0.0, low)
        base = self.base + np.tensordot(given, self.slopes, axes=1)
        value = self.value + self.jacobian @ given
        one = programme(*base.shape[:2], len(value), int(free.sum()))
        step = one.solve(
            base, self.slopes[free], value, self.jacobian[:, free], low[free], high[free]
        )
        change, at_low, at_high = given, np.zeros(len(low)), np.zeros(len(low))
        change[free], at_low[free] = step.change, step.low_multipliers
        at_high[free] = step.high_multipliers
        return replace(step, change=change, low_multipliers=at_low, high_multipliers=at_high)


@dataclass(eq=False, kw_only=True)
class Search:
    """One run from one start: the design reached so far, and the watched rows."""

    problem: Problem  # what is searched
    x: Array  # the best design so far
    strictness: float = 1.0  # how many times dearer a missed requirement is than usual
    within: tuple[Array, Array] | None = None  # bounds of x; the problem's if None
    reference: float = 0.0  # ω² that steps are measured by [rad²/s²], at least the problem's scale
    # numbers of the watched rows, and of those at which static forces are watched
    rows: Array = field(default_factory=lambda: np.empty(0, dtype=int))
    holding: Array = field(default_factory=lambda: np.empty(0, dtype=int))
    squared: float = field(init=False, default=0.0)  # lowest ω² of x over the workspace [rad²/s²]
    limits: Constraints = field(init=False)  # requirements at x
    # the design at which the whole workspace was looked at last
    looked_at: Array | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        self.reference = max(self.reference, self.problem.dynamics.omega_squared_scale)

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Least and largest value of every entry of x."""
        return self.problem.bounds if self.within is None else self.within

    @property
    def merit(self) -> float:
        """Lowest ω² over the problem's scale, less the penalty of missed requirements."""
        return self._merit(self.squared, self.limits, self.problem.dynamics.omega_squared_scale)

    @property
    def violation(self) -> float:
        """Largest amount by which a requirement is missed."""
        return float(amounts_missed(self.limits).max())

    @property
    def rank(self) -> tuple[bool, float]:
        """To compare searches: whether all requirements are met, then the merit."""
        return self.violation <= MISSED, self.merit

    @property
    def missed(self) -> list[str]:
        """Requirements that are missed by more than ``NEARLY``, the worst first."""
        amounts = amounts_missed(self.limits)
        order = np.argsort(-amounts, kind="stable")[: int((amounts > NEARLY).sum())]
        return list(dict.fromkeys(self.limits.names[k] for k in order))

    # ------------------------------------------------------------------------------------- running

    @np.errstate(invalid="ignore", divide="ignore")  # a dead centre on the way is no better
    def run(self, trust: float, tolerance: float = 1e-5, looks: int = 8) -> Search:
        """Improve ``x`` until a step promises less than ``tolerance`` on the whole workspace."""
        self.look()
        for _ in range(looks):
            # prices keep pace with what is gained
            self.reference = max(self.problem.dynamics.omega_squared_scale, self.squared)
            self._improve(trust, tolerance)
            hoped = self._merit(self.squared, self.limits)
            self.look(improved=True)
            reached = self._merit(self.squared, self.limits)
            if reached > hoped - 10 * tolerance and self.squared < 2 * self.reference:
                break
        return self

    @np.errstate(invalid="ignore", divide="ignore")
    def run_on(self, trust: float, tolerance: float, looks: int) -> Search:
        """As ``run``, from where the rows watched already are those that count."""
        for _ in range(looks):
            hoped = self.refine(trust, tolerance).merit
            if self.look(improved=True).merit > hoped - 10 * tolerance:
                break
        return self

    def refine(self, trust: float, tolerance: float) -> Search:
        """Improve ``x`` by the rows watched already: for a design that hardly moves."""
        self.limits = constraints_at(self.problem, self.x, self.holding)
        self._improve(trust, tolerance)
        return self

    @np.errstate(invalid="ignore", divide="ignore")
    def look(self, improved: bool = False) -> Search:
        """Watch the lowest and the most loaded poses of the whole workspace.

        After ``_improve`` the requirements are known at the rows watched so far.
        """
        if self.looked_at is self.x:
            return self
        squared, forces = self.problem.dynamics.omega_squared_and_forces(self.x)
        lowest = np.argsort(squared)[:MEMORY]
        spread = np.arange(0, len(squared), max(1, len(squared) // SPREAD))
        self.rows = np.unique(np.concatenate([self.rows, lowest, spread])).astype(int)
        known = self.problem.dynamics.forces_of_nominal(forces)
        loaded = holding_rows(self.problem, self.x, known)
        if not (improved and np.isin(loaded, self.holding).all()):
            self.holding = np.union1d(self.holding, loaded).astype(int)
            self.limits = constraints_at(self.problem, self.x, self.holding)
        self.squared, self.looked_at = float(squared.min()), self.x
        return self

    def at(self, x: Array, strictness: float | None = None) -> Search:
        """A search of the same problem at another design, with the rows watched so far."""
        strictness = self.strictness if strictness is None else strictness
        return replace(self, x=x, strictness=strictness).look()

    def of(self, problem: Problem, x: Array, within: tuple[Array, Array] | None = None) -> Search:
        """A search of a similar problem, not yet looked at, with the rows watched so far."""
        return replace(self, problem=problem, x=x, within=within or self.within)

    def taking(self, trial: Trial) -> Search:
        """A search at a trial of its own."""
        search = self.of(self.problem, trial.x, self.within)
        search.limits, search.squared = trial.limits, float(trial.squared.min())
        return search

    # --------------------------------------------------------------------------------------- steps

    def trial(self, x: Array | None = None) -> Trial:
        """A design looked at on the watched rows; the search's own if None."""
        at = self.limits if x is None else constraints_at(self.problem, x, self.holding)
        x = self.x if x is None else x
        squared = self.problem.dynamics.omega_squared(x, self.rows)
        return Trial(x, squared, at, self._merit(float(squared.min()), at))

    def linearised(self, trial: Trial, rows: Array, box: Box) -> Linearised:
        """Stiffness of rows near a trial, and the limits that a step in the box could reach."""
        squared = float(trial.squared.min())
        matrices = self.problem.dynamics.scaled_stiffness_and_gradient(trial.x, rows, squared)
        base, slopes = (part / self.reference for part in matrices)
        return Linearised(rows, base, slopes, **self._limits(trial, box))

    def _limits(self, trial: Trial, box: Box) -> dict[str, Array]:
        """The limits of a trial that a step in the box could reach, as ``Linearised`` has them."""
        at = trial.limits
        kept = _nearest_limits(at, box, LIMITS)
        value, jacobian = padded(
            *(self.strictness * part[kept] for part in (at.values, at.jacobian))
        )
        return {"kept": kept, "value": value, "jacobian": jacobian}

    def active(self, squared: Array, pinned: Sequence[int] = ()) -> Array:
        """Rows for the next programme: the lowest and those that spoilt a step, no two alike."""
        order = np.argsort(squared)
        place = np.ascontiguousarray(self.problem.dynamics.row_coordinates(self.rows[order]).T)
        ranks = np.argsort(order)
        chosen = [int(ranks[row]) for row in dict.fromkeys(pinned)][-ACTIVE // 2 :]
        # of every row from what is chosen
        distance = np.full(len(order), np.inf)
        for c in chosen:
            distance = np.minimum(distance, np.abs(place - place[:, c, None]).max(axis=0))
        for spacing in (0.05, 0.0):
            while len(chosen) < ACTIVE and (far := distance > spacing).any():
                chosen.append(int(far.argmax()))
                near = np.abs(place - place[:, chosen[-1], None]).max(axis=0)
                distance = np.minimum(distance, near)
        return self.rows[order[chosen]]

    def foreseen_merit(self, reach: float = AHEAD) -> Callable[[Array, Flags], float]:
        """Function of a design and its ``given`` entries: the merit promised by one step there.

        The other entries follow, each as far as ``reach``.
        """
        trial = self.trial()
        near = box_around(self.x, self.bounds, reach)
        model = self.linearised(trial, self.active(trial.squared), near)
        share = self.reference / self.problem.dynamics.omega_squared_scale

        def foreseen(x: Array, given: Flags) -> float:
            low, high = (np.where(given, x - self.x, end) for end in near)
            try:
                step = replace(model, **self._limits(trial, (low, high))).solve((low, high))
            except InfeasibleError:  # the solver gave up
                return -math.inf
            return share * step.value - PENALTY * step.violation

        return foreseen

    def _improve(self, trust: float, tolerance: float) -> None:
        """Take ``x`` along steps by the watched rows, as long as they promise the tolerance.

        Far from allowed, where the merit is far below zero, that share of it.
        """

        def step(trial: Trial, box: Box, refused: Sequence[Trial]) -> tuple[Trial, float] | None:
            spoilers = [int(t.squared.argmin()) for t in refused]
            model = self.linearised(trial, self.active(trial.squared, spoilers), box)
            answer = model.solve(box)
            promised = answer.value - PENALTY * answer.violation - trial.merit
            if promised < tolerance * max(1.0, -trial.merit):
                return None
            return self._best_trial(trial, model, answer.change, box, promised), promised

        best = ascend(self.trial(), step, self.bounds, TrustRegion(trust, SMALLEST, STEPS))
        self.x, self.limits, self.squared = best.x, best.limits, float(best.squared.min())

    def _best_trial(
        self, start: Trial, model: Linearised, change: Array, box: Box, promised: float
    ) -> Trial:
        """The design that a step leads to, or where it disappoints the corrected step.

        Limits and stiffness bend: the programme is solved again with their values at the trial
        (second-order correction), without which steps along a bent limit would have to be tiny.
        """
        none, x, dynamics = (
            replace(start, merit=-math.inf),
            start.x + change,
            self.problem.dynamics,
        )
        trial = self.trial(x) if self.problem.vector.closes(x) else none
        if trial.merit - start.merit > 0.1 * promised or trial is none:
            return trial
        squared = float(start.squared.min())
        base = dynamics.scaled_stiffness(x, model.rows, start.x, squared) / self.reference
        kept = self.strictness * trial.limits.values[model.kept]
        value = np.pad(kept, (0, len(model.value) - len(kept)), constant_values=1.0)
        slope = np.einsum("vnij,v->nij", model.slopes, change)
        bent = replace(model, base=base - slope, value=value - model.jacobian @ change)
        try:
            again = start.x + bent.solve(box).change
        except InfeasibleError:  # the solver gave up: the first trial has to do
            return trial
        corrected = self.trial(again) if self.problem.vector.closes(again) else none
        return max(trial, corrected, key=lambda t: t.merit)

    def _merit(self, squared: float, at: Constraints, scale: float | None = None) -> float:
        penalty = PENALTY * self.strictness * float(amounts_missed(at).sum())
        return squared / (self.reference if scale is None else scale) - penalty


def amounts_missed(at: Constraints) -> Array:
    """Miss of each requirement; infinite where that is not known."""
    return np.where(np.isnan(at.values), np.inf, np.maximum(-at.values, 0.0))


def _nearest_limits(at: Constraints, box: Box, count: int) -> Array:
    """As many constraints each time: those that a step could bring nearest to violation."""
    reach = np.minimum(at.jacobian * box[0], at.jacobian * box[1]).sum(axis=1)
    lowest = at.values + reach
    return np.sort(np.argsort(lowest)[: min(count, len(lowest))])
