"""Constraints of the optimiser: derivatives, and the same requirements as the check's."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from armdesign import Machine
from armdesign.design.program.constraints import constraints_at, least_rod_area_factor
from armdesign.design.program.problem import Problem
from armdesign.design.requirements.check import check
from armdesign.hydraulics.oil_spring import holding_force
from armdesign.machine.file.schema import share_of
from tests.design.by_machine import slopes
from tests.design.designs import MACHINES, as_machine, problem_of, some_x
from tests.design.requirements.shared import EVERYTHING, NEW, by_name


@pytest.mark.slow
@pytest.mark.parametrize("column", ["rod", "stepped"])
def test_derivatives(column: str) -> None:
    """Every new limit by every variable against central differences of the value itself."""
    problem = problem_of("excavator", **EVERYTHING | {"buckling_column": column}).tightened(1e-3)
    x, rows = some_x(problem, 4), np.arange(0, len(problem.dynamics.rows), 7)
    expected = slopes(lambda y: constraints_at(problem, y, rows).values, x)
    at = constraints_at(problem, x, rows)
    assert {name.split(".")[0] for name in at.names} >= set(NEW)
    assert_allclose(at.jacobian.T, expected, rtol=0, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_limits_are_the_checks(seed: int) -> None:
    """Names, signs and the room itself: (value − limit)/scale at the machine that x describes,
    written and measured.

    61 poses of a joint range against 181 for the speed at every pose and digging force: 1e-3.
    """
    problem = problem_of("excavator", **EVERYTHING)
    x = some_x(problem, seed, 0.1)
    at, new = constraints_at(problem, x), as_machine(problem, x)
    of_checks = {
        c.name: c for c in check(new, problem.machine, problem.workspace, problem.requirements)
    }
    for name in {n for n in at.names if n.split(".")[0] in NEW}:
        rows = np.array(at.names) == name
        value, slack = float(at.values[rows].min()), of_checks[name].slack
        assert (value > 0) == (slack > 0), name
        if name.split(".")[0] in (
            "speed",
            "digging_force",
            "cylinder_mass",
            "outline",
            "clearance",
        ):
            assert value == pytest.approx(slack, abs=1e-3), name


# over the range of a joint
SAMPLED = ("moment_arm", "digging", "transmission", "torque", "outline", "clearance")
GUARANTEED = ("range.", "pin_box.")  # by how x is made: strokes cover, bounds


def expected_slack(
    problem: Problem, machine: Machine, x: np.ndarray, name: str, values: np.ndarray
) -> list[float]:
    """The slack that ``check`` must find where ``limits`` says ``values``: the same room over
    another scale.

    Several answers for holding: each watched row over what the supply holds pushing or pulling;
    one is the worst.
    """
    r, kind, cylinder = problem.requirements, name.split(".")[0], name.split(".")[-1]
    value = float(values.min())
    if kind in ("outline", "clearance"):
        return [value]
    if kind == "oil":
        return [value / (r.oil_total_share if cylinder == "total" else r.oil_each_share)]
    i = [c.name for c in machine.cylinders].index(cylinder)
    a1, a2 = problem.vector.areas(x)[i]
    if kind == "buckling":  # safety ~ I/(L² A1) ~ (A1 − A2)²/(L² A1)
        needed = machine.cylinders[i].open_length * math.sqrt(
            least_rod_area_factor(problem, i) * a1
        )
        return [((needed + value * problem.vector.areas_today[i, 0]) / needed) ** 2 - 1]
    if kind == "holding":  # room over what the supply holds that way
        scale = machine.supply.pressure * problem.vector.areas_today[i, 0]
        valve, back = machine.cylinders[i].valve, machine.supply.return_pressure
        most = min(machine.supply.pressure, (valve and valve.relief) or math.inf)
        held = [float(holding_force(a1, a2, most, back, way)) for way in (True, False)]
        return [v * scale / way / r.holding_share for v in values.tolist() for way in held]
    if kind == "transmission":  # room by the angle's cosine
        poses = problem.vector.range_poses[i]
        assert poses is not None
        least = min(
            r.transmission,
            float(np.arccos(np.abs(problem.machine.linkages[i].transmission(poses)).max())),
        )
        return [math.acos(math.cos(least) - value * math.sin(least) * least) / least - 1]
    share = {
        "thrust": r.thrust_share, "dead_length": 1.0, "moment_arm": r.moment_arm_share,
        "digging": r.digging_share, "torque": share_of(r.torque_share, cylinder),
        "end_torque": r.end_torque_share,
    }[kind]  # fmt: skip
    return [value / share]


@pytest.mark.parametrize("name", MACHINES)
@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_constraints_of_the_optimiser_are_the_requirements(name: str, seed: int) -> None:
    """Same names, same signs, same room on machines that violate some of them.

    1e-3: ``limits`` samples a joint's range at 61 poses, ``check`` at 181, which tells torques,
    moment arms and digging apart.
    """
    digging = tuple(c.name for c in MACHINES[name]().cylinders[1:])
    torque = {"default": 0.95, **dict.fromkeys(digging, 0.9)}  # of these the digging asks for more
    problem = problem_of(
        name, digging=digging, torque_share=torque, holding_share=0.3, oil_each_share=1.02
    )
    x = some_x(problem, seed, 0.15)
    machine = as_machine(problem, x)
    at = constraints_at(problem, x)
    checks = by_name(check(machine, problem.machine, problem.workspace, problem.requirements))
    assert set(at.names) == {n for n in checks if not n.startswith(GUARANTEED)}
    for label in set(at.names):
        values = at.values[[n == label for n in at.names]]
        slack = checks[label].slack
        tolerance = 1e-3 if label.startswith(SAMPLED) else 1e-8
        if not label.startswith("lift_share"):  # the force that is spared, maybe elsewhere
            wanted = expected_slack(problem, machine, x, label, values)
            assert min(abs(slack - w) for w in wanted) < tolerance, (label, slack, wanted)
        if abs(slack) > tolerance:
            assert (slack > 0) == (values.min() > 0), label
    for label in checks:
        if label.startswith(GUARANTEED):
            assert checks[label].slack >= -1e-9, label
    moved = {v.cylinder for v in problem.vector.variables if v.pin}
    for i in moved:
        pins = np.array(
            [
                value
                for value, v in zip(x, problem.vector.variables, strict=True)
                if v.cylinder == i and v.pin
            ]
        )
        boxes = [
            c.slack
            for n, c in checks.items()
            if n.startswith(f"pin_box.{machine.cylinders[i].name}.")
        ]
        assert min(boxes) == pytest.approx(1 - np.abs(pins).max(), abs=1e-9)
