"""How much do new bores and rods alone raise rigid machines' lowest frequency?

By at most +6.9 % (loader crane), +3.6 % (20 t), nothing with one joint; before rounding to 0.1 mm
no sizes exceed the answers by 0.01 %. Sizes are any, not a catalogue's; oil is without air, too.
"""

from __future__ import annotations

from pathlib import Path

import pandas as pd

import armdesign as ad
from armdesign.machine.loading import shipped

OUT = Path("out") / "03_areas_only"


def run(fast: bool = False) -> tuple[pd.DataFrame, dict[str, ad.Design]]:
    """Gain of new sizes on every machine, and what no sizes exceed; ``fast``: coarse grids."""
    designs = {}
    for name in shipped():
        machine = ad.load(name)
        rigid = {f"cylinder.{c.name}.compliance_m_per_N": 0 for c in machine.cylinders}
        machine = machine.replace(rigid | {"fluid.entrained_air_percent": 0})
        workspace = ad.Workspace.grid(machine, points=9 if fast else None)
        designs[name] = ad.size_cylinders(machine, workspace, bands=ad.Bands(), catalogue="free")
    rows = [
        {
            "machine": name,
            "before_hz": design.before.worst.frequency,
            "after_hz": design.after.worst.frequency,
            "gain": design.after.worst.frequency / design.before.worst.frequency - 1,
            "unrounded_hz": design.unrounded,
            "bound_hz": design.bound,
            "gap": design.gap,
            "dearest": design.binding[0].name if design.binding else "",
        }
        for name, design in designs.items()
    ]
    return pd.DataFrame(rows).set_index("machine").sort_values("gain", ascending=False), designs


def main() -> None:
    """Print the table; save it with a figure of the gains."""
    from armdesign import plots

    table, designs = run()
    print(table.to_string(formatters={"gain": "{:+.1%}".format, "gap": "{:.2%}".format}))
    OUT.mkdir(parents=True, exist_ok=True)
    table.to_csv(OUT / "gains.csv")
    for name, design in designs.items():
        plots.save(plots.before_after(design), OUT / f"{name}.png")


if __name__ == "__main__":
    main()
