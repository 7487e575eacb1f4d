"""Entries of x chosen from lists, such as sizes of a catalogue, by which least is missed.

All requirements linear about a design, pins and what is not chosen following: of

    least Σ t + Σ w e   with   c + C d + e ≥ 0,   d_i = Σ_s z_is (value_is − x_i),   Σ_s z_is = 1

as in ``elastic_programme``, with z of zeros and ones, HiGHS finds the optimum.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from armdesign.arrays import Array
from armdesign.design.search.infeasibility.elastic_programme import (
    Bounds,
    Roles,
    Rooms,
    linear_programme,
)
from armdesign.design.search.trust_region import LARGEST, box_around

NODES, GAP = 1_000, 1e-3  # of branch and bound


@dataclass(frozen=True, eq=False)
class Choice:
    """Values (s, k) that k entries of x may have together."""

    entries: Array
    values: Array


def best_choice(
    at: Rooms,
    roles: Roles,
    bounds: Bounds,
    choices: Sequence[Choice],
    known: Collection[tuple[int, ...]] = (),
) -> tuple[tuple[int, ...], float] | None:
    """Number of the best value of each choice, and the least cost that is foreseen.

    What is chosen may go anywhere, the rest as far as a step may. ``known`` combinations are left
    out. None if there is no other, or branch and bound gave up.
    """
    from scipy.optimize import Bounds as Ends
    from scipy.optimize import LinearConstraint, milp

    low, high = (end.copy() for end in box_around(at.x, bounds, LARGEST))
    for one in choices:
        changes = one.values - at.x[one.entries]
        low[one.entries], high[one.entries] = changes.min(axis=0), changes.max(axis=0)
    _, costs, limits, least, ends = linear_programme(at, roles, (low, high))
    ties, of_choice = _ties(choices, at.x, len(costs))
    none, flags = np.zeros((len(of_choice), len(costs))), np.zeros(of_choice.shape[1])
    others = np.zeros((max(len(known), 1), len(costs) + len(flags)))
    for row, numbers in zip(others, known, strict=False):
        own = [np.flatnonzero(z)[k] for z, k in zip(of_choice, numbers, strict=True)]
        row[len(costs) + np.array(own)] = 1.0
    answer = milp(
        np.concatenate([costs, flags]),
        integrality=np.concatenate([0 * costs, flags + 1]),
        bounds=Ends(*np.vstack([ends, np.stack([flags, flags + 1], axis=1)]).T),
        constraints=[
            LinearConstraint(np.pad(limits, ((0, 0), (0, len(flags)))), ub=least),
            LinearConstraint(ties, 0.0, 0.0),
            LinearConstraint(np.hstack([none, of_choice]), 1.0, 1.0),
            LinearConstraint(others, ub=len(choices) - 1.0),
        ],
        options={"node_limit": NODES, "mip_rel_gap": GAP},
    )
    if answer.x is None:
        return None
    picked = (of_choice * answer.x[len(costs) :]).argmax(axis=1) - of_choice.argmax(axis=1)
    return tuple(map(int, picked)), float(answer.fun)


def _ties(choices: Sequence[Choice], x: Array, count: int) -> tuple[Array, Array]:
    """Rows that tie changes of chosen entries to z, which follows ``count`` others; z of each."""
    total, first, ties = sum(len(one.values) for one in choices), 0, []
    of_choice = np.zeros((len(choices), total))
    for c, one in enumerate(choices):
        own = slice(first, first + len(one.values))
        of_choice[c, own], first = 1.0, own.stop
        tie = np.zeros((len(one.entries), count + total))
        tie[np.arange(len(tie)), one.entries] = -1.0
        tie[:, count:][:, own] = (one.values - x[one.entries]).T
        ties.append(tie)
    return np.concatenate(ties), of_choice
