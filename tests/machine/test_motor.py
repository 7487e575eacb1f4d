"""Hydraulic motors: a joint that turns without end on trapped oil.

More in the tests of all machines, among them "slewing" and "rotator".
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import armdesign as ad
from armdesign.design.requirements.performance import performances
from armdesign.frequency.modes import natural_modes
from armdesign.inspection.inspection import inspect
from armdesign.simulation.linearization import linearize
from armdesign.units import cm3, deg, litre
from tests import machines

SLEWING = ["swing", "boom", "stick", "bucket"]


@pytest.fixture(scope="module")
def slewing(excavator: ad.Machine) -> ad.Machine:
    return excavator.replace({"joints": SLEWING})


def test_the_slewing_frequency_by_hand(slewing: ad.Machine) -> None:
    """f = √(β D² (1/Va + 1/Vb) / J)/2π, D = 129 cm³ · 140/2π: the arm's plane keeps slewing apart
    from all else.
    """
    poses = slewing.at([0.3, 0.2, -1.2, -0.5])
    oil = 129 * cm3 * 140 / (2 * math.pi)
    stiffness = 1.2e9 * oil**2 * (1 / (0.8 * litre) + 1 / (0.8 * litre))
    expected = math.sqrt(stiffness / poses.mass_matrix[0, 0, 0]) / (2 * math.pi)
    assert_allclose(ad.natural_modes(poses).locked_frequencies[0, 3], expected, rtol=1e-12)
    assert_allclose(poses.oil_stiffness[0, 3], stiffness, rtol=1e-12)


@pytest.mark.slow
def test_the_swing_of_the_20_t_machine_is_damped() -> None:
    """Anchors of issue 13: damping ratios between 0.01 and 0.05 at mid reach."""
    machine = ad.load("excavator_20t").replace({"joints": SLEWING})
    q = machine.ranges.mean(axis=1)
    for case in machine.payloads:
        linear = linearize(machine.with_payload(case.name), q)
        swing = natural_modes(machine.with_payload(case.name).at(q)).locked_frequencies[0, 3]
        mode = np.argmin(np.abs(linear.natural_frequencies - swing))
        assert linear.natural_frequencies[mode] == pytest.approx(swing, rel=1e-3)
        assert 0.01 < linear.damping_ratios[mode] < 0.05


def test_a_motor_drives_its_joint_alone(slewing: ad.Machine) -> None:
    """No spring on the joint, whether the motor is at work or idle."""
    table = '\n[spring.slew]\njoint = "swing"\nstiffness_N_m_per_rad = 1e7\n'
    for machine in (slewing, ad.load("excavator_20t")):
        text = machine.text.replace("swing = 0.0", "") + table
        with pytest.raises(ad.ArmDesignError, match="swing") as caught:
            ad.Machine.from_text(text, machine.urdf_text, machine.source)
        assert "spring.slew.joint" in caught.value.part


def test_slewing_leaves_the_planar_modes_alone(slewing: ad.Machine, excavator: ad.Machine) -> None:
    """With everything in the arm's plane M has no terms between slewing and the rest (mirror
    symmetry).
    """
    q = machines.inner_poses(slewing, 6)
    planar = ad.natural_modes(excavator.at(q[:, 1:])).frequencies
    modes = ad.natural_modes(slewing.at(q))
    both = np.sort(np.concatenate([planar, modes.locked_frequencies[:, 3:]], axis=1), axis=1)
    assert_allclose(modes.frequencies, both, rtol=1e-9)
    assert np.all(np.isinf(modes.rigid_frequencies[:, 3])), "no static torque about the vertical"


def test_a_load_beside_the_plane_couples_slewing() -> None:
    aside = machines.named("slewing").with_payload("full")
    poses = aside.at(machines.inner_poses(aside, 4))
    assert np.abs(poses.mass_matrix[:, 0, 1:]).max() > 100
    modes = ad.natural_modes(poses)
    assert np.all(modes.frequencies[:, 0] < modes.locked_frequencies.min(axis=1))


@pytest.mark.slow
def test_maps_do_not_depend_on_slewing(slewing: ad.Machine, excavator: ad.Machine) -> None:
    """The worst pose of the planar machine stays the worst, and reach is measured along the arm
    wherever it points.
    """
    planar = ad.frequency_map(excavator, ad.Workspace.grid(excavator, points=8))
    frequencies = ad.frequency_map(slewing, ad.Workspace.grid(slewing, points=[2, 8, 8, 8]))
    assert_allclose(frequencies.worst.frequency, planar.worst.frequency, rtol=1e-6)
    assert frequencies.worst.cylinder == "boom"
    assert set(frequencies.limiting) >= {"boom", "swing"}
    reach, other = frequencies.reach_map(20), planar.reach_map(20)
    assert_allclose(reach.reach, other.reach, atol=1e-9)
    columns = set(frequencies.frame.columns)
    assert {"swing", "swing_torque_n_m", "locked_swing_hz", "rigid_swing_hz"} <= columns
    assert "swing_extension" not in columns


def test_a_motor_has_no_end_stop(slewing: ad.Machine) -> None:
    q = np.array([[50.0, 0.2, -1.2, -0.5]])
    assert np.isinf(slewing.margins(q)[0, 3])
    assert_allclose(slewing.at(q).lengths[0, 3], 50.0)


def test_a_frozen_joints_motor_is_idle(excavator: ad.Machine) -> None:
    assert excavator.motors == ()
    assert excavator.section.motor["swing"].gear_ratio == 140


def test_the_shipped_motor_meets_the_data_sheet(slewing: ad.Machine) -> None:
    """Cat 320: 74 kN m at 268 bar, 11.30 rpm with one pump's 214.5 l/min; ideal motor, so up to 6
    % above both.
    """
    motor = slewing.motors[0]
    torque, speed = motor.bore_area * (268 - 5) * 1e5, 214.5 * litre / 60 / motor.bore_area
    assert 1.0 <= torque / 74e3 <= 1.06
    assert 1.0 <= speed / (11.30 * 2 * math.pi / 60) <= 1.06


def test_a_relief_below_the_supply_limits_the_torque(slewing: ad.Machine) -> None:
    """200 bar · 129 cm³ · 140/2π both ways, and a line of ``check`` that says so."""
    relieved = slewing.replace({"motor.swing.valve.relief_bar": 200.0})
    torque = performances(relieved)[3].largest
    assert_allclose(torque, 200e5 * 129 * cm3 * 140 / (2 * math.pi), rtol=1e-12)
    found = inspect(relieved, ad.Workspace.grid(relieved, 3)).findings()
    (words,) = (f.words for f in found if f.part == "motor.swing.valve.relief_bar")
    assert words.startswith("opens at 200 bar, below the supply's 350 bar: ")


@pytest.mark.slow
def test_the_nonlinear_simulation_slews_at_the_linear_frequency(slewing: ad.Machine) -> None:
    validation = ad.validate(slewing, [0.3, 0.2, -1.2, -0.5], cylinders=["swing"])
    assert validation.runs[0].cylinder == "swing"
    assert validation.worst_deviation < 1e-3


def test_full_valve_turns_at_the_speed_of_its_flow(slewing: ad.Machine) -> None:
    """Steady slewing: Q = D q̇, and half of supply less return drops over each edge (equal ports,
    no load, no friction).

    With rated flow Q_r at Δp_r, Q = Q_r √((p_s − p_r)/2/Δp_r): by hand 2.9 rad/s at a tenth of the
    valve.
    """
    slewing = slewing.replace({"damped": False})
    run = ad.simulate(
        slewing, [0.0, 0.2, -1.2, -0.5], {"swing": lambda t: 0.1 * min(t / 4, 1.0)}, duration=12.0
    )
    motor = slewing.motors[0]
    flow = 0.1 * 214.5 * litre / 60 * math.sqrt((350 - 5) / 2 / 14)
    late = run.velocity[run.time > 8, 0].mean()
    assert_allclose(late, flow / motor.bore_area, rtol=0.01)


@pytest.mark.slow
def test_designs_leave_the_motor_as_it_is(slewing: ad.Machine) -> None:
    workspace = ad.Workspace.grid(slewing, points=[2, 6, 6, 8])
    any_torque = replace(ad.Requirements.of(slewing), **machines.ANY_LIFT_AND_TORQUE)
    design = ad.size_cylinders(slewing, workspace, any_torque, catalogue="free")
    assert design.machine.motors == slewing.motors
    assert design.after.worst.frequency > design.before.worst.frequency
    assert "holding.swing" in design.slacks
    assert min(design.slacks.values()) >= -1e-9


FAULTS = [
    (
        {"motor.swing.gear_ratio": 0},
        r"motor\.swing\.gear_ratio: 0 is not allowed; give a number in \(0, 1e\+06\]",
    ),
    (
        {"motor.swing.trapped_volume_l.a": 0},
        r"motor\.swing\.trapped_volume_l\.a: 0 is not allowed",
    ),
    (
        {"motor.swing.hose.a_l": 1.0},
        r"motor\.swing\.hose\.a_l: 1 l exceeds the dead volume; give a volume in \[0, 0\.8\] l",
    ),
    (
        {"motor.swing.joint": "swimg"},
        r'motor\.swing\.joint: no joint "swimg" in the URDF; did you mean "swing"\?',
    ),
    (
        {"motor.swing.friction.static_N_m": 1, "motor.swing.friction.coulomb_N_m": 2},
        "1 N m is below the Coulomb friction",
    ),
    ({"motor.swing.joint": "boom", "joints": SLEWING}, 'no cylinder or motor moves "swing"'),
]


@pytest.mark.parametrize(("changes", "message"), FAULTS)
def test_faults_are_said_with_key_and_remedy(
    excavator: ad.Machine, changes: dict[str, object], message: str
) -> None:
    with pytest.raises(ad.ArmDesignError, match=message):
        excavator.replace(changes)


def test_a_motor_cannot_push_a_slide() -> None:
    crane = machines.named("loader_crane")
    slide = next(joint.name for joint in crane.arm.joints if not joint.revolute)
    data = "displacement_cm3 = 10\ngear_ratio = 5\ntrapped_volume_l = { a = 1, b = 1 }"
    text = f"{crane.text}\n[motor.winch]\njoint = '{slide}'\n{data}\n"
    with pytest.raises(
        ad.ArmDesignError, match=f'motor.winch: "{slide}" does not turn; use a cylinder'
    ):
        ad.Machine.from_text(text, crane.urdf_text, crane.source)


def test_friction_is_that_of_the_joint() -> None:
    """Friction is given at the joint, all motors together, so two motors have no more of it than
    one.
    """
    bare = machines.named("rotator")
    text = (
        bare.text + "\n[motor.turn.friction]\ncoulomb_N_m = 300\nstribeck_velocity_deg_per_s = 2\n"
    )
    motor = ad.Machine.from_text(text, bare.urdf_text, bare.source).motors[0]
    assert_allclose(motor.count * motor.friction.coulomb, 300)
    assert_allclose(motor.friction.stribeck_velocity, 2 * deg)


def test_a_frozen_value_of_a_coordinate_is_not_used(excavator: ad.Machine) -> None:
    """So that one word in `joints` frees a joint; `check` says it."""
    free = excavator.replace({"joints": SLEWING, "frozen.swing": 0.7})
    assert_allclose(
        free.at([0.0, 0.2, -1.2, -0.5]).tool, excavator.at([0.2, -1.2, -0.5]).tool, atol=1e-9
    )
    findings = inspect(free, ad.Workspace.grid(free, points=3)).findings()
    assert [finding.words for finding in findings if finding.part == "frozen.swing"] == [
        "is not used: the joint is a coordinate"
    ]
