"""Curves of moment arms are drawn for any machines."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from armdesign import Machine, lift_chart, plots
from armdesign.report.lift_charts import lift_charts
from tests import machines
from tests.opening import opening


def test_curves_of_moment_arms_take_any_machines(tmp_path: Path) -> None:
    """Cylinders are matched by name; the curve is the moment arm over the machine's own range."""
    machine = machines.named("excavator_20t")
    fig = plots.moment_arm_curves({"20 t": machine, "12 t": machines.named("excavator_12t")})
    line = fig.axes[0].lines[0]
    poses = machine.at(np.array([[machine.ranges[0, 0], *machine.ranges.mean(axis=1)[1:]]]))
    assert line.get_xdata()[0] == pytest.approx(np.rad2deg(machine.ranges[0, 0]))
    assert line.get_ydata()[0] == pytest.approx(1000 * abs(poses.moment_arms[0, 0, 0]))
    assert [len(ax.lines) for ax in fig.axes] == [2, 2, 2, 4, 4, 4]
    arm, pressure = abs(poses.moment_arms[0, 0, 0]), machine.supply.pressure
    boom = machine.cylinders[0]
    assert [line.get_ydata()[0] for line in fig.axes[3].lines[:2]] == pytest.approx(
        [pressure * area * arm / 1000 for area in (boom.bore_area, boom.annulus_area)]
    )
    assert plots.save(fig, tmp_path / "a.png").stat().st_size > 5_000


def test_todays_curves_are_drawn_above_the_same_ones() -> None:
    one = machines.named("patu_boom")
    for ax in plots.moment_arm_curves({"today": one, "new": one}).axes:
        heights = [line.get_zorder() for line in ax.lines]
        assert heights == sorted(heights, reverse=True)
        assert heights[0] > heights[-1]


def test_curves_of_a_cylinder_across_two_joints() -> None:
    """One picture for each joint it spans, the other joint in the middle of its range."""
    machine = machines.named("crossing")  # lift about the boom, long about both
    fig = plots.moment_arm_curves({"odd": machine})
    titles = [ax.get_title() for ax in fig.axes]
    assert titles[:3] == ["lift cylinder", "long cylinder about stick", "long cylinder about boom"]
    q = machine.ranges.mean(axis=1)
    q[1] = machine.ranges[1, 1]
    arm = machine.evaluate(machine.arm.kinematics(q[None])).moment_arms[0, 1, 1]
    assert fig.axes[2].lines[0].get_ydata()[-1] == pytest.approx(1000 * abs(arm))


def test_a_motor_has_no_curves_among_cylinders() -> None:
    """A moment arm of 1 m, as it was drawn, it has not, and its torque is the same everywhere."""
    machine = machines.named("rotator")
    fig = plots.moment_arm_curves({"rotator": machine})
    titles = [ax.get_title() for ax in fig.axes]
    assert "turn motor" not in titles
    cylinders = [one for one in machine.actuators if one.kind == "cylinder"]
    assert len([title for title in titles if title.endswith("cylinder")]) == len(cylinders)


def test_a_lift_chart_says_whose_it_is() -> None:
    """Its label stands above what limits the capacities: tipping only where the file knows it."""
    crane = machines.named("patu_boom")
    table = "[stability]\nmass_kg = 900\nat_mm = [0, 0, 0]\nfront_mm = 500\nrear_mm = 500\n"
    stable = Machine.from_text(f"{crane.text}\n{table}", crane.urdf_text, crane.source)
    for machine, limits in (
        (crane, "87 % hydraulic"),
        (stable, "87 % hydraulic, or 75 % of tipping"),
    ):
        fig = plots.lift_charts({"the crane": lift_chart(machine)})
        assert fig.axes[0].get_title() == f"the crane\n{limits} (ISO 10567)"


def test_lift_charts_of_two_machines_have_one_scale() -> None:
    """Points of both lie within the axes of either; the ratio is taken where both have a point."""
    charts = {
        name: lift_chart(machines.named(name)) for name in ("excavator_20t", "excavator_12t")
    }
    fig = plots.lift_charts(charts)
    spans = {(*ax.get_xlim(), *ax.get_ylim()) for ax in fig.axes[:3]}
    assert len(spans) == 1
    (left, right, low, high) = next(iter(spans))
    for ax, chart in zip(fig.axes, charts.values(), strict=False):
        points = ax.collections[0].get_offsets()
        np.testing.assert_allclose(points, np.column_stack([chart.reach, chart.height]))
        assert np.all((left < chart.reach) & (chart.reach < right))
        assert np.all((low < chart.height) & (chart.height < high))


@pytest.mark.parametrize(
    "names", [("excavator_20t", "loader_crane"), ("loader_crane", "mini_excavator_2t")]
)
def test_words_of_lift_charts_do_not_meet(names: tuple[str, ...]) -> None:
    """Two machines of different size, each with points of its own: apart, and within the axes."""
    fig = plots.lift_charts({name: lift_chart(machines.named(name)) for name in names})
    fig.canvas.draw()
    for ax in fig.axes[:3]:
        boxes = [text.get_window_extent() for text in ax.texts]
        assert boxes
        assert not any(one.overlaps(other) for one, other in combinations(boxes, 2))
        whole = ax.get_window_extent()
        assert all(whole.x0 <= box.x0 and box.x1 <= whole.x1 for box in boxes)
        assert all(whole.y0 <= box.y0 for box in boxes)


def test_points_too_near_for_words_have_colours() -> None:
    """The large machine at the small one's steps of half a metre: 14 points in a row."""
    names = ("mini_excavator_2t", "excavator_20t")
    fig = plots.lift_charts(lift_charts({name: machines.named(name) for name in names}))
    assert "colours alone" in fig.get_suptitle()
    assert not any(ax.texts for ax in fig.axes)


def test_charts_without_common_points_say_so() -> None:
    chart = lift_chart(machines.named("excavator_12t"))
    apart = replace(chart, height=chart.height + 0.25)
    ax = plots.lift_charts({"one": chart, "other": apart}).axes[2]
    assert [text.get_text() for text in ax.texts] == ["no common points"]
    assert not ax.child_axes


def test_a_curve_has_a_gap_where_a_four_bar_is_open() -> None:
    figure = plots.moment_arm_curves({"today": opening()})
    drawn = [line.get_ydata() for ax in figure.axes for line in ax.lines]
    assert any(np.isnan(values).any() for values in drawn)
    assert all(np.isfinite(ax.get_ylim()).all() for ax in figure.axes)
