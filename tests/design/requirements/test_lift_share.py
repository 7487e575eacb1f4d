"""Lift that remains: against lift charts, over poses, in conflicts and in designs."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

import armdesign as ad
from armdesign import Bands, InfeasibleError, Machine, Requirements, Workspace
from armdesign.design.program.constraints import constraints_at
from armdesign.design.program.problem import Problem
from armdesign.design.requirements.check import check, slacks, static_loads
from armdesign.design.search.prices import prices
from armdesign.machine import template
from armdesign.machine.lifting import liftable_masses
from tests.design.by_machine import slopes
from tests.design.designs import MACHINES, problem_of, solved, some_x, workspace_of
from tests.design.requirements.shared import judged, own
from tests.machine.test_lift_chart import two_elbows
from tests.machines import ANY_LIFT_AND_TORQUE, named


def _values(machine: Machine, today: Machine, **settings: float) -> dict[str, float]:
    checks = judged(machine, today, **settings)
    return {name: c.value for name, c in checks.items() if name.startswith("lift_share.")}


def test_todays_machine_lifts_what_it_lifts() -> None:
    """A share of one everywhere, so the slack is 1/0.9 − 1; with a share of 0 nothing is asked."""
    checks = own(lift_share=0.9)
    values = {name: c for name, c in checks.items() if name.startswith("lift_share.")}
    assert set(values) == {"lift_share.boom", "lift_share.stick"}  # the bucket's pin: no bucket
    for c in values.values():
        assert c.value == pytest.approx(1.0, rel=1e-12)
        assert c.slack == pytest.approx(1 / 0.9 - 1, rel=1e-9)
        assert (c.setting, c.at_least) == (c.name, True)
    assert not any(name.startswith("lift_share") for name in own(lift_share=0.0))


@pytest.mark.parametrize(
    "changes",
    [
        {"cylinder.boom.bore_mm": 114.0},
        {"cylinder.stick.bore_mm": 130.0, "cylinder.stick.rod_mm": 95.0},
        {"cylinder.boom.base.at_mm": [430.0, 0.0, -590.0]},
    ],
    ids=["boom", "stick", "pin"],
)
def test_least_share_is_that_of_the_charts(changes: dict[str, Any]) -> None:
    """The least of all actuators is the least ratio of both machines' charts."""
    today = MACHINES["excavator"]()
    new = today.replace(changes)
    old = ad.lift_chart(today)
    chart = ad.lift_chart(new, like=old)
    capacity = dict(zip(zip(chart.reach, chart.height, strict=True), chart.capacity, strict=True))
    places = zip(old.reach, old.height, old.capacity, strict=True)
    ratio = min(capacity[x, z] / mass for x, z, mass in places)
    assert ratio < 0.99
    assert min(_values(new, today, lift_share=0.9).values()) == pytest.approx(ratio, rel=1e-6)


def test_the_new_machine_may_take_its_own_best_pose() -> None:
    """Where two elbows reach a place, the ratio of charts with either, not of today's pose."""
    today = two_elbows()
    new = today.replace({"motor.turn.displacement_cm3": 40.0})
    old = ad.lift_chart(today)
    chart = ad.lift_chart(new, like=old)
    assert not np.allclose(chart.q, old.q)  # somewhere the other elbow lifts more now
    lifts = old.capacity > 0
    ratio = (chart.capacity[lifts] / old.capacity[lifts]).min()
    requirements = replace(Requirements.of(today), lift_share=0.5)
    checks = check(new, today, Workspace.grid(today, points=5), requirements)
    shares = [c.value for c in checks if c.name.startswith("lift_share.")]
    assert min(shares) == pytest.approx(ratio, rel=1e-9)


def test_an_actuator_that_the_load_leaves_alone_at_a_place() -> None:
    """There it lifts anything, so other places limit it; derivatives by central differences."""
    machine = Machine.from_text(template.new("crane"), "", Path("crane.toml"))
    poses = ad.lift_chart(machine).poses
    masses = liftable_masses(machine, poses.rigid, poses.arms, poses.torque, 0.87)
    idle = np.isinf(masses).sum(axis=0)
    assert 0 < idle.max() < len(masses)
    problem = Problem.of(
        machine=machine,
        workspace=Workspace.grid(machine, 3),
        requirements=Requirements.of(machine),
        vary=("areas", "pins"),
    )
    x, rows = some_x(problem, 3), np.array([0])
    at = constraints_at(problem, x, rows)
    lifts = np.array([name.startswith("lift_share") for name in at.names])
    expected = slopes(lambda y: constraints_at(problem, y, rows).values[lifts], x)
    assert_allclose(at.jacobian[lifts].T, expected, rtol=0, atol=1e-8 * np.abs(expected).max())
    checks = check(machine, machine, problem.workspace, problem.requirements)
    assert {c.value for c in checks if c.name.startswith("lift_share")} == {1.0}


def test_shares_of_many_sizes() -> None:
    """As of machines with these sizes, one after the other."""
    today, workspace = MACHINES["excavator"](), workspace_of("excavator")
    requirements = replace(Requirements.of(today), lift_share={"boom": 0.95, "default": 0.8})
    sizes = np.array([[c.bore_area, c.annulus_area] for c in today.cylinders])
    factors = np.random.default_rng(2).uniform(0.8, 1.1, (4, len(sizes), 1))
    loads = static_loads(today, workspace)
    names, slack = slacks(today, factors * sizes, today, workspace, requirements, loads)
    for areas, row in zip(factors * sizes, slack, strict=True):
        bores = np.sqrt(4 / np.pi * areas[:, 0] / [c.count for c in today.cylinders])
        rods = np.sqrt(
            4 / np.pi * (areas[:, 0] - areas[:, 1]) / [c.count for c in today.cylinders]
        )
        new = today.replace(
            {
                f"cylinder.{c.name}.{key}_mm": 1000 * float(values[i])
                for i, c in enumerate(today.cylinders)
                for key, values in (("bore", bores), ("rod", rods))
            }
        )
        by_name = {c.name: c for c in check(new, today, workspace, requirements)}
        for name in ("lift_share.boom", "lift_share.stick"):
            assert row[names.index(name)] == pytest.approx(by_name[name].slack, abs=1e-9)
            assert by_name[name].limit == (0.95 if name.endswith("boom") else 0.8)


@pytest.mark.slow
def test_a_conflict_names_the_share_that_grants_it() -> None:
    """No sizes with 5 % less thrust lift as much as today: what is asked for is granted, and
    enough.
    """
    machine, workspace = MACHINES["double"](), workspace_of("double")
    settings = {**ANY_LIFT_AND_TORQUE, "lift_share": 1.0, "thrust_share": 0.95}
    requirements = replace(Requirements.of(machine), **settings)
    with pytest.raises(InfeasibleError) as caught:
        ad.size_cylinders(machine, workspace, requirements)
    conflict = caught.value.conflict
    assert any(c.name == "lift_share.lift" and c.together > 0 for c in conflict)
    granted = requirements.granting(conflict)
    design = ad.size_cylinders(machine, workspace, granted)
    assert min(design.slacks.values()) >= -1e-9


@pytest.mark.slow
def test_price_is_what_relaxing_by_one_percent_buys() -> None:
    """Both actuators' prices together against solving again with 1 % less lift kept, 5 %."""
    before, after = (
        solved(problem_of("excavator", ("areas", "pins"), lift_share=share), 1e-8)
        for share in (0.95, 0.95 * 0.99)
    )
    priced = [p.gain for name, p in prices(before).items() if name.startswith("lift_share.")]
    gain = math.sqrt(after.squared / before.squared) - 1
    assert gain > 1e-3
    assert sum(priced) == pytest.approx(gain, rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "share", "gain"),
    [("excavator_20t", 0.9, 17.2), ("excavator_20t", 1.0, 11.0), ("excavator_12t", 0.95, 8.3)],
)
def test_gains_of_the_trials_with_lift_kept(name: str, share: float, gain: float) -> None:
    """Structure rigid, as trials with another optimiser's inputs found them; the written machine
    keeps the share at every point, by its own chart.
    """
    machine = named(f"rigid_{name}")
    requirements = replace(Requirements.of(machine), lift_share=share)
    design = ad.optimize(machine, requirements=requirements, bands=Bands(), starts=1)
    before, after = design.before.worst.frequency, design.after.worst.frequency
    assert 100 * (after / before - 1) == pytest.approx(gain, abs=0.15)
    old = ad.lift_chart(machine)
    new = ad.lift_chart(design.machine, like=old)
    places = dict(zip(zip(new.reach, new.height, strict=True), new.capacity, strict=True))
    for x, z, mass in zip(old.reach, old.height, old.capacity, strict=True):
        assert places[x, z] >= share * mass * (1 - 1e-9)
