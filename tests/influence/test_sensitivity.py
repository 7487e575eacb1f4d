"""What every number is worth: its table, its rivals, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import armdesign as ad
from armdesign.control.loop_plant import loop_plant
from armdesign.control.loops import Loops
from armdesign.control.map_parts import ControlOptions
from armdesign.control.tuning import EXACT, Task, best_of
from armdesign.influence.bandwidth import at_pose
from armdesign.influence.family import Family, can_matter
from armdesign.machine.file.numbers import numbers_of
from tests import machines


@pytest.fixture(scope="module")
def excavator_answer() -> ad.Sensitivity:
    machine = ad.load("excavator_20t")
    return ad.sensitivity(machine, ad.Workspace.grid(machine, points=5))


@pytest.mark.slow
def test_the_worst_pose_is_that_of_the_map(excavator_answer: ad.Sensitivity) -> None:
    machine = excavator_answer.machine
    worst = ad.frequency_map(machine, ad.Workspace.grid(machine, points=5)).worst
    assert excavator_answer.rivals[0].frequency == pytest.approx(worst.frequency, rel=1e-7)
    frequencies = [rival.frequency for rival in excavator_answer.rivals]
    assert frequencies == sorted(frequencies)
    assert {rival.pose.payload for rival in excavator_answer.rivals} == {"full", "empty"}


def test_every_number_is_there_or_counted(excavator_answer: ad.Sensitivity) -> None:
    machine, frame = excavator_answer.machine, excavator_answer.frame
    everything = numbers_of(machine.section)
    assert len(frame) + excavator_answer.left_out == len(everything)
    assert set(frame["key"]) <= set(everything)
    assert "cylinder.boom.valve.rated_flow_l_per_min" not in set(frame["key"])
    assert "motor.swing.displacement_cm3" not in set(frame["key"])  # it stands still


def test_what_is_left_out_does_nothing(excavator_answer: ad.Sensitivity) -> None:
    """All of it changed by 3 % at once, at the poses of all rivals."""
    machine, known = excavator_answer.machine, set(excavator_answer.frame["key"])
    values = {
        number.location: np.array([1.03 * number.value])
        for path, number in numbers_of(machine.section).items()
        if path not in known and can_matter(number.location)
    }
    assert len(values) > 20
    for rival in excavator_answer.rivals:
        changed = rival.frequencies(Family.of(machine, values, 1))[0]
        assert changed == pytest.approx(rival.frequency, rel=1e-5)


def test_linear_and_exact_meet_for_small_changes(excavator_answer: ad.Sensitivity) -> None:
    """10 mm of a pin is little, and the rest is curvature: the error falls with the square."""
    frame = excavator_answer.frame.set_index("key")
    pins = frame[frame.index.str.contains("at_mm")]
    np.testing.assert_allclose(pins["up_linear_hz"], pins["up_exact_hz"], atol=2e-3)
    assert frame.loc["fluid.entrained_air_percent", "up_exact_hz"] > -0.2
    assert frame.loc["fluid.entrained_air_percent", "up_linear_hz"] < -0.6
    assert np.isnan(frame.loc["fluid.entrained_air_percent", "down_exact_hz"])


@pytest.mark.slow
def test_exact_changes_are_those_of_a_new_map() -> None:
    """Ten millimetres move the crane's worst pose off its end stop, into a kink by the air."""
    machine = ad.load("loader_crane")
    answer = ad.sensitivity(machine, ad.Workspace.grid(machine, points=9))
    frame = answer.frame.set_index("key")
    for path, value in (("closed_length_mm", 830.0), ("stroke_mm", 545.0), ("bore_mm", 110.0)):
        other = machine.replace({f"cylinder.lift.{path}": value})
        new = ad.frequency_map(other, ad.Workspace.grid(other, points=9)).worst.frequency
        change = frame.loc[f"cylinder.lift.{path}", "up_exact_hz"]
        assert change == pytest.approx(new - answer.rivals[0].frequency, abs=3e-4)


@pytest.mark.slow
def test_exact_changes_where_the_worst_pose_leaves_the_ends_that_it_followed() -> None:
    """The pivot takes the bucket's kink out of its range: only a rival was found, at +389 mHz."""
    machine = ad.load("mini_excavator_2t").replace({"fluid.entrained_air_percent": 1.0})
    answer = ad.sensitivity(machine, ad.Workspace.grid(machine, points=5))
    other = machine.replace({"cylinder.bucket.four_bar.pivot.at_mm": [890.0, 0.0, 0.0]})
    new = ad.frequency_map(other, ad.Workspace.grid(other, points=15)).worst.frequency
    row = answer.frame.set_index("key").loc["cylinder.bucket.four_bar.pivot.at_mm.0"]
    assert row["up_exact_hz"] == pytest.approx(new - answer.rivals[0].frequency, abs=1e-3)


def test_air_makes_a_pose_the_worst_that_is_no_rival_without_it() -> None:
    """By a new map -1.804 Hz, at another pose; near the worst pose without air only -1.082 Hz."""
    machine = ad.load("paper_1dof")
    row = ad.sensitivity(machine).frame.set_index("key").loc["fluid.entrained_air_percent"]
    worst = [
        ad.frequency_map(one, ad.Workspace.grid(one)).worst.frequency
        for one in (machine, machine.replace({"fluid.entrained_air_percent": 1.0}))
    ]
    assert row["up_exact_hz"] == pytest.approx(worst[1] - worst[0], rel=1e-4)


def test_overtaken_is_where_a_rival_is_as_low(excavator_answer: ad.Sensitivity) -> None:
    frame = excavator_answer.frame.set_index("key")
    row = frame.loc["payload.full.mass_kg"]
    change = row["overtaken_at"] - row["value"]
    slopes = [row["hz_per_unit"], row["rival_2_hz_per_unit"]]
    first, second = (
        rival.frequency + slope * change
        for rival, slope in zip(excavator_answer.rivals[:2], slopes, strict=True)
    )
    assert first == pytest.approx(second)
    assert change < -1000


def test_any_quantity_by_differences(excavator_answer: ad.Sensitivity) -> None:
    """Thrust of the boom: p A1 = 2 p π/4 D², by 10 mm of the bore; by hand."""
    machine = excavator_answer.machine

    def thrust(other: ad.Machine) -> float:
        return other.supply.pressure * other.cylinders[0].bore_area

    changes = excavator_answer.differences(thrust, count=3)
    expected = 2 * thrust(machine) / machine.cylinders[0].bore * 0.01
    assert changes["cylinder.boom.bore_mm"] == pytest.approx(expected)
    assert changes["fluid.entrained_air_percent"] == 0.0


def test_tables_and_picture(excavator_answer: ad.Sensitivity) -> None:
    poses, table = excavator_answer.sheets()
    assert poses.rows[0][0] == "0.767"
    assert "boom out" in poses.rows[0][3]
    assert f"{excavator_answer.left_out} numbers of the file do not matter" in table.note
    axes = excavator_answer.plot()
    assert axes.get_yticklabels()[0].get_text().startswith(table.rows[0][0])


def test_an_unstable_machine_has_no_slope() -> None:
    machine = machines.rigid("excavator_20t")
    machine = machine.replace({"payload.full.mass_kg": 900_000.0})
    with pytest.raises(ad.ArmDesignError, match="unstable at its worst pose"):
        ad.sensitivity(machine, ad.Workspace.grid(machine, points=4))


def test_a_load_case_that_exists_nowhere_is_refused_as_by_a_map() -> None:
    """The worst of the other load cases would stand for that of the machine."""
    machine = machines.named("excavator_20t").replace({"payload.full.link": "chassis"})
    workspace = ad.Workspace.grid(machine, points=3)
    with_widths = machine.replace({"tolerances.pin_mm": 1.0})
    for ask in (
        lambda: ad.frequency_map(machine, workspace),
        lambda: ad.sensitivity(machine, workspace),
        lambda: ad.tolerances(with_widths, workspace, count=16),
    ):
        with pytest.raises(ad.ArmDesignError, match="that pitch at no pose of the workspace"):
            ask()


def test_a_share_that_cannot_be_is_refused() -> None:
    machine = ad.load("paper_1dof")
    with pytest.raises(ad.ArmDesignError, match="within: -1 is not allowed"):
        ad.sensitivity(machine, within=-1)


def _widest(machine: ad.Machine, q: np.ndarray) -> float:
    """Bandwidth [Hz] at a pose with the best of forty loss factors tried one by one."""
    plant = loop_plant(machine, machine.at(q[None]))
    task = Task(plant, Loops.of(plant), ControlOptions().aim, EXACT)
    tried = (best_of(task, (eta,)).figures.narrowest[0] for eta in np.geomspace(0.7, 1.1, 40))
    return float(max(tried)) / (2 * np.pi)


@pytest.mark.slow
def test_bandwidths_by_every_number() -> None:
    """Against bandwidths at one pose of machines that differ by a tenth of a step."""
    machine = ad.load("excavator_20t")
    workspace = ad.Workspace.grid(machine, points=3)
    answer = ad.sensitivity(machine, workspace)
    changes = answer.bandwidths().set_index("key")
    sizes = changes["damped_hz"].abs().to_numpy()
    assert (np.diff(sizes) <= 0).all()
    assert "cylinder.boom.valve.leakage_l_per_min_per_bar" in changes.index  # of no frequency
    pose = answer.rivals[0].pose
    there = replace(workspace.subset(np.array([0])), q=pose.q[None])
    for key, part in (("cylinder.boom.bore_mm", 1.0), ("payload.full.mass_kg", 10.0)):
        ends = []
        for sign in (1, -1):
            other = machine.replace({key: changes.loc[key, "value"] + sign * part})
            frame = ad.bandwidth_map(other, there).frame.set_index("payload")
            widest = _widest(other.with_payload(pose.payload), pose.q)
            alone = frame.loc[pose.payload, "proportional_hz"]
            ends.append({"proportional_hz": alone, "damped_hz": widest})
        for scheme in ("proportional_hz", "damped_hz"):
            slope = 5 * (ends[0][scheme] - ends[1][scheme])  # a tenth of the step, both ways
            largest = np.abs([changes[scheme][key], slope]).max()
            assert changes[scheme][key] == pytest.approx(slope, abs=0.1 * largest + 1e-5)


def test_straight_lines_below_zero_are_no_estimates() -> None:
    """A litre of the oil in a soft hose: the derivative would take 6.2 of 4.3 Hz."""
    soft = {"dead_volume_l.annulus": 1.0, "hose.bulk_modulus_MPa": 100.0}
    changes = {f"cylinder.lift.{key}": value for key, value in soft.items()}
    machine = ad.load("paper_1dof").replace(changes)
    worth = ad.sensitivity(machine, ad.Workspace.grid(machine, points=5))
    rows = {number.path: k for k, number in enumerate(worth.numbers)}
    hose, bore = rows["cylinder.lift.hose.annulus_l"], rows["cylinder.lift.bore_mm"]
    assert worth.rivals[0].frequency + worth.changes[hose, 0, 0] < 0
    possible = worth.possible_changes
    assert np.isnan(possible[hose, 0, 0])
    np.testing.assert_array_equal(possible[hose, 0, 1], worth.changes[hose, 0, 1])
    np.testing.assert_array_equal(possible[bore], worth.changes[bore])
    cells = {cells[0]: cells for cells in worth.sheets()[1].rows}
    assert cells["cylinder.lift.hose.annulus_l"][3] == "–"
    assert cells["cylinder.lift.hose.annulus_l"][4].startswith("-")


def test_bandwidths_change_smoothly_with_a_number() -> None:
    """Differences over 0.1 and over 1 mm of bore agree: gains are found closely enough for both.

    To 3 %, as gains of a map are, the smaller difference was up to a thousand times too large.
    """
    machine, q = ad.load("excavator_20t"), np.array([1.1, -1.2, -1.5])

    def slope(step: float) -> np.ndarray:
        bores = (120.0 + step, 120.0 - step)
        ends = [machine.replace({"cylinder.boom.bore_mm": bore}) for bore in bores]
        up, down = (at_pose(one, q, "full", 0.02) for one in ends)
        return np.asarray((up - down) / (2 * step))

    np.testing.assert_allclose(slope(0.05), slope(0.3), rtol=0.1)


def test_a_step_that_other_numbers_do_not_allow_is_none() -> None:
    """A hose no larger than the dead volume that holds it, and a rod no wider than the bore."""
    volumes = {"cylinder.boom.dead_volume_l.cap": 0.5, "cylinder.boom.hose.cap_l": 0.1}
    rod = {"cylinder.bucket.bore_mm": 125.0, "cylinder.bucket.rod_mm": 118.0}
    machine = machines.named("excavator_20t").replace({**volumes, **rod})
    worth = ad.sensitivity(machine, ad.Workspace.grid(machine, points=3))
    rows = worth.frame.set_index("key")
    for key in ("cylinder.boom.hose.cap_l", "cylinder.bucket.rod_mm"):
        number = numbers_of(machine.section)[key]
        with pytest.raises(ad.ArmDesignError):
            machine.replace({key: number.value + number.step[0]})
        assert rows.loc[key, ["up_linear_hz", "up_exact_hz"]].isna().all(), key


def test_no_step_goes_to_an_end_that_the_file_may_not_have() -> None:
    """A motor that traps 1 l cannot have 1 l less: without oil it would be rigid."""
    volumes = [f"motor.turn.trapped_volume_l.{side}" for side in "ab"]
    hoses = [f"motor.turn.hose.{side}_l" for side in "ab"]
    changes = dict.fromkeys(volumes, 1.0) | dict.fromkeys(hoses, 0.0)
    machine = machines.named("rotator").replace(changes)
    answer = ad.sensitivity(machine, ad.Workspace.grid(machine, points=3))
    rows = answer.frame.set_index("key").loc[volumes]
    assert np.isfinite(rows["up_exact_hz"]).all()
    assert np.isnan(rows["down_exact_hz"]).all()
