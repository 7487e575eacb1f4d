"""Bounds of designs whose own masses follow sizes and pins."""

from __future__ import annotations

import numpy as np
import pytest

from armdesign.design.bound.certificate import certificate_of
from armdesign.design.bound.mass_enclosure import bar_enclosures
from armdesign.design.program.constraints import constraints_at
from armdesign.design.program.problem import Problem
from armdesign.design.search.sequential_sdp import Search
from armdesign.frequency.modes import hertz
from tests.design.designs import solved
from tests.design.program.weighed_machines import bars, posed
from tests.machines import named

# -------------------------------------------------------------------- the bound for pins and areas


def of_the_bars(problem: Problem, x: np.ndarray, rows: np.ndarray) -> list[np.ndarray]:
    """What barrels and rods add to mass matrix, gravity and its slope."""
    dynamics = problem.dynamics
    bare = (dynamics.rows.mass, dynamics.rows.gravity, dynamics.rows.slope)
    parts = dynamics.inertia_and_gravity(x, dynamics.rows, rows)
    return [part - base[rows] for part, base in zip(parts, bare, strict=True)]


@pytest.mark.parametrize(
    ("name", "pins"), [("double", "pins"), ("sprung", "pins"), ("heavy_bars", "linkages")]
)
def test_own_masses_lie_within_their_intervals(name: str, pins: str) -> None:
    """Gravity, and Σ ⟨W, ∂g/∂q − ω² M⟩ for random weights, of random designs, by ``loads`` with
    and without bars.

    Nothing is said of the joint of a four-bar that moves: a bound holds it.
    """
    machine = named(name) if name == "heavy_bars" else bars(name)
    problem = posed(machine, ("areas", pins))
    enclosed, random = bar_enclosures(problem), np.random.default_rng(7)
    assert enclosed is not None
    assert [bar.cylinder for bar in enclosed] == list(range(len(machine.cylinders)))
    rows = np.arange(0, len(problem.dynamics.rows), 5)
    rigid = problem.workspace.rigid[problem.dynamics.rows.pose[rows]]
    held = [machine.linkages[bar.cylinder].joints[0] for bar in enclosed if len(bar.per_area) > 2]
    assert bool(held) == (pins == "linkages")
    size = len(machine.arm.coordinates)
    free = np.setdiff1d(np.arange(size), held)
    root = random.normal(size=(len(rows), size, size))
    root[:, held] = 0.0
    weights, squared = root @ np.swapaxes(root, 1, 2), 400.0
    gravity = [bar.gravity(rigid) for bar in enclosed]
    low, high = sum(g.low for g in gravity), sum(g.high for g in gravity)
    worths = [bar.most_added(rigid, weights, squared) for bar in enclosed]
    bottom, top = problem.bounds
    tried = 0
    for _ in range(200):
        x = np.clip(random.uniform(bottom, top), None, 1.1)
        areas = problem.vector.areas(x)
        if np.any(areas[:, 1] > areas[:, 0]) or not problem.vector.closes(x):
            continue
        own = of_the_bars(problem, x, rows)
        scale = np.abs(own[1]).max()
        assert np.all((own[1] >= low - 1e-9 * scale)[:, free])
        assert np.all((own[1] <= high + 1e-9 * scale)[:, free])
        value = float(np.einsum("nij,nij->", weights, own[2] - squared * own[0]))
        most = sum(
            w[0] * a[0] + w[1] * (a[0] - a[1]) + sum(w[2:])
            for w, a in zip(worths, areas, strict=True)
        )
        assert value <= most + 1e-9 * abs(value)
        tried += 1
    assert tried > 20


@pytest.mark.slow
@pytest.mark.parametrize(("name", "gap"), [("single", 0.05), ("double", 0.12), ("sprung", 0.12)])
def test_no_random_design_exceeds_the_bound(name: str, gap: float) -> None:
    """Allowed designs drawn in the boxes; ``gap``: measured and rounded up, bars here are half of
    all inertia.
    """
    problem = posed(bars(name), ("areas", "pins"))
    search, random = solved(problem, 1e-5), np.random.default_rng(8)
    bound = certificate_of(problem, search.x, search.rows)
    assert bound is not None
    assert "own masses in proportion to areas and lengths" in bound.assumptions
    assert hertz(search.squared) <= bound.frequency < hertz(search.squared) * (1 + gap)
    low, high = problem.bounds
    tried = 0
    for _ in range(600):
        pin = np.array([v.pin is not None for v in problem.vector.variables])
        x = np.where(
            pin, random.uniform(low, high) * random.uniform(), random.uniform(0.8, 1.1, len(low))
        )
        if constraints_at(problem, x).values.min() >= 0:
            assert hertz(problem.dynamics.omega_squared(x).min()) <= bound.frequency
            tried += 1
    assert tried > 5


@pytest.mark.slow
def test_no_random_design_exceeds_the_bound_of_a_heavy_four_bar_that_moves() -> None:
    """All of its four-bar moves and weighs; designs around the start and what a rough search
    finds, limits loose.
    """
    loose = {
        "oil_total_share": 1.2,
        "oil_each_share": 1.3,
        "thrust_share": 1.3,
        "holding_share": 2.0,
    }
    loose |= {"moment_arm_share": 0.5, "buckling_share": 0.5, "digging_share": 0.5}
    problem = posed(named("heavy_bars"), ("areas", "linkages"), points=3, **loose)
    search = Search(problem=problem, x=problem.vector.start).run(
        trust=0.2, tolerance=0.02, looks=1
    )
    bound, random = certificate_of(problem, search.x, search.rows), np.random.default_rng(8)
    assert bound is not None
    assert bound.held == ("bucket",)
    reached = []
    pin = np.array([v.pin is not None for v in problem.vector.variables])
    for _ in range(60):
        x = problem.vector.start + random.uniform() * random.uniform(
            -0.1, 0.1, len(pin)
        ) * np.where(pin, 1.0, 0.3)
        x = np.clip(x, *problem.bounds)
        if problem.vector.closes(x) and constraints_at(problem, x).values.min() >= 0:
            reached.append(hertz(problem.dynamics.omega_squared(x).min()))
    assert len(reached) > 3
    assert search.violation < 1e-3
    assert max(reached) < hertz(search.squared) <= bound.frequency < 1.25 * hertz(search.squared)
