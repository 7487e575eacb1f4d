"""Spools that pass planned oil: by closed form, and in the plant."""

from __future__ import annotations

import math

import numpy as np
import pytest

import armdesign as ad
from armdesign.motion.compensation import CompensatedPlant
from armdesign.motion.feed_forward import SpoolPlan, spool_plan
from armdesign.simulation.plant.equilibrium import find_equilibrium
from armdesign.simulation.plant.plant import Plant
from tests import machines
from tests.simulation.valves import ideally_fed

POSE = np.array([[0.2, -1.5, -1.4]])


@pytest.fixture(scope="module")
def lossless() -> ad.Machine:
    """The 20 t machine with a full bucket, at a pump that holds its pressure."""
    return ideally_fed(machines.rigid("excavator_20t")).with_payload("full")


@pytest.mark.parametrize("speed", [0.05, 0.2, -0.05, -0.2])
def test_a_spool_is_the_closed_form_of_both_edges(lossless: ad.Machine, speed: float) -> None:
    """x = v √((A1³ + A2³)/(A1 p_s − A2 p_r − F))/K extending, and F − A1 p_r + A2 p_s retracting;
    laminar flow below 0.5 bar makes the difference.
    """
    poses, boom = lossless.at(POSE), lossless.cylinders[0]
    velocity = np.array([[speed / poses.moment_arms[0, 0, 0], 0.0, 0.0]])
    plan = spool_plan(lossless, POSE, velocity)
    a1, a2, force = boom.bore_area, boom.annulus_area, poses.cylinder_forces[0, 0]
    supply, back = lossless.supply.pressure, lossless.supply.return_pressure
    drop = a1 * supply - a2 * back - force if speed > 0 else force - a1 * back + a2 * supply
    assert boom.valve is not None
    expected = speed * math.sqrt((a1**3 + a2**3) / drop) / boom.valve.gain
    assert plan.spools[0, 0] == pytest.approx(expected, rel=1e-4)
    assert plan.speeds[0, 0] == pytest.approx(speed, rel=1e-12)
    assert plan.flow[0] == pytest.approx(abs(speed) * (a1 if speed > 0 else a2), rel=1e-12)
    assert not plan.spools[0, 1:].any()
    assert not plan.too_fast
    assert not plan.starving


def test_a_planned_speed_is_what_the_plant_then_has(lossless: ad.Machine) -> None:
    """The planned spool held open: after the start has rung out (a damped machine) the boom moves
    with the planned speed.
    """
    damped = lossless.replace({"cylinder.boom.friction.viscous_N_s_per_m": 2e6})
    damped = damped.with_payload("full")
    arm = damped.at(POSE).moment_arms[0, 0, 0]
    spool = spool_plan(damped, POSE, np.array([[0.02 / arm, 0.0, 0.0]])).spools[0, 0]
    run = ad.simulate(damped, POSE[0], {"boom": ad.Step(size=float(spool))}, duration=2.0)
    late = run.time > 1.5
    assert run.speeds[late, 0].mean() == pytest.approx(0.02, rel=0.02)


def test_what_a_valve_cannot_pass(lossless: ad.Machine) -> None:
    fast = spool_plan(lossless, POSE, np.array([[3.0, 0.0, 0.0]]))
    assert fast.too_fast == ("boom",)
    assert abs(fast.spools[0, 0]) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.slow
def test_overlap_is_crossed_and_leaks_are_made_up_for() -> None:
    """Overlap 10 %: x = 0.1 + 0.9 share. A leaking valve stands open at rest."""
    machine = ad.load("excavator_20t").with_payload("full")
    velocity = np.array([[0.1, 0.0, 0.0]])
    today = spool_plan(machine, POSE, velocity).spools[0, 0]
    lapped = machine.replace({"cylinder.boom.valve.overlap_percent": 10.0}).with_payload("full")
    spool = spool_plan(lapped, POSE, velocity).spools[0, 0]
    assert spool == pytest.approx(0.1 + 0.9 * today, rel=1e-9)
    change = {"cylinder.boom.valve.leakage_l_per_min_per_bar": 0.1}
    leaking = machine.replace(change).with_payload("full")
    holding = spool_plan(leaking, POSE, 0 * velocity).spools[0, 0]
    state = find_equilibrium(Plant(leaking), POSE[0]).state
    assert holding == pytest.approx(Plant(leaking).split(state)[4][0], rel=0.02)
    assert holding > 0


def test_springs_are_at_rest() -> None:
    """On a carriage that rocks the boom's valve opens as on rigid ground: the load is the same."""
    rocking, rigid = machines.named("rocking"), machines.rigid("excavator_20t")
    velocity = np.array([[0.1, 0.0, 0.0]])
    spools = [spool_plan(one, POSE, velocity).spools[0, 0] for one in (rocking, rigid)]
    assert spools[0] == pytest.approx(spools[1], rel=0.05)


def test_compensated_spools_move_a_piston_whose_force_does_not_change(
    lossless: ad.Machine,
) -> None:
    """Ḟ = k (v − ℓ̇): with the arm held (ℓ̇ = 0) the boom's force rises at k v, k its oil's
    stiffness, whatever its pressures, from the first instant on.
    """
    plant, speed = Plant(lossless), np.array([[0.01, 0.0, 0.0]])
    state = find_equilibrium(plant, POSE[0]).state
    boom = lossless.cylinders[0]
    static = spool_plan(lossless, POSE, np.array([[0.1, 0.0, 0.0]]))
    plan = SpoolPlan(
        *[np.tile(static.spools, (2, 1))] * 2, np.tile(speed, (2, 1)), np.zeros(2), (), ()
    )
    system = CompensatedPlant(plant, ((np.array([0.0, 1.0]), plan),))
    for offset in (0.0, 20.0, 60.0):  # [bar] more in the annulus, as in motion
        moved = state[None].copy()
        moved[:, plant.state_names.index("boom annulus pressure")] += offset
        rates = system.rates(np.zeros(1), moved)
        cap, annulus = (
            rates[0, plant.state_names.index(f"boom {side} pressure")] * 1e5
            for side in ("cap", "annulus")
        )
        stiffness = lossless.at(POSE).oil_stiffness[0, 0]
        force_rate = boom.bore_area * cap - boom.annulus_area * annulus
        assert force_rate == pytest.approx(0.01 * stiffness, rel=1e-6)


def test_compensation_opens_half_as_far_again_at_most(lossless: ad.Machine) -> None:
    """With the cap near supply pressure hardly anything flows in, however far the valve opens."""
    plant = Plant(lossless)
    static = spool_plan(lossless, POSE, np.array([[0.1, 0.0, 0.0]]))
    plan = SpoolPlan(*(np.tile(values, (2, 1)) for values in static[:3]), np.zeros(2), (), ())
    system = CompensatedPlant(plant, ((np.array([0.0, 1.0]), plan),))
    state = find_equilibrium(plant, POSE[0]).state[None].copy()
    state[:, plant.state_names.index("boom cap pressure")] = 349.9
    spools = system.spools(np.zeros(1), state)
    assert spools[0, 0] == pytest.approx(1.5 * static.spools[0, 0], rel=1e-9)
