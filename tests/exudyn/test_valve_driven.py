"""Valve-driven motion of the same machines in Exudyn: the difference falls at second order with
its step.

Both plants get the same spools: ours integrates the lag of the spool, the other side has it in
closed form. The laminar range of our metering edges, the one part of the common plant that
Exudyn's actuator lacks, goes into its openings.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

import armdesign as ad
from armdesign import Machine
from armdesign.hydraulics.valve import LAMINAR_DROP
from tests.exudyn.exudyn_machines import named
from tests.exudyn.exudyn_twin import Twin, Valves
from tests.exudyn.exudyn_valve import step_response

DURATION, RATE = 0.5, 100.0  # [s], records per second to compare


COUNTS = (10, 20, 40)  # Exudyn's steps per record


# machine: Exudyn's solver, pose, steps of the commands; pressures stay between vapour and reliefs
RUNS = {
    "paper_1dof": ("ExplicitMidpoint", (0.1,), (0.03,)),
    "patu_boom": ("TrapezoidalIndex2", (0.2,), (-0.2,)),
    "direct_bucket": ("ExplicitMidpoint", (0.3, -1.5, 0.0), (0.1, -0.1, 0.05)),
    "excavator_20t": ("TrapezoidalIndex2", (0.3, -1.2, -1.0), (0.1, -0.1, 0.05)),
}


def laminar_share(drop: float) -> float:
    """Flow of our metering edge over K x √|Δp| sign Δp."""
    return (1 + (LAMINAR_DROP / drop) ** 2) ** -0.25


def valves(machine: Machine, steps: Sequence[float]) -> Valves:
    """Openings of both ports after steps of the commands."""
    responses = [step_response(cylinder.valve) for cylinder in machine.cylinders]
    high, low = machine.supply.pressure, machine.supply.return_pressure

    def openings(time: float, pressures: np.ndarray) -> list[tuple[float, float]]:
        valves_of_twin = []
        for step, response, (cap, annulus) in zip(steps, responses, pressures, strict=True):
            spool = step * response(time)
            drops = (high - cap, annulus - low) if spool >= 0 else (cap - low, high - annulus)
            valves_of_twin.append(
                (spool * laminar_share(drops[0]), -spool * laminar_share(drops[1]))
            )
        return valves_of_twin

    return openings


@pytest.mark.slow
@pytest.mark.parametrize("name", RUNS)
def test_difference_falls_at_second_order(name: str) -> None:
    """Step halved, difference quartered; extrapolated to step zero, half a second goes alike to a
    part in a million.

    Our own tolerance is 1e-8; pressures are compared with their greatest change, the
    extrapolation's error is theirs.
    """
    machine, (solver, pose, steps) = named(name), RUNS[name]
    ours = ad.simulate(
        machine, pose, lambda _: steps, duration=DURATION, rate=RATE, preloaded=True
    )
    assert ours.pressures.min() > 0
    assert ours.pressures.max() < machine.supply.pressure
    twin = Twin(machine, np.array(pose), ours.pressures[0])
    runs = [
        twin.run(solver, 1 / (RATE * count), DURATION, valves(machine, steps)) for count in COUNTS
    ]
    for quantity, tolerance in (("q", 1e-6), ("pressures", 1e-5)):
        expected = getattr(ours, quantity)
        series = [getattr(run, quantity)[::count] for run, count in zip(runs, COUNTS, strict=True)]
        series.append((4 * series[-1] - series[-2]) / 3)
        *differences, last = (
            np.abs(value - expected).max() / np.ptp(expected, axis=0).max() for value in series
        )
        np.testing.assert_allclose(np.divide(differences[:-1], differences[1:]), 4, rtol=0.05)
        assert last < tolerance
