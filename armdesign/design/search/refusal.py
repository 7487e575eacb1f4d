"""Refusals: why no design can be written, and requirements that give enough for one, tried before they are said.

Conflicts are looked for with limits drawn in by what rounding takes. What they must give is
granted, a design is sought and rounded near the one that misses least; where that fails, a little
more is granted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from armdesign.arrays import Array
from armdesign.design.requirements.record import Concession, Evaluation, Requirement
from armdesign.design.search.elastic import MET
from armdesign.design.search.infeasibility import (
    Conflict,
    Relaxation,
    concessions,
    nearest,
    remedy,
    sentence,
)
from armdesign.design.search.rounding import inmost, nearest_misses
from armdesign.design.search.sequential_sdp import Search
from armdesign.errors import InfeasibleError

STRICT = (
    30.0  # times dearer a missed requirement is for a search that left the designs that meet all
)
DRAWN_IN = (
    1e-4,
    1e-3,
    3e-3,
    1e-2,
)  # shares by which limits are drawn in, until there is a conflict
MORE = (0.0, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2)  # of their limits that requirements give besides
GRID = "on the 0.1 mm grid"


def kept_within(search: Search, x: Array) -> Search:
    """The search, on from a design that meets all requirements, without leaving those that do."""
    search.x = x
    search.run(trust=0.02, tolerance=1e-5)
    if search.violation > 10 * MET:
        search.x, search.strictness = x, STRICT
        search.run(trust=0.02, tolerance=1e-5)
    if search.violation > 10 * MET:
        search.x = x
        search.look()
    return search


def refusal(search: Search) -> InfeasibleError | None:
    """The error that says what requirements must give.

    None where a design meets all: ``search`` then stands there.
    """
    conflict, parts, found = _conflict(
        search, 0.0 if not search.problem.vector.moving else DRAWN_IN[0]
    )
    if not parts or (found and found.nothing):
        kept_within(search, found.x if found else conflict.x)
        return None
    return _error(search, conflict, parts, found, "no design meets")


def not_written(search: Search) -> InfeasibleError:
    """The error where designs meet all requirements, but none was found that can be written."""
    for share in DRAWN_IN if search.problem.vector.moving else ():
        conflict, parts, found = _conflict(search, share)
        if parts and not (found and found.nothing):
            return _error(search, conflict, parts, found, f"no sizes and pins {GRID} meet")
    missed = nearest_misses(search)
    names, of = tuple(c.name for c in missed), {c.name: c for c in missed}
    amounts = {c.name: abs(c.value - c.limit) for c in missed}
    given = _enough(search, (names,), of, amounts, {}, search.x)
    words = f"no sizes {GRID} meet all requirements{nearest(given)}"
    return InfeasibleError(search.problem.machine.name, words, remedy(given), given)


def _conflict(
    search: Search, share: float
) -> tuple[Conflict, tuple[tuple[str, ...], ...], Relaxation | None]:
    """Conflicts near a search with limits drawn in by a share, and the least that they must give."""
    conflict = Conflict(search.problem.tightened(share), search.x, search.holding)
    parts = conflict.parts()
    if not parts:
        return conflict, (), None
    found = conflict.relaxed(parts)
    if found is None:  # what conflicts cannot give enough: anything else may help
        others = tuple(name for name in conflict.names if not any(name in part for part in parts))
        found = conflict.relaxed([*parts, others])
        helps = tuple(name for name in others if found and found.amounts.get(name, 0.0) > 0)
        parts = (*parts, helps) if helps else parts
    return conflict, parts, found


def _error(
    search: Search,
    conflict: Conflict,
    parts: Sequence[Sequence[str]],
    found: Relaxation | None,
    none_meets: str,
) -> InfeasibleError:
    """The error that names conflicts and what they must give, together and alone."""
    of = {name: condition for name, (condition, _) in conflict.amounts(conflict.x).items()}
    if found is None:  # what they may give is not enough: what misses least says what lacks
        lacks = {
            name: amount
            for name, (_, amount) in conflict.amounts(conflict.x).items()
            if amount > 0
        }
        given, settles = (
            concessions(search.problem.requirements, [tuple(lacks)], of, lacks, {}),
            False,
        )
    else:
        alone = _alone(search, conflict, parts, of, found.amounts, found.x)
        given, settles = _enough(search, parts, of, found.amounts, alone, found.x), True
    words, otherwise = sentence(given, settles, none_meets), ""
    if search.problem.sizes:
        words, otherwise = (
            f"with the sizes of the catalogue that were tried, {words}",
            " or offer other sizes",
        )
    return InfeasibleError(search.problem.machine.name, words, remedy(given, otherwise), given)


def _alone(
    search: Search,
    conflict: Conflict,
    parts: Sequence[Sequence[str]],
    of: Mapping[str, Evaluation],
    together: Mapping[str, float],
    near: Array,
) -> dict[str, float | None]:
    """What each requirement of a part gives where no other of its part does.

    None where that does not help.
    """
    alone: dict[str, float | None] = {}
    for part in parts:
        others = [other for other in parts if other is not part]
        for name in part if len(part) > 1 else ():
            alone[name] = None
            if (
                not of[name].setting
                or (found := conflict.relaxed([(name,), *others], near)) is None
            ):
                continue
            rest = {
                other: together[other] for group in others for other in group if other in together
            }
            given = _enough(
                search, [(name,), *others], of, {**rest, name: found.amounts[name]}, {}, found.x
            )
            alone[name] = next(c.together for c in given if c.name == name)
    return alone


def _enough(
    search: Search,
    parts: Sequence[Sequence[str]],
    of: Mapping[str, Requirement],
    amounts: Mapping[str, float],
    alone: Mapping[str, float | None],
    x: Array,
) -> tuple[Concession, ...]:
    """The concessions with which a design near ``x`` is found and can be written.

    The largest tried if none is.
    """
    problem = search.problem
    for more in MORE:
        given = {
            name: amount + more * abs(of[name].limit)
            for name, amount in amounts.items()
            if amount > 0
        }
        found = concessions(problem.requirements, parts, of, given, alone)
        granted = problem.under(problem.requirements.granting(found))
        if inmost(replace(search, problem=granted, x=np.clip(x, *granted.bounds))) is not None:
            break
    return found
