"""Rest: what a shut valve leaves, preloads of the file, reliefs, and the balance behind valves
that leak.
"""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

import armdesign as ad
from armdesign import Machine
from armdesign.errors import MachineFileError, SimulationError
from armdesign.inspection.inspection import inspect
from armdesign.report.maps import map_sheets
from armdesign.simulation.experiment import Experiment
from armdesign.simulation.linearization import linearize
from armdesign.simulation.simulate import simulate
from armdesign.simulation.validation import validate
from armdesign.units import bar, l_per_min
from tests import machines
from tests.simulation.plant.valve_machines import LIGHT, holding, started, valves
from tests.simulation.valves import WORST, with_leakage

# -------------------------------------------------------------------------- tight valves, preloads


@pytest.mark.parametrize("air", [0.0, 1.0])
def test_a_shut_valve_leaves_the_load_to_one_chamber(excavator: Machine, air: float) -> None:
    """F = A1 p1 − A2 p2 by hand, one chamber at the return's 5 bar, the other above: with air and
    without alike.
    """
    machine = excavator.replace({"fluid.entrained_air_percent": air})
    pressures, forces = started(machine, WORST), excavator.at(WORST).cylinder_forces[0]
    for cylinder, force, (cap, annulus) in zip(
        excavator.cylinders, forces, pressures, strict=True
    ):
        assert cylinder.bore_area * cap - cylinder.annulus_area * annulus == pytest.approx(
            force, rel=1e-9
        )
        assert min(cap, annulus) == pytest.approx(5 * bar)


def test_check_map_and_runs_name_the_same_pressures(excavator: Machine) -> None:
    """The largest static load that ``check`` names is where a run at that pose starts; the map's
    rows, too.
    """
    machine = valves(excavator, ("stick",), preload_bar=40.0)
    workspace = ad.Workspace.grid(machine, 5)
    frequencies = ad.frequency_map(machine, workspace)
    rows = (frequencies.frame["payload"] == "full").to_numpy()
    poses = frequencies.frame.loc[rows, list(machine.joints)].to_numpy()
    share, pressure = frequencies.holding_pressures[rows], frequencies.static_pressures[rows]
    np.testing.assert_allclose(share * machine.supply.pressure, pressure)
    loads = [load for load in inspect(machine, workspace).loads if load.payload == "full"]
    for i, load in enumerate(loads):
        row = int(np.argmin(np.abs(pressure[:, i] - load.pressure)))
        start = started(machine, poses[row])[i]
        assert max(start) == pytest.approx(load.pressure, rel=1e-9)
        assert start[0 if load.cap else 1] == max(start)
        assert min(start) == pytest.approx((40 if load.cylinder == 1 else 5) * bar)


def test_air_is_as_stiff_as_the_preload_makes_it(excavator: Machine) -> None:
    """Derivatives of the plant at its rest know no formula of stiffness: they and the map's modes
    agree.
    """
    airy = valves(excavator.replace({"fluid.entrained_air_percent": 1.0}), relief_bar=300.0)
    frequencies = []
    for preload in (5.0, 60.0):
        machine = valves(airy, preload_bar=preload)
        frequencies.append(ad.natural_modes(machine.at(WORST)).frequencies[0])
        assert linearize(machine, WORST).natural_frequencies == pytest.approx(
            frequencies[-1], rel=1e-6
        )
        assert Experiment.of(machine, np.array(WORST), 0, 0).target == pytest.approx(
            frequencies[-1][0], rel=1e-6
        )
    assert frequencies[1][0] > 1.1 * frequencies[0][0]


def test_preload_stays_below_the_relief(excavator: Machine) -> None:
    """Of the file, and what ``preloaded`` asks for: the force is held, no chamber stands within 5
    % of its relief.
    """
    for relief, preload in itertools.product((170.0, 220.0), (60.0, 150.0)):
        machine = valves(excavator, ("boom",), relief_bar=relief, preload_bar=preload)
        boom, force = machine.cylinders[0], machine.at(LIGHT).cylinder_forces[0, 0]
        for preloaded in (None, True):
            cap, annulus = started(machine, LIGHT, preloaded)[0]
            assert boom.bore_area * cap - boom.annulus_area * annulus == pytest.approx(force)
            assert max(cap, annulus) <= 0.95 * relief * bar * (1 + 1e-12)
            assert min(cap, annulus) >= 5 * bar
        # the cap at 95 % of its relief
        lower = (boom.bore_area * 0.95 * relief * bar - force) / boom.annulus_area
        assert min(started(machine, LIGHT)[0]) == pytest.approx(min(preload * bar, lower))
    # no relief in reach
    np.testing.assert_allclose(started(excavator, LIGHT, True).sum(axis=1), 355 * bar)
    slack = valves(excavator, preload_bar=80.0)
    np.testing.assert_allclose(started(slack, LIGHT, False).min(axis=1), 5 * bar)


def test_preload_of_a_motor_and_round_trip(tmp_path: Path) -> None:
    """Behind a tight valve: a leak would pull both chambers to one pressure."""
    tight = {"motor.swing.valve.leakage_l_per_min_per_bar": 0.0}
    machine = machines.named("slewing").replace(tight | {"motor.swing.valve.preload_bar": 30.0})
    saved = ad.load(machine.save(tmp_path / "again.toml"))
    assert saved.motors[0].valve == machine.motors[0].valve
    assert saved.motors[0].valve.preload == 30 * bar
    assert started(saved, machines.inner_poses(saved, 1)[0])[-1].min() == pytest.approx(30 * bar)


@pytest.mark.parametrize(
    ("relief", "preload", "words"),
    [
        (
            None,
            385.0,
            (
                r"385 bar is not allowed; give a pressure in \[5, 385\) bar, .* below 1\.1 ×"
                r" supply pressure"
            ),
        ),
        (
            170.0,
            170.0,
            r"170 bar is not allowed; give a pressure in \[5, 170\) bar, .* to below relief_bar",
        ),
        (
            170.0,
            4.0,
            r"4 bar is not allowed; give a pressure in \[5, 170\) bar, from return pressure",
        ),
        (170.0, -1.0, r"-1\.0 is not allowed; give a number in \[0, 5000\] bar"),
    ],
)
def test_preloads_that_cannot_be(
    excavator: Machine, relief: float | None, preload: float, words: str
) -> None:
    machine = excavator if relief is None else valves(excavator, ("boom",), relief_bar=relief)
    with pytest.raises(MachineFileError, match=rf"cylinder\.boom\.valve\.preload_bar: {words}"):
        valves(machine, ("boom",), preload_bar=preload)


# ----------------------------------------------------------------------------------------- reliefs


def test_a_low_relief_leaves_mode_and_sweep_alone(excavator: Machine) -> None:
    """170 bar on the boom: at rest no relief is open, so the modes on trapped oil stay, and the
    sweeps find them.
    """
    machine = valves(excavator, ("boom",), relief_bar=170.0).with_payload("empty")
    expected = ad.natural_modes(machine.at(LIGHT)).frequencies[0]
    assert expected[0] == pytest.approx(2.508, abs=5e-4)  # of the issue
    for preloaded in (None, True):
        assert linearize(machine, LIGHT, preloaded=preloaded).natural_frequencies == pytest.approx(
            expected, rel=1e-6
        )
        run = simulate(machine, LIGHT, {}, duration=1.0, preloaded=preloaded)
        assert run.events == ()
        assert np.ptp(run.extensions, axis=0).max() < 1e-9
    validation = validate(machine, LIGHT, cylinders=["boom"])
    assert {run.remark for run in validation.runs} == {"agrees"}
    assert validation.worst_deviation < 1e-3


def test_a_load_close_below_the_relief_is_swept_gently(excavator: Machine) -> None:
    """Of 188 bar under 190 bar: in a sweep from return pressure both chambers climb, and must not
    reach the relief.
    """
    machine = valves(excavator, ("boom",), relief_bar=190.0)
    assert validate(machine, WORST, cylinders=["boom"]).worst_deviation < 1e-3
    with pytest.raises(
        SimulationError,
        match=r"boom cylinder: needs 188\.1 bar to hold .* relief opens at 188\.4 bar",
    ):
        validate(valves(excavator, ("boom",), relief_bar=188.4), WORST, cylinders=["boom"])


def test_a_load_above_the_relief_is_told(excavator: Machine) -> None:
    """p1 = (F + A2 p0)/A1 by hand is above 170 bar, nothing holds that: run, linear answer, check
    and map say so.
    """
    machine = valves(excavator, ("boom",), relief_bar=170.0)
    boom, force = machine.cylinders[0], machine.at(WORST).cylinder_forces[0, 0]
    needed = (force + boom.annulus_area * 5 * bar) / boom.bore_area / bar
    assert needed > 171
    words = (
        f"the relief of boom's cap cannot hold {force / 1e3:.0f} kN: that needs {needed:.4g} bar,"
        " it opens at 170 bar"
    )
    for preloaded in (None, True, False):
        run = simulate(machine, WORST, {}, duration=0.5, preloaded=preloaded)
        assert f"{words} at 0 s" in run.events
        assert run.extensions[-1, 0] < run.extensions[0, 0] - 1e-3
    with pytest.raises(
        SimulationError, match=f"excavator_20t: rest: {words}; raise relief_bar"
    ) as caught:
        linearize(machine, WORST)
    assert "\n" not in str(caught.value)
    with pytest.raises(
        SimulationError, match=r"boom cylinder: needs 188\.1 bar .* its relief opens at 170 bar"
    ):
        validate(machine, WORST, cylinders=["boom"])
    workspace = ad.Workspace.grid(machine, 7)
    frequencies = ad.frequency_map(machine, workspace)
    share, most = frequencies.beyond_reliefs["boom"]
    beyond = frequencies.holding_pressures[:, 0] * 350 > 170
    assert share == pytest.approx(frequencies.weights[beyond].sum() / frequencies.weights.sum())
    assert "boom needs more than its relief holds: up to" in map_sheets(frequencies)[0].note
    odd = [
        finding for finding in inspect(machine, workspace).findings() if "relief" in finding.part
    ]
    assert [finding.part for finding in odd] == 2 * ["cylinder.boom.valve.relief_bar"]
    assert odd[0].words.startswith("opens at 170 bar, below the supply's 350 bar: what it lifts")
    assert (
        f"needs {most / bar:.0f} bar to stand still; its relief opens at 170 bar" in odd[1].words
    )
    assert not ad.frequency_map(excavator, workspace).beyond_reliefs


def test_a_setting_that_the_load_opens_is_told(excavator: Machine) -> None:
    """A load-holding valve set below the load: the shut spool still holds, but ``check`` says that
    it does not.
    """
    machine = holding(excavator, "boom", side="cap", setting_bar=100.0)
    odd = {
        finding.part: finding.words
        for finding in inspect(machine, ad.Workspace.grid(machine, 5)).findings()
    }
    assert (
        "more than the setting of 100 bar: the load alone opens it"
        in odd["cylinder.boom.load_holding.setting_bar"]
    )
    run = simulate(machine, WORST, {}, duration=1.0)
    assert run.events == ()
    assert np.ptp(run.extensions, axis=0).max() < 1e-9


def test_tight_seals_rest_as_if_shut_and_creep() -> None:
    """The load creeps from the pressures of a shut valve at ṡ = −C Δp (A1/V1 + A2/V2) /
    (A1²/V1 + A2²/V2): leakage alone changes both pressures so that A1 p1 − A2 p2 stays.
    """
    leak = 5e-6 * l_per_min / bar
    machine, shut = with_leakage(ad.load("paper_1dof"), leak), ad.load("paper_1dof")
    run, shut_run = (simulate(one, [0.1], {}, duration=4.0, rate=10) for one in (machine, shut))
    assert run.events == ()
    np.testing.assert_array_equal(run.pressures[0], shut_run.pressures[0])
    cylinder = machine.cylinders[0]
    areas = np.array([cylinder.bore_area, cylinder.annulus_area])
    volumes = np.ravel(cylinder.volumes(run.extensions[0, 0]))
    lost = -leak * (run.pressures[0, 0, 0] - run.pressures[0, 0, 1])
    speed = lost * (areas / volumes).sum() / (areas**2 / volumes).sum()
    crept = (run.extensions[-1, 0] - run.extensions[0, 0]) / run.time[-1]
    # the load rings a little from its start; the pressures change by 1 %
    assert crept == pytest.approx(speed, rel=0.02)
    assert 0 < abs(crept) < 1e-3 / 60  # [m/s]: below 1 mm per minute
