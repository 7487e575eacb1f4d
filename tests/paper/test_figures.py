"""The paper's pairs of figures.

Pencelli et al., "On the Estimation of Resonance Frequencies of Hydraulically Actuated Systems",
ISARC 2019, section 4.
"""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.testing import assert_allclose

from armdesign.paper.reproduction import Reproduction
from armdesign.paper.sheets import name_ends, paper_chart
from armdesign.plots.canvas import figure


@pytest.mark.slow
def test_pictures_have_the_papers_form(corners: Reproduction) -> None:
    """Figures 3, 4: identified red, computed blue; a curve per length against mass, and the other
    way round.
    """
    left, right = corners.plot("static_11").axes
    assert (left.get_xlabel(), right.get_xlabel()) == ("load mass m2 [kg]", "link length l2 [m]")
    for ax in (left, right):
        colours = [line.get_color() for line in ax.lines if line.get_linestyle() == "-"]
        assert colours == ["#3b82c4"] * 2 + ["#e5484d"] * 2
    drawn = np.concatenate([line.get_ydata() for line in left.lines[:2]])
    assert_allclose(np.sort(drawn), np.sort(corners.computed["static_11"]))


@pytest.mark.slow
def test_the_chart_by_mass_says_which_curve_is_which(corners: Reproduction) -> None:
    """A longer link has more inertia: the line of the shortest is the highest."""
    chart = paper_chart(corners)
    short, *_, long = [curve.y for curve in chart.curves if curve.kind == "line"]
    assert min(np.subtract(short, long)) > 0
    ends = np.unique(corners.mechanism.link_length)
    assert f"{ends[0]:g} m the highest, {ends[-1]:g} m the lowest" in chart.title


def test_names_of_near_curves_stand_apart() -> None:
    """Frequencies as √(1/m l) of the paper's masses and lengths, in a figure of the same size."""
    mass, length = np.repeat(np.arange(50.0, 401, 50), 5), np.tile(np.arange(0.5, 1.51, 0.25), 8)
    fig, axes = figure(2, 6.2, 5.4)
    for ax, x, family in ((axes[0], mass, length), (axes[1], length, mass)):
        ax.set_ylim(0, 95)
        name_ends(ax, x, family, 450 / np.sqrt(mass * length), "kg")
    fig.draw_without_rendering()
    for ax in axes:
        boxes = sorted((text.get_window_extent() for text in ax.texts), key=lambda box: box.y0)
        assert len(boxes) in (5, 8)
        assert all(low.y1 <= high.y0 for low, high in itertools.pairwise(boxes))
