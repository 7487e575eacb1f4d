"""A design: the new machine beside today's, how it was judged, and what bounds and limits it.

The optimum is found in real numbers, then rounded to what a drawing can say (0.1 mm), written to a
machine file, read back and judged by ``check``, which knows nothing of the optimiser.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self, TypeAlias

import numpy as np

from armdesign.arrays import Array, ReadOnly
from armdesign.design.bound.certificate import Certificate, certificate_within_bands
from armdesign.design.catalogue.branch_and_bound import SizeSelection
from armdesign.design.program.problem import ChosenSizes, Problem
from armdesign.design.provenance import documented
from armdesign.design.requirements.check import slacks, static_loads
from armdesign.design.requirements.record import Check
from armdesign.design.requirements.settings import Requirements
from armdesign.design.search.file_changes import with_todays_structure
from armdesign.design.search.infeasibility.explanation import not_written, require_feasible
from armdesign.design.search.multistart import Starts
from armdesign.design.search.prices import LEAST_PRICE, prices
from armdesign.design.search.rounding import CheckedMachine, rounded_machine
from armdesign.design.search.sequential_sdp import Search
from armdesign.frequency.bands import Bands
from armdesign.frequency.frequency_band import FrequencyBand, frequency_band
from armdesign.frequency.maps import FrequencyMap, frequency_map
from armdesign.frequency.modes import hertz
from armdesign.frequency.workspace import Workspace
from armdesign.frequency.worst_frequency import WorstPose, worst_anywhere
from armdesign.hydraulics.actuator import areas_of
from armdesign.machine.lift_chart import lift_chart_if_any
from armdesign.machine.machine import Machine
from armdesign.short_repr import short_repr
from armdesign.units import mm, percent

if TYPE_CHECKING:
    from armdesign.plots.canvas import Figure

Found: TypeAlias = tuple[Array, ChosenSizes]  # a design x, and the sizes that it has
SMALLER = 0.99  # areas, to tell what depends on them
BINDING = 2e-3  # a requirement with less slack than this binds


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a search came to: where it ended, and a machine near there that can be written.

    Attributes:
        search: at its end, where all requirements are met.
        starts: what each of its starts came to.
        best_sizes: as in ``Design``.
        rounded: the machine.
    """

    search: Search
    starts: Starts
    best_sizes: SizeSelection | None
    rounded: CheckedMachine

    @classmethod
    def of(
        cls,
        search: Search,
        starts: Starts,
        best_sizes: SizeSelection | None = None,
        rounded: CheckedMachine | None = None,
    ) -> Outcome:
        """The outcome of a search; ``rounded`` is its machine where that is known.

        Raises:
            InfeasibleError: it misses a requirement, or nothing near it does that can be written.
        """
        search = require_feasible(search)
        rounded = rounded or rounded_machine(search)
        if rounded is None:
            raise not_written(search)
        return cls(search, starts, best_sizes, rounded)

    @classmethod
    def at_all_masses(
        cls, problem: Problem, solve: Callable[[Problem, Found | None], Outcome]
    ) -> Outcome:
        """The outcome whose machine is nowhere worse than at the corners that its problem counts.

        At first these have masses at the ends of their bands. Those between at which the machine
        is worse join, and ``solve`` goes on from the design found. Only one problem's poses are
        held at a time.
        """
        if not problem.dynamics.corners.not_counted:
            return solve(problem, None)
        between, found = problem.dynamics.corners.between, None
        while True:
            outcome = solve(problem.counting(between), found)
            new, own = outcome.rounded, outcome.search.problem
            more = own.dynamics.corners.missed(new.machine, new.judged)
            if not more:
                return outcome
            between, found = (*between, *more), (outcome.search.x, own.sizes)
            del outcome, new, own


@dataclass(frozen=True, eq=False, kw_only=True)
class Design(ReadOnly):
    """A new machine, why it is allowed, and what it gains.

    Attributes:
        machine: the new machine, rounded and read back from its file.
        today: the machine it was made from.
        requirements: the limits it was made under.
        checks: every requirement judged on the new machine.
        prices: for each requirement, the relative gain in the worst frequency from relaxing it by
            1 %, solved again from the optimum; requirements that one setting states are relaxed
            together and share the gain.
        at_margin: the gain per 1 % for a small relaxation (the multiplier), before another limit
            is met.
        unrounded: worst frequency of the optimum before rounding, on the workspace's poses, within
            the bands that it was made for [Hz]; where it was made for the least gain within them,
            that gain times today's worst frequency with the file's values.
        starts: what each start of the search reached, as ``unrounded`` [Hz], without those that
            failed: at its end, or where it was left because another was near the same optimum or
            far better. None of a search for a least amount, whose starts have another one.
        failed_starts: of every start that failed why, in words.
        workspace: today's workspace.
        problem: the problem that was solved.
        x: the optimum before rounding.
        watched: rows of the problem that the search kept an eye on.
        best_sizes: the sizes of a catalogue and their proof, where nothing but sizes varied; None
            otherwise.
        bandwidths: least bandwidth of today's machine, of the one of the highest worst frequency
            and of this one [Hz], where that was the objective; None otherwise.
    """

    __repr__ = short_repr

    machine: Machine
    today: Machine
    requirements: Requirements
    checks: tuple[Check, ...]
    prices: dict[str, float]
    at_margin: dict[str, float]
    unrounded: float
    starts: tuple[float, ...]
    failed_starts: tuple[str, ...]
    workspace: Workspace
    problem: Problem
    x: Array
    watched: Array
    best_sizes: SizeSelection | None = None
    bandwidths: tuple[float, float, float] | None = None

    @classmethod
    def of(cls, outcome: Outcome, *, command: str) -> Design:
        """The design of a search, whose file says that ``command`` made it."""
        search, best_sizes, rounded = outcome.search, outcome.best_sizes, outcome.rounded
        problem, priced = search.problem, {} if best_sizes else prices(search)
        machine = with_todays_structure(rounded.machine, problem.machine)
        return cls(
            machine=documented(machine, problem, command),
            today=problem.machine,
            requirements=problem.requirements,
            checks=rounded.checks,
            prices={name: price.gain for name, price in priced.items()},
            at_margin={name: price.at_margin for name, price in priced.items()},
            unrounded=hertz(search.squared),
            starts=outcome.starts.reached,
            failed_starts=outcome.starts.failed,
            workspace=problem.workspace,
            problem=problem,
            x=search.x,
            watched=search.rows,
            best_sizes=best_sizes,
        )

    @property
    def headline(self) -> str:
        """Machine, worst frequency today and new, its gain, the aim of the search, what binds.

        With the least gain within the bands and the least bandwidths where it was made for them.
        """
        before, after = self.before.worst.frequency, self.after.worst.frequency
        words = f"worst {before:.4g} → {after:.4g} Hz, {percent(self.gain)}"
        if self.made_for in ("gain", "worst"):
            words += f", at least {percent(self.least_gain)} within the bands"
        if self.bandwidths is not None:
            today, _, new = self.bandwidths
            words = f"least bandwidth {today:.4g} → {new:.4g} Hz, {words}"
        binding = ", ".join(check.name for check in self.binding) or "nothing"
        return f"of {self.today.name}: {words}, aim {self.made_for}; binding: {binding}"

    @property
    def identity(self) -> list[Any]:
        """Everything in which two that a search starts from can differ."""
        return [self.problem.identity, self.x.tolist()]

    @property
    def catalogue(self) -> bool:
        """Whether bores and rods come from a catalogue."""
        return bool(self.problem.sizes)

    @cached_property
    def before(self) -> FrequencyMap:
        """Today's machine over its workspace."""
        return frequency_map(self.today, self.workspace)

    @cached_property
    def after(self) -> FrequencyMap:
        """The new machine over the same workspace."""
        return frequency_map(self.machine, self.workspace)

    @cached_property
    def worst_in_own_workspace(self) -> WorstPose:
        """The new machine's worst pose in its own workspace.

        End margins are shares of its own strokes.
        """
        counts = [len(axis) for axis in self.workspace.axes]
        own = Workspace.grid(self.machine, counts, end_margin=self.workspace.end_margin)
        return worst_anywhere(self.machine, own)

    @cached_property
    def lift_share(self) -> float:
        """Least lift over today's of all points of the lift chart that lift; NaN without any."""
        today = lift_chart_if_any(self.today)
        new = None if today is None else lift_chart_if_any(self.machine, today)
        if today is None or new is None:
            return math.nan
        lifts = dict(zip(zip(new.reach, new.height, strict=True), new.capacity, strict=True))
        points = zip(today.reach, today.height, today.capacity, strict=True)
        shares = (lifts.get((x, z), 0.0) / lift for x, z, lift in points if lift > 0)
        return min(shares, default=math.nan)

    @property
    def made_for(self) -> str:
        """Aim of the search: "gain" or "worst" frequency within bands, "nominal", "bandwidth"."""
        if self.problem.dynamics.corners.emphasis is not None:
            return "bandwidth"
        if self.problem.dynamics.corners.bands == Bands():
            return "nominal"
        return "gain" if self.problem.dynamics.corners.gain else "worst"

    @property
    def bands(self) -> Bands:
        """Bands that it was made for; if none, the file's; if that has none, assumed structure."""
        bands = self.problem.dynamics.corners.bands
        return Bands.shown(self.today) if bands == Bands() else bands

    @cached_property
    def band_before(self) -> FrequencyBand:
        """Today's worst frequency within the bands, on the workspace's poses."""
        known = self.problem.dynamics.corners
        if known.bands == self.bands:
            return known.band
        return frequency_band(self.today, self.workspace, self.bands)

    @cached_property
    def band_after(self) -> FrequencyBand:
        """The new machine's worst frequency within the bands, on the same poses."""
        return frequency_band(self.machine, self.workspace, self.bands, today=self.today)

    @cached_property
    def judged(self) -> float:
        """The search's objective of the new machine on the workspace's poses [Hz].

        What a bound on designs of its kind is compared with.
        """
        corners = self.problem.dynamics.corners
        if corners.emphasis is not None or corners.bands != self.bands:
            return corners.judged(self.machine)
        return corners.objective({one.corner: one.frequency for one in self.band_after.scenarios})

    @property
    def gain(self) -> float:
        """Relative gain in the worst frequency with the file's values; inf over 0 Hz."""
        before, after = self.before.worst.frequency, self.after.worst.frequency
        if before > 0:
            return after / before - 1
        return math.inf if after > 0 else 0.0

    @property
    def least_gain(self) -> float:
        """Least relative gain over today's machine within the bands; a sample.

        Of the lowest of the workspace's poses, and of what lies between them with the file's
        values.
        """
        return min(self.band_after.least_gain(self.band_before), self.gain)

    def written_by(self, command: str) -> Machine:
        """The new machine with a file that says it was made by ``command``."""
        return documented(self.machine, self.problem, command)

    def plot(self, plane: str = "joints") -> Figure:
        """Maps before and after on one colour scale over two joints or over reach and height.

        Returns the figure.
        """
        from armdesign import plots

        return plots.before_after(self, plane)

    def _repr_html_(self) -> str:
        from armdesign.report import notebook

        return notebook.of_design(self)

    @cached_property
    def certificate(self) -> Certificate | None:
        """Upper bound on ``unrounded`` of all designs of this kind, with its assumptions.

        Where pins vary it takes seconds to find.

        With a catalogue: what none of its sizes exceeds. Where own masses vary with them and no
        pin does: what no sizes at all exceed, so none of the catalogue either. Refused where this
        design exceeds it. None is known of bandwidths.
        """
        if self.made_for == "bandwidth":
            return None
        # else sizes were chosen with masses held
        if self.best_sizes is not None and self.problem.vector.moving_masses is None:
            words = ("today's workspace and load cases", "today's pins", "sizes of the catalogue")
            most = self.best_sizes.bound
            refused = "the one of all combinations lies below the best"
            refused = "" if math.isfinite(most) else refused
            bound = Certificate(frequency=most, held=(), assumptions=words, refused=refused)
            return bound.above(self.unrounded)
        free = replace(self.problem, sizes=()) if self.catalogue else self.problem
        known = certificate_within_bands(free, self.x, self.watched)
        most = max(self.unrounded, self.judged)
        return known and known.above(most).useful(most)

    def unproved(self) -> Self:
        """The same design without a bound, for those who do not wait for it."""
        known = Certificate(frequency=math.inf, held=(), assumptions=(), refused="interrupted")
        design = copy(self)
        design.__dict__["certificate"] = known
        return design

    @property
    def bound(self) -> float | None:
        """Worst frequency that no design of this kind can exceed on the workspace's poses [Hz].

        None: none is known. As ``unrounded`` where a gain was to be made large.
        """
        known = self.certificate
        return known.frequency if known and math.isfinite(known.frequency) else None

    @property
    def gap(self) -> float | None:
        """Share by which the bound exceeds the optimum before rounding; None: no bound known."""
        if self.bound is None:
            return None
        return self.bound / self.unrounded - 1 if self.unrounded > 0 else math.inf

    @property
    def slacks(self) -> dict[str, float]:
        """Relative slack of every requirement, ≥ 0 where it is met."""
        return {c.name: c.slack for c in self.checks}

    @property
    def binding(self) -> list[Check]:
        """Requirements that bind and cost frequency, the dearest first."""
        dear = {name for name, gain in self.at_margin.items() if gain > LEAST_PRICE}
        held = [c for c in self.checks if self._is_held(c) and c.name in dear]
        return sorted(held, key=lambda c: -self.prices[c.name])

    def _is_held(self, check: Check) -> bool:
        """Whether a requirement leaves no room, or in its box a pin no step of the drawing."""
        left, step = check.limit - check.value, self.problem.grid.lengths * mm
        return check.slack < BINDING or (check.name.startswith("pin_box.") and left < step)

    @property
    def tightest(self) -> list[Check]:
        """Requirements that depend on areas, the least slack first: for sizes in steps."""
        loads = static_loads(self.machine, self.workspace)
        areas = areas_of(self.machine.actuators)
        both = np.stack([areas, SMALLER * areas])
        names, slack_pair = slacks(
            self.machine, both, self.today, self.workspace, self.requirements, loads
        )
        dependent = {
            name
            for name, slack, smaller in zip(names, *slack_pair, strict=True)
            if slack != smaller
        }
        return sorted((c for c in self.checks if c.name in dependent), key=lambda c: c.slack)
