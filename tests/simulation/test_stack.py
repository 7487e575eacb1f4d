"""Many cases at once: each comes out as if it were alone; the integrator against closed forms."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pytest

import armdesign as ad
from armdesign import Machine
from armdesign.errors import SimulationError
from armdesign.simulation.integrator import Breaks, GaveUpError, Pace, Span, integrate
from armdesign.simulation.plant.equilibrium import find_equilibrium
from armdesign.simulation.plant.plant import Plant
from armdesign.simulation.simulate import SimulationCase, attempt_all, simulate, simulate_all
from tests import machines
from tests.simulation.valves import WORST, pulse


@dataclass
class Linear:
    """ẏ = A y, one matrix per case."""

    matrices: np.ndarray
    calls: int = 0

    def rates(self, time: np.ndarray, state: np.ndarray) -> np.ndarray:
        self.calls += len(time)
        return np.einsum("nij,nj->ni", self.matrices, state)

    def picked(self, cases: Sequence[int]) -> Linear:
        return Linear(self.matrices[list(cases)])


def alone(
    system: Linear,
    start: np.ndarray,
    durations: np.ndarray,
    counts: np.ndarray,
    omegas: np.ndarray,
    tolerance: float,
    most_steps: int,
) -> list[np.ndarray | GaveUpError]:
    """Cases whose rates may jump at any time."""
    breaks, pace = [Breaks()] * len(start), Pace(omegas, omegas)
    return integrate(system, start, Span(durations, counts), pace, breaks, tolerance, most_steps)


def oscillator(omega: float, damping: float = 0.0) -> list[list[float]]:
    return [[0, 1], [-(omega**2), -2 * damping * omega]]


@pytest.mark.slow
def test_oscillators_of_unlike_speed_and_duration() -> None:
    """cos ωt at every record; an undamped one neither grows nor shrinks over 300 periods."""
    omegas, durations = np.array([1.0, 20.0, 300.0]), np.array([10.0, 100.0, 0.5])
    system = Linear(np.array([oscillator(w) for w in omegas]))
    start, counts = np.tile([1.0, 0.0], (3, 1)), np.array([50, 500, 70])
    states = alone(system, start, durations, counts, omegas, 1e-9, 100_000)
    for omega, duration, count, states_of_one in zip(
        omegas, durations, counts, states, strict=True
    ):
        time = np.linspace(0, duration, count + 1)
        np.testing.assert_allclose(states_of_one[:, 0], np.cos(omega * time), atol=2e-5)


def test_error_falls_with_the_tolerance() -> None:
    errors = []
    for tolerance in (1e-4, 1e-6, 1e-8):
        trajectory = alone(
            Linear(np.array([oscillator(2.0, 0.1)])), np.array([[1.0, 0.0]]), np.array([5.0]),
            np.array([10]), np.zeros(1), tolerance, 10_000,
        )[0]  # fmt: skip
        wd = 2.0 * math.sqrt(1 - 0.01)
        exact = math.exp(-1.0) * (math.cos(5 * wd) + 0.2 / wd * math.sin(5 * wd))
        errors.append(abs(trajectory[-1, 0] - exact))
    assert errors[0] > 10 * errors[1] > 100 * errors[2]
    assert errors[2] < 1e-7


def test_stiff_case_is_finished_implicitly() -> None:
    """λ = −1 and −10⁶: explicitly 300 000 steps; e^−t is met all the same."""
    stiff = np.array([[-1.0, 0.0], [1e6, -1e6]])
    system = Linear(np.array([stiff, oscillator(2.0)]))
    states = alone(
        system, np.ones((2, 2)), np.array([2.0, 2.0]), np.array([4, 4]), np.zeros(2), 1e-8, 20_000
    )
    np.testing.assert_allclose(
        states[0], np.exp(-np.linspace(0, 2, 5))[:, None] * [1, 1], rtol=1e-5
    )
    assert system.calls < 20_000


def test_too_many_steps_stop_that_case_alone() -> None:
    system = Linear(np.array([oscillator(1.0), oscillator(500.0)]))
    start, omegas = np.tile([1.0, 0.0], (2, 1)), np.array([1.0, 500.0])
    slow, fast = alone(system, start, np.full(2, 5.0), np.full(2, 5), omegas, 1e-8, 100)
    np.testing.assert_allclose(slow[:, 0], np.cos(np.arange(6.0)), atol=1e-6)
    assert isinstance(fast, GaveUpError)
    assert "more than 100 steps" in str(fast)
    assert 0 < fast.time < 5
    assert fast.state[0] == pytest.approx(math.cos(500 * fast.time), abs=1e-5)


def cases(excavator: Machine) -> list[SimulationCase]:
    """Unlike poses, loads, oils, pins, commands, durations, rates; one goes hard into its stop."""
    changed = excavator.replace({"cylinder.boom.bore_mm": 125.0, "fluid.bulk_modulus_MPa": 900})
    return [
        SimulationCase(
            machine=excavator, q=WORST, command={"boom": pulse(-0.01)}, duration=1.0, rate=50
        ),
        SimulationCase(
            machine=excavator.with_payload("empty"),
            q=(0.3, -1.2, -1.0),
            command={"bucket": pulse(0.05)},
            duration=0.4,
        ),
        SimulationCase(
            machine=changed,
            q=WORST,
            command={"stick": pulse(0.02)},
            duration=0.7,
            rate=90,
            hold=0.2,
        ),
        SimulationCase(
            machine=excavator, q=WORST, command={"boom": pulse(1.0, 0.5)}, duration=0.6, rate=60
        ),
        SimulationCase(machine=machines.named("paper_1dof"), q=[0.0], command={}, duration=0.1),
    ]


def test_a_case_does_not_depend_on_its_company(excavator: Machine) -> None:
    """Every case has its own steps and its own error: what differs is rounding, below the error of
    either (1e-7).
    """
    for case, run in zip(cases(excavator), simulate_all(cases(excavator)), strict=True):
        alone = simulate_all([case])[0]
        assert len(run.time) == round(case.duration * case.rate) + 1
        np.testing.assert_allclose(run.q, alone.q, rtol=0, atol=1e-8)
        np.testing.assert_allclose(run.pressures, alone.pressures, rtol=0, atol=100.0)
        assert run.events == alone.events


def test_a_case_that_gives_up_does_not_touch_the_others(excavator: Machine) -> None:
    """Its spool loses its command on the way: the others come out bit by bit as without it."""
    good = cases(excavator)[:3]
    bad = SimulationCase(
        machine=excavator,
        q=WORST,
        command={"boom": lambda t: 0.01 if t < 0.2 else math.nan},
        duration=1.0,
    )
    with_it = attempt_all([good[0], bad, *good[1:]])
    error = with_it.pop(1)
    assert isinstance(error, SimulationError)
    assert "gave up at 0.2 s" in str(error)
    assert "the command gives nan there" in str(error)
    for one, other in zip(with_it, attempt_all(good), strict=True):
        for name, value in vars(other).items():
            np.testing.assert_array_equal(getattr(one, name), value)


def test_one_case_is_simulate(excavator: Machine) -> None:
    case = cases(excavator)[0]
    alone = simulate(excavator, WORST, case.command, duration=1.0, rate=50)
    np.testing.assert_array_equal(simulate_all([case])[0].q, alone.q)


def test_answer_converges_with_the_tolerance(excavator: Machine) -> None:
    runs = [
        simulate(
            excavator,
            WORST,
            {"boom": pulse(-0.02)},
            duration=1.0,
            rate=20,
            preloaded=True,
            tolerance=tolerance,
        ).q
        for tolerance in (1e-10, 1e-8, 1e-6)
    ]
    errors = [np.abs(run - runs[0]).max() for run in runs[1:]]
    assert errors[0] < 1e-7
    assert errors[0] < errors[1] < 1e-5


def test_bars_of_unlike_machines_do_not_mix() -> None:
    """Cases with the same bars are evaluated together: as each alone, whatever load, pose and bars
    beside it.
    """
    machine = ad.load("loader_crane")
    cases = [machine.with_payload(name) for name in ("full", "empty", "full")]
    cases.append(machine.replace({"cylinder.lift.barrel_kg": 99.0}))
    q = ad.Workspace.grid(machine, 5).q[3:39:9]
    states = np.array(
        [find_equilibrium(Plant(case), pose).state for case, pose in zip(cases, q, strict=True)]
    )
    states[:, 3:6] = np.random.default_rng(0).normal(size=(4, 3)) / 10
    shut = np.zeros((4, 3))
    alone = [
        Plant(case).derivative(state[None], shut[:1])[0]
        for case, state in zip(cases, states, strict=True)
    ]
    np.testing.assert_allclose(
        Plant(*cases).derivative(states, shut), alone, rtol=1e-12, atol=1e-9
    )
