"""Tables of the reproduction.

Pencelli et al., "On the Estimation of Resonance Frequencies of Hydraulically Actuated Systems",
ISARC 2019, section 4.
"""

from __future__ import annotations

import pandas as pd
import pytest

from armdesign.paper.errata import errata as errata_of
from armdesign.paper.reproduction import Reproduction
from armdesign.paper.sheets import paper_sheets
from armdesign.simulation.identification.sweep_bias import sweep_bias


@pytest.mark.slow
def test_sheets_say_what_was_found(corners: Reproduction, scanned: pd.DataFrame) -> None:
    conventions, frequencies, bias, errors, errata, *scans = paper_sheets(
        corners, errata_of(corners.mechanism), scanned, sweep_bias(periods=(10, 300))
    )
    assert (
        "cylinder",
        "asymmetric",
        "63.0/36.0 mm, stroke 200.0 mm, dead 0.10 l and 0.10 l",
    ) in conventions.rows
    assert [row[0] for row in frequencies.rows] == ["50 kg", "400 kg"]
    assert frequencies.rows[0][1].startswith("41.73")
    assert "23.49" in errors.note
    assert bias.rows[1] == (
        "10",
        "0.05",
        "-1.57 %",
        "-3.00 %",
        "+0.00 %",
    )  # tests/simulation/test_excitation.py
    assert len(bias.rows) == 6
    assert errors.rows[-1][2] == f"{corners.errors['identified']['joint_exact']:.4g}"
    assert dict((row[0], row[3]) for row in errata.rows)["(12)"] == "+41.42 %"
    assert ["23.49" in sheet.title for sheet in scans] == [True, True]
    assert len({len(row) for sheet in scans for row in sheet.rows}) == 1
