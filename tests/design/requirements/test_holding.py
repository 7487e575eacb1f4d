"""Holding by the static forces of the workspace."""

from __future__ import annotations

import math

import pytest

from armdesign.design.program.constraints import constraints_at
from armdesign.design.requirements.check import check
from tests.design.designs import MACHINES, problem_of
from tests.design.requirements.shared import PRESSURE, by_name, judged


def test_holding_by_the_static_forces_of_the_workspace() -> None:
    """Largest F/(p A1 − p_r A2) pushing and −F/(p A2 − p_r A1) pulling, from ``Machine.at`` at
    every pose and case.
    """
    problem = problem_of("excavator", holding_share=0.5)
    machine = problem.machine
    checks = by_name(check(machine, machine, problem.workspace, problem.requirements))
    for i, c in enumerate(machine.cylinders):
        used = 0.0
        for payload in machine.payloads:
            case = machine.with_payload(payload.name)
            force = case.at(problem.workspace.q[case.holds(problem.workspace.q)]).cylinder_forces[
                :, i
            ]
            used = max(used, force.max() / (PRESSURE * c.bore_area - 5e5 * c.annulus_area))
            used = max(used, -force.min() / (PRESSURE * c.annulus_area - 5e5 * c.bore_area))
        assert checks[f"holding.{c.name}"].value == pytest.approx(used, rel=1e-12)
        assert checks[f"holding.{c.name}"].slack == pytest.approx((0.5 - used) / 0.5, rel=1e-9)
    assert checks["holding.boom"].slack < 0  # 0.53 of what the supply holds


def test_a_relief_below_the_supply_holds_its_own_pressure() -> None:
    """The boom's relief at 190 of 350 bar: its static force over 190 bar × A1 − 5 bar × A2, as it
    pushes everywhere; the stick's stays.
    """
    today = MACHINES["excavator"]()
    machine = today.replace({"cylinder.boom.valve.relief_bar": 190.0})
    boom = machine.cylinders[0]
    before, after = (judged(m, m) for m in (today, machine))
    full, relieved = (p * boom.bore_area - 5e5 * boom.annulus_area for p in (PRESSURE, 190e5))
    used = before["holding.boom"].value * full / relieved
    assert after["holding.boom"].value == pytest.approx(used, rel=1e-12)
    assert after["holding.stick"].value == before["holding.stick"].value


@pytest.mark.parametrize(("rod", "holds"), [(119.0, True), (119.2, False)])
def test_a_rod_too_thick_to_pull_with(rod: float, holds: bool) -> None:
    """350 bar on the annulus against 5 bar on the bore: nothing is left from a rod of √(1 − 5/350)
    = 0.9928 bores.

    That is 119.14 mm of 120: the bucket's cylinder, which pulls somewhere, then holds no load,
    however small; for the check and for the optimiser, at all other requirements' leisure.
    """
    problem = problem_of(
        "excavator", ("cylinder.bucket.rod_mm",), holding_share=1e9, oil_total_share=9.0
    )
    today = problem.machine
    forces = problem.dynamics.nominal_forces(problem.vector.start)[:, 2]
    assert forces.min() < 0
    machine = today.replace({"cylinder.bucket.rod_mm": rod})
    holding = by_name(check(machine, today, problem.workspace, problem.requirements))[
        "holding.bucket"
    ]
    x = problem.vector.start.copy()
    x[5] = (0.12**2 - (rod / 1000) ** 2) / (0.12**2 - 0.085**2)
    at = constraints_at(problem, x)
    room = min(
        value for name, value in zip(at.names, at.values, strict=True) if name == "holding.bucket"
    )
    if holds:
        assert holding.slack > 0
        assert room > 0
    else:
        assert holding.value == math.inf
        assert holding.slack == -math.inf
        assert room < 0
