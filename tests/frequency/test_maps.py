"""Frequency maps: columns, rows, percentiles and shares by weight, bookkeeping of stiffness."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose

import armdesign as ad
from armdesign import progress
from armdesign.arrays import Array, Flags, chunks, percentiles
from armdesign.frequency.modes import energy_shares
from tests import machines
from tests.frequency.cached import mapped


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
    frequencies, machine = mapped(name), machines.named(name)
    monkeypatch.setattr("armdesign.arrays.CHUNK", 97)
    monkeypatch.setattr("armdesign.frequency.workspace.KEPT", 0)
    again = ad.frequency_map(machine, ad.Workspace.grid(machine, 5))
    pd.testing.assert_frame_equal(again.frame, frequencies.frame, rtol=1e-12)
    assert np.array_equal(again.limiting, frequencies.limiting)
    modes = ad.natural_modes(machine.at(frequencies.workspace.q))
    assert modes.frequencies.shape == (len(frequencies.workspace), len(machine.joints))


@pytest.mark.parametrize("terminal", [True, False])
def test_a_progress_bar_shows_on_a_terminal_only(
    terminal: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("armdesign.progress.PATIENCE", -1.0)
    monkeypatch.setattr("sys.stderr.isatty", lambda: terminal)
    progress.console.cache_clear()  # another test's console has looked at another stderr
    assert list(progress.with_bar(chunks(40_000), 40_000, "poses")) == list(chunks(40_000))
    written = capsys.readouterr()
    assert written.out == ""
    assert ("poses" in written.err) == terminal


@pytest.mark.parametrize("name", ["excavator_20t", "redundant"])
def test_percentiles_and_shares_weigh_the_rows(name: str) -> None:
    """By hand, from the frame: a pose counts as its joint box, half a step at each end; those
    added count nothing.

    Half of the weight lies on either side of the median, to the box of one pose.
    """
    frequencies = mapped(name, 4)
    q = frequencies.frame[list(frequencies.machine.joints)].to_numpy()
    weights = np.ones(len(q))
    for axis, values in zip(frequencies.workspace.axes, q.T, strict=True):
        off = np.abs(values[:, None] - axis).min(axis=1)
        weights *= np.where(
            off > 1e-9, 0, np.where((values == axis[0]) | (values == axis[-1]), 0.5, 1)
        )
    assert_allclose(frequencies.weights, weights, atol=0)
    table = frequencies.percentiles([0, 50, 100])
    assert list(table.index) == [
        *(payload.name for payload in frequencies.machine.payloads),
        "all",
    ]
    assert table.loc["all", "0 %"] == frequencies.frame["f1_hz"].min()
    assert table.loc["all", "100 %"] == frequencies.frame["f1_hz"].max()
    for payload, rows in frequencies.frame.groupby("payload"):
        below = weights[rows.index][rows["f1_hz"] <= table.loc[payload, "50 %"]].sum()
        assert below == pytest.approx(weights[rows.index].sum() / 2, abs=1)
        assert frequencies.worst_of[payload].frequency <= rows["f1_hz"].min() + 1e-12
        assert frequencies.worst_of[payload].payload == payload
    assert frequencies.worst.frequency == min(
        worst.frequency for worst in frequencies.worst_of.values()
    )
    shares = frequencies.limiting_shares
    assert shares.sum() == pytest.approx(1)
    for c in frequencies.machine.cylinders:
        assert shares[c.name] == pytest.approx(
            weights[frequencies.limiting == c.name].sum() / weights.sum(), abs=1e-12
        )


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("excavator_20t", "grid"),
        *(
            pytest.param(*case, marks=pytest.mark.slow)
            for case in (
                ("excavator_20t", "sobol"),
                ("excavator_20t", "reach_plane"),
                ("loader_crane", "grid"),
            )
        ),
    ],
)
def test_percentiles_and_shares_are_those_of_random_poses(name: str, kind: str) -> None:
    """Brute force: poses at random, even over the joint ranges, know no edges. 1.5 % is their own
    scatter.
    """
    machine = machines.named(name)
    space = getattr(ad.Workspace, kind)(machine, *([6000] if kind == "sobol" else []))
    frequencies = ad.frequency_map(machine, space)
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
            frequencies.percentiles([5, 25, 50, 75, 95]).loc[payload.name], percents, rtol=margin
        )
        limits.append(energy_shares(poses, modes)[:, 0].argmax(axis=1))
    shares = np.bincount(np.concatenate(limits), minlength=3) / sum(map(len, limits))
    assert_allclose(frequencies.limiting_shares, shares, atol=margin)


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


def test_percentiles_of_groups_are_those_of_each_alone() -> None:
    """Equal values, weights of zero, of a whole group too, groups of one, numbers left out."""
    random = np.random.default_rng(2)
    groups = random.choice([0, 1, 3, 4, 8], 300, p=[0.5, 0.3, 0.1, 0.09, 0.01])
    groups[:2] = 9, 11
    values, weights = np.round(random.normal(size=300), 1), random.integers(0, 3, 300) * 1.0
    weights[groups == 3] = 0.0
    values[groups == 4] = np.inf
    percents = [0, 5, 50, 95, 100]
    alone = [percentiles(values[rows], weights[rows], percents) for rows in _each(groups)]
    assert_allclose(percentiles(values, weights, percents, groups), alone, atol=1e-12)


def _each(groups: Array) -> Iterator[Flags]:
    return (groups == number for number in np.unique(groups))


def test_a_load_case_that_is_all_edge_counts_its_rows() -> None:
    """A pitch range of hardly any width: the case exists at poses turned onto it alone."""
    machine = machines.named("excavator_20t").replace({"payload.full.pitch_deg": [179.99, 180.01]})
    frequencies = ad.frequency_map(machine, ad.Workspace.grid(machine, 4))
    lowest = frequencies.frame["f1_hz"][frequencies.frame["payload"] == "full"]
    assert_allclose(
        frequencies.percentiles([5, 50]).loc["full"], np.percentile(lowest, [5, 50]), rtol=1e-12
    )


def test_the_default_workspace_is_the_default_grid() -> None:
    machine = machines.named("patu_boom")
    frequencies = ad.frequency_map(machine)
    assert_allclose(frequencies.workspace.q, ad.Workspace.grid(machine).q, atol=0)


@pytest.mark.parametrize("name", ["excavator_20t", "spatial"])
def test_stiffness_bookkeeping_adds_up(name: str) -> None:
    """The parts sum to ω² of the lowest mode; oil alone, from the shares, is the Rayleigh quotient
    of K_h.
    """
    frequencies = mapped(name, 4)
    omega = 2 * np.pi * frequencies.frame["f1_hz"].to_numpy()
    assert_allclose(frequencies.stiffness_parts.sum(axis=1), omega**2, rtol=1e-9)
    shares = frequencies.part_shares
    assert_allclose(shares.sum(axis=1), 1, rtol=1e-12)
    row = len(frequencies.frame) // 3
    machine = frequencies.machine.with_payload(frequencies.frame["payload"].iloc[row])
    poses = machine.at(frequencies.frame[list(machine.joints)].iloc[row].to_numpy())
    shape = ad.natural_modes(poses).shapes[0, :, 0]
    assert shares[row, 0] == pytest.approx(
        shape @ poses.hydraulic_stiffness[0] @ shape / omega[row] ** 2, rel=1e-9
    )


def test_holding_pressures_balance_the_forces() -> None:
    """F = A1 p1 − A2 p2 with the unloaded chamber at the return pressure (definition)."""
    frequencies = mapped("excavator_20t")
    supply, cylinder = frequencies.machine.supply, frequencies.machine.cylinders[1]
    force = frequencies.frame["stick_force_n"].to_numpy()
    pressure = frequencies.holding_pressures[:, 1] * supply.pressure
    pushing = cylinder.bore_area * pressure - cylinder.annulus_area * supply.return_pressure
    pulling = cylinder.bore_area * supply.return_pressure - cylinder.annulus_area * pressure
    least = (cylinder.bore_area - cylinder.annulus_area) * supply.return_pressure
    assert (force > least).any()
    assert (force < least).any()
    assert_allclose(np.where(force > least, pushing, pulling), force, rtol=1e-9, atol=1e-6)
