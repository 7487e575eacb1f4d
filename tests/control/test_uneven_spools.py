"""Spools of uneven sides: against the spool's motion in time, and in the limits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import armdesign as ad
from armdesign.control.controller import closed_loop
from armdesign.control.loop_plant import LoopPlant, loop_plant
from armdesign.control.loops import Loops
from armdesign.control.tuning import Aim, Task, damped
from armdesign.control.uneven_spools import passed, swings
from armdesign.machine.loading import shipped
from armdesign.simulation.excitation import SymmetricValve
from armdesign.simulation.linearization import without_dry_friction
from armdesign.simulation.plant.equilibrium import find_equilibrium
from armdesign.simulation.plant.plant import Plant
from armdesign.simulation.plant.springs import settled
from tests.control.machines import one_mass, worst_plant

OMEGA, DAMPING = 60.0, 0.8  # of the spool


def uneven(extend: float, retract: float) -> LoopPlant:
    sides = np.array([[[extend, retract]]])
    return replace(one_mass(5.0, 0.02, OMEGA), valve_damping=np.array([DAMPING]), sides=sides)


def in_time(sides: tuple[float, float], omega: float, mean: float) -> tuple[complex, float]:
    """First harmonic and mean of the piston speed, once the spool swings steadily."""

    def side(value: float) -> float:
        return sides[0] if value > 0 else sides[1]

    def rates(time: float, x: np.ndarray) -> list[float]:
        demand = np.sin(omega * time) + mean
        pull = side(demand) * demand - x[0]
        return [x[1], OMEGA**2 * pull - 2 * DAMPING * OMEGA * x[1]]

    period = 2 * np.pi / omega
    at = (20 + np.arange(2000) / 2000) * period
    options = {"rtol": 1e-8, "atol": 1e-10, "max_step": period / 50}
    spool = solve_ivp(rates, (0, 21 * period), [0, 0], t_eval=at, **options).y[0]
    speed = np.array([x / side(x) for x in spool])
    return complex(2j * np.mean(speed * np.exp(-1j * omega * at))), float(speed.mean())


@pytest.mark.parametrize("sides", [(1.5, 0.75), (0.7, 1.75), (3.0, 0.6)])
@pytest.mark.parametrize("omega", [20.0, 60.0, 180.0])
def test_a_swing_is_passed_as_in_time(sides: tuple[float, float], omega: float) -> None:
    plant = uneven(*sides)
    expected, mean = in_time(sides, omega, 0.0)
    lag = plant.spool(np.array([1j * omega]))[0, 0]
    share, speed = (each[0, 0, 0] for each in passed(plant, np.array([[omega]])))
    assert share == pytest.approx(expected / lag, abs=1e-3)
    assert speed == pytest.approx(mean, abs=1e-3)


@pytest.mark.parametrize(("sides", "omega"), [((1.5, 0.75), 60.0), ((3.0, 0.6), 180.0)])
def test_a_mean_demand_that_leaves_no_piston_moving(
    sides: tuple[float, float], omega: float
) -> None:
    """The mean demand that leaves none is sought here by itself."""
    mean = brentq(lambda each: in_time(sides, omega, each)[1], -0.6, 0.6, xtol=1e-5)
    plant = uneven(*sides)
    lag = plant.spool(np.array([1j * omega]))[0, 0]
    share, speed = (each[0, 0, 0] for each in passed(plant, np.array([[omega]]), mean))
    assert share == pytest.approx(in_time(sides, omega, mean)[0] / lag, abs=2e-3)
    assert speed == pytest.approx(0.0, abs=1e-3)


def test_limits() -> None:
    """Slow: as even. Fast: on the side with the larger spool. Even: as the lag alone."""
    omega = np.array([[0.02 * OMEGA, 20 * OMEGA]])
    for extend, retract in ((1.5, 0.75), (0.6, 3.0)):
        slow, fast = passed(uneven(extend, retract), omega).share[0, :, 0]
        assert slow == pytest.approx(1.0, abs=2e-3)
        assert fast == pytest.approx((extend + retract) / 2 / max(extend, retract), abs=1e-3)
    assert passed(uneven(1.0, 1.0), omega).share[0] == pytest.approx(np.ones((2, 1)), abs=1e-9)


def test_no_spool_passes_less_than_half() -> None:
    """And hardly another phase, so that loops which keep 6 dB stay stable: sides up to 1 : 7."""
    omega = OMEGA * np.geomspace(0.05, 30, 60)[None]
    for ratio in (1.2, 2.0, 5.0, 7.0):
        sides = np.array([ratio, 1.0]) * (1 + 1 / ratio) / 2  # speeds over these have the mean 1
        share = passed(uneven(*sides), omega).share
        assert np.abs(share).min() > 0.56
        assert np.abs(share).max() < 1.01
        assert np.abs(share[omega < OMEGA / 2] - 1).max() < 0.02
        assert np.degrees(np.abs(np.angle(share))).max() < 5.5


@pytest.mark.parametrize("name", shipped())
def test_sides_are_those_of_valves_wide_open(name: str) -> None:
    """Gains at rest, and flows of the plant through open valves: shipped valves are lapped."""
    machine = ad.load(name)
    q = machine.ranges.mean(axis=1)
    plant = Plant(without_dry_friction(settled(machine, q)))
    valves = SymmetricValve.all(plant, find_equilibrium(plant, q).state)
    expected = [[valve.extend, valve.retract] for valve in valves]
    stated = loop_plant(machine, machine.at(q), damping=0.02)
    assert stated.sides[0] == pytest.approx(np.array(expected), rel=1e-6)


def test_poles_of_even_spools_are_those_of_the_linear_loops() -> None:
    plant = worst_plant()
    controller = damped(Task(plant, Loops.of(plant), Aim(margin=0.8284271))).controller
    even = replace(plant, sides=np.ones_like(plant.sides))
    poles = np.linalg.eigvals(closed_loop(plant, controller)[0][0])
    found = swings(even, controller)[0]
    for pole in found[~np.isnan(found)]:
        assert np.abs(poles - pole).min() < 1e-6 * abs(pole)
