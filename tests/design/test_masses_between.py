"""Designs for masses between the ends of their bands, in oil with air: what a design promises
holds at all masses that are tried. By brute force: each of them is a machine of its own.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

import armdesign as ad
from armdesign.design.program.constraints import constraints_at
from armdesign.design.program.problem import Problem
from armdesign.frequency.modes import hertz
from armdesign.journal.finished import keeping
from tests.checks import worst_within
from tests.design.designs import MACHINES, as_machine, problem_of, some_x, workspace_of

# load makes the oil stiffer, at first fast, and the machine heavier: with a fifth more oil than
# today "single" is at its worst between these ends
AIRY = ad.Bands(air=(0.07, 0.07), payload=(0.1, 3.0))
MORE_OIL = ad.Requirements(oil_total_share=1.2, oil_each_share=1.2)


def of_masses(machine: ad.Machine, problem: Problem) -> dict[tuple[float, float], float]:
    """Lowest frequency at all masses that are tried [Hz]."""
    today, space = problem.machine, problem.workspace
    band = ad.frequency_band(machine, space, AIRY, today=today)
    return {one.corner.masses: one.frequency for one in band.scenarios}


def test_a_design_is_made_for_the_ends_of_the_masses_while_these_are_the_worst() -> None:
    bands = ad.Bands(air=(0.0, 0.02), payload=(0.8, 1.2), link_mass=(0.9, 1.1))
    problem = problem_of("double", bands=bands, gain=True)
    ends = [(0.8, 0.9), (0.8, 1.1), (1.2, 0.9), (1.2, 1.1)]
    assert [corner.masses for corner in problem.dynamics.corners.all] == [*ends, *ends]
    assert len(problem.dynamics.corners.band.scenarios) == 2 * 25
    none = ad.size_cylinders(problem.machine, problem.workspace, bands=bands)
    assert none.problem.dynamics.corners.between == ()


@pytest.mark.parametrize("gain", [True, False], ids=["gain", "worst"])
def test_masses_between_count_when_they_are_asked_for(gain: bool) -> None:
    """The lowest ω² of all masses, and those that are missed, against whole machines."""
    ends = problem_of("single", bands=AIRY, gain=gain)
    shares = AIRY.mass_shares(ends.machine)
    every = ends.counting(tuple(ends.dynamics.corners.not_counted))
    corners = ends.dynamics.corners
    for x in (ends.vector.start, some_x(ends, 3)):
        new, today = (of_masses(m, ends) for m in (as_machine(ends, x), ends.machine))
        weights = {one: today[one] / corners.nominal if gain else 1.0 for one in shares}
        values = {one: new[one] / weights[one] for one in shares}
        reached = hertz(every.dynamics.omega_squared(x).min())
        assert_allclose(reached, min(values.values()), rtol=1e-9)
        machine = as_machine(ends, x)
        judged = corners.judged(machine)
        assert_allclose(judged, min(values[one] for one in AIRY.mass_ends), rtol=1e-9)
        lower = {one for one, value in values.items() if value < judged * (1 - 1e-4)}
        assert {one.masses for one in corners.missed(machine, judged)} == lower


@pytest.mark.parametrize("catalogue", [False, True])
def test_a_promise_holds_at_masses_between_the_ends_too(catalogue: bool) -> None:
    """The machine is at its worst between the ends, and its design counts that; no allowed sizes
    are better there.
    """
    machine, space = MACHINES["single"](), workspace_of("single")
    lift = machine.cylinders[0]
    shares = (1.0, 1.04, 1.08)
    sizes = [(share * lift.bore, share * lift.rod) for share in shares] if catalogue else None
    design = ad.size_cylinders(
        machine, space, MORE_OIL, bands=AIRY, objective="worst", catalogue=sizes
    )
    problem = design.problem
    assert problem.dynamics.corners.between
    reached = worst_within(as_machine(problem, design.x), space, AIRY, machine).frequency
    assert_allclose(design.unrounded, reached, rtol=1e-9)
    assert_allclose(
        design.judged, worst_within(design.machine, space, AIRY, machine).frequency, rtol=1e-9
    )
    assert design.judged == design.band_after.low.frequency
    assert design.bound is not None
    assert design.bound >= reached
    random, start, allowed = np.random.default_rng(1), problem.vector.start, 0
    for _ in range(0 if catalogue else 250):
        share = random.uniform(0.5, 1.0)
        x = start + share * (design.x - start) + random.normal(0, 0.003 * (1 - share), len(start))
        if constraints_at(problem, x).values.min() >= 0:
            allowed += 1
            other = worst_within(as_machine(problem, x), space, AIRY, machine).frequency
            assert other <= reached * (1 + 1e-4)  # where the search stops
    assert catalogue or allowed > 2


def test_a_least_amount_is_enough_at_masses_between_the_ends_too() -> None:
    machine, space = MACHINES["single"](), workspace_of("single")
    most = ad.size_cylinders(machine, space, MORE_OIL, bands=AIRY, objective="worst")
    frequency = most.judged
    design = ad.least(machine, space, MORE_OIL, frequency=frequency, vary=["areas"], bands=AIRY)
    assert design.problem.dynamics.corners.between
    assert worst_within(design.machine, space, AIRY, machine).frequency >= frequency


def test_a_journal_keeps_the_masses_that_count(tmp_path: Path) -> None:
    machine, space = MACHINES["single"](), workspace_of("single")

    def found() -> ad.Design:
        with keeping(tmp_path / "journal"):
            return ad.size_cylinders(machine, space, MORE_OIL, bands=AIRY, objective="worst")

    first, again = found(), found()
    assert again.problem.dynamics.corners.between
    assert again.problem.identity == first.problem.identity
    assert again.judged == first.judged
