"""Rest: what a shut valve leaves, preloads of the file, reliefs, and the balance behind valves
that leak.
"""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
import pytest

import armdesign as ad
from armdesign import Machine
from armdesign.errors import MachineFileError, SimulationError
from armdesign.hydraulics.actuator import Actuator
from armdesign.hydraulics.valve import LAMINAR_DROP
from armdesign.inspection.inspection import inspect
from armdesign.report.maps import map_sheets
from armdesign.simulation.experiment import Experiment
from armdesign.simulation.linearization import linearize
from armdesign.simulation.plant.equilibrium import find_equilibrium
from armdesign.simulation.plant.hydraulics import actuators_of, port, system_of
from armdesign.simulation.plant.plant import Plant
from armdesign.simulation.simulate import simulate
from armdesign.simulation.validation import validate
from armdesign.units import bar, l_per_min
from tests import machines

WORST, LIGHT = (1.154, -1.199, -2.191), (0.228865, -1.64707, -0.867145)
CYLINDERS = ("boom", "stick", "bucket")
HOLDING = {
    "pilot_ratio": 4.0,
    "setting_bar": 250.0,
    "rated_flow_l_per_min": 429,
    "rated_drop_bar": 14,
}


def valves(machine: Machine, names: tuple[str, ...] = CYLINDERS, **keys: object) -> Machine:
    """The machine with other keys of the valves of some cylinders."""
    return machine.replace(
        {f"cylinder.{name}.valve.{key}": value for name in names for key, value in keys.items()}
    )


def holding(machine: Machine, name: str, **keys: object) -> Machine:
    return machine.replace(
        {f"cylinder.{name}.load_holding.{key}": value for key, value in (HOLDING | keys).items()}
    )


def started(machine: Machine, pose: object, preloaded: bool | None = None) -> np.ndarray:
    """Pressures (nc, 2) [Pa] at which a run starts."""
    run = simulate(machine, pose, {}, duration=0.01, preloaded=preloaded)  # type: ignore[arg-type]
    return run.pressures[0]


def rates(machine: Machine, pose: object) -> np.ndarray:
    """Pressure rates (nc,) [bar/s] at rest, the larger of both chambers."""
    plant = Plant(machine)
    rest = find_equilibrium(plant, pose).state  # type: ignore[arg-type]
    _, _, cap, annulus, _, _ = plant.split(
        plant.derivative(rest[None], plant.split(rest)[4][None])[0]
    )
    return np.maximum(np.abs(cap), np.abs(annulus)) / bar


# -------------------------------------------------------------------------- tight valves, preloads


@pytest.mark.parametrize("air", [0.0, 1.0])
def test_a_shut_valve_leaves_the_load_to_one_chamber(excavator: Machine, air: float) -> None:
    """F = A1 p1 − A2 p2 by hand, one chamber at the return's 5 bar, the other above: with air and
    without alike.
    """
    machine = excavator.replace({"fluid.entrained_air_percent": air})
    found, forces = started(machine, WORST), excavator.at(WORST).cylinder_forces[0]
    for cylinder, force, (cap, annulus) in zip(excavator.cylinders, forces, found, strict=True):
        assert cylinder.bore_area * cap - cylinder.annulus_area * annulus == pytest.approx(
            force, rel=1e-9
        )
        assert min(cap, annulus) == pytest.approx(5 * bar)


def test_check_map_and_runs_name_the_same_pressures(excavator: Machine) -> None:
    """The largest static load that ``check`` names is where a run at that pose starts; the map's
    rows, too.
    """
    machine = valves(excavator, ("stick",), preload_bar=40.0)
    workspace = ad.Workspace.grid(machine, 5)
    found = ad.frequency_map(machine, workspace)
    rows = (found.frame["payload"] == "full").to_numpy()
    poses = found.frame.loc[rows, list(machine.joints)].to_numpy()
    share, pressure = found.holding_pressures[rows], found.static_pressures[rows]
    np.testing.assert_allclose(share * machine.supply.pressure, pressure)
    loads = [load for load in inspect(machine, workspace).loads if load.payload == "full"]
    for i, load in enumerate(loads):
        row = int(np.argmin(np.abs(pressure[:, i] - load.pressure)))
        start = started(machine, poses[row])[i]
        assert max(start) == pytest.approx(load.pressure, rel=1e-9)
        assert start[0 if load.cap else 1] == max(start)
        assert min(start) == pytest.approx((40 if load.cylinder == 1 else 5) * bar)


def test_air_is_as_stiff_as_the_preload_makes_it(excavator: Machine) -> None:
    """Derivatives of the plant at its rest know no formula of stiffness: they and the map's modes
    agree.
    """
    airy = valves(excavator.replace({"fluid.entrained_air_percent": 1.0}), relief_bar=300.0)
    frequencies = []
    for preload in (5.0, 60.0):
        machine = valves(airy, preload_bar=preload)
        frequencies.append(ad.natural_modes(machine.at(WORST)).frequencies[0])
        assert linearize(machine, WORST).natural_frequencies == pytest.approx(
            frequencies[-1], rel=1e-6
        )
        assert Experiment.of(machine, np.array(WORST), 0, 0).target == pytest.approx(
            frequencies[-1][0], rel=1e-6
        )
    assert frequencies[1][0] > 1.1 * frequencies[0][0]


def test_preload_stays_below_the_relief(excavator: Machine) -> None:
    """Of the file, and what ``preloaded`` asks for: the force is held, no chamber stands within 5
    % of its relief.
    """
    for relief, preload in itertools.product((170.0, 220.0), (60.0, 150.0)):
        machine = valves(excavator, ("boom",), relief_bar=relief, preload_bar=preload)
        boom, force = machine.cylinders[0], machine.at(LIGHT).cylinder_forces[0, 0]
        for preloaded in (None, True):
            cap, annulus = started(machine, LIGHT, preloaded)[0]
            assert boom.bore_area * cap - boom.annulus_area * annulus == pytest.approx(force)
            assert max(cap, annulus) <= 0.95 * relief * bar * (1 + 1e-12)
            assert min(cap, annulus) >= 5 * bar
        # the cap at 95 % of its relief
        lower = (boom.bore_area * 0.95 * relief * bar - force) / boom.annulus_area
        assert min(started(machine, LIGHT)[0]) == pytest.approx(min(preload * bar, lower))
    # no relief in reach
    np.testing.assert_allclose(started(excavator, LIGHT, True).sum(axis=1), 355 * bar)
    slack = valves(excavator, preload_bar=80.0)
    np.testing.assert_allclose(started(slack, LIGHT, False).min(axis=1), 5 * bar)


def test_preload_of_a_motor_and_round_trip(tmp_path: Path) -> None:
    machine = machines.named("slewing").replace({"motor.swing.valve.preload_bar": 30.0})
    saved = ad.load(machine.save(tmp_path / "again.toml"))
    assert saved.motors[0].valve == machine.motors[0].valve
    assert saved.motors[0].valve.preload == 30 * bar
    assert started(saved, machines.inner_poses(saved, 1)[0])[-1].min() == pytest.approx(30 * bar)


@pytest.mark.parametrize(
    ("relief", "preload", "words"),
    [
        (
            None,
            385.0,
            (
                r"385 bar is not allowed; give a pressure in \[5, 385\) bar, .* below 1\.1 ×"
                r" supply pressure"
            ),
        ),
        (
            170.0,
            170.0,
            r"170 bar is not allowed; give a pressure in \[5, 170\) bar, .* to below relief_bar",
        ),
        (
            170.0,
            4.0,
            r"4 bar is not allowed; give a pressure in \[5, 170\) bar, from return pressure",
        ),
        (170.0, -1.0, r"-1\.0 is not allowed; give a number in \[0, 5000\] bar"),
    ],
)
def test_preloads_that_cannot_be(
    excavator: Machine, relief: float | None, preload: float, words: str
) -> None:
    machine = excavator if relief is None else valves(excavator, ("boom",), relief_bar=relief)
    with pytest.raises(MachineFileError, match=rf"cylinder\.boom\.valve\.preload_bar: {words}"):
        valves(machine, ("boom",), preload_bar=preload)


# ----------------------------------------------------------------------------------------- reliefs


def test_a_low_relief_leaves_mode_and_sweep_alone(excavator: Machine) -> None:
    """170 bar on the boom: at rest no relief is open, so the modes on trapped oil stay, and the
    sweeps find them.
    """
    machine = valves(excavator, ("boom",), relief_bar=170.0).with_payload("empty")
    expected = ad.natural_modes(machine.at(LIGHT)).frequencies[0]
    assert expected[0] == pytest.approx(2.508, abs=5e-4)  # of the issue
    for preloaded in (None, True):
        assert linearize(machine, LIGHT, preloaded=preloaded).natural_frequencies == pytest.approx(
            expected, rel=1e-6
        )
        run = simulate(machine, LIGHT, {}, duration=1.0, preloaded=preloaded)
        assert run.events == ()
        assert np.ptp(run.extensions, axis=0).max() < 1e-9
    found = validate(machine, LIGHT, cylinders=["boom"])
    assert {run.remark for run in found.runs} == {"agrees"}
    assert found.worst_deviation < 1e-3


def test_a_load_close_below_the_relief_is_swept_gently(excavator: Machine) -> None:
    """Of 188 bar under 190 bar: in a sweep from return pressure both chambers climb, and must not
    reach the relief.
    """
    machine = valves(excavator, ("boom",), relief_bar=190.0)
    assert validate(machine, WORST, cylinders=["boom"]).worst_deviation < 1e-3
    with pytest.raises(
        SimulationError,
        match=r"boom cylinder: needs 188\.1 bar to hold .* relief opens at 188\.4 bar",
    ):
        validate(valves(excavator, ("boom",), relief_bar=188.4), WORST, cylinders=["boom"])


def test_a_load_above_the_relief_is_told(excavator: Machine) -> None:
    """p1 = (F + A2 p0)/A1 by hand is above 170 bar, nothing holds that: run, linear answer, check
    and map say so.
    """
    machine = valves(excavator, ("boom",), relief_bar=170.0)
    boom, force = machine.cylinders[0], machine.at(WORST).cylinder_forces[0, 0]
    needed = (force + boom.annulus_area * 5 * bar) / boom.bore_area / bar
    assert needed > 171
    words = (
        f"the relief of boom's cap cannot hold {force / 1e3:.0f} kN: that needs {needed:.0f} bar,"
        " it opens at 170 bar"
    )
    for preloaded in (None, True, False):
        run = simulate(machine, WORST, {}, duration=0.5, preloaded=preloaded)
        assert f"{words} at 0 s" in run.events
        assert run.extensions[-1, 0] < run.extensions[0, 0] - 1e-3
    with pytest.raises(
        SimulationError, match=f"excavator_20t: rest: {words}; raise relief_bar"
    ) as caught:
        linearize(machine, WORST)
    assert "\n" not in str(caught.value)
    with pytest.raises(
        SimulationError, match=r"boom cylinder: needs 188\.1 bar .* its relief opens at 170\.0 bar"
    ):
        validate(machine, WORST, cylinders=["boom"])
    workspace = ad.Workspace.grid(machine, 7)
    found = ad.frequency_map(machine, workspace)
    share, most = found.beyond_reliefs["boom"]
    beyond = found.holding_pressures[:, 0] * 350 > 170
    assert share == pytest.approx(found.weights[beyond].sum() / found.weights.sum())
    assert "boom needs more than its relief holds: up to" in map_sheets(found)[0].note
    odd = [
        finding for finding in inspect(machine, workspace).findings() if "relief" in finding.part
    ]
    assert [finding.part for finding in odd] == ["cylinder.boom.valve.relief_bar"]
    assert (
        f"needs {most / bar:.0f} bar to stand still; its relief opens at 170 bar" in odd[0].words
    )
    assert not ad.frequency_map(excavator, workspace).beyond_reliefs


def test_a_setting_that_the_load_opens_is_told(excavator: Machine) -> None:
    """A load-holding valve set below the load: the shut spool still holds, but ``check`` says that
    it does not.
    """
    machine = holding(excavator, "boom", side="cap", setting_bar=100.0)
    odd = {
        finding.part: finding.words
        for finding in inspect(machine, ad.Workspace.grid(machine, 5)).findings()
    }
    assert (
        "more than the setting of 100 bar: the load alone opens it"
        in odd["cylinder.boom.load_holding.setting_bar"]
    )
    run = simulate(machine, WORST, {}, duration=1.0)
    assert run.events == ()
    assert np.ptp(run.extensions, axis=0).max() < 1e-9


# -------------------------------------------------------------------------------- valves that leak


@pytest.mark.parametrize("overlap", [0.0, 3.0])
def test_tank_leakage_alone(excavator: Machine, overlap: float) -> None:
    """By hand: nothing leaks at return pressure; the loaded chamber's leak T (p − p0) passes K o
    √(p_s − p).
    """
    leakage = 0.005 * l_per_min / bar
    machine = valves(excavator, tank_leakage_l_per_min_per_bar=0.005, overlap_percent=overlap)
    held = find_equilibrium(Plant(machine), WORST).holdings
    for one, cylinder, force in zip(
        held, machine.cylinders, machine.at(WORST).cylinder_forces[0], strict=True
    ):
        assert min(one.cap, one.annulus) == pytest.approx(5 * bar)
        own, area = (
            max(one.cap, one.annulus),
            cylinder.bore_area if one.cap > one.annulus else cylinder.annulus_area,
        )
        other = cylinder.annulus_area if one.cap > one.annulus else cylinder.bore_area
        assert area * own - other * 5 * bar == pytest.approx(abs(force))
        drop = machine.supply.pressure - own
        passed = cylinder.valve.gain * drop / (drop**2 + LAMINAR_DROP**2) ** 0.25
        opening = leakage * (own - 5 * bar) / passed
        side = 1 if one.cap > one.annulus else -1
        assert one.spool == pytest.approx(
            side * (overlap / 100 + opening * (1 - overlap / 100)), rel=1e-9
        )
    assert rates(machine, WORST).max() < 1e-6
    spool = Plant(machine).split(find_equilibrium(Plant(machine), WORST).state)[4].tolist()
    run = simulate(machine, WORST, lambda _: spool, duration=20.0, rate=5)
    assert np.ptp(run.q, axis=0).max() < 1e-6


def test_leakage_across_alone(excavator: Machine) -> None:
    """What leaves one chamber enters the other; with equal edges the drops are equal too: p1 + p2
    = supply + return.
    """
    machine = valves(excavator, leakage_l_per_min_per_bar=0.01)
    for one in find_equilibrium(Plant(machine), WORST).holdings:
        assert one.cap + one.annulus == pytest.approx(355 * bar, rel=1e-6)
        assert one.spool * (one.cap - one.annulus) > 0
    assert rates(machine, WORST).max() < 1e-6


def test_leakage_across_behind_a_load_holding_valve(excavator: Machine) -> None:
    """The bucket's cap is held: what leaks in stays there, until both pressures are F/(A1 − A2)
    and nothing leaks.
    """
    machine = valves(excavator, ("bucket",), leakage_l_per_min_per_bar=0.01, overlap_percent=2.0)
    machine = holding(machine, "bucket", side="cap", pilot_ratio=0.0)
    bucket, force = machine.cylinders[2], machine.at(WORST).cylinder_forces[0, 2]
    even = force / (bucket.bore_area - bucket.annulus_area)
    assert even > 5 * bar
    one = find_equilibrium(Plant(machine), WORST).holdings[2]
    assert (one.cap, one.annulus, one.spool, one.creeps) == (
        pytest.approx(even),
        pytest.approx(even),
        0.0,
        "",
    )
    assert rates(machine, WORST).max() < 1e-6
    run = simulate(machine, WORST, {}, duration=5.0, rate=5)
    assert np.ptp(run.q, axis=0).max() < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("side", ["cap", "annulus"])
@pytest.mark.parametrize("payload", ["full", "empty"])
def test_underlap_with_a_load_holding_valve(excavator: Machine, side: str, payload: str) -> None:
    """Its spool cannot shut what flows in: it stands where the pilot opens as much, and the load
    stays for a minute.
    """
    machine = valves(excavator.with_payload(payload), overlap_percent=-4.0)
    for name in CYLINDERS:
        machine = holding(machine, name, side=side)
    assert rates(machine, WORST).max() < 1e-6
    plant = Plant(machine)
    held = find_equilibrium(plant, WORST).holdings
    for one in held:
        own, pilot = (one.cap, one.annulus) if side == "cap" else (one.annulus, one.cap)
        assert own + 4 * pilot > 250 * bar  # open at all
    run = simulate(
        machine,
        WORST,
        lambda _: [one.spool for one in held],
        duration=60.0,
        rate=1,
        tolerance=1e-7,
    )
    assert np.ptp(run.q, axis=0).max() < 1e-6
    assert run.events == ()


def leaky(machine: Machine, random: np.random.Generator) -> Machine:
    """The machine with any combination of leakages, underlap or overlap, edges, reliefs and
    load-holding valves.
    """
    keys: dict[str, object] = {}
    for cylinder in machine.cylinders:
        valve, held = f"cylinder.{cylinder.name}.valve", f"cylinder.{cylinder.name}.load_holding"
        keys[f"{valve}.overlap_percent"] = float(random.choice([0, 5, -1, -5, -20]))
        for key in ("leakage_l_per_min_per_bar", "tank_leakage_l_per_min_per_bar"):
            keys |= (
                {f"{valve}.{key}": 10 ** random.uniform(-4, -1)} if random.random() < 0.5 else {}
            )
        keys |= (
            {f"{valve}.relief_bar": float(random.choice([100, 170, 250]))}
            if random.random() < 0.4
            else {}
        )
        for edge in ("cap_to_return", "supply_to_annulus"):
            keys |= (
                {f"{valve}.edges.{edge}": random.uniform(0.3, 2)} if random.random() < 0.3 else {}
            )
        if random.random() < 0.6:
            chosen = {
                "side": str(random.choice(["cap", "annulus"])),
                "pilot_ratio": float(random.choice([0, 1, 4])),
            }
            keys |= {f"{held}.{key}": value for key, value in (HOLDING | chosen).items()}
    return machine.replace(keys)


def nearest_balance(machine: Machine, actuator: Actuator, index: int, force: float) -> float:
    """Smallest flow [l/min] that cap and annulus together are off by, over a fine grid of
    pressures and spools.
    """
    row, system, supply = actuators_of(machine)[index], system_of(machine), machine.supply
    least = np.inf
    for other in np.linspace(supply.return_pressure, supply.pressure, 30):
        for cap, annulus in (
            (other, (actuator.bore_area * other - force) / actuator.annulus_area),
            ((force + actuator.annulus_area * other) / actuator.bore_area, other),
        ):
            if (
                not supply.return_pressure
                <= min(cap, annulus)
                <= max(cap, annulus)
                <= supply.pressure
            ):
                continue
            for spool in np.linspace(-1, 1, 81):
                pairs = ((0, cap, annulus), (1, annulus, cap))
                flows = [port(row, system, *pair, spool, supply.pressure) for pair in pairs]
                least = min(least, max(abs(flow[0] - flow[1] + flow[2]) for flow in flows))
    return least / l_per_min


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["excavator_20t", "excavator_12t", "mini_excavator_2t", "loader_crane"]
)
def test_every_combination_of_leaks_rests_or_says_that_it_cannot(name: str) -> None:
    """Random machines and poses: chambers gain nothing at rest; else it is told, and a grid finds
    none either.
    """
    random, shipped = np.random.default_rng(sum(map(ord, name))), ad.load(name)
    low, high = shipped.ranges.T
    asked = 0
    for _ in range(8):
        machine = leaky(
            shipped.with_payload(str(random.choice(list(shipped.section.payload)))), random
        )
        poses = low + random.random((50, len(low))) * (high - low)
        pose = next(q for q in poses if machine.margins(q).min() > 0)
        held, rate, forces = (
            find_equilibrium(Plant(machine), pose).holdings,
            rates(machine, pose),
            machine.at(pose).cylinder_forces[0],
        )
        for i, (actuator, one) in enumerate(zip(machine.actuators, held, strict=True)):
            static = max(actuator.static_pressures(forces[i], machine.supply))
            assert bool(one.overcome) == (static > actuator.relief(machine.supply))
            if one.creeps and not asked:
                asked += 1
                assert nearest_balance(machine, actuator, i, forces[i]) > 1e-3
            elif not (one.overcome or one.creeps):
                assert rate[i] < 1e-6
                assert min(one.cap, one.annulus) >= machine.supply.return_pressure * (1 - 1e-12)
                assert (
                    one.cap * actuator.bore_area - one.annulus * actuator.annulus_area
                    == pytest.approx(forces[i])
                )


def test_what_creeps_is_told(excavator: Machine) -> None:
    """What leaks into a held cap can never leave it: no pilot opens it, and no spool."""
    machine = valves(excavator, ("bucket",), leakage_l_per_min_per_bar=0.01, overlap_percent=-1.0)
    machine = holding(machine, "bucket", side="cap", pilot_ratio=0.0)
    assert (
        nearest_balance(machine, machine.cylinders[2], 2, machine.at(WORST).cylinder_forces[0, 2])
        > 1e-3
    )
    run = simulate(machine, WORST, {}, duration=0.1)
    words = (
        "bucket's valve leaks, and at no spool position does it make up for that: the load creeps"
        " from 0 s on"
    )
    assert words in run.events


def test_a_flow_limited_pump_makes_up_for_leaks_below_its_pressure(excavator: Machine) -> None:
    """It gives Q (p_max − p)/(c p_max) there: what the edges take.

    Wide open centres take more than it has: told.
    """
    machine = valves(excavator.replace({"supply.pump": "flow_limited"}), overlap_percent=-4.0)
    plant = Plant(machine)
    rest = find_equilibrium(plant, WORST).state
    found = plant.evaluate(rest[None], plant.split(rest)[4][None])
    pump, line = machine.supply, float(plant.supply_pressure(rest[None])[0])
    given = pump.flow * (pump.pressure - line) / (pump.cut_off * pump.pressure)
    assert found.outputs["supplied"].sum() == pytest.approx(given, rel=1e-9)
    assert given > 50 * l_per_min
    assert np.abs(found.rates).max() < 1e-6
    wide = simulate(valves(machine, overlap_percent=-40.0), WORST, {}, duration=0.01)
    assert (
        "the pump gives less than what the valves let through at rest: its pressure falls from 0"
        " s on" in wide.events
    )


def test_static_pressures_are_those_of_the_definition() -> None:
    """Lower chamber at the preload, or at what leaves the loaded one below its relief, by
    bisection; over forces.
    """
    cylinder = valves(
        ad.load("excavator_20t"), ("stick",), relief_bar=200.0, preload_bar=90.0
    ).cylinders[1]
    supply, limit = ad.load("excavator_20t").supply, 0.95 * 200 * bar
    for force in np.linspace(-2.5e5, 2.8e5, 107):

        def pair(common: float, force: float = force) -> tuple[float, float]:
            cap = (force + cylinder.annulus_area * common) / cylinder.bore_area
            if cap >= common:
                return cap, common
            return common, (cylinder.bore_area * common - force) / cylinder.annulus_area

        low, high = 5 * bar, 90 * bar
        if max(pair(high)) > limit and max(pair(low)) < limit:
            for _ in range(80):
                middle = (low + high) / 2
                low, high = (middle, high) if max(pair(middle)) < limit else (low, middle)
            expected = pair(low)
        else:
            expected = pair(high if max(pair(high)) <= limit else low)
        assert cylinder.static_pressures(force, supply) == pytest.approx(expected, rel=1e-9)
        assert math.isclose(
            cylinder.bore_area * expected[0] - cylinder.annulus_area * expected[1],
            force,
            abs_tol=1e-3,
        )
