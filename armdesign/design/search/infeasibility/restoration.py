"""Restoration of feasibility: back to designs that meet all requirements."""

from __future__ import annotations

from armdesign.arrays import Array
from armdesign.design.program.constraints import holding_rows
from armdesign.design.program.problem import Problem
from armdesign.design.search.infeasibility.elastic_programme import (
    MET,
    ROUGH,
    ElasticProgramme,
    Roles,
)
from armdesign.design.search.sequential_sdp import MISSED, Search

# share of what is missed that a step must promise, where a design that meets all is sought
EXACT = 1e-6
STRICT = (
    30.0  # times dearer a missed requirement, for a search that left the designs that meet all
)


def nearest_design(problem: Problem, x: Array) -> Search:
    """The search of a problem at the design that misses its requirements least.

    Sought from ``x``, which it is if that misses none, without regard to frequency.
    """
    programme = ElasticProgramme(problem, x, holding_rows(problem, x))
    solution = programme.solve(Roles((), programme.names), ROUGH, starts=1)
    return Search(problem=problem, x=solution.x, holding=programme.holding).look()


def restore_feasibility(search: Search) -> Search:
    """The search, on from where all requirements are met, if a way there is found."""
    if search.violation <= MISSED:
        return search
    programme = ElasticProgramme(search.problem, search.x, search.holding)
    solution = programme.solve(Roles((), programme.names), EXACT)
    return run_from_feasible(search, solution.x) if solution.met else search


def run_from_feasible(search: Search, x: Array) -> Search:
    """The search, on from a design that meets all requirements, without leaving those that do."""
    for strictness in (search.strictness, STRICT):
        search = search.at(x, strictness).run(trust=0.02, tolerance=1e-5)
        if search.violation <= 10 * MET:
            return search
    return search.at(x)
