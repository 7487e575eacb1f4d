"""Closed loops in nonlinear simulation, of every shipped machine."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import armdesign as ad
from armdesign.arrays import Array
from armdesign.control.controller import Controller
from armdesign.control.critical_gain import MOST_CRITICAL, critical_factor
from armdesign.control.loop_plant import loop_plant, workable
from armdesign.control.loops import Loops
from armdesign.control.tuning import Aim, Task, damped, proportional
from armdesign.machine.loading import shipped
from tests.control.closed_loop_run import closed_loop_run
from tests.control.machines import single_pose

CALIBRATED, YIELDING = "calibrated", "cylinder.lift.compliance_m_per_N"
POSES, MANY = 20, 2_000.0  # poses of each machine; periods of a swing that hardly grows
SLOW = 0.2  # [ω of the slowest spool] position gains of loops that are slow against it
DATA_SHEET = {YIELDING: 0.0, "fluid.entrained_air_percent": 0.0, "fluid.bulk_modulus_MPa": 1200.0}


def loaded(name: str) -> ad.Machine:
    """Under its last load case; the paper's machine, which has no damping, with some friction.

    ``CALIBRATED``: the crane of the data sheet, fitted to its recording as in study 08.
    """
    machine = ad.load("loader_crane" if name == CALIBRATED else name)
    if name == CALIBRATED:
        measured = machine.source.parent / "measured.csv"
        machine = ad.calibrate(machine.replace(DATA_SHEET), measured, [YIELDING]).machine
    if name == "paper_1dof":
        friction = {"cylinder.lift.friction.viscous_N_s_per_m": 8000.0}
        machine = machine.replace(friction)
    return machine.with_payload(machine.payloads[-1].name)


def poses_of(machine: ad.Machine, count: int) -> Array:
    """Random poses of the whole ranges at which a controller can work under the load case."""
    low, high = machine.range_within(0.05).T
    q = np.random.default_rng(count).uniform(low, high, (40 * count, len(low)))
    q = q[machine.holds(q)]
    return q[workable(machine, machine.at(q))][:count]


def controllers_at(machine: ad.Machine, q: Array) -> list[Controller]:
    """With common gains, own gains, and own gains without pressure feedback; where there are."""
    plant = loop_plant(machine, machine.at(q))
    common = damped(Task(plant, Loops.of(plant), Aim(margin=0.8284271))).controller
    bandwidths, name = ad.bandwidth_map(machine, single_pose(machine, q)), machine.payload.name
    schedules = (ad.gain_schedule(bandwidths, name, feedback=fed) for fed in (True, False))
    return [one for one in (common, *(of([q]) for of in schedules)) if one.position.all()]


@pytest.mark.slow
@pytest.mark.parametrize("name", [*shipped(), CALIBRATED])
def test_nonlinear_damping_is_the_predicted_one(name: str) -> None:
    """Within 10 % at every pose and with all gains; growth at 1.3 × the critical gain."""
    machine, tried, grown = loaded(name), 0, 0
    for q in poses_of(machine, POSES):
        for controller in controllers_at(machine, q):
            for least_damped in (True, False):
                run = closed_loop_run(machine, q, controller, least_damped=least_damped)
                nonlinear, predicted = run.damping_ratios
                assert predicted > 0
                assert nonlinear == pytest.approx(predicted, rel=0.1)
                left = abs(run.predicted[-1])  # and what drifts
                assert abs(run.amplitude[-1]) < 0.05 + left
            tried += 1
            factor = critical_factor(loop_plant(machine, machine.at(q)), controller)[0]
            if factor == MOST_CRITICAL:  # stable even there
                continue
            more = replace(controller, position=1.3 * factor * controller.position)
            run = closed_loop_run(machine, q, more, periods=MANY, change=1.5)
            assert run.pole.real > 0
            assert run.nonlinear_pole.real > 0
            assert abs(run.amplitude[-1]) > 1.2
            grown += 1
    assert tried > 2 * POSES
    assert grown > 0.9 * tried


@pytest.mark.slow
def test_fast_swings_that_last_have_answered_their_mean() -> None:
    """Modes above twice the valve's frequency: within 1.5 % in six periods, 1 % in a hundred.

    In six periods the median is below 0.5 % and one of 27 poses above 1 %, 1.33 %: a share of the
    approximation, as it does not change with the size of the swing. Within 5 % where position
    loops are not slow against the spools, as the prediction takes them.
    """
    machine, errors = loaded("loader_crane"), list[float]()
    for q in poses_of(machine, 4 * POSES):
        controller = controllers_at(machine, q)[-2]  # own gains with pressure feedback
        run, plant = closed_loop_run(machine, q, controller), loop_plant(machine, machine.at(q))
        first, predicted = run.damping_ratios
        if run.pole.imag < 2 * plant.valve_omega.max():
            continue
        slow = controller.position.max() < SLOW * plant.valve_omega.min()
        smaller = closed_loop_run(machine, q, controller, swing=1e-4)
        assert smaller.damping_ratios[0] == pytest.approx(first, rel=0.01)
        assert first == pytest.approx(predicted, rel=0.015 if slow else 0.05)
        long = closed_loop_run(machine, q, controller, periods=100)
        assert long.damping_ratios[0] == pytest.approx(long.damping_ratios[1], rel=0.01)
        if slow:
            errors.append(abs(first / predicted - 1))
    assert len(errors) > POSES
    assert np.median(errors) < 0.005


def test_loops_without_pressure_feedback_run() -> None:
    """The linear loop has no filters then."""
    machine = loaded("patu_boom")
    q = poses_of(machine, 1)[0]
    plant = loop_plant(machine, machine.at(q))
    alone = proportional(Task(plant, Loops.of(plant), Aim(margin=0.8284271))).controller
    assert not alone.pressure.any()
    run = closed_loop_run(machine, q, alone, least_damped=False)
    assert run.damping_ratios[0] == pytest.approx(run.damping_ratios[1], rel=0.02)
