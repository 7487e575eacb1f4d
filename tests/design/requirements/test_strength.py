"""Buckling by hand."""

from __future__ import annotations

import math

import pytest

from armdesign.hydraulics.cylinder_build import (
    barrel_ratio,
    euler_load,
    second_moment,
    stepped_load,
)
from tests.design.designs import MACHINES
from tests.design.requirements.shared import PRESSURE, judged, own


@pytest.mark.parametrize("column", ["rod", "stepped"])
def test_buckling_factor_by_hand(column: str) -> None:
    """π² E I/(L² p A) of the stick's rod, open 3.304 m; as two columns each half of it, the
    barrel's wall by Lamé.
    """
    thrust = PRESSURE * math.pi / 4 * 0.14**2
    rod, barrel = second_moment(0.1), second_moment(0.14 * barrel_ratio(PRESSURE), 0.14)
    load = (
        euler_load(rod, 3.304)
        if column == "rod"
        else float(stepped_load(barrel, rod, 1.652, 1.652))
    )
    buckling = own(buckling_factor=3.0, buckling_column=column)["buckling_factor.stick"]
    assert buckling.value == pytest.approx(load / thrust, rel=1e-9)
    assert (buckling.limit, buckling.at_least) == (3.0, True)


def test_a_relief_below_the_supply_limits_the_thrust() -> None:
    """280 of 350 bar: the rod is pushed with 280 bar × A1; the wall is what 350 bar need."""
    machine = MACHINES["excavator"]().replace({"cylinder.stick.valve.relief_bar": 280.0})
    checks = judged(machine, machine, buckling_factor=3.0, buckling_column="stepped")
    thrust = 280e5 * math.pi / 4 * 0.14**2
    rod, barrel = second_moment(0.1), second_moment(0.14 * barrel_ratio(PRESSURE), 0.14)
    load = float(stepped_load(barrel, rod, 1.652, 1.652))
    assert checks["thrust.stick"].value == pytest.approx(thrust, rel=1e-12)
    assert checks["buckling_factor.stick"].value == pytest.approx(load / thrust, rel=1e-9)


def test_wall_of_the_barrel_from_the_file() -> None:
    machine = MACHINES["excavator"]().replace({"cylinder.stick.barrel_wall_mm": 20.0})
    buckling = judged(machine, machine, buckling_factor=3.0, buckling_column="stepped")[
        "buckling_factor.stick"
    ]
    load = float(stepped_load(second_moment(0.18, 0.14), second_moment(0.1), 1.652, 1.652))
    assert buckling.value == pytest.approx(load / (PRESSURE * math.pi / 4 * 0.14**2), rel=1e-9)
