"""Where in its workspace is each shipped machine's lowest frequency, and which cylinder limits?

At 0.651 Hz the loader crane, boom upright, at 0.767 Hz the 20 t excavator, boom up; on every
machine its lowest cylinder limits ≥ 88 %.
"""

from __future__ import annotations

from pathlib import Path

import pandas as pd

import armdesign as ad
from armdesign.machine.loading import shipped

OUT = Path("out") / "01_baseline_map"


def run(fast: bool = False) -> tuple[pd.DataFrame, dict[str, ad.FrequencyMap]]:
    """Worst pose, median, limiting cylinder of every machine, and the maps; ``fast``: coarse."""
    machines = {name: ad.load(name) for name in shipped()}
    maps = {
        name: ad.frequency_map(machine, ad.Workspace.grid(machine, points=9 if fast else None))
        for name, machine in machines.items()
    }
    rows = [
        {
            "machine": name,
            "worst_hz": frequencies.worst.frequency,
            "cylinder": frequencies.worst.cylinder,
            "payload": frequencies.worst.payload,
            "median_hz": frequencies.percentiles().loc["all", "50 %"],
            "most_often": frequencies.limiting_shares.idxmax(),
            "share": frequencies.limiting_shares.max(),
            "joints": ", ".join(
                f"{j} {x:.3f}"
                for j, x in zip(frequencies.worst.joints, frequencies.worst.q, strict=True)
            ),
        }
        for name, frequencies in maps.items()
    ]
    return pd.DataFrame(rows).set_index("machine").sort_values("worst_hz"), maps


def main() -> None:
    """Print the table; save it with every machine's map and static pressures drawn."""
    from armdesign import plots

    table, maps = run()
    print(
        table.to_string(
            formatters={
                "worst_hz": "{:.3f}".format,
                "median_hz": "{:.3f}".format,
                "share": "{:.0%}".format,
            }
        )
    )
    OUT.mkdir(parents=True, exist_ok=True)
    table.to_csv(OUT / "machines.csv")
    for name, frequencies in maps.items():
        frequencies.frame.to_csv(OUT / f"{name}.csv", index=False)
        fig, axes = plots.figure(3)
        frequencies.plot(axes[0])
        frequencies.plot(axes[1], plane="reach")
        plots.holding_pressure(frequencies, axes[2])
        plots.save(fig, OUT / f"{name}.png")
        plots.save(
            plots.moment_arm_curves({name: frequencies.machine}), OUT / f"{name}_moment_arms.png"
        )


if __name__ == "__main__":
    main()
