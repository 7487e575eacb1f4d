"""Time laws: the fastest within limits, beside closed forms; what a path of a machine allows."""

from __future__ import annotations

import math

import numpy as np
import pytest

import armdesign as ad
from armdesign.motion.path_limits import PathLimits, path_limits
from armdesign.motion.time_law import fastest
from armdesign.motion.trajectory import fastest_leg, trajectory
from tests import machines

POINTS = 401


def limits_of(speed: float, acceleration: float) -> PathLimits:
    """|σ̇| ≤ speed, |σ̈| ≤ acceleration everywhere."""
    ones = np.ones((POINTS, 1))
    both = np.hstack([ones, -ones])
    most = np.full(POINTS, speed**2)
    return PathLimits(most, both, 0 * both, acceleration * np.ones((POINTS, 2)))


@pytest.mark.parametrize(
    ("speed", "acceleration", "expected"),
    [
        (1.0, 2.0, 1 / 1.0 + 1.0 / 2.0),  # trapezoid: 1/v + v/a
        (0.5, 8.0, 1 / 0.5 + 0.5 / 8.0),
        (10.0, 3.0, 2 / math.sqrt(3.0)),  # triangle: 2/√a
    ],
)
def test_constant_limits_make_a_trapezoid(
    speed: float, acceleration: float, expected: float
) -> None:
    law = fastest(limits_of(speed, acceleration), "move")
    assert law.duration == pytest.approx(expected, rel=3e-3)  # the first of 400 intervals
    assert law.speed.max() <= speed * (1 + 1e-9)
    slower = law.stretched(2.0)
    assert slower.duration == pytest.approx(2 * law.duration)
    time = np.linspace(-0.1, slower.duration + 0.1, 2001)
    sigma, rate, acceleration_ = slower.at(time)
    assert (sigma[0], sigma[-1], rate[0], rate[-1]) == (0, 1, 0, 0)
    np.testing.assert_allclose(np.gradient(sigma, time)[1:-1], rate[1:-1], atol=2e-3)
    assert np.abs(acceleration_).max() <= acceleration / 4 * (1 + 1e-6)


def test_a_load_that_the_pump_cannot_lift() -> None:
    """The reliefs, 385 bar, hold it, but the pump has 350 bar."""
    machine = ad.load("excavator_20t")
    poses = np.array([0.0, -0.8, -1.0]), np.array([0.1, -0.8, -1.0])
    forces = [machine.with_payload(m).at(poses[0]).cylinder_forces[0, 0] for m in (1000, 2000)]
    lifted = 350e5 * machine.cylinders[0].bore_area
    mass = 1000 + 1000 * (1.04 * lifted - forces[0]) / (forces[1] - forces[0])
    message = "move: the pump's 350 bar cannot move boom against its load; give a lighter payload"
    with pytest.raises(ad.ArmDesignError, match=message):
        path_limits(machine.with_payload(float(mass)), *poses, 11, 0.7)


@pytest.mark.parametrize("name", ["excavator_20t", "heavy_bars", "slewing"])
def test_forces_by_speed_are_those_of_changing_inertia(name: str) -> None:
    """Rᵀ F = Ṁ Δ − ½ ∇(Δᵀ M Δ), by differences of M.

    F is the last of each actuator's four rows.
    """
    machine = machines.named(name).with_payload(0.0)
    start, end = machines.inner_poses(machine, 2)
    along, nq, step = end - start, len(start), 1e-4
    forces = path_limits(machine, start, end, 5, 0.7).b[:, 3::4]
    poses = machine.at(start + np.linspace(0, 1, 5)[:, None] * along)
    slopes = []
    for shift in step * np.eye(nq):
        ahead, behind = (machine.at(poses.q + s * shift).mass_matrix for s in (1, -1))
        slopes.append((ahead - behind)[:, :nq, :nq] @ along / (2 * step))  # ∂M/∂q_j Δ
    rates = np.stack(slopes, axis=1)
    torque = np.einsum("njk,j->nk", rates, along) - 0.5 * rates @ along
    held = np.einsum("nij,ni->nj", poses.moment_arms[..., :nq], forces)
    np.testing.assert_allclose(held, torque, atol=1e-6 * np.abs(poses.gravity_torque).max())


def test_pump_flow_is_shared_and_used() -> None:
    """Boom and stick together: their flows add up to the share of the pump's and no more; half the
    pump takes about twice as long.
    """
    machine = ad.load("excavator_20t").with_payload("full")
    start, end = np.array([-0.3, -1.2, -1.7]), np.array([0.3, -1.6, -1.7])
    leg = fastest_leg(machine, start, end, 0.7)
    plan = trajectory([leg], ad.Shaper.none())
    arms = machine.at(plan.q).moment_arms
    speeds = np.einsum("ncj,nj->nc", arms, plan.velocity)
    areas = [
        np.where(speeds[:, i] > 0, actuator.bore_area, actuator.annulus_area)
        for i, actuator in enumerate(machine.actuators)
    ]
    flow = (np.abs(speeds) * np.stack(areas, axis=1)).sum(axis=1)
    assert flow.max() == pytest.approx(0.7 * machine.supply.flow, rel=0.01)
    half = machine.replace({"supply.flow_l_per_min": 214.5}).with_payload("full")
    assert 1.6 < fastest_leg(half, start, end, 0.7).law.duration / leg.law.duration < 2.0


def test_a_heavier_load_starts_more_slowly() -> None:
    """Pressure limits acceleration: with a tenth of the force to spare it takes longer, the more
    the heavier the load.
    """
    machine = ad.load("excavator_20t")
    start, end = np.array([-0.1, -1.6, -1.3]), np.array([0.0, -1.6, -1.3])
    durations = [
        fastest(path_limits(machine.with_payload(mass), start, end, 101, share), "m").duration
        for mass in (1600.0, 4000.0)
        for share in (1.0, 0.1)
    ]
    assert durations[1] > 1.5 * durations[0]
    assert durations[2] > durations[0]


def test_legs_follow_each_other() -> None:
    """Every leg ends at rest at its pose, and the shaper's delay counts for each."""
    machine = ad.load("paper_1dof")
    legs = [
        fastest_leg(machine, np.array([a]), np.array([b]), 0.7) for a, b in [(-0.4, 0.1), (0.1, 0)]
    ]
    shaper = ad.Shaper.zvd(10.0)
    planned = trajectory(legs, shaper)
    first = legs[0].law.duration + shaper.delay
    assert planned.duration == pytest.approx(first + legs[1].law.duration + shaper.delay)
    between = np.interp(first, planned.time, planned.q[:, 0])
    assert [planned.q[0, 0], between, planned.q[-1, 0]] == pytest.approx([-0.4, 0.1, 0], abs=1e-4)
    assert abs(np.interp(first, planned.time, planned.velocity[:, 0])) < 0.05
    steps = np.diff(planned.q[:, 0]) / np.diff(planned.time)
    np.testing.assert_allclose(steps, planned.velocity[1:, 0], atol=0.2)
