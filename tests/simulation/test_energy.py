"""The energy balance of a run: supplied = stored + dissipated; what valves dissipate by another
way.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import cumulative_simpson

import armdesign as ad
from armdesign import Machine, Step
from armdesign.hydraulics.fluid import bulk_modulus
from armdesign.hydraulics.friction import Friction
from armdesign.simulation.plant.equilibrium import find_equilibrium
from armdesign.simulation.plant.plant import Plant
from armdesign.simulation.simulate import simulate
from armdesign.units import bar, l_per_min
from tests import machines
from tests.simulation import valves as helpers
from tests.simulation.valves import WORST


def step_until(size: float, until: float = 0.3) -> Step:
    """A command that says when it jumps, so that the tolerance alone sets the steps between."""
    return Step(size=size, end=until)


@pytest.mark.parametrize(
    "name",
    [
        *("excavator_20t", "spatial", "crossing", "branched", "redundant"),
        pytest.param("heavy_bars", marks=pytest.mark.slow),
    ],
)
def test_balance_closes(name: str) -> None:
    """Kinetic and potential energy are Pinocchio's, all else is booked apart from them; leaks,
    friction, air, hoses.
    """
    machine = helpers.with_valves(machines.named(name), compliance=1e-8)
    machine = helpers.with_friction(machine, Friction(coulomb=800, static=1000, viscous=3e3))
    cylinders = [
        replace(c, valve=replace(c.valve, leakage=1e-3 * l_per_min / bar))
        for c in machine.cylinders
    ]
    machine = replace(machine, cylinders=tuple(cylinders))
    pose = machines.inner_poses(machine, 1)[0]
    run = simulate(
        machine,
        pose,
        lambda t: [step_until(0.02)(t)] * len(cylinders),
        duration=0.6,
        tolerance=1e-7,
    )
    assert np.ptp(run.energy) > 1
    assert run.energy_error < 1e-5
    assert np.diff(run.dissipated).min() > -1e-6 * np.ptp(run.dissipated)


@pytest.mark.parametrize("air", [0.0, 1.0])
def test_open_valves_balance_to_the_tolerance(excavator: Machine, air: float) -> None:
    """What does not close is the integration's error: at fifth order it falls at least as
    tolerance^⅘.
    """
    machine = excavator.replace({"fluid.entrained_air_percent": air})
    lowered = {"boom": step_until(-0.05, 0.5), "stick": step_until(0.03, 0.8)}
    errors = [
        simulate(machine, WORST, lowered, duration=1.0, tolerance=t).energy_error
        for t in (1e-5, 1e-7)
    ]
    assert errors[0] < 1e-5
    assert errors[1] < errors[0] / 100**0.8


@pytest.mark.parametrize("air", [0.0, 1.0])
def test_compression_is_that_of_the_oil_less_what_crosses_the_ports(
    excavator: Machine, air: float
) -> None:
    """By quadrature: growth of Σ V ε is what was booked and ∫ Σ ε Q dt, ε = ρ ∫ p dρ/ρ²; 0.4 % of
    the work p Q.

    Without air ε = β (exp(p/β) − 1 − p/β). Ports are open, the motion is slow and far from
    cavitation.
    """
    machine = excavator.replace({"fluid.entrained_air_percent": air})
    run = simulate(
        machine, WORST, {"boom": step_until(-0.05, 9.0)}, duration=0.8, rate=4000, preloaded=True
    )
    assert run.events == ()
    p = np.linspace(0.0, 500 * bar, 50_001)
    modulus = bulk_modulus(p, machine.fluid.bulk_modulus, air / 100)
    density = np.exp(cumulative_simpson(1 / modulus, x=p, initial=0))
    held = density * cumulative_simpson(p / density / modulus, x=p, initial=0)  # [J/m³]
    if air == 0:
        x = p / modulus
        np.testing.assert_allclose(held, modulus * (np.expm1(x) - x), rtol=1e-6, atol=1e-3)
    each = np.interp(run.pressures, p, held)
    volumes = np.stack(
        [np.stack(c.volumes(run.extensions[:, i]), -1) for i, c in enumerate(machine.cylinders)], 1
    )
    growth = np.diff((volumes * each).sum(axis=(1, 2))[[0, -1]])[0]
    booked = run.stored[-1] - np.diff(run.energy[[0, -1]])[0]
    carried = np.trapezoid((each * run.flows).sum(axis=(1, 2)), run.time)
    work = np.trapezoid((run.pressures * np.abs(run.flows)).sum(axis=(1, 2)), run.time)
    assert booked + carried == pytest.approx(growth, abs=1e-4 * abs(carried))
    assert 0.002 < abs(carried) / work < 0.01


def test_closed_and_undamped_nothing_comes_or_goes(excavator: Machine) -> None:
    """Lapped valves, shut again: the arm rings, but neither gains nor loses."""
    lapped = {f"cylinder.{c.name}.valve.overlap_percent": 2.0 for c in excavator.cylinders}
    commands = {"boom": step_until(-0.03), "bucket": step_until(0.03)}
    # far from cavitation
    run = simulate(excavator.replace(lapped), WORST, commands, duration=2.0, preloaded=True)
    assert run.events == ()
    rings = run.time > 1.0
    exchanged = np.ptp(run.energy[rings])
    assert exchanged > 100
    assert np.ptp(run.supplied[rings]) == np.ptp(run.dissipated[rings]) == 0
    assert np.ptp(run.stored[rings]) < 1e-5 * exchanged


@pytest.mark.parametrize("name", ["loader_crane", "paper_1dof"])
def test_at_rest_the_balance_is_no_quotient_of_roundings(name: str) -> None:
    """Nothing is exchanged but what the integration lets pass, in dry friction, too."""
    machine = ad.load(name)
    run = simulate(machine, machine.ranges.mean(axis=1), {}, duration=2.0, rate=5)
    assert np.ptp(run.energy) < 1e-6
    assert run.energy_error < 1e-4


def test_valves_dissipate_flow_times_drop(excavator: Machine) -> None:
    """By the trapezoidal rule from the records: the boom sinks, its cap drains, its annulus
    fills.
    """
    run = simulate(excavator, WORST, {"boom": step_until(-0.05, 1.0)}, duration=1.0, rate=2000)
    supply, back = excavator.supply.pressure, excavator.supply.return_pressure
    into, out = run.flows[:, 0, 1], -run.flows[:, 0, 0]
    assert into[200:].min() > 0
    assert out[200:].min() > 0
    power = into * (supply - run.pressures[:, 0, 1]) + out * (run.pressures[:, 0, 0] - back)
    assert run.dissipated[-1] == pytest.approx(np.trapezoid(power, run.time), rel=1e-4)
    assert run.supplied[-1] == pytest.approx(
        np.trapezoid(supply * into - back * out, run.time), rel=1e-4
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", ["excavator_20t", "heavy_bars", "spatial", "branched", "slewing"])
@pytest.mark.parametrize("seed", [1, 2])
def test_compliance_stops_and_friction_never_give_energy_back(name: str, seed: int) -> None:
    """Struck at random and with open valves, into the stops and back: the balance closes,
    dissipation never falls.
    """
    random = np.random.default_rng(seed)
    machine = helpers.with_valves(
        machines.named(name), compliance=float(random.choice([1e-8, 3e-8]))
    )
    machine = helpers.with_friction(
        machine, Friction(coulomb=800, static=1000, viscous=3e3) if seed > 1 else Friction()
    )
    pose = machines.inner_poses(machine, 1, seed)[0]
    spools = random.uniform(-1, 1, len(machine.actuators)).tolist()
    velocity = random.uniform(-0.3, 0.3, len(pose))
    run = simulate(
        machine, pose, lambda _: spools, duration=0.8, rate=500, velocity=velocity, tolerance=1e-7
    )
    assert run.dissipated[-1] > 10
    assert run.energy_error < 1e-5
    assert np.diff(run.dissipated).min() > -1e-7 * run.dissipated[-1]


@pytest.mark.parametrize("compliance", [1e-8, 3e-8])
def test_into_a_stop_with_compliance(excavator: Machine, compliance: float) -> None:
    """By definition the compliance carries what the stop's spring leaves of the oil's force, on
    the stop and off it.

    Also by definition supply pressure on the bore presses the stop in by 0.1 % of the stroke.
    """
    machine = helpers.with_valves(excavator, compliance=compliance)
    machine = helpers.with_friction(machine, Friction(viscous=1e5))
    run = simulate(
        machine, WORST, {"boom": lambda _: 1.0}, duration=2.5, rate=1000, tolerance=1e-7
    )
    assert run.energy_error < 1e-5
    assert np.diff(run.dissipated).min() > -1e-9 * run.dissipated[-1]
    boom = machine.cylinders[0]
    stop = machine.supply.pressure * boom.bore_area / (1e-3 * boom.stroke)
    beyond = np.maximum(run.extensions[:, 0] - boom.stroke, 0)
    carried = run.pressures[:, 0] @ [boom.bore_area, -boom.annulus_area] - stop * beyond
    lengths = machine.evaluate(machine.rigid_poses(run.q)).lengths[:, 0]
    ahead = run.extensions[:, 0] - (lengths - boom.closed_length)
    assert (stop * beyond).max() > 0.2 * np.abs(carried).max()
    np.testing.assert_allclose(ahead, compliance * carried, rtol=0, atol=1e-9)


def test_leaks_from_the_tank_bring_its_pressure_along(excavator: Machine) -> None:
    """At 10 bar in all chambers and 30 bar in the return line oil leaks in: K Σ (p − p_r)² is
    lost, none is made.
    """
    tank = 0.05 * l_per_min / bar
    valve = {
        f"cylinder.{c.name}.valve.tank_leakage_l_per_min_per_bar": 0.05
        for c in excavator.cylinders
    }
    plant = Plant(excavator.replace(valve | {"supply.return_pressure_bar": 30.0}))
    state = find_equilibrium(plant, WORST, preloaded=False).state
    for part in (plant.spread((0, 0, 1, 0, 0, 0, 0)), plant.spread((0, 0, 0, 1, 0, 0, 0))):
        state[part == 1] = 10.0
    powers = plant.evaluate(state[None], np.zeros((1, 3))).powers[0]
    assert powers[2] == pytest.approx(tank * 6 * (20 * bar) ** 2)
    assert powers[0] == pytest.approx(tank * 6 * 20 * bar * 30 * bar)


def test_viscous_friction_dissipates_force_times_speed() -> None:
    machine = helpers.with_friction(machines.named("paper_1dof"), Friction(viscous=2e4))
    run = simulate(machine, [0.0], {"lift": step_until(0.05, 0.2)}, duration=1.0, rate=1000)
    late = run.time >= 0.5
    lost = np.trapezoid(2e4 * run.speeds[late, 0] ** 2, run.time[late])
    # the valve still shuts a little
    assert run.dissipated[-1] - run.dissipated[late][0] == pytest.approx(lost, rel=0.02)
