"""Flows of a valve's ports, of its leakage and underlap, against numbers worked by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from armdesign import Machine, load
from armdesign.hydraulics.valve import Edges, Valve
from armdesign.simulation.plant.plant import Plant
from armdesign.units import bar, l_per_min

VALVE = Valve(
    rated_flow=60 * l_per_min, rated_drop=10 * bar, natural_frequency=10, damping_ratio=0.8
)
TURBULENT = 1e-3  # relative; the laminar term is worth (Δp_lam/2Δp)² = 6e-4 at 10 bar, less above


def ports(machine: Machine, spool: float) -> list[float]:
    """Flows [l/min] into cap and annulus of its one cylinder at 100 and 50 bar."""
    plant = Plant(machine)
    state = plant.with_spools(np.zeros((1, plant.size)), spool)
    state[0, 2 * plant.nq : 2 * plant.nq + 2] = 100.0, 50.0
    outputs = plant.evaluate(state, np.zeros((1, 1))).outputs[0, 0]
    return list(
        ((outputs["supplied"] - outputs["returned"] + outputs["leaked"]) / l_per_min).tolist()
    )


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


def test_tank_leakage() -> None:
    """Shut: (100 − 10) and (50 − 10) bar × 0.02 l/min/bar leave the chambers, (100 − 50) × 0.01
    cross the piston.
    """
    machine = lifting(tank_leakage=0.02 * l_per_min / bar, leakage=0.01 * l_per_min / bar)
    assert ports(machine, 0.0) == pytest.approx([-1.8 - 0.5, -0.8 + 0.5])
