"""Torque of actuators, both ways, over the range of their joints."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

import armdesign as ad
from armdesign import Requirements, Workspace
from armdesign.design.program.constraints import constraints_at
from armdesign.design.requirements.check import check
from armdesign.mechanism.joint_ranges import over
from tests.design.by_machine import slopes
from tests.design.designs import MACHINES, as_machine, problem_of, some_x, workspace_of
from tests.design.requirements.shared import CHANGES, PRESSURE, by_name, shipped_reference
from tests.machines import ANY_LIFT_AND_TORQUE, ODD
from tests.reference_planar import Reference

SHARES = {"torque_share": 0.95, "end_torque_share": 0.8}


@pytest.mark.parametrize("cylinder", ["boom", "stick", "bucket"])
def test_torque_by_the_independent_reference(cylinder: str, tmp_path: Path) -> None:
    """Planar reference: complex step of the length, 20 001 poses; a parabola through 181: 1e-5."""
    problem = problem_of("excavator", **SHARES)
    today = problem.machine
    machine = today.replace(CHANGES[cylinder])
    new, old = Reference.load(machine.save(tmp_path / "new.toml")), shipped_reference(today)
    checks = by_name(check(machine, today, problem.workspace, problem.requirements))
    after, before = ({c.name: c for c in m.cylinders}[cylinder] for m in (new, old))
    arms = [abs(m.joint_scan(c, old.ranges)[2]) for m, c in ((new, after), (old, before))]
    for direction, areas in {
        "extending": (after.bore_area, before.bore_area),
        "retracting": (after.annulus_area, before.annulus_area),
    }.items():
        torques = [PRESSURE * area * arm for area, arm in zip(areas, arms, strict=True)]
        largest = checks[f"torque.{direction}.{cylinder}"]
        assert largest.value == pytest.approx(torques[0].max(), rel=1e-5)
        assert largest.limit == pytest.approx(0.95 * torques[1].max(), rel=1e-5)
        ratio = min(torques[0][k] / torques[1][k] for k in (0, -1))
        at_ends = checks[f"end_torque.{direction}.{cylinder}"]
        assert (at_ends.value, at_ends.limit) == (pytest.approx(ratio, rel=1e-6), 0.8)
        assert largest.slack == pytest.approx(largest.value / largest.limit - 1)
        assert at_ends.slack == pytest.approx(ratio / 0.8 - 1, rel=1e-6)


@pytest.mark.parametrize("name", ["crossing", "branched", "rotator"])
def test_torque_of_every_actuator_by_virtual_work(name: str) -> None:
    """F dℓ/dq by central differences, also across several joints and of a motor; a parabola."""
    today, step = ODD[name](), 1e-5
    checks = by_name(check(today, today, Workspace.grid(today, 3), Requirements(**SHARES)))
    middle = today.ranges.mean(axis=1)
    names = set()
    for actuator, drive in zip(today.actuators, today.drives, strict=True):
        for joint in drive.joints:
            q = np.tile(middle, (2001, 1))
            q[:, joint] = over(today.ranges[joint], len(q))
            aside = step * np.eye(len(middle))[joint]
            lengths = [drive.length(today.arm.kinematics(q + way * aside)) for way in (1, -1)]
            arm = abs(lengths[0] - lengths[1]).max() / (2 * step)
            own = f"{actuator.name}.{today.joints[joint]}"
            label = own if len(drive.joints) > 1 else actuator.name
            names.add(label)
            for direction, area in (
                ("extending", actuator.bore_area),
                ("retracting", actuator.annulus_area),
            ):
                wanted = today.supply.pressure * area * arm
                torque = checks[f"torque.{direction}.{label}"]
                assert torque.value == pytest.approx(wanted, rel=1e-4)
                assert torque.limit == pytest.approx(0.95 * wanted, rel=1e-4)
                assert torque.unit == ("N m" if today.arm.joints[joint].revolute else "N")
    assert {n.split(".", 2)[2] for n in checks if n.startswith("torque.")} == names


@pytest.mark.parametrize(
    "name", ["double", *(pytest.param(n, marks=pytest.mark.slow) for n in ("odd", "excavator"))]
)
def test_derivatives(name: str) -> None:
    """Every torque by every variable against central differences of the value itself."""
    problem = problem_of(name, **SHARES)
    x, rows = some_x(problem, 4), np.array([0])
    at = constraints_at(problem, x, rows)
    torques = np.array(["torque" in n for n in at.names])
    expected = slopes(lambda y: constraints_at(problem, y, rows).values[torques], x)
    assert torques.sum() == 6 * len(problem.machine.actuators)
    assert_allclose(at.jacobian[torques].T, expected, rtol=0, atol=1e-8 * np.abs(expected).max())


@pytest.mark.parametrize("name", ["double", "odd", "excavator"])
def test_constraints_are_the_checks(name: str) -> None:
    """The room at the machine that x describes; 61 poses of a range against 181: 1e-4."""
    problem = problem_of(name, **SHARES)
    x = some_x(problem, 2, 0.15)
    machine, at = as_machine(problem, x), constraints_at(problem, x)
    checks = by_name(check(machine, problem.machine, problem.workspace, problem.requirements))
    for label in {n for n in at.names if "torque" in n}:
        value = at.values[np.array(at.names) == label].min()
        share = SHARES[f"{label.split('.')[0]}_share"]
        assert value / share == pytest.approx(checks[label].slack, abs=1e-4)


def test_without_a_share_there_is_no_such_requirement() -> None:
    machine, space = MACHINES["double"](), workspace_of("double")
    some = Requirements(
        torque_share={"default": 0, "fold": 0.9}, end_torque_share={"default": 0.8, "fold": 0}
    )
    names = [c.name for c in check(machine, machine, space, some) if "torque" in c.name]
    assert names == [
        "end_torque.extending.lift",
        "end_torque.retracting.lift",
        "torque.extending.fold",
        "torque.retracting.fold",
    ]
    none = Requirements(torque_share=0, end_torque_share=0)
    assert not [c for c in check(machine, machine, space, none) if "torque" in c.name]


@pytest.mark.parametrize("catalogue", [None, "iso"])
def test_a_design_keeps_the_torques_of_its_file(catalogue: str | None) -> None:
    """Rounded or of a catalogue, written and read; without the requirement they fall below."""
    machine, space = MACHINES["double"](), workspace_of("double")
    plain = Requirements(thrust_share=1.3, oil_each_share=1.3, **ANY_LIFT_AND_TORQUE)
    kept = replace(plain, **SHARES)
    with_torque, without = (
        ad.optimize(machine, space, r, ("areas",), starts=1, catalogue=catalogue)
        for r in (kept, plain)
    )
    slacks = [
        min(c.slack for c in check(d.machine, machine, space, kept) if "torque" in c.name)
        for d in (with_torque, without)
    ]
    assert slacks[0] >= -1e-9
    assert slacks[1] < 0
    assert with_torque.unrounded <= without.unrounded * (1 + 1e-6)
