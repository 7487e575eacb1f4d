"""Moment arms, digging torque and transmission angles by the independent planar reference."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from armdesign.design.requirements.check import check
from tests.design.designs import problem_of
from tests.design.requirements.shared import CHANGES, PRESSURE, by_name, own, shipped_reference
from tests.reference_planar import Reference


@pytest.mark.parametrize("cylinder", ["boom", "stick", "bucket"])
def test_moment_arm_digging_and_transmission_by_the_independent_reference(
    cylinder: str, tmp_path: Path
) -> None:
    """Values of the planar reference (complex step of the length, 20 001 poses); 1e-3 for 181
    poses here.
    """
    problem = problem_of(
        "excavator", moment_arm_share=1.0, transmission=math.radians(40), torque_share=0.0
    )
    today = problem.machine
    machine = today.replace(CHANGES[cylinder])
    new, old = Reference.load(machine.save(tmp_path / "new.toml")), shipped_reference(today)
    checks = by_name(check(machine, today, problem.workspace, problem.requirements))
    part, before = ({c.name: c for c in m.cylinders}[cylinder] for m in (new, old))
    scans = new.joint_scan(part, old.ranges), old.joint_scan(before, old.ranges)
    (q, _, arm), (_, _, arm_before) = scans
    assert checks[f"moment_arm.{cylinder}"].value == pytest.approx(np.abs(arm).min(), rel=1e-3)
    assert checks[f"moment_arm.{cylinder}"].limit == pytest.approx(
        np.abs(arm_before).min(), rel=1e-3
    )
    if cylinder != "boom":
        digging = checks[f"digging.{cylinder}"]
        pairs = (part, arm), (before, arm_before)
        torque = [PRESSURE * c.bore_area * np.abs(a).max() for c, a in pairs]
        assert [digging.value, digging.limit] == pytest.approx(
            [torque[0], 0.95 * torque[1]], rel=1e-3
        )
        assert digging.slack < 0
    if cylinder == "bucket":
        angles = [m.transmission_angles(q, c).min() for m, c in ((new, part), (old, before))]
        digging = checks["transmission.bucket"]
        assert digging.value == pytest.approx(angles[0], rel=1e-3)
        # or today's, if lower
        assert digging.limit == pytest.approx(min(math.radians(40), angles[1]), rel=1e-3)


def test_digging_torque_is_stated_where_it_asks_for_more_than_torque() -> None:
    """Largest torque extending is the same number: with a lower share digging says nothing."""
    for torque, wanted in (
        (0.95, set()),
        (0.9, {"digging.stick", "digging.bucket"}),
        ({"default": 0.95, "bucket": 0.94}, {"digging.bucket"}),
    ):
        checks = own(torque_share=torque)
        assert {name for name in checks if name.startswith("digging.")} == wanted
        for name in wanted:
            extending = checks[name.replace("digging", "torque.extending")]
            assert checks[name].value == pytest.approx(extending.value, rel=1e-9)
            assert checks[name].limit > extending.limit
