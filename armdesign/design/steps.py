"""Steps of a design: the best machine with no pin moved, with one, with two, up to all.

For each number of pins every set of them is searched, with free sizes; where the sets are too
many, those that add a pin to the best of the step before. The best are then designed as
``optimize`` would. Sizes of a catalogue and lengths on the drawing's grid can reverse their order,
so that with a catalogue some are. Of the other sets upper bounds prove that they hold nothing
better (``proved_sets``); those of which they do not are designed, too, and the best is the answer.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

from armdesign.arguments import checked, with_options
from armdesign.design.bound.unfit_sizes import refuse_unfit_catalogue
from armdesign.design.catalogue.sizes import Sizes, sizes_and_grid
from armdesign.design.design import Design
from armdesign.design.kept_designs import form
from armdesign.design.optimize import USUAL_SEARCH, SearchOptions, outcome_of
from armdesign.design.program.problem import Problem
from armdesign.design.program.variables import chosen
from armdesign.design.proved_sets import Bounds, Pins, bounds_of_others, most_of, others
from armdesign.design.provenance import call
from armdesign.design.requirements.settings import Requirements
from armdesign.design.search.multistart import (
    ROUGHLY,
    TO_THE_END,
    follow_all,
    formulate,
    start_designs,
)
from armdesign.design.search.sequential_sdp import NEARLY, Search
from armdesign.errors import ArmDesignError, InfeasibleError
from armdesign.frequency.workspace import Workspace
from armdesign.journal.finished import Form, all_finished
from armdesign.machine.machine import Machine
from armdesign.processes import in_processes
from armdesign.short_repr import short_repr
from armdesign.units import percent

if TYPE_CHECKING:
    import pandas as pd

    from armdesign.plots.canvas import Axes, Figure

SETS = 24  # of so many pins that are all searched
BUILT = 3  # sets of as many pins, the best with free sizes, that are designed by a catalogue


@dataclass(frozen=True, eq=False, kw_only=True)
class DesignStep:
    """The best design with so many pins moved.

    Attributes:
        pins: key paths of those that may move, "cylinder.boom.base".
        design: with these pins and any cylinders.
        searched: sets of as many pins that were searched with free sizes.
        built: of these the ones that were designed as they can be built: the best, and those that
            no bound rules out.
        sets: that there are.
        open_sets: other sets that no upper bound rules out, each with the share by which a design
            of it might exceed this one's worst frequency: infinite without a bound. None: no
            bounds were sought.
    """

    __repr__ = short_repr

    pins: Pins
    design: Design
    searched: int
    built: int
    sets: int
    open_sets: Mapping[Pins, float] | None = None

    @property
    def proved(self) -> int:
        """Other sets of which an upper bound says that none of their designs gains more.

        With a catalogue a bound on what can be built, see ``proved_sets``; else on all designs.
        """
        return 0 if self.open_sets is None else self.sets - 1 - len(self.open_sets)

    @property
    def excess(self) -> float:
        """Share by which a design of the sets left open might exceed this one's worst frequency.

        0 where none is, infinite where one has no bound.
        """
        return math.inf if self.open_sets is None else max(self.open_sets.values(), default=0.0)

    @property
    def gain(self) -> float:
        """Gain in the worst frequency: the least within the bands it was made for, if any."""
        return _gain(self.design)

    def plot(self, plane: str = "joints") -> Figure:
        """Figure of its design: maps of today's and the new machine."""
        return self.design.plot(plane)

    @property
    def changed(self) -> tuple[str, ...]:
        """Parts that differ from today's machine: cylinders and pins."""
        new, today = self.design.machine, self.design.today
        cylinders = [
            f"{a.name} cylinder"
            for a, b in zip(new.cylinders, today.cylinders, strict=True)
            if (a.bore, a.rod, a.stroke, a.closed_length)
            != (b.bore, b.rod, b.stroke, b.closed_length)
        ]
        moved = [
            f"{cylinder.name} {place.replace('_', '-')}"
            for cylinder, a, b in zip(new.cylinders, new.linkages, today.linkages, strict=True)
            for place in a.places
            if a.place(place) != b.place(place)
        ]
        return (*cylinders, *moved)


@dataclass(frozen=True, eq=False, kw_only=True)
class Steps:
    """The best designs with more and more pins moved.

    Attributes:
        today: the machine that all were made from.
        steps: one for each number of pins, the least first.
        left_out: numbers of pins with which no design was found, or none better than with fewer,
            and why.
    """

    __repr__ = short_repr

    today: Machine
    steps: tuple[DesignStep, ...]
    left_out: dict[int, str]

    @property
    def robust(self) -> bool:
        """Whether the designs were made for bands."""
        return _robust(self.steps[0].design)

    @property
    def headline(self) -> str:
        """Machine, and the gain of each step."""
        gains = ", ".join(f"{percent(one.gain)} by {len(one.pins)}" for one in self.steps)
        return f"of {self.today.name}: by number of moved pins {gains or 'nothing'}"

    def plot(self, ax: Axes | None = None) -> Axes:
        """Gain by pins moved, and which they are; returns the axes."""
        from armdesign import plots

        return plots.design_steps(self, ax)

    @cached_property
    def frame(self) -> pd.DataFrame:
        """A row for each step.

        ``pins`` that may move and their paths ``moved``; ``gain``, the least within the bands that
        the designs were made for, without bands that of ``worst_hz``; ``worst_hz`` at the file's
        values; ``lift_share``, the least over the lift chart; ``changed`` parts; ``searched`` of
        ``sets`` with free sizes, ``built`` of these, and of the other sets ``proved`` to hold
        nothing better; ``excess`` that bounds leave to any of the others.
        """
        import pandas as pd

        return pd.DataFrame(
            {
                "pins": len(step.pins),
                "moved": " ".join(step.pins),
                "gain": step.gain,
                "worst_hz": step.design.after.worst.frequency,
                "lift_share": step.design.lift_share,
                "changed": ", ".join(step.changed),
                "searched": step.searched,
                "built": step.built,
                "sets": step.sets,
                "proved": step.proved,
                "excess": step.excess,
            }
            for step in self.steps
        )

    @property
    def sentences(self) -> list[str]:
        """Steps that are left out, and the reasons."""
        return [f"{count} pins are left out: {why}" for count, why in self.left_out.items()]


@checked
@with_options(SearchOptions, USUAL_SEARCH)
def steps(
    machine: Machine,
    workspace: Workspace | None = None,
    requirements: Requirements | None = None,
    *,
    objective: str = "gain",
    **options: Unpack[SearchOptions],
) -> Steps:
    """Which change first: the best designs with no pin moved, with one, … up to all.

    Args:
        machine: today's machine.
        workspace: poses that count; default grid if None.
        requirements: limits; None: the machine's file states them.
        objective: as in ``optimize``.
        starts: how many starts each set of pins has: today's pins, those of the best set with one
            pin less, and drawn ones; None: the first two alone.
        seed: of the drawn starts.
        workers: processes that share the searches. The answer does not depend on it.
        bands: as in ``optimize``.
        catalogue: as in ``optimize``.

    Raises:
        InfeasibleError: no step has a design.

    Example:
        >>> import armdesign as ad
        >>> machine = ad.load("paper_1dof")
        >>> workspace = ad.Workspace.grid(machine, points=2)
        >>> which = ad.steps(machine, workspace)
        >>> for step in which.steps:
        ...     print(len(step.pins), f"{step.gain:+.1%}", *step.pins)
        ...
        0 +0.0%
        1 +16.0% cylinder.lift.rod_end
        2 +16.1% cylinder.lift.base cylinder.lift.rod_end
    """
    requirements = requirements or Requirements.of(machine)
    workspace = workspace or Workspace.grid(machine, end_margin=requirements.end_margin)
    starts, seed, workers = options["starts"], options["seed"], options["workers"]
    sizes, grid = sizes_and_grid(machine, options["catalogue"])
    pins = _pins(machine)

    problem = formulate(
        machine, workspace, requirements, ("areas", *pins), bands=options["bands"],
        objective=objective, grid=grid,
    )  # fmt: skip
    if sizes and pins:
        refuse_unfit_catalogue(problem)
    best: dict[Pins, Search] = {}
    for count in range(len(pins) + 1):
        problems = {some: problem.varying(("areas", *some)) for some in _sets(pins, count, best)}
        best |= _searched(problems, best, starts, seed, workers)
    command = _command(options)
    most = BUILT if sizes else 1
    few = [some for count in range(len(pins) + 1) for some in _best(best, count)[:most]]
    built = _designs({some: best[some] for some in few}, sizes, command, workers)
    answer = _rising(machine, built, best, pins)
    reached = {step.pins: step.design.judged for step in answer.steps}
    drawn = sizes is not None
    bounds = bounds_of_others(pins, best, reached, workers, _own(built, drawn), drawn)
    if sizes:
        left = {
            some: best[some]
            for chosen in reached
            for some in others(pins, chosen)
            if some in best and some not in built and most_of(some, bounds) > reached[chosen]
        }
        built |= _designs(left, sizes, command, workers)
        answer = _rising(machine, built, best, pins)
        reached = {step.pins: step.design.judged for step in answer.steps}
        # of those that lost
        bounds = bounds_of_others(pins, best, reached, workers, _own(built, drawn), drawn, bounds)
    return replace(answer, steps=tuple(_proved(step, pins, bounds) for step in answer.steps))


def _command(options: SearchOptions) -> str:
    """The call of ``steps`` with what was asked for."""
    drawn = (
        {} if options["starts"] is None else {"starts": options["starts"], "seed": options["seed"]}
    )
    return call("steps", **drawn, bands=options["bands"], catalogue=options["catalogue"])


def _proved(step: DesignStep, pins: Pins, bounds: Bounds) -> DesignStep:
    """The step with what bounds prove of the other sets of as many pins."""
    reached = step.design.judged
    most = {some: most_of(some, bounds) / reached - 1 for some in others(pins, step.pins)}
    return replace(step, open_sets={some: excess for some, excess in most.items() if excess > 0})


def _rising(
    machine: Machine,
    built: Mapping[Pins, Design | InfeasibleError],
    known: Mapping[Pins, Search],
    pins: Pins,
) -> Steps:
    """The best steps with no pin moved, with one, …, those left out that gain less.

    Raises:
        InfeasibleError: there is no design.
    """
    done: list[DesignStep] = []
    left_out: dict[int, str] = {}
    for count in sorted({len(some) for some in built}):
        designs = {some: one for some, one in built.items() if len(some) == count}
        design = _best_built([*designs.values()])
        if isinstance(design, InfeasibleError):
            left_out[count], refused = str(design.fault), design
            continue
        step = DesignStep(
            pins=tuple(design.problem.vector.vary[1:]),
            design=design,
            searched=sum(len(some) == count for some in known),
            built=len(designs),
            sets=math.comb(len(pins), count),
        )
        if done and step.gain < done[-1].gain:  # as can be built: in real numbers it would be more
            left_out[count] = f"no better than {len(done[-1].pins)}"
            continue
        done.append(step)
    if not done:
        raise refused
    return Steps(today=machine, steps=tuple(done), left_out=left_out)


def _robust(design: Design) -> bool:
    return design.made_for in ("gain", "worst")


def _gain(design: Design) -> float:
    """Gain of what a design was made for: within its bands, or with the file's values."""
    return design.least_gain if _robust(design) else design.gain


def _own(built: Mapping[Pins, Design | InfeasibleError], drawn: bool) -> dict[Pins, float]:
    """What designs reach [Hz], as a bound on drawn ones or on those before rounding."""
    designs = {some: one for some, one in built.items() if isinstance(one, Design)}
    return {some: one.judged if drawn else one.unrounded for some, one in designs.items()}


def _pins(machine: Machine) -> Pins:
    """Key paths of all pins that can move."""
    paths = []
    for cylinder in machine.cylinders:
        for pin in ("base", "rod_end"):
            try:
                chosen(machine, (f"cylinder.{cylinder.name}.{pin}",))
            except ArmDesignError:  # no such pin, or one whose move no stroke follows
                continue
            paths.append(f"cylinder.{cylinder.name}.{pin}")
    return tuple(paths)


def _sets(pins: Pins, count: int, known: dict[Pins, Search]) -> Iterator[Pins]:
    """All sets of so many pins; if they are too many, those that add one to the best known."""
    if math.comb(len(pins), count) <= SETS:
        yield from itertools.combinations(pins, count)
        return
    before = _best(known, count - 1)[0]
    for pin in pins:
        if pin not in before:
            yield tuple(p for p in pins if p == pin or p in before)


def _searched(
    problems: dict[Pins, Problem],
    known: dict[Pins, Search],
    count: int | None,
    seed: int,
    workers: int,
) -> dict[Pins, Search]:
    """Each problem searched from today's pins, the best known set with one pin less, drawn pins.

    These are ``count`` starts in all; None: none is drawn.
    """
    starts: list[tuple[Pins, Search]] = []
    for some, problem in problems.items():
        less = [known[part] for part in known if len(part) == len(some) - 1 and {*part} < {*some}]
        drawn = 1 if count is None else count - bool(less)
        designs = start_designs(problem, max(drawn, 1), seed)
        if less:
            parent = max(less, key=_rank)
            designs.insert(1, problem.like(parent.x, parent.problem))
        starts += ((some, Search(problem=problem, x=x)) for x in designs)
    rough = follow_all([search for _, search in starts], workers, **ROUGHLY)
    best: dict[Pins, Search] = {}
    for (some, _), search in zip(starts, rough, strict=True):
        best[some] = max(best.get(some, search), search, key=_rank)
    return dict(zip(best, follow_all([*best.values()], workers, **TO_THE_END), strict=True))


def _rank(search: Search) -> tuple[bool, float]:
    return search.violation < NEARLY, search.merit


def _best(known: dict[Pins, Search], count: int) -> list[Pins]:
    """The best known sets of so many pins, the best first."""
    of_count = (some for some in known if len(some) == count)
    return sorted(of_count, key=lambda some: _rank(known[some]), reverse=True)


def _best_built(designs: list[Design | InfeasibleError]) -> Design | InfeasibleError:
    """The design that gains most; without any, why the first is none."""
    found = (design for design in designs if isinstance(design, Design))
    return max(found, key=_gain, default=designs[0])


def _designs(
    best: Mapping[Pins, Search], sizes: Sizes | None, command: str, workers: int
) -> dict[Pins, Design | InfeasibleError]:
    """Design of each set's search, or why there is none."""
    searches = [*best.values()]
    designs = form(Design, [search.problem for search in searches])

    def identity(k: int) -> Any:
        return [searches[k].problem.identity, command, repr(sizes), searches[k].x.tolist()]

    def designs_of(numbers: list[int]) -> Iterator[tuple[int, Design | InfeasibleError]]:
        longest_first = sorted(numbers, key=lambda k: -len(searches[k].problem.vector.vary))
        some = ((k, searches[k]) for k in longest_first)
        tasks = (partial(_design, k, s.problem, s.x, sizes, command) for k, s in some)
        yield from in_processes(tasks, workers)

    def write(k: int, design: Design | InfeasibleError) -> Mapping[str, Any] | None:
        return None if isinstance(design, InfeasibleError) else designs.write(k, design)

    both: Form[Design | InfeasibleError] = Form(write=write, read=designs.read)
    found = all_finished("design", len(searches), identity, designs_of, both)
    return dict(zip(best, found, strict=True))


def _design(
    k: int, problem: Problem, x: Any, sizes: Sizes | None, command: str
) -> tuple[int, Design | InfeasibleError]:
    """The design of a search, or why there is none, with the number of the search."""
    try:
        outcome = outcome_of(problem, sizes, 1, given=(np.asarray(x), ()))
    except InfeasibleError as error:
        return k, error
    design = Design.of(outcome, command=command)
    _gain(design)  # which it remembers
    return k, design
