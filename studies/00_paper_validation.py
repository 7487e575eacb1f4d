"""How far are the paper's formulas from simulated frequencies over its 40 configurations?

Root mean square error: (11) 158.5 rad/s, (42) as printed 11.4; the exact formula within 0.01 %.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pandas as pd

import armdesign as ad
from armdesign.paper.configurations import LENGTHS, MACHINE, MASSES, error_of, grid
from armdesign.paper.errata import errata, errata_frame, scan
from armdesign.paper.reproduction import SWEEP, Reproduction, reproduce
from armdesign.simulation.identification.sweep_bias import sweep_bias

OUT = Path("out") / "00_paper_validation"
OPENINGS = (0.002, 0.01, 0.05)  # of the valve in the raw sweep; the paper does not say
CORNERS = (50.0, 400.0), (0.5, 1.5)  # [kg, m]


def run(fast: bool = False) -> tuple[pd.DataFrame, Reproduction]:
    """Errors [rad/s] of every formula, and the measurements at the usual opening of the valve.

    Columns: against the linear answer (closed form, always all 40), the frequencies fitted at
    small amplitude, and the highest spectral line of sweeps with each opening. ``fast`` measures
    four corners.
    """
    configurations = grid(ad.load(MACHINE))
    computed = configurations.frequencies
    table = pd.DataFrame({"linear": error_of(computed, computed["joint_exact"])})
    for opening in (SWEEP.amplitude,) if fast else OPENINGS:
        masses, lengths = CORNERS if fast else (MASSES, LENGTHS)
        reproduction = reproduce(None, masses, lengths, replace(SWEEP, amplitude=opening))
        table["fitted"] = reproduction.errors["identified"]
        table[f"sweep {100 * opening:g} %"] = reproduction.errors["swept"]
        if opening == SWEEP.amplitude:
            usual = reproduction
    return table.rename_axis("formula"), usual


def main() -> None:
    """Print the errors; save them with frequencies, errata, scan and the paper's figures."""
    from armdesign import plots

    table, reproduction = run()
    print(table.to_string(float_format="{:.4g}".format))
    OUT.mkdir(parents=True, exist_ok=True)
    table.to_csv(OUT / "errors.csv")
    reproduction.frame.to_csv(OUT / "paper.csv", index=False)
    errata_frame(errata(reproduction.mechanism)).to_csv(OUT / "errata.csv", index=False)
    scan().to_csv(OUT / "scan.csv", index=False)
    sweep_bias().to_csv(OUT / "sweep_bias.csv", index=False)  # what a sweep alone gets wrong
    for formula in ("static_11", "joint_42_as_printed", "joint_exact"):
        plots.save(reproduction.plot(formula), OUT / f"{formula}.png")


if __name__ == "__main__":
    main()
