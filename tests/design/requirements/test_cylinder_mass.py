"""Mass of all cylinders by hand."""

from __future__ import annotations

import pytest

from armdesign.hydraulics.cylinder_build import estimated_mass
from tests.design.requirements.shared import PRESSURE, own


def test_mass_of_all_cylinders() -> None:
    """The sum of ``estimated_mass`` by the file's numbers, two boom cylinders."""
    one = [
        estimated_mass(d, r, s, PRESSURE)
        for d, r, s in ((0.12, 0.085, 1.26), (0.14, 0.1, 1.504), (0.12, 0.085, 1.03))
    ]
    assert own(cylinder_mass=600.0)["cylinder_mass"].value == pytest.approx(
        2 * one[0] + one[1] + one[2], rel=1e-12
    )
