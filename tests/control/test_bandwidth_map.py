"""Bandwidth maps and gain schedules of shipped machines."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

import armdesign as ad
from armdesign.control.bandwidth_map import SCHEMES
from armdesign.control.loop_plant import loop_plant
from armdesign.control.loops import FINE, Loops
from armdesign.control.stability import stable
from armdesign.control.tuning import Aim, Task, proportional
from armdesign.report.bandwidths import bandwidth_sheets
from armdesign.sweeps.numbers import of_bandwidths
from armdesign.units import deg
from tests.control.machines import single_pose

MARGIN = 0.8284271


@pytest.fixture(scope="module")
def bandwidths() -> ad.BandwidthMap:
    machine = ad.load("excavator_20t")
    return ad.bandwidth_map(machine, ad.Workspace.grid(machine, points=3), damping=0.02)


@pytest.mark.slow
def test_every_pose_and_load_case_is_there(bandwidths: ad.BandwidthMap) -> None:
    """The rows of the frequency map, with its lowest frequencies."""
    frequencies = ad.frequency_map(bandwidths.machine, bandwidths.workspace).frame
    assert len(frequencies) == len(bandwidths.frame) == len(bandwidths.gains)
    for name in (*bandwidths.machine.joints, "f1_hz"):
        np.testing.assert_allclose(bandwidths.frame[name], frequencies[name])
    assert list(bandwidths.frame["payload"]) == list(frequencies["payload"])


@pytest.mark.slow
def test_margins_hold_and_pressure_feedback_pays(bandwidths: ad.BandwidthMap) -> None:
    frame = bandwidths.frame
    for scheme in SCHEMES:
        assert (frame[f"{scheme}_margin"] >= 0.99 * MARGIN).all()  # on a coarse grid
    assert (frame["damped_hz"] > 2 * frame["proportional_hz"]).all()
    assert (frame["own_hz"] >= frame["damped_hz"]).all()
    assert (frame["merritt_hz"] > frame["proportional_hz"]).all()
    assert (frame["own_critical"] > 1.5).all()
    assert (frame["own_damping"] > 0.01).all()  # none rings more than with its valves shut, halved
    np.testing.assert_allclose(frame["merritt_hz"], 0.04 * frame["f1_hz"])


@pytest.mark.slow
def test_schedule_is_stable_with_margin(bandwidths: ad.BandwidthMap) -> None:
    """gains.csv, read back as gains of the loops at its poses."""
    table = bandwidths.schedule
    schedule = ad.gain_schedule(bandwidths, "full")
    rows = table[table["payload"] == "full"]
    q = rows[list(bandwidths.machine.joints)].to_numpy()
    controller = schedule(q)
    machine = bandwidths.machine.with_payload("full")
    plant = loop_plant(machine, machine.at(q), 0.02)
    assert stable(plant, controller).all()
    assert (Loops.of(plant, FINE).figures(controller).margin >= 0.99 * MARGIN).all()
    for place, joint in enumerate(machine.joints):
        np.testing.assert_allclose(controller.position[:, place], rows[f"{joint}_gain_per_s"])


@pytest.mark.slow
def test_schedule_between_poses_and_beyond(bandwidths: ad.BandwidthMap) -> None:
    schedule = ad.gain_schedule(bandwidths)
    low, high = schedule.gains.min(axis=0), schedule.gains.max(axis=0)
    inside = schedule(bandwidths.machine.ranges.mean(axis=1))
    assert (inside.position[0] >= low[:3]).all()
    assert (inside.position[0] <= high[:3]).all()
    beyond = schedule(bandwidths.machine.ranges[:, 1] + 1.0)
    assert np.isfinite(beyond.position).all()
    with pytest.raises(ad.ArmDesignError, match="did you mean"):
        ad.gain_schedule(bandwidths, "ful")
    with pytest.raises(ad.ArmDesignError, match="shape"):
        schedule([0.0])


@pytest.mark.slow
def test_interpolation_of_one_joint_is_linear() -> None:
    machine = ad.load("patu_boom")
    schedule = ad.gain_schedule(ad.bandwidth_map(machine, ad.Workspace.grid(machine, points=5)))
    order = schedule.poses[:, 0].argsort()
    pair, gains = schedule.poses[order[:2], 0], schedule.gains[order[:2], 0]
    assert schedule([pair.mean()]).position[0, 0] == pytest.approx(gains.mean())


@pytest.mark.slow
@pytest.mark.parametrize("name", ["loader_crane", "mini_excavator_2t", "patu_boom"])
def test_machines_with_their_own_damping(name: str) -> None:
    """A slide, a four-bar, one joint: some gains at every pose."""
    machine = ad.load(name)
    bandwidths = ad.bandwidth_map(machine, ad.Workspace.grid(machine, points=3))
    works = bandwidths.frame[bandwidths.frame["works"]]
    assert (works["own_hz"] > 0).all()
    assert np.isfinite(works.select_dtypes("number").to_numpy()).all()
    np.testing.assert_allclose(3 * works["rule_hz"], works["f1_hz"])  # with leakage, too


@pytest.mark.slow
def test_no_bandwidth_rests_on_no_damping() -> None:
    machine = ad.load("paper_1dof")
    with pytest.raises(ad.ArmDesignError, match="no bandwidth can rest on that") as caught:
        ad.bandwidth_map(machine)
    assert "--damping 0.02 (in Python and studies damping = 0.02" in str(caught.value)
    assert (ad.bandwidth_map(machine, damping=0.02).frame["own_hz"] > 0).all()


def test_a_supply_that_cannot_lift() -> None:
    machine = ad.load("excavator_20t").replace({"supply.pressure_bar": 20})
    workspace = ad.Workspace.grid(machine, points=2)
    with pytest.raises(ad.ArmDesignError, match="at no pose"):
        ad.bandwidth_map(machine, workspace, damping=0.02)


def test_a_load_case_that_cannot_be_lifted_is_said() -> None:
    """Its bandwidths are missing, so that the worst of the others is no answer for it."""
    machine = ad.load("excavator_20t").replace({"payload.full.mass_kg": 60000})
    workspace = ad.Workspace.grid(machine, points=2)
    bandwidths = ad.bandwidth_map(machine, workspace, damping=0.02)
    full = bandwidths.frame["payload"] == "full"
    assert not bandwidths.frame.loc[full, "works"].any()
    assert bandwidths.frame.loc[~full, "works"].all()
    notes = " ".join(sheet.note for sheet in bandwidth_sheets({"": bandwidths}))
    assert f"; {full.sum()} of {len(full)} poses left out: " in notes
    assert "; all of payload full" in notes
    assert of_bandwidths(bandwidths)["workable_share"] == pytest.approx((~full).mean())


def test_valves_slower_than_the_mode_are_said() -> None:
    machine = ad.load("patu_boom").replace({"cylinder.lift.valve.natural_frequency_hz": 1.0})
    bandwidths = ad.bandwidth_map(machine, ad.Workspace.grid(machine, points=5))
    assert bandwidths.slow_valves["lift"] > 0.5


def test_a_missing_valve_is_said() -> None:
    machine = ad.load("patu_boom")
    text = machine.text
    begin, end = text.index("[cylinder.lift.valve]"), text.index("[cylinder.lift.friction]")
    bare = ad.Machine.from_text(text[:begin] + text[end:], machine.urdf_text, machine.source)
    with pytest.raises(ad.ArmDesignError, match="cylinder lift has no valve"):
        ad.bandwidth_map(bare, damping=0.02)


@pytest.mark.parametrize(
    ("name", "asked", "option"),
    [
        ("paper_1dof", {"gain_margin_db": 120.0}, "--gain-margin"),
        ("paper_1dof", {"phase_margin": 89.9999 * deg}, "--phase-margin"),
        ("excavator_20t", {"gain_margin_db": 1e5}, "--gain-margin"),
    ],
)
def test_a_margin_that_no_gains_keep_is_said_with_the_largest_that_some_keep(
    name: str, asked: dict[str, float], option: str
) -> None:
    """What is told can be asked for, and half as far from the limit of disk margins, 2, cannot."""
    machine = ad.load(name)
    workspace = ad.Workspace.grid(machine, points=2)
    with pytest.raises(ad.ArmDesignError, match=f"no gains keep .* as {option} ") as caught:
        ad.bandwidth_map(machine, workspace, damping=0.02, **asked)
    (key,) = asked
    told = float(re.search(rf"{key}=([\d.]+)", str(caught.value))[1])
    again = ad.bandwidth_map(machine, workspace, damping=0.02, **{key: told})
    assert 0 < again.frame["own_hz"].max() < 1e-3
    closer = {"gain_margin_db": told + 6, "phase_margin": (told + math.pi / 2) / 2}
    with pytest.raises(ad.ArmDesignError, match="no gains keep"):
        ad.bandwidth_map(machine, workspace, damping=0.02, **{key: closer[key]})


@pytest.mark.parametrize(
    ("wrong", "part"),
    [({"filter": "low-pass"}, "filter"), ({"corner": -1.0}, "corner"), ({"delay": -1}, "delay")],
)
def test_options_that_cannot_be(wrong: dict, part: str) -> None:
    with pytest.raises(ad.ArmDesignError, match=part):
        ad.bandwidth_map(ad.load("patu_boom"), **wrong)


@pytest.mark.slow
def test_picture_has_one_scale(bandwidths: ad.BandwidthMap) -> None:
    from armdesign import plots

    figure = plots.bandwidth_maps(bandwidths)
    meshes = [
        mesh for ax in figure.axes for mesh in ax.collections if mesh.get_array() is not None
    ]
    limits = {mesh.get_clim() for mesh in meshes[:3]}
    assert len(limits) == 1
    bars = [bar for ax in figure.axes for bar in ax.child_axes]
    assert any("Hz" in bar.get_ylabel() for bar in bars)


def test_a_mode_that_is_hardly_damped_bounds_the_gains() -> None:
    """Its resonance falls between the frequencies of a grid, which seems to keep the margin at
    gains beyond its band of instability: gains below that band do work.

    The second mode of the crane has ζ = 1e-4 here. Margins of position loops alone on a fine grid
    with that resonance: 1.3 at κ = 2e-4, 0.6 at 6e-4. So slow a loop is the lag K/(K + s) with
    K = κ ω_1: its bandwidth is κ f_1, below all frequencies of the grid.
    """
    machine, q = ad.load("loader_crane").with_payload("full"), (0.96205013, -2.53347753, 0.031)
    workspace = single_pose(machine, q)
    bandwidths = ad.bandwidth_map(machine, workspace)
    row = bandwidths.frame.query("payload == 'full'").iloc[0]
    modes = ad.linearize(machine, q)
    slowest = (modes.natural_frequencies * modes.damping_ratios).argmin()
    assert slowest == 1
    assert row["bounding_hz"] == pytest.approx(modes.natural_frequencies[1], rel=1e-6)
    assert row["bounding_damping"] == pytest.approx(modes.damping_ratios[1], rel=1e-6)
    assert 2e-4 < row["proportional_hz"] / row["f1_hz"] < 6e-4
    assert row["proportional_hz"] <= row["damped_hz"] <= row["own_hz"]
    for scheme in ("proportional", "damped", "own"):
        assert MARGIN <= row[f"{scheme}_margin"] < 1.3
    sheet = str(bandwidth_sheets({"": bandwidths})[1])
    assert "what bounds position loops at their worst pose is the mode at 7.24 Hz" in sheet


def test_gains_below_a_band_of_instability_are_found_with_a_delay() -> None:
    """Beyond the band half a second of delay makes stable loops, too, whose margin is too small.

    Margins of position loops alone on a fine grid with the resonances: 1.19 at κ = 2.66e-4, 0.61
    at 6.28e-4, 0.14 at 1.48e-3, 0.46 at 0.03.
    """
    machine, q = ad.load("loader_crane").with_payload("full"), (0.96205013, -2.53347753, 0.031)
    plant = loop_plant(machine, machine.at([q]), None, 0.5)
    tuned = proportional(Task(plant, Loops.of(plant), Aim(margin=MARGIN)))
    assert 2.66e-4 < (tuned.controller.position / plant.omega).min() < 6.28e-4
    assert tuned.figures.margin[0] > MARGIN


def test_slow_valves_of_each_machine_are_said() -> None:
    """Of the new one, too: today's has none."""
    maps = {}
    for label, hertz in (("today", 100.0), ("new", 1.0)):
        changes = {"cylinder.lift.valve.natural_frequency_hz": hertz}
        machine = ad.load("patu_boom").replace(changes)
        maps[label] = ad.bandwidth_map(machine, ad.Workspace.grid(machine, points=3))
    assert "cannot damp well: new lift (100 % of the poses)" in str(bandwidth_sheets(maps)[0])
    alone = str(bandwidth_sheets({"": maps["new"]})[0])
    assert "cannot damp well: lift (100 % of the poses)" in alone
    assert "slower" not in str(bandwidth_sheets({"": maps["today"]})[0])


def test_a_scheme_that_there_is_not() -> None:
    machine = ad.load("paper_1dof")
    bandwidths = ad.bandwidth_map(machine, ad.Workspace.grid(machine, points=2), damping=0.02)
    with pytest.raises(ad.ArmDesignError, match='scheme: "dampd" is none; did you mean "damped"'):
        bandwidths.plot(scheme="dampd")
