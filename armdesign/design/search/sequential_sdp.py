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

from armdesign.arrays import Array
from armdesign.design.program.constraints import (
    Constraints,
    constraints_at,
    evaluations_at,
    holding_rows,
)
from armdesign.design.program.convex_relaxation import convex_relaxation
from armdesign.design.program.problem import Problem
from armdesign.design.search.semidefinite import (
    Step,
    StepProgramme,
    certificate,
    dual_bound,
    lifted,
    programme,
)
from armdesign.errors import InfeasibleError
from armdesign.frequency.modes import hertz

ACTIVE = 24  # poses in one programme
MEMORY = 300  # lowest poses watched between looks at the whole workspace,
SPREAD = 1200  # and about so many all over it
STEPS = 60
RELAXED = 0.01  # share by which a requirement is relaxed to price it
PRICING = 0.05  # trust with which that is solved again,
FINE, ENOUGH = (
    1e-7,
    0.01,
)  # until a step promises less than this of ω², or than this share of what is expected
PRICED = 1e-6  # gain in frequency below which a requirement has no price
# by which a search that is not at its end may miss a requirement, and still meet it there
NEARLY = 1e-3
PRICE = 30.0  # of ω² (relative) per unit of violated requirement when steps are compared


@dataclass(frozen=True)
class Worth:
    """Relative gain in the worst frequency from relaxing a requirement by 1 %: if the first of it counts, and all."""

    at_margin: float
    gain: float


@dataclass(frozen=True, eq=False)
class _Trial:
    """A design, ω² of the watched rows [rad²/s²], its limits and merit."""

    x: Array
    squared: Array
    limits: Constraints
    merit: float


@dataclass(frozen=True, eq=False)
class _Model:
    """The design problem linearised: stiffness over the reference of some rows, and the limits ``keep``, padded."""

    rows: Array
    base: Array
    slopes: Array
    keep: Array
    value: Array
    jacobian: Array


@dataclass(eq=False)
class Search:
    """One run from one start: the state of the search on a problem, reusing one programme.

    ``x`` is the best design so far, ``squared`` its lowest ω² [rad²/s²] over the workspace,
    ``limits`` its requirements.
    """

    problem: Problem
    x: Array
    programme: StepProgramme | None = None
    strictness: float = 1.0  # how many times dearer a missed requirement is than usual
    squared: float = 0.0
    limits: Constraints = field(init=False)
    reference: float = field(init=False)  # the ω² that steps are measured by [rad²/s²]
    bounds: tuple[Array, Array] = field(init=False)  # of x
    rows: Array = field(default_factory=lambda: np.empty(0, dtype=int))
    holding: Array = field(default_factory=lambda: np.empty(0, dtype=int))

    def __post_init__(self) -> None:
        self.reference, self.bounds = (
            self.problem.dynamics.omega_squared_scale,
            self.problem.bounds,
        )

    @property
    def merit(self) -> float:
        """Lowest ω² over the problem's scale, less the price of missed requirements: for comparing searches."""
        return (
            self.squared / self.problem.dynamics.omega_squared_scale
            - PRICE * self.strictness * _missed(self.limits)
        )

    @property
    def violation(self) -> float:
        """Largest amount by which a requirement is missed."""
        return float(_amounts(self.limits).max())

    @property
    def missed(self) -> list[str]:
        """Requirements that are missed by more than a search may miss them on its way, the worst first."""
        amounts = _amounts(self.limits)
        order = np.argsort(-amounts, kind="stable")[: int((amounts > NEARLY).sum())]
        return list(dict.fromkeys(self.limits.names[k] for k in order))

    @np.errstate(invalid="ignore", divide="ignore")  # a dead centre on the way is no better
    def run(self, trust: float, tolerance: float = 1e-5, looks: int = 8) -> Search:
        """Improve ``x`` until a step promises less than ``tolerance`` of ω² and the whole workspace agrees."""
        self.look()
        for _ in range(looks):
            self.reference = max(
                self.problem.dynamics.omega_squared_scale, self.squared
            )  # so that prices keep pace with what is gained
            self._improve(trust, tolerance)
            hoped = self._merit(self.squared, self.limits)
            self.look()
            found = self._merit(self.squared, self.limits)
            if found > hoped - 10 * tolerance and self.squared < 2 * self.reference:
                break
        return self

    def refine(self, trust: float, tolerance: float) -> Search:
        """As ``run``, but by the rows watched already: for a design that hardly moves."""
        self.limits = constraints_at(self.problem, self.x, self.holding)
        self._improve(trust, tolerance)
        return self

    def foresight(self, given: slice) -> Callable[[Array], float]:
        """Function of a design near ``x``: the merit that one step promises if its ``given`` entries are to stay."""
        here = self._trial(self.x, self.limits)
        low, high = (
            np.maximum(self.bounds[0] - self.x, -0.02),
            np.minimum(self.bounds[1] - self.x, 0.02),
        )
        model = self._model(here, self.active(here.squared), low, high)

        def promised(x: Array) -> float:
            low[given] = high[given] = (x - self.x)[given]
            try:
                step = self._solve(model, low, high)
            except InfeasibleError:  # the solver gave up
                return -math.inf
            return step.value - PRICE * step.violation

        return promised

    def upper_bound(self) -> float | None:
        """Worst frequency [Hz] that no areas can exceed with these pins.

        None where no bound is known.

        Convex stiffness is replaced by its chord over the box of allowed areas, buckling
        (reverse-convex) by its chord too; the multipliers of that programme certify the bound, see
        ``dual_bound``. Own masses are affine in the areas: see ``lifted``.
        """
        try:
            relaxed = convex_relaxation(self.problem)
        except InfeasibleError:  # by less than the search lets pass
            return None
        if relaxed is None:
            return None
        linear, low, high = relaxed
        bound = math.inf
        near = (
            self.problem.dynamics.omega_squared(self.x, self.rows).min()
            if self.problem.vector.moving_masses
            else 0.0
        )
        chords = self.problem.dynamics.scaled_stiffness_chords(low, high, self.rows, self.x, near)
        base, slopes = (part / self.reference for part in chords)
        light = self.problem.dynamics.scaled_fixed_mass(self.x, self.rows)
        chosen = np.flatnonzero(
            np.isin(self.rows, self.active(self.problem.dynamics.omega_squared(self.x, self.rows)))
        )
        kept = self.programme
        count = kept.shape[2] if kept else 0
        room = (*_padded(linear.values, linear.jacobian, count), np.zeros(len(low)), high - low)
        for _ in range(6):
            shape = (len(chosen), base.shape[1], len(room[0]), len(low))
            try:
                step = self._programme(shape).solve(base[chosen], slopes[:, chosen], *room)
            except InfeasibleError:  # the solver gave up: what is known so far still holds
                break
            found = dual_bound(step, base[chosen], slopes[:, chosen], *room)
            bound = min(
                bound, lifted(found, near / self.reference, certificate(step), light[chosen])
            )
            lowest = np.linalg.eigvalsh(base + np.einsum("vnij,v->nij", slopes, step.change))[:, 0]
            worse = np.setdiff1d(np.argsort(lowest)[:8], chosen)
            if len(worse) == 0 or lowest.min() > bound * (1 - 1e-4):
                break
            chosen = np.concatenate([chosen, worse])
        self.programme = kept
        return hertz(bound * self.reference) if math.isfinite(bound) else None

    @np.errstate(invalid="ignore", divide="ignore")
    def look(self) -> None:
        """Watch the lowest and the most loaded poses of the whole workspace."""
        squared, forces = self.problem.dynamics.omega_squared_and_forces(self.x)
        lowest, spread = (
            np.argsort(squared)[:MEMORY],
            np.arange(0, len(squared), max(1, len(squared) // SPREAD)),
        )
        self.rows = np.unique(np.concatenate([self.rows, lowest, spread])).astype(int)
        known = (
            forces if self.problem.dynamics.nominal_rows is self.problem.dynamics.rows else None
        )
        self.holding = np.union1d(self.holding, holding_rows(self.problem, self.x, known)).astype(
            int
        )
        self.squared = float(squared.min())
        self.limits = constraints_at(self.problem, self.x, self.holding)

    def _improve(self, trust: float, tolerance: float) -> None:
        here = self._trial(self.x, self.limits)
        low_x, high_x = self.bounds
        pinned: list[int] = []
        for _ in range(STEPS):
            active = self.active(here.squared, pinned)
            low, high = np.maximum(low_x - here.x, -trust), np.minimum(high_x - here.x, trust)
            try:
                model = self._model(here, active, low, high)
                step = self._solve(model, low, high)
            except InfeasibleError:  # the solver gave up: a smaller box is an easier programme
                trust *= 0.35
                if trust < 1e-6:
                    break
                continue
            promised = step.value - PRICE * step.violation - here.merit
            if promised < tolerance:
                break
            trial = self._best_trial(here, model, step.change, (low, high), promised)
            gained = trial.merit - here.merit
            if gained > 0.1 * promised:
                here, pinned = trial, []
                self.x = here.x
                trust = min(trust * (2.0 if gained > 0.6 * promised else 1.0), 0.5)
            else:
                trust *= 0.35
                pinned = [*pinned, int(trial.squared.argmin())]
            if trust < 1e-6:
                break
        self.limits, self.squared = here.limits, float(here.squared.min())

    def _trial(self, x: Array, at: Constraints | None = None) -> _Trial:
        """A design looked at on the watched rows."""
        squared = self.problem.dynamics.omega_squared(x, self.rows)
        at = constraints_at(self.problem, x, self.holding) if at is None else at
        return _Trial(x, squared, at, self._merit(float(squared.min()), at))

    def _best_trial(
        self, here: _Trial, model: _Model, change: Array, box: tuple[Array, Array], promised: float
    ) -> _Trial:
        """The design that a step leads to.

        If it disappoints, also the step corrected by what it met there.

        Constraints and stiffness bend: the programme is solved again with their values at the trial
        (second-order correction), without which steps along a bent limit would have to be tiny.
        """
        none = replace(here, merit=-math.inf)
        trial = (
            self._trial(here.x + change) if self.problem.vector.closes(here.x + change) else none
        )
        if trial.merit - here.merit > 0.1 * promised or trial is none:
            return trial
        base = (
            self.problem.dynamics.scaled_stiffness(
                trial.x, model.rows, here.x, float(here.squared.min())
            )
            / self.reference
        )
        kept = self.strictness * trial.limits.values[model.keep]
        bent = replace(
            model,
            base=base - np.einsum("vnij,v->nij", model.slopes, change),
            value=np.pad(kept, (0, len(model.value) - len(kept)), constant_values=1.0)
            - model.jacobian @ change,
        )
        try:
            again = here.x + self._solve(bent, *box).change
        except InfeasibleError:  # the solver gave up: the first trial has to do
            return trial
        corrected = self._trial(again) if self.problem.vector.closes(again) else none
        return max(trial, corrected, key=lambda t: t.merit)

    def _merit(self, squared: float, at: Constraints) -> float:
        return squared / self.reference - PRICE * self.strictness * _missed(at)

    def _model(self, here: _Trial, rows: Array, low: Array, high: Array) -> _Model:
        """Stiffness of rows, and the limits that could bind in the box, linearised."""
        base, slopes = self.problem.dynamics.scaled_stiffness_and_gradient(
            here.x, rows, float(here.squared.min())
        )
        keep = _nearest_limits(here.limits, low, high, 100)
        at = here.limits
        value, jacobian = _padded(
            self.strictness * at.values[keep], self.strictness * at.jacobian[keep]
        )
        return _Model(rows, base / self.reference, slopes / self.reference, keep, value, jacobian)

    def _solve(self, model: _Model, low: Array, high: Array) -> Step:
        shape = (len(model.rows), model.base.shape[1], len(model.value), len(low))
        return self._programme(shape).solve(
            model.base, model.slopes, model.value, model.jacobian, low, high
        )

    def _programme(self, shape: tuple[int, int, int, int]) -> StepProgramme:
        """The programme of this shape: the one at hand, if it fits, because setting one up costs several solutions."""
        if self.programme is None or self.programme.shape != shape:
            self.programme = programme(*shape)
        return self.programme

    def worth(self) -> dict[str, Worth]:
        """Relative gains in the worst frequency from relaxing each requirement by 1 %.

        At the margin by its multiplier; the whole 1 % by solving again from here: another limit
        may soon be met, and designs of nearly the same frequency may lie far apart, so that no box
        around this one holds the answer. Requirements that one setting states are relaxed
        together, as a designer relaxes them, and share the gain by their multipliers.
        """
        here = replace(self, x=self.x, squared=self.squared)
        here.bounds, here.reference = self.bounds, self.reference
        here.run(PRICING, 10 * FINE, looks=2)
        margins = here.margins()
        settings = {c.name: c.setting for c in evaluations_at(self.problem, self.x, self.holding)}
        together: dict[str, list[str]] = {}
        for name in margins:
            together.setdefault(settings.get(name) or name, []).append(name)
        found: dict[str, Worth] = {}
        for names in together.values():
            first = sum(margins[name] for name in names)
            share = here._gain(names, first) / first if first > PRICED else 1.0
            found |= {
                name: Worth(at_margin=margins[name], gain=share * margins[name]) for name in names
            }
        return found

    def margins(self) -> dict[str, float]:
        """Relative gain in the worst frequency per 1 % of each requirement, by its multiplier."""
        here = self._trial(self.x, self.limits)
        low_x, high_x = self.bounds
        low, high = np.maximum(low_x - self.x, -PRICING), np.minimum(high_x - self.x, PRICING)
        model = self._model(here, self.active(here.squared), low, high)
        try:
            step = self._solve(model, low, high)
        except InfeasibleError:  # the solver gave up: nothing is known
            return {}
        scale = 0.5 * self.reference / float(here.squared.min())  # f ~ sqrt(λ)
        multipliers = np.zeros(len(self.limits.values))
        multipliers[model.keep] = self.strictness * step.multipliers[: len(model.keep)]
        # a limit that no variable moves has no price, whatever the solver's multiplier says
        multipliers[~np.any(self.limits.jacobian[:, high_x > low_x] != 0, axis=1)] = 0.0
        at_end = np.where(high < PRICING, step.high_multipliers, 0) + np.where(
            low > -PRICING, step.low_multipliers, 0
        )
        gains: dict[str, float] = {}
        for name, gain in (
            *zip(self.limits.names, multipliers * self.limits.per_percent * scale, strict=True),
            *zip(self._boxes, RELAXED * high_x * at_end * scale, strict=True),
        ):
            gains[name] = gains.get(name, 0.0) + float(gain)
        gains.pop("", None)
        return gains

    @property
    def _boxes(self) -> list[str]:
        """Name of the pin box that bounds each entry of x; empty for areas."""
        cylinders = self.problem.machine.cylinders
        return [
            f"pin_box.{cylinders[v.cylinder].name}.{v.pin}" if v.pin else ""
            for v in self.problem.vector.variables
        ]

    def _gain(self, names: Sequence[str], expected: float) -> float:
        """Relative gain in frequency that is found from here with requirements relaxed by 1 %."""
        eased = replace(
            self, problem=self.problem.relaxed(dict.fromkeys(names, RELAXED)), x=self.x
        )
        low, high = self.bounds
        more = RELAXED * high * np.isin(self._boxes, names)
        eased.bounds, eased.reference = (low - more, high + more), self.reference
        eased.run(PRICING, max(FINE, ENOUGH * expected), looks=2)
        return math.sqrt(max(eased.squared / self.squared, 1.0)) - 1

    def active(self, squared: Array, pinned: Sequence[int] = ()) -> Array:
        """Rows for the next programme: the lowest, but no two that nearly coincide, and those that spoilt a step."""
        place = self.problem.dynamics.row_coordinates(self.rows)
        chosen = list(dict.fromkeys(pinned))[-ACTIVE // 2 :]
        for spacing in (0.05, 0.0):
            for index in np.argsort(squared):
                if len(chosen) == min(ACTIVE, len(self.rows)):
                    break
                if index not in chosen and all(
                    np.abs(place[index] - place[c]).max() > spacing for c in chosen
                ):
                    chosen.append(int(index))
        return self.rows[chosen]


def _amounts(at: Constraints) -> Array:
    """What each requirement is missed by; infinite where that is not known."""
    return np.where(np.isnan(at.values), np.inf, np.maximum(-at.values, 0.0))


def _missed(at: Constraints) -> float:
    """Sum of what requirements are missed by."""
    return float(_amounts(at).sum())


def _padded(value: Array, jacobian: Array, count: int = 0) -> tuple[Array, Array]:
    """Constraints filled up with ones that always hold, so that a programme serves many times.

    To ``count``, or to a multiple of 40 if there are more.
    """
    more = count - len(value) if count >= len(value) else -len(value) % 40
    return np.pad(value, (0, more), constant_values=1.0), np.pad(jacobian, ((0, more), (0, 0)))


def _nearest_limits(at: Constraints, low: Array, high: Array, count: int) -> Array:
    """The constraints that a step in the box could bring nearest to violation.

    Always the same number of them.
    """
    reach = np.minimum(at.jacobian * low, at.jacobian * high).sum(axis=1)
    lowest = at.values + reach
    return np.sort(np.argsort(lowest)[: min(count, len(lowest))])
