"""Refusals where rods buckle: what the limit may give, and how far it goes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import armdesign as ad
from armdesign import Requirements
from armdesign.design.program.constraints import evaluations_at
from armdesign.design.search.infeasibility.concessions import largest_share
from armdesign.errors import InfeasibleError
from tests.design.designs import MACHINES, problem_of, workspace_of


def refused(name: str, **asked: Any) -> InfeasibleError:
    """The refusal of sizes; all that it asks for, granted at once, gives a design."""
    machine, space = MACHINES[name](), workspace_of(name)
    requirements = replace(Requirements.of(machine), **asked)
    with pytest.raises(InfeasibleError) as error:
        ad.size_cylinders(machine, space, requirements)
    granted = requirements.granting(error.value.conflict)
    ad.size_cylinders(machine, space, granted)
    return error.value


def test_no_rod_is_asked_to_buckle_under_the_thrust() -> None:
    """Of a factor of 2 a half was asked for, with which the rod buckles."""
    refusal = refused("odd", buckling_factor=2.0, buckling_share=0.1, cylinder_mass=40.0)
    given = [c for c in refusal.conflict if c.setting == "buckling_factor" and c.value]
    assert min(c.value or 0.0 for c in given) >= 1.0
    assert min(c.limit - c.together for c in given) >= 1.0


@pytest.mark.parametrize("name", ["double", "odd"])
def test_a_limit_far_out_of_reach_is_told_with_all_that_others_must_give(name: str) -> None:
    """A factor of 1000: its own amount was told, and that others conflicted besides."""
    refusal = refused(name, buckling_factor=1000.0, cylinder_mass=20.0)
    assert "others conflict" not in refusal.fault
    assert {c.setting for c in refusal.conflict if c.value} >= {
        "buckling_factor",
        "cylinder_mass_kg",
    }


@pytest.mark.parametrize("share", [0.1, 0.5, 0.99])
def test_room_of_a_limit_of_buckling_is_what_the_constraint_gains(share: float) -> None:
    """The constraint with the limit as it is and relaxed, by evaluating both."""
    limits = []
    for least in (8.0, 8.0 * (1 - share)):
        problem = problem_of("double")
        requirements = replace(problem.requirements, buckling_factor=least)
        limits.append(next(
            e for e in evaluations_at(problem.under(requirements), problem.vector.start)
            if e.name == "buckling_factor.lift"
        ))  # fmt: skip
    before, after = (e.constraint[0, 0].real for e in limits)
    gained = limits[0].room(share) * limits[0].limit_sensitivity[0, 0].real
    np.testing.assert_allclose(gained, after - before, rtol=1e-9)


@pytest.mark.parametrize(("least", "most"), [(2.0, 0.5), (1.0, 0.0), (0.8, 0.0)])
def test_a_factor_of_a_file_at_or_below_1_gives_nothing(least: float, most: float) -> None:
    """A refusal lowered what the file itself states there, below the thrust."""
    requirements = replace(problem_of("double").requirements, buckling_factor=least)
    problem = problem_of("double").under(requirements)
    shares = [
        largest_share(requirements, e)
        for e in evaluations_at(problem, problem.vector.start)
        if e.setting == "buckling_factor"
    ]
    np.testing.assert_allclose(shares, most, atol=1e-3)  # within what a file allows
    assert len(shares) == 2
