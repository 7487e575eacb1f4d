"""Runs that go to the limits: finite, energy-consistent, told in words; and the parts that only
they use.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from armdesign import Machine
from armdesign.errors import SimulationError
from armdesign.simulation import simulate as motion
from armdesign.simulation.excitation import Table
from armdesign.simulation.integrator import (
    NO_LIMIT,
    TOO_MANY,
    Breaks,
    GaveUpError,
    Pace,
    Span,
    integrate,
)
from armdesign.simulation.linearization import linearize
from armdesign.simulation.plant.equilibrium import find_equilibrium
from armdesign.simulation.plant.plant import Plant
from armdesign.simulation.run import Simulation
from armdesign.simulation.simulate import simulate
from armdesign.units import bar, l_per_min
from tests import machines
from tests.simulation.valves import WORST

LEVEL = (0.3, -1.2, -1.0)
CYLINDERS = ("boom", "stick", "bucket")


def always(size: float) -> Callable[[float], float]:
    return lambda _: size


def assert_events(run: Simulation, *words: str) -> None:
    """Finite, balanced to 1e-5 of what it exchanged, and each word is in some event."""
    assert np.all(np.isfinite(run.q))
    assert np.all(np.isfinite(run.pressures))
    assert run.energy_error < 1e-5
    assert run.dissipated[-1] > -1e-6  # [J], where all is held
    for word in words:
        assert any(word in event for event in run.events), run.events


def test_into_the_end_stop(excavator: Machine) -> None:
    run = simulate(excavator, WORST, {"boom": always(1.0)}, duration=1.0, tolerance=1e-7)
    assert_events(
        run, "boom reached its outer stop at 0.4", "boom's spool was fully open", "taken as ideal"
    )


def test_joints_have_no_stops_but_their_limits_are_told(excavator: Machine) -> None:
    """Limits within the strokes, both ways; it went on there without a word."""
    urdf = excavator.urdf_text.replace('upper="1.22553"', 'upper="1.17"')
    urdf = urdf.replace('lower="-2.71404"', 'lower="-1.25"')
    machine = Machine.from_text(excavator.text, urdf, excavator.source).with_payload("full")
    commands = {"boom": always(1.0), "stick": always(1.0)}
    words = "passed its joint limit of"
    run = simulate(machine, WORST, commands, duration=0.6, tolerance=1e-6)
    assert_events(run, f"boom {words} 67.0° (where a run has no stop) at", f"stick {words} -71.6°")
    run = simulate(excavator, WORST, commands, duration=0.6, tolerance=1e-6)
    assert_events(run, "boom reached its outer stop")
    assert not any(words in event for event in run.events)


@pytest.mark.parametrize(("limit", "told"), [("4.0", True), (str(np.pi), False)])
def test_limits_wider_than_a_turn_are_told_and_one_turn_has_none(limit: str, told: bool) -> None:
    """Hoses allow 4 rad, 229.2°, to each side of a slew that could turn all around."""
    slewing = machines.named("slewing")
    urdf = slewing.urdf_text.replace("continuous", "revolute")
    limits = f'<limit lower="-{limit}" upper="{limit}" effort="80000"'
    urdf = urdf.replace('<limit effort="80000"', limits)
    machine = Machine.from_text(slewing.text, urdf, slewing.source)
    start = (float(limit) - 0.02, 0.0, -1.57, -1.57)
    run = simulate(machine, start, {"swing": always(0.9)}, duration=0.6, tolerance=1e-6)
    assert run.q[:, 0].max() > float(limit)
    assert any("swing passed its joint limit of 229.2°" in event for event in run.events) == told


def test_a_slew_that_is_stopped_at_once() -> None:
    """Its inertia empties the side that drove it, and opens the relief of the other."""
    turn = {"swing": lambda t: 0.9 if t < 0.6 else 0.0}
    level = (0.0, 0.0, -1.57, -1.57)
    run = simulate(machines.named("slewing"), level, turn, duration=1.0, tolerance=1e-7)
    assert_events(run, "swing's side a cavitated at 0.6", "relief of swing's side b was open")


@pytest.mark.slow
@pytest.mark.parametrize("compliance", [3e-8, 4e-8])
def test_out_of_a_stop_with_compliance(excavator: Machine, compliance: float) -> None:
    """Into the inner stops and out: where a stop lets go the rates jump, and steps must grow again
    from there on.
    """
    machine = excavator.replace(
        {f"cylinder.{name}.compliance_m_per_N": compliance for name in CYLINDERS}
    )
    low, high = excavator.ranges.T
    there = Table([0, 1.5, 1.5, 2], [-0.9, -0.9, 0.6, 0.6])
    start, command = low + 0.15 * (high - low), dict.fromkeys(CYLINDERS, there)
    run, finer = (
        simulate(machine, start, command, duration=2.0, tolerance=tol) for tol in (1e-8, 1e-9)
    )
    assert run.extensions.min(axis=0).max() < 0  # all three were in their stops
    assert run.extensions[-1].min() > 0
    assert run.energy_error < 1e-6
    assert np.all(np.diff(run.dissipated) > -1e-6)
    np.testing.assert_allclose(run.q, finer.q, rtol=0, atol=1e-5)


def test_cavitating_load(excavator: Machine) -> None:
    """Unloaded chambers start at 5 bar; a hard pulse of the boom empties the bucket's and the
    stick's.
    """
    run = simulate(
        excavator,
        LEVEL,
        {"boom": lambda t: -0.1 if t < 0.3 else 0.0},
        duration=0.6,
        preloaded=False,
        tolerance=1e-7,
    )
    assert_events(run, "bucket's cap cavitated at 0.29", "stick's cap cavitated")
    assert run.pressures.min() > -1.02 * bar


def test_zero_supply_pressure(excavator: Machine) -> None:
    """The valve opens towards lifting, and the load drives its oil into the dead pump; reliefs
    stay as set.
    """
    lift = {"boom": always(0.5)}
    run = simulate(
        excavator, WORST, lift, duration=1.0, supply_pressure=0.0, preloaded=False, tolerance=1e-7
    )
    assert_events(
        run,
        "the pump held 0 bar, no more than the return line's",
        "boom's load pushed oil back",
        "cavitated",
    )
    assert run.extensions[-1, 0] < run.extensions[0, 0] - 0.1
    assert not any("relief" in event for event in run.events)
    assert (run.supply == 0).all()
    limited = excavator.replace({"supply.pump": "flow_limited"})
    assert limited.supply.flow_limited
    same = simulate(
        limited, WORST, lift, duration=1.0, supply_pressure=0.0, preloaded=False, tolerance=1e-7
    )
    np.testing.assert_array_equal(same.q, run.q)
    with pytest.raises(
        SimulationError, match="supply_pressure: -1 Pa is not allowed; give 0 or more"
    ):
        simulate(excavator, WORST, lift, duration=1.0, supply_pressure=-1.0)


def test_another_supply_pressure_is_another_machine_but_for_its_reliefs(
    excavator: Machine,
) -> None:
    reliefs = {
        f"cylinder.{c}.valve.relief_bar": 1.1 * excavator.supply.pressure / bar for c in CYLINDERS
    }
    machine = excavator.replace(reliefs | {"supply.pressure_bar": 250.0})
    runs = [
        simulate(one, LEVEL, {"boom": always(0.1)}, duration=0.3, supply_pressure=pressure)
        for one, pressure in ((machine, None), (excavator, 250 * bar))
    ]
    np.testing.assert_allclose(runs[1].q, runs[0].q, rtol=0, atol=1e-12)


@pytest.mark.parametrize("pump", ["ideal", "flow_limited"])
def test_valve_larger_than_the_pump(excavator: Machine, pump: str) -> None:
    changes = {"supply.pump": pump, "cylinder.boom.valve.rated_flow_l_per_min": 5000.0}
    run = simulate(
        excavator.replace(changes), LEVEL, {"boom": always(1.0)}, duration=0.4, tolerance=1e-7
    )
    assert_events(run, "were not enough" if pump == "flow_limited" else "taken as ideal")
    assert (run.supply.min() < 0.9 * excavator.supply.pressure) == (pump == "flow_limited")


def test_flow_limited_pump_sets_the_speed(excavator: Machine) -> None:
    """Lifting steadily at full spool, the whole flow goes into the cap: ṡ = Q/A1; the supply
    falls.
    """
    slow = {"supply.flow_l_per_min": 150.0, "cylinder.boom.friction.viscous_N_s_per_m": 1e5}
    machine = machines.rigid("excavator_20t").with_payload("full").replace(slow)
    run = simulate(machine, LEVEL, {"boom": always(1.0)}, duration=2.0, tolerance=1e-7)
    late = run.time > 1.0
    speed = np.mean(run.speeds[late, 0])
    assert speed == pytest.approx(150 * l_per_min / excavator.cylinders[0].bore_area, rel=0.02)
    assert run.supply[late].max() < 0.9 * excavator.supply.pressure
    assert run.supply[0] == excavator.supply.pressure


def test_flow_limited_pump_keeps_the_modes(excavator: Machine) -> None:
    """Shut valves do not feel the pump: natural frequencies stay; its pressure is one more
    state.
    """
    limited = excavator.replace({"supply.pump": "flow_limited"})
    model = linearize(limited, WORST)
    assert model.A.shape == (19, 19)
    assert model.states[12] == "supply pressure"
    expected = linearize(excavator, WORST).natural_frequencies
    np.testing.assert_allclose(model.natural_frequencies, expected, rtol=1e-9)


@pytest.mark.parametrize("air", [0.0, 1.0])
def test_underlap_and_leakage_rest(excavator: Machine, air: float) -> None:
    """Valves that shut nothing stand where both chambers lose what they get: all rates vanish at
    once.
    """
    changes: dict[str, float] = {"fluid.entrained_air_percent": air}
    for name in CYLINDERS:
        valve = f"cylinder.{name}.valve"
        changes |= {f"{valve}.overlap_percent": -4.0, f"{valve}.edges.cap_to_return": 1.5}
        changes |= {
            f"{valve}.leakage_l_per_min_per_bar": 0.005,
            f"{valve}.tank_leakage_l_per_min_per_bar": 0.002,
        }
    machine = excavator.replace(changes)
    plant = Plant(machine)
    equilibrium = find_equilibrium(plant, WORST).state
    spool = plant.split(equilibrium)[4]
    rates = plant.derivative(equilibrium[None], spool[None])[0]
    assert np.abs(rates).max() < 1e-6
    # the flow's, not the load's: no chamber at return pressure
    assert plant.pressures(equilibrium[None]).min() > 50 * bar
    held = simulate(
        machine, WORST, lambda _: spool.tolist(), duration=60.0, rate=1, tolerance=1e-7
    )
    assert np.ptp(held.q, axis=0).max() < 1e-6


def test_spool_rate_limit(excavator: Machine) -> None:
    """Full stroke in 200 ms: a fast spool moves at 5/s, so it stands at one half after 100 ms and
    its lag (1.6/ω).
    """
    valve = {"natural_frequency_hz": 100.0, "stroke_time_ms": 200.0}
    machine = excavator.replace(
        {f"cylinder.boom.valve.{key}": value for key, value in valve.items()}
    )
    run = simulate(machine, LEVEL, {"boom": always(1.0)}, duration=0.1, rate=1000, tolerance=1e-7)
    assert np.diff(run.spool[:, 0]).max() == pytest.approx(5e-3, rel=1e-3)
    assert run.spool[-1, 0] == pytest.approx(5 * (0.1 - 1 / (2 * 0.8 * 2 * np.pi * 100)), rel=1e-3)


HOLDING = {
    "side": "cap",
    "setting_bar": 380.0,
    "pilot_ratio": 4.0,
    "rated_flow_l_per_min": 429,
    "rated_drop_bar": 14,
}


def holding(machine: Machine, **changes: object) -> Machine:
    return machine.replace(
        {f"cylinder.boom.load_holding.{k}": v for k, v in (HOLDING | changes).items()}
    )


def test_load_holding_valve_holds_without_supply(excavator: Machine) -> None:
    """The spool opens either way, the pump is dead: the load stays, and sinks without the
    valve.
    """
    machine = excavator.replace({"supply.return_pressure_bar": 0.0})
    for spool in (0.5, -0.5):
        ways = []
        for one in (machine, holding(machine)):
            run = simulate(
                one,
                WORST,
                {"boom": always(spool)},
                duration=0.5,
                supply_pressure=0.0,
                tolerance=1e-7,
            )
            ways.append(run.extensions[-1, 0] - run.extensions[0, 0])
            assert_events(run)
        assert ways[0] < -0.03
        assert abs(ways[1]) < 1e-6


def test_load_holding_valve_lowers_on_pilot_pressure(excavator: Machine) -> None:
    """With the pump alive the annulus pilots it open, and it meters: slower than the valve
    alone.
    """
    speeds = []
    for machine in (excavator, holding(excavator)):
        run = simulate(machine, WORST, {"boom": always(-0.1)}, duration=1.0, tolerance=1e-7)
        assert_events(run)
        speeds.append(np.mean(run.speeds[run.time > 0.5, 0]))
    assert speeds[0] < speeds[1] < -0.005


def test_reliefs_open_where_they_are_set(excavator: Machine) -> None:
    machine = excavator.replace({"cylinder.boom.valve.relief_bar": 250.0})
    run = simulate(
        machine, WORST, {"boom": lambda t: -0.1 if t < 0.3 else 0.0}, duration=0.6, tolerance=1e-7
    )
    assert_events(run, "the relief of boom's cap was open above 250 bar")


class Breaking:
    """ẏ = 1, but there is none where y reaches an edge."""

    def __init__(self, *edges: float) -> None:
        self.edges = np.array(edges)[:, None]

    def rates(self, time: np.ndarray, state: np.ndarray) -> np.ndarray:
        return np.where(state < self.edges, 1.0, np.nan)

    def picked(self, cases: Sequence[int]) -> Breaking:
        return Breaking(*self.edges[list(cases), 0])


@pytest.mark.parametrize("edges", [(1.0,), (1.0, 9.0), (9.0, 2.0, 1.0, 1.0, 9.0)])
def test_no_result_is_cut_short(edges: tuple[float, ...]) -> None:
    """A case that comes to its edge gives up there; the others reach their end."""
    n = len(edges)
    trajectory = integrate(
        Breaking(*edges),
        np.zeros((n, 1)),
        Span(np.full(n, 5.0), np.full(n, 5)),
        Pace(np.zeros(n), np.zeros(n)),
        [Breaks()] * n,
        1e-6,
        9999,
    )
    for edge, states in zip(edges, trajectory, strict=True):
        if edge < 5:
            assert isinstance(states, GaveUpError)
            assert "four-bar has opened" in states.cause
            assert states.time == pytest.approx(edge, abs=1e-3)
            assert states.state[0] == pytest.approx(states.time, rel=1e-12)
        else:
            np.testing.assert_allclose(states[:, 0], np.arange(6.0), rtol=1e-12)


def test_likely_causes(excavator: Machine) -> None:
    short = machines.named("four_bar_left")
    turns = [np.array([0.0, 0.0, angle]) for angle in np.linspace(-3.0, 3.0, 60)]
    broken = next(q for q in turns if np.isneginf(short.margins(q)).any())
    assert "the four-bar of tilt does not close there" in motion.likely_cause(short, broken, [])
    assert "of its stroke beyond a stop" in motion.likely_cause(
        excavator, np.array([2.0, -1.2, -1.0]), []
    )
    assert "thousand times faster" in motion.likely_cause(excavator, np.array(LEVEL), [1.0])
    assert "gives inf there" in motion.likely_cause(excavator, np.array(LEVEL), [0.0, np.inf])


def test_causes_are_true(excavator: Machine) -> None:
    """Too many steps, rates that jump without end, a number that is none: each is said, with its
    own remedy.
    """
    level = np.array(LEVEL)
    said = motion.likely_cause(excavator, level, [0.1], f"{TOO_MANY} 500000 steps", 1e-11)
    assert "coarser tolerance than 1e-11, a shorter duration or a smoother command" in said
    assert "smooth a command" in motion.likely_cause(
        excavator, level, [0.1], f"no step is small enough: {NO_LIMIT}"
    )


class Toggling:
    """ẏ = ±1e9, the sign of which nobody foresees."""

    def __init__(self) -> None:
        self.random = np.random.default_rng(0)

    def rates(self, time: np.ndarray, state: np.ndarray) -> np.ndarray:
        return self.random.choice([-1e9, 1e9], state.shape)

    def picked(self, cases: Sequence[int]) -> Toggling:
        return self


def test_rates_that_jump_without_end_are_not_followed_for_ever() -> None:
    trajectory = integrate(
        Toggling(),
        np.zeros((1, 3)),
        Span(np.ones(1), np.ones(1, dtype=int)),
        Pace(np.zeros(1), np.zeros(1)),
        [Breaks()],
        1e-12,
        9999,
    )[0]
    assert isinstance(trajectory, GaveUpError)
    assert NO_LIMIT in trajectory.cause
