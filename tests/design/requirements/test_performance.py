"""Performance of actuators: torque curves, stroke times and joint speeds."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from armdesign.design.requirements.performance import performances
from tests.design.requirements.shared import FLOW, PRESSURE, shipped_reference
from tests.machines import named


@pytest.mark.parametrize("name", ["excavator_20t", "mini_excavator_2t"])
def test_torques_and_speeds_by_the_independent_reference(name: str) -> None:
    """Planar reference, complex step of the length: p A r, and Q = A r q̇ at every pose."""
    machine = named(name)
    reference = shipped_reference(machine)
    pressure, flow = machine.supply.pressure, machine.supply.flow
    for i, performance in enumerate(performances(machine)):
        cylinder = reference.cylinders[i]
        q = reference.along(reference.joint_of[i], performance.q)
        arm = abs(reference.moment_arms(q)[:, i, performance.joint])
        areas = cylinder.bore_area, cylinder.annulus_area
        assert_allclose(performance.arm, arm, rtol=1e-9)
        assert_allclose(performance.torque, [pressure * a * arm for a in areas], rtol=1e-9)
        assert_allclose(performance.speed, [flow / (a * arm) for a in areas], rtol=1e-9)
        scan = abs(reference.joint_scan(cylinder, machine.ranges)[2]).max()
        assert_allclose(performance.largest, [pressure * a * scan for a in areas], rtol=1e-5)
        # at these speeds the whole stroke takes as long as the pump needs to fill it
        times = ((1 / s[:-1] + 1 / s[1:]) / 2 @ np.diff(performance.q) for s in performance.speed)
        used = np.ptp(reference.lengths(q)[:, i]) / cylinder.stroke
        assert list(times) == pytest.approx(list(used * performance.stroke_time), rel=1e-3)


def test_stroke_times_by_hand() -> None:
    """Boom of the 20 t machine: two of 120/85 mm over 1260 mm at 429 l/min."""
    boom = performances(named("excavator_20t"))[0]
    bore, annulus = (2 * math.pi / 4 * d2 for d2 in (0.12**2, 0.12**2 - 0.085**2))
    assert boom.stroke_time == pytest.approx([bore * 1.26 / FLOW, annulus * 1.26 / FLOW])
    assert PRESSURE * bore * boom.arm.max() == pytest.approx(boom.largest[0], rel=1e-4)


def test_a_motor_turns_evenly() -> None:
    """Displacement × gear ratio per turn: speed and torque are the same at every position."""
    machine = named("rotator")
    motor = machine.motors[0]
    turn = next(p for p in performances(machine) if machine.actuators[p.actuator] is motor)
    per_radian = 2 * 160e-6 * 24 / (2 * math.pi)  # two of 160 cm³ on a gear of 24
    assert_allclose(turn.torque, machine.supply.pressure * per_radian, rtol=1e-12)
    assert_allclose(turn.speed, machine.supply.flow / per_radian, rtol=1e-12)
    angle = np.ptp(machine.ranges[turn.joint])
    assert turn.stroke_time == pytest.approx(2 * [per_radian * angle / machine.supply.flow])
