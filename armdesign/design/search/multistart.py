"""Multistart: the design problem formulated, and searched from several starts to its end."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from armdesign.arguments import refuse_unless_seed
from armdesign.arrays import Array
from armdesign.design.catalogue.sizes import (
    FINE,
    DrawingGrid,
    Sizes,
    refuse_shared_joints,
    sizes_and_grid,
)
from armdesign.design.program.corners import Emphasis
from armdesign.design.program.problem import Problem
from armdesign.design.program.variables import chosen
from armdesign.design.requirements.places import pins_outside
from armdesign.design.requirements.settings import Requirements
from armdesign.design.search.arm_shapes import linkages_of_every_shape, of_other_shapes
from armdesign.design.search.canonical_pins import least_moved_pins
from armdesign.design.search.sequential_sdp import NEARLY, Search
from armdesign.design.search.slsqp import improve_by_slsqp
from armdesign.errors import ArmDesignError, choose, raise_together
from armdesign.frequency.bands import Bands
from armdesign.frequency.modes import hertz
from armdesign.frequency.workspace import Workspace
from armdesign.journal.finished import Form, all_finished, finished
from armdesign.machine.machine import Machine
from armdesign.processes import in_processes
from armdesign.progress import counted

OBJECTIVES = ["gain", "worst"]
STARTS = 3  # where pins move
STARTS_OF_FOUR_BARS = 4  # where these move, which have more local optima
DRAWN_SHARE = 0.7  # of the pin box in which starts are drawn; shrunk by it until they close
ROUGHLY: dict[str, Any] = {"trust": 0.2, "tolerance": 2e-3, "looks": 3}
TO_THE_END: dict[str, Any] = {"trust": 0.05, "tolerance": 1e-5}
CURVED_ROUNDS = 4  # of second order and linearised programmes in turn, where four-bars move
LEAST_RISE = 1e-5  # of today's lowest ω², by the last of them
NAMED = 3  # requirements, of a start that failed
LEFT_BELOW = 0.2  # of today's lowest ω²: starts that end this far below the best are left there


def formulate(
    machine: Machine,
    workspace: Workspace | None,
    requirements: Requirements | None,
    vary: Sequence[str],
    proportional: bool = False,
    bands: Bands | None = None,
    objective: str | Emphasis = "gain",
    grid: DrawingGrid = FINE,
) -> Problem:
    """The design problem; with the default grid and the file's requirements where none are given.

    And with the file's bands.

    Raises:
        ArmDesignError: a word or path of ``vary`` that names nothing that can vary; a requirement
            on what is not there; an outline that does not hold today's pins; an objective that
            there is not.
    """
    emphasis = None if isinstance(objective, str) else objective
    if emphasis is None and objective not in OBJECTIVES:
        raise ArmDesignError(
            "objective", f"{objective!r} is not allowed", choose(str(objective), OBJECTIVES)
        )
    bands = Bands.of(machine) if bands is None else bands
    chosen(machine, vary)
    requirements = requirements or Requirements.of(machine)
    requirements.refuse_unknown(machine)
    raise_together([*pins_outside(machine, requirements.outlines)])
    workspace = workspace or Workspace.grid(machine, end_margin=requirements.end_margin)
    problem = Problem.of(
        machine=machine,
        workspace=workspace,
        requirements=requirements,
        vary=tuple(vary),
        proportional=proportional,
        bands=bands,
        gain=emphasis is None and objective == "gain" and bands != Bands(),
        emphasis=emphasis,
    )
    return replace(problem, grid=grid)


def formulate_with_sizes(
    machine: Machine,
    workspace: Workspace | None,
    requirements: Requirements | None,
    vary: Sequence[str],
    *,
    bands: Bands | None,
    objective: str | Emphasis,
    catalogue: str | Iterable[Sequence[float]] | None,
) -> tuple[Problem, Sizes | None]:
    """The design problem on the grid of a catalogue, and its sizes; None where any may be.

    Where no size varies the machine's sizes stay, whatever its file would choose from.
    """
    sizes, grid = sizes_and_grid(machine, catalogue)
    problem = formulate(
        machine, workspace, requirements, vary, bands=bands, objective=objective, grid=grid
    )
    if sizes is None or (catalogue is None and not problem.vector.any_size_varies):
        return problem, None
    refuse_shared_joints(problem.machine)
    return problem, sizes


@dataclass(frozen=True)
class Starts:
    """Results of all starts of a search."""

    reached: tuple[float, ...] = ()  # worst frequencies [Hz] where all requirements are met
    failed: tuple[str, ...] = ()  # of every other start why it failed, in words

    @classmethod
    def of(cls, searches: Sequence[Search]) -> Starts:
        """Outcomes of searches that ended, or were left for better ones."""
        failures = [_failure(search) for search in searches]
        reached = [hertz(s.squared) for s, why in zip(searches, failures, strict=True) if not why]
        return cls(tuple(reached), tuple(why for why in failures if why))


def _failure(search: Search) -> str:
    """Reason why a search ended without a design; empty if it found one."""
    if missed := search.missed:
        more = f" and {len(missed) - NAMED} more" if len(missed) > NAMED else ""
        return f"the search did not meet {', '.join(missed[:NAMED])}{more}"
    return "" if search.squared > 0 else "the arm is unstable at its worst pose (ω² ≤ 0)"


def multistart(
    problem: Problem, starts: int | None, seed: int, workers: int, given: Array | None = None
) -> tuple[Search, Starts]:
    """The best of several starts, run to its end; and what each start came to.

    Starts are the design ``given``, if any, today's machine and random pins, ``starts`` in all
    (None: ``STARTS``, or ``STARTS_OF_FOUR_BARS`` where four-bars move). Every start is searched
    roughly. Those that come near the best are searched to the end, with SLSQP too: of several
    whose moment arms have come to one shape, that is, near one optimum, the best.
    """
    searches = [Search(problem=problem, x=x) for x in start_designs(problem, starts, seed, given)]
    searches = follow_all(searches, workers, **ROUGHLY)
    least = max(s.merit for s in searches) - LEFT_BELOW
    order = sorted(range(len(searches)), key=lambda k: searches[k].merit, reverse=True)
    near = [k for k in order if searches[k].merit >= least]
    near = [near[k] for k in of_other_shapes(problem, [searches[k].x for k in near])]
    followed = follow_all([searches[k] for k in near], workers, curved=True, **TO_THE_END)
    for k, search in zip(near, followed, strict=True):
        searches[k] = search
    best = max(searches, key=lambda s: (s.violation < NEARLY, s.merit))
    return with_least_moved_pins(best), Starts.of(searches)


def start_designs(
    problem: Problem, starts: int | None, seed: int, given: Array | None = None
) -> list[Array]:
    """The designs that searches start from: the given one, today's machine, drawn pins.

    Of drawn four-bars those of the most different shapes, see ``arm_shapes``.

    Raises:
        ArmDesignError: a seed that cannot be.
    """
    refuse_unless_seed(seed)
    random, vector = np.random.default_rng(seed), problem.vector
    moving = np.array([v.pin is not None for v in vector.variables])
    designs = [] if given is None else [given]
    if starts is None:
        starts = STARTS_OF_FOUR_BARS if vector.moves_within else STARTS
    count = (max(starts, 1) if vector.moving else 1) - len(designs)
    others = [vector.start.copy() for _ in range(count)]
    for x in others[1:]:
        x[moving] = random.uniform(-DRAWN_SHARE, DRAWN_SHARE, moving.sum())
    for i in vector.moving if count > 1 else ():
        if vector.moved_within(i):
            entries = list(vector.moves(i))
            linkages = linkages_of_every_shape(problem, i, count - 1, random)
            for x, of_shape in zip(others[1:], linkages, strict=False):
                x[entries] = of_shape[entries]
    return [*designs, *(_closing(problem, x, vector.start) for x in others)]


def _closing(problem: Problem, x: Array, near: Array) -> Array:
    """The design x within bounds, so far towards a ``near`` one that its four-bars close."""
    x = np.clip(x, *problem.bounds)
    while not problem.vector.closes(x):
        x = near + DRAWN_SHARE * (x - near)
    return x


def run_to_end(search: Search, trust: float) -> Search:
    """The search run until nothing is gained, with the equal design whose pins move least."""
    settings: dict[str, Any] = {"trust": trust, "tolerance": 1e-5}
    run = finished(
        "run",
        lambda: _identity(search, "run", settings),
        lambda: search.run(**settings),
        _form([search]),
    )
    return with_least_moved_pins(run)


def with_least_moved_pins(search: Search) -> Search:
    """The search at the equal design whose pins move least."""
    return search.at(least_moved_pins(search.problem, search.x))


def follow_all(searches: list[Search], workers: int, **settings: Any) -> list[Search]:
    """Follow searches, in this process or in several; finished ones are kept in the journal."""

    def followed(numbers: list[int]) -> Iterator[tuple[int, Search]]:
        some = [(k, searches[k]) for k in numbers]
        if workers <= 1 or len(some) < 2:
            yield from ((k, follow(search, **settings)) for k, search in counted(some, "start"))
            return
        tasks = [
            partial(_outcome, k, s.problem, s.x, s.rows, s.holding, settings) for k, s in some
        ]
        outcomes = in_processes(tasks, workers)
        for k, outcome in counted(outcomes, "start", len(tasks)):
            yield k, replace(searches[k], **outcome).look()

    def identity(k: int) -> Any:
        return _identity(searches[k], "follow", settings)

    return all_finished("start", len(searches), identity, followed, _form(searches))


def _identity(search: Search, what: str, settings: Mapping[str, Any]) -> Any:
    """Everything that decides what becomes of a search."""
    within = search.within and [end.tolist() for end in search.within]
    at = [search.x.tolist(), search.rows.tolist(), search.holding.tolist()]
    return [
        search.problem.identity,
        at,
        search.reference,
        search.strictness,
        within,
        what,
        settings,
    ]


def _form(searches: Sequence[Search]) -> Form[Search]:
    """Form in which searches are kept: fields that changed, not the problem."""

    def read(k: int, answer: Mapping[str, Any]) -> Search:
        x, reference = np.array(answer["x"]), answer["reference"]
        rows, holding = (np.array(answer[name], dtype=int) for name in ("rows", "holding"))
        search = replace(searches[k], x=x, rows=rows, holding=holding, reference=reference)
        return search.look()

    def write(_: int, search: Search) -> dict[str, Any]:
        return {name: _plain(value) for name, value in _changed(search).items()}

    return Form(write=write, read=read)


def _changed(search: Search) -> dict[str, Any]:
    """The fields of a search that change while it is followed."""
    return {name: getattr(search, name) for name in ("x", "rows", "holding", "reference")}


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray) else float(value)


def follow(search: Search, curved: bool = False, **settings: Any) -> Search:
    """Run a search; with SLSQP before it if ``curved`` and the requirements are nearly met.

    Where four-bars move the two are repeated in turn.
    """
    for _ in range(CURVED_ROUNDS if curved and search.problem.vector.moves_within else 1):
        search.look()
        before = search.merit
        if curved and search.violation < NEARLY:
            search = improve_by_slsqp(search)
        search = search.run(**settings)
        if search.merit < before + LEAST_RISE:
            break
    return search


def _outcome(
    k: int, problem: Problem, x: Array, rows: Array, holding: Array, settings: dict[str, Any]
) -> tuple[int, dict[str, Any]]:
    """Result of ``follow`` to send between processes, with the number of the search."""
    search = follow(Search(problem=problem, x=x, rows=rows, holding=holding), **settings)
    return k, _changed(search)
