"""Benchmarks: jobs cost no more than agreed, in counts; and the one against other optimisers is
fair: what rivals are told of a design is what ours is judged by.
"""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from armdesign import Workspace
from armdesign.design.program.constraints import constraints_at
from armdesign.design.search.multistart import formulate
from benchmarks.__main__ import ALLOWED, table
from benchmarks.rivals import Judge
from benchmarks.waiting import ARMDESIGN, Wait, seconds_of
from tests import machines


@pytest.mark.parametrize("name", ["excavator_20t", "heavy_bars", "loader_crane", "paper_1dof"])
def test_rivals_see_the_same(name: str) -> None:
    """Objective, static forces and requirements without derivatives are those with derivatives."""
    machine = machines.named(name)
    problem = formulate(machine, Workspace.grid(machine, points=4), None, ("areas", "pins"))
    shift = np.random.default_rng(0).uniform(-0.05, 0.05, len(problem.vector.start))
    x = np.clip(problem.vector.start + shift, *problem.bounds)
    squared, forces, missed = Judge(problem).at(x)
    np.testing.assert_allclose(
        squared, problem.dynamics.omega_squared_and_forces(x)[0], rtol=1e-12
    )
    np.testing.assert_allclose(forces, problem.dynamics.omega_squared_and_forces(x)[1], rtol=1e-12)
    ours = np.maximum(
        -constraints_at(problem, x, np.arange(len(problem.dynamics.nominal_rows.pose))).values, 0.0
    )
    assert missed.max() == pytest.approx(ours.max(), rel=1e-9)
    assert missed.max() > 1e-3


@pytest.mark.parametrize(
    "job",
    [
        *("map", "sizes", "design"),
        *(pytest.param(name, marks=pytest.mark.slow) for name in ("conflict", "validate")),
    ],
)
def test_jobs_cost_no_more_than_agreed(job: str) -> None:
    """Poses, rows, programmes, factorisations, cells of the bound, right-hand sides."""
    counts = table([job])
    assert len(counts) > 0
    assert (counts["ratio"] <= ALLOWED).all(), counts.to_string()


def test_commands_that_are_timed_run() -> None:
    """A module without a command in it ends at once, and well."""
    run = subprocess.run([sys.executable, *ARMDESIGN, "--version"], capture_output=True, text=True)
    assert run.stdout.startswith("armdesign ")
    assert seconds_of(Wait(("-c", "raise SystemExit(3)"), 1, ends=3)) > 0
    with pytest.raises(SystemExit, match="no such"):
        seconds_of(Wait(("-c", "raise SystemExit('no such')"), 1))
