"""Sheets of designs say what buildability costs."""

from __future__ import annotations

import re

import pytest

import armdesign as ad
from armdesign.report.designs import design_sheets
from tests.design.designs import MACHINES, workspace_of

BANDS = ad.Bands(structure=(0.0, 1.0))


@pytest.mark.slow
@pytest.mark.parametrize("catalogue", ["5mm", "free"])
def test_what_buildability_costs(catalogue: str) -> None:
    """The gain of the machine as written beside that of the best start, before any steps."""
    machine, space = MACHINES["double"](), workspace_of("double")
    design = ad.optimize(machine, space, catalogue=catalogue, starts=1, bands=BANDS)
    gains = re.findall(
        r"buildable ([+-][\d.]+) %, in real numbers ([+-][\d.]+) %", design_sheets(design)[0].note
    )
    if catalogue == "free":
        assert not gains
        return
    ((built, real),) = gains
    today = design.problem.dynamics.corners.nominal
    assert float(built) == pytest.approx(100 * design.least_gain, abs=0.05)
    assert float(real) == pytest.approx(100 * (design.starts[0] / today - 1), abs=0.05)
    assert float(built) < float(real)
