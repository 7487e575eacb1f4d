"""What is measured in the nonlinear model against the linear answer."""

from __future__ import annotations

from dataclasses import replace

import helpers
import machines
import numpy as np
import pytest

import armdesign as ad
from armdesign import Machine
from armdesign.errors import PoseError, SimulationError
from armdesign.linearization import linearize, without_dry_friction
from armdesign.machine import shipped
from armdesign.modes import energy_shares, natural_modes
from armdesign.simulation.validation import Validation, validate
from armdesign.units import bar, l_per_min
from armdesign.valve import Friction

WORST = (1.154, -1.199, -2.191)
COLUMNS = [
    "payload",
    "boom",
    "stick",
    "bucket",
    "cylinder",
    "mode",
    "linear_hz",
    "identified_hz",
    "deviation",
    "linear_damping",
    "identified_damping",
    "amplitude",
]


@pytest.fixture(scope="module")
def worst() -> Validation:
    return validate(ad.load("excavator_20t").with_payload("full"), WORST)


def test_worst_pose_agrees(worst: Validation) -> None:
    """The aim is 0.3 %; reached 0.02 %. Damping: the linear plant has none, the open valve a little."""
    frame = worst.frame
    assert list(frame.columns[: len(COLUMNS)]) == COLUMNS
    assert list(frame["cylinder"]) == ["boom", "boom", "bucket", "bucket", "stick", "stick"]
    assert list(frame["mode"]) == [1, 1, 2, 2, 3, 3]
    assert frame["deviation"].abs().max() < 1e-3
    assert (frame["linear_damping"] == 0).all()
    full, half = frame[::2].reset_index(), frame[1::2].reset_index()
    assert (half["amplitude"] == full["amplitude"] / 2).all()
    assert ((half["identified_damping"] > 0) & (half["identified_damping"] < full["identified_damping"])).all()
    assert full["identified_damping"].max() < 0.01
    assert set(frame["remark"]) == {"agrees"}
    assert (frame["identified_hz_sigma"] < 1e-3 * frame["identified_hz"]).all()


def test_frame_shows_the_poses_visited(worst: Validation) -> None:
    frame = worst.frame
    for index, joint in enumerate(worst.joints):
        assert list(frame[f"{joint}_mean"]) == [run.mean[index] for run in worst.runs]
        assert list(frame[f"{joint}_span"]) == [run.span[index] for run in worst.runs]


def test_measured_at_the_pose_asked_for(worst: Validation) -> None:
    """The slow loop holds the mean pose to a small part of the swing, which itself is small and real."""
    for run in worst.runs:
        assert 5e-4 < run.span.max() < 0.1
        assert np.abs(run.mean - WORST).max() < 0.05 * run.span.max()


def test_response_is_kept_and_fitted(worst: Validation) -> None:
    fit = worst.runs[0].fit
    assert len(fit.frequency) == len(fit.response) == len(fit.fitted) > 10
    np.testing.assert_allclose(fit.response, fit.fitted, atol=0.05 * np.abs(fit.fitted).max())


def test_picks_poses_over_payloads_and_moves_every_cylinder() -> None:
    """Worst, median and best by the map of the same workspace: the one place, half and all of its sorted column."""
    machine = ad.load("mini_excavator_2t")
    workspace = ad.Workspace.grid(machine, 9)
    validation = validate(machine, workspace=workspace)
    found = ad.frequency_map(machine, workspace)
    lowest = np.sort(found.frame["f1_hz"])
    firsts = [validation.by_pose[name].runs[0] for name in ("worst", "median", "best")]
    assert [run.mode for run in firsts] == [1, 1, 1]
    expected = [found.worst.frequency, lowest[len(lowest) // 2], lowest[-1]]
    assert [run.linear_frequency for run in firsts] == pytest.approx(expected, rel=1e-9)
    assert firsts[0].cylinder == found.worst.cylinder
    for one in validation.by_pose.values():
        assert {run.cylinder for run in one.runs} == {"boom", "stick", "bucket"}
        assert len(one.runs) == 6
    assert validation.worst_deviation < 5e-3
    empty = validate(machine, workspace=workspace, payloads=["empty"], cylinders=["boom"])
    assert {run.payload for run in empty.runs} == {"empty"}
    assert empty.runs[0].linear_frequency == pytest.approx(found.worst_of["empty"].frequency, rel=1e-9)


@pytest.mark.parametrize("name", shipped())
def test_small_sweeps_find_the_damped_frequency_of_every_shipped_machine(name: str) -> None:
    """Issue: within 0.5 % of the linear plant's damped frequency, every cylinder, at the worst pose.

    Dry friction is left out: a motion small enough to be linear would never break loose.
    """
    machine = without_dry_friction(ad.load(name))
    worst = ad.frequency_map(machine, ad.Workspace.grid(machine, 9)).worst
    machine = machine.with_payload(worst.payload)
    poles = linearize(machine, worst.q).modes
    for run in validate(machine, worst.q).runs[1::2]:
        damped = poles.imag[np.argmin(np.abs(np.abs(poles) / (2 * np.pi) - run.linear_frequency))] / (2 * np.pi)
        found = run.identified_frequency * np.sqrt(1 - run.identified_damping**2)
        assert found == pytest.approx(damped, rel=5e-3)


def test_deviation_vanishes_with_amplitude() -> None:
    """From a sweep that swings the pressures hard to one a hundred times smaller."""
    machine = ad.load("excavator_20t").with_payload("full")
    runs = [run for size in (3e-3, 3e-5) for run in validate(machine, WORST, amplitude=size, cylinders=["boom"]).runs]
    deviations = [abs(run.deviation) for run in runs]
    assert deviations[0] > 2e-3
    assert deviations[0] > deviations[1] > deviations[2]
    assert max(deviations[2:]) < 2e-4
    assert runs[0].remark == "agrees" or runs[0].remark == "amplitude"


def test_paper_machine() -> None:
    run = validate(ad.load("paper_1dof"), [0.0]).runs[0]
    assert run.linear_frequency == pytest.approx(10.7676, abs=1e-4)  # THEORY §5, eigenvalue of the exact formula
    assert abs(run.deviation) < 1e-3


def test_damping_is_identified() -> None:
    """Leakage and viscous friction: half the sweep's amplitude brings the fit to the linear plant's ζ."""
    machine = helpers.with_leakage(ad.load("paper_1dof"), 0.003 * l_per_min / bar)
    machine = helpers.with_friction(machine, Friction(viscous=2e4))
    validation = validate(machine, [0.0], amplitude=4e-4)
    for run in validation.runs:
        assert run.linear_damping > 0.01
        assert run.identified_damping == pytest.approx(run.linear_damping, rel=0.03)
        assert abs(run.deviation) < 3e-3


def test_air() -> None:
    """β(p) of each chamber at its static pressure, as in the linear answer; the sweep is small enough for it."""
    machine = ad.load("excavator_20t").with_payload("full").replace({"fluid.entrained_air_percent": 1.0})
    full, half = validate(machine, WORST, cylinders=["boom"]).runs
    assert full.linear_frequency < 0.7
    assert abs(half.deviation) < abs(full.deviation) < 0.01


@pytest.mark.parametrize("name", ["random_29", "branched", "random_35"])
def test_odd_machines(name: str) -> None:
    """Soft small cylinders whose geometry changes fast; cylinders seen from behind, across a telescope; one joint."""
    machine = helpers.with_valves(machines.named(name).with_payload("load"))
    assert validate(machine, machines.inner_poses(machine, 1)[0]).worst_deviation < 3e-3


def test_overlap_is_leapt() -> None:
    machine = ad.load("paper_1dof").replace({"cylinder.lift.valve.overlap_percent": 5.0})
    assert validate(machine, [0.0]).worst_deviation < 5e-3


def test_cylinders_by_name_sweep_their_own_mode(excavator: Machine) -> None:
    """Bucket and stick each over the mode of which they hold most; the shares of a mode add up to 1."""
    poses = excavator.at(WORST)
    shares = energy_shares(poses, natural_modes(poses))[0]
    np.testing.assert_allclose(shares.sum(axis=1), 1)
    validation = validate(excavator, WORST, cylinders=["bucket"])
    assert validation.runs[0].mode == 1 + np.argmax(shares[:, 2]) == 2
    assert validation.worst_deviation < 5e-3


def test_poses_and_payloads_make_rows() -> None:
    validation = validate(ad.load("paper_1dof"), [[0.0], [0.2]], payloads=["load"])
    assert list(validation.frame["boom"]) == [0.0, 0.0, 0.2, 0.2]
    assert list(validation.frame["payload"]) == ["load"] * 4


def test_dry_friction_is_blamed() -> None:
    """A sweep that hardly breaks loose does not show the mode; the remark says why."""
    machine = helpers.with_friction(ad.load("paper_1dof"), Friction(coulomb=3000, static=3000))
    validation = validate(machine, [0.0], amplitude=0.002)
    assert {run.remark for run in validation.runs} == {"friction"}


def test_linear_model_sees_the_same_modes(worst: Validation, excavator: Machine) -> None:
    assert worst.runs[0].linear_frequency == pytest.approx(linearize(excavator, WORST).natural_frequencies[0], rel=1e-9)


def test_faults(excavator: Machine) -> None:
    with pytest.raises(SimulationError, match="choose from: boom, stick, bucket"):
        validate(excavator, WORST, cylinders=["arm"])
    with pytest.raises(SimulationError, match="amplitude"):
        validate(excavator, WORST, amplitude=2.0)
    with pytest.raises(PoseError):
        validate(excavator, (3.0, 0.0, 0.0))
    with pytest.raises(SimulationError, match=r"boom cylinder: needs \d+ bar to hold the load, supply is 350 bar"):
        validate(excavator.with_payload(6000.0), WORST)
    edge = excavator.ranges[0, 1]
    with pytest.raises(SimulationError, match=r"boom cylinder: is .* mm from its end stop"):
        validate(excavator.with_payload("empty"), (edge, *WORST[1:]))
    bare = replace(excavator, cylinders=tuple(replace(c, valve=None) for c in excavator.cylinders))
    with pytest.raises(SimulationError, match=r"cylinder\.boom\.valve: missing"):
        validate(bare, WORST)
