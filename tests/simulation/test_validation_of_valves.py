"""Validation with air, leaking and underlapped valves, and without overlaps."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

import armdesign as ad
from armdesign.hydraulics.friction import Friction
from armdesign.report.validations import validation_sheet, verdict
from armdesign.simulation.experiment import Experiment
from armdesign.simulation.sweeps import Failure, FittedMode
from armdesign.simulation.validation import validate
from tests import machines
from tests.simulation import valves as helpers
from tests.simulation.valves import WORST


@pytest.mark.slow
def test_air() -> None:
    """β(p) of each chamber at its static pressure, as in the linear answer; the sweep is small
    enough for it.
    """
    machine = (
        machines.rigid("excavator_20t")
        .with_payload("full")
        .replace({"fluid.entrained_air_percent": 1.0})
    )
    full, half = validate(machine, WORST, cylinders=["boom"]).runs
    assert full.linear_frequency < 0.7
    assert abs(half.deviation) < abs(full.deviation) < 0.01


@pytest.mark.slow
def test_air_behind_valves_that_leak() -> None:
    """The valve's flow, not the load, sets the pressures, and they the oil's stiffness; the
    damping is the leak's.
    """
    changes: dict[str, float] = {"fluid.entrained_air_percent": 1.0}
    for name in ("boom", "stick", "bucket"):
        changes |= {f"cylinder.{name}.valve.overlap_percent": -0.5}
        changes |= {f"cylinder.{name}.valve.leakage_l_per_min_per_bar": 1e-3}
    validation = validate(
        machines.rigid("excavator_20t").with_payload("full").replace(changes),
        WORST,
        cylinders=["boom"],
    )
    for run in validation.runs:
        assert run.remark == "leaks"
        assert run.frequency_at_rest > 1.3 * run.linear_frequency
        assert run.identified_frequency == pytest.approx(run.frequency_at_rest, rel=1e-3)
        assert run.identified_damping == pytest.approx(run.linear_damping, rel=0.03)


@pytest.mark.slow
def test_wide_underlap() -> None:
    """What damps so much, and shifts the frequency by a quarter, is told from a fault."""
    changes = {
        f"cylinder.{name}.valve.overlap_percent": -5.0 for name in ("boom", "stick", "bucket")
    }
    machine = machines.rigid("excavator_20t").with_payload("full").replace(changes)
    for run in validate(machine, WORST, cylinders=["boom"]).runs:
        assert run.remark == "leaks"
        assert run.linear_damping > 0.4
        assert run.deviation < -0.2
        assert (
            abs(run.identified_frequency - run.frequency_at_rest)
            < 3 * run.fit.frequency_deviations[0]
        )
    # the edges bend the flow no more
    for run in validate(machine, WORST, cylinders=["boom"], amplitude=1e-4).runs:
        assert run.remark == "leaks"
        assert run.identified_frequency == pytest.approx(run.frequency_at_rest, rel=2e-3)


@pytest.mark.slow
def test_creep() -> None:
    """What leaks into a chamber behind a load-holding valve without pilot cannot leave it: the
    pressures rise.
    """
    across = {
        f"cylinder.{name}.valve.leakage_l_per_min_per_bar": 0.005
        for name in ("boom", "stick", "bucket")
    }
    machine = machines.rigid("excavator_20t").with_payload("full").replace(across)
    assert not Experiment.of(machine, np.array(WORST), 0, 0).creeps
    held = {"side": "annulus", "setting_bar": 380.0, "pilot_ratio": 0.0}
    held |= {"rated_flow_l_per_min": 429, "rated_drop_bar": 14}
    changes: dict[str, object] = {
        f"cylinder.boom.load_holding.{key}": value for key, value in held.items()
    }
    # p1 = p2 would need 370 bar
    machine = machine.replace(changes | {"cylinder.boom.valve.relief_bar": 360.0})
    assert Experiment.of(machine, np.array(WORST), 0, 0).creeps
    assert {run.remark for run in validate(machine, WORST, cylinders=["boom"]).runs} == {"creep"}


@pytest.mark.slow
def test_tank_leakage_is_no_creep() -> None:
    """Both chambers lose oil; but none leaks at return pressure, and the valve feeds the other:
    sweeps run there.
    """
    changes = {
        f"cylinder.{name}.valve.tank_leakage_l_per_min_per_bar": 0.005
        for name in ("boom", "stick", "bucket")
    }
    machine = machines.rigid("excavator_20t").with_payload("full").replace(changes)
    assert not Experiment.of(machine, np.array(WORST), 0, 0).creeps
    assert {run.remark for run in validate(machine, WORST, cylinders=["stick"]).runs} == {"agrees"}


@pytest.mark.slow
def test_sweeps_leave_overlaps_out() -> None:
    """In oil with air at small openings: a leap of the spool overshot them eighty times, and the
    sweep told a fault of 1 to 3 %.
    """
    crane = ad.load("loader_crane")
    wide = {f"cylinder.{c.name}.valve.overlap_percent": 10.0 for c in crane.cylinders}
    pose = [0.3, -1.0, 0.5]
    with_overlap, without = (validate(one, pose).frame for one in (crane.replace(wide), crane))
    assert without["remark"].str.startswith("agrees").all()
    pd.testing.assert_frame_equal(with_overlap, without)


@pytest.mark.slow
def test_a_sweep_that_hardly_breaks_loose() -> None:
    """It does not show the mode, as the table and its verdict tell; without dry friction it
    does.
    """
    machine = helpers.with_friction(ad.load("paper_1dof"), Friction(coulomb=1500, static=1500))
    assert isinstance(validate(machine, [0.0], amplitude=0.001).runs[0].with_friction, Failure)
    validation = validate(machine, [0.0], amplitude=0.004)
    for run in validation.runs:
        assert run.remark == "agrees"
        assert isinstance(run.with_friction, FittedMode)
        assert abs(run.with_friction.deviation) > 0.05 > 10 * abs(run.deviation)
    sheet = validation_sheet(validation.by_pose)
    assert sheet.columns[-2:] == ("dry", "remark")
    assert sheet.rows[0][-2] == f"{validation.frame['with_friction_hz'][0]:.4f}"
    assert "; largest deviation 0.0" in verdict([validation])
    assert " %, with dry friction " in verdict([validation])
