"""Designs of machines on springs, by the package's front door."""

from __future__ import annotations

import pytest

import armdesign as ad
from armdesign.report.designs import design_sheets, summary
from tests.sprung import rocking


@pytest.mark.slow
def test_the_carriage_limits_and_cylinders_help_little() -> None:
    """On soft tracks new sizes and pins gain a few per cent; the bound says that no design does
    better, and the words say why.
    """
    machine = rocking("mini_excavator_2t", 2.5e6)
    workspace = ad.Workspace.grid(machine, points=(4, 4, 5))
    design = ad.optimize(machine, workspace, starts=1, bands=ad.Bands(), catalogue="free")
    before, after = design.before.worst, design.after.worst
    assert before.cylinder == after.cylinder == "carriage"
    assert 1 < after.frequency / before.frequency < 1.1
    assert design.bound is not None
    assert after.frequency <= design.bound < 1.01 * after.frequency
    words = "the carriage spring limits there, which no search changes"
    assert words in summary(design)
    assert words in design_sheets(design)[0].note
