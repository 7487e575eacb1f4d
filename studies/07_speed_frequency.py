"""Do bigger cylinders on the 20 t excavator buy more frequency than they cost in joint speed, or
do new pins?

Bores do not: frequency² × speed stays within 0.1 % of today's if dead volumes grow along (20 %
more oil: +12 % if they are fixed). At today's oil the best new sizes make it ×1.11, new pins and
sizes ×1.92.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pandas as pd

import armdesign as ad

MACHINE = "excavator_20t"
OIL = (
    0.9,
    1.0,
    1.1,
    1.2,
)  # swept oil over today's: at the pump's flow joint speeds are its inverse
THRUST = 2.0  # over today's: as good as no limit, so that cylinders may grow
CASES = {"cylinders": ("areas",), "pins too": ("areas", "pins")}
PROPORTIONS = {"all bores, dead volumes too": True, "all bores, dead volumes fixed": False}
OUT = Path("out") / "07_speed_frequency"


def run(fast: bool = False) -> tuple[pd.DataFrame, dict[str, ad.Pareto]]:
    """Worst frequency against oil for both cases, all areas in proportion beside them; ``fast``: a
    coarse grid.
    """
    machine = ad.load(MACHINE)
    workspace = ad.Workspace.grid(machine, points=7 if fast else None)
    free = replace(ad.Requirements.of(machine), thrust_share=THRUST)
    found = {
        case: ad.pareto(
            machine, workspace, free, against="oil", values=OIL, vary=vary, starts=1 if fast else 3
        )
        for case, vary in CASES.items()
    }
    today = ad.frequency_map(machine, workspace).worst.frequency
    frames = [
        pd.DataFrame([scaled(machine, workspace, share, today, volumes) for share in OIL]).assign(
            case=case
        )
        for case, volumes in PROPORTIONS.items()
    ]
    frames += [trade.frame.assign(case=case) for case, trade in found.items()]
    return pd.concat(frames, join="inner", ignore_index=True).set_index(["case", "limit"]), found


def scaled(
    machine: ad.Machine, workspace: ad.Workspace, share: float, today: float, volumes: bool
) -> dict[str, float]:
    """The machine with all areas (and dead volumes) ``share`` of today's."""
    changes = {}
    for name, cylinder in machine.section.cylinder.items():
        for key in ("bore_mm", "rod_mm"):
            changes[f"cylinder.{name}.{key}"] = getattr(cylinder, key) * share**0.5
        for side in ("cap", "annulus") if volumes else ():
            changes[f"cylinder.{name}.dead_volume_l.{side}"] = (
                getattr(cylinder.dead_volume_l, side) * share
            )
    frequency = ad.frequency_map(machine.replace(changes), workspace).worst.frequency
    return {
        "limit": share,
        "frequency_hz": frequency,
        "gain": frequency / today - 1,
        "squared_times_speed": (frequency / today) ** 2 / share,
    }


def main() -> None:
    """Print the table; save it with a figure of frequency and of frequency² × speed against
    oil.
    """
    from armdesign import plots

    table, found = run()
    print(table.to_string(float_format="{:.3f}".format))
    OUT.mkdir(parents=True, exist_ok=True)
    table.to_csv(OUT / "trade_off.csv")
    fig, (left, right) = plots.figure(2, 6.0, 4.6)
    found["pins too"].plot(left)
    for case, rows in table.groupby("case", sort=False):
        oil = rows.index.get_level_values("limit")
        right.plot(oil, rows["squared_times_speed"], "o-", label=str(case))
    right.axhline(1.0, ls="--", color=plots.INK)
    right.set(
        xlabel="swept oil, over today's",
        ylabel="frequency² × joint speed, over today's",
        ylim=(0, None),
    )
    right.legend(frameon=False)
    plots.save(fig, OUT / "trade_off.png")


if __name__ == "__main__":
    main()
