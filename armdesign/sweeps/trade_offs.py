"""``pareto``: the best design under each value of one limit, as a sweep.

Each value is a case with starts of its own, so that processes share them and any number of them
gives the same designs. What meets a tight limit meets a looser one: from the tightest on, a point
that came out worse than its tighter neighbour is searched from that one's design too. Where
rounding to a drawing's grid, or poses and bands between those searched, make its answer worse even
so, the neighbour's is its answer too: no point is below a tighter one.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Unpack, cast

from armdesign.arguments import checked, with_options
from armdesign.design.catalogue.sizes import sizes_and_grid
from armdesign.design.design import Design
from armdesign.design.kept_designs import answer_of, found_in
from armdesign.design.optimize import USUAL_SEARCH, AimedSearch, SearchOptions, best_frequency
from armdesign.design.pareto import SHARES, Pareto, limited, limits_of
from armdesign.design.program.problem import Problem
from armdesign.design.requirements.check import check
from armdesign.design.requirements.settings import Requirements
from armdesign.design.search.infeasibility.concessions import relaxations
from armdesign.design.search.multistart import formulate_with_sizes
from armdesign.errors import ArmDesignError, InfeasibleError, Stopped, choose
from armdesign.frequency.workspace import Workspace
from armdesign.journal.journal import Entry
from armdesign.machine.machine import Machine
from armdesign.progress import counted, note_rounds
from armdesign.sweeps.numbers import Numbers
from armdesign.sweeps.sweep import sweep

WORSE = 1e-6  # share of the frequency before rounding

Found = Design | InfeasibleError


@checked
@with_options(SearchOptions, USUAL_SEARCH)
def pareto(
    machine: Machine,
    workspace: Workspace | None = None,
    requirements: Requirements | None = None,
    against: str = "oil",
    values: Sequence[float] | None = None,
    vary: Sequence[str] = ("areas", "pins"),
    *,
    objective: str = "gain",
    **options: Unpack[SearchOptions],
) -> Pareto:
    """The best worst frequency under each value of one limit, all others as they are.

    Args:
        machine: today's machine.
        workspace: poses that count; default grid if None.
        requirements: limits; None: the machine's file states them.
        against: "oil": ``oil_total_share``, which is pump flow and so speed, and with it
            ``oil_each_share``, 1.1 × it; "thrust": ``thrust_share``; "digging": ``digging_share``,
            and ``torque_share`` of these cylinders where it is higher; "lift": ``lift_share``;
            "pin_box": ``pin_box`` [m]. Actuators with a share of their own keep that, as pins
            with a box of their own do.
        values: of the limit, in any order; some around today's if None.
        vary: as in ``optimize``.
        starts: how many starts each point has, as in ``optimize``; where that is worse than its
            tighter neighbour, the neighbour's design is one more, and the answer if it is best.
        seed: of the drawn starts.
        workers: processes that share the values.
        bands: as in ``optimize``: every design is made for them.
        objective: as in ``optimize``.
        catalogue: as in ``optimize``.

    Raises:
        ArmDesignError: a trade-off that does not exist, or values that cannot be.
        InfeasibleError: no design meets any of the values.
        Stopped: Ctrl-C, with the designs that were found before it.

    Example:
        >>> import armdesign as ad
        >>> machine = ad.load("paper_1dof")
        >>> workspace = ad.Workspace.grid(machine, points=2)
        >>> trade = ad.pareto(machine, workspace, values=[1.0, 1.05], vary=["areas"], starts=1)
        >>> print(trade.frame[["limit", "frequency_hz"]].round(2).to_string(index=False))
         limit  frequency_hz
          1.00          7.45
          1.05          7.77
    """
    requirements = requirements or Requirements.of(machine)
    workspace = workspace or Workspace.grid(machine, end_margin=requirements.end_margin)
    if against not in SHARES:
        remedy = choose(str(against), list(SHARES))
        raise ArmDesignError("against", f"{against!r} is not allowed", remedy)
    if against == "digging" and not requirements.digging:
        fault, remedy = "no cylinder's digging force counts", "name some in requirements.digging"
        raise ArmDesignError("against", fault, remedy)
    catalogue, workers = options["catalogue"], options["workers"]
    if catalogue is not None and not isinstance(catalogue, str):
        catalogue = [tuple(size) for size in catalogue]
    sizes_and_grid(machine, catalogue)  # refused before anything is searched
    limits = limits_of(machine, workspace, requirements, against, values)
    of_all: dict[str, Any] = {"requirements": requirements, "against": against}
    of_all |= {"vary": tuple(vary), "objective": objective}
    of_all |= {**options, "catalogue": catalogue, "workers": 1}
    trade_off = _TradeOff(machine, workspace, of_all)
    return trade_off.front({limit: trade_off.problem(limit) for limit in limits}, workers)


def best_under(
    machine: Machine, workspace: Workspace, limit: float, start: Design | None = None, **how: Any
) -> Numbers:
    """The best design under a value of a limit, or why there is none, as a journal has it.

    Args:
        machine: today's machine.
        workspace: poses that count.
        limit: the value.
        start: design from which alone it is searched; None: starts as in ``optimize``.
        how: requirements, and the other arguments of ``pareto``.
    """
    requirements = limited(how.pop("requirements"), how.pop("against"), limit)
    problem = _problem(machine, workspace, requirements, how)
    vary, objective = how.pop("vary"), how.pop("objective")
    how |= {"starts": 1} if start else {}
    aimed = AimedSearch(
        vary=vary, objective=objective, start=start, options=cast(SearchOptions, how)
    )
    try:
        found: Found = best_frequency(machine, workspace, requirements, aimed)
    except InfeasibleError as error:
        found = error
    return {"found": json.dumps(answer_of(found, problem))}


def _problem(
    machine: Machine, workspace: Workspace, requirements: Requirements, how: Mapping[str, Any]
) -> Problem:
    given = {name: how[name] for name in ("bands", "objective", "catalogue")}
    return formulate_with_sizes(machine, workspace, requirements, how["vary"], **given)[0]


@dataclass(frozen=True, eq=False)
class _TradeOff:
    """What all points of a trade-off share; ``options`` are those of ``best_under``."""

    machine: Machine
    workspace: Workspace
    options: Mapping[str, Any]

    def problem(self, limit: float) -> Problem:
        """The design problem under a value of the limit.

        Raises:
            ArmDesignError: as ``optimize``.
        """
        requirements = limited(self.options["requirements"], self.options["against"], limit)
        return _problem(self.machine, self.workspace, requirements, self.options)

    def front(self, problems: Mapping[float, Problem], workers: int) -> Pareto:
        """The best design under each limit, of which these are the problems.

        Raises:
            InfeasibleError: no limit has any.
            Stopped: Ctrl-C, with the designs that were found before it.
        """
        found: dict[float, Found] = {}
        try:
            self._search_alone(problems, workers, found)
            self._search_from_neighbours(problems, found)
        except KeyboardInterrupt as stop:
            front = self._of(found)
            if not front.designs:
                raise KeyboardInterrupt from stop
            stopped = Stopped(front)
            note_rounds(stopped)
            raise stopped from stop
        front = self._of(found)
        if not front.designs:
            refused = [one for one in found.values() if isinstance(one, InfeasibleError)][-1]
            fault = f"no value of {self.options['against']} can be met"
            why = f"{refused.fault}; {refused.remedy}" if refused.remedy else refused.fault
            conflict = refused.conflict, refused.table
            raise InfeasibleError(self.machine.name, fault, why, *conflict)
        return front

    def _search_alone(
        self, problems: Mapping[float, Problem], workers: int, found: dict[float, Found]
    ) -> None:
        """Fill in what is found under each limit by itself."""
        sets = [{"limit": limit, **self.options} for limit in problems]
        how: dict[str, Any] = {"workspace": self.workspace, "workers": min(workers, len(sets))}
        stopped = None
        try:
            answers = sweep(self.machine, task=best_under, options=sets, **how)
        except Stopped as stop:
            answers, stopped = stop.finished, stop
        for case, one in zip(answers.cases, answers.outcomes, strict=True):
            limit = case.options["limit"]
            found[limit] = self._read(limit, one, problems)
        if stopped is not None:
            raise stopped

    def _search_from_neighbours(
        self, problems: Mapping[float, Problem], found: dict[float, Found]
    ) -> None:
        """Search points that are worse than their tighter neighbour from its design, too."""
        tighter: Design | None = None
        for limit in counted(problems, "value"):
            if tighter is not None and _is_worse(found[limit], tighter):
                near = {"limit": limit, **self.options, "start": tighter}
                answers = sweep(
                    self.machine, task=best_under, options=near, workspace=self.workspace
                )
                other = self._read(limit, answers.outcomes[0], problems)
                found[limit] = other if _is_worse(found[limit], other) else found[limit]
            one = found[limit]
            if isinstance(one, Design):
                if tighter is not None and _aim(one) < _aim(tighter):
                    one = found[limit] = _under(tighter, one)
                tighter = one

    def _read(self, limit: float, one: Entry, problems: Mapping[float, Problem]) -> Found:
        """What a case has found.

        Raises:
            ArmDesignError: it failed.
        """
        if one.error:
            raise ArmDesignError(f"{self.options['against']} {limit:g}", one.error)
        return found_in(Design, json.loads(one.answer["found"]), problems[limit])

    def _of(self, found: Mapping[float, Found]) -> Pareto:
        designs = {limit: one for limit, one in found.items() if isinstance(one, Design)}
        refused = {limit: one for limit, one in found.items() if isinstance(one, InfeasibleError)}
        return Pareto(
            against=self.options["against"],
            limits=tuple(designs),
            designs=tuple(designs.values()),
            left_out={limit: _why(self.machine, error) for limit, error in refused.items()},
            today=self.machine,
        )


def _aim(design: Design) -> float:
    """What a design was made to have most of: gain or frequency within its bands, or at all."""
    if design.made_for == "gain":
        return design.least_gain
    if design.made_for == "worst":
        return design.band_after.low.frequency
    return design.after.worst.frequency


def _under(tighter: Design, looser: Design) -> Design:
    """A design as the answer under a looser limit, that of another one, where it is the better.

    It keeps the prices of requirements that stay as they are.
    """
    within = tighter.today, tighter.workspace, looser.requirements
    checks = check(tighter.machine, *within)
    limits = {one.name: one.limit for one in tighter.checks}
    kept = {one.name for one in checks if one.limit == limits.get(one.name)}
    prices, at_margin = (
        {name: gain for name, gain in part.items() if name in kept}
        for part in (tighter.prices, tighter.at_margin)
    )
    problem, sizes = replace(looser.problem, sizes=tighter.problem.sizes), looser.best_sizes
    if sizes and tighter.best_sizes:  # the bound stays that of the looser limit
        sizes = replace(tighter.best_sizes, bound=sizes.bound)
    return replace(
        looser, machine=tighter.machine, checks=checks, problem=problem,
        x=looser.problem.like(tighter.x, tighter.problem), unrounded=tighter.unrounded,
        watched=tighter.watched, best_sizes=sizes, prices=prices, at_margin=at_margin,
    )  # fmt: skip


def _is_worse(one: Found, other: Found) -> bool:
    """Whether the other is a design of a higher frequency."""
    if isinstance(one, InfeasibleError) or isinstance(other, InfeasibleError):
        return isinstance(other, Design)
    return one.unrounded < (1 - WORSE) * other.unrounded


def _why(machine: Machine, error: InfeasibleError) -> str:
    """Why no design meets a value, and what to relax."""
    if relax := relaxations(error.conflict):
        return f"{error.fault}: relax {relax}"
    whole = f"{error.fault}; {error.remedy}" if error.remedy else error.fault
    return whole if error.part == machine.name else f"{error.part} {whole}"
