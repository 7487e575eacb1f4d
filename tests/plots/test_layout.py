"""Places of axes: what stands around them is on the paper, and meets nothing of other axes."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np

import armdesign as ad
from armdesign import plots
from tests.frequency.cached import mapped
from tests.machines import CylinderSpec, Joint, build, named

PIXEL = 1.0  # what rounding of letters to pixels may add


def pictures() -> dict[str, Any]:
    crane, frequencies = named("loader_crane"), mapped("excavator_20t", 5)
    both = {"today": frequencies, "new": mapped("crossing", 5)}
    charts = {name: ad.lift_chart(named(name)) for name in ("excavator_20t", "loader_crane")}
    return {
        "one": plots.map_figure(frequencies, "joints"),
        "equal scales": plots.map_figure(frequencies, "reach"),
        "row": plots.side_by_side(both),
        "grid": plots.moment_arm_curves({"crane": crane}),
        "three": plots.lift_charts(charts),
        "beside": plots.machine_drawing(crane).figure,
        "legend": plots.mode_shapes(crane),
    }


def test_nothing_is_off_the_paper_or_over_another() -> None:
    """By the boxes that matplotlib finds of axes with all their words."""
    for name, fig in pictures().items():
        fig.canvas.draw()
        axes = [ax for ax in fig.axes if ax.get_visible()]
        boxes = [ax.get_tightbbox(for_layout_only=True) for ax in axes]
        boxes += [legend.get_window_extent() for legend in fig.legends]
        boxes += [fig._suptitle.get_window_extent()] if fig._suptitle else []
        for box in boxes:
            assert min(box.x0, box.y0) > -PIXEL, name
            assert max(box.x1 - fig.bbox.width, box.y1 - fig.bbox.height) < PIXEL, name
        for one, other in combinations(boxes, 2):
            assert not one.padded(-PIXEL).overlaps(other), name


def test_ticks_that_change_with_the_last_of_the_size_have_room() -> None:
    """Numbers of one digit became ones of two as the axes grew by less than a twentieth."""
    lift = Joint("lift", "root", xyz=(1.1, 0, 1.9), limits=(-0.7, 0.14))
    bucket = Joint("bucket", "lift", xyz=(2.7, 0, 0), limits=(-0.7, 0.64))
    cylinders = [
        CylinderSpec("lift", ("root", (1.05, 0, 0.9)), ("lift", (1.7, 0, -0.18))),
        CylinderSpec("tilt", ("lift", (0.5, 0, 0.43)), ("bucket", (-0.06, 0, 0.42))),
    ]
    loader = build([lift, bucket], cylinders, payload=("bucket", (1.15, 0, -0.06)))
    fig = plots.machine_drawing(loader).figure
    fig.canvas.draw()
    one, other = (ax.get_tightbbox(for_layout_only=True) for ax in fig.axes)
    assert not one.padded(-PIXEL).overlaps(other)


def test_axes_of_a_grid_have_one_size() -> None:
    fig = plots.moment_arm_curves({"crane": named("loader_crane")})
    fig.canvas.draw()
    sizes = [ax.get_window_extent().size for ax in fig.axes]
    np.testing.assert_allclose(sizes, np.tile(sizes[0], (len(sizes), 1)), rtol=1e-12)
