"""Which rule costs the shipped excavators their gain, in real numbers and as they can be built?

All rules leave the 20 t machine +12.7 %, buildable +6.9 %. Without the one that rods buckle no
sooner +14.5 and +11.6 %; without those on torque +18.3 and +15.2 %; without these and those on
room, so that lift alone is kept, +18.9 and +15.7 %; without that on lift +22.0 and +15.2 %, and
somewhere 76 % of the lift.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd

import armdesign as ad

MACHINES = ("excavator_20t", "excavator_12t", "mini_excavator_2t")
TORQUE = {"torque_share": 0.0, "end_torque_share": 0.0, "digging_share": 0.0}
ROOM: dict[str, Any] = {"outlines": (), "clearances": ()}
RULES: dict[str, dict[str, Any]] = {  # settings without each
    "none": {},
    "lift": {"lift_share": 0.0},
    "torque": TORQUE,
    "buckling": {"buckling_share": 0.0},
    "moment arms": {"moment_arm_share": 0.0},
    "thrust": {"thrust_share": 10.0},
    "oil of each": {"oil_each_share": 10.0},
    "room": ROOM,
    "torque, room": TORQUE | ROOM,  # lift alone
    "today's oil, 10 % more": {"oil_total_share": 1.1},
}
OUT = Path("out") / "15_rules"
JOURNAL = OUT / "journal.sqlite"  # with which an interrupted run goes on


def gains(machine: ad.Machine, workspace: ad.Workspace, without: str) -> dict[str, float | None]:
    """Least gain within the bands without a rule, and the least share of today's lift."""
    rules = replace(ad.Requirements.of(machine), **RULES[without])
    design = ad.optimize(machine, workspace, rules)
    today = design.problem.dynamics.corners.nominal
    return {
        "real": max(design.starts) / today - 1,
        "built": design.least_gain,
        "lift_share": design.lift_share,
    }


def run(
    machines: Sequence[str] = MACHINES, rules: Iterable[str] = tuple(RULES), **means: Any
) -> pd.DataFrame:
    """Gains without each rule, by machine and rule."""
    every = [{"without": rule} for rule in rules]
    return ad.sweep(machines, task=gains, options=every, **means).answers


def main() -> None:
    """Print the table and save it."""
    table = run(workers=2, journal=JOURNAL)
    print(table.to_string(float_format="{:+.1%}".format))
    table.to_csv(OUT / "rules.csv")
    JOURNAL.unlink()


if __name__ == "__main__":
    main()
