"""Numbers as they are printed."""

from __future__ import annotations

import numpy as np
import pytest

import armdesign as ad
from armdesign.units import SI, WORKSHOP, masses, mm, percent


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
    """Two digits count of a number alone; but for what is rounding."""
    masses, torques = (0.3, 0.03, 1e-9, 1.44, 14.4), (42.0, -62.0)
    assert [WORKSHOP.number(m, "kg") for m in masses] == ["0.30", "0.030", "0", "1.4", "14"]
    assert [WORKSHOP.number(t, "N m") for t in torques] == ["0.042", "-0.062"]
    assert WORKSHOP.number(0.03, "kg", 1) == "0.030"
    assert WORKSHOP.number(1.44 * mm, "m") == "1.4"  # lengths of a workshop have their decimals


def test_several_numbers_have_the_decimals_of_the_largest() -> None:
    """Three digits of it, or as many decimals as usual; torques of a robot of 1 kg in N m."""
    assert WORKSHOP.numbers((1.04, -0.78), "N m") == ["0.00104", "-0.00078"]
    assert WORKSHOP.numbers((2310.0, 0.4), "kg", 1) == ["2310.0", "0.4"]
    assert WORKSHOP.numbers((np.nan, 0.0, 1e-6), "kg") == ["nan", "0", "0"]
    assert WORKSHOP.numbers((), "kg") == []
    assert masses((2.334, 0.87, np.nan)) == ["2.33", "0.87", "–"]
    assert masses((8961.2, 0.87)) == ["8961", "1"]


def test_units_show_what_is_meant_for_others() -> None:
    """No imports and no helpers; every factor that a file's units need."""
    shown = {name for name in dir(ad.units) if not name.startswith("_")}
    assert shown == set(ad.units.__all__)
    assert {"mm", "deg", "bar", "MPa", "litre", "l_per_min", "kN", "psi"} <= shown
    assert not {"annotations", "dataclass", "Mapping", "math"} & shown
    assert all(hasattr(ad.units, name) for name in shown)
