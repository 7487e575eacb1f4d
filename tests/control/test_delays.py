"""Loops behind delays, short and of many periods of a mode, against a line that holds commands."""

from __future__ import annotations

import math
from dataclasses import replace

import control
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import expm

import armdesign as ad
from armdesign.control.controller import Controller, closed_loop, pade_delay
from armdesign.control.critical_gain import critical_factor
from armdesign.control.loop_plant import LoopPlant, loop_plant, workable
from armdesign.control.loops import Loops
from armdesign.control.map_parts import ControlOptions
from armdesign.control.own_bandwidths import Schemes
from armdesign.control.settling import settling_time, tracking_error
from armdesign.control.stability import stable
from armdesign.control.tuning import Task, damped, proportional
from armdesign.frequency.modes import natural_modes
from tests.control.machines import one_mass

AIM = ControlOptions().aim
SLOW = pytest.mark.slow
# The hold of a step adds half of one to the delay: less than 1 % of it, and 0.05 rad at 100 rad/s.
HELD, STEP = 80, 1e-3


def plants(delay: float) -> LoopPlant:
    """Of one joint with modes up to 31 Hz, at 15 poses without load."""
    machine = ad.load("patu_boom").with_payload("empty")
    return loop_plant(machine, machine.at(ad.Workspace.grid(machine, points=15).q), None, delay)


def loaded_plants(name: str, delay: float, damping: float | None = 0.02) -> LoopPlant:
    """Of a machine under its last load case, at random poses."""
    machine = ad.load(name)
    machine = machine.with_payload(machine.payloads[-1].name)
    low, high = machine.range_within(0.05).T
    q = np.random.default_rng(5).uniform(low, high, (400, len(low)))
    poses = machine.at(q[machine.holds(q)][:30])
    return loop_plant(machine, poses[workable(machine, poses)], damping, delay)


def stepped(plant: LoopPlant, controller: Controller, pose: int, duration: float) -> np.ndarray:
    """The joints (steps, nq) of a pose after unit steps of all their commands.

    Plant, spools and high-pass filters step exactly; what the controller asks for waits in a line.
    """
    plant, controller = plant[[pose]], controller[[pose]]
    size, nq, nc = plant.A.shape[1], plant.joints, plant.B.shape[2]
    one, spool = np.eye(nc), np.diag(plant.valve_omega**2)
    x, place, speed, filtered, demand = np.split(
        np.arange(size + 4 * nc), np.cumsum([size, nc, nc, nc])
    )
    A = np.zeros((size + 4 * nc, size + 4 * nc))
    A[np.ix_(x, x)], A[np.ix_(x, place)] = plant.A[0], plant.B[0]
    A[np.ix_(place, speed)], A[np.ix_(speed, place)] = one, -spool
    A[np.ix_(speed, speed)] = -2 * np.diag(plant.valve_damping * plant.valve_omega)
    A[np.ix_(speed, demand)] = spool
    A[np.ix_(filtered, x)] = controller.corner[0] * plant.load
    A[np.ix_(filtered, filtered)] = -controller.corner[0] * one
    held = max(HELD, math.ceil(plant.delay / STEP))
    step, size_of_step = expm(A * plant.delay / held), plant.delay / held
    line, state = np.zeros((held, nc)), np.zeros(len(A))
    wanted = plant.moment_arms[0] * controller.position[0]
    joints = np.empty((round(duration / size_of_step), nq))
    for k in range(len(joints)):
        state[demand] = line[k % held]
        pressure = plant.load @ state[x] - state[filtered]
        line[k % held] = wanted @ (1 - state[:nq]) - controller.pressure[0] * pressure
        state = step @ state
        joints[k] = state[:nq]
    return joints


@pytest.mark.parametrize("delay", [0.04, 0.07, pytest.param(0.25, marks=SLOW)])
def test_loops_are_stable_behind_a_true_delay(delay: float) -> None:
    """At 31 Hz the commands lag by 7.8 to 49 rad; and steps have settled when it is said."""
    plant = plants(delay)
    found = Schemes.of(Task(plant, Loops.of(plant), AIM))
    for tuned in (found.proportional, found.damped, found.own):
        settling = settling_time(plant, tuned.controller)
        for pose in np.flatnonzero(tuned.controller.position.all(axis=1)):
            duration = 1.5 + 1.5 * min(settling[pose], 3.0)
            joint = stepped(plant, tuned.controller, pose, duration)
            assert np.abs(joint).max() < 3
            rest = joint[len(joint) // 2 :]
            if settling[pose] < 3:
                assert np.abs(rest - 1).max() < 0.05


@SLOW
@pytest.mark.parametrize(
    ("name", "delay"),
    [
        ("loader_crane", 0.25),
        ("loader_crane", 1.0),
        ("excavator_20t", 0.25),
        ("excavator_20t", 3.0),
        ("mini_excavator_2t", 0.12),
    ],
)
def test_several_loops_behind_long_delays(name: str, delay: float) -> None:
    """Stable, settled when it is said; stable below the critical gains, not beyond."""
    plant = loaded_plants(name, delay)[np.arange(12)]
    found = Schemes.of(Task(plant, Loops.of(plant), AIM))
    tried = 0
    for tuned in (found.proportional, found.individual, found.own):
        controller = tuned.controller
        settling, critical = settling_time(plant, controller), critical_factor(plant, controller)
        for pose in np.flatnonzero((settling < 60 + 20 * delay) & (critical < 6))[:4]:
            joints = stepped(plant, controller, pose, 1.5 * settling[pose])
            assert np.abs(joints).max() < 4
            assert np.abs(joints[round(len(joints) / 1.4) :] - 1).max() < 0.05
            for factor in (0.9, 1.1):
                gains = controller.position * factor * critical[pose]
                raised = replace(controller, position=gains)
                thirds = np.array_split(stepped(plant, raised, pose, 150 * delay), 3)
                first, last = (np.ptp(part, axis=0).max() for part in thirds[1:])
                assert (last < first) == (factor < 1)
            tried += 1
    assert tried > 3


@pytest.mark.parametrize("factor", [0.3, 1.0, 1.6, 2.4, 3.2, 4.5])
@pytest.mark.parametrize(("name", "delay"), [("loader_crane", 0.2), ("excavator_20t", 0.1)])
def test_turns_tell_what_poles_tell(name: str, delay: float, factor: float) -> None:
    """Against the eigenvalues with the delay approximated up to the fastest mode."""
    plant = loaded_plants(name, delay)
    filters = (ControlOptions(filter=filter).aim for filter in ("high-pass", "band-pass"))
    tasks = [Task(plant, Loops.of(plant), aim) for aim in filters]
    for tuned in (proportional(tasks[0]), *map(damped, tasks)):
        gains = {key: factor * getattr(tuned.controller, key) for key in ("position", "pressure")}
        controller = replace(tuned.controller, **gains)
        rightmost = np.linalg.eigvals(closed_loop(plant, controller)[0]).real.max(axis=1)
        certain = np.abs(rightmost) > 3e-3 * plant.omega
        certain |= np.abs(rightmost) < 1e-9
        assert certain.mean() > 0.7
        theirs = rightmost < plant.fastest_creep
        np.testing.assert_array_equal(stable(plant, controller)[certain], theirs[certain])


@pytest.mark.parametrize(
    ("name", "delay"), [("loader_crane", 0.25), ("loader_crane", 4.0), ("excavator_20t", 0.15)]
)
def test_margins_hold_between_the_frequencies_of_the_grid(name: str, delay: float) -> None:
    """On 20 000 frequencies, on which the delay turns by 0.1 rad at most."""
    plant = loaded_plants(name, delay)[np.arange(6)]
    task = Task(plant, Loops.of(plant), AIM)
    low, high = plant.band
    shares = np.linspace(0, 1, 20_000)
    omega = np.sort(
        np.concatenate(
            [
                low[:, None] * (high / low)[:, None] ** shares[::2],
                low[:, None] + (high - low)[:, None] * shares[::2],
            ],
            axis=1,
        )
    )
    dense = Loops.at(plant, omega)
    for tuned in (proportional(task), damped(task)):
        margin = dense.figures(tuned.controller).margin[tuned.controller.position.all(axis=1)]
        assert (margin > 0.97 * AIM.margin).all()


@pytest.mark.parametrize("delay", [0.01, 0.5, 3.0, 20.0])
def test_one_mass_behind_a_delay(delay: float) -> None:
    """The critical gain in closed form: the least of those at which K G(jω) is −1.

    As G = e^(−sT)/(s (s²/ω² + 2ζ s/ω + 1)) behind a fast valve.
    """
    omega, ratio, gain = 5.0, 0.3, 0.01
    plant = one_mass(omega, ratio, delay=delay)
    controller = Controller(
        position=np.full((1, 1), gain), pressure=np.zeros((1, 1)), corner=np.ones(1)
    )
    w = np.linspace(1e-4, 40, 4_000_001)
    loop = np.exp(-1j * w * delay) / (1j * w * (1 - (w / omega) ** 2 + 2j * ratio * w / omega))
    crosses = np.flatnonzero((loop.imag[1:] * loop.imag[:-1] < 0) & (loop.real[1:] < 0))
    critical = 1 / np.abs(loop[crosses]).max()
    for factor in (0.97, 1.03):
        raised = replace(controller, position=np.full((1, 1), factor * critical))
        assert stable(plant, raised)[0] == (factor < 1)


def test_figures_in_time_go_over_into_those_without_delay() -> None:
    """A delay of 10 µs changes nothing, though other formulas are in use."""
    none, hardly = (loaded_plants("excavator_20t", delay) for delay in (0.0, 1e-5))
    controller = damped(Task(none, Loops.of(none), AIM)).controller
    for figure in (settling_time, tracking_error, critical_factor):
        assert_allclose(figure(hardly, controller), figure(none, controller), rtol=0.02)


@pytest.mark.parametrize("turns", [0.0, 0.5, 3.0, 10.0, 40.0, 100.0])
def test_padé_is_a_delay(turns: float) -> None:
    """e^(−s T) as python-control evaluates the state space, to 0.001; nowhere louder."""
    T = 0.1 if turns else 0.0
    system = control.ss(*pade_delay(T, turns, 2))
    omega = np.linspace(0, 3 * turns / 0.1, 31)
    theirs = np.exp(-1j * omega * T)
    ours = system(1j * omega) if turns else np.tile(np.eye(2)[:, :, None], 31)
    assert_allclose(ours[:, :, :11], np.eye(2)[:, :, None] * theirs[:11], atol=1e-3)
    assert np.abs(ours).max() < 1 + 1e-9


def test_only_delays_of_many_periods_are_refused() -> None:
    """Some seconds work; the remedy is a delay that works, too."""
    machine = ad.load("patu_boom").with_payload("empty")
    poses = machine.at(ad.Workspace.grid(machine, points=3).q)
    with pytest.raises(ad.ArmDesignError, match=r"periods of the lowest mode.*give") as refused:
        ad.bandwidth_map(machine, ad.Workspace.grid(machine, points=3), delay=60.0)
    cases = [machine.with_payload(one.name) for one in machine.payloads]
    worked = [case.at(poses.q)[workable(case, case.at(poses.q))] for case in cases]
    lowest = min(float(natural_modes(some).frequencies.min()) for some in worked)
    assert f"{60 * lowest:.0f} periods of the lowest mode, {lowest:.3g} Hz" in str(refused.value)
    longest = float(str(refused.value).split("delay=")[1].rstrip(")"))
    plant = loop_plant(machine, poses, None, longest)
    assert longest > 1
    assert proportional(Task(plant, Loops.of(plant), AIM)).controller.position.all()
