"""What machines of one drawing cost on excavator_20t, measured beside the target.

Run on an otherwise idle machine: ``python -m benchmarks.tolerances``. One core; oil, masses, pins
in the four-bar and elsewhere, structure and the mass of every link differ.
"""

from __future__ import annotations

import os

os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}  # before numpy starts

import numpy as np

import armdesign as ad
from armdesign.influence.rivals import rivals
from armdesign.influence.widths import family_of, widths_of
from benchmarks.main_job import report
from benchmarks.timing import best_of

MACHINE, COUNT = "excavator_20t", 10_000
WIDTHS = {
    "pin_mm": 1.0,
    "bar_mm": 0.5,
    "payload_percent": 10.0,
    "link_mass_percent": 3.0,
    "bulk_modulus_percent": 10.0,
    "entrained_air_percent": 0.2,
    "dead_volume_percent": 10.0,
    "compliance_percent": 30.0,
}


def main() -> None:
    """Measure and print everything."""
    machine = ad.load(MACHINE).replace({f"tolerances.{k}": v for k, v in WIDTHS.items()})
    workspace = ad.Workspace.grid(machine)
    worst = rivals(machine, workspace)[0]
    widths = widths_of(machine)
    places = np.random.default_rng(0).random((COUNT, len(widths)))
    values = np.stack(
        [width.values(at, False) for width, at in zip(widths, places.T, strict=True)], axis=1
    )
    taken = best_of(lambda: worst.frequencies(family_of(machine, widths, values)), 1).wall
    what = f"{COUNT} machines, {len(widths)} numbers"
    report(f"{what}, worst pose", f"{taken:.2f} s", "10 s", taken < 10)
    taken = best_of(lambda: ad.tolerances(machine, workspace, count=COUNT), 1).wall
    report(f"{what}, with all else", f"{taken:.2f} s", "", True)
    taken = best_of(lambda: ad.sensitivity(machine, workspace), 1).wall
    report("sensitivity, linear and exact", f"{taken:.2f} s", "", True)


if __name__ == "__main__":
    main()
