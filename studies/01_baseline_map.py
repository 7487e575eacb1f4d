"""Where in its workspace is each shipped machine's lowest frequency, and which cylinder limits?

At 0.651 Hz the loader crane, boom upright, at 0.767 Hz the 20 t excavator, boom up; on every
machine its lowest cylinder limits ≥ 88 %.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd

import armdesign as ad
from armdesign import plots
from armdesign.machine.loading import shipped

OUT = Path("out") / "01_baseline_map"


def lowest(machine: ad.Machine, workspace: ad.Workspace, draw: bool = False) -> dict[str, Any]:
    """Worst pose, median, limiting cylinder; draws the map if told."""
    frequencies = ad.frequency_map(machine, workspace)
    if draw:
        save(frequencies)
    worst, shares = frequencies.worst, frequencies.limiting_shares
    return {
        "worst_hz": worst.frequency,
        "cylinder": worst.cylinder,
        "payload_at_worst": worst.payload,
        "median_hz": frequencies.percentiles().loc["all", "50 %"],
        "most_often": shares.idxmax(),
        "share": shares.max(),
        "joints": ", ".join(f"{j} {x:.3f}" for j, x in zip(worst.joints, worst.q, strict=True)),
    }


def save(frequencies: ad.FrequencyMap) -> None:
    """Save a machine's map, drawn with its static pressures and moment arms."""
    name = frequencies.machine.name
    frequencies.frame.to_csv(OUT / f"{name}.csv", index=False)
    fig, axes = plots.figure(3)
    frequencies.plot(axes[0])
    frequencies.plot(axes[1], plane="reach")
    plots.holding_pressure(frequencies, axes[2])
    plots.save(fig, OUT / f"{name}.png")
    arms = plots.moment_arm_curves({name: frequencies.machine})
    plots.save(arms, OUT / f"{name}_moment_arms.png")


def run(fast: bool = False, **means: Any) -> pd.DataFrame:
    """Every machine's answers, the lowest first; ``fast``: coarse grids."""
    sweep = ad.sweep([*shipped()], task=lowest, points=9 if fast else None, **means)
    return sweep.answers.sort_values("worst_hz")


def main() -> None:
    """Print the table; save it with every machine's map and static pressures drawn."""
    OUT.mkdir(parents=True, exist_ok=True)
    table = run(options={"draw": True}, workers=2)
    print(
        table.to_string(
            formatters={
                "worst_hz": "{:.3f}".format,
                "median_hz": "{:.3f}".format,
                "share": "{:.0%}".format,
            }
        )
    )
    table.to_csv(OUT / "machines.csv")


if __name__ == "__main__":
    main()
