"""Closed loops in nonlinear simulation, of every shipped machine."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import armdesign as ad
from armdesign.arrays import Array
from armdesign.control.loop_plant import loop_plant
from armdesign.control.loops import Loops
from armdesign.control.tuning import Aim, Task, critical_factor, damped
from armdesign.machine.loading import shipped
from tests.control.closed_loop_run import closed_loop_run
from tests.control.machines import single_pose

CALIBRATED, YIELDING = "calibrated", "cylinder.lift.compliance_m_per_N"
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


def pose_of(machine: ad.Machine) -> Array:
    """A pose inside the ranges at which the load case exists."""
    low, high = machine.range_within(0.1).T
    middle = low + 0.6 * (high - low)
    others = np.random.default_rng(0).uniform(low, high, (500, len(low)))
    q = np.vstack([middle, others])
    return q[machine.holds(q)][0]


@pytest.mark.slow
@pytest.mark.parametrize("name", [*shipped(), CALIBRATED])
def test_nonlinear_damping_is_the_predicted_one(name: str) -> None:
    """Within 10 % at the chosen gains, own and common; growth at 1.3 × the critical gain."""
    machine = loaded(name)
    q = pose_of(machine)
    plant = loop_plant(machine, machine.at(q))
    task = Task(plant, Loops.of(plant), Aim(margin=0.8284271))
    bandwidths = ad.bandwidth_map(machine, single_pose(machine, q))
    own = ad.gain_schedule(bandwidths, machine.payload.name)([q])
    for controller in (damped(task).controller, own):
        assert (controller.position > 0).all()
        for least_damped in (True, False):
            run = closed_loop_run(machine, q, controller, least_damped=least_damped)
            nonlinear, predicted = run.damping_ratios
            assert predicted > 0
            assert nonlinear == pytest.approx(predicted, rel=0.1)
            left = abs(np.exp(run.pole * run.time[-1]))  # and what drifts
            assert abs(run.amplitude[-1]) < max(0.8, (1 + left) / 2)
    beyond = replace(own, position=1.3 * critical_factor(plant, own)[0] * own.position)
    run = closed_loop_run(machine, q, beyond)
    assert run.pole.real > 0
    assert run.nonlinear_pole.real > 0
    assert abs(run.amplitude[-1]) > 1.2
