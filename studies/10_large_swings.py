"""How much lower does the 20 t excavator ring in large swings, and is a measured one alike?

After a hard boom-down stop 1.25 Hz rises to 1.70 Hz (×0.74) as it decays; measured ×0.63 to ×0.91.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd

import armdesign as ad

MACHINE, POSE = "excavator_20t", (0.6, -0.9, -0.6)  # empty, the arm out
COMMAND, BEGIN, END = -0.6, 0.1, 0.7  # of the boom's spool; [s]
SMOOTHING = 0.14  # [s], about a period of the second mode
# An excavator of unknown make, 20 to 30 t class, empty rod chamber: 1.0 to 1.45 Hz in the first
# swings of 200 bar after a boom-down stop, rising to 1.6 Hz as they decay.
MEASURED_FIRST, MEASURED_LAST, MEASURED_SWING = (1.0, 1.45), 1.6, 200.0
OUT = Path("out") / "10_large_swings"


def run() -> tuple[pd.DataFrame, ad.Simulation]:
    """Frequency and pressure swing of the cap, swing by swing, and the run."""
    down = {"boom": ad.Step(size=COMMAND, begin=BEGIN, end=END)}
    motion = ad.simulate(
        ad.load(MACHINE), POSE, down, payload="empty", duration=9.0, tolerance=1e-6
    )
    ring = motion.ring()
    later = motion.time >= ring.begin
    time, frame = motion.time[later], motion.frame[later]
    width = round(SMOOTHING / (time[1] - time[0]))
    speed = np.convolve(motion.velocity[later, 0], np.ones(width) / width, "same")
    ups = [k for k in range(width, len(time) - width) if speed[k] < 0 <= speed[k + 1]]
    at = [time[k] - speed[k] * (time[k + 1] - time[k]) / (speed[k + 1] - speed[k]) for k in ups]
    rows = [
        {
            "time_s": (begin + end) / 2,
            "frequency_hz": 1 / (end - begin),
            "swing_bar": np.ptp(frame["boom_cap_bar"][(time >= begin) & (time <= end)]) / 2,
            "annulus_bar": frame["boom_annulus_bar"][(time >= begin) & (time <= end)].max(),
        }
        for begin, end in pairwise(at)
    ]
    return pd.DataFrame(rows).assign(linear_hz=ring.linear_frequencies[0]), motion


def main() -> None:
    """Print the table; save it, with both pressures of the boom and frequency against swing."""
    from armdesign import plots

    table, motion = run()
    print(table.round(3).to_string(index=False))
    OUT.mkdir(parents=True, exist_ok=True)
    table.to_csv(OUT / "swings.csv", index=False)
    fig, axes = plots.figure(2)
    for side in ("cap", "annulus"):
        axes[0].plot(motion.time, motion.frame[f"boom_{side}_bar"], label=f"boom, {side}")
    axes[0].set(xlabel="time [s]", ylabel="pressure [bar]")
    axes[0].legend()
    axes[1].plot(table["swing_bar"], table["frequency_hz"], "o-", label="simulated, 20 t")
    axes[1].axhline(table["linear_hz"].iloc[0], color="gray", label="linear")
    axes[1].vlines(MEASURED_SWING, *MEASURED_FIRST, colors="C3", label="measured, first swings")
    axes[1].axhline(MEASURED_LAST, color="C3", linestyle="--", label="measured, decayed")
    axes[1].set(
        xlabel="swing of the cap's pressure [± bar]", ylabel="frequency [Hz]", ylim=(0, None)
    )
    axes[1].legend(loc="lower left")
    plots.save(fig, OUT / "swings.png")


if __name__ == "__main__":
    main()
