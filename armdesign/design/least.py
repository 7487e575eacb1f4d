"""The least oil, pump flow or cylinder mass that is enough for a given frequency.

The best worst frequency never falls when a limit is loosened. So the least amount is the root of
*best frequency under that limit = frequency asked for*, found by the secant rule within a bracket;
each search starts from the last answer.

With a catalogue and given pins each search chooses sizes with their proof, and the bracket closes
on an amount that a combination uses: under a little less none is enough. Where pins vary, sizes
are chosen under the least amount of free sizes, the amount follows the sizes, and both are
repeated: sizes that need less are sizes that reach more under the same limit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Unpack

import numpy as np

from armdesign.arguments import checked, with_options
from armdesign.design.catalogue.alternation import (
    improve_in_turn,
    refuse_fixed_sizes,
    sizes_for_pins,
    with_sizes,
)
from armdesign.design.catalogue.branch_and_bound import SizeSelection
from armdesign.design.catalogue.sizes import Sizes
from armdesign.design.design import Design, Found, Outcome
from armdesign.design.kept_designs import finished_design
from armdesign.design.optimize import USUAL_SEARCH, SearchOptions
from armdesign.design.program.constraints import evaluations_at
from armdesign.design.program.problem import Problem
from armdesign.design.provenance import call
from armdesign.design.requirements.check import cylinder_mass
from armdesign.design.requirements.settings import Requirements
from armdesign.design.search.infeasibility.explanation import require_feasible
from armdesign.design.search.infeasibility.restoration import restore_feasibility
from armdesign.design.search.multistart import Starts, formulate_with_sizes, multistart, run_to_end
from armdesign.design.search.prices import LEAST_PRICE, marginal_prices
from armdesign.design.search.rounding import rounded_machine
from armdesign.design.search.sequential_sdp import MISSED, Search
from armdesign.errors import ArmDesignError, InfeasibleError, UntriedError
from armdesign.frequency.bands import Bands
from armdesign.frequency.modes import hertz
from armdesign.frequency.workspace import Workspace
from armdesign.machine.machine import Machine

AMOUNTS = {"oil": "oil_total_share", "flow": "oil_each_share", "mass": "cylinder_mass"}
WIDEST = 4.0  # times today's amount
GROWTH = 1.3  # of the amount, until it is enough
LITTLE = 0.02  # of the amount: the first step to more where no sizes of a catalogue do
NARROW = 3e-4  # bracket of the amount, relative
LESS = 1e-6  # share by which the next combination of a catalogue must need less than the last
NAMED = 3  # requirements named where a frequency is out of reach
SEARCHES = 40
SLOPES = (0.05, 5.0)  # of log frequency by log amount that are believed
TURNS = 5  # of sizes for an amount and the amount for sizes
# shares of the amount that rounding may cost; frequency may hardly depend on the amount
ROOM = (0.0, 3e-4, 1e-3, 2e-3, 4e-3, 8e-3, 0.016, 0.032, 0.064, 0.128, 0.256)


@checked
@with_options(SearchOptions, USUAL_SEARCH)
def least(
    machine: Machine,
    workspace: Workspace | None = None,
    requirements: Requirements | None = None,
    *,
    frequency: float,
    of: str = "oil",
    vary: Sequence[str] = ("areas", "pins"),
    **options: Unpack[SearchOptions],
) -> Design:
    """The machine of a given worst frequency that needs least oil, pump flow or steel.

    Its ``requirements`` state the amount: the limit on what was made least takes the place of the
    one given.

    Args:
        machine: today's machine.
        workspace: poses that count; default grid if None.
        requirements: all other limits; None: the machine's file states them.
        frequency: lowest coupled frequency [Hz] that no pose of the workspace and load case may
            fall below, nor within the bands.
        of: "oil": swept volume of all cylinders together, bore sides or annulus sides, whichever
            is the larger share of today's (``oil_total_share``). "flow": pump flow at which every
            cylinder, moving alone, crosses its range in today's time: the largest share of today's
            swept volume of any cylinder and side (``oil_each_share``) × today's flow. Motors,
            which no search changes, turn as much slower as that flow is less. "mass": estimated
            mass of all cylinders (``cylinder_mass`` [kg]).
        vary: as in ``optimize``.
        starts: as in ``optimize``.
        seed: as in ``optimize``.
        workers: as in ``optimize``.
        bands: what is not known exactly: the worst frequency within them is then what may not fall
            below.
        catalogue: as in ``optimize``. Where no pin varies the answer is the least of all
            combinations; ``best_sizes.below`` says whether that is proved.

    Raises:
        InfeasibleError: no amount is enough, because other requirements limit the frequency.
        ArmDesignError: ``of`` names no amount, or ``frequency`` is not above 0.

    Example:
        >>> import armdesign as ad
        >>> machine = ad.load("paper_1dof")
        >>> workspace = ad.Workspace.grid(machine, points=3)
        >>> design = ad.least(machine, workspace, frequency=7.2, vary=["areas"], starts=1)
        >>> print(f"{design.requirements.oil_total_share:.3f} of the oil of today")
        0.975 of the oil of today
    """
    if of not in AMOUNTS:
        raise ArmDesignError("of", f'"{of}" is not allowed', f"give one of {', '.join(AMOUNTS)}")
    if not (math.isfinite(frequency) and frequency > 0):
        raise ArmDesignError("frequency", f"{frequency:g} Hz is not allowed", "give a number > 0")
    starts, seed, workers = options["starts"], options["seed"], options["workers"]
    bands, catalogue = options["bands"], options["catalogue"]
    problem, sizes = formulate_with_sizes(
        machine, workspace, requirements, vary,
        bands=bands, objective="worst", catalogue=catalogue,
    )  # fmt: skip
    command = call(
        "least", frequency=frequency, of=of, vary=tuple(vary), starts=starts, seed=seed,
        bands=bands, catalogue=catalogue,
    )  # fmt: skip

    def solve(problem: Problem, _: Found | None) -> Outcome:
        least_amount = LeastAmount(problem=problem, of=of, frequency=frequency)
        if sizes is not None and not problem.vector.moving:
            search, best_sizes = least_amount.with_given_pins(sizes)
            return Outcome.of(search, Starts((best_sizes.frequency,)), best_sizes)
        search, failed = least_amount.under_today(starts, seed, workers)
        search = least_amount.search(search)
        if sizes is not None:
            search = least_amount.with_sizes(search, sizes)
        return least_amount.rounded(search, failed)

    def search_for_design() -> Design:
        return Design.of(Outcome.at_all_masses(problem, solve), command=command)

    if sizes is not None:
        refuse_fixed_sizes(problem)
    return finished_design(Design, problem, [command, repr(sizes)], search_for_design)


def amount_of(machine: Machine, today: Machine, of: str) -> float:
    """Amount that a machine needs: share of today's oil or flow, or mass [kg]."""
    if of == "mass":
        return cylinder_mass(machine)
    new, old = (
        np.array([[c.bore_area * c.stroke, c.annulus_area * c.stroke] for c in one.cylinders])
        for one in (machine, today)
    )
    return float((new.sum(axis=0) / old.sum(axis=0) if of == "oil" else new / old).max())


def amounts(design: Design, of: str) -> tuple[float, float]:
    """Oil of all cap sides [m³], pump flow [m³/s] or mass of all cylinders [kg], today and new."""
    today, new = design.today, design.machine
    if of == "oil":
        before, after = (sum(c.bore_area * c.stroke for c in m.cylinders) for m in (today, new))
        return float(before), float(after)
    scale = today.supply.flow if of == "flow" else 1.0
    return scale * amount_of(today, today, of), scale * amount_of(new, today, of)


@dataclass(frozen=True, eq=False, kw_only=True)
class LeastAmount:
    """Searches for a ``frequency`` [Hz] under several limits on an amount ``of`` something."""

    problem: Problem
    of: str
    frequency: float

    def under_today(self, starts: int | None, seed: int, workers: int) -> tuple[Search, Starts]:
        """The best design under today's amount, with any sizes; and the starts that failed.

        What others reach there is above all that the least amount allows.
        """
        under = self._under(self.problem, self._today)
        search, outcomes = multistart(under, starts, seed, workers)
        return search, replace(outcomes, reached=())

    def search(self, search: Search) -> Search:
        """The search under the smallest amount that reaches the frequency, before rounding."""
        search, low = self._enough(search)
        slope = 0.5  # of log frequency by log amount: ω² grows with the oil, at first
        for _ in range(SEARCHES):
            high, reached = self._amount(search), _frequency(search)
            if high / low < 1 + NARROW or reached < self.frequency * (1 + NARROW / 3):
                break
            guess = high * (self.frequency * (1 + NARROW / 6) / reached) ** (1 / slope)
            if not low * (1 + NARROW / 10) < guess < high / (1 + NARROW / 10):
                guess = math.sqrt(low * high)
            other = self._search(guess, search)
            under_guess = _frequency(other)
            if under_guess > 0 and under_guess != reached:
                slope = math.log(reached / under_guess) / math.log(high / guess)
                slope = float(np.clip(slope, *SLOPES))
            if under_guess >= self.frequency:
                search = other
            else:
                low = guess
        return search

    def with_sizes(self, search: Search, sizes: Sizes) -> Search:
        """The least amount with sizes of a catalogue, from that with free sizes."""
        best = self.search(self._sized(search, sizes))
        for _ in range(TURNS):
            other = improve_in_turn(best, sizes)
            if other.problem.sizes == best.problem.sizes:
                break
            best = self.search(other)
        return best

    def with_given_pins(self, sizes: Sizes) -> tuple[Search, SizeSelection]:
        """The combination that needs least with today's pins; of equals the best one."""
        search, best_sizes = self._select(WIDEST * self._today, sizes)
        if _frequency(search) < self.frequency:
            raise self._out_of_reach(_frequency(search))
        low, below = self._today / WIDEST**2, math.inf
        while low < (guess := _between(low, self._used(best_sizes))):
            try:
                search, other = self._select(guess, sizes)
            except InfeasibleError as error:
                low, below = guess, math.inf if isinstance(error, UntriedError) else 0.0
                continue
            if _frequency(search) >= self.frequency:
                best_sizes = other
            else:
                low, below = guess, other.bound
        search, best_sizes = self._select(self._used(best_sizes), sizes)
        proved = self.problem.vector.moving_masses is None
        return search, replace(best_sizes, below=below if proved else math.inf)

    def rounded(self, search: Search, failed: Starts) -> Outcome:
        """The outcome of the search, under a little more where rounding costs too much."""
        amount, worst = self._amount(search), 0.0
        for more in ROOM:
            under = self._under(search.problem, amount * (1 + more))
            as_it_is = search.of(under, search.x).look()
            # the best under a little more may have too little room where frequency is no matter
            for near in (as_it_is, self._search(amount * (1 + more), search)):
                machine = rounded_machine(near) if near.violation <= MISSED else None
                if machine is None:  # no room to round in
                    continue
                if machine.judged >= self.frequency:
                    return Outcome.of(near, failed, rounded=machine)
                worst = max(worst, machine.judged)
        fault = f"rounded sizes reach {worst:.4g} of {self.frequency:.4g} Hz"
        raise InfeasibleError(self.problem.machine.name, fault, "ask for less")

    def _enough(self, search: Search) -> tuple[Search, float]:
        """A search under an amount that is enough, and an amount that is not."""
        amount = self._amount(search)
        low = amount / WIDEST**2
        while _frequency(search) < self.frequency:
            if amount >= WIDEST * self._today:
                search = require_feasible(search)
                if _frequency(search) >= self.frequency:
                    return search, amount / WIDEST**2
                raise self._out_of_reach(_frequency(search), _held_back_by(search))
            low, amount = amount, min(amount * GROWTH, WIDEST * self._today)
            # from a design that meets all requirements to one that does not, though it has more
            search = restore_feasibility(self._search(amount, search))
        return search, low

    def _sized(self, search: Search, sizes: Sizes) -> Search:
        """Sizes near a search's free ones, or near those under more where no amount is enough.

        Only where none is enough for any of them does the design miss a requirement.
        """
        found, more = with_sizes(search, sizes), LITTLE
        while not self._can_do(found) and self._amount(search) < WIDEST * self._today:
            amount = min(self._amount(search) * (1 + more), WIDEST * self._today)
            search, more = self._search(amount, search), 2 * more
            found = with_sizes(search, sizes)
        return found

    def _can_do(self, search: Search) -> bool:
        """Whether its sizes meet all other requirements."""
        widest = WIDEST * self._today
        return search.violation <= MISSED or self._search(widest, search).violation <= MISSED

    def _select(self, amount: float, sizes: Sizes) -> tuple[Search, SizeSelection]:
        return sizes_for_pins(self._under(self.problem, amount), sizes)

    def _search(self, amount: float, near: Search) -> Search:
        problem = self._under(near.problem, amount)
        return run_to_end(Search(problem=problem, x=near.x), trust=0.2)

    def _under(self, problem: Problem, amount: float) -> Problem:
        change: dict[str, Any] = {AMOUNTS[self.of]: amount}
        return replace(problem, requirements=replace(problem.requirements, **change))

    def _used(self, best_sizes: SizeSelection) -> float:
        """Amount that a combination needs."""
        today = self.problem.machine
        pairs = zip(today.cylinders, best_sizes.sizes, strict=True)
        cylinders = tuple(replace(c, bore=bore, rod=rod) for c, (bore, rod) in pairs)
        return amount_of(replace(today, cylinders=cylinders), today, self.of)

    @property
    def _today(self) -> float:
        return amount_of(self.problem.machine, self.problem.machine, self.of)

    def _amount(self, search: Search) -> float:
        return float(getattr(search.problem.requirements, AMOUNTS[self.of]))

    def _out_of_reach(
        self, reached: float, dearest: tuple[list[str], list[str]] = ([], [])
    ) -> InfeasibleError:
        """The error that says what is reached, and what holds it back: ``_held_back_by``."""
        keys, words = dearest
        first = f", {' and '.join(keys)} first," if keys else ""
        besides = f"; no setting allows more of this: {', '.join(words)}" if words else ""
        allowed = f"the other requirements allow {reached:.4g} Hz"
        if self.problem.dynamics.corners.bands != Bands():
            allowed += " within the bands (--nominal or bands=ad.Bands(): at the file's values)"
        fault = f"{self.frequency:.4g} Hz is out of reach: {allowed}"
        remedy = f"relax them{first} or ask for less{besides}"
        return InfeasibleError(self.problem.machine.name, fault, remedy)


def _frequency(search: Search) -> float:
    """Worst frequency of a search [Hz]; 0 where it misses a requirement."""
    return hertz(search.squared) if search.violation <= MISSED else 0.0


def _held_back_by(search: Search) -> tuple[list[str], list[str]]:
    """Settings of the dearest limits of a search, the dearest first; words of those without."""
    costs = {name: -gain for name, gain in marginal_prices(search).items() if gain > LEAST_PRICE}
    limits = {c.name: c for c in evaluations_at(search.problem, search.x, search.holding)}
    keys: dict[str, None] = {}
    words: dict[str, None] = {}
    for name in sorted(costs, key=lambda name: costs[name])[:NAMED]:
        kind, _, pin = name.partition(".")
        if kind == "pin_box":
            keys[f"requirements.pin_boxes_mm.{pin}"] = None
        elif setting := limits[name].setting:
            keys[f"requirements.{setting}"] = None
        else:
            words[limits[name].words] = None
    return list(keys), list(words)


def _between(low: float, high: float) -> float:
    """The next amount to try under one that is enough: the middle, and at last next to it."""
    return math.sqrt(low * high) if high / low > 1 + NARROW else high * (1 - LESS)
