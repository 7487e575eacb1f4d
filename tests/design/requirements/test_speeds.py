"""Speeds: flows by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import armdesign as ad
from armdesign import ArmDesignError, Requirements, Workspace
from armdesign.design.requirements.check import check
from armdesign.design.requirements.record import Check
from armdesign.design.requirements.speeds import Speed
from tests.design.requirements.shared import FLOW, own, reference
from tests.machines import named


def test_speed_is_swept_volume_over_stroke_time() -> None:
    """Over the range in T: flow = A ΔL/T, bore side extending, annulus side retracting; ℓ and r by
    the reference.

    The boom's cylinders extend as it rises, the stick's as it curls in (negative), by the machine
    file's comments.
    """
    old = reference()
    q = old.ranges
    for index, name, up in ((0, "boom", 1), (1, "stick", -1)):
        cylinder = old.cylinders[index]
        _, length, arm = old.joint_scan(cylinder, q)
        for sign, area in ((up, cylinder.bore_area), (-up, cylinder.annulus_area)):
            time = 4.0
            rate = sign * (q[index, 1] - q[index, 0]) / time
            at_mean, at_every = (
                Speed(name="s", joints={name: rate}, at=at) for at in ("mean", "every")
            )
            mean, every = (own(speeds=(speed,))["speed.s"] for speed in (at_mean, at_every))
            assert mean.value == pytest.approx(area * abs(length[-1] - length[0]) / time, rel=1e-6)
            # 181 poses
            assert every.value == pytest.approx(area * abs(rate) * np.abs(arm).max(), rel=1e-4)
            assert (mean.limit, mean.unit) == (pytest.approx(FLOW), "m³/s")
            assert mean.slack == pytest.approx(1 - mean.value / FLOW, rel=1e-9)


def test_functions_that_move_together_share_the_flow() -> None:
    """By hand for cylinders: 0.2 m/s × bores out, 0.1 m/s × annuli in; and a joint beside one is
    the sum of both.
    """
    boom, stick = 2 * math.pi / 4 * 0.12**2, math.pi / 4 * (0.14**2 - 0.1**2)
    both = Speed(name="both", cylinders={"boom": 0.2, "stick": -0.1})
    assert own(speeds=(both,))["speed.both"].value == pytest.approx(
        0.2 * boom + 0.1 * stick, rel=1e-12
    )
    parts = [Speed(name="b", joints={"boom": 0.2}), Speed(name="s", cylinders={"stick": -0.1})]
    together = Speed(name="t", joints={"boom": 0.2}, cylinders={"stick": -0.1})
    checks = own(speeds=(*parts, together))
    assert checks["speed.t"].value == pytest.approx(
        checks["speed.b"].value + checks["speed.s"].value, rel=1e-12
    )


def test_a_motor_draws_its_displacement() -> None:
    """By hand: V_g i/2π q̇, beside what the boom draws; with more speed than the pump's flow the
    requirement is missed.
    """
    machine = named("slewing")
    workspace = Workspace.grid(machine, points=2)

    def flow_of(*speeds: Speed) -> dict[str, Check]:
        requirements = replace(Requirements.of(machine), speeds=speeds)
        return {c.name: c for c in check(machine, machine, workspace, requirements)}

    motor = machine.section.motor["swing"]
    per_radian = motor.displacement_cm3 * 1e-6 * motor.gear_ratio / (2 * math.pi)
    swing = Speed(name="a", joints={"swing": -0.5})
    both = Speed(name="b", joints={"swing": -0.5, "boom": 0.2}, at="every")
    boom = Speed(name="c", joints={"boom": 0.2}, at="every")
    flows = flow_of(swing, both, boom)
    assert flows["speed.a"].value == pytest.approx(0.5 * per_radian, rel=1e-12)
    together = flows["speed.a"].value + flows["speed.c"].value
    assert flows["speed.b"].value == pytest.approx(together, rel=1e-12)
    too_fast = Speed(name="a", joints={"swing": 2 * machine.supply.flow / per_radian})
    assert flow_of(too_fast)["speed.a"].slack < 0


def test_speed_of_a_joint_that_a_cylinder_across_joints_moves() -> None:
    machine = named("crossing")
    requirements = Requirements(speeds=(Speed(name="a", joints={machine.joints[1]: 0.1}),))
    with pytest.raises(ArmDesignError, match="ask for the speed of the cylinder instead"):
        ad.optimize(machine, Workspace.grid(machine, points=4), requirements, starts=1)
