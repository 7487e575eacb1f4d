"""Validation with air, leaking and underlapped valves, and without overlaps."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import armdesign as ad
from armdesign.hydraulics.friction import Friction
from armdesign.report.validations import validation_sheet, verdict
from armdesign.simulation.experiment import Experiment
from armdesign.simulation.resting import Resting
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


CRANE = """
name = "crane"
joints = ["slew", "luff"]
tool = { link = "jib", at_mm = [3500, 0, 0] }
[links.base]
[links.column]
parent = "base"
joint = "slew"
axis = [0, 0, 1]
limits_deg = [-170, 170]
mass_kg = 300
centre_mm = [50, 0, 500]
inertia_kg_m2 = [20, 20, 10]
[links.jib]
parent = "column"
joint = "luff"
at_mm = [100, 0, 1200]
limits_deg = [-10, 65]
mass_kg = 180
centre_mm = [1600, 0, 0]
inertia_kg_m2 = [3, 190, 190]
[payload.empty]
mass_kg = 0
[fluid]
bulk_modulus_MPa = 1300
entrained_air_percent = 0.5
[supply]
pressure_bar = 180
return_pressure_bar = 2
flow_l_per_min = 30
[motor.slew]
joint = "slew"
displacement_cm3 = 160
gear_ratio = 40
trapped_volume_l = { a = 0.9, b = 0.7 }
[motor.slew.valve]
rated_flow_l_per_min = 40
rated_drop_bar = 10
natural_frequency_hz = 12
damping_ratio = 0.8
preload_bar = 30
leakage_l_per_min_per_bar = 0.001
[cylinder.luff]
bore_mm = 100
rod_mm = 56
stroke_mm = 700
closed_length_mm = 960
dead_volume_l = { cap = 0.4, annulus = 0.4 }
base = { link = "column", at_mm = [250, 0, 250] }
rod_end = { link = "jib", at_mm = [900, 0, -60] }
[cylinder.luff.valve]
rated_flow_l_per_min = 60
rated_drop_bar = 10
natural_frequency_hz = 12
damping_ratio = 0.8
leakage_l_per_min_per_bar = 0.001
"""


def test_leaks_that_change_the_order_of_modes_are_no_fault() -> None:
    """Under the pressures of leaks the luffing mode, the lower one at rest, is the higher one.

    Each sweep is over its own mode; either was over that of the other.
    """
    machine, pose = ad.Machine.from_text(CRANE, "", Path("crane.toml")), [0.0, 0.6]
    assert Resting.of(machine, np.array(pose)).counterparts == [1, 0]
    validation = validate(machine, pose)
    assert [run.cylinder for run in validation.runs[::2]] == ["luff", "slew"]
    for run in validation.runs:
        assert run.remark == "leaks"
        assert run.identified_frequency == pytest.approx(run.frequency_at_rest, rel=0.01)
