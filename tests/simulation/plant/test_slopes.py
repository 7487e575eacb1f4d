"""Hydraulics with slopes against the compiled one, at any instant: stops, reliefs, vapour."""

from __future__ import annotations

import numpy as np
import pytest

from armdesign import Machine
from armdesign.arrays import Array
from armdesign.simulation.linearization import without_dry_friction
from armdesign.simulation.plant import slopes
from armdesign.simulation.plant.compiled import borrowing, new_records
from armdesign.simulation.plant.hydraulics import (
    OUTPUT,
    actuate,
    actuators_of,
    pump_flow,
    system_of,
)
from tests import machines
from tests.simulation import valves as helpers
from tests.simulation.differences import jacobian

_actuate = borrowing(actuate)  # compiled, called from Python here alone

STEPS = np.array([1e-5, 1e-4, 50.0, 50.0, 1e-4, 2e3])
HOLDING = (
    "load_holding = { side = 'cap', setting_bar = 320, pilot_ratio = 4, opening_range_bar = 900,"
    " rated_flow_l_per_min = 200, rated_drop_bar = 10 }\ncompliance_m_per_N = 1e-8\n"
)


def machine_of(kind: str) -> Machine:
    if kind == "rotator":
        return helpers.with_valves(machines.named("rotator"))
    machine = machines.named(kind).replace({"fluid.entrained_air_percent": 0.7})
    text = machine.text.replace("[cylinder.boom]\n", f"[cylinder.boom]\n{HOLDING}", 1)
    return Machine.from_text(text, machine.urdf_text, machine.source)


def instants(machine: Machine, count: int) -> Array:
    """Numbers of every actuator (count, nc, 6): pressures from vapour to beyond the reliefs."""
    rng, shape = np.random.default_rng(3), (count, len(machine.actuators))
    strokes = np.where(np.isinf(machine.strokes), 1.0, machine.strokes)
    length = machine.closed_lengths + rng.uniform(-0.005, 1.005, shape) * strokes
    pressures = [10 ** rng.uniform(3, 7.8, shape) - 0.72e5 for _ in range(2)]
    spool = rng.uniform(-1.1, 1.1, shape)
    supply = rng.uniform(1e6, 4e7, shape)
    return np.stack([length, rng.uniform(-0.3, 0.3, shape), *pressures, spool, supply], axis=-1)


def outputs(instant: slopes.Instant) -> list[slopes.Slope]:
    return [instant.force, *instant.rates, instant.extension, instant.speed, instant.supplied]


@pytest.mark.parametrize("kind", ["rigid_excavator_20t", "rotator"])
def test_values_are_those_of_the_compiled_law(kind: str) -> None:
    machine = without_dry_friction(machine_of(kind))
    records, system = actuators_of(machine), system_of(machine)
    numbers = instants(machine, 60)
    instant = slopes.actuate(records, system[()], numbers)
    output = new_records(1, OUTPUT)
    for case, row in enumerate(numbers):
        for i, (length, rate, cap, annulus, spool, supply) in enumerate(row.tolist()):
            out = output[0]
            values = _actuate(
                records[i], system[()], (length, rate), (cap, annulus), spool, supply, out
            )
            expected = [*values, float(out["extension"]), None, float(sum(out["supplied"]))]
            for ours, theirs in zip(outputs(instant), expected, strict=True):
                if theirs is not None:
                    value = ours.value[case, i]
                    assert value == pytest.approx(theirs, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("kind", ["rigid_excavator_20t", "rotator"])
def test_slopes_are_differences(kind: str) -> None:
    """Of each actuator alone; instants within the reach of a step from a corner are few."""
    machine = without_dry_friction(machine_of(kind))
    records, system = actuators_of(machine), system_of(machine)[()]
    numbers, wrong = instants(machine, 60), 0
    instant = slopes.actuate(records, system, numbers)
    for case in range(len(numbers)):
        for i in range(len(machine.actuators)):
            own = records[i : i + 1]

            def values(x: Array, own: Array = own) -> Array:
                at = slopes.actuate(own, system, x[:, None])
                return np.stack([one.value[:, 0] for one in outputs(at)], axis=1)

            expected = jacobian(values, numbers[case, i], STEPS) * STEPS
            ours = np.array([one.by[case, i] for one in outputs(instant)]) * STEPS
            scale = np.abs(expected).max(axis=1, keepdims=True) + 1e-30
            wrong += bool(np.any(np.abs(ours - expected) > 1e-7 * scale))
    assert wrong <= 0.03 * numbers[..., 0].size


def test_pump() -> None:
    system = system_of(machines.named("excavator_20t"))[()]
    pressure = np.linspace(1e6, 1.1 * float(system["pressure"]), 37)
    flow, slope = slopes.pump(system, pressure)
    expected = [pump_flow(system, float(p)) for p in pressure]
    np.testing.assert_allclose(flow, expected, rtol=1e-12)
    steps = 1.0
    risen = slopes.pump(system, pressure + steps)[0] - slopes.pump(system, pressure - steps)[0]
    np.testing.assert_allclose(slope, risen / (2 * steps), rtol=1e-6, atol=1e-18)
