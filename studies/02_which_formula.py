"""Which simpler frequency formula is wrong, where in the workspace, and by how much?

Rigid load: ×2.85 to ×4.0 in the median, at most ×32 (boom upright); one cylinder alone: +3 % in
the median, at most +33 %.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import armdesign as ad
from armdesign.arrays import percentiles
from armdesign.machine.loading import shipped

OUT = Path("out") / "02_which_formula"
FORMULAS = {"locked": "each cylinder alone, others locked", "rigid": "static load as a mass"}


def ratios(frequencies: ad.FrequencyMap, formula: str) -> pd.Series[float]:
    """Lowest frequency of a formula over the lowest coupled one, pose by pose."""
    names = [f"{formula}_{cylinder.name}_hz" for cylinder in frequencies.machine.cylinders]
    return frequencies.frame[names].min(axis=1) / frequencies.frame["f1_hz"]


def error(machine: ad.Machine, workspace: ad.Workspace, formula: str) -> dict[str, Any]:
    """Median and worst ratio of a formula, and where that is."""
    frequencies = ad.frequency_map(machine, workspace)
    ratio = ratios(frequencies, formula)
    median, p95 = percentiles(ratio.to_numpy(), frequencies.weights, [50, 95])
    worst = frequencies.frame.iloc[int(ratio.to_numpy().argmax())]
    return {
        "median": median,
        "p95": p95,
        "worst": ratio.max(),
        "lowest_pose": ratio.iloc[int(frequencies.frame["f1_hz"].to_numpy().argmin())],
        "where": ", ".join(f"{joint} {worst[joint]:.2f}" for joint in machine.joints),
        "payload_at_worst": worst["payload"],
    }


def run(fast: bool = False) -> pd.DataFrame:
    """Errors of every formula on every machine; ``fast`` takes coarse grids."""
    formulas = [{"formula": formula} for formula in FORMULAS]
    sweep = ad.sweep([*shipped()], task=error, options=formulas, points=9 if fast else None)
    return sweep.answers


def main() -> None:
    """Print the table; save it with each formula's error over the share of joint space."""
    from armdesign import plots

    table = run()
    print(table.to_string(float_format="{:.2f}".format))
    OUT.mkdir(parents=True, exist_ok=True)
    table.to_csv(OUT / "ratios.csv")
    maps = {name: ad.frequency_map(ad.load(name)) for name in shipped()}
    fig, axes = plots.figure(len(FORMULAS), 6.0, 4.2)
    for ax, (formula, title) in zip(axes, FORMULAS.items(), strict=True):
        for name, frequencies in maps.items():
            percents, values = np.linspace(0, 100, 501), ratios(frequencies, formula).to_numpy()
            ax.plot(percents, percentiles(values, frequencies.weights, percents), label=name)
        ax.set(xlabel="share of joint space [%]", title=title)
        ax.grid(alpha=0.3)
    axes[0].set_ylabel("formula / lowest coupled frequency")
    axes[0].legend(frameon=False)
    plots.save(fig, OUT / "ratios.png")


if __name__ == "__main__":
    main()
