"""Static equilibrium of valves that leak or have an underlap."""

from __future__ import annotations

import math

import numpy as np
import pytest

from armdesign import Machine
from armdesign.hydraulics.actuator import Actuator
from armdesign.hydraulics.valve import LAMINAR_DROP
from armdesign.simulation.plant.compiled import borrowing
from armdesign.simulation.plant.equilibrium import find_equilibrium
from armdesign.simulation.plant.hydraulics import actuators_of, port, system_of
from armdesign.simulation.plant.plant import Plant
from armdesign.simulation.simulate import simulate
from armdesign.units import bar, l_per_min
from tests import machines
from tests.simulation.plant.valve_machines import CYLINDERS, HOLDING, holding, rates, valves
from tests.simulation.valves import WORST

# -------------------------------------------------------------------------------- valves that leak

_port = borrowing(port)  # compiled, called from Python here alone


@pytest.mark.slow
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
                flows = [_port(row, system, *pair, spool, supply.pressure) for pair in pairs]
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
    random = np.random.default_rng(sum(map(ord, name)))
    shipped = machines.rigid(name).replace({"damped": False})  # leaks are drawn
    low, high = shipped.ranges.T
    combinations = 0
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
            if one.creeps and not combinations:
                combinations += 1
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
    equilibrium = find_equilibrium(plant, WORST).state
    derivatives = plant.evaluate(equilibrium[None], plant.split(equilibrium)[4][None])
    pump, line = machine.supply, float(plant.supply_pressure(equilibrium[None])[0])
    given = pump.flow * (pump.pressure - line) / (pump.cut_off * pump.pressure)
    assert derivatives.outputs["supplied"].sum() == pytest.approx(given, rel=1e-9)
    assert given > 50 * l_per_min
    assert np.abs(derivatives.rates).max() < 1e-6
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
        machines.rigid("excavator_20t"), ("stick",), relief_bar=200.0, preload_bar=90.0
    ).cylinders[1]
    supply, limit = machines.rigid("excavator_20t").supply, 0.95 * 200 * bar
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
