"""Catalogues without a size that a cylinder could have, wherever its pins lie.

Proved by the enclosures of the bound (``cylinder_constraints``), so that no search is needed to
say so. What they leave of finer steps says which sizes might do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from armdesign.design.bound.cylinder_constraints import cylinder_constraints
from armdesign.design.bound.mass_enclosure import BarEnclosure, bar_enclosures
from armdesign.design.catalogue.sizes import GRID_MM, Sizes, areas_of_sizes, sizes_of
from armdesign.design.program.problem import Problem
from armdesign.errors import InfeasibleError
from armdesign.machine.file.schema import BY_ACTUATOR
from armdesign.units import mm, outward

FINER = sizes_of(f"{GRID_MM}mm")
UPPER = "holding_share", "oil_each_share", "thrust_share"  # the other shares are lower limits
FARTHEST = 4.0  # times an upper share, to which it is relaxed
BISECTIONS, DIGITS = 10, 3


def refuse_unfit_catalogue(problem: Problem) -> None:
    """Raise where the problem's catalogue has no size that some cylinder could have.

    Only where that is proved, and finer steps have sizes that might do.

    Raises:
        InfeasibleError: all such cylinders, with the sizes that might do.
    """
    offered, lacking = set(problem.grid.sizes), {}
    every = replace(problem.grid, sizes=tuple(sorted(offered.union(FINER))))
    wide = replace(problem, grid=every)
    bars = bar_enclosures(wide)
    if bars is None:
        return
    for i in range(len(problem.machine.cylinders)):
        sizes = possible_sizes(wide, i, bars) if all(problem.vector.resized[i]) else ()
        if sizes and not offered.intersection(sizes):
            lacking[i] = sizes
    if lacking:
        several, names = len(lacking) > 1, [problem.machine.cylinders[i].name for i in lacking]
        fault = (
            f"has no size for the {', '.join(names)} {'cylinders' if several else 'cylinder'}:"
            f" {'their' if several else 'its'} requirements allow none, wherever pins lie in"
            " the boxes"
        )
        pairs = zip(names, lacking.values(), strict=True)
        ways = "; ".join(f"for the {name} {_spans(sizes)}" for name, sizes in pairs)
        others = f"offer others: in steps of {GRID_MM} mm these might do: {ways}"
        relaxed = [way for i in lacking if (way := _relaxations(wide, i, offered, bars))]
        remedy = f"relax, at least so far, {', and '.join(relaxed)}"
        if not relaxed:
            remedy = "relax several requirements together, as no single one is enough"
        elif len(relaxed) < len(lacking):
            remedy += ", and several requirements of the rest together"
        raise InfeasibleError("catalogue", fault, f"{others}; or {remedy}")


def _relaxations(
    problem: Problem, i: int, offered: set[tuple[float, float]], bars: Sequence[BarEnclosure]
) -> str:
    """Shares of cylinder ``i`` of which one alone may leave it some of the sizes, and how far."""
    stated, name = problem.requirements, problem.machine.cylinders[i].name

    def might_do(setting: str, value: float) -> bool:
        granted = replace(problem, requirements=stated.with_setting(setting, value))
        return not offered.isdisjoint(possible_sizes(granted, i, bars))

    ways = []
    for key in BY_ACTUATOR:
        setting = f"{key}.{name}"
        low = tight = stated.setting(setting)
        high = FARTHEST * tight if key in UPPER else 0.0
        if tight <= 0 or not might_do(setting, high):
            continue
        for _ in range(BISECTIONS):
            middle = (low + high) / 2
            low, high = (low, middle) if might_do(setting, middle) else (middle, high)
        ways.append(f"requirements.{setting} to {outward(high, DIGITS, key in UPPER):g}")
    return " or ".join(ways)


def possible_sizes(problem: Problem, i: int, bars: Sequence[BarEnclosure]) -> Sizes:
    """Sizes of the problem's catalogue that cylinder ``i`` may have under requirements of its own.

    Empty where there are none, or where nothing is known.
    """
    machine = problem.machine
    joints = set(machine.linkages[i].joints)
    alone = sum(not joints.isdisjoint(drive.joints) for drive in machine.drives) == 1
    limits = cylinder_constraints(problem, i, bars, alone=alone)
    if limits is None or limits.areas.pairs is None:
        return ()
    left, sizes = set(map(tuple, limits.areas.pairs)), problem.grid.sizes
    areas = areas_of_sizes(machine.cylinders[i], sizes)
    return tuple(size for size, pair in zip(sizes, areas, strict=True) if tuple(pair) in left)


def _spans(sizes: Sizes) -> str:
    """The spans of bores and rods in words."""
    spans = zip(np.min(sizes, axis=0) / mm, np.max(sizes, axis=0) / mm, strict=True)
    bores, rods = (f"{a:g}" if a == b else f"{a:g} to {b:g}" for a, b in spans)
    return f"bores of {bores} mm with rods of {rods} mm"
