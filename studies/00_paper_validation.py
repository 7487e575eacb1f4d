"""How far are the source paper's formulas from simulated frequencies over its 40 configurations?

Root mean square: static mass in (11) 158.5 rad/s, (42) as printed 11.4; exact within 0.01 %
of each.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pandas as pd

import armdesign as ad
from armdesign.paper import reproduction as paper
from armdesign.simulation.identification.sweep_bias import sweep_bias

OUT = Path("out") / "00_paper_validation"
OPENINGS = (0.002, 0.01, 0.05)  # of the valve in the raw sweep; the paper does not say
CORNERS = (50.0, 400.0), (0.5, 1.5)  # [kg, m]


def run(fast: bool = False) -> tuple[pd.DataFrame, paper.Reproduction]:
    """Errors [rad/s] of every formula, and the measurements; ``fast`` measures four corners.

    Columns: against the linear answer (closed form, always all 40), the frequencies fitted at
    small amplitude, and the highest line of sweeps with each opening.
    """
    grid = paper.grid(ad.load(paper.MACHINE))
    computed = grid.frequencies
    table = pd.DataFrame({"linear": paper.error_of(computed, computed["joint_exact"])})
    for opening in (paper.SWEEP.amplitude,) if fast else OPENINGS:
        masses, lengths = CORNERS if fast else (paper.MASSES, paper.LENGTHS)
        found = paper.reproduce(None, masses, lengths, replace(paper.SWEEP, amplitude=opening))
        table["fitted"] = found.errors["identified"]
        table[f"sweep {100 * opening:g} %"] = found.errors["swept"]
        if opening == paper.SWEEP.amplitude:
            usual = found
    return table.rename_axis("formula"), usual


def main() -> None:
    """Print the errors; save them with frequencies, errata, scan and the paper's figures."""
    from armdesign import plots

    table, found = run()
    print(table.to_string(float_format="{:.4g}".format))
    OUT.mkdir(parents=True, exist_ok=True)
    table.to_csv(OUT / "errors.csv")
    found.frame.to_csv(OUT / "paper.csv", index=False)
    paper.errata_frame(paper.errata(found.mechanism)).to_csv(OUT / "errata.csv", index=False)
    paper.scan().to_csv(OUT / "scan.csv", index=False)
    sweep_bias().to_csv(OUT / "sweep_bias.csv", index=False)  # what a sweep alone gets wrong
    for formula in ("static_11", "joint_42_as_printed", "joint_exact"):
        plots.save(found.plot(formula), OUT / f"{formula}.png")


if __name__ == "__main__":
    main()
