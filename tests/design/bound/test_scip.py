"""The largest share of one cylinder, by a global solver that knows no shapes and no cells.

On three machines, with rigid structure, oil without air and a return without pressure, whose part
in holding is bounded apart here.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armdesign import Requirements, Workspace
from armdesign.design.bound.branching import first_look, nearer
from armdesign.design.bound.columns import joint_drives
from armdesign.design.bound.lagrangian import LagrangianDual
from armdesign.design.program.problem import Problem
from tests.design.bound.scip_share import largest_share
from tests.machines import ANY_LIFT_AND_TORQUE, named

CLOSE = 1e-5  # of ω² over the reference
FINE, CELLS = 1e-6, 400_000
SECONDS = 200  # of processor time; measured: 20 to 60


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "points"), [("paper_1dof", 9), ("mini_excavator_2t", 4), ("loader_crane", 4)]
)
def test_a_global_solver_finds_the_largest_share(name: str, points: int) -> None:
    """Both the best pins that it finds and its own bound agree with ours."""
    machine = named(f"rigid_{name}").replace({"fluid.entrained_air_percent": 0.0})
    workspace = Workspace.grid(machine, points=points)
    required = replace(Requirements.of(machine), **ANY_LIFT_AND_TORQUE, lifts=())
    problem = Problem.of(machine, workspace, required, ("areas", "pins"))
    rows = np.arange(len(problem.dynamics.rows))
    dual = LagrangianDual.start(problem, joint_drives(problem), problem.vector.start, rows)
    term = dual.terms(dual.converged())[0]
    term = replace(term, limits=replace(term.limits, back=0.0))
    ours = nearer(term, first_look(term), FINE, CELLS)
    assert ours.upper - ours.value <= 2 * FINE
    value, bound = largest_share(term, FINE, SECONDS)
    assert value == pytest.approx(ours.value, abs=CLOSE)
    assert bound == pytest.approx(ours.upper, abs=CLOSE)
