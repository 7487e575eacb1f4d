"""Mass of all cylinders by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from numpy.testing import assert_allclose

from armdesign import Requirements
from armdesign.design.program.constraints import constraints_at
from armdesign.design.program.problem import Problem
from armdesign.design.requirements.check import check
from armdesign.hydraulics.cylinder_build import estimated_mass
from tests.design.by_machine import slopes
from tests.design.designs import MACHINES, as_machine, some_x, workspace_of
from tests.design.requirements.shared import PRESSURE, by_name, judged, own

WALLED = {"cylinder.boom.barrel_wall_mm": 12.5, "cylinder.bucket.barrel_wall_mm": 25.0}


def test_mass_of_all_cylinders() -> None:
    """The sum of ``estimated_mass`` by the file's numbers, two boom cylinders."""
    one = [
        estimated_mass(d, r, s, None, PRESSURE)
        for d, r, s in ((0.12, 0.085, 1.26), (0.14, 0.1, 1.504), (0.12, 0.085, 1.03))
    ]
    assert own(cylinder_mass=600.0)["cylinder_mass"].value == pytest.approx(
        2 * one[0] + one[1] + one[2], rel=1e-12
    )


def test_walls_of_the_file_count() -> None:
    """By hand: tubes D/(D + 2 w) in place of those that the pressure needs, k² = 71/50, of both
    boom cylinders and the bucket's, each S + D long; their bottoms are wider, too.
    """
    machine = MACHINES["excavator"]()
    new = machine.replace(WALLED)
    more = [
        ((0.12 + 2 * wall) ** 2 - 0.12**2 * 71 / 50) * (stroke + 0.12 + 0.06)
        for wall, stroke in ((0.0125, 1.26), (0.025, 1.03))
    ]
    old, today = (judged(m, machine, cylinder_mass=600.0)["cylinder_mass"] for m in (new, machine))
    by_hand = 7850 * math.pi / 4 * (2 * more[0] + more[1])
    assert old.value - today.value == pytest.approx(by_hand, rel=1e-6)


def test_candidates_keep_the_walls_of_the_file() -> None:
    """The optimiser's limit by every variable against differences, and its room is the check's."""
    machine = MACHINES["excavator"]().replace(WALLED)
    problem = Problem.of(
        machine=machine,
        workspace=workspace_of("excavator"),
        requirements=replace(Requirements.of(machine), cylinder_mass=600.0),
        vary=("areas", "pins"),
    )
    x = some_x(problem, 4)
    at = constraints_at(problem, x)
    row = at.names.index("cylinder_mass")
    expected = slopes(lambda y: constraints_at(problem, y).values[[row]], x)[:, 0]
    assert_allclose(at.jacobian[row], expected, rtol=0, atol=1e-9 * abs(expected).max())
    new = as_machine(problem, x)
    checks = by_name(check(new, machine, problem.workspace, problem.requirements))
    assert at.values[row] == pytest.approx(checks["cylinder_mass"].slack, rel=1e-9)
