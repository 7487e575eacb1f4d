"""Our simulation against Exudyn's on the common plant: measured time for equal accuracy.

Run on an otherwise idle machine: ``python -m benchmarks.against_exudyn``. Both run in this process
on one core, the best of five each. The plant is the 20 t machine without its four-bar (Exudyn's
explicit solvers, its fast ones, take no loop), three valves open at once; in the batch by another
share in each case. Each side's error is its greatest difference in a joint from its own finest run
over the way gone: that both converge to the same motion is what ``tests/exudyn`` proves. Exudyn
runs as fast as it can: module without range checks, spools in closed form, nothing recorded that
is not compared. It runs a batch one by one, we stack it.
"""

from __future__ import annotations

import os

# before numpy starts its threads
os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
os.environ |= {"EXUDYN_MODULE": "fast"}

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from armdesign import Machine
from armdesign.arrays import Array
from armdesign.simulation import simulate as motion
from benchmarks.timing import best_of
from tests.exudyn.exudyn_machines import named
from tests.exudyn.exudyn_twin import Twin, Valves
from tests.exudyn.exudyn_valve import step_response

POSE, STEPS = (0.3, -1.5, 0.0), (0.1, -0.1, 0.05)
DURATION, RATE = 2.0, 100.0
TIMES = 5  # of each run
TOLERANCES = (1e-4, 1e-5, 1e-6, 1e-7)
# Exudyn's steps per record
SOLVERS = {"ExplicitMidpoint": (4, 10, 40, 100), "RK44": (2, 4, 10, 30)}
FINEST = 200
# times as fast, of a single run and of a batch, down to an error of 1e-6 and below it
TARGETS, FINE, FINER = {1: 2, 8: 5}, 1e-6, {1: 4, 8: 5}
SHARES = (1.0,), tuple(np.linspace(0.3, 1.0, 8).tolist())  # of the steps: a single run, a batch


def ours(machine: Machine, shares: Sequence[float], tolerance: float) -> Array:
    """Joint positions (cases, n, nq) of our simulation at a tolerance of its integration."""
    cases = [
        motion.SimulationCase(
            machine=machine,
            q=POSE,
            command=constant(share),
            duration=DURATION,
            rate=RATE,
            preloaded=True,
        )  # pressures stay between vapour and reliefs, which Exudyn's model does not know
        for share in shares
    ]
    return np.array([run.q for run in motion.simulate_all(cases, tolerance=tolerance)])


def constant(share: float) -> Callable[[float], list[float]]:
    """A share of all steps from the start on."""
    return lambda _: [share * step for step in STEPS]


def theirs(twin: Twin, valves: Sequence[Valves], solver: str, count: int) -> Array:
    """Joint positions (cases, n, nq) of Exudyn's with so many steps per record."""
    return np.array(
        [twin.run(solver, 1 / (RATE * count), DURATION, own, 1 / RATE).q for own in valves]
    )


def spools(machine: Machine, share: float) -> Valves:
    """Openings of both ports: a symmetric valve whose spool answers a step."""
    responses = [step_response(cylinder.valve) for cylinder in machine.cylinders if cylinder.valve]

    def openings(now: float, _: Array) -> list[tuple[float, float]]:
        positions = [
            share * step * response(now) for step, response in zip(STEPS, responses, strict=True)
        ]
        return [(x, -x) for x in positions]

    return openings


def error(q: Array, finest: Array) -> float:
    """Greatest difference over the way gone, of the worst case."""
    ways = np.ptp(finest, axis=1).max(axis=1)
    return float((np.abs(q - finest).max(axis=(1, 2)) / ways).max())


def rivals(machine: Machine, shares: Sequence[float]) -> dict[str, tuple[Array, Array]]:
    """Errors and times [s] of Exudyn's solvers, coarse steps first; printed."""
    start = motion.simulate(
        machine, POSE, lambda _: STEPS, duration=1 / RATE, rate=RATE, preloaded=True
    ).pressures[0]
    twin, valves = (
        Twin(machine, np.array(POSE), start),
        [spools(machine, share) for share in shares],
    )
    finest = theirs(twin, valves, "RK44", FINEST)
    errors_and_seconds = {}
    for solver, counts in SOLVERS.items():
        runs = [best_of(partial(theirs, twin, valves, solver, count), TIMES) for count in counts]
        errors_and_seconds[solver] = (
            np.array([error(run.result, finest) for run in runs]),
            np.array([run.processor for run in runs]),
        )
        for count, off, seconds in zip(counts, *errors_and_seconds[solver], strict=True):
            print(
                f"Exudyn     {solver:<17} {RATE * count:6.0f} steps/s   {seconds:7.3f} s   error"
                f" {off:.1e}"
            )
    return errors_and_seconds


def main() -> None:
    """Measure and print our time and the fastest solver's at our error."""
    machine = named("direct_bucket")
    for shares in SHARES:
        print(f"\n{len(shares)} run{'s' * (len(shares) > 1)} of {DURATION:g} s")
        errors_and_seconds, finest = rivals(machine, shares), ours(machine, shares, 1e-10)
        for tolerance in TOLERANCES:
            _, seconds, q = best_of(partial(ours, machine, shares, tolerance), TIMES)
            off = error(q, finest)
            times = {
                solver: float(np.exp(np.interp(-np.log(off), -np.log(errors), np.log(spent))))
                for solver, (errors, spent) in errors_and_seconds.items()
            }
            best = min(times, key=lambda solver: times[solver])
            print(
                f"armdesign  tolerance {tolerance:<21.0e}  {seconds:7.3f} s   error {off:.1e}",
                end="   ",
            )
            ratio = times[best] / seconds
            target = TARGETS[len(shares)] if off > FINE else FINER[len(shares)]
            reached = "ok" if ratio >= target else "MISSED"
            print(f"{ratio:5.2f} × as fast as {best}   target ≥ {target}   {reached}")


if __name__ == "__main__":
    main()
