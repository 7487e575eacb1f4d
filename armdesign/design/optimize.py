"""Searches for the best design: sizes and pins of the best frequency, ``size_cylinders`` alone."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TypedDict

import numpy as np

from armdesign.arguments import checked
from armdesign.design.bound.unfit_sizes import refuse_unfit_catalogue
from armdesign.design.catalogue.alternation import (
    meeting_all,
    refuse_fixed_sizes,
    sized,
    sizes_and_pins,
    sizes_for_pins,
)
from armdesign.design.catalogue.sizes import Sizes, sizes_and_grid
from armdesign.design.design import Design, Found, Outcome
from armdesign.design.kept_designs import finished_design
from armdesign.design.program.corners import Emphasis
from armdesign.design.program.problem import Problem
from armdesign.design.provenance import call
from armdesign.design.requirements.settings import Requirements
from armdesign.design.search.idle_changes import without_idle_changes
from armdesign.design.search.infeasibility.explanation import (
    design_or_proof,
    not_written,
    require_feasible,
)
from armdesign.design.search.infeasibility.restoration import nearest_design
from armdesign.design.search.multistart import Starts, formulate, formulate_with_sizes, multistart
from armdesign.design.search.rounding import CheckedMachine, inmost_machine
from armdesign.design.search.sequential_sdp import MISSED, Search
from armdesign.errors import ArmDesignError, InfeasibleError
from armdesign.frequency.bands import Bands
from armdesign.frequency.modes import hertz
from armdesign.frequency.workspace import Workspace
from armdesign.machine.machine import Machine


class SearchOptions(TypedDict, total=False):
    """How ``optimize``, ``least``, ``pareto`` and ``steps`` search for designs."""

    starts: int | None
    seed: int
    workers: int
    bands: Bands | None
    catalogue: str | Iterable[Sequence[float]] | None


USUAL_SEARCH: SearchOptions = {
    "starts": None,
    "seed": 0,
    "workers": 1,
    "bands": None,
    "catalogue": None,
}


@dataclass(frozen=True, eq=False, kw_only=True)
class AimedSearch:
    """A search for the best design; the terms are those of ``optimize``.

    Attributes:
        vary: what may change.
        objective: what rises; instead of its name, by how much frequencies count at poses and
            load cases.
        start: a design to start from.
        options: how it is searched for, all of them.
    """

    vary: Sequence[str]
    objective: str | Emphasis
    start: Design | None = None
    options: SearchOptions

    @property
    def command(self) -> str:
        """The call of ``optimize`` that searches so."""
        options = self.options
        return call(
            "optimize", vary=tuple(self.vary), starts=options["starts"], seed=options["seed"],
            bands=options["bands"], objective=_stated(self.objective),
            catalogue=options["catalogue"],
        )  # fmt: skip


def best_frequency(
    machine: Machine,
    workspace: Workspace | None,
    requirements: Requirements | None,
    aimed: AimedSearch,
) -> Design:
    """The design of the highest lowest frequency, as ``optimize`` has it.

    Raises:
        ArmDesignError: as ``optimize``.
        InfeasibleError: as ``optimize``.
    """
    start, command, options = aimed.start, aimed.command, aimed.options
    problem, sizes = formulate_with_sizes(
        machine, workspace, requirements, aimed.vary,
        bands=options["bands"], objective=aimed.objective, catalogue=options["catalogue"],
    )  # fmt: skip
    if start is not None and _names(start.today) != _names(machine):
        fault = f"is a design of {start.today.name}, not of {machine.name}"
        raise ArmDesignError("start", fault, "give one of it")
    given = None if start is None else (problem.like(start.x, start.problem), start.problem.sizes)
    how = options["starts"], options["seed"], options["workers"]

    def under(problem: Problem, any_will_do: bool) -> Outcome:
        return outcome_of(problem, sizes, *how, given, any_will_do)

    def design() -> Design:
        outcome = design_or_proof(problem, under, sizes is not None)
        return Design.of(outcome, command=command)

    identity = [command, repr(sizes), given and [given[0].tolist(), repr(given[1])]]
    return finished_design(Design, problem, identity, design)


def outcome_of(
    problem: Problem,
    sizes: Sizes | None,
    starts: int | None,
    seed: int = 0,
    workers: int = 1,
    given: Found | None = None,
    any_will_do: bool = False,
) -> Outcome:
    """The best design of a problem, not yet priced; arguments as in ``optimize``.

    ``given`` is a design to start from, and the sizes that it has of a catalogue. Where
    ``any_will_do`` the first design is the answer, which the whole search falls back on too.

    Raises:
        InfeasibleError: none was found that meets the requirements.
    """

    def under(problem: Problem, found: Found | None) -> Outcome:
        return _outcome(problem, sizes, starts, seed, workers, found or given, any_will_do)

    return under(problem, None) if any_will_do else Outcome.at_all_masses(problem, under)


def _outcome(
    problem: Problem,
    sizes: Sizes | None,
    starts: int | None,
    seed: int,
    workers: int,
    given: Found | None,
    any_will_do: bool,
) -> Outcome:
    """``outcome_of`` a problem whose masses are those that it counts."""
    if not problem.vector.moving:
        if sizes is not None:
            return _of_catalogue(problem, sizes)
        outcome = Outcome.of(*multistart(problem, starts, seed, workers, given and given[0]))
        return _as_today_where_idle(outcome, None)
    if sizes is not None:
        refuse_fixed_sizes(problem)
        refuse_unfit_catalogue(problem)
    start = np.clip(given[0] if given else problem.vector.start, *problem.bounds)
    nearest = nearest_design(problem, start)
    if nearest.violation > MISSED:
        nearest = meeting_all(nearest, sizes)
    if any_will_do:
        return _first_outcome(sized(nearest, sizes))
    near = None
    if not np.array_equal(nearest.x, start):  # which misses some
        near = require_feasible(sized(nearest, sizes))
    try:
        if sizes is None:
            outcome = Outcome.of(*multistart(problem, starts, seed, workers, given and given[0]))
        else:
            search, reached, rounded = sizes_and_pins(problem, sizes, starts, seed, workers, given)
            outcome = Outcome.of(search, reached, rounded=rounded)
        return _as_today_where_idle(outcome, sizes)
    except InfeasibleError:
        near = near or sized(nearest, sizes)
        machine = _machine_near(near) if near.violation <= MISSED else None
        if machine is None:
            raise
        return Outcome(near, Starts(), None, machine)


def _machine_near(search: Search) -> CheckedMachine | None:
    """A machine near a search that can be written, its lengths the best for frequency nearby.

    Or the first that meets all requirements where the best miss one.
    """
    return inmost_machine(search) or inmost_machine(search, any_will_do=True)


def _first_outcome(search: Search) -> Outcome:
    """The first machine near a search that can be written, frequency left aside.

    Raises:
        InfeasibleError: the search misses a requirement, or none near it can be written.
    """
    search = require_feasible(search)
    machine = inmost_machine(search, any_will_do=True)
    if machine is None:
        raise not_written(search)
    return Outcome(search, Starts(), None, machine)


@checked
def size_cylinders(
    machine: Machine,
    workspace: Workspace | None = None,
    requirements: Requirements | None = None,
    *,
    dead_volume: str = "fixed",
    bands: Bands | None = None,
    objective: str = "gain",
    catalogue: str | Iterable[Sequence[float]] | None = None,
) -> Design:
    """Bore and rod of every cylinder for given pins, with an upper bound for any sizes.

    With ``dead_volume="proportional"`` (dead volumes grow with the areas) stiffness is linear in
    the areas: one semidefinite programme is the global optimum and ``bound`` its dual certificate
    (where buckling binds, which is reverse-convex, the bound may stay above the value). With
    "fixed" each step replaces the convex stiffness by its tangent, so frequencies rise from step
    to step; ``bound`` comes from its chord over all areas that are allowed.

    With a ``catalogue`` (as in ``optimize``, the file's by default) every cylinder has one
    of its sizes, and the combination is the best of all; ``bound`` equals ``unrounded`` where that
    is proved, and lies above it by the gap that is left where the combinations are too many.

    Args:
        machine: today's machine.
        workspace: poses that count; default grid if None.
        requirements: limits; None: the machine's file states them.
        dead_volume: "fixed", or "proportional" to the areas.
        bands: what is not known exactly, as in ``optimize``; for the bound too.
        objective: as in ``optimize``; for the bound too.
        catalogue: sizes, as in ``optimize``.

    Raises:
        InfeasibleError: no sizes meet the requirements.
        ArmDesignError: ``dead_volume``, ``objective`` or ``catalogue`` is none that can be.

    Example:
        >>> import armdesign as ad
        >>> machine = ad.load("paper_1dof")
        >>> workspace = ad.Workspace.grid(machine, points=3)
        >>> design = ad.size_cylinders(machine, workspace, ad.Requirements(oil_total_share=1.05))
        >>> print(f"{design.before.worst.frequency:.2f} to {design.after.worst.frequency:.2f} Hz")
        7.45 to 7.77 Hz
    """
    if dead_volume not in ("fixed", "proportional"):
        remedy = 'give "fixed" or "proportional"'
        raise ArmDesignError("dead_volume", f'"{dead_volume}" is not allowed', remedy)
    proportional = dead_volume == "proportional"
    sizes, grid = sizes_and_grid(machine, catalogue)
    problem = formulate(
        machine, workspace, requirements, ("areas",), proportional, bands, objective, grid
    )
    command = call(
        "size_cylinders", dead_volume=dead_volume, bands=bands,
        objective=_stated(objective), catalogue=catalogue,
    )  # fmt: skip

    def solve(problem: Problem, found: Found | None) -> Outcome:
        if sizes is not None:
            return _of_catalogue(problem, sizes)
        start = found[0] if found else problem.vector.start
        search = Search(problem=problem, x=start).run(trust=1.0, tolerance=1e-6)
        outcome = Outcome.of(search, Starts((hertz(search.squared),)))
        return _as_today_where_idle(outcome, None)

    def under(problem: Problem, _: bool) -> Outcome:
        return Outcome.at_all_masses(problem, solve)

    def design() -> Design:
        outcome = design_or_proof(problem, under, sizes is not None)
        return Design.of(outcome, command=command)

    return finished_design(Design, problem, [command, repr(sizes)], design)


def _stated(objective: str | Emphasis) -> str | None:
    """An objective in the command that made a design; None for the default."""
    name = objective if isinstance(objective, str) else "bandwidth"
    return None if name == "gain" else name


def _names(machine: Machine) -> tuple[str, ...]:
    """Joints and actuators."""
    return (*machine.joints, *(actuator.name for actuator in machine.actuators))


def _of_catalogue(problem: Problem, sizes: Sizes) -> Outcome:
    search, best_sizes = sizes_for_pins(problem, sizes)
    outcome = Outcome.of(search, Starts((best_sizes.frequency,)), best_sizes)
    return _as_today_where_idle(outcome, sizes)


def _as_today_where_idle(outcome: Outcome, sizes: Sizes | None) -> Outcome:
    rounded = without_idle_changes(outcome.rounded, outcome.search, sizes)
    return replace(outcome, rounded=rounded)
