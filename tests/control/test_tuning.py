"""Gains: figures of the 20 t machine's worst pose, and that no larger gain keeps the margin."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import control
import numpy as np
import pytest

import armdesign as ad
from armdesign.arrays import Array
from armdesign.control.bandwidth_map import GAIN_ERROR
from armdesign.control.controller import Controller, closed_loop
from armdesign.control.loop_plant import loop_plant, workable
from armdesign.control.loops import FINE, Loops
from armdesign.control.map_parts import ControlOptions
from armdesign.control.position_gains import individual
from armdesign.control.stability import stability, stable
from armdesign.control.tuning import (
    CLOSE,
    EXACT,
    LOSS_FACTORS,
    Aim,
    Task,
    best_of,
    damped,
    proportional,
)
from tests.control.machines import many_plants, one_mass, worst_plant

MARGIN = 2 * math.tan(math.pi / 8)  # 45 deg
EIGHT = 0.7, 0.5, 1.0, 0.35, 1.4, 0.2, 0.1, 0.04


def task_of(corner: float | None = None) -> Task:
    plant = worst_plant()
    return Task(plant, Loops.of(plant), Aim(margin=MARGIN, corner=corner))


def hertz(controller: Controller) -> np.ndarray:
    plant = worst_plant()
    return Loops.of(plant, FINE).figures(controller).bandwidth[0] / (2 * math.pi)


def test_position_loops_alone_reach_next_to_nothing() -> None:
    """By hand: the mode carries K/2ζω, so K = 2ζω (2 − α)/(2 + α) = 0.095 1/s, 0.015 Hz.

    A trial had given 0.14 1/s and 0.022 Hz: by hand its margin is 2 (1 − x)/(1 + x) = 0.48 with x
    = 0.14/2ζω.
    """
    tuned = proportional(task_of())
    bound = 2 * 0.02 * worst_plant().omega[0] * (2 - MARGIN) / (2 + MARGIN)
    assert bound == pytest.approx(0.0948, abs=2e-4)
    assert tuned.controller.position[0, 0] == pytest.approx(bound, rel=0.05)
    assert hertz(tuned.controller).max() == pytest.approx(0.015, abs=0.001)
    trial = Controller(
        position=np.full((1, 3), 0.14), pressure=np.zeros((1, 3)), corner=np.ones(1)
    )
    assert hertz(trial).max() == pytest.approx(0.022, abs=0.001)
    figures = Loops.of(worst_plant(), FINE).figures(trial)
    share = 0.14 / (2 * 0.02 * worst_plant().omega[0])
    assert figures.margin[0] == pytest.approx(2 * (1 - share) / (1 + share), abs=0.01)


def test_common_pressure_feedback_reaches_more_than_the_trial() -> None:
    """The trial: 0.84 1/s and 0.13 to 0.15 Hz in all three loops through a 0.5 s high-pass."""
    tuned = damped(task_of(corner=2.0))
    assert tuned.controller.position.min() >= 0.84
    assert hertz(tuned.controller).min() >= 0.15
    trial = Controller(
        position=np.full((1, 3), 0.84), pressure=np.full((1, 3), 1.9e-4), corner=np.array([2.0])
    )
    assert Loops.of(worst_plant(), FINE).figures(trial).margin[0] >= MARGIN
    np.testing.assert_allclose(hertz(trial), [0.15, 0.14, 0.13], atol=0.02)


def test_feed_forward_divides_the_error_of_a_move_by_five() -> None:
    """A move at constant speed, valves that pass 15 % less than the controller knows."""
    plant = worst_plant()
    weak = replace(plant, B=0.85 * plant.B)
    controller = Controller(
        position=np.full((1, 3), 0.84), pressure=np.full((1, 3), 1.9e-4), corner=np.array([2.0])
    )
    A, B, C = closed_loop(weak, controller)
    time = np.linspace(0, 30, 1501)
    system = control.ss(A[0], B[0], C, np.zeros((3, 3)))
    errors = []
    for forward in (0.0, 1.0):  # q̇_r enters where K q_r does: as q_r + q̇_r/K
        demand = np.zeros((3, len(time)))
        demand[0] = time + forward / 0.84
        answer = control.forced_response(system, time, demand).outputs
        errors.append(abs(time[-1] - answer[0, -1]))
    assert errors[0] > 5 * errors[1]
    assert errors[1] == pytest.approx(GAIN_ERROR / 0.84, rel=0.2)


def test_gains_keep_the_margin_and_larger_ones_do_not() -> None:
    """At 50 poses with the file's damping; each controller's loops are stable."""
    plant = many_plants()
    task = Task(plant, Loops.of(plant), Aim(margin=MARGIN))
    for tuned in (proportional(task), damped(task)):
        controller = tuned.controller
        fine = Loops.of(plant, FINE, stability(plant, controller).ringing)
        assert (controller.position > 0).all()
        assert (fine.figures(controller).margin >= MARGIN * (1 - 1e-6)).all()
        assert stable(plant, controller).all()
    larger = Controller(
        position=1.12 * proportional(task).controller.position,
        pressure=np.zeros((len(plant), 3)),
        corner=plant.omega,
    )
    assert (fine.figures(larger).margin < MARGIN).mean() > 0.9


def crane(close: float = CLOSE) -> Task:
    """Of the loader crane at poses all over, whose modes are damped by 0.02 % and less."""
    machine = ad.load("loader_crane").with_payload("full")
    space = ad.Workspace.sobol(machine, 64)
    poses = machine.at(space.q[machine.holds(space.q)])
    plant = loop_plant(machine, poses)[np.flatnonzero(workable(machine, poses))]
    return Task(plant, Loops.of(plant), Aim(margin=MARGIN), close)


def test_gains_that_are_reduced_keep_the_margin_where_they_then_ring() -> None:
    """Between frequencies of any grid."""
    task = crane()
    for controller in (damped(task).controller, individual(task, proportional(task)).controller):
        ringing = stability(task.plant, controller).ringing
        about = np.concatenate([ringing * share for share in (0.997, 0.9995, 1.0, 1.003)], axis=1)
        there = Loops.at(task.plant, np.sort(about, axis=1))
        assert (there.figures(controller).margin >= 0.98 * MARGIN).all()  # before: 0.62 and more


def test_no_loss_factor_leaves_larger_gains_than_the_one_that_is_chosen() -> None:
    """The largest gains before some are reduced are often reduced the most."""
    task = crane(EXACT)

    def largest(loss_factors: Sequence[float]) -> Array:
        return task.without_units(best_of(task, loss_factors).controller)[0][:, 0]

    best = largest(LOSS_FACTORS)
    for eta in LOSS_FACTORS[1::2]:
        assert (best >= 0.999 * largest((eta,))).all()  # before: 0.54 and more


def test_few_loss_factors_leave_much_wider_loops_than_the_one_that_is_found() -> None:
    """Of forty tried one by one. With the best of eight they were half as wide."""
    machine = ad.load("mini_excavator_2t")
    plant = loop_plant(machine, machine.at(ad.Workspace.grid(machine, points=3).q))
    task = Task(plant, Loops.of(plant), Aim(margin=MARGIN))
    each = [best_of(task, (eta,)).figures.narrowest for eta in np.geomspace(0.02, 1.0, 40)]
    found, widest = damped(task).figures.narrowest, np.max(each, axis=0)
    before = np.max([best_of(task, (eta,)).figures.narrowest for eta in EIGHT], axis=0)
    assert (widest > 0).all()
    assert np.median(found / widest) > 1.0
    assert np.percentile(found / widest, 10) > 0.9
    assert np.median(found / before) > 1.5


def test_a_margin_that_no_gain_reaches_leaves_no_gains() -> None:
    plant = one_mass(5.0, 0.02)
    task = Task(plant, Loops.of(plant), Aim(margin=1.999))
    assert best_of(task, (0.0,)).controller.position[0, 0] <= 1e-3


def test_delay_costs_bandwidth() -> None:
    widths = []
    for delay in (0.0, 0.1):
        plant = worst_plant(0.02, delay)
        tuned = damped(Task(plant, Loops.of(plant), Aim(margin=MARGIN)))
        widths.append(tuned.figures.narrowest[0])
    assert widths[1] < 0.95 * widths[0]


def test_pressures_that_creep_with_air_take_no_bandwidth() -> None:
    """A pole to the right that no loop makes: pressures at rest rise ever faster."""
    machine = ad.load("excavator_20t")
    airy = machine.replace({"fluid.entrained_air_percent": 0.2})
    workspace = ad.Workspace.grid(machine, points=3)
    few = workspace.subset(np.flatnonzero(workspace.q[:, 0] < 0))
    plants = [loop_plant(each, each.at(few.q)) for each in (machine, airy)]
    assert plants[0].creep.max() < 1e-5 < 1e-3 < plants[1].creep.max() < 2e-3
    pole = plants[1].creep.argmax()
    poles, shapes = np.linalg.eig(plants[1].A[pole])
    shape = np.abs(shapes[:, poles.real.argmax()])
    assert shape[:6].max() < 1e-3 * shape.max()  # [rad, bar]
    for plant in plants:
        task = Task(plant, Loops.of(plant), ControlOptions().aim)
        assert (damped(task).figures.bandwidth > 2 * np.pi * 0.05).all()


@pytest.mark.parametrize(("valve", "delay"), [(2.0, 0.0), (1e4, 0.6), (6.0, 0.2)])
def test_modes_whose_phase_is_turned_do_not_bound_gains(valve: float, delay: float) -> None:
    """Valves slower than the mode, and delays: the gain is that of a scan in closed form.

    Behind a fast valve without delay the mode rings from 2 ζω on.
    """
    omega, ratio = 5.0, 0.02
    plant = one_mass(omega, ratio, valve, delay)
    assert (plant.valve_damping == 1.0).all()
    s = 1j * np.geomspace(1e-3, 60, 40001)
    opened = np.exp(-delay * s) / (s / valve + 1) ** 2 / s
    opened *= omega**2 / (s**2 + 2 * ratio * omega * s + omega**2)
    late, early = control.pade(delay, 12) if delay else ([1.0], [1.0])
    ahead = np.polymul(np.polymul([1 / valve**2, 2 / valve, 1], [1, 0]), early)
    ahead = np.polymul(ahead, [1, 2 * ratio * omega, omega**2])
    largest = 0.0
    for gain in np.geomspace(0.01, 10, 2000):
        size = np.abs((1 - gain * opened) / (1 + gain * opened)) / 2
        poles = np.roots(np.polyadd(ahead, gain * omega**2 * np.asarray(late)))
        if 1 / size.max() < MARGIN or poles.real.max() >= 0:
            break
        largest = gain
    tuned = proportional(Task(plant, Loops.of(plant), Aim(margin=MARGIN)))
    assert tuned.controller.position[0, 0] == pytest.approx(largest, rel=0.06)
    assert largest > 1.5 * 2 * ratio * omega
