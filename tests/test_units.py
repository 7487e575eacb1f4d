"""Numbers as they are printed."""

from __future__ import annotations

import numpy as np
import pytest

import armdesign as ad
from armdesign.units import SI, WORKSHOP, mm, percent


@pytest.mark.parametrize(
    ("share", "decimals", "printed"),
    [
        (0.0687, 1, "+6.9 %"),
        (-0.0687, 1, "-6.9 %"),
        (-1e-9, 1, "+0.0 %"),  # what a search loses to rounding is no loss of the machine
        (-0.0, 1, "+0.0 %"),
        (-0.00049, 1, "+0.0 %"),
        (-0.00051, 1, "-0.1 %"),
        (-0.00004, 2, "+0.00 %"),
        (np.float64(-0.2), 0, "-20 %"),
        (np.inf, 1, "–"),  # over nothing
        (np.nan, 1, "–"),
    ],
)
def test_changes_in_per_cent(share: float, decimals: int, printed: str) -> None:
    assert percent(share, decimals) == printed


def test_nothing_is_printed_as_minus_nothing() -> None:
    assert WORKSHOP.number(-0.04 * mm, "m") == "0.0"
    assert WORKSHOP.number(-0.06 * mm, "m") == "-0.1"
    assert SI.number(-1e-9, "N") == "0"
    assert WORKSHOP.text(-1e-12, "rad") == "0.0°"


def test_small_machines_have_masses_and_torques() -> None:
    """Less than decimals show has two more; but for what is rounding."""
    masses, torques = (0.3, 0.03, 1e-9, 1.4), (42.0, -62.0)
    assert [WORKSHOP.number(m, "kg") for m in masses] == ["0.30", "0.03", "0", "1"]
    assert [WORKSHOP.number(t, "N m") for t in torques] == ["0.042", "-0.062"]
    assert WORKSHOP.number(0.03, "kg", 1) == "0.030"


def test_units_show_what_is_meant_for_others() -> None:
    """No imports and no helpers; every factor that a file's units need."""
    shown = {name for name in dir(ad.units) if not name.startswith("_")}
    assert shown == set(ad.units.__all__)
    assert {"mm", "deg", "bar", "MPa", "litre", "l_per_min", "kN", "psi"} <= shown
    assert not {"annotations", "dataclass", "Mapping", "math"} & shown
    assert all(hasattr(ad.units, name) for name in shown)
