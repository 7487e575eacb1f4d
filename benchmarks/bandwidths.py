"""Time of a bandwidth map of 2 000 poses and 2 load cases of excavator_20t.

Run on an otherwise idle machine: ``python -m benchmarks.bandwidths``. One core; beside the wall
time stands the processor time, which a busy machine spoils less. Compiling and loading compiled
code is not part of it.
"""

from __future__ import annotations

import os

# before numpy starts its threads
os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}

import numpy as np

import armdesign as ad
from benchmarks.timing import best_of

MACHINE, POSES, TARGET = "excavator_20t", 2_000, 20.0  # [s]


def main() -> None:
    """Measure and print the time."""
    machine = ad.load(MACHINE)
    ad.bandwidth_map(machine, ad.Workspace.grid(machine, points=2), damping=0.02)
    # Poses at which both load cases exist: 2 000 of them in 2 load cases.
    grid = ad.Workspace.grid(machine, points=25)
    rows = np.flatnonzero(grid.holds(machine.payloads[-1]))
    chosen = np.random.default_rng(1).choice(rows, POSES, replace=False)
    workspace = grid.subset(np.sort(chosen))
    wall, spent, bandwidths = best_of(
        lambda: ad.bandwidth_map(machine, workspace, damping=0.02), 1
    )
    worst = bandwidths.worst()
    reached = "ok" if spent < TARGET else "MISSED"
    print(
        f"{POSES} poses × {len(machine.payloads)} load cases, {len(bandwidths.frame)} rows:"
        f" {wall:.1f} s ({spent:.1f} s of the processor)   target < {TARGET:g} s   {reached}"
    )
    print(f"worst bandwidth {worst['own_hz']:.3f} Hz at {worst['f1_hz']:.3f} Hz")


if __name__ == "__main__":
    main()
