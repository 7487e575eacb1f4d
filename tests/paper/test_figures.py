"""The paper's pairs of figures.

Pencelli et al., "On the Estimation of Resonance Frequencies of Hydraulically Actuated Systems",
ISARC 2019, section 4.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from armdesign.paper.reproduction import Reproduction
from armdesign.paper.sheets import paper_chart


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
