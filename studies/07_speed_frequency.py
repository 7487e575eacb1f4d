"""Do bigger cylinders on a rigid 20 t excavator raise frequency more than they lower joint speed?

No: frequency² × speed stays within 0.1 % of today's if dead volumes grow in proportion (+12 % with
20 % more oil if not). At today's oil the best free sizes make it ×1.07, with pins ×1.29.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path

import pandas as pd

import armdesign as ad
from armdesign.journal.finished import keeping

MACHINE = "excavator_20t"
RIGID = {f"cylinder.{name}.compliance_m_per_N": 0 for name in ("boom", "stick", "bucket")}
OIL = (0.95, 1.0, 1.1, 1.2)  # swept, over today's: at the pump's flow speeds are its inverse
THRUST = 2.0  # over today's: as good as no limit, so that cylinders may grow
CASES = {"cylinders": ("areas",), "pins too": ("areas", "pins")}
PROPORTIONS = {"all bores, dead volumes too": True, "all bores, dead volumes fixed": False}
OUT = Path("out") / "07_speed_frequency"


def run(fast: bool = False) -> tuple[pd.DataFrame, dict[str, ad.Pareto]]:
    """Worst frequency against oil: areas, pins too, all areas in proportion; ``fast``: coarse."""
    machine = ad.load(MACHINE).replace(RIGID)
    workspace = ad.Workspace.grid(machine, points=7 if fast else None)
    free = replace(ad.Requirements.of(machine), thrust_share=THRUST)
    best = partial(ad.pareto, machine, workspace, free, "oil", OIL, bands=ad.Bands())
    best_free = partial(best, catalogue="free", starts=1 if fast else 3)
    trades = {case: best_free(vary=vary) for case, vary in CASES.items()}
    frame = pd.DataFrame(product(PROPORTIONS, OIL), columns=["case", "limit"])
    changes = [scaled(machine, x, PROPORTIONS[case]) for case, x in frame.to_numpy()]
    hz = ad.sweep(machine, changes, workspace=workspace).answers["worst_hz"].to_numpy()
    ratio = hz / hz[OIL.index(1.0)]
    speeds = {"gain": ratio - 1, "squared_times_speed": ratio**2 / frame["limit"]}
    fronts = [trade.frame.assign(case=case) for case, trade in trades.items()]
    frames = [frame.assign(frequency_hz=hz, **speeds), *fronts]
    return pd.concat(frames, join="inner").set_index(["case", "limit"]), trades


def scaled(machine: ad.Machine, share: float, volumes: bool) -> dict[str, float]:
    """Changes that make all areas (and dead volumes) ``share`` of today's."""
    changes = {}
    for name, cylinder in machine.section.cylinder.items():
        for key in ("bore_mm", "rod_mm"):
            changes[f"cylinder.{name}.{key}"] = getattr(cylinder, key) * share**0.5
        for side in ("cap", "annulus") if volumes else ():
            volume = getattr(cylinder.dead_volume_l, side) * share
            changes[f"cylinder.{name}.dead_volume_l.{side}"] = volume
    return changes


def main() -> None:
    """Print the table; save it with frequency and frequency² × speed drawn against oil."""
    from armdesign import plots

    with keeping(OUT / "journal.sqlite"):  # with which an interrupted run goes on
        table, trades = run()
    print(table.to_string(float_format="{:.3f}".format))
    OUT.mkdir(parents=True, exist_ok=True)
    table.to_csv(OUT / "trade_off.csv")
    fig, (left, right) = plots.figure(2, 6.0, 4.6)
    trades["pins too"].plot(left)
    for case, rows in table.groupby("case", sort=False):
        right.plot(rows.loc[case].index, rows["squared_times_speed"], "o-", label=str(case))
    right.axhline(1.0, ls="--", color=plots.INK)
    right.set(xlabel="swept oil, over today's", ylim=(0, None))
    right.set_ylabel("frequency² × joint speed, over today's")
    right.legend(frameon=False)
    plots.save(fig, OUT / "trade_off.png")


if __name__ == "__main__":
    main()
