"""Commands that jump: none is lost, however short, and each step ends where the command says that
it jumps.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import armdesign as ad
from armdesign import Machine
from armdesign.errors import SimulationError
from armdesign.simulation.controlled_plant import breaks_of
from armdesign.simulation.excitation import (
    SweptSine,
    SymmetricCommand,
    SymmetricValve,
    sweeps_of,
    write_sweeps,
)
from armdesign.simulation.integrator import Breaks, Pace, Span, integrate
from armdesign.simulation.plant.equilibrium import find_equilibrium
from armdesign.simulation.plant.plant import Plant
from armdesign.simulation.simulate import SimulationCase, simulate, simulate_all
from tests.simulation.valves import WORST

SIZE = 0.3


def silent(begin: float, width: float) -> Callable[[float], float]:
    """A pulse that does not say where it is."""
    return lambda time: SIZE if begin <= time < begin + width else 0.0


def spool_after(machine: Machine, begin: float, width: float, time: np.ndarray) -> np.ndarray:
    """Closed form: the difference of two step responses of a second-order lag with ζ < 1."""
    valve = machine.cylinders[0].valve
    assert valve is not None
    omega, zeta = 2 * math.pi * valve.natural_frequency, valve.damping_ratio
    damped = omega * math.sqrt(1 - zeta**2)

    def step(t: np.ndarray) -> np.ndarray:
        t = np.maximum(t, 0)
        swing = np.cos(damped * t) + zeta * omega / damped * np.sin(damped * t)
        return np.asarray(1 - np.exp(-zeta * omega * t) * swing)

    return SIZE * (step(time - begin) - step(time - begin - width))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("width", "rate", "announced"),
    [(5e-3, 200.0, False), (1e-3, 1000.0, False), (1e-3, 200.0, True), (1e-4, 5.0, True)],
)
def test_no_pulse_is_lost(excavator: Machine, width: float, rate: float, announced: bool) -> None:
    """Thirty starts at random, in one stack: the spool follows in closed form to the tolerance
    (1e-8).
    """
    starts = np.random.default_rng(3).uniform(0.05, 0.9, 30)
    pulses = [
        ad.Step(size=SIZE, begin=b, end=b + width) if announced else silent(b, width)
        for b in starts.tolist()
    ]
    runs = simulate_all(
        [
            SimulationCase(
                machine=excavator, q=WORST, command={"boom": p}, duration=1.0, rate=rate
            )
            for p in pulses
        ]
    )
    for begin, run in zip(starts, runs, strict=True):
        expected = spool_after(excavator, begin, width, run.time)
        np.testing.assert_allclose(run.spool[:, 0], expected, rtol=0, atol=1e-6)


@pytest.mark.parametrize("begin", [0.0, 0.31])
def test_the_arm_moves_as_integrated_between_the_jumps(excavator: Machine, begin: float) -> None:
    """By scipy's DOP853 on the plant's right-hand side, started anew at each jump."""
    plant, end = Plant(excavator), 0.8
    state = find_equilibrium(plant, WORST).state
    for a, b, spool in ((0.0, begin, 0.0), (begin, begin + 1e-3, SIZE), (begin + 1e-3, end, 0.0)):
        if b > a:
            command = np.array([[spool, 0.0, 0.0]])
            solution = solve_ivp(
                lambda _, y, u=command: plant.derivative(y[None], u)[0],
                (a, b),
                state,
                method="DOP853",
                rtol=1e-10,
                atol=1e-10,
            )
            state = solution.y[:, -1]
    pulse = ad.Step(size=SIZE, begin=begin, end=begin + 1e-3)
    run = simulate(excavator, WORST, {"boom": pulse}, duration=end, rate=10)
    assert np.abs(state[:3] - WORST).max() > 1e-4
    np.testing.assert_allclose(run.q[-1], state[:3], rtol=0, atol=1e-7)


@pytest.mark.parametrize("begin", [0.0, 0.15, 0.5, 0.7])
def test_a_jump_at_a_recorded_instant(excavator: Machine, begin: float) -> None:
    """At the start, at a record, at the end, after it; whether the instant itself has the old or
    the new value.
    """
    runs = [
        simulate(excavator, WORST, {"boom": command}, duration=0.5, rate=20)
        for command in (
            ad.Step(size=0.1, begin=begin),
            ad.Table([begin, begin], [0.0, 0.1]),
            Late(begin),
        )
    ]
    for run in runs[1:]:
        np.testing.assert_array_equal(run.q, runs[0].q)
    assert (np.abs(runs[0].q[-1] - WORST).max() > 1e-4) == (begin < 0.5)


class Late:
    """A step of 0.1 whose instant still has the old value."""

    def __init__(self, begin: float) -> None:
        self.breakpoints = [begin]

    def __call__(self, time: float) -> float:
        return 0.1 if time > self.breakpoints[0] else 0.0


def test_cases_with_unlike_breaks_come_out_as_if_alone(excavator: Machine) -> None:
    commands = [
        ad.Step(size=0.05, begin=0.1, end=0.103),
        ad.Table([0.0, 0.2, 0.2, 0.3], [0.0, 0.02, -0.02, 0.0]),
        silent(0.25, 0.005),
        SweptSine(amplitude=0.1, start=50, stop=50, duration=0.01, fade=0.5),
    ]
    cases = [
        SimulationCase(machine=excavator, q=WORST, command={"boom": command}, duration=0.5)
        for command in commands
    ]
    for case, run in zip(cases, simulate_all(cases), strict=True):
        np.testing.assert_array_equal(run.q, simulate_all([case])[0].q)


def test_a_stiff_case_keeps_its_pulses() -> None:
    """ẋ = p(t) beside a stiff state, which LSODA finishes: x grows by each pulse's area, told or
    not.
    """
    pulses = ((1.0, 0.05), (3.003, 0.001), (4.0, 0.05))

    def driver(time: float) -> list[float]:
        return [float(any(a <= time < a + width for a, width in pulses))]

    class Stiff:
        def rates(self, time: np.ndarray, state: np.ndarray) -> np.ndarray:
            return np.array(
                [
                    [driver(t)[0], -1e6 * (y[1] - 1)]
                    for t, y in zip(time.tolist(), state, strict=True)
                ]
            )

        def picked(self, cases: Sequence[int]) -> Stiff:
            return self

    instants = Breaks([t for a, width in pulses for t in (a, a + width)], True)
    for breaks, area, count in ((instants, 0.101, 5), (Breaks(), 0.101, 5000)):
        trajectory = integrate(
            Stiff(),
            np.zeros((1, 2)),
            Span(np.array([5.0]), np.array([count])),
            Pace(np.zeros(1), np.zeros(1)),
            [breaks],
            1e-8,
            50_000,
        )[0]
        assert trajectory[-1, 0] == pytest.approx(area, abs=1e-6)


class Watched:
    """ẏ = 0, and the instants at which it is evaluated."""

    def __init__(self) -> None:
        self.instants = [0.0]

    def rates(self, time: np.ndarray, state: np.ndarray) -> np.ndarray:
        self.instants += time.tolist()
        return np.zeros_like(state)

    def picked(self, cases: Sequence[int]) -> Watched:
        return self


@pytest.mark.parametrize(
    ("breaks", "longest"), [(Breaks(), 0.05), (Breaks([0.3, 0.8]), 0.05), (Breaks([2.0], True), 8)]
)
def test_no_step_is_longer_than_half_the_recording_interval(
    breaks: Breaks, longest: float
) -> None:
    """At rest at any tolerance: 10 records per second, half a step between evaluations at most.

    With all breakpoints stated a step may reach from one to the next.
    """
    watched = Watched()
    span, pace = Span(np.array([10.0]), np.array([100])), Pace(np.zeros(1), np.zeros(1))
    integrate(watched, np.ones((1, 1)), span, pace, [breaks], 1e-2, 10_000)
    gaps = np.diff(np.unique(watched.instants))
    assert gaps.max() <= longest / 2 * (1 + 1e-9)
    assert gaps.max() > 0.4 * longest


def test_a_jump_is_crossed_at_any_tolerance(excavator: Machine) -> None:
    """A valve of 2 kHz: its spool's acceleration jumps by ω² u = 5e7/s², so even 1e-14 s leave an
    error of 5e-7.
    """
    fast = excavator.replace({"cylinder.boom.valve.natural_frequency_hz": 2000.0})
    runs = [
        simulate(fast, WORST, {"boom": command}, duration=0.3, tolerance=tolerance)
        for command, tolerance in (
            (silent(0.1, 0.1), 1e-8),
            (silent(0.1, 0.1), 1e-10),
            (silent(0.1, 0.1), 1e-12),
        )
    ]
    expected = simulate(
        fast,
        WORST,
        {"boom": ad.Step(size=SIZE, begin=0.1, end=0.2)},
        duration=0.3,
        tolerance=1e-11,
    ).q
    for run, bound in zip(runs, (1e-6, 1e-8, 1e-8), strict=True):
        assert np.abs(run.q - expected).max() < bound


def test_tables_and_steps() -> None:
    table = ad.Table([1, 2, 2, 4], [0, 1, 3, 5])
    assert [table(t) for t in (0.0, 1.0, 1.5, 2.0, 3.0, 4.0, 9.0)] == [0, 0, 0.5, 3, 4, 5, 5]
    assert table.breakpoints == (1, 2, 4)
    step = ad.Step(size=2.0, begin=1.0, end=2.0)
    assert [step(t) for t in (0.9, 1.0, 1.9, 2.0)] == [0, 2, 2, 0]
    assert step.breakpoints == (1, 2)
    assert ad.Step(size=1.0).breakpoints == (0,)
    for times, values, message in (
        ([2, 1], [0, 0], "1 s comes after 2 s; sort them"),
        ([0, math.nan], [0, 0], "times: .* are not finite numbers"),
        ([0, 1], [0], "2 times for 1 values"),
        ([], [], "not finite numbers"),
        ([0, 1], ["a", 0], "values: .* are not finite numbers"),
    ):
        with pytest.raises(SimulationError, match=message):
            ad.Table(times, values)  # type: ignore[arg-type]
    for changes in ({"end": -1.0}, {"begin": math.nan}, {"size": math.inf}):
        with pytest.raises(
            SimulationError, match="give a finite size and begin, and an end after it"
        ):
            ad.Step(**({"size": 1.0} | changes))
    with pytest.raises(SimulationError, match=r"step: size: '0\.1' is not a number; give one"):
        ad.Step(size="0.1")  # type: ignore[arg-type]


def test_every_excitation_tells_itsbreaks_of(excavator: Machine) -> None:
    for given, expected in (
        (SweptSine(amplitude=1, start=1, stop=2, duration=10.0), [0, 1, 9, 10]),
    ):
        moved = SymmetricCommand(None, 0.0, given)  # type: ignore[arg-type]
        breaks = breaks_of({"boom": moved, "stick": ad.Step(size=1, begin=2.0)}, "machine")
        np.testing.assert_allclose(breaks.instants, sorted({*expected, 2.0}))
        assert breaks.complete
    assert not breaks_of({"boom": lambda _: 0.0, "stick": ad.Step(size=1)}, "machine").complete


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ([0.3, 0.1], "command boom: breakpoints: 0.1 s comes after 0.3 s; sort them"),
        ([0.1, math.inf], "not finite times; give a list"),
        ("soon", "not finite times; give a list"),
        (0.1, "not finite times; give a list"),
    ],
)
def test_faults_of_breakpoints(excavator: Machine, given: object, message: str) -> None:
    late = Late(0.1)
    late.breakpoints = given  # type: ignore[assignment]
    with pytest.raises(SimulationError, match=message) as caught:
        simulate(excavator, WORST, {"boom": late}, duration=0.1)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"amplitude": "0.1"}, r"swept sine: amplitude: '0\.1' is not a finite number; give one"),
        ({"stop": math.inf}, r"swept sine: stop: inf is not a finite number; give one"),
        ({"start": -1.0}, r"swept sine: of -1 to 5 Hz in 10 s, fade 0\.1 is none; give freq"),
        ({"duration": 0.0}, r"swept sine: of 1 to 5 Hz in 0 s, fade 0\.1 is none"),
        ({"fade": 0.6}, r"swept sine: of 1 to 5 Hz in 10 s, fade 0\.6 is none"),
    ],
)
def test_what_is_no_swept_sine(wrong: dict[str, Any], message: str) -> None:
    right = {"amplitude": 0.1, "start": 1.0, "stop": 5.0, "duration": 10.0}
    with pytest.raises(SimulationError, match=message):
        SweptSine(**(right | wrong))


def test_compiled_sweeps_are_the_same_to_the_last_bit(excavator: Machine) -> None:
    """Compiled and called: before, in and after fades and sweeps; of what is no sweep none."""
    plant = Plant(excavator)
    valves = SymmetricValve.all(plant, find_equilibrium(plant, WORST).state)
    names = [actuator.name for actuator in excavator.actuators]
    sweep = SweptSine(amplitude=0.1, start=1.0, stop=5.0, duration=10.0)
    whole = [
        SymmetricCommand(valve, mean, sweep)
        for valve, mean in zip(valves, (0.0, 0.02, -0.3), strict=True)
    ]
    commands = [{name: one} for name, one in zip(names, whole, strict=True)]
    records = sweeps_of(commands, [excavator] * len(commands))
    assert records is not None
    for time in (-1.0, 0.0, 1e-9, *np.random.default_rng(0).uniform(0, 10, 200), 10.0, 11.0):
        spools = np.zeros((len(commands), len(names)))
        write_sweeps(np.full(len(commands), time), records, spools)
        assert spools.tolist() == np.diag([one(float(time)) for one in whole]).tolist()
    for other in (
        {},
        {"boom": ad.Step(size=0.1)},
        {**commands[0], **commands[1]},
        lambda _: [0.0],
    ):
        assert sweeps_of([commands[0], other], [excavator] * 2) is None
