"""What tests of requirements share: one of each on the excavator, checks by name."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

from armdesign import Machine, Requirements
from armdesign.design.requirements.check import check
from armdesign.design.requirements.holding import Lift
from armdesign.design.requirements.places import Clearance, Outline
from armdesign.design.requirements.record import Check
from armdesign.design.requirements.speeds import Speed
from tests.design.designs import MACHINES, workspace_of
from tests.machines import named
from tests.reference_planar import Reference

DEG = math.pi / 180
PRESSURE, RETURN, FLOW = 350e5, 5e5, 429e-3 / 60  # excavator_20t's file
FRONT = Lift(name="front", mass=2500, joints={"bucket": -120 * DEG}, reach=6.0, height=1.5)
CHANGES: dict[str, dict[str, Any]] = {  # of one cylinder of the 20 t machine, by its name
    "boom": {"cylinder.boom.base.at_mm": [461.5, 0, -562.5], "cylinder.boom.rod_mm": 90.0},
    "stick": {"cylinder.stick.rod_end.at_mm": [-780.0, 0, 346.5], "cylinder.stick.bore_mm": 130.0},
    "bucket": {"cylinder.bucket.four_bar.coupler_mm": 575.0, "cylinder.bucket.bore_mm": 115.0},
}
POSED = Lift(
    name="posed",
    mass=1000,
    link="stick",
    at=(2.7, 0, 0.1),
    joints={"boom": 0.3, "stick": -1.5, "bucket": -1},
)
BOOM_PLATE = ((-0.3, -0.3), (2.8, 0.3), (5.9, -0.3), (6.0, 0.3), (3.5, 1.4), (2.0, 1.2))
STICK_PLATE = ((0.2, -0.2), (2.6, -0.1), (2.6, 0.1), (0.2, 0.3))
EVERYTHING: dict[str, Any] = dict(
    speeds=(
        Speed(name="raise", joints={"boom": 14 * DEG}),
        Speed(name="lower", joints={"boom": -20 * DEG}, at="every"),
        Speed(name="all", joints={"boom": 0.1, "stick": -0.1}, cylinders={"bucket": -0.05}),
    ),
    lifts=(FRONT, POSED),
    lift_share=0.9,
    digging_force={"stick": 100e3, "bucket": 125e3},
    buckling_factor=1.9,
    buckling_column="stepped",
    cylinder_mass=600.0,
    pin_boxes={"boom": {"base": 0.1}, "stick": {"rod_end": 0.0}},
    outlines=(Outline(link="boom", points=BOOM_PLATE, pin_radius=0.2),),
    clearances=(
        Clearance(
            name="plate",
            cylinders=("bucket", "stick"),
            link="stick",
            points=STICK_PLATE,
            distance=0.15,
        ),
    ),
)
NEW = (
    "speed",
    "lift",
    "lift_share",
    "digging_force",
    "buckling_factor",
    "cylinder_mass",
    "outline",
    "clearance",
)


def judged(machine: Machine, today: Machine, **settings: Any) -> dict[str, Check]:
    requirements = replace(Requirements.of(today), **settings)
    return {c.name: c for c in check(machine, today, workspace_of("excavator"), requirements)}


def reference() -> Reference:
    return Reference.load(Path(named("excavator_20t").source))


def own(**settings: Any) -> dict[str, Check]:
    machine = MACHINES["excavator"]()
    return judged(machine, machine, **settings)


def by_name(checks: tuple[Check, ...]) -> dict[str, Check]:
    checks_by_name = {c.name: c for c in checks}
    assert len(checks_by_name) == len(checks)
    return checks_by_name


def shipped_reference(machine: Machine) -> Reference:
    """The planar reference of a machine's file."""
    return Reference.load(Path(machine.source))
