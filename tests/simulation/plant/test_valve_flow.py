"""Orifice, overlap, ports and friction against numbers worked by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from armdesign import Machine, load
from armdesign.hydraulics.valve import (
    LAMINAR_DROP,
    Edges,
    Friction,
    Valve,
    friction_force,
    opening,
    orifice_flow,
    spool_position,
)
from armdesign.simulation.plant.plant import Plant
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
    found = orifice_flow(VALVE.gain * share, drop * bar) / l_per_min
    assert found == pytest.approx(flow, rel=TURBULENT)


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


def ports(machine: Machine, spool: float) -> list[float]:
    """Flows [l/min] into cap and annulus of its one cylinder at 100 and 50 bar."""
    plant = Plant(machine)
    state = plant.with_spools(np.zeros((1, plant.size)), spool)
    state[0, 2 * plant.nq : 2 * plant.nq + 2] = 100.0, 50.0
    told = plant.evaluate(state, np.zeros((1, 1))).outputs[0, 0]
    return list(((told["supplied"] - told["returned"] + told["leaked"]) / l_per_min).tolist())


def lifting(**changes: object) -> Machine:
    """The paper's machine with that valve between 350 and 10 bar."""
    machine = load("paper_1dof").replace(
        {"supply.pressure_bar": 350, "supply.return_pressure_bar": 10}
    )
    return replace(
        machine, cylinders=(replace(machine.cylinders[0], valve=replace(VALVE, **changes)),)
    )  # type: ignore[arg-type]


def test_ports() -> None:
    """Extending: 350 − 100 = 250 bar into the cap, 50 − 10 = 40 bar out of the annulus;
    retracting: 90 out, 300 in.
    """
    expected = [60 * 5, -60 * 2, -60 * 3, 60 * math.sqrt(30)]
    assert ports(lifting(), 1.0) + ports(lifting(), -1.0) == pytest.approx(expected, rel=TURBULENT)


def test_edges_have_gains_of_their_own() -> None:
    """As above, times 2 out of the cap and 0.5 into the annulus."""
    machine = lifting(edges=Edges(cap_to_return=2.0, supply_to_annulus=0.5))
    expected = [60 * 5, -60 * 2, -2 * 60 * 3, 0.5 * 60 * math.sqrt(30)]
    assert ports(machine, 1.0) + ports(machine, -1.0) == pytest.approx(expected, rel=TURBULENT)


def test_underlap_opens_both_edges_in_the_middle() -> None:
    """Underlap 0.25: at the middle each edge is open by 0.25/1.25 = 0.2, at 0.25 one by 0.4 and
    the other shut.
    """
    machine = lifting(overlap=-0.25)
    assert ports(machine, 0.0) == pytest.approx(
        [0.2 * 60 * (5 - 3), 0.2 * 60 * (math.sqrt(30) - 2)], rel=2e-3
    )
    assert ports(machine, 0.25) == pytest.approx([0.4 * 60 * 5, -0.4 * 60 * 2], rel=TURBULENT)


@pytest.mark.parametrize("share", [-1.0, -0.3, -0.1, 0.0, 0.05, 0.7])
def test_spool_position_with_underlap(share: float) -> None:
    valve = replace(VALVE, overlap=-0.25)
    assert opening(valve, spool_position(valve, share)) == pytest.approx(share, abs=1e-15)


def test_tank_leakage() -> None:
    """Shut: (100 − 10) and (50 − 10) bar × 0.02 l/min/bar leave the chambers, (100 − 50) × 0.01
    cross the piston.
    """
    machine = lifting(tank_leakage=0.02 * l_per_min / bar, leakage=0.01 * l_per_min / bar)
    assert ports(machine, 0.0) == pytest.approx([-1.8 - 0.5, -0.8 + 0.5])


def test_friction_curve() -> None:
    """Static at 0.3 Stribeck speeds (tanh 3 = 0.995, e^−0.09 = 0.914), Coulomb and viscous far
    above.
    """
    friction = Friction(coulomb=1000, static=1500, stribeck_velocity=0.01, viscous=2000)
    assert friction_force(friction, 0.5) == pytest.approx(1000 + 2000 * 0.5)
    assert friction_force(friction, 0.003) == pytest.approx(
        (1000 + 500 * 0.9139) * 0.9951 + 6, rel=1e-3
    )
    assert friction_force(friction, -0.5) == -friction_force(friction, 0.5)
    assert friction_force(friction, 0.0) == 0
