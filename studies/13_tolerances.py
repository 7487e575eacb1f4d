"""Which pin is worth moving, what does 1 % of air cost, and how far are derivatives to be trusted?

The boom's base pin: 28 mHz per 10 mm; the stick's pins: none. 1 % of air takes 24 % of 0.767 Hz,
its first 0.2 % half of that. Without air 1 % of machines are 4 mHz off the line, 51 with it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

import armdesign as ad

MACHINE = "excavator_20t"
AIR = (0.0, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0)  # [%] by volume
STEP = 10.0  # [mm] that a pin is moved, along its steepest way
WIDTHS = {  # estimates, either way
    "pin_mm": 1.0,
    "bar_mm": 0.5,
    "payload_percent": 10.0,
    "link_mass_percent": 3.0,
    "bulk_modulus_percent": 10.0,
    "dead_volume_percent": 10.0,
    "compliance_percent": 30.0,
}
TRACE, MORE = 1e-9, 0.2  # [%] of air that machines may have, at most
OUT = Path("out") / "13_tolerances"


def pins(machine: ad.Machine, workspace: ad.Workspace) -> pd.Series:
    """Change of the worst frequency [Hz] by a step of each pin along its steepest way."""
    slopes = ad.sensitivity(machine, workspace).frame.set_index("key")["hz_per_unit"]
    slopes = slopes[slopes.index.str.match(r"cylinder\..*\.at_mm\.[02]$")]
    steepest = slopes.groupby(lambda path: path.rpartition(".at_mm")[0]).agg(np.linalg.norm)
    return (STEP * steepest).sort_values(ascending=False).rename("hz")


def air(machine: ad.Machine, points: int | None) -> pd.Series:
    """Worst frequency [Hz] by air [%]."""
    answers = ad.sweep(machine, {"fluid.entrained_air_percent": AIR}, points=points).answers
    return answers["worst_hz"].rename_axis(None)


def trust(machine: ad.Machine, workspace: ad.Workspace) -> pd.DataFrame:
    """Deviation, and errors of the linear estimate [Hz], without and with air, by width."""
    rows = {}
    for words, most in (("no air", TRACE), ("air", MORE)):
        for scale in (0.1, 1.0, 3.0):
            widths = {**WIDTHS, "entrained_air_percent": most}
            stated = {f"tolerances.{key}": scale * width for key, width in widths.items()}
            answer = ad.tolerances(machine.replace(stated), workspace)
            rows[words, scale] = {
                "deviation_hz": answer.frequencies.std(),
                "error_1_percent_hz": answer.percentiles.loc["1 %"].diff()["linear"],
                "largest_error_hz": np.abs(answer.linear - answer.frequencies).max(),
            }
    return pd.DataFrame(rows).T


def run(fast: bool = False) -> tuple[pd.Series | pd.DataFrame, ...]:
    """Pins, air, and trust in derivatives; ``fast``: coarse grid, the worst pose is refined."""
    machine, points = ad.load(MACHINE), 7 if fast else None
    workspace = ad.Workspace.grid(machine, points)
    return pins(machine, workspace), air(machine, points), trust(machine, workspace)


def main() -> None:
    """Print and save the tables."""
    OUT.mkdir(parents=True, exist_ok=True)
    for name, table in zip(("pins", "air", "trust"), run(), strict=True):
        print(f"{table.round(4).to_string()}\n")
        table.to_csv(OUT / f"{name}.csv")


if __name__ == "__main__":
    main()
