"""Figures that poses and maps must reach on excavator_20t, measured beside their targets.

Run on an otherwise idle machine: ``python -m benchmarks.maps``. Both sides of the ratio run in
this process on one core, the best of five each; memory is the peak of processes of their own.
"""

from __future__ import annotations

import os

# before numpy starts its threads
os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}

import resource
import subprocess
import sys
import time

import numpy as np
import pinocchio

import armdesign as ad
from armdesign.arrays import Array

MACHINE = "excavator_20t"
POSES, MANY = 100_000, 1_000_000
TASKS = ("modes", "map")


def poses_of(machine: ad.Machine, count: int) -> Array:
    """Random poses in stroke."""
    low, high = machine.range_within(0.02).T
    return np.random.default_rng(1).uniform(low, high, (count, len(low)))


def on_a_spring(machine: ad.Machine) -> ad.Machine:
    """The machine whose boom foot rolls."""
    hinge = (
        '<joint name="boom_foot" type="revolute"><axis xyz="1 0 0"/><limit lower="-0.1"'
        ' upper="0.1" effort="1" velocity="1"/>'
    )
    urdf = machine.urdf_text.replace('<joint name="boom_foot" type="fixed">', hinge)
    spring = '[spring.foot]\njoint = "boom_foot"\nstiffness_N_m_per_rad = 5e7\n'
    return ad.Machine.from_text(f"{machine.text}\n{spring}", urdf, machine.source)


def rigid_loop(model: pinocchio.Model, q: Array) -> tuple[Array, Array, Array]:
    """What a Python loop over Pinocchio takes at least: M, g and ∂g/∂q, stored."""
    data = model.createData()
    n, nq = q.shape
    mass, gravity, slope = np.empty((n, nq, nq)), np.empty((n, nq)), np.empty((n, nq, nq))
    for row, at in enumerate(q):
        mass[row] = pinocchio.crba(model, data, at)
        slope[row] = pinocchio.computeGeneralizedGravityDerivatives(model, data, at)
        gravity[row] = data.g
    return mass, gravity, slope


def many(task: str) -> None:
    """Time and peak memory of a million poses: all arrays and modes, or the map, printed."""
    machine = ad.load(MACHINE).with_payload("full")
    start = time.perf_counter()
    if task == "modes":
        poses = machine.at(poses_of(machine, MANY))
        kept: object = (poses, ad.natural_modes(poses))
    else:
        kept = ad.frequency_map(machine, ad.Workspace.grid(machine, points=round(MANY ** (1 / 3))))
    assert kept is not None
    print(
        time.perf_counter() - start, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024**2
    )


def main() -> None:
    """Measure and print everything."""
    machine = ad.load(MACHINE)
    ratio("rigid", machine.with_payload("full"))
    ratio("on a spring", on_a_spring(machine).with_payload("full"))
    for task in TASKS:
        run = subprocess.run(
            [sys.executable, __file__, task], check=True, capture_output=True, text=True
        )
        time_, memory = (float(word) for word in run.stdout.split())
        reached = "ok" if memory < 1 else "MISSED"
        print(
            f"{MANY:,} poses, {task:<5} {time_:5.1f} s  {memory:5.2f} GiB   target < 1 GiB  "
            f" {reached}"
        )


def ratio(label: str, machine: ad.Machine) -> None:
    """Measure and print the time of all arrays and modes over the loop's."""
    model = pinocchio.buildModelFromXML(machine.arm.xml)
    q = poses_of(machine, POSES)
    coordinates, seconds = machine.arm.with_springs(q), dict[str, float]()
    for _ in range(5):
        for name, action in (
            ("loop", lambda: rigid_loop(model, coordinates)),
            ("modes", lambda: ad.natural_modes(machine.at(q))),
        ):
            start = time.perf_counter()
            action()
            seconds[name] = min(time.perf_counter() - start, seconds.get(name, np.inf))
    times = seconds["modes"] / seconds["loop"]
    print(
        f"{POSES:,} poses, one payload, {label}: loop over pinocchio {seconds['loop']:.2f} s,"
        f" modes {seconds['modes']:.2f} s"
    )
    print(
        f"ratio                        {times:5.2f}       target ≤ 2      "
        f" {'ok' if times <= 2 else 'MISSED'}"
    )


if __name__ == "__main__":
    many(sys.argv[1]) if sys.argv[1:] else main()
