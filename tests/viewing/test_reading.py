"""Readings against maps of the same pose, and in words where a pose cannot be."""

from __future__ import annotations

import html

import numpy as np
import pytest

import armdesign as ad
from armdesign.frequency.modes import natural_modes
from armdesign.units import deg
from armdesign.viewing.page_words import reading_words
from armdesign.viewing.reading import PHASES, reading, rows, swing_words
from armdesign.viewing.scene import scene_of
from armdesign.viewing.view import view_of
from tests.machines import inner_poses, named


def test_a_reading_is_what_the_modes_of_its_pose_are() -> None:
    machine = named("excavator_20t")
    q = machine.ranges.mean(axis=1)
    one = reading(machine, q)
    modes = natural_modes(machine.at(q))
    np.testing.assert_allclose(one.frequencies, modes.frequencies[0])
    assert one.limiting[0] == "boom"
    table = dict(rows(one))
    assert table["lowest frequency"] == f"{modes.frequencies[0, 0]:.3g} Hz"
    assert table["limited by"].startswith("boom (9")


def test_bandwidth_is_that_of_the_bandwidth_map() -> None:
    machine = named("paper_1dof")
    space = ad.Workspace.grid(machine, 3)
    table = ad.bandwidth_map(machine, space, damping=0.02).frame
    for row in (0, 1, 2):
        width = reading(machine, space.q[row], 0.02).bandwidth
        assert not isinstance(width, str)
        assert width.proportional == pytest.approx(table["proportional_hz"][row], rel=1e-9)
        assert width.damped == pytest.approx(table["damped_hz"][row], rel=1e-9)
        assert width.damping == pytest.approx(0.02)


def test_what_cannot_be_is_said_in_words() -> None:
    machine = named("excavator_20t")
    beyond = machine.ranges[:, 1] + 0.1
    one = reading(machine, beyond)
    assert "is outside its stroke" in one.fault
    assert rows(one) == [("no frequency", one.fault)]
    assert not len(one.frequencies)
    tipped = np.array([0.0, -60.0, 30.0]) * deg
    spilled = reading(machine.with_payload("full"), tipped)
    assert "bucket has a pitch of" in spilled.fault
    assert not reading(machine.with_payload("empty"), tipped).fault
    undamped = reading(named("paper_1dof"), np.array([0.0]))
    assert isinstance(undamped.bandwidth, str)
    assert "damping" in dict(rows(undamped))["no bandwidth"]
    assert not any("nan" in value for _, value in rows(undamped))


@pytest.mark.parametrize("name", ["excavator_20t", "rocking"])
def test_a_swing_is_the_mode_and_begins_at_rest(name: str) -> None:
    machine = named(name)
    q = inner_poses(machine, 1)[0]
    one = reading(machine, q)
    assert one.modes is not None
    z, tool = one.swing(0, scene_of(machine).swings)
    assert z.shape == (PHASES, len(machine.arm.coordinates))
    equilibrium = machine.arm.with_springs(q[None])[0]
    np.testing.assert_allclose(z[0], equilibrium)
    step = z[PHASES // 4] - equilibrium
    shape = one.modes.shapes[0, :, 0]
    np.testing.assert_allclose(step / np.linalg.norm(step), shape / np.linalg.norm(shape), 1e-6)
    words, rate = swing_words(one, len(shape) - 1, tool)
    assert rate <= 1.5
    assert f"{one.frequencies[-1]:.3g} Hz" in words
    assert words.endswith(f"±{1e3 * tool:.0f} mm at the tool")


def test_the_region_is_the_reach_map() -> None:
    machine = named("paper_1dof")
    space = ad.Workspace.grid(machine, 9)
    view = view_of(machine, workspace=space)
    frequencies = ad.frequency_map(machine, space)
    places = frequencies.reach_map(60)
    assert view.region.frequencies.min() == np.nanmin(places.frequency)
    assert len(view.region.middles) == np.isfinite(places.frequency).sum()
    at = view.region.middles[view.region.frequencies.argmin()]
    i, j = np.unravel_index(np.nanargmin(places.frequency), places.frequency.shape)
    np.testing.assert_allclose(at, [places.reach[i], places.height[j]])
    assert view.region.scale[0][0] == "#440154"  # the dark end of viridis
    assert view.worst.frequency == frequencies.worst.frequency


def test_another_machine_needs_the_same_joints() -> None:
    with pytest.raises(ad.ArmDesignError, match="has other joints"):
        view_of(named("paper_1dof"), named("loader_crane"))


def test_faults_stand_below_the_table_and_are_said_once() -> None:
    machine = named("paper_1dof")
    view = view_of(machine, workspace=ad.Workspace.grid(machine, 3))
    within, beyond = (reading(machine, np.array([q])) for q in (0.0, 2.0))
    of_both = reading_words({"today": within, "new": within}, "", view.region)
    assert of_both.count("no bandwidth: ") == 1
    assert ": no bandwidth: " not in of_both
    of_new = reading_words({"today": within, "new": beyond}, "", view.region)
    assert "<p>today: no bandwidth: " in of_new
    assert f"<p>new: no frequency: {html.escape(beyond.fault)}</p>" in of_new
    assert f"<td>{within.frequencies[0]:.3g} Hz</td><td>–</td>" in of_new
    of_none = reading_words({"today": beyond, "new": beyond}, "", view.region)
    assert "<table></table>" in of_none
