"""Choices by which least is missed: against every combination, each by its linear programme."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.optimize import linprog

from armdesign.design.search.infeasibility.best_choice import Choice, best_choice
from armdesign.design.search.infeasibility.elastic_programme import Roles, Rooms, linear_programme
from armdesign.design.search.trust_region import LARGEST

ENTRIES, ROWS = 5, 12


def _drawn(seed: int) -> tuple[Rooms, list[Choice], tuple[np.ndarray, np.ndarray]]:
    """Requirements, linear in five entries, of which two pairs are chosen from three values."""
    random = np.random.default_rng(seed)
    x = random.uniform(-0.2, 0.2, ENTRIES)
    room, jacobian = random.normal(0, 0.3, ROWS), random.normal(size=(ROWS, ENTRIES))
    names = [f"r{k}" for k in range(ROWS // 2)]
    at = Rooms(x, names, np.repeat(np.arange(ROWS // 2), 2), room, jacobian, 1.0, 1.0)
    choices = [
        Choice(np.array(pair), x[list(pair)] + random.normal(0, 0.3, (3, 2)))
        for pair in ((0, 1), (2, 3))
    ]
    return at, choices, (np.full(ENTRIES, -1.0), np.ones(ENTRIES))


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(
    "roles", [Roles((), [f"r{k}" for k in range(6)]), Roles([["r0"]], ["r1"])]
)
def test_the_best_of_all_combinations(seed: int, roles: Roles) -> None:
    at, choices, bounds = _drawn(seed)
    costs = {}
    for numbers in itertools.product(range(3), range(3)):
        low, high = (np.clip(end - at.x, -LARGEST, LARGEST) for end in bounds)
        for one, k in zip(choices, numbers, strict=True):
            low[one.entries] = high[one.entries] = one.values[k] - at.x[one.entries]
        _, cost, limits, least, ends = linear_programme(at, roles, (low, high))
        costs[numbers] = linprog(cost, A_ub=limits, b_ub=least, bounds=ends).fun
    known: list[tuple[int, ...]] = []
    for _ in range(3):  # the best, the second best, the third
        answer = best_choice(at, roles, bounds, choices, known)
        assert answer is not None
        least_cost = min(cost for numbers, cost in costs.items() if numbers not in known)
        assert answer[1] == pytest.approx(least_cost, rel=2e-3, abs=1e-6)
        assert costs[answer[0]] == pytest.approx(least_cost, rel=2e-3, abs=1e-6)
        known.append(answer[0])


def test_none_where_all_are_known() -> None:
    at, choices, bounds = _drawn(0)
    known = list(itertools.product(range(3), range(3)))
    assert best_choice(at, Roles((), at.names), bounds, choices, known) is None
