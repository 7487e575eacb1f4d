"""The design problem against what it stands for: natural modes, finite differences, convexity."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from armdesign.design.program.constraints import constraints_at
from armdesign.design.program.lowest_eigenvalues import EXACT, lowest
from armdesign.design.program.problem import Problem
from tests.checks import assert_same
from tests.design.by_machine import slopes, true_frequencies
from tests.design.designs import MACHINES, problem_of, some_x


@pytest.mark.parametrize("name", MACHINES)
@pytest.mark.parametrize("proportional", [False, True])
def test_frequencies_are_those_of_the_machine_that_x_describes(
    name: str, proportional: bool
) -> None:
    """Today's machine at x = start, any other near it; 1e-10: the same formulas, another way
    round.
    """
    problem = problem_of(name, proportional=proportional)
    for x in (problem.vector.start, some_x(problem, 1), some_x(problem, 2)):
        squared = problem.dynamics.omega_squared(x)
        assert_allclose(np.sqrt(squared) / (2 * np.pi), true_frequencies(problem, x), rtol=1e-9)


def test_rows_are_the_load_cases_where_they_exist() -> None:
    """Every pose empty, and loaded only with the bucket between 120° and 240°
    (robots/excavator_20t).
    """
    problem = problem_of("excavator")
    machine, q = problem.machine, problem.workspace.q
    held = machine.holds(q, machine.payloads[1])
    assert 0 < held.sum() < len(q)
    assert len(problem.dynamics.rows) == len(q) + held.sum()
    # planar: the bucket's pitch is the sum of the joint angles
    tilt = np.degrees(q.sum(axis=1)) % 360
    assert np.all((tilt[held] > 119.999) & (tilt[held] < 240.001))


@pytest.mark.parametrize("near", [1.0, 1e-2, 1e-6, 0.0])
def test_lowest_eigenvalues_of_many_matrices(near: float) -> None:
    """By LAPACK, also where the two lowest are equal and where a matrix is not finite."""
    random = np.random.default_rng(1)
    eigenvalues = random.uniform(1.0, 50.0, (2 * EXACT, 3))
    eigenvalues[:, 1] = eigenvalues[:, 0] * (1 + near)
    axes = np.linalg.qr(random.normal(size=(2 * EXACT, 3, 3)))[0]
    matrices = axes @ (eigenvalues[:, :, None] * np.swapaxes(axes, 1, 2))
    matrices[::7] *= -1
    expected = np.linalg.eigvalsh(matrices)[:, 0]
    matrices[3], expected[3] = np.nan, 0.0
    actual = lowest(matrices.copy())
    size = np.abs(eigenvalues).max(axis=1)
    assert np.abs((actual - expected) / size).max() < 1e-7
    assert_same(np.sort(actual)[:EXACT], np.sort(expected)[:EXACT], 1e-14)


@pytest.mark.parametrize("size", [1, 2, 4])
def test_lowest_eigenvalues_of_other_sizes(size: int) -> None:
    """By LAPACK's routine for matrices of any kind; 0 where one is not finite."""
    half = np.random.default_rng(2).normal(size=(9, size, size))
    matrices = half + np.swapaxes(half, 1, 2)
    expected = np.linalg.eigvals(matrices).real.min(axis=1)
    matrices[3, 0, size - 1], expected[3] = np.inf, 0.0
    matrices[3, size - 1, 0] = np.inf
    assert_same(lowest(matrices), expected, 1e-12)


def test_chosen_lengths_leave_rows_and_todays_frequencies_alone() -> None:
    """They change the strokes of x, but neither inertia nor what ω² is measured by."""
    problem = problem_of("excavator")
    chosen = problem.with_lengths(((1.80, 1.30), (1.75, 1.60), None))
    assert chosen.dynamics.rows is problem.dynamics.rows
    assert chosen.dynamics.omega_squared_scale == problem.dynamics.omega_squared_scale
    start = problem.vector.start
    assert chosen.vector.strokes(start)[1][0] == 1.30
    assert np.any(chosen.dynamics.omega_squared(start) != problem.dynamics.omega_squared(start))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["odd", "excavator", "sprung"])
@pytest.mark.parametrize("proportional", [False, True])
def test_derivatives_of_stiffness(name: str, proportional: bool) -> None:
    """By every variable against central differences of the value itself."""
    problem = problem_of(name, proportional=proportional)
    x = some_x(problem, 3)
    rows = np.linspace(0, len(problem.dynamics.rows) - 1, 5).astype(int)
    # three bores and annuli, four pin coordinates of two cylinders, two of one
    assert len(x) == (2 * 2 + 2 * 4 if name == "sprung" else 2 * 3 + 2 * 4 + 2)
    expected = slopes(lambda y: problem.dynamics.scaled_stiffness_and_gradient(y, rows)[0], x)
    actual = problem.dynamics.scaled_stiffness_and_gradient(x, rows)[1]
    for v in range(len(x)):
        assert_same(actual[v], expected[v], 1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["single", "odd", "excavator"])
@pytest.mark.parametrize("tightening", [0.0, 1e-3])
def test_derivatives_of_limits(name: str, tightening: float) -> None:
    """By every variable against central differences of the value itself."""
    digging = {"odd": ("fold", "tilt"), "single": ("lift",), "excavator": ("stick", "bucket")}[
        name
    ]
    problem = problem_of(name, digging=digging).tightened(tightening)
    x = some_x(problem, 4)
    at = constraints_at(problem, x)
    holding = np.arange(0, len(problem.dynamics.rows), 7)
    expected = slopes(lambda y: constraints_at(problem, y, holding).values, x)
    actual = constraints_at(problem, x, holding)
    assert set(actual.names) == set(at.names)
    assert_allclose(actual.jacobian.T, expected, rtol=0, atol=1e-8 * np.abs(expected).max())


@pytest.mark.parametrize("name", ["double", "excavator", "sprung"])
def test_chord_is_stiffer_than_any_areas_in_the_box(name: str) -> None:
    """A²/(A s + V) is convex in A, so its chord lies above: chord − K ⪰ 0, and = 0 at
    the corners.
    """
    problem = problem_of(name, ("areas",))
    low, high = problem.vector.start - 0.3, problem.vector.start + 0.2
    rows = np.arange(0, len(problem.dynamics.rows), 3)
    base, rise = problem.dynamics.scaled_stiffness_chords(low, high, rows)
    random = np.random.default_rng(0)
    for x in [*random.uniform(low, high, (20, len(low))), low, high]:
        gap = (
            base
            + np.einsum("vnij,v->nij", rise, x - low)
            - problem.dynamics.scaled_stiffness_and_gradient(x, rows)[0]
        )
        size = np.abs(base).max()
        assert np.linalg.eigvalsh(gap).min() > -1e-12 * size
        if x is high or x is low:
            assert np.abs(gap).max() < 1e-12 * size


def test_proportional_dead_volumes_make_stiffness_linear() -> None:
    """A²/(A s + A v) = A/(s + v): the middle of two designs has the mean stiffness."""
    problem = problem_of("excavator", ("areas",), proportional=True)
    rows = np.arange(0, len(problem.dynamics.rows), 11)
    x, y = some_x(problem, 5, 0.3), some_x(problem, 6, 0.3)
    ends = [
        problem.dynamics.scaled_stiffness_and_gradient(z, rows)[0] for z in (x, y, (x + y) / 2)
    ]
    assert_same(ends[2], (ends[0] + ends[1]) / 2, 1e-12)


def test_pins_vary_only_where_asked_and_where_strokes_follow() -> None:
    """A cylinder across two joints keeps its pins; a box of nothing leaves areas alone; areas can
    stay.
    """
    from armdesign import Requirements, Workspace
    from tests.machines import named

    crossing = named("crossing")
    space = Workspace.grid(crossing, points=4)
    crossed = Problem.of(
        machine=crossing, workspace=space, requirements=Requirements(), vary=("areas", "pins")
    )
    moving = {
        crossed.machine.cylinders[v.cylinder].name for v in crossed.vector.variables if v.pin
    }
    assert moving == {"lift"}
    assert all(v.pin is None for v in problem_of("double", pin_box=0.0).vector.variables)
    fixed = problem_of("double", ("pins",))
    assert [low == high for low, high in zip(*fixed.bounds, strict=True)] == [
        v.pin is None for v in fixed.vector.variables
    ]
