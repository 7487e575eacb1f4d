"""Trade-offs: what the worst frequency costs in oil, thrust, digging force, lift or pin room.

One limit is moved from its tightest value to its loosest. What meets a tight limit meets a looser
one, so every point starts where its tighter neighbour ended. Where rounding to a drawing's grid,
or poses and bands between those searched, make its answer worse even so, the neighbour's is its
answer too: no point is below a tighter one.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from armdesign.arguments import checked
from armdesign.design.catalogue.sizes import sizes_and_grid
from armdesign.design.design import Design
from armdesign.design.optimize import SearchOptions, best_frequency
from armdesign.design.requirements.check import check
from armdesign.design.requirements.performance import torque_shares
from armdesign.design.requirements.settings import Requirements
from armdesign.design.search.infeasibility.concessions import relaxations
from armdesign.errors import ArmDesignError, InfeasibleError, Stopped, choose
from armdesign.frequency.bands import Bands
from armdesign.frequency.workspace import Workspace
from armdesign.machine.file.schema import DEFAULT, share_of
from armdesign.machine.machine import Machine
from armdesign.progress import counted, note_rounds
from armdesign.short_repr import short_repr

if TYPE_CHECKING:
    import pandas as pd

    from armdesign.plots.canvas import Axes

SHARES = {  # what is tried unless told: shares of today's, of a pin box of the default box
    "oil": (0.8, 0.9, 1.0, 1.1, 1.2),
    "thrust": (0.9, 1.0, 1.1, 1.2, 1.3),
    "digging": (1.1, 1.0, 0.95, 0.9, 0.8),
    "lift": (1.0, 0.95, 0.9, 0.85, 0.8, 0.7),
    "pin_box": (0.0, 0.25, 0.5, 1.0, 1.5, 2.0),
}
EACH = 1.1  # oil of one cylinder's side, over the share that all together may have

PLAUSIBLE = {"pin_box": (0.0, 3.0, "m")}  # values that somebody may mean
OF_SHARES = (0.1, 3.0, "of today's")


@dataclass(frozen=True, eq=False, kw_only=True)
class Pareto:
    """The best designs under one limit that moves, from its tightest value to its loosest.

    Attributes:
        against: "oil", "thrust", "digging", "lift" or "pin_box".
        limits: of the designs: shares of today's, or the pin box [m].
        designs: one for each limit.
        left_out: limits that no design meets, and why.
        today: the machine that all were made from.
    """

    __repr__ = short_repr

    against: str
    limits: tuple[float, ...]
    designs: tuple[Design, ...]
    left_out: dict[float, str]
    today: Machine

    @property
    def robust(self) -> bool:
        """Whether the designs were made for bands."""
        return self.designs[0].problem.dynamics.corners.bands != Bands()

    @cached_property
    def frame(self) -> pd.DataFrame:
        """A row for each design, with what it has of everything that trades against frequency.

        ``frequency_hz``: worst, of the rounded machine, between grid poses too; ``unrounded_hz``:
        of the optimum, on the workspace's poses; ``gain``. ``banded_hz``: the worst within the
        bands that the designs were made for, on the workspace's poses, and ``least_gain`` there
        over today's (no columns without bands).
        ``oil_share``, ``annulus_oil_share``: summed over the cylinders, over today's;
        ``thrust_share``: largest of any cylinder; ``digging_share``: least torque of those whose
        digging counts (no column where none does); ``lift_share``: least lift of all points of the
        lift chart; ``pin_move_m``: largest move of any pin coordinate or bar. All are of the
        rounded machine. ``squared_times_speed``: frequency² × 1/``oil_share``, which is what the
        pump's flow makes of the speed, over today's.
        """
        import pandas as pd

        return pd.DataFrame(
            [_row(limit, design) for limit, design in zip(self.limits, self.designs, strict=True)]
        )

    @property
    def sentences(self) -> list[str]:
        """Limits that are left out, and the reasons."""
        return [
            f"{self.against} {limit:g} is left out: {why}" for limit, why in self.left_out.items()
        ]

    def plot(self, ax: Axes | None = None) -> Axes:
        """Worst frequency over the limit, with today's machine; returns the axes."""
        from armdesign import plots

        return plots.trade_off(self, ax)


@checked
def pareto(
    machine: Machine,
    workspace: Workspace | None = None,
    requirements: Requirements | None = None,
    against: str = "oil",
    values: Sequence[float] | None = None,
    vary: Sequence[str] = ("areas", "pins"),
    *,
    starts: int | None = None,
    seed: int = 0,
    workers: int = 1,
    bands: Bands | None = None,
    objective: str = "gain",
    catalogue: str | Iterable[Sequence[float]] | None = None,
) -> Pareto:
    """The best worst frequency under each value of one limit, all others as they are.

    Args:
        machine: today's machine.
        workspace: poses that count; default grid if None.
        requirements: limits; None: the machine's file states them.
        against: "oil": ``oil_total_share``, which is pump flow and so speed, and with it
            ``oil_each_share``, 1.1 × it; "thrust": ``thrust_share``; "digging": ``digging_share``,
            and ``torque_share`` of these cylinders where it is higher; "lift": ``lift_share``;
            "pin_box": ``pin_box`` [m], pins with a box of their own keep that.
        values: of the limit, in any order; some around today's if None.
        vary: as in ``optimize``.
        starts: how many starts each point has: its tighter neighbour, today's machine and drawn
            ones, in this order. As in ``optimize`` if None.
        seed: of the drawn starts.
        workers: processes that share the starts.
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
    sizes_and_grid(machine, catalogue)  # refused before anything is searched
    limits = _limits(machine, workspace, requirements, against, values)

    options = SearchOptions(
        vary=vary, starts=starts, seed=seed, workers=workers, bands=bands,
        objective=objective, catalogue=catalogue,
    )  # fmt: skip

    def best(limit: float, tighter: Design | None) -> Design:
        limited = _limited(requirements, against, limit)
        design = best_frequency(machine, workspace, limited, replace(options, start=tighter))
        if tighter is None or _aim(design) >= _aim(tighter):
            return design
        return _under(tighter, design)

    return _front(machine, against, limits, best)


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


def _why(machine: Machine, error: InfeasibleError) -> str:
    """Why no design meets a value, and what to relax."""
    if relax := relaxations(error.conflict):
        return f"{error.fault}: relax {relax}"
    whole = f"{error.fault}; {error.remedy}" if error.remedy else error.fault
    return whole if error.part == machine.name else f"{error.part} {whole}"


def _front(
    machine: Machine,
    against: str,
    limits: Sequence[float],
    best: Callable[[float, Design | None], Design],
) -> Pareto:
    """The best design under each limit, each from its tighter neighbour's.

    Raises:
        InfeasibleError: no limit has any.
        Stopped: Ctrl-C, with the designs that were found before it.
    """
    designs: dict[float, Design] = {}
    left_out: dict[float, str] = {}
    tighter: Design | None = None

    def front() -> Pareto:
        return Pareto(
            against=against,
            today=machine,
            limits=tuple(designs),
            designs=tuple(designs.values()),
            left_out=left_out,
        )

    try:
        for limit in counted(limits, "value"):
            try:
                designs[limit] = tighter = best(limit, tighter)
            except InfeasibleError as error:
                left_out[limit] = _why(machine, error)
                refused = error
    except KeyboardInterrupt as stop:
        if not designs:
            raise
        stopped = Stopped(front())
        note_rounds(stopped)
        raise stopped from stop
    if not designs:
        why = refused.fault, refused.conflict, refused.table
        raise InfeasibleError(machine.name, f"no value of {against} can be met", *why)
    return front()


def read_values(text: str, against: str) -> list[float] | None:
    """Values of a limit as a command line gives them, commas between; None for none.

    Args:
        text: such as ``0.9,1.0,1.1``.
        against: the limit.

    Raises:
        ArmDesignError: no numbers, a comma that may be a decimal one, or numbers that nobody
            means.
    """
    words = [word.strip() for word in text.split(",") if word.strip()]
    try:
        values = [float(word) for word in words]
    except ValueError:
        fault = f'"{text}" is not a list of numbers'
        raise ArmDesignError("--values", fault, "give 0.9,1.0,1.1") from None
    whole = re.search(r"(?<![\d.])(\d+),(\d+)(?![\d.])", text)
    if whole:
        one, two = whole.groups()
        fault = f'"{whole[0]}" may be {one}.{two}, or {one} and {two}'
        raise ArmDesignError("--values", fault, f"give {one}.{two}, or {one}.0,{two}.0")
    low, high, unit = PLAUSIBLE.get(against, OF_SHARES)
    for value in values:
        if against in SHARES and not low <= value <= high:
            fault, remedy = f"{value:g} {unit} is not allowed", f"give {low:g} to {high:g} {unit}"
            raise ArmDesignError("--values", fault, remedy)
    return values or None


def _limits(
    machine: Machine,
    workspace: Workspace,
    requirements: Requirements,
    against: str,
    values: Sequence[float] | None,
) -> list[float]:
    """The values of the limit, the tightest first."""
    if values is None:
        unit = requirements.box(machine, workspace) if against == "pin_box" else 1.0
        values = [share * unit for share in SHARES[against]]
    numbers = [v for v in values if isinstance(v, int | float | np.number)]
    usable = [v for v in numbers if math.isfinite(v) and v >= 0]
    if not usable or len(usable) < len(values):
        raise ArmDesignError("values", f"{list(values)} is not allowed", "give finite numbers ≥ 0")
    return sorted({float(v) for v in values}, reverse=against in ("digging", "lift"))


def _limited(requirements: Requirements, against: str, limit: float) -> Requirements:
    """The requirements with one limit at a value."""
    if against == "oil":
        return replace(requirements, oil_total_share=limit, oil_each_share=EACH * limit)
    if against == "digging":
        torque = requirements.torque_share
        own = {name: min(limit, share_of(torque, name)) for name in requirements.digging}
        every = torque if isinstance(torque, Mapping) else {DEFAULT: torque}
        return replace(requirements, digging_share=limit, torque_share={**every, **own})
    name = "pin_box" if against == "pin_box" else f"{against}_share"
    changes: dict[str, Any] = {name: limit}
    return replace(requirements, **changes)


def _row(limit: float, design: Design) -> dict[str, float]:
    new, today = design.machine, design.today
    before, after = design.before.worst.frequency, design.after.worst.frequency
    pairs = list(zip(new.cylinders, today.cylinders, strict=True))
    oil, annulus = (
        sum(getattr(c, area) * c.stroke for c, _ in pairs)
        / sum(getattr(c, area) * c.stroke for _, c in pairs)
        for area in ("bore_area", "annulus_area")
    )
    torques = torque_shares(new, today) if design.requirements.digging else {}
    digging = [torques[name][0] for name in design.requirements.digging]
    return {
        "limit": limit,
        "frequency_hz": after,
        "unrounded_hz": design.unrounded,
        "gain": design.gain,
        **(
            {"banded_hz": design.band_after.low.frequency, "least_gain": design.least_gain}
            if design.problem.dynamics.corners.bands != Bands()
            else {}
        ),
        "oil_share": oil,
        "annulus_oil_share": annulus,
        "thrust_share": max(c.bore_area / old.bore_area for c, old in pairs),
        **({"digging_share": float(min(digging))} if digging else {}),
        "lift_share": design.lift_share,
        "pin_move_m": max(
            (check.value for check in design.checks if check.name.startswith("pin_box.")),
            default=0.0,
        ),
        "squared_times_speed": (after / before) ** 2 / oil if before > 0 else math.inf,
    }
