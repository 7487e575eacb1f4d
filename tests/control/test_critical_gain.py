"""Critical gains: in closed form, and where poles of the closed loops cross the axis."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

import armdesign as ad
from armdesign.control.controller import Controller, closed_loop
from armdesign.control.critical_gain import MOST_CRITICAL, critical_factor
from armdesign.control.loop_plant import LoopPlant, loop_plant, workable
from armdesign.control.loops import Loops
from armdesign.control.tuning import Aim, Task, damped, proportional
from tests.control.machines import one_mass

CLOSE = 1e-6


def position_loop(gain: float) -> Controller:
    return Controller(position=np.full((1, 1), gain), pressure=np.zeros((1, 1)), corner=np.ones(1))


def test_one_mass_on_oil() -> None:
    """K = 2ζω (Merritt 1967), but for a valve two thousand times as fast."""
    omega, ratio = 5.0, 0.05
    factor = critical_factor(one_mass(omega, ratio), position_loop(0.1))[0]
    assert factor == pytest.approx(2 * ratio * omega / 0.1, rel=2e-4)


def test_one_mass_behind_a_delay() -> None:
    """1 + G(jω) = 0 of G = K e^{−jωT}/(jω (1 − ω²/ω_0² + 2ζ jω/ω_0)) by its phase alone."""
    omega, ratio, delay = 5.0, 0.3, 0.2
    plant = one_mass(omega, ratio, valve=1e7, delay=delay)

    def beyond(at: float) -> float:
        return at * delay + math.atan2(2 * ratio * at / omega, 1 - (at / omega) ** 2) - math.pi / 2

    at = brentq(beyond, 0.1, omega)
    lag = complex(1 - (at / omega) ** 2, 2 * ratio * at / omega)
    factor = critical_factor(plant, position_loop(0.5))[0]
    assert factor == pytest.approx(at * abs(lag) / 0.5, rel=1e-5)


def loaded_plants(name: str, delay: float) -> LoopPlant:
    machine = ad.load(name)
    machine = machine.with_payload(machine.payloads[-1].name)
    low, high = machine.range_within(0.05).T
    q = np.random.default_rng(1).uniform(low, high, (400, len(low)))
    q = q[machine.holds(q)]
    q = q[workable(machine, machine.at(q))][:40]
    return loop_plant(machine, machine.at(q), delay=delay)


@pytest.mark.parametrize("delay", [0.0, 0.02])
@pytest.mark.parametrize("name", ["excavator_20t", "loader_crane", "patu_boom"])
def test_poles_cross_the_axis_there(name: str, delay: float) -> None:
    """No pole to the right a millionth below, one a millionth above; delays by Padé."""
    plant = loaded_plants(name, delay)
    task = Task(plant, Loops.of(plant), Aim(margin=0.8284271))
    for found in (proportional(task), damped(task)):
        controller = found.controller
        factor = critical_factor(plant, controller)
        exists = (factor > 0) & (factor < MOST_CRITICAL)
        assert exists.sum() > 10
        sides = [_rightmost(plant, controller, factor * (1 + off)) for off in (-CLOSE, CLOSE)]
        assert (sides[0][exists] < 0).all()
        assert (sides[1][exists] > 0).all()


def _rightmost(plant: LoopPlant, controller: Controller, factor: np.ndarray) -> np.ndarray:
    """Real part of the least stable pole that swings (n,)."""
    raised = replace(controller, position=controller.position * factor[:, None])
    poles = np.linalg.eigvals(closed_loop(plant, raised, 40.0 if plant.delay else None)[0])
    return np.where(poles.imag > 1e-3 * plant.omega[:, None], poles.real, -np.inf).max(axis=1)
