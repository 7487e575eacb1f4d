"""Pictures of maps are drawn from the numbers of the map."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import armdesign as ad
from armdesign import plots
from armdesign.drawing.colours import ACTUATORS
from tests.frequency.cached import mapped
from tests.machines import BOOM, FOLD, LIFT, STICK, CylinderSpec, Joint, build, named


@pytest.mark.parametrize("name", ["excavator_20t", "crossing", "branched"])
def test_least_of_the_joint_picture_is_least_of_the_map(name: str) -> None:
    frequencies = mapped(name)
    x, y, values = plots.joint_plane(frequencies, frequencies.lowest)
    assert values.shape == (len(x), len(y))
    assert np.nanmin(values) == frequencies.frame["f1_hz"].min()


@pytest.mark.parametrize("draw", ["joints", "holding", "bandwidth"])
def test_cells_end_where_the_joints_do(draw: str) -> None:
    """Two values of each joint are two cells of half its range, not of all of it."""
    machine = named("loader_crane")
    workspace = ad.Workspace.grid(machine, 2)
    if draw == "bandwidth":
        ax = plots.bandwidth_map(ad.bandwidth_map(machine, workspace))
    else:
        ax = plots.map_figure(ad.frequency_map(machine, workspace), draw).axes[0]
    lower, upper = np.degrees(machine.range_within(workspace.end_margin)[:2]).T
    corners = ax.collections[0].get_coordinates()
    np.testing.assert_allclose(corners[0, 0], lower)
    np.testing.assert_allclose(corners[1, 1], (lower + upper) / 2)
    np.testing.assert_allclose(corners[2, 2], upper)
    frame = np.array([ax.get_xlim(), ax.get_ylim()])
    np.testing.assert_allclose(frame, np.column_stack([lower, upper]))


@pytest.mark.parametrize("plane", ["joints", "reach"])
@pytest.mark.parametrize(
    "name",
    [
        "paper_1dof",
        "crossing",
        *(pytest.param(name, marks=pytest.mark.slow) for name in ("excavator_20t", "spatial")),
    ],
)
def test_pictures_draw(name: str, plane: str, tmp_path: Path) -> None:
    """Without a display and without a warning (warnings are errors)."""
    fig, (ax,) = plots.figure()
    assert mapped(name, 3).plot(ax, plane=plane) is ax
    assert plots.save(fig, tmp_path / "a.png").stat().st_size > 5_000


@pytest.mark.parametrize(
    "plane", ["joints", pytest.param("reach", marks=pytest.mark.slow), "holding"]
)
def test_steps_in_maps_are_explained(plane: str) -> None:
    """Where a load case ends, a map jumps: said where a machine has such cases, nowhere else."""
    words = "steps: where the pitch of bucket ends load case full"
    for name, said in (("excavator_20t", True), ("crossing", False)):
        title = plots.map_figure(mapped(name, 4), plane).axes[0].get_title()
        assert (words in title) == said


@pytest.mark.parametrize("plane", ["joints", "holding"])
def test_load_cases_of_one_joint_are_told_apart(plane: str) -> None:
    """Each curve has its own look, and only an actuator has an actuator's colour."""
    ax = plots.map_figure(mapped("patu_boom"), plane).axes[0]
    curves = [line for line in ax.lines if len(line.get_xdata()) > 2]
    looks = {(line.get_color(), line.get_linestyle()) for line in curves}
    assert len(looks) == len(curves) >= 2
    for line in curves:
        of_actuator = "rigid load" in str(line.get_label())
        assert (line.get_color() in ACTUATORS) == of_actuator


@pytest.mark.parametrize(("foot", "drawn"), [(0.0, True), (0.2, True), (1.0, False)])
def test_the_worst_pose_is_marked_at_its_reach(foot: float, drawn: bool) -> None:
    """Reach is the distance from the root's vertical axis, the root of Pythagoras of x and y.

    That is seen from the side where the slew stands on that axis, though it leans (``foot`` 0),
    not where it stands apart: little by 0.2 m, which is drawn, too much by 1 m.
    """
    tilt = 0.0 if foot else 0.05
    column = Joint(
        "column", "root", xyz=(foot, 0, 0), rpy=(tilt, -tilt, 0), axis=(0, 0, 1), limits=(-1.2, 1)
    )
    joints = [column, replace(BOOM, parent="column"), STICK]
    turn = CylinderSpec("turn", ("root", (foot - 0.2, 0.9, 0.3)), ("column", (0.3, 0.1, 0.3)))
    lift = replace(LIFT, base=("column", (0.7, 0, 0.1)))
    machine = build(joints, [turn, lift, FOLD])
    frequencies = ad.frequency_map(machine, ad.Workspace.grid(machine, 4))
    x, y, z = frequencies.worst.tool
    assert abs(y) > 0.5
    ax = frequencies.plot(plane="reach")
    (ring, _) = [line for line in ax.lines if line.get_markersize() == 10]
    np.testing.assert_allclose(ring.get_xydata()[0], (np.hypot(x, y), z))
    assert bool(ax.patches) == drawn
    stars = [line.get_xydata()[0] for line in ax.lines if line.get_marker() == "*"]
    assert len(stars) == drawn
    if foot == 0:
        np.testing.assert_allclose(stars, [(np.hypot(x, y), z)], rtol=1e-3)


def test_a_reach_map_draws_its_own_cells() -> None:
    reach_map = mapped("crossing", 3).reach_map()
    (mesh,) = reach_map.plot().collections
    drawn = np.ma.filled(mesh.get_array(), np.nan).reshape(reach_map.frequency.T.shape)
    np.testing.assert_array_equal(drawn, reach_map.frequency.T)


@pytest.mark.parametrize("plane", ["joints", pytest.param("reach", marks=pytest.mark.slow)])
def test_maps_side_by_side_have_one_scale(plane: str, tmp_path: Path) -> None:
    pair = {"one": mapped("excavator_20t", 3), "other": mapped("crossing", 3)}
    fig = plots.side_by_side(pair, plane)
    scales = {mesh.get_clim() for ax in fig.axes for mesh in ax.collections[:1]}
    least = min(frequencies.frame["f1_hz"].min() for frequencies in pair.values())
    meshes = [scale for scale in scales if scale[0] == pytest.approx(least, rel=1e-12)]
    assert len(meshes) == 1
    fig.canvas.draw()
    one, other = (ax.get_window_extent() for ax in fig.axes[:2])
    assert (one.width, one.height) == pytest.approx((other.width, other.height))
    assert plots.save(fig, tmp_path / "a.png").stat().st_size > 5_000


@pytest.mark.parametrize("name", ["excavator_20t", "paper_1dof", "crossing"])
def test_holding_pressures_draw(name: str, tmp_path: Path) -> None:
    fig, (ax,) = plots.figure()
    assert plots.holding_pressure(mapped(name, 4), ax) is ax
    assert plots.save(fig, tmp_path / "a.png").stat().st_size > 5_000
