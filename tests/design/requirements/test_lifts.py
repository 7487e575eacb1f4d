"""Lifts: capacity and place by the independent planar reference."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from armdesign import Requirements
from armdesign.design.requirements.holding import Lift, lift_pose
from tests.design.designs import MACHINES
from tests.design.requirements.shared import DEG, FRONT, POSED, PRESSURE, RETURN, own, reference
from tests.reference_planar import Reference


@pytest.mark.parametrize("lift", [FRONT, POSED], ids=["place", "pose"])
def test_lift_capacity_by_the_independent_reference(lift: Lift, tmp_path: Path) -> None:
    """At the mass that ``check`` says, the weakest cylinder carries just 87 % of what the supply
    gives (ISO 10567).

    The reference has the mass as a payload of its own file; static forces by complex steps of
    energy and lengths.
    """
    machine = MACHINES["excavator"]()
    lift_check = own(lifts=(lift,))[f"lift.{lift.name}"]
    at = lift_pose(machine, lift, Requirements.of(machine).holding_share)
    link = lift.link or "bucket"
    place = [1000.0 * x for x in lift.at or machine.tool.at]
    loaded = machine.replace(
        {
            "payload.full.mass_kg": lift_check.value,
            "payload.full.link": link,
            "payload.full.at_mm": place,
        }
    )
    other = Reference.load(loaded.save(tmp_path / "loaded.toml"))
    force = other.forces(at.rigid.q, "full")[0]
    push = PRESSURE * other.bore_areas - RETURN * other.annulus_areas
    pull = PRESSURE * other.annulus_areas - RETURN * other.bore_areas
    use = np.where(force > 0, force / push, -force / pull)
    assert use.max() == pytest.approx(0.87, rel=1e-9)
    assert lift_check.slack == pytest.approx(lift_check.value / lift.mass - 1, rel=1e-9)


def test_lift_at_a_place_stands_there() -> None:
    """The reference's tool: reach and height as asked; the bucket as given; of both elbows the one
    that lifts more.
    """
    machine, old = MACHINES["excavator"](), reference()
    at = lift_pose(machine, FRONT, Requirements.of(machine).holding_share)
    (q,) = at.rigid.q
    frames = old.frames(q[None])
    x, z, angle = frames["bucket"]
    tool = machine.tool.at
    assert x[0] + tool[0] * math.cos(angle[0]) - tool[2] * math.sin(angle[0]) == pytest.approx(
        6.0, abs=1e-8
    )
    assert z[0] + tool[0] * math.sin(angle[0]) + tool[2] * math.cos(angle[0]) == pytest.approx(
        1.5, abs=1e-8
    )
    assert q[2] == pytest.approx(-120 * DEG)
