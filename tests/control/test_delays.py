"""Delays of many periods of the fastest mode, against a line that holds commands back."""

from __future__ import annotations

import control
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import expm

import armdesign as ad
from armdesign.control.controller import Controller, pade_delay
from armdesign.control.loop_plant import LoopPlant, loop_plant
from armdesign.control.loops import Loops
from armdesign.control.map_parts import ControlOptions
from armdesign.control.own_bandwidths import Schemes
from armdesign.control.settling import settling_time
from armdesign.control.tuning import Task

AIM = ControlOptions().aim
HELD = 80  # steps of a delay: the hold of a step adds half of one to it


def plants(delay: float) -> LoopPlant:
    """Of one joint with modes up to 31 Hz, at 15 poses without load."""
    machine = ad.load("patu_boom").with_payload("empty")
    return loop_plant(machine, machine.at(ad.Workspace.grid(machine, points=15).q), None, delay)


def stepped(plant: LoopPlant, controller: Controller, pose: int, duration: float) -> np.ndarray:
    """The joint of a pose after a unit step of its command, in steps of the delay / ``HELD``.

    Plant, spool and high-pass filter step exactly; what the controller asks for waits in a line.
    """
    plant, controller = plant[[pose]], controller[[pose]]
    size, spool, damping = plant.A.shape[1], plant.valve_omega[0], plant.valve_damping[0]
    corner, load = controller.corner[0], plant.load[0]
    A = np.zeros((size + 4, size + 4))  # states, spool position and speed, filter, demand
    A[:size, :size], A[:size, size] = plant.A[0], plant.B[0, :, 0]
    A[size, size + 1] = 1.0
    A[size + 1, [size, size + 1, size + 3]] = -(spool**2), -2 * damping * spool, spool**2
    A[size + 2, :size], A[size + 2, size + 2] = corner * load, -corner
    step = expm(A * plant.delay / HELD)
    line, state = np.zeros(HELD), np.zeros(size + 4)
    wanted = plant.moment_arms[0, 0, 0] * controller.position[0, 0]
    joint = []
    for k in range(round(duration / plant.delay * HELD)):
        state[-1] = line[k % HELD]
        pressure = load @ state[:size] - state[size + 2]
        line[k % HELD] = wanted * (1 - state[0]) - controller.pressure[0, 0] * pressure
        state = step @ state
        joint.append(state[0])
    return np.array(joint)


@pytest.mark.parametrize("delay", [0.04, 0.07])
def test_loops_are_stable_behind_a_true_delay(delay: float) -> None:
    """At 31 Hz the commands lag by 7.8 and 14 rad; and steps have settled when it is said."""
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


@pytest.mark.parametrize("sections", [0, 1, 2, 7])
def test_sections_are_a_delay(sections: int) -> None:
    """e^(−s T) as python-control evaluates the state space, up to 2 rad for each section."""
    T = 0.1 if sections else 0.0
    system = control.ss(*pade_delay(T, sections, 2))
    omega = np.linspace(0, 2 * sections / 0.1, 9)
    theirs = np.exp(-1j * omega * T)
    ours = system(1j * omega) if sections else np.tile(np.eye(2)[:, :, None], 9)
    assert_allclose(ours, np.eye(2)[:, :, None] * theirs, atol=0.002 * max(sections, 1))
