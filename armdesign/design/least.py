"""The reverse question: how little oil, pump flow or cylinder mass is enough for a given frequency.

The best worst frequency never falls when a limit is loosened. So the least amount is the root of *best frequency under
that limit = frequency asked for*, found by the secant rule within a bracket; each search starts from the last answer.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from armdesign.bands import Bands
from armdesign.design.check import cylinder_mass
from armdesign.design.codesign import Search, hertz
from armdesign.design.optimum import Design
from armdesign.design.problem import Problem
from armdesign.design.requirements import Requirements
from armdesign.design.rounding import worst_on_poses
from armdesign.design.searching import MISSED, STARTS, finished, met, multistart, posed
from armdesign.errors import ArmDesignError, InfeasibleError
from armdesign.machine import Machine
from armdesign.workspace import Workspace

AMOUNTS = {"oil": "oil_total_share", "flow": "oil_each_share", "mass": "cylinder_mass"}
WIDEST = 4.0  # times today's amount
NARROW = 3e-4  # bracket of the amount, relative
SEARCHES = 40
ROOM = (0.0, 3e-4, 1e-3, 2e-3, 4e-3, 8e-3, 0.016)  # shares of the amount that rounding may cost


def least(
    machine: Machine,
    workspace: Workspace | None = None,
    requirements: Requirements | None = None,
    *,
    frequency: float,
    of: str = "oil",
    vary: Sequence[str] = ("areas", "pins"),
    starts: int = STARTS,
    seed: int = 0,
    workers: int = 1,
    bands: Bands | None = None,
) -> Design:
    """The machine that needs least oil, pump flow or steel and still has a given worst frequency on the workspace.

    Its ``requirements`` state the amount: the limit on what was made least takes the place of the one given.

    Args:
        machine: today's machine.
        workspace: poses that count; default grid if None.
        requirements: all other limits; those of the machine's file if None.
        frequency: lowest coupled frequency [Hz] that no pose of the workspace and load case may fall below.
        of: "oil": swept volume of all cylinders together, bore sides or annulus sides, whichever is the larger share
            of today's (``oil_total_share``). "flow": pump flow at which every function, moving alone, crosses its
            range in today's time: the largest share of today's swept volume of any cylinder and side
            (``oil_each_share``) × today's flow. "mass": estimated mass of all cylinders (``cylinder_mass`` [kg]).
        vary: as in ``optimize``.
        starts: as in ``optimize``.
        seed: as in ``optimize``.
        workers: as in ``optimize``.
        bands: what is not known exactly: the worst frequency within them is then what may not fall below.

    Raises:
        InfeasibleError: no amount is enough, because other requirements limit the frequency.
    """
    if of not in AMOUNTS:
        raise ArmDesignError("of", f'"{of}" is not allowed', f"give one of {', '.join(AMOUNTS)}")
    if not (math.isfinite(frequency) and frequency > 0):
        raise ArmDesignError("frequency", f"{frequency:g} Hz is not allowed", "give a number > 0")
    problem = posed(machine, workspace, requirements, vary, bands=bands)
    hunt = _Hunt(problem=problem, limit=AMOUNTS[of], today=cylinder_mass(machine) if of == "mass" else 1.0)
    return hunt.rounded(hunt.least(frequency, starts, seed, workers), frequency)


@dataclass(eq=False, kw_only=True)
class _Hunt:
    """Searches under several limits on one amount, ``limit`` of the requirements; ``today`` is a start for it."""

    problem: Problem
    limit: str
    today: float
    reached: tuple[float, ...] = ()

    def least(self, frequency: float, starts: int, seed: int, workers: int) -> Search:
        """The search under the smallest amount that reaches a frequency [Hz], before rounding."""
        search, self.reached = multistart(self._under(self.today), starts, seed, workers)
        search, low = self._enough(search, frequency)
        slope = 0.5  # of log frequency by log amount: ω² grows with the oil, at first
        for _ in range(SEARCHES):
            high, found = self._amount(search), _frequency(search)
            if high / low < 1 + NARROW or found < frequency * (1 + NARROW / 3):
                break
            guess = high * (frequency * (1 + NARROW / 6) / found) ** (1 / slope)
            if not low * (1 + NARROW / 10) < guess < high / (1 + NARROW / 10):
                guess = math.sqrt(low * high)
            other = self._search(guess, search)
            now = _frequency(other)
            if now > 0 and now != found:
                slope = float(np.clip(math.log(found / now) / math.log(high / guess), 0.05, 5.0))
            if now >= frequency:
                search = other
            else:
                low = guess
        return search

    def _enough(self, search: Search, frequency: float) -> tuple[Search, float]:
        """A search under an amount that is enough, and an amount that is not."""
        amount, low = self.today, self.today / WIDEST**2
        while _frequency(search) < frequency:
            if amount >= WIDEST * self.today:
                search = met(search)
                raise InfeasibleError(
                    self.problem.machine.name,
                    f"{frequency:.4g} Hz is out of reach: the other requirements allow {_frequency(search):.4g} Hz",
                    "loosen them or ask for less",
                )
            low, amount = amount, min(amount * 1.3, WIDEST * self.today)
            search = self._search(amount, search)
        return search, low

    def rounded(self, search: Search, frequency: float) -> Design:
        """The rounded design, under a little more where rounding costs too much."""
        amount, worst = self._amount(search), 0.0
        for more in ROOM:
            try:
                design = Design.of(self._search(amount * (1 + more), search) if more else search, self.reached)
            except InfeasibleError:  # no room to round in
                continue
            worst = worst_on_poses(design.machine, design.problem)
            if worst >= frequency:
                return design
        raise InfeasibleError(
            self.problem.machine.name, f"rounded sizes reach {worst:.4g} of {frequency:.4g} Hz", "ask for less"
        )

    def _search(self, amount: float, near: Search) -> Search:
        return finished(Search(problem=self._under(amount), x=near.x, programme=near.programme), trust=0.2)

    def _under(self, amount: float) -> Problem:
        change: dict[str, Any] = {self.limit: amount}
        return replace(self.problem, requirements=replace(self.problem.requirements, **change))

    def _amount(self, search: Search) -> float:
        return float(getattr(search.problem.requirements, self.limit))


def _frequency(search: Search) -> float:
    """Worst frequency of a search [Hz]; 0 where it misses a requirement."""
    return hertz(search.squared) if search.violation <= MISSED else 0.0
