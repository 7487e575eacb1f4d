"""Linear models against closed formulas of stiffness and damping, and against python-control."""

from __future__ import annotations

import math
import re
import sys

import numpy as np
import pytest

import armdesign as ad
from armdesign import Machine, identify_ringdown
from armdesign.errors import SimulationError
from armdesign.hydraulics.friction import Friction
from armdesign.report.maps import map_sheets
from armdesign.simulation.linearization import linearize
from armdesign.simulation.plant.equilibrium import find_equilibrium
from armdesign.simulation.plant.plant import Plant
from armdesign.simulation.simulate import simulate
from armdesign.units import bar, l_per_min
from tests import machines
from tests.simulation import valves as helpers
from tests.simulation.valves import WORST


@pytest.mark.slow
def test_natural_frequencies_are_those_of_the_modes(machine: Machine) -> None:
    """K v = ω² M v with trapped oil (closed form) = poles of the differentiated nonlinear model,
    undamped.
    """
    machine = helpers.with_valves(machine.replace({"damped": False}))
    for pose in machines.inner_poses(machine, 3):
        poses = machine.at(pose)
        model = linearize(machine, pose)
        np.testing.assert_allclose(
            model.natural_frequencies, ad.natural_modes(poses).frequencies[0], rtol=1e-6
        )
        np.testing.assert_allclose(model.damping_ratios, 0, atol=1e-6)


def test_leakage_damps_as_merritt_says() -> None:
    """Symmetric cylinder at mid-stroke: ζ = (C_L/A) √(β M/V_t), M = J/r² (Merritt 1967, ch. 6).

    The rod is thinned to 1 mm. Left over: gravity's stiffness (5e-4 of the oil's), A1 − A2 and
    order ζ².
    """
    leakage = 0.002 * l_per_min / bar
    machine = helpers.with_leakage(
        ad.load("paper_1dof").replace({"cylinder.lift.rod_mm": 1.0}), leakage
    )
    poses, cylinder = machine.at([0.0]), machine.cylinders[0]
    mass = poses.mass_matrix[0, 0, 0] / poses.moment_arms[0, 0, 0] ** 2
    volume = sum(cylinder.volumes(poses.lengths[0, 0] - cylinder.closed_length))
    expected = leakage / cylinder.bore_area * math.sqrt(machine.fluid.bulk_modulus * mass / volume)
    model = linearize(machine, [0.0], preloaded=False)
    assert expected > 0.001
    assert model.damping_ratios == pytest.approx([expected], rel=3e-3)


def test_viscous_friction_damps_as_a_dashpot() -> None:
    """One mass: ζ = b/(2 M ω), b of both parallel cylinders."""
    b = 2e4
    machine = ad.load("paper_1dof").replace({"cylinder.lift.count": 2})
    machine = helpers.with_friction(machine, Friction(viscous=b))
    poses = machine.at([0.1])
    mass = poses.mass_matrix[0, 0, 0] / poses.moment_arms[0, 0, 0] ** 2
    omega = 2 * math.pi * ad.natural_modes(poses).frequencies[0, 0]
    model = linearize(machine, [0.1])
    assert model.damping_ratios == pytest.approx([2 * b / (2 * mass * omega)], rel=1e-9)


def test_dry_friction_is_left_out(excavator: Machine) -> None:
    dry = helpers.with_friction(excavator, Friction(coulomb=3000, static=4000))
    np.testing.assert_allclose(linearize(dry, WORST).A, linearize(excavator, WORST).A, atol=1e-12)


def test_shapes_names_and_spool(excavator: Machine) -> None:
    model = linearize(excavator, WORST)
    assert model.A.shape == (18, 18)
    assert (model.B.shape, model.C.shape, model.D.shape) == ((18, 6), (24, 18), (24, 6))
    assert model.inputs[:3] == ("boom", "stick", "bucket")
    assert model.inputs[3:] == ("tool force x", "tool force y", "tool force z")
    assert (model.outputs[0], model.outputs[-1]) == ("boom piston position", "tool acceleration z")
    assert (model.states[0], model.states[6], model.states[-1]) == (
        "boom position",
        "boom cap pressure",
        "bucket spool speed",
    )
    omega = 2 * math.pi * 10.0  # the spools' natural frequency in the file
    np.testing.assert_allclose(model.B[-3:, :3], omega**2 * np.eye(3), rtol=1e-9)
    np.testing.assert_allclose(model.C[:3, :3], excavator.at(WORST).moment_arms[0], atol=1e-9)
    assert np.sum(np.isclose(np.abs(model.poles), omega)) == 6
    with pytest.raises(ValueError, match="read-only"):
        model.A[0, 0] = 1.0


def test_python_control_sees_the_same_plant(excavator: Machine) -> None:
    """Poles but for rounding, and the response at 3 rad/s by C (jω − A)⁻¹ B in SI."""
    pytest.importorskip("control")
    linear = linearize(excavator, WORST)
    system = linear.to_control()
    assert system.state_labels == list(linear.states)
    assert system.input_labels == list(linear.inputs)
    assert system.output_labels == list(linear.outputs)
    theirs = system.poles()
    for pole in linear.modes:
        assert np.abs(theirs - pole).min() < 1e-6 * abs(pole)
    response = linear.C @ np.linalg.solve(3j * np.eye(len(linear.A)) - linear.A, linear.B)
    response = response + linear.D
    pressures = [name.endswith("pressure") for name in linear.outputs]
    response[pressures] /= bar
    for theirs, ours in zip(system(3j), response, strict=True):
        np.testing.assert_allclose(theirs, ours, rtol=1e-6, atol=1e-9 * np.abs(ours).max())


def test_frequency_responses_are_those_of_python_control_and_drawn(excavator: Machine) -> None:
    pytest.importorskip("control")
    linear = linearize(excavator, WORST)
    own, lines = linear.select("commands", "piston speeds"), np.geomspace(0.3, 30, 7)
    expected = np.array([own.to_control()(2j * math.pi * f) for f in lines])
    scale = np.abs(expected).max()
    np.testing.assert_allclose(own.frequency_response(lines), expected, atol=1e-9 * scale)
    size, phase = linear.plot().axes
    f, drawn = size.lines[0].get_data()
    at = own.frequency_response(f)[:, 0, 0]
    np.testing.assert_allclose(drawn * np.exp(1j * np.radians(phase.lines[0].get_ydata())), at)
    with pytest.raises(SimulationError, match="no input"):
        linear.select("tool force").plot()


def test_modes_of_several_poses_are_drawn(excavator: Machine) -> None:
    models = ad.linear_models(excavator, [WORST, excavator.ranges.mean(axis=1)])
    points = [line.get_xydata() for line in models.plot().lines]
    for pose in range(2):
        one = models[pose]
        pairs = np.stack([one.natural_frequencies, one.damping_ratios], axis=1)
        np.testing.assert_array_equal([line[pose] for line in points], pairs)


def test_without_python_control_the_remedy_is_named(
    excavator: Machine, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(
        SimulationError,
        match=r"needs the package python-control; pip install 'armdesign\[control\]'",
    ):
        linearize(excavator, WORST).to_control()


@pytest.mark.parametrize("leak", ["leakage_l_per_min_per_bar", "overlap_percent"])
def test_a_map_says_where_leaking_valves_set_other_pressures(leak: str) -> None:
    """Oil with air behind valves that leak: the frequency that the map tells beside its own is
    the frequency of a free decay.
    """
    size = -1.0 if leak == "overlap_percent" else 1e-4
    machine = ad.load("paper_1dof").replace(
        {"fluid.entrained_air_percent": 1.0, f"cylinder.lift.valve.{leak}": size}
    )
    frequencies = ad.frequency_map(machine, ad.Workspace.grid(machine, 5))
    note = map_sheets(frequencies)[0].note
    assert "underlap (lift) changes it" in note
    stated = float(re.search(r"then has ([\d.]+) Hz", note)[1])  # type: ignore[index]
    plant = Plant(machine)
    trim = plant.split(find_equilibrium(plant, frequencies.worst.q).state)[4].tolist()
    run = simulate(
        machine, frequencies.worst.q, lambda _: trim, velocity=[1e-4], duration=1.0, rate=400
    )
    assert stated == pytest.approx(
        identify_ringdown(run.time, run.velocity).natural_frequencies[0], rel=2e-3
    )
    assert stated > 1.5 * frequencies.worst.frequency


@pytest.mark.parametrize(
    "changes",
    [
        {"fluid.entrained_air_percent": 1.0},  # tight
        {"cylinder.lift.valve.overlap_percent": -1.0},  # the same stiffness under all pressures
        # no spool position makes up for what both chambers lose: it creeps, from the pressures of
        # the map
        {
            "fluid.entrained_air_percent": 1.0,
            "cylinder.lift.valve.tank_leakage_l_per_min_per_bar": 1e-4,
        },
    ],
)
def test_a_map_says_so_only_there(changes: dict[str, float]) -> None:
    machine = ad.load("paper_1dof").replace(changes)
    assert map_sheets(ad.frequency_map(machine, ad.Workspace.grid(machine, 5)))[0].note == ""


@pytest.mark.parametrize("payload", ["empty", "full"])
@pytest.mark.parametrize(
    "name", ["excavator_20t", "excavator_12t", "mini_excavator_2t", "loader_crane", "patu_boom"]
)
def test_shipped_machines_settle_as_measured_ones_do(name: str, payload: str) -> None:
    """Issue 13: ζ of the lowest mode between 0.01 and 0.05 in the middle of the joint ranges.

    Measured: 0.02 on a loader crane, 0.02 to 0.07 on an excavator. Independently ζ = Σ b (R v)² /
    (2 ω vᵀM v), by viscous friction alone; the leakage's part is below 1e-4.
    """
    machine = ad.load(name).with_payload(payload)
    pose = machine.ranges.mean(axis=1)
    model, poses = linearize(machine, pose), machine.at(pose)
    assert 0.01 < model.damping_ratios[0] < 0.05
    modes = ad.natural_modes(poses)
    shape, omega = modes.shapes[0, :, 0], 2 * math.pi * modes.frequencies[0, 0]
    viscous = [c.count * c.friction.viscous for c in machine.cylinders]
    speeds = poses.moment_arms[0] @ shape
    expected = viscous @ speeds**2 / (2 * omega * (shape @ poses.mass_matrix[0] @ shape))
    assert model.damping_ratios[0] == pytest.approx(expected, abs=1e-4)
    tight = linearize(helpers.with_leakage(machine, 0.0), pose)
    by_leakage = model.damping_ratios[0] - tight.damping_ratios[0]
    assert 0 <= by_leakage < 1e-4
    leaks = any(c.valve is not None and c.valve.leakage > 0 for c in machine.cylinders)
    assert (by_leakage > 0) == leaks


def test_undamped_by_one_key(excavator: Machine) -> None:
    """Friction and leakage of cylinders and motors; the paper's machine has none to leave out."""
    lossy = excavator.replace(
        {
            "joints": ["swing", "boom", "stick", "bucket"],
            "cylinder.boom.friction.viscous_N_s_per_m": 5e4,
            "cylinder.boom.valve.leakage_l_per_min_per_bar": 1e-5,
            "motor.swing.friction.viscous_N_m_s_per_rad": 3e3,
            "motor.swing.valve.leakage_l_per_min_per_bar": 1e-5,
        }
    )
    bare = lossy.replace({"damped": False})
    for machine, has in ((lossy, True), (bare, False)):
        for actuator in (machine.cylinders[0], machine.motors[0]):
            valve = actuator.valve
            assert valve is not None
            assert (actuator.friction.viscous > 0) == has
            assert (valve.leakage > 0) == has
    assert bare.cylinders[0].friction == Friction()
    pose = (0.0, *WORST)
    assert linearize(lossy, pose).damping_ratios.max() > 1e-3
    assert linearize(bare, pose).damping_ratios.max() == 0
    assert linearize(ad.load("paper_1dof"), [0.0]).damping_ratios == [0.0]
