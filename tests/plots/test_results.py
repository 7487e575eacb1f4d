"""Results that draw themselves: what their pictures show."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import armdesign as ad
from armdesign import plots
from armdesign.drawing.colours import actuator_colours
from tests import machines
from tests.simulation.valves import with_valves


def test_a_ringdown_shows_record_fit_and_residual(tmp_path: Path) -> None:
    time = np.arange(0, 8, 0.02)
    speed = np.exp(-0.3 * time) * np.cos(2 * np.pi * time)
    decay = ad.identify_ringdown(time, speed + 0.02 * np.sin(0.3 * time))
    fig = decay.plot()
    recorded, fitted = fig.axes[0].lines
    (left,) = fig.axes[1].lines
    np.testing.assert_array_equal(recorded.get_xdata(), time)
    np.testing.assert_allclose(recorded.get_ydata() - fitted.get_ydata(), left.get_ydata())
    assert f"{decay.natural_frequencies[0]:.3f} Hz" in fig.axes[0].get_title()
    assert plots.save(fig, tmp_path / "a.svg").stat().st_size > 5_000


@pytest.mark.parametrize("name", ["paper_1dof", "crossing"])
def test_gains_are_drawn_at_their_poses(name: str) -> None:
    machine = with_valves(machines.named(name))
    bandwidths = ad.bandwidth_map(machine, ad.Workspace.grid(machine, 3), damping=0.02)
    schedule = ad.gain_schedule(bandwidths)
    fig, alone = schedule.plot(), len(machine.joints) == 1
    titles = [ax.get_title() for ax in fig.axes[: len(machine.joints)]]
    assert titles == [f"loop of {joint}" for joint in machine.joints]
    (drawn,) = fig.axes[0].lines if alone else fig.axes[0].collections
    values = drawn.get_ydata() if alone else drawn.get_array()
    np.testing.assert_array_equal(np.sort(values), np.sort(schedule.gains[:, 0]))


@pytest.mark.parametrize("name", ["paper_1dof", "crossing"])
def test_bandwidths_are_read_in_plain_decimals(name: str) -> None:
    """On their axis or colour bar, whose scale is logarithmic: no 6×10⁻¹."""
    machine = with_valves(machines.named(name))
    bandwidths = ad.bandwidth_map(machine, ad.Workspace.grid(machine, 3), damping=0.02)
    fig = plots.bandwidth_maps(bandwidths)
    fig.canvas.draw()
    alone = len(machine.joints) == 1
    scales = fig.axes if alone else [ax.child_axes[0] for ax in fig.axes]
    for ax in scales:
        assert ax.get_yscale() == "log"
        labels = [label.get_text() for label in ax.yaxis.get_ticklabels(which="both")]
        numbers = [float(label) for label in labels if label]  # 10⁻¹ in mathtext is none
        assert len(numbers) > 2


def test_a_sweep_is_drawn_over_what_changed() -> None:
    bores = [60.0, 65.0, 70.0]
    sweep = ad.sweep("paper_1dof", {"cylinder.lift.bore_mm": bores}, points=3)
    (ax,) = sweep.plot().axes
    np.testing.assert_array_equal(ax.lines[0].get_xdata(), bores)
    assert ax.get_ylabel() == "worst_hz"
    assert sweep.plot("median_hz").axes[0].get_ylabel() == "median_hz"
    with pytest.raises(ad.ArmDesignError, match='"f1" is none of the sweep; choose from'):
        sweep.plot("f1")
    with pytest.raises(ad.ArmDesignError, match="has no change that is a number"):
        ad.sweep("paper_1dof", points=3).plot()
    sets = [{"k": 1e308}, {"k": -1e308}]
    huge = ad.sweep("paper_1dof", task=lambda m, w, k: {"y": k}, options=sets, points=2)
    with pytest.raises(ad.ArmDesignError, match=r"^k: has numbers beyond 1e\+300; draw the"):
        huge.plot()


def test_modes_are_drawn_pose_by_pose(tmp_path: Path) -> None:
    machine = machines.named("excavator_20t")
    poses = machine.at(ad.Workspace.grid(machine, 2).q[:5])
    modes = ad.natural_modes(poses)
    ax = modes.plot()
    drawn = np.array([line.get_ydata() for line in ax.lines])
    np.testing.assert_array_equal(drawn[:3], modes.frequencies.T)
    np.testing.assert_array_equal(drawn[3:], modes.locked_frequencies.T)
    words = [text.get_text() for text in ax.get_legend().get_texts()]
    assert words == ["lowest coupled mode", "higher modes", "one cylinder, the others locked"]
    assert plots.save(ax.figure, tmp_path / "a.png").stat().st_size > 5_000
    ax = poses.plot()
    forces = np.array([line.get_ydata() for line in ax.lines[:3]])
    np.testing.assert_allclose(forces, poses.cylinder_forces.T / 1000)
    colours = actuator_colours(machine)
    drawn_in = [line.get_color() for line in ax.lines[:3]]
    assert drawn_in == [colours[actuator.name] for actuator in machine.actuators]
    words = [text.get_text() for text in ax.get_legend().get_texts()]
    assert words == ["boom", "stick", "bucket"]
    assert poses[1:3].machine is machine


def test_unstable_poses_have_no_dot_and_one_pose_is_enough(tmp_path: Path) -> None:
    machine = machines.named("paper_1dof")
    soft = machine.replace({"fluid.bulk_modulus_MPa": 60, "payload.load.mass_kg": 100_000})
    modes = ad.natural_modes(soft.evaluate(soft.rigid_poses(np.array([[0.5]]))))
    assert modes.frequencies[0, 0] == 0.0
    ax = modes.plot()
    assert np.isnan(ax.lines[0].get_ydata()).all()
    assert plots.save(ax.figure, tmp_path / "a.png").stat().st_size > 1_000


def test_a_band_is_drawn_corner_by_corner() -> None:
    machine = machines.named("paper_1dof")
    workspace = ad.Workspace.grid(machine, 3)
    band = ad.frequency_band(machine, workspace, ad.Bands(structure=(0, 1), payload=(0.8, 1.0)))
    ax = band.plot()
    expected = [scenario.frequency for scenario in band.scenarios]
    assert ax.lines[0].get_xdata().tolist() == expected
    names = [label.get_text() for label in ax.get_yticklabels()]
    assert names == [
        "soft end, payload × 0.8",
        "soft end",
        "stiff end, payload × 0.8",
        "stiff end",
    ]
    mixed = ad.frequency_band(machine, workspace, ad.Bands(structure=(0, 1), dead_volume=(1, 2)))
    names = [label.get_text() for label in mixed.plot().get_yticklabels()]
    assert names == ["soft end", "soft dead volume", "soft structure", "stiff end"]


def test_a_frequency_response_says_what_it_is_and_cuts_no_word() -> None:
    validation = ad.validate(machines.named("paper_1dof"), [0.1])
    fig = plots.frequency_responses({name: validation for name in ("worst", "median", "best")})
    fig.canvas.draw()
    ax, run = fig.axes[0], validation.runs[0]
    assert ax.get_title() == f"worst: lift, fitted {run.identified_frequency:.3f} Hz"
    assert ax.get_ylabel() == "speed / commanded speed [–]"
    words, whole = ax.yaxis.label.get_window_extent(), fig.bbox
    assert whole.y0 <= words.y0 < words.y1 <= whole.y1
