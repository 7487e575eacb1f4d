"""Orifice, overlap and underlap against numbers worked by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from armdesign.hydraulics.valve import LAMINAR_DROP, Valve, opening, orifice_flow, spool_position
from armdesign.units import bar, l_per_min

VALVE = Valve(
    rated_flow=60 * l_per_min, rated_drop=10 * bar, natural_frequency=10, damping_ratio=0.8
)
LAPPED = Valve(
    rated_flow=60 * l_per_min,
    rated_drop=10 * bar,
    natural_frequency=10,
    damping_ratio=0.8,
    overlap=0.2,
)
TURBULENT = 1e-3  # relative; the laminar term is worth (Δp_lam/2Δp)² = 6e-4 at 10 bar, less above


@pytest.mark.parametrize(
    ("share", "drop", "flow"),
    [
        (1.0, 10, 60),  # its rating
        (1.0, 40, 120),  # four times the drop, twice the flow
        (0.5, 90, 90),  # half open, nine times the drop: 60 · ½ · 3
        (1.0, -10, -60),  # backwards
        (0.0, 100, 0),
    ],
)
def test_orifice_by_hand(share: float, drop: float, flow: float) -> None:
    volume_flow = orifice_flow(VALVE.gain * share, drop * bar) / l_per_min
    assert volume_flow == pytest.approx(flow, rel=TURBULENT)


def test_orifice_is_laminar_near_zero_drop() -> None:
    """Q → K x Δp/√Δp_lam: a slope, where the root has none."""
    gain = VALVE.rated_flow / math.sqrt(VALVE.rated_drop)
    assert orifice_flow(gain, 1.0) == pytest.approx(gain / math.sqrt(LAMINAR_DROP), rel=1e-9)
    assert orifice_flow(gain, -1.0) == -orifice_flow(gain, 1.0)


@pytest.mark.parametrize(
    ("spool", "share"), [(0.2, 0.0), (-0.1, 0.0), (0.6, 0.5), (-1.0, -1.0), (1.3, 1.0)]
)
def test_overlap_is_a_dead_band(spool: float, share: float) -> None:
    """(0.6 − 0.2)/(1 − 0.2) = ½."""
    assert opening(LAPPED, spool) == pytest.approx(share, abs=1e-15)


@pytest.mark.parametrize("share", [-1.0, -0.3, 0.0, 0.01, 0.7])
def test_spool_position_opens_by_the_share(share: float) -> None:
    assert opening(LAPPED, spool_position(LAPPED, share)) == pytest.approx(share, abs=1e-15)


@pytest.mark.parametrize("share", [-1.0, -0.3, -0.1, 0.0, 0.05, 0.7])
def test_spool_position_with_underlap(share: float) -> None:
    valve = replace(VALVE, overlap=-0.25)
    assert opening(valve, spool_position(valve, share)) == pytest.approx(share, abs=1e-15)


def test_seals_in_good_order_shut() -> None:
    """TIGHT is 1e-5 of the rated flow at the rated drop: here 6e-5 l/min per bar, both leaks."""
    for across, to_tank, leaks in ((3e-5, 2e-5, False), (5e-5, 2e-5, True), (0.0, 7e-5, True)):
        leakage, tank_leakage = (value * l_per_min / bar for value in (across, to_tank))
        valve = replace(VALVE, leakage=leakage, tank_leakage=tank_leakage)
        assert valve.leaks == leaks
    assert replace(VALVE, overlap=-0.01).leaks
