"""Loops: plants and closed loops against closed forms and python-control."""

from __future__ import annotations

import math
from collections.abc import Callable

import control
import numpy as np
import pytest

import armdesign as ad
from armdesign.control.controller import Controller, Filter, closed_loop
from armdesign.control.loop_plant import loop_plant, workable
from armdesign.control.loops import FINE, Loops
from armdesign.control.map_parts import ControlOptions
from armdesign.control.settling import settling_time, tracking_error
from armdesign.control.tuning import Task, Tuned, damped, proportional
from tests.control.machines import WORST, many_plants, one_mass, rigid, worst_plant


def controller_of(position: float, pressure: float = 0.0, corner: float = 2.0) -> Controller:
    return Controller(
        position=np.full((1, 1), position),
        pressure=np.full((1, 1), pressure),
        corner=np.array([corner]),
    )


def test_modes_are_those_of_the_frequency_map() -> None:
    """Leakage and friction leave |λ| alone to first order."""
    machine = rigid()
    expected = ad.natural_modes(machine.at(WORST)).frequencies
    for damping in (None, 0.02):
        np.testing.assert_allclose(worst_plant(damping).frequencies, expected, rtol=2e-3)
    np.testing.assert_allclose(worst_plant().damping, 0.02)
    assert expected[0, 0] == pytest.approx(0.91, abs=0.005)


def test_stated_damping_is_the_damping_of_the_poles() -> None:
    poles = np.linalg.eigvals(worst_plant().A[0])
    swings = poles[poles.imag > 1e-3]
    np.testing.assert_allclose(-swings.real / np.abs(swings), 0.02, rtol=1e-9)


def test_slow_demands_move_the_pistons_as_asked() -> None:
    """Far below the modes jω R P = R K⁻¹ Rᵀ k: the identity, but for gravity's stiffness."""
    plant, machine = many_plants(), rigid()
    poses = machine.at(plant.q)
    omega = np.full((len(plant), 1), 1e-2)
    speeds = plant.moment_arms @ (1j * omega[0, 0] * plant.response(omega)[0][..., 0])
    turned = np.swapaxes(poses.moment_arms, 1, 2) * poses.oil_stiffness[:, None]
    expected = poses.moment_arms @ np.linalg.solve(poses.stiffness_matrix, turned)
    np.testing.assert_allclose(speeds, expected, atol=0.02)


def test_one_mass_is_the_textbook_loop() -> None:
    """G = K/(s (s²/ω² + 2ζ s/ω + 1)): critical K = 2ζω, margin there (2 − α)/(2 + α) of it."""
    omega, ratio, margin = 5.0, 0.02, 0.8284271
    plant = one_mass(omega, ratio)
    largest = 2 * ratio * omega * (2 - margin) / (2 + margin)
    figures = Loops.of(plant, FINE).figures(controller_of(largest))
    assert figures.margin[0] == pytest.approx(margin, rel=5e-3)
    for factor, sign in ((0.99, -1), (1.01, 1)):
        poles = np.linalg.eigvals(
            closed_loop(plant, controller_of(factor * 2 * ratio * omega))[0][0]
        )
        assert np.sign(poles.real.max()) == sign
    assert figures.bandwidth[0, 0] == pytest.approx(largest, rel=0.01)
    assert settling_time(plant, controller_of(largest))[0] == pytest.approx(
        math.log(50) / largest, rel=0.05
    )


@pytest.mark.parametrize("gain", [3e-3, 1e-3, 1e-5])
def test_bandwidth_far_below_the_modes(gain: float) -> None:
    """K of a slow loop, as python-control has it: below all frequencies of the grid, too."""
    plant, controller = one_mass(5.0, 0.02), controller_of(gain)
    loops = Loops.of(plant)
    assert (gain < loops.omega.min()) == (gain < 0.02)
    A, B, C = closed_loop(plant, controller)
    theirs = control.ss(A[0], B[0], C, 0).bandwidth(dbdrop=-20 * math.log10(math.sqrt(2)))
    assert theirs == pytest.approx(gain, rel=1e-3)
    assert loops.figures(controller).bandwidth[0, 0] == pytest.approx(theirs, rel=1e-3)


@pytest.mark.parametrize("filter", ["high-pass", "band-pass"])
@pytest.mark.parametrize("delay", [0.0, 0.02])
def test_state_space_is_the_frequency_response(filter: Filter, delay: float) -> None:
    """T of python-control from the state space with Padé's delay; exact delay in the loops."""
    plant = worst_plant(0.02, delay)
    controller = Controller(
        position=np.array([[1.0, 0.7, 1.5]]),
        pressure=np.array([[1.9e-4, 1e-4, 2e-4]]),
        corner=np.array([2.0]),
        filter=filter,
    )
    A, B, C = closed_loop(plant, controller)
    system = control.ss(A[0], B[0], C, np.zeros((3, 3)))
    omega = np.geomspace(0.1, 30, 40)
    loops = Loops(omega[None], *plant.response(omega[None]), plant.moment_arms)
    positions, pressures = (np.moveaxis(of[0], -1, 0) for of in (loops.positions, loops.pressures))
    inner = np.eye(3) + (
        (controller.pressure * controller.filtered(omega[None])[0][:, None])[:, :, None]
        * pressures
    )
    opened = positions @ np.linalg.inv(inner) @ plant.moment_arms * controller.position
    closed = opened @ np.linalg.inv(np.eye(3) + opened)
    theirs = system(1j * omega).transpose(2, 0, 1)
    np.testing.assert_allclose(closed, theirs, atol=1e-6)
    figures = Loops.of(plant, FINE).figures(controller)
    below = np.abs(closed[:, range(3), range(3)]) < math.sqrt(0.5)
    first = omega[below.argmax(axis=0)]
    np.testing.assert_allclose(figures.bandwidth[0], first, rtol=0.16)


def test_settling_of_python_control() -> None:
    """The step of ``control.step_response`` settled to 2 %."""
    plant = worst_plant()
    controller = Controller(
        position=np.full((1, 3), 1.0), pressure=np.full((1, 3), 1.9e-4), corner=np.array([2.0])
    )
    A, B, C = closed_loop(plant, controller)
    system = control.ss(A[0], B[0], C, np.zeros((3, 3)))
    time = np.linspace(0, 20, 4001)
    step = control.step_response(system, time, input=0, output=0)
    outside = np.abs(np.ravel(step.outputs) - 1) > 0.02
    last = time[np.flatnonzero(outside)[-1]]
    assert last <= settling_time(plant, controller)[0] < 1.5 * last


@pytest.mark.parametrize("tuned", [proportional, damped])
def test_settling_with_poles_that_hardly_show(tuned: Callable[[Task], Tuned]) -> None:
    """Leakage turns chambers with air slowly, by 1 to 3 % of a step: python-control's settles.

    It does so no later than is said, though none of these poles alone delays it.
    """
    changes = {
        "fluid.entrained_air_percent": 0.5,
        "cylinder.lift.valve.leakage_l_per_min_per_bar": 0.001,
    }
    machine = ad.load("paper_1dof").replace(changes)
    plant = loop_plant(machine, machine.at(ad.Workspace.grid(machine, points=4).q))
    controller = tuned(Task(plant, Loops.of(plant), ControlOptions().aim)).controller
    A, B, C = closed_loop(plant, controller)
    for pose, said in enumerate(settling_time(plant, controller)):
        time = np.linspace(0, 2 * said, 4001)
        step = control.step_response(control.ss(A[pose], B[pose], C, 0), time).outputs
        last = time[np.flatnonzero(np.abs(np.ravel(step) - 1) > 0.02)[-1]]
        assert last < said < 1.5 * last


def test_ramps_lag_by_speed_over_gain() -> None:
    """The error of a move at constant speed is 1/K of it, but for gravity's stiffness.

    That is 7 % at the bucket, and pressures that change with the pose; of one mass none.
    """
    alone = Controller(position=np.full((1, 1), 0.3), pressure=np.ones((1, 1)), corner=np.ones(1))
    assert tracking_error(one_mass(5.0, 0.02), alone)[0, 0] == pytest.approx(1 / 0.3, rel=2e-3)
    plant, position = worst_plant(), np.array([[0.8, 1.1, 0.9]])
    controller = Controller(
        position=position, pressure=np.full((1, 3), 1.9e-4), corner=np.array([2.0])
    )
    error = tracking_error(plant, controller)
    np.testing.assert_allclose(error[:, :2], 1 / position[:, :2], rtol=5e-3)
    A, B, C = closed_loop(plant, controller)
    system, time = control.ss(A[0], B[0], C, np.zeros((3, 3))), np.linspace(0, 40, 2001)
    ramp = control.forced_response(system, time, np.outer([0, 0, 1.0], time)).outputs
    assert error[0, 2] == pytest.approx(time[-1] - ramp[2, -1], rel=1e-3)


def test_poses_at_which_no_controller_works() -> None:
    """Beyond the supply's pressure a valve cannot lift."""
    machine = ad.load("excavator_20t").with_payload("full")
    q = machine.at(WORST)
    assert workable(machine, q).all()
    weak = machine.replace({"supply.pressure_bar": 60}).with_payload("full")
    assert not workable(weak, weak.at(WORST)).any()


def test_poses_without_gains_have_figures_of_0() -> None:
    """Of one among others, whose figures are those it has alone."""
    plant = many_plants()
    loops, position = Loops.of(plant), np.full((len(plant), 3), 0.1)
    position[1:] = 0.0
    controller = Controller(
        position=position, pressure=np.zeros_like(position), corner=np.full(len(plant), 2.0)
    )
    alone = loops[:1].figures(controller[np.array([0])])
    for values, one in zip(loops.figures(controller), alone, strict=True):
        np.testing.assert_array_equal(values[1:], 0.0)
        np.testing.assert_allclose(values[:1], one, rtol=1e-12)


def test_damping_that_is_none() -> None:
    machine = ad.load("paper_1dof")
    poses = machine.at([0.0])
    with pytest.raises(ad.ArmDesignError, match="no bandwidth can rest on that; state it"):
        loop_plant(machine, poses)
    assert loop_plant(machine, poses, 0.02).damping == pytest.approx(0.02)
    for wrong in (0.0, 1.0, -0.1, math.nan):
        with pytest.raises(ad.ArmDesignError, match="damping"):
            loop_plant(machine, poses, wrong)
    with pytest.raises(ad.ArmDesignError, match="delay"):
        loop_plant(machine, poses, 0.02, -0.1)
