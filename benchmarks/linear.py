"""Linear models of excavator_20t: a thousand at once beside differences of the plant, one by one.

Run on an otherwise idle machine: ``python -m benchmarks.linear``. Both run in this process on one
core, equilibria included; the best of three each, of the differences over a few poses only.
"""

from __future__ import annotations

import os

# before numpy starts its threads
os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}

import armdesign as ad
from armdesign.arrays import Array
from armdesign.simulation.plant.equilibrium import find_equilibrium
from benchmarks.maps import MACHINE, poses_of
from benchmarks.timing import best_of
from tests.simulation.differences import plant_of, state_and_command_jacobians

POSES, FEW, LIMIT = 1000, 20, 2.0


def by_differences(machine: ad.Machine, q: Array) -> None:
    """A and B by central differences of order 8, as once."""
    for pose in q:
        plant = plant_of(machine, pose)
        equilibrium = find_equilibrium(plant, pose).state * plant.units
        state_and_command_jacobians(plant, equilibrium, plant.split(equilibrium / plant.units)[4])


def main() -> None:
    """Measure and print everything."""
    machine = ad.load(MACHINE).with_payload("full")
    q = poses_of(machine, 3 * POSES)
    q = q[machine.holds(q)][:POSES]
    at_rest = best_of(lambda: ad.linear_models(machine, q)).wall
    moving = best_of(lambda: ad.linear_models(machine, q, speed=[0.05, 0.0, 0.0])).wall
    differences = best_of(lambda: by_differences(machine, q[:FEW])).wall / FEW * POSES
    reached = "ok" if at_rest < LIMIT else "MISSED"
    print(f"{len(q)} poses at rest       {at_rest:7.3f} s   target < {LIMIT:g} s   {reached}")
    print(f"{len(q)} in steady motion    {moving:7.3f} s")
    print(f"by differences of order 8  {differences:7.3f} s   ratio {differences / at_rest:.0f}")


if __name__ == "__main__":
    main()
