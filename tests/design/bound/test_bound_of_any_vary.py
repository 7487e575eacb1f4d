"""The bound whatever varies: words, single numbers and mixtures of them; and what is no proof is
not stated.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

import armdesign as ad
from armdesign import Machine, Requirements, Workspace
from armdesign.design import design as optimum
from armdesign.design.bound import lagrangian, regions
from armdesign.design.bound.branching import first_look, nearer
from armdesign.design.bound.certificate import Certificate, certificate_of
from armdesign.design.bound.columns import joint_drives
from armdesign.design.bound.lagrangian import LagrangianDual
from armdesign.design.catalogue import branch_and_bound
from armdesign.design.catalogue.separable_bound import SeparableBound, separable_bound
from armdesign.design.program.constraints import constraints_at
from armdesign.design.program.problem import Problem
from armdesign.design.search.sequential_sdp import Search
from armdesign.frequency.modes import hertz
from armdesign.report.designs import design_sheets
from tests.design.designs import problem_of
from tests.machines import ANY_LIFT_AND_TORQUE, named

BUCKET = "cylinder.bucket.four_bar"
VARY = [  # of the 20 t machine: every kind of key path, and every kind of mixture
    ("areas",),
    ("areas", "pins"),
    ("cylinder.boom.bore_mm",),
    ("cylinder.boom.rod_mm",),
    ("cylinder.boom.base.at_mm.0",),
    ("cylinder.stick.base.at_mm.1",),
    ("cylinder.stick.base",),
    ("cylinder.bucket.base",),
    (f"{BUCKET}.pivot",),
    (f"{BUCKET}.lug.at_mm.0",),
    (f"{BUCKET}.rocker_mm",),
    ("pins", "cylinder.boom.bore_mm"),
    ("pins", "cylinder.boom.rod_mm"),
    ("cylinder.stick.rod_end.at_mm.0", "cylinder.stick.rod_mm"),
    ("cylinder.bucket.base", "cylinder.bucket.bore_mm"),
    (f"{BUCKET}.lug", "cylinder.bucket.bore_mm", "cylinder.boom.base"),
    ("areas", "cylinder.stick.base.at_mm.0"),
    ("cylinder.boom.bore_mm", "cylinder.stick.rod_mm", "cylinder.bucket.base.at_mm.2"),
]
MIXED = [  # of any machine, {} the name of a cylinder
    ("pins", "cylinder.{}.bore_mm"),
    ("cylinder.{}.base", "cylinder.{}.rod_mm"),
    ("cylinder.{}.rod_end.at_mm.0", "cylinder.{}.bore_mm"),
]
ODD = ["paper_1dof", "random_3", "random_18", "branched"]


@cache
def coarse(name: str) -> Workspace:
    machine = named(name)
    return Workspace.grid(
        machine, points=[7 if len(machine.joints) == 1 else 3] * len(machine.joints)
    )


def posed(name: str, vary: tuple[str, ...]) -> Problem:
    machine = named(name)
    return Problem.of(
        machine=machine, workspace=coarse(name), requirements=Requirements.of(machine), vary=vary
    )


def roughly_solved(problem: Problem) -> Search:
    return Search(problem=problem, x=problem.vector.start).run(trust=0.2, tolerance=1e-3, looks=1)


def best_of_random(problem: Problem, near: np.ndarray, seed: int = 0) -> float:
    """The best worst frequency [Hz] of allowed designs drawn at all distances of today's and of
    another one.
    """
    random, (low, high), best = np.random.default_rng(seed), problem.bounds, 0.0
    for k in range(30):
        reach = (high - low) * 10 ** random.uniform(-3, -0.3)
        x = np.clip(
            (near if k % 3 else problem.vector.start) + random.uniform(-1, 1, len(low)) * reach,
            low,
            high,
        )
        if problem.vector.closes(x) and constraints_at(problem, x).values.min() >= 0:
            best = max(best, hertz(float(problem.dynamics.omega_squared(x).min())))
    return best


def holds(problem: Problem) -> float | None:
    """Assert that the bound lies above all that is known to be allowed; its gap, or None where
    none is known.
    """
    search = roughly_solved(problem)
    bound = certificate_of(problem, search.x, search.rows)
    if bound is None:
        return None
    assert bound.refused == ""
    assert not math.isnan(bound.frequency)
    value = hertz(search.squared) if search.violation <= 1e-5 else 0.0
    assert bound.frequency >= max(value, best_of_random(problem, search.x))
    return bound.frequency / value - 1 if value else None


@pytest.fixture
def few_cells(monkeypatch: pytest.MonkeyPatch) -> None:
    """Branching and multipliers that stop early are only less tight."""
    monkeypatch.setattr(regions, "ROUNDS", 2)
    monkeypatch.setattr(regions, "AIRY", 1)
    monkeypatch.setattr(regions, "REGIONS", 3)
    monkeypatch.setattr(lagrangian, "CELLS", 3000)


@pytest.mark.slow
@pytest.mark.usefixtures("few_cells")
@pytest.mark.parametrize("vary", VARY, ids="+".join)
def test_no_design_exceeds_the_bound_whatever_varies(vary: tuple[str, ...]) -> None:
    """20 t machine: the search's own end and random allowed designs, as the problem itself judges
    them.
    """
    holds(posed("rigid_excavator_20t", vary))


@pytest.mark.usefixtures("few_cells")
@pytest.mark.parametrize(
    "name", [*ODD[:1], *(pytest.param(name, marks=pytest.mark.slow) for name in ODD[1:])]
)
@pytest.mark.parametrize("vary", MIXED, ids="+".join)
def test_no_design_of_odd_machines_exceeds_the_bound(name: str, vary: tuple[str, ...]) -> None:
    """Slides, skew axes, air, four-bars: a size that varies alone, with pins."""
    pairs = zip(named(name).cylinders, named(name).linkages, strict=True)
    cylinder = next(
        c for c, linkage in pairs if linkage.pin("rod_end") and len(linkage.joints) == 1
    )
    holds(posed(name, tuple(word.format(cylinder.name) for word in vary)))


@pytest.mark.slow
@pytest.mark.parametrize("size", ["bore", "rod"])
def test_one_size_with_the_pins_has_a_near_bound(size: str) -> None:
    """The bore alone, its rod fixed, had a bound of 0 Hz: near what is found, and not above that
    of both sizes.
    """
    own, both = (
        roughly_solved(problem_of("single", ("pins", *words)))
        for words in (
            [f"cylinder.lift.{size}_mm"],
            ["cylinder.lift.bore_mm", "cylinder.lift.rod_mm"],
        )
    )
    near, wide = (certificate_of(search.problem, search.x, search.rows) for search in (own, both))
    assert near is not None
    assert wide is not None
    assert near.held == ()
    # measured, rounded up
    assert hertz(own.squared) <= near.frequency < hertz(own.squared) * 1.05
    assert near.frequency**2 <= wide.frequency**2 * (1 + regions.ENOUGH) ** 2


def test_a_bore_alone_leaves_an_annulus() -> None:
    """All that x may be, between its bounds, can be built: areas and rods are positive, and the
    rod is today's.
    """
    problem = posed("rigid_excavator_20t", ("pins", "cylinder.boom.bore_mm"))
    for x in problem.bounds:
        areas = problem.vector.areas(x)
        assert areas.min() > 0
        assert areas[0, 0] - areas[0, 1] == pytest.approx(2 * math.pi / 4 * 0.085**2)


# -------------------------------------------------------------------------------- what is no proof


def test_what_is_not_a_number_is_not_known() -> None:
    """A share whose value is nowhere a number has no upper bound: no box may be dropped."""
    problem = problem_of("double")
    dual = LagrangianDual.start(
        problem, joint_drives(problem), problem.vector.start, np.arange(len(problem.dynamics.rows))
    )
    share = dual.terms(dual.multipliers())[0]
    unknown = replace(share, price=np.full(2, np.nan))
    assert nearer(unknown, first_look(unknown), 0.02, 500).upper == math.inf


def test_no_share_at_all_is_no_proof() -> None:
    """Where branching finds nothing allowed, though a design is at hand, or no number, nothing is
    bounded.
    """
    problem = problem_of("double")
    dual = LagrangianDual.start(
        problem, joint_drives(problem), problem.vector.start, np.arange(len(problem.dynamics.rows))
    )
    multipliers = dual.multipliers()
    term = dual.terms(multipliers)[0]
    some = nearer(term, first_look(term), 0.1, 200)
    for wrong in (-math.inf, math.nan):
        assert dual.bound(multipliers, [replace(some, upper=wrong), some]) == math.inf


def test_a_bound_below_a_design_is_refused() -> None:
    """By more than rounding; else it is raised to the design: a larger bound still holds."""
    bound = Certificate(frequency=1.2, held=(), assumptions=())
    assert bound.above(1.1) == bound
    assert bound.above(1.2 * (1 + 1e-6)).frequency == 1.2 * (1 + 1e-6)
    refused = bound.above(1.3)
    assert refused.frequency == math.inf
    assert "1.200 Hz" in refused.refused
    assert "1.300 Hz" in refused.refused
    assert replace(bound, frequency=math.nan).above(1.0).frequency == math.inf


def test_a_bound_that_says_nothing_is_not_stated() -> None:
    """More than twice what a design reaches; the reason names the cylinders taken as rigid."""
    bound = Certificate(frequency=2.1, held=("lift",), assumptions=())
    assert bound.useful(1.1) == bound
    far = bound.useful(1.0)
    assert far.frequency == math.inf
    assert "2.1 Hz with the lift cylinder rigid" in far.refused
    assert far.useful(1.0) == far


@pytest.fixture(scope="module")
def machine() -> Machine:
    return named("paper_1dof")


@pytest.mark.slow
@pytest.mark.parametrize("wrong", [0.0, 5.0, math.nan])
def test_a_design_states_no_bound_below_itself(
    machine: Machine, wrong: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever the proof says: neither as a number nor in print; and why not is said."""
    monkeypatch.setattr(
        optimum,
        "certificate_within_bands",
        lambda *_: Certificate(frequency=wrong, held=(), assumptions=()),
    )
    design = ad.optimize(machine, coarse("paper_1dof"), starts=1)
    assert design.unrounded > 5
    assert design.bound is None
    assert design.gap is None
    note = design_sheets(design)[0].note
    assert "upper bound" not in note
    assert "no bound is known: the one found" in note


def test_a_catalogue_states_no_bound_below_its_best(
    machine: Machine, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Multipliers that say less of all combinations than one reaches are no proof."""

    def halved(*problem: Any) -> tuple[SeparableBound, np.ndarray]:
        bound, rows = separable_bound(*problem)
        by_size = [bounds / 2 for bounds in bound.by_size]
        return SeparableBound(bound.constant / 2, by_size), rows

    machine = machine.replace({f"requirements.{key}": 0.0 for key in ANY_LIFT_AND_TORQUE})
    proved = ad.size_cylinders(machine, coarse("paper_1dof"), catalogue="5mm")
    assert proved.bound == proved.unrounded
    monkeypatch.setattr(branch_and_bound, "separable_bound", halved)
    design = ad.size_cylinders(machine, coarse("paper_1dof"), catalogue="5mm")
    assert design.bound is None
    assert "no bound is known" in design_sheets(design)[0].note
