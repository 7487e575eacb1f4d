"""How much do new bores and rods alone raise rigid machines' lowest frequency?

By at most +6.9 % (loader crane), +3.6 % (20 t), nothing with one joint; before rounding to 0.1 mm
no sizes exceed the answers by 0.01 %. Sizes are any, not a catalogue's; oil is without air, too.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd

import armdesign as ad
from armdesign import plots
from armdesign.machine.loading import shipped

OUT = Path("out") / "03_areas_only"


def sized(machine: ad.Machine, workspace: ad.Workspace, draw: bool = False) -> dict[str, Any]:
    """Gain of new sizes, and what no sizes exceed; draws today's map and the new one if told."""
    design = ad.size_cylinders(machine, workspace, bands=ad.Bands(), catalogue="free")
    if draw:
        plots.save(plots.before_after(design), OUT / f"{machine.name}.png")
    return {
        "before_hz": design.before.worst.frequency,
        "after_hz": design.after.worst.frequency,
        "gain": design.after.worst.frequency / design.before.worst.frequency - 1,
        "unrounded_hz": design.unrounded,
        "bound_hz": design.bound,
        "gap": design.gap,
        "dearest": design.binding[0].name if design.binding else "",
    }


def run(fast: bool = False, **means: Any) -> pd.DataFrame:
    """Every machine's answers, the largest gain first; ``fast``: coarse grids."""
    machines = []
    for machine in map(ad.load, shipped()):
        rigid = {f"cylinder.{c.name}.compliance_m_per_N": 0 for c in machine.cylinders}
        machines.append(machine.replace(rigid | {"fluid.entrained_air_percent": 0}))
    sweep = ad.sweep(machines, task=sized, points=9 if fast else None, **means)
    return sweep.answers.sort_values("gain", ascending=False)


def main() -> None:
    """Print the table; save it with today's and the new maps."""
    OUT.mkdir(parents=True, exist_ok=True)
    table = run(options={"draw": True}, workers=2)
    print(table.to_string(formatters={"gain": "{:+.1%}".format, "gap": "{:.2%}".format}))
    table.to_csv(OUT / "gains.csv")


if __name__ == "__main__":
    main()
