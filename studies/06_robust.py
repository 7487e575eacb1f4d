"""What does a rigid 20 t excavator designed for uncertain load, air and oil gain, and what lose?

Its worst case is +12 % on today's (0.63 against 0.57 Hz) at a cost of 0.5 % at the file's values;
the design for those keeps +8 % of its +14 % there. Sizes and pins are any, not a catalogue's.
"""

from __future__ import annotations

from pathlib import Path

import pandas as pd

import armdesign as ad

MACHINE = "excavator_20t"
RIGID = {f"cylinder.{name}.compliance_m_per_N": 0 for name in ("boom", "stick", "bucket")}
BANDS = ad.Bands(
    bulk_modulus=(0.8, 1.1),  # over the file's: temperature and make of the oil
    air=(0.0, 0.01),  # entrained, by volume at atmospheric pressure
    payload=(0.8, 1.2),  # over the file's: wet or dry, heaped or struck
    link_mass=(0.95, 1.05),  # over the file's: castings, hoses, grease
)
OUT = Path("out") / "06_robust"


def run(fast: bool = False) -> tuple[pd.DataFrame, dict[str, ad.Design]]:
    """Frequency bands of today's machine and both optima; ``fast``: coarse grid, one start."""
    machine = ad.load(MACHINE).replace(RIGID)
    workspace = ad.Workspace.grid(machine, points=9 if fast else None)
    starts = 1 if fast else 3
    designs = {
        made_for: ad.optimize(
            machine, workspace, starts=starts, bands=bands, objective="worst", catalogue="free"
        )
        for made_for, bands in (("file", ad.Bands()), ("bands", BANDS))
    }
    machines = {"today": machine} | {
        f"for the {name}": design.machine for name, design in designs.items()
    }
    rows = {}
    for name, model in machines.items():
        band = ad.frequency_band(model, workspace, BANDS, today=machine)
        rows[name] = {
            "least_hz": band.low.frequency,
            "file_hz": band.nominal,
            "greatest_hz": band.high.frequency,
            "payload": band.low.payload,
            "payload_share": band.low.corner.payload_share,
            "link_share": band.low.corner.link_share,
        }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("machine"), designs


def main() -> None:
    """Print the table; save it with the bands and the robust design's moment arms drawn."""
    from armdesign import plots

    table, designs = run()
    print(table.to_string(float_format="{:.3f}".format))
    OUT.mkdir(parents=True, exist_ok=True)
    table.to_csv(OUT / "bands.csv")
    fig, (ax,) = plots.figure(1, 6.4, 3.2)
    for place, row in enumerate(table.itertuples()):
        ax.hlines(place, row.least_hz, row.greatest_hz, lw=6, color=plots.COMPUTED, alpha=0.5)
        label = "_nolegend_" if place else "as in the file"
        ax.plot(row.file_hz, place, "o", color=plots.INK, label=label)
    ax.set(yticks=range(len(table)), yticklabels=table.index)
    ax.set(xlabel="worst natural frequency [Hz]", xlim=(0, None))
    ax.grid(alpha=0.3)
    ax.legend(frameon=False)
    plots.save(fig, OUT / "bands.png")
    plots.save(plots.moment_arms(designs["bands"]), OUT / "moment_arms.png")


if __name__ == "__main__":
    main()
