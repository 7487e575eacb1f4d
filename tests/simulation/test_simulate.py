"""The nonlinear model: rest, energy, oil balance, stops, vapour, reliefs, leakage, faults said in
one line.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import armdesign as ad
from armdesign import Machine
from armdesign.errors import PoseError, SimulationError
from armdesign.simulation import simulate as motion
from armdesign.simulation.simulate import simulate
from armdesign.units import bar, l_per_min
from tests import machines
from tests.simulation import valves as helpers
from tests.simulation.valves import WORST, pulse


def test_stays_at_rest(excavator: Machine) -> None:
    """Valves shut, no leakage: static equilibrium, so nothing moves in a minute.

    (Reached: 1e-11 rad.)
    """
    run = simulate(excavator, WORST, helpers.shut(excavator), duration=60.0, rate=5)
    assert np.ptp(run.q, axis=0).max() < 1e-8
    assert np.ptp(run.pressures, axis=0).max() < 1e-4 * bar


def test_every_machine_stays_at_rest(machine: Machine) -> None:
    """Also with air, hoses, compliance, telescopes, four-bars, more cylinders than joints."""
    machine = helpers.with_valves(machine)
    pose = machines.inner_poses(machine, 1)[0]
    run = simulate(machine, pose, helpers.shut(machine), duration=1.0, rate=5)
    assert np.ptp(run.q, axis=0).max() < 1e-6


def test_rest_pressures(excavator: Machine) -> None:
    """A1 p1 − A2 p2 = F, and p1 + p2 = supply + return (Merritt), or one of them at return
    pressure.
    """
    forces = excavator.at(WORST).cylinder_forces[0]
    area = np.array([(c.bore_area, -c.annulus_area) for c in excavator.cylinders])
    for preloaded in (True, False):
        run = simulate(
            excavator, WORST, helpers.shut(excavator), duration=0.01, preloaded=preloaded
        )
        np.testing.assert_allclose((run.pressures[0] * area).sum(axis=1), forces, rtol=1e-9)
        if preloaded:
            np.testing.assert_allclose(run.pressures[0].sum(axis=1), 355 * bar)
        else:
            np.testing.assert_allclose(run.pressures[0].min(axis=1), 5 * bar)


def oil_energy(machine: Machine, run: ad.Simulation) -> np.ndarray:
    """−∫p dV of every chamber with p = p0 − β ln(V/V0): −p0 (V − V0) + β (V ln(V/V0) − V + V0)."""
    beta, total = machine.fluid.bulk_modulus, np.zeros(len(run.time))
    for i, cylinder in enumerate(machine.cylinders):
        for volume, pressure in zip(
            cylinder.volumes(run.extensions[:, i]), run.pressures[:, i].T, strict=True
        ):
            v0, p0 = volume[0], pressure[0]
            total += -p0 * (volume - v0) + beta * (volume * np.log(volume / v0) - volume + v0)
    return total


@pytest.mark.parametrize("name", ["rigid_excavator_20t", "heavy_bars"])
def test_energy_is_conserved_once_the_valves_are_shut(name: str) -> None:
    """Kinetic + potential + oil energy of the ringing arm; a pulse has set it in motion, the spool
    has come to rest.
    """
    excavator = machines.named(name).replace({"damped": False}).with_payload("full")
    run = simulate(
        excavator,
        WORST,
        {"boom": pulse(-0.01, 0.5), "bucket": pulse(0.02, 0.5)},
        duration=12.0,
        preloaded=True,
    )
    ringing = run.time > 2.0
    rings = replace(
        run, **{k: v[ringing] for k, v in vars(run).items() if isinstance(v, np.ndarray)}
    )  # since t0 = 2 s the trapped oil is what the first row has
    total = rings.energy + oil_energy(excavator, rings)
    exchanged = np.ptp(rings.energy)
    assert exchanged > 500  # J: it does ring
    assert np.ptp(total) < 1e-4 * exchanged


def test_oil_balance(excavator: Machine) -> None:
    """What flows into the cap is swept or compressed: ∫Q dt = A1 Δs + ∫(V/β) dp."""
    run = simulate(excavator, WORST, {"boom": pulse(-0.03, 1.0)}, duration=1.5, rate=2000)
    cylinder = excavator.cylinders[0]
    volume = cylinder.volumes(run.extensions[:, 0])[0]
    swept = cylinder.bore_area * (run.extensions[-1, 0] - run.extensions[0, 0])
    squeezed = np.trapezoid(volume / excavator.fluid.bulk_modulus, run.pressures[:, 0, 0])
    assert np.trapezoid(run.flows[:, 0, 0], run.time) == pytest.approx(swept + squeezed, rel=1e-3)
    assert swept < -1e-4


@pytest.mark.parametrize("size", [0.05, 1.0])
def test_end_stop_holds(excavator: Machine, size: float) -> None:
    """Driven out against the stop: finite, beyond it by less than 2 % of the stroke, and at rest
    on it in the end.

    Supply pressure alone presses it in by 0.1 % (its definition); the rest is the impact of up to
    1 m/s.
    """
    run = simulate(excavator, WORST, {"boom": lambda _: size}, duration=3.0, preloaded=True)
    beyond = run.extensions[:, 0] / excavator.cylinders[0].stroke - 1
    assert np.all(np.isfinite(run.q))
    assert 0 < beyond.max() < (0.02 if size > 0.5 else 0.004)
    assert 0 < beyond[-1] < 0.002


def test_vapour_and_reliefs_bound_the_pressures(excavator: Machine) -> None:
    """Unloaded chambers start at 5 bar, a hard pulse empties them: never below a vacuum; never far
    above 1.1 supply.
    """
    run = simulate(
        excavator, (0.3, -1.2, -1.0), {"boom": pulse(-0.1, 0.3)}, duration=3.0, preloaded=False
    )
    assert -1.02 * bar < run.pressures.min() < 0
    hard = simulate(excavator, (0.3, -1.2, -1.0), {"boom": pulse(-1.0, 0.3)}, duration=1.0)
    assert 350 * bar < hard.pressures.max() < 1.5 * 385 * bar


def test_leakage_lets_a_load_sink_and_its_trim_holds_it(excavator: Machine) -> None:
    machine = helpers.with_leakage(excavator, 0.02 * l_per_min / bar)
    sinks = simulate(machine, WORST, {}, duration=5.0, rate=20)
    assert sinks.extensions[-1, 0] < sinks.extensions[0, 0] - 1e-3
    trim = sinks.spool[0]
    held = simulate(machine, WORST, lambda _: trim.tolist(), duration=5.0, rate=20)
    assert np.abs(held.extensions - held.extensions[0]).max() < 1e-5


@pytest.mark.slow
def test_slow_loop_brings_the_piston_back(excavator: Machine) -> None:
    kick = {"boom": pulse(-0.002, 1.0)}
    free = simulate(excavator, WORST, kick, duration=25.0, rate=20)
    held = simulate(excavator, WORST, kick, duration=25.0, rate=20, hold=0.25)
    late = free.time > 20
    away = [abs(np.mean(run.extensions[late, 0]) - run.extensions[0, 0]) for run in (free, held)]
    assert away[1] < 0.2 * away[0]
    own, valve = held.time > 1.5, excavator.cylinders[0].valve
    assert valve is not None
    # what the loop commands, the spool follows
    lag = valve.damping_ratio / np.pi / valve.natural_frequency
    expected = held.spool[own, 0] + lag * np.gradient(held.spool[own, 0], held.time[1])
    assert np.abs(held.command[own, 0] - expected).max() < 0.02 * np.abs(expected).max()


def test_missing_valve_is_one_line(excavator: Machine) -> None:
    bare = replace(
        excavator, cylinders=(excavator.cylinders[0], replace(excavator.cylinders[1], valve=None))
    )
    with pytest.raises(
        SimulationError,
        match=r"cylinder stick has no valve; add cylinder\.stick\.valve: rated_flow",
    ) as caught:
        simulate(bare, WORST, {}, duration=1.0)
    assert "\n" not in str(caught.value)


def test_faults_of_a_call(excavator: Machine) -> None:
    with pytest.raises(PoseError, match="outside its stroke"):
        simulate(excavator, (3.0, 0, 0), {}, duration=1.0)
    with pytest.raises(SimulationError, match="choose from: boom, stick, bucket"):
        simulate(excavator, WORST, {"arm": pulse(0.1, 0.5)}, duration=1.0)
    with pytest.raises(SimulationError, match="duration"):
        simulate(excavator, WORST, {}, duration=-1.0)
    with pytest.raises(SimulationError, match=r"are 2e\+11 instants; give 50000 s or less"):
        simulate(excavator, WORST, {}, duration=1e9)  # no memory has so many
    with pytest.raises(
        SimulationError,
        match="gives 2 numbers; give a list, one per cylinder: boom, stick, bucket",
    ):
        simulate(excavator, WORST, lambda _: [0.0, 0.0], duration=1.0)
    with pytest.raises(SimulationError, match="gives 1 number; give a list, one per cylinder"):
        simulate(excavator, WORST, lambda _: 0.1, duration=1.0)
    for nothing, message in (
        (None, "the command gives nan there"),
        ("up", "command: gives 0 numbers at 0 s; give 3 at all times"),
        ([0.1, 0.2], "command: gives 0 numbers at 0 s; give 3 at all times"),
    ):
        with pytest.raises(SimulationError, match=message):
            simulate(excavator, WORST, {"boom": lambda _, nothing=nothing: nothing}, duration=1.0)
    for command in ({"boom": 0.1}, [0.1, 0.0, 0.0]):
        with pytest.raises(
            SimulationError,
            match=r"0\.1.* is not a function of time; give one, like lambda t: 0\.1",
        ):
            simulate(excavator, WORST, command, duration=1.0)  # type: ignore[arg-type]
    for tolerance in (0.0, -1.0, 2.0, np.nan):
        with pytest.raises(
            SimulationError, match=r"tolerance: .* is not in \(0, 1\); give one like 1e-6"
        ):
            simulate(excavator, WORST, {}, duration=1.0, tolerance=tolerance)
    with pytest.raises(PoseError, match="holds 2 poses"):
        simulate(excavator, [WORST, WORST], {}, duration=1.0)


def test_giving_up_names_time_and_place(
    excavator: Machine, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(motion, "MOST_STEPS", 8)
    with pytest.raises(
        SimulationError, match=r"gave up at .* s, .* boom 66\.1°.*more than 8 steps"
    ):
        simulate(excavator, WORST, {"boom": pulse(0.1, 0.5)}, duration=5.0)


def test_faults_of_strikes() -> None:
    machine = ad.load("paper_1dof")
    for velocity in ([0.1, 0.2], [math.nan]):
        with pytest.raises(
            SimulationError, match=r"paper_1dof: velocity: .* is not one finite number per joint"
        ):
            simulate(machine, [0.0], {}, velocity=velocity, duration=1.0)


def test_the_load_case_is_named_and_told(excavator: Machine) -> None:
    """As by ``with_payload``: a name or a mass [kg]; None leaves the machine's own."""
    for payload, name in (("empty", "empty"), (800.0, "800 kg"), (None, "full")):
        loaded = excavator if payload is None else excavator.with_payload(payload)
        runs = [
            simulate(machine, WORST, {"boom": pulse(-0.05, 0.5)}, payload=given, duration=0.3)
            for machine, given in ((excavator, payload), (loaded, None))
        ]
        assert [run.payload for run in runs] == [name] * 2
        np.testing.assert_array_equal(runs[0].q, runs[1].q)


def test_faults_of_load_cases(excavator: Machine) -> None:
    """The file's bucket holds its load at a pitch of 120…240°; at the sum of the joints, −1.9 rad,
    it has 360° − 108.9°.
    """
    level = (0.3, -1.2, -1.0)
    for payload, problem in (
        ("ful", r'payload ful: no such load case; did you mean "full"\?'),
        (-5.0, r"payload: -5 kg is not allowed; give a mass in \[0, ∞\) kg"),
        (
            "full",
            "payload full: the bucket has a pitch of 251.1° at boom 17.2°, .* it holds the"
            " load at 120…240°; choose another pose or load case",
        ),
    ):
        with pytest.raises(ad.ArmDesignError, match=problem) as caught:
            simulate(excavator, level, {}, payload=payload, duration=1.0)
        assert "\n" not in str(caught.value)


def test_numbers_that_no_run_has(excavator: Machine) -> None:
    """Each is refused in its own unit: a loop's corner in Hz."""
    for wrong, problem in (
        ({"hold": -3.0}, "hold: -3 Hz is not allowed; give a positive number"),
        ({"duration": 0.0}, "duration: 0 s is not allowed"),
        ({"rate": math.inf}, "rate: inf per second is not allowed"),
    ):
        given: dict[str, Any] = {"duration": 1.0} | wrong
        with pytest.raises(ad.ArmDesignError, match=f"excavator_20t: {problem}"):
            simulate(excavator, WORST, {}, **given)


def test_a_load_that_would_fall_out_is_an_event(excavator: Machine) -> None:
    tipped = simulate(excavator, WORST, {"bucket": pulse(-1.0, 1.0)}, duration=1.0)
    late = next(words for words in tipped.events if "tipped" in words)
    assert "the bucket was tipped beyond the pitch at which it holds payload full" in late
    assert not excavator.holds(tipped.q[-1])[0]
    assert not any(
        "tipped" in words
        for words in simulate(
            excavator, WORST, {"bucket": pulse(-1.0, 1.0)}, payload="empty", duration=1.0
        ).events
    )
