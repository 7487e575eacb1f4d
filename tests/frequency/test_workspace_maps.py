"""Workspaces and maps: exact edges, refinement, columns, pictures; and the answers of an
independent implementation.
"""

from __future__ import annotations

import itertools
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose

import armdesign as ad
from armdesign import arrays, plots
from armdesign.arrays import chunks, percentiles, shown
from armdesign.frequency.joint_grid import nearest
from armdesign.frequency.modes import energy_shares, lowest_frequency
from armdesign.frequency.pitch_limits import onto_pitch_limit, tipping_joints
from tests import machines
from tests.reference_planar import Reference

SHIPPED = Path(__file__).parents[2] / "robots"
SERIAL = ("paper_1dof", "excavator_20t", "four_bar_left", "crossing", "branched")
# Found by tests/reference_planar.py (grid 21 × 21 × 121, zoomed), which shares no code with the
# package.
WORST_FREQUENCY, WORST_Q = 0.910210, [1.154484, -1.057556, -2.191324]


@cache
def workspace(name: str, points: int | tuple[int, ...] = 5) -> ad.Workspace:
    return ad.Workspace.grid(machines.named(name), points)


@cache
def mapped(name: str, points: int | tuple[int, ...] = 5) -> ad.FrequencyMap:
    return ad.frequency_map(machines.named(name), workspace(name, points))


# --------------------------------------------------------------------------------------- workspace


@pytest.mark.parametrize("margin", [0.0, 0.02, 0.3])
@pytest.mark.parametrize("name", SERIAL)
def test_grid_ends_where_the_end_margin_begins(name: str, margin: float) -> None:
    """Definition of the workspace: the range that keeps the margin; its ends leave exactly that
    share of the stroke.
    """
    machine = machines.named(name)
    space = ad.Workspace.grid(machine, 3, end_margin=margin)
    assert_allclose(space.ranges, machine.range_within(margin), rtol=0, atol=0)
    assert space.end_margin == margin
    assert machine.margins(space.q).min() >= margin - 1e-9
    for linkage, column in zip(machine.linkages, range(len(machine.cylinders)), strict=True):
        if len(linkage.joints) == 1:
            joint = linkage.joints[0]
            for side in (0, 1):
                # not cut by the URDF
                if abs(space.ranges[joint, side] - machine.arm.limits[joint, side]) > 1e-6:
                    q = machine.ranges.mean(axis=1)
                    q[joint] = space.ranges[joint, side]
                    shared = [
                        k for k, other in enumerate(machine.linkages) if joint in other.joints
                    ]
                    assert machine.margins(q)[0, shared].min() == pytest.approx(
                        margin, abs=1e-9
                    ), column


def test_default_margin_is_that_of_the_requirements() -> None:
    machine = machines.named("excavator_20t").replace({"requirements.end_margin": 0.1})
    assert ad.Workspace.grid(machine, 3).end_margin == 0.1


def test_points_per_joint_and_the_default() -> None:
    """By hand: 3 · 4 · 5 grid poses, last joint fastest; the default is about 20 000 poses, the
    last joint finest.
    """
    machine = machines.named("excavator_20t")
    space = ad.Workspace.grid(machine, [3, 4, 5])
    assert [len(axis) for axis in space.axes] == [3, 4, 5]
    assert len(space) >= 60
    assert_allclose(space.q[:5, 2], space.axes[2], atol=0)
    default = ad.Workspace.grid(machine)
    counts = [len(axis) for axis in default.axes]
    assert 10_000 < np.prod(counts) < 40_000
    assert counts[2] == max(counts)
    assert not default.q.flags.writeable


def swinging(axis: float, motor: bool = False) -> ad.Machine:
    """A bracket about a vertical axis that a cylinder swings, a boom on it; below it, if asked, a
    slewing motor.
    """
    feet = (
        [machines.Joint("slew", "root", axis=(0, 0, 1), kind="continuous", com=(0, 0, 0.2))]
        if motor
        else []
    )
    foot = "slew" if motor else "root"
    bracket = machines.Joint(
        "bracket",
        foot,
        xyz=(0.6, 0, 0.4),
        axis=(0, 0, axis),
        com=(0.2, 0, 0.1),
        limits=(-0.8, 0.8),
    )
    boom = replace(machines.BOOM, parent="bracket")
    turn = machines.Function("turn", (foot, (0.0, 0.5, 0.5)), ("bracket", (0.3, 0.35, 0.2)))
    lift = machines.Function("lift", ("bracket", (0.5, 0, -0.2)), ("boom", (1.1, 0, 0.3)))
    table = (
        "[motor.slew]\njoint = 'slew'\ndisplacement_cm3 = 160\ngear_ratio = 24\ntrapped_volume_l ="
        " { a = 1, b = 1 }"
    )
    return machines.build([*feet, bracket, boom], [turn, lift], more=table if motor else "")


@pytest.mark.parametrize("axis", [1, -1])
@pytest.mark.parametrize("motor", [False, True])
def test_a_cylinder_across_a_slewing_joint_makes_its_angle_count(axis: float, motor: bool) -> None:
    """The default grid covers its whole range: no random pose lies below the worst, of either sign
    of the axis.
    """
    machine = swinging(axis, motor)
    j = machine.joints.index("bracket")
    space = ad.Workspace.grid(machine, None if not motor else [2, 15, 15])
    assert_allclose(space.ranges[j], machine.range_within(space.end_margin)[j], atol=1e-12)
    found = ad.frequency_map(machine, space)
    low, high = machine.range_within(space.end_margin).T
    q = low + np.random.default_rng(3).random((4000, len(low))) * (high - low)
    random = ad.natural_modes(machine.at(q)).frequencies[:, 0].min()
    assert found.worst.frequency <= random <= 1.02 * found.worst.frequency
    assert plots.drawn_joints(machine) == [j, j + 1]


def test_the_sign_of_a_slewing_axis_changes_no_design() -> None:
    """A mirrored coordinate is the same machine: worst pose and sizes agree."""
    designs = [
        ad.size_cylinders(one, ad.Workspace.grid(one, 7)) for one in (swinging(1), swinging(-1))
    ]
    assert designs[0].before.worst.frequency == pytest.approx(
        designs[1].before.worst.frequency, rel=1e-6
    )
    assert designs[0].after.worst.frequency == pytest.approx(
        designs[1].after.worst.frequency, rel=1e-4
    )


def test_slewing_is_idle_only_where_nothing_depends_on_it() -> None:
    """A lowest motor is; a cylinder's joint is not; nor a second motor whose axis stands beside
    the first one's.

    Of the second the inertia about the first says so: it depends on the second's angle.
    """
    assert machines.named("slewing").idle_joints == {0}
    assert swinging(1).idle_joints == frozenset()
    assert swinging(1, motor=True).idle_joints == {0}
    joints = [
        machines.Joint(name, "root" if k == 0 else "a", axis=(0, 0, 1))
        for k, name in enumerate("ab")
    ]
    table = (
        "[motor.{0}]\njoint = '{0}'\ndisplacement_cm3 = 160\ngear_ratio = 24\ntrapped_volume_l ="
        " {{ a = 1, b = 1 }}"
    )
    tables = "\n".join(table.format(name) for name in "ab")
    for offset, idle in ((0.0, {0, 1}), (0.5, {0})):
        pair = [
            joints[0],
            replace(joints[1], xyz=(offset, 0, 0.3)),
            replace(machines.BOOM, parent="b"),
        ]
        lift = machines.Function("lift", ("b", (0.5, 0, -0.2)), ("boom", (1.1, 0, 0.3)))
        machine = machines.build(pair, [lift], more=tables)
        assert machine.idle_joints == idle
        mass = machine.at([[0, 0, 0], [0, 0.3, 0]]).mass_matrix[:, 0, 0]
        assert (abs(mass[1] / mass[0] - 1) < 1e-12) == (offset == 0)


def test_poses_on_the_pitch_limits_belong_to_it(excavator: ad.Machine) -> None:
    """The load case's limits, 120° and 240°, are met exactly, and the bucket holds its load
    there.
    """
    space = workspace("excavator_20t")
    excess = excavator.pitch_excess(excavator.arm.kinematics(space.q), excavator.payload)
    on_limit = np.abs(excess) < 1e-8
    assert on_limit.sum() > 50
    assert excavator.holds(space.q[on_limit]).all()
    pitch = (
        np.rad2deg(excavator.arm.pitch(excavator.arm.kinematics(space.q[on_limit]), "bucket"))
        % 360
    )
    assert_allclose(np.minimum(abs(pitch - 120), abs(pitch - 240)), 0, atol=1e-6)
    assert (abs(pitch - 120) < 1e-6).any()
    assert (abs(pitch - 240) < 1e-6).any()


def test_each_joint_is_turned_onto_the_pitch_limit(excavator: ad.Machine) -> None:
    q = machines.inner_poses(excavator, 5)
    for joint in tipping_joints(excavator, excavator.payload):
        moved = onto_pitch_limit(excavator, excavator.payload, q, joint, np.deg2rad(120))
        assert len(moved) == 5
        others = [j for j in range(3) if j != joint]
        assert_allclose(moved[:, others], q[:, others], atol=0)
        assert_allclose(
            excavator.pitch_excess(excavator.arm.kinematics(moved), excavator.payload),
            0,
            atol=1e-9,
        )


def test_a_cylinder_across_two_joints_bounds_the_workspace() -> None:
    """Poses at which any cylinder, also one across joints, has less than its margin are no part of
    it.
    """
    machine, space = machines.named("crossing"), workspace("crossing", 9)
    assert len(space) <= 81
    assert machine.margins(space.q).min() >= space.end_margin - 1e-9


@pytest.mark.parametrize("name", ["paper_1dof", "excavator_20t", "crossing", "spatial"])
def test_sobol_poses_fill_the_ranges_and_lie_on_their_edges(name: str) -> None:
    """Equal seeds, equal poses; all keep the margin; every end of every joint and the pitch limits
    are met exactly.
    """
    machine = machines.named(name)
    space = ad.Workspace.sobol(machine, 600, seed=4)
    assert_allclose(space.q, ad.Workspace.sobol(machine, 600, seed=4).q, atol=0)
    assert not np.array_equal(space.q[:50], ad.Workspace.sobol(machine, 600, seed=5).q[:50])
    assert machine.margins(space.q).min() >= space.end_margin - 1e-9
    low, high = machine.range_within(space.end_margin).T
    assert np.all((space.q >= low) & (space.q <= high))
    if all(len(linkage.joints) == 1 for linkage in machine.linkages):
        assert len(space) >= 600
        assert np.all((space.q == low).any(axis=0) & (space.q == high).any(axis=0))
        middle = (space.q[:600] - low) / (high - low)
        # chance alone would leave 0.29/√600 = 0.012
        assert_allclose(middle.mean(axis=0), 0.5, atol=0.01)
    for payload in machine.payloads:
        if payload.pitch is not None:
            excess = machine.pitch_excess(machine.arm.kinematics(space.q), payload)
            assert (np.abs(excess) < 1e-8).sum() > 50


def test_sobol_and_grid_find_the_same_worst_pose() -> None:
    machine = machines.named("excavator_20t")
    worst = ad.frequency_map(machine, ad.Workspace.sobol(machine, 1000)).worst
    assert worst.frequency == pytest.approx(WORST_FREQUENCY, abs=1e-6)


@pytest.mark.parametrize("name", ["excavator_20t", "loader_crane", "crossing", "spatial"])
def test_poses_of_the_reach_plane_bring_the_tool_to_the_cells(name: str) -> None:
    """The tool is on a cell's middle to a micrometre; where joints are left over, in several
    ways.
    """
    machine = machines.named(name)
    space = ad.Workspace.reach_plane(machine, 12, 7 if len(machine.joints) > 2 else 20)
    assert machine.margins(space.q).min() >= space.end_margin - 1e-9
    tool = machine.at(space.q).tool
    place = np.stack(
        [np.copysign(np.hypot(tool[:, 0], tool[:, 1]), tool[:, 0]), tool[:, 2]], axis=1
    )
    assert space.cells is not None
    cell = np.stack(
        [np.abs(place[:, [i]] - space.cells[i]).argmin(axis=1) for i in (0, 1)], axis=1
    )
    assert_allclose(
        place, np.stack([space.cells[i][cell[:, i]] for i in (0, 1)], axis=1), atol=1e-6
    )
    ways = np.unique(cell, axis=0, return_counts=True)[1]
    if len(machine.joints) > 2:
        assert np.median(ways) >= 3
    found = ad.frequency_map(machine, space).reach_map()
    assert np.isfinite(found.frequency).sum() == len(ways)


@pytest.mark.parametrize("count", [0, -1, 2.5, "9", True, None, 10**7])
def test_sobol_counts_that_cannot_be(count: object, excavator: ad.Machine) -> None:
    with pytest.raises(
        ad.ArmDesignError,
        match=r"count: .* is not allowed; give a whole number from 1 to 5,000,000",
    ):
        ad.Workspace.sobol(excavator, count)  # type: ignore[arg-type]
    with pytest.raises(ad.ArmDesignError, match=r"cells: .*" if count != 10**7 else r"points"):
        ad.Workspace.reach_plane(excavator, 9 if count == 10**7 else count, points=1)  # type: ignore[arg-type]


def test_one_joint_reaches_no_plane() -> None:
    with pytest.raises(
        ad.ArmDesignError, match="no pose brings the tool to a cell's middle; take a grid for one"
    ):
        ad.Workspace.reach_plane(machines.named("paper_1dof"))


def test_a_slide_begins_at_zero() -> None:
    """The extension's length is its closed length plus q: rod in is q = 0, not the number next to
    it.
    """
    assert machines.named("loader_crane").ranges[2, 0] == 0.0


def test_a_seed_is_a_whole_number(excavator: ad.Machine) -> None:
    with pytest.raises(ad.ArmDesignError, match="seed: -1 is not allowed"):
        ad.Workspace.sobol(excavator, 10, seed=-1)


# --------------------------------------------------------------------------------------------- map


@pytest.mark.parametrize("name", ["paper_1dof", "excavator_20t", "crossing"])
def test_columns_are_those_of_the_csv_file(name: str) -> None:
    """DESIGN, map.csv: joints, payload, tool, coupled, locked, rigid, forces, extensions, in this
    order.
    """
    machine, frame = machines.named(name), mapped(name).frame
    cylinders = [cylinder.name for cylinder in machine.cylinders]
    assert list(frame.columns) == [
        *machine.joints,
        "payload",
        *("tool_x_m", "tool_y_m", "tool_z_m"),
        *(f"f{i + 1}_hz" for i in range(len(machine.joints))),
        *(f"locked_{c}_hz" for c in cylinders),
        *(f"rigid_{c}_hz" for c in cylinders),
        *(f"{c}_force_n" for c in cylinders),
        *(f"{c}_extension" for c in cylinders),
    ]
    assert not frame.drop(columns="payload").isna().any().any()


def test_rows_say_what_the_machine_says_at_their_pose() -> None:
    frame = mapped("excavator_20t").frame
    for row in (0, len(frame) // 2, len(frame) - 1):
        values = frame.iloc[row]
        machine = machines.named("excavator_20t").with_payload(values["payload"])
        poses = machine.at(values[list(machine.joints)].to_numpy(dtype=float))
        modes = ad.natural_modes(poses)
        assert_allclose(
            values[["f1_hz", "f2_hz", "f3_hz"]].to_numpy(float), modes.frequencies[0], rtol=1e-12
        )
        assert_allclose(values["locked_boom_hz"], modes.locked_frequencies[0, 0], rtol=1e-12)
        assert_allclose(values["rigid_boom_hz"], modes.rigid_frequencies[0, 0], rtol=1e-12)
        assert_allclose(values["stick_force_n"], poses.cylinder_forces[0, 1], rtol=1e-12)
        assert_allclose(
            values[["tool_x_m", "tool_y_m", "tool_z_m"]].to_numpy(float), poses.tool[0], atol=1e-12
        )
        length = (
            machine.cylinders[0].closed_length
            + values["boom_extension"] * machine.cylinders[0].stroke
        )
        assert_allclose(length, poses.lengths[0, 0], rtol=1e-12)


def test_a_load_case_exists_only_where_it_is_held() -> None:
    frame, machine = mapped("excavator_20t").frame, machines.named("excavator_20t")
    full = frame[frame["payload"] == "full"]
    assert 0 < len(full) < (frame["payload"] == "empty").sum()
    assert machine.with_payload("full").holds(full[list(machine.joints)].to_numpy()).all()


@pytest.mark.parametrize("name", [*SERIAL, "redundant", "spatial"])
def test_worst_pose_is_below_the_grid_and_inside(name: str) -> None:
    """Refinement only lowers the minimum, never leaves the workspace, and its numbers belong to
    its pose.
    """
    found, machine = mapped(name, 4), machines.named(name)
    worst = found.worst
    assert worst.frequency <= found.frame["f1_hz"].min() + 1e-12
    loaded = machine.with_payload(worst.payload)
    low, high = found.workspace.ranges.T
    assert np.all((worst.q >= low) & (worst.q <= high))
    assert loaded.margins(worst.q).min() >= found.workspace.end_margin - 1e-9
    assert loaded.holds(worst.q).all()
    poses = loaded.at(worst.q)
    assert_allclose(worst.frequency, ad.natural_modes(poses).frequencies[0, 0], rtol=1e-12)
    assert_allclose(worst.tool, poses.tool[0], atol=1e-12)
    assert worst.cylinder in {cylinder.name for cylinder in machine.cylinders}
    assert worst.joints == machine.joints


@pytest.mark.parametrize("name", ["paper_1dof", "excavator_20t", "crossing"])
def test_grid_minimum_never_rises_when_the_grid_is_refined(name: str) -> None:
    """STYLE, known answer 7: grids of 3, 5, 9 values contain each other; the worst pose hardly
    moves.
    """
    minima = [mapped(name, points).frame["f1_hz"].min() for points in (3, 5, 9)]
    assert minima[0] >= minima[1] - 1e-12
    assert minima[1] >= minima[2] - 1e-12
    assert mapped(name, 9).worst.frequency == pytest.approx(
        mapped(name, 5).worst.frequency, rel=1e-3
    )


@pytest.mark.parametrize("name", ["excavator_20t", "redundant"])
def test_the_limiting_cylinder_is_the_one_whose_stiffening_helps_most(name: str) -> None:
    """Rayleigh: f² rises with k_i in proportion to cylinder i's share of the mode's spring
    energy.
    """
    found, machine = mapped(name, 4), machines.named(name)
    assert len(found.limiting) == len(found.frame)
    worst = found.worst
    poses = machine.with_payload(worst.payload).at(worst.q)
    gains = []
    for i in range(len(machine.cylinders)):
        extra = (
            1e-4
            * poses.oil_stiffness[0, i]
            * np.outer(poses.moment_arms[0, i], poses.moment_arms[0, i])
        )
        shape = ad.natural_modes(poses).shapes[0, :, 0]
        gains.append(shape @ extra @ shape)
    assert machine.cylinders[int(np.argmax(gains))].name == worst.cylinder


def test_a_machine_without_a_pose_for_any_load_case_says_so() -> None:
    machine = machines.named("excavator_20t").replace(
        {
            "payload.full.link": "chassis",
            "payload.empty.link": "chassis",
            "payload.empty.pitch_deg": [100, 110],
        }
    )
    with pytest.raises(ad.ArmDesignError, match=r"excavator_20t\.toml: payload.*pitch_deg"):
        ad.frequency_map(machine, ad.Workspace.grid(machine, 3))


@pytest.mark.parametrize("name", ["excavator_20t", "crossing"])
def test_chunks_leave_no_trace(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A map made 97 poses at a time, nothing kept, is the map."""
    found, machine = mapped(name), machines.named(name)
    monkeypatch.setattr("armdesign.arrays.CHUNK", 97)
    monkeypatch.setattr("armdesign.frequency.workspace.KEPT", 0)
    again = ad.frequency_map(machine, ad.Workspace.grid(machine, 5))
    pd.testing.assert_frame_equal(again.frame, found.frame, rtol=1e-12)
    assert np.array_equal(again.limiting, found.limiting)
    modes = ad.natural_modes(machine.at(found.workspace.q))
    assert modes.frequencies.shape == (len(found.workspace), len(machine.joints))


@pytest.mark.parametrize("terminal", [True, False])
def test_a_progress_bar_shows_on_a_terminal_only(
    terminal: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("armdesign.arrays.PATIENCE", -1.0)
    monkeypatch.setattr("sys.stderr.isatty", lambda: terminal)
    arrays.terminal.cache_clear()  # another test's console has looked at another stderr
    assert list(shown(chunks(40_000), 40_000, "poses")) == list(chunks(40_000))
    written = capsys.readouterr()
    assert written.out == ""
    assert ("poses" in written.err) == terminal


@pytest.mark.parametrize("name", ["excavator_20t", "redundant"])
def test_percentiles_and_shares_weigh_the_rows(name: str) -> None:
    """By hand, from the frame: a pose counts as its joint box, half a step at each end; those
    added count nothing.

    Half of the weight lies on either side of the median, to the box of one pose.
    """
    found = mapped(name, 4)
    q, weights = found.frame[list(found.machine.joints)].to_numpy(), np.ones(len(found.frame))
    for axis, values in zip(found.workspace.axes, q.T, strict=True):
        off = np.abs(values[:, None] - axis).min(axis=1)
        weights *= np.where(
            off > 1e-9, 0, np.where((values == axis[0]) | (values == axis[-1]), 0.5, 1)
        )
    assert_allclose(found.weights, weights, atol=0)
    table = found.percentiles([0, 50, 100])
    assert list(table.index) == [*(payload.name for payload in found.machine.payloads), "all"]
    assert table.loc["all", "0 %"] == found.frame["f1_hz"].min()
    assert table.loc["all", "100 %"] == found.frame["f1_hz"].max()
    for payload, rows in found.frame.groupby("payload"):
        below = weights[rows.index][rows["f1_hz"] <= table.loc[payload, "50 %"]].sum()
        assert below == pytest.approx(weights[rows.index].sum() / 2, abs=1)
        assert found.worst_of[payload].frequency <= rows["f1_hz"].min() + 1e-12
        assert found.worst_of[payload].payload == payload
    assert found.worst.frequency == min(worst.frequency for worst in found.worst_of.values())
    shares = found.limiting_shares
    assert shares.sum() == pytest.approx(1)
    for c in found.machine.cylinders:
        assert shares[c.name] == pytest.approx(
            weights[found.limiting == c.name].sum() / weights.sum(), abs=1e-12
        )


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("excavator_20t", "grid"),
        ("excavator_20t", "sobol"),
        ("excavator_20t", "reach_plane"),
        ("loader_crane", "grid"),
    ],
)
def test_percentiles_and_shares_are_those_of_random_poses(name: str, kind: str) -> None:
    """Brute force: poses at random, even over the joint ranges, know no edges. 1.5 % is their own
    scatter.
    """
    machine = machines.named(name)
    space = getattr(ad.Workspace, kind)(machine, *([6000] if kind == "sobol" else []))
    found = ad.frequency_map(machine, space)
    low, high = machine.range_within(space.end_margin).T
    q = low + np.random.default_rng(8).random((12_000, len(low))) * (high - low)
    # a cell at the rim loses what misses its middle
    limits, margin = [], 0.04 if kind == "reach_plane" else 0.015
    for payload in machine.payloads:
        case = machine.with_payload(payload.name)
        poses = case.at(q[case.holds(q)])
        modes = ad.natural_modes(poses)
        percents = np.percentile(modes.frequencies[:, 0], [5, 25, 50, 75, 95])
        assert_allclose(
            found.percentiles([5, 25, 50, 75, 95]).loc[payload.name], percents, rtol=margin
        )
        limits.append(energy_shares(poses, modes)[:, 0].argmax(axis=1))
    shares = np.bincount(np.concatenate(limits), minlength=3) / sum(map(len, limits))
    assert_allclose(found.limiting_shares, shares, atol=margin)


def test_weighted_percentiles() -> None:
    """Equal weights: numpy's.

    Whole weights: as if each value stood there so often, but for where it lies between.
    """
    values, weights = (
        np.random.default_rng(0).normal(size=200),
        np.random.default_rng(1).integers(0, 4, 200),
    )
    percents = [0, 1, 20, 50, 99, 100]
    assert_allclose(
        percentiles(values, np.full(200, 0.3), percents),
        np.percentile(values, percents),
        rtol=1e-12,
    )
    repeated = np.percentile(np.repeat(values, weights), [20, 50, 80])
    assert_allclose(percentiles(values, weights, [20, 50, 80]), repeated, atol=0.03)
    assert_allclose(percentiles(values, weights, [0, 100]), [values.min(), values.max()], atol=0)
    assert_allclose(
        percentiles(values, np.zeros(200), percents), np.percentile(values, percents), rtol=1e-12
    )
    assert_allclose(
        percentiles(np.array([1.0, np.inf, np.inf]), np.ones(3), [0, 50, 75]), [1, np.inf, np.inf]
    )


def test_a_load_case_that_is_all_edge_counts_its_rows() -> None:
    """A pitch range of hardly any width: the case exists at poses turned onto it alone."""
    machine = machines.named("excavator_20t").replace({"payload.full.pitch_deg": [179.99, 180.01]})
    found = ad.frequency_map(machine, ad.Workspace.grid(machine, 4))
    lowest = found.frame["f1_hz"][found.frame["payload"] == "full"]
    assert_allclose(
        found.percentiles([5, 50]).loc["full"], np.percentile(lowest, [5, 50]), rtol=1e-12
    )


def test_the_default_workspace_is_the_default_grid() -> None:
    machine = machines.named("patu_boom")
    found = ad.frequency_map(machine)
    assert_allclose(found.workspace.q, ad.Workspace.grid(machine).q, atol=0)


@pytest.mark.parametrize("name", ["paper_1dof", "excavator_20t", "redundant"])
def test_formula_ratios_obey_interlacing(name: str) -> None:
    """Locked over coupled is never below one; with one joint and one cylinder it is one.

    Rigid: from the frame.
    """
    found = mapped(name, 4)
    table = found.formula_ratios
    assert table.loc[(slice(None), "locked"), "least"].min() >= 1 - 1e-9
    if len(found.machine.joints) == 1:
        assert_allclose(table.loc[(slice(None), "locked"), :], 1, rtol=1e-9)
    for cylinder in found.machine.cylinders:
        ratio = (found.frame[f"rigid_{cylinder.name}_hz"] / found.frame["f1_hz"]).to_numpy()
        expected = percentiles(ratio, found.weights, [0, 50, 100])
        assert_allclose(table.loc[(cylinder.name, "rigid")], expected, rtol=1e-12)
        assert_allclose(expected[[0, 2]], [ratio.min(), ratio.max()], rtol=0)


@pytest.mark.parametrize("name", ["excavator_20t", "spatial"])
def test_stiffness_bookkeeping_adds_up(name: str) -> None:
    """The parts sum to ω² of the lowest mode; oil alone, from the shares, is the Rayleigh quotient
    of K_h.
    """
    found = mapped(name, 4)
    omega = 2 * np.pi * found.frame["f1_hz"].to_numpy()
    assert_allclose(found.stiffness_parts.sum(axis=1), omega**2, rtol=1e-9)
    shares = found.stiffness_shares
    assert list(shares.columns) == ["hydraulic", "gravity", "geometric"]
    assert_allclose(shares.sum(axis=1), 1, rtol=1e-12)
    row = len(found.frame) // 3
    machine = found.machine.with_payload(found.frame["payload"].iloc[row])
    poses = machine.at(found.frame[list(machine.joints)].iloc[row].to_numpy())
    shape = ad.natural_modes(poses).shapes[0, :, 0]
    assert shares["hydraulic"].iloc[row] == pytest.approx(
        shape @ poses.hydraulic_stiffness[0] @ shape / omega[row] ** 2, rel=1e-9
    )


def test_holding_pressures_balance_the_forces() -> None:
    """F = A1 p1 − A2 p2 with the unloaded chamber at the return pressure (definition)."""
    found = mapped("excavator_20t")
    supply, cylinder = found.machine.supply, found.machine.cylinders[1]
    force = found.frame["stick_force_n"].to_numpy()
    pressure = found.holding_pressures[:, 1] * supply.pressure
    pushing = cylinder.bore_area * pressure - cylinder.annulus_area * supply.return_pressure
    pulling = cylinder.bore_area * supply.return_pressure - cylinder.annulus_area * pressure
    least = (cylinder.bore_area - cylinder.annulus_area) * supply.return_pressure
    assert (force > least).any()
    assert (force < least).any()
    assert_allclose(np.where(force > least, pushing, pulling), force, rtol=1e-9, atol=1e-6)


# ------------------------------------------------------------------- an independent implementation


@pytest.mark.parametrize("name", ["excavator_20t", "paper_1dof"])
def test_frequencies_agree_with_an_independent_implementation(name: str) -> None:
    """tests/reference_planar.py: complex steps and differences of energies in the plane; its own
    error is near 1e-9.
    """
    reference = Reference.load(SHIPPED / name / f"{name}.toml")
    machine = machines.named(name)
    q = machines.inner_poses(machine, 12, seed=5)
    for payload in machine.payloads:
        ours = ad.natural_modes(machine.with_payload(payload.name).at(q)).frequencies
        assert_allclose(ours, reference.frequencies(q, payload.name), rtol=1e-6)


def test_ranges_agree_with_an_independent_implementation() -> None:
    reference = Reference.load(SHIPPED / "excavator_20t" / "excavator_20t.toml")
    assert_allclose(
        machines.named("excavator_20t").range_within(0.02), reference.ranges_with(0.02), atol=1e-8
    )


@pytest.mark.parametrize("points", [(5, 5, 7), (9, 9, 15)])
def test_worst_pose_agrees_with_an_independent_search(points: tuple[int, ...]) -> None:
    worst = mapped("excavator_20t", points).worst
    assert worst.frequency == pytest.approx(WORST_FREQUENCY, abs=1e-6)
    assert_allclose(worst.q, WORST_Q, atol=2e-5)
    assert worst.payload == "full"
    assert worst.cylinder == "boom"


# ---------------------------------------------------------------------------------------- pictures


@pytest.mark.parametrize("name", ["excavator_20t", "crossing", "branched"])
def test_least_of_the_joint_picture_is_least_of_the_map(name: str) -> None:
    found = mapped(name)
    x, y, values = plots.joint_plane(found)
    assert values.shape == (len(x), len(y))
    assert np.nanmin(values) == found.frame["f1_hz"].min()


@pytest.mark.parametrize("name", ["excavator_20t", "paper_1dof", "crossing"])
def test_least_of_the_reach_picture_is_least_of_the_map(name: str) -> None:
    """Cells between grid poses are interpolated, which cannot go below the least grid value."""
    found = mapped(name)
    reach = found.reach_map()
    assert reach.frequency.shape == (len(reach.reach), len(reach.height))
    assert np.nanmin(reach.frequency) == pytest.approx(found.frame["f1_hz"].min(), rel=1e-12)


@pytest.mark.parametrize("name", ["excavator_20t", "loader_crane", "branched"])
def test_no_pose_lies_below_its_cell_of_the_reach_picture(name: str) -> None:
    """Brute force: random poses, a third on faces of the joint box and a third turned onto pitch
    limits.

    Every cell that one of them brings the tool to has a value, and none of them is more than 2 %
    below it.
    """
    machine = machines.named(name)
    found = ad.frequency_map(machine)
    reach, low, high = found.reach_map(), *found.workspace.ranges.T
    rng = np.random.default_rng(6)
    inside = low + rng.random((3000, len(low))) * (high - low)
    faces, which = inside.copy(), rng.integers(0, len(low), 3000)
    faces[np.arange(3000), which] = np.where(rng.random(3000) < 0.5, low[which], high[which])
    for payload in machine.payloads:
        q = [inside, faces]
        for limit in payload.pitch or ():
            turned = onto_pitch_limit(
                machine, payload, inside, tipping_joints(machine, payload)[-1], limit
            )
            q.append(turned[np.all((turned >= low) & (turned <= high), axis=1)])
        case, poses = machine.with_payload(payload.name), np.concatenate(q)
        poses = case.at(
            poses[
                case.holds(poses) & (case.margins(poses).min(axis=1) >= found.workspace.end_margin)
            ]
        )
        place = np.stack([machine.arm.reach(poses.q, poses.tool), poses.tool[:, 2]])
        cell = tuple(
            nearest(axis, at) for axis, at in zip((reach.reach, reach.height), place, strict=True)
        )
        assert np.nanmin(lowest_frequency(poses) / reach.frequency[cell]) > 1 / 1.02
        assert np.isfinite(reach.frequency[cell]).mean() > 0.9999


def test_no_pose_on_a_joint_end_and_a_pitch_limit_lies_below_its_cell() -> None:
    """Brute force along these curves, which cut but a corner off some cells: two were up to 48 %
    too high.
    """
    machine = machines.named("excavator_20t")
    found = ad.frequency_map(machine)
    reach, ranges = found.reach_map(), found.workspace.ranges
    case, q = machine.with_payload("full"), []
    for joint, end, limit in itertools.product((0, 1), (0, 1), case.payload.pitch):
        along = np.linspace(*ranges.T, 8000)
        along[:, joint] = ranges[joint, end]
        turned = onto_pitch_limit(
            machine, case.payload, along, tipping_joints(machine, case.payload)[-1], limit
        )
        q.append(turned[np.all((turned >= ranges[:, 0]) & (turned <= ranges[:, 1]), axis=1)])
    q = np.concatenate(q)
    poses = case.at(q[case.holds(q) & (case.margins(q).min(axis=1) >= found.workspace.end_margin)])
    assert len(poses) > 10_000
    at = machine.arm.reach(poses.q, poses.tool), poses.tool[:, 2]
    cell = nearest(reach.reach, at[0]), nearest(reach.height, at[1])
    assert np.min(lowest_frequency(poses) / reach.frequency[cell]) > 1 / 1.02


def test_values_of_the_reach_picture_are_frequencies_of_poses() -> None:
    """The other side: dense random poses of single cells come within 2 % of their value from
    above.
    """
    machine = machines.named("excavator_20t")
    found = ad.frequency_map(machine)
    reach, low, high = found.reach_map(), *found.workspace.ranges.T
    size, rng = reach.reach[1] - reach.reach[0], np.random.default_rng(2)
    q = low + rng.random((20_000, 3)) * (high - low)
    place = np.stack([machine.arm.reach(q, tool := machine.at(q).tool), tool[:, 2]], axis=1)
    for spot in ((6.33, -3.66), (4.0, 1.0), (8.5, 2.0)):
        i, k = (
            int(np.abs(axis - at).argmin())
            for axis, at in zip((reach.reach, reach.height), spot, strict=True)
        )
        middle = np.array([reach.reach[i], reach.height[k]])
        # and around them, until they fill the cell
        near = q[np.abs(place - middle).max(axis=1) < size]
        near = np.clip(near + rng.normal(0, 0.02, (500, *near.shape)), low, high).reshape(-1, 3)[
            :10_000
        ]
        lowest = [np.inf]
        for payload in machine.payloads:
            case = machine.with_payload(payload.name)
            poses = case.at(near[case.holds(near)])
            there = np.stack([machine.arm.reach(poses.q, poses.tool), poses.tool[:, 2]], axis=1)
            lowest += lowest_frequency(poses)[
                np.abs(there - middle).max(axis=1) <= size / 2
            ].tolist()
        assert reach.frequency[i, k] == pytest.approx(min(lowest), rel=0.02), spot


def test_the_reach_plane_holds_the_worst_way_to_each_cell() -> None:
    """Brute force of the family of poses that bring the tool to a cell's middle: stick and boom of
    every bucket angle.

    The links from boom foot to stick foot to tool are a triangle of known sides, solved by hand,
    elbow up or down.
    """
    machine = machines.named("excavator_20t")
    space = ad.Workspace.reach_plane(machine, 12, 9)
    found = ad.frequency_map(machine, space).reach_map()
    low, high = machine.range_within(space.end_margin).T
    q = np.column_stack([np.zeros((1201, 2)), np.linspace(low[2], high[2], 1201)])
    still = machine.arm.kinematics(q)
    foot, elbow = (still.translation[0, j, [0, 2]] for j in (0, 1))
    tool = machine.arm.point(still, machine.tool.link, np.array(machine.tool.at))[:, [0, 2]]
    upper, lower = np.linalg.norm(elbow - foot), np.linalg.norm(tool - elbow, axis=1)
    # of the stick against the boom at 0
    bent = np.arctan2(*(tool - elbow).T[::-1]) - np.arctan2(*(elbow - foot)[::-1])
    cells = np.argwhere(np.isfinite(found.frequency))
    for i, k in cells[:: len(cells) // 12]:
        to = np.array([found.reach[i], found.height[k]]) - foot
        cosine = (to @ to - upper**2 - lower**2) / (2 * upper * lower)
        poses = []
        for side in (1, -1):
            inner = side * np.arccos(np.where(abs(cosine) <= 1, cosine, np.nan))
            boom = np.arctan2(to[1], to[0]) - np.arctan2(
                lower * np.sin(inner), upper + lower * np.cos(inner)
            )
            turned = np.column_stack(
                [boom - np.arctan2(*(elbow - foot)[::-1]), inner - bent, q[:, 2]]
            )
            middle = (low + high)[:2] / 2
            turned[:, :2] = (turned[:, :2] - middle + np.pi) % (2 * np.pi) - np.pi + middle
            poses.append(turned[np.all((turned >= low - 1e-9) & (turned <= high + 1e-9), axis=1)])
        poses, lowest = np.concatenate(poses), np.inf
        for payload in machine.payloads:
            case = machine.with_payload(payload.name)
            held = poses[case.holds(poses)]
            lowest = min(lowest, lowest_frequency(case.at(held)).min()) if len(held) else lowest
        assert found.frequency[i, k] == pytest.approx(lowest, rel=0.02)


def test_places_out_of_reach_are_blank() -> None:
    """The corners of a picture around an arm's reach lie outside its annulus; joint pairs that
    cannot be, too.
    """
    values = mapped("excavator_20t").reach_map().frequency
    assert np.isnan(values[-1, -1])
    assert np.isfinite(values).sum() > 0.3 * values.size
    machine = machines.named("crossing")
    stroke = machine.section.cylinder["long"].stroke_mm
    # the one across both joints now stops them
    machine = machine.replace({"cylinder.long.stroke_mm": 0.58 * stroke})
    found = ad.frequency_map(machine, ad.Workspace.grid(machine, 9))
    _, _, cells = plots.joint_plane(found)
    assert np.isnan(cells).any()
    assert np.isfinite(cells).sum() == len(found.frame)


@pytest.mark.parametrize("plane", ["joints", "reach"])
@pytest.mark.parametrize("name", ["excavator_20t", "paper_1dof", "crossing", "spatial"])
def test_pictures_draw(name: str, plane: str, tmp_path: Path) -> None:
    """Without a display and without a warning (warnings are errors)."""
    fig, (ax,) = plots.figure()
    assert mapped(name, 3).plot(ax, plane=plane) is ax
    assert plots.save(fig, tmp_path / "a.png").stat().st_size > 5_000


@pytest.mark.parametrize("plane", ["joints", "reach"])
def test_maps_side_by_side_have_one_scale(plane: str, tmp_path: Path) -> None:
    pair = {"one": mapped("excavator_20t", 3), "other": mapped("crossing", 3)}
    fig = plots.side_by_side(pair, plane)
    scales = {mesh.get_clim() for ax in fig.axes for mesh in ax.collections[:1]}
    least = min(found.frame["f1_hz"].min() for found in pair.values())
    meshes = [scale for scale in scales if scale[0] == pytest.approx(least, rel=1e-12)]
    assert len(meshes) == 1
    assert plots.save(fig, tmp_path / "a.png").stat().st_size > 5_000


def test_curves_of_moment_arms_take_any_machines(tmp_path: Path) -> None:
    """Cylinders are matched by name; the curve is the moment arm over the machine's own range."""
    machine = machines.named("excavator_20t")
    fig = plots.moment_arm_curves({"20 t": machine, "12 t": machines.named("excavator_12t")})
    line = fig.axes[0].lines[0]
    poses = machine.at(np.array([[machine.ranges[0, 0], *machine.ranges.mean(axis=1)[1:]]]))
    assert line.get_xdata()[0] == pytest.approx(np.rad2deg(machine.ranges[0, 0]))
    assert line.get_ydata()[0] == pytest.approx(1000 * abs(poses.moment_arms[0, 0, 0]))
    assert [len(ax.lines) for ax in fig.axes] == [2, 2, 2]
    assert plots.save(fig, tmp_path / "a.png").stat().st_size > 5_000


def test_curves_of_a_cylinder_across_two_joints() -> None:
    """One picture for each joint it spans, the other joint in the middle of its range."""
    machine = machines.named("crossing")  # lift about the boom, long about both
    fig = plots.moment_arm_curves({"odd": machine})
    titles = [ax.get_title() for ax in fig.axes]
    assert titles == ["lift cylinder", "long cylinder about stick", "long cylinder about boom"]
    q = machine.ranges.mean(axis=1)
    q[1] = machine.ranges[1, 1]
    arm = machine.evaluate(machine.arm.kinematics(q[None])).moment_arms[0, 1, 1]
    assert fig.axes[2].lines[0].get_ydata()[-1] == pytest.approx(1000 * abs(arm))


@pytest.mark.parametrize("name", ["excavator_20t", "paper_1dof", "crossing"])
def test_holding_pressures_draw(name: str, tmp_path: Path) -> None:
    fig, (ax,) = plots.figure()
    assert plots.holding_pressure(mapped(name, 4), ax) is ax
    assert plots.save(fig, tmp_path / "a.png").stat().st_size > 5_000
