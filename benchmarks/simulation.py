"""Figures that the simulation must reach on excavator_20t, measured beside their targets.

``python -m benchmarks.simulation``: one core, one process, simulated time over processor time
(which is wall time on an idle machine), best of three. A sweep of the boom's valve to 1.5 × the
lowest mode, three cylinders, with the slow loop and the energy book.
"""

from __future__ import annotations

import os

# before numpy starts its threads
os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}

import numpy as np
from scipy.integrate import solve_ivp

import armdesign as ad
from armdesign.arrays import Array
from armdesign.simulation.controlled_plant import ControlledPlant
from armdesign.simulation.experiment import Experiment
from armdesign.simulation.plant.equilibrium import find_equilibrium
from armdesign.simulation.plant.plant import Plant
from armdesign.simulation.simulate import SimulationCase, simulate_all
from benchmarks.timing import best_of

TOLERANCE, CASES = 1e-6, 40
FINEST, TRIED = 1e-11, (1e-6, 1e-7, 1e-8, 1e-9)  # tolerances of scipy
POSE = np.array([1.154, -1.199, -2.191])  # near the worst


def sweeps() -> list[SimulationCase]:
    """Cases that differ in payload, pose and amplitude."""
    rows = []
    for number in range(CASES):
        machine = ad.load("excavator_20t").with_payload(400.0 + 40 * (number % 20))
        pose = POSE + np.array([0.0, 0.004, 0.003]) * number
        experiment = Experiment.of(machine, pose, 0, 0)
        commands = experiment.commands(experiment.swept_sine(5e-4 * (1 + number % 3) / 2))
        hold = 0.25 * experiment.band[0]
        rows.append(
            SimulationCase(
                machine=machine,
                q=pose,
                command=commands,
                duration=16.0,
                rate=60,
                hold=hold,
                preloaded=True,
            )
        )
    return rows


def by_scipy(case: SimulationCase, method: str, tolerance: float) -> tuple[float, Array]:
    """Processor time [s] and states of one case by scipy on the same right-hand side."""
    plant = Plant(case.machine)
    start = find_equilibrium(plant, case.q, case.preloaded).state
    system = ControlledPlant.of([plant], [start], [case.command], [case.hold])
    instants = np.linspace(0.0, case.duration, round(case.duration * case.rate) + 1)

    def run() -> Array:
        solution = solve_ivp(
            lambda t, y: system.rates(np.array([t]), y[None])[0],
            (0.0, case.duration),
            system.start[0],
            method=method,
            t_eval=instants,
            rtol=tolerance,
            atol=tolerance,
        )
        return np.asarray(solution.y.T)

    _, seconds, states = best_of(run, 2)
    return seconds, states


def at_equal_error(case: SimulationCase, finest: Array, method: str, off: float) -> float:
    """Processor time [s] in which scipy reaches an error of q [rad]."""
    spent, errors = [], []
    for tolerance in TRIED:
        time_, states = by_scipy(case, method, tolerance)
        spent.append(time_)
        errors.append(np.abs(states[:, : len(finest[0])] - finest).max())
    return float(np.exp(np.interp(-np.log(off), -np.log(errors), np.log(spent))))


def report(what: str, figure: float, target: str, reached: bool) -> None:
    """One line: figure, target, whether it is reached."""
    print(f"{what:<46} {figure:>8.1f} ×   target {target:<24} {'ok' if reached else 'MISSED'}")


def main() -> None:
    """Measure and print everything."""
    cases = sweeps()
    single_run = best_of(lambda: simulate_all(cases[:1], tolerance=TOLERANCE))
    seconds, run = single_run.processor, single_run.result[0]
    single = cases[0].duration / seconds
    report("one run, real time", single, "≥ 10, aim 30", single >= 10)
    total = sum(case.duration for case in cases)
    stacked = total / best_of(lambda: simulate_all(cases, tolerance=TOLERANCE)).processor
    report(f"{CASES} runs stacked, real time", stacked, "≥ 250", stacked >= 250)
    print(f"{'stacked over one by one':<46} {stacked / single:>8.1f} ×")
    finest = by_scipy(cases[0], "DOP853", FINEST)[1][:, : run.q.shape[1]]
    off = float(np.abs(run.q - finest).max())
    for method in ("RK45", "DOP853", "LSODA"):
        ratio = at_equal_error(cases[0], finest, method, off) / seconds
        report(f"one run over {method} at its error, {off:.0e}", ratio, "≥ 1", ratio >= 1)
    print(f"{'energy balance of that run closes within':<46} {run.energy_error:>8.0e}")


if __name__ == "__main__":
    main()
