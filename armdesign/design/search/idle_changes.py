"""Cylinders that a search changed for nothing stay as they are today.

A programme does not care where pins are that its worst poses do not feel, as those of a
telescope's cylinder, nor which of several sizes it takes there; and a drawing that changes what
gains nothing is work for nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from armdesign.design.catalogue.sizes import Sizes, is_offered
from armdesign.design.program.problem import Problem
from armdesign.design.search.rounding import CheckedMachine
from armdesign.design.search.sequential_sdp import Search
from armdesign.machine.file.machine_file import flat

NOTHING = 1e-4  # share of the frequency that all cylinders put back may cost
WORTH = 2e-3  # share of ω² that pins put back may cost before all is drawn
OF_SIZES = ("bore_mm", "rod_mm", "dead_volume_l")  # what follows the size that was chosen


def without_idle_changes(
    best: CheckedMachine, search: Search, sizes: Sizes | None
) -> CheckedMachine:
    """The machine with every cylinder as it is today whose changes gain next to nothing.

    A cylinder keeps its new size where today's is none of the catalogue; if it has own masses,
    which follow sizes and pins, it is then left as it was found. One that the oil of others keeps
    from its old size is tried again once these are back.
    """
    problem, least, before = search.problem, best.judged * (1 - NOTHING), None
    idle = [i for i in range(len(problem.machine.cylinders)) if not _is_worth(search, i)]
    while best is not before:
        before = best
        for i in idle:
            for changes in _back(best, problem, i, sizes):
                other = CheckedMachine.of(best.machine.replace(changes), best.problem)
                if other.allowed and other.judged >= least:
                    best = other
                    break
    return best


def _is_worth(search: Search, i: int) -> bool:
    """Whether the pins of a cylinder gain more than next to nothing, before all is drawn."""
    x, start = search.x.copy(), search.problem.vector.start
    entries = list(search.problem.vector.moves(i))
    x[entries] = start[entries]
    return bool(entries) and search.trial(x).squared.min() < search.squared * (1 - WORTH)


def _back(
    best: CheckedMachine, problem: Problem, i: int, sizes: Sizes | None
) -> Iterator[Mapping[str, Any]]:
    """Changes that put a cylinder back: the whole of it, if that is offered, or all but its size.

    None where it is as today.
    """
    today, cylinder = flat(problem.machine.section), problem.machine.cylinders[i]
    new, name = flat(best.machine.section), f"cylinder.{cylinder.name}."
    back = {k: v for k, v in today.items() if k.startswith(name) and new.get(k) != v}
    lengths = {k: v for k, v in back.items() if not k.removeprefix(name).startswith(OF_SIZES)}
    if not back:
        return
    own = cylinder.bore, cylinder.rod
    if sizes is None or is_offered(cylinder, own, sizes, *problem.vector.resized[i]):
        yield back
    if lengths and problem.vector.moving_masses is None:
        yield lengths
