"""Which single rule costs the shipped excavators how much of their gain, in real numbers?

All rules leave the 20 t machine +12.7 %. Without that on the boom's lift alone it gains +20.9 %,
without the torque of its stick +18.1 %, of its bucket +16.5 %, without the stick's lift +14.2 %,
without buckling of the boom's rods +14.1 %.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd

import armdesign as ad

MACHINES = ("excavator_20t", "excavator_12t", "mini_excavator_2t")
NONE = "none"
AT_MOST = ("holding_share", "oil_each_share", "thrust_share")  # the other shares are least ones
KEPT = ("", "oil_total_share")  # no key asks for it; without it bigger is always better
OUT = Path("out") / "16_each_rule"
JOURNAL = OUT / "journal.sqlite"  # with which an interrupted run goes on


def rules_without(rules: ad.Requirements, key: str) -> ad.Requirements:
    """The rules without that of one key, such as ``lift_share.boom`` or ``outline.stick``."""
    rule, _, name = key.partition(".")
    if rule == "outline":
        return replace(rules, outlines=tuple(o for o in rules.outlines if o.link != name))
    if rule == "clearance":
        return replace(rules, clearances=tuple(c for c in rules.clearances if c.name != name))
    if rule == "torque_share":  # digging asks for this one's, too
        rules = replace(rules, digging=tuple(one for one in rules.digging if one != name))
    return rules.with_setting(key, 10.0 if rule in AT_MOST else 0.0)


def gains(machine: ad.Machine, workspace: ad.Workspace, without: str) -> dict[str, Any]:
    """Gain before rounding without a rule, and keys of all that bind."""
    rules = ad.Requirements.of(machine)
    rules = rules if without == NONE else rules_without(rules, without)
    design = ad.optimize(machine, workspace, rules, catalogue="free")
    today = design.problem.dynamics.corners.nominal
    keys = [check.setting for check in design.binding if check.setting not in KEPT]
    keys = [k.rpartition(".")[0] if k.startswith(("outline", "clear")) else k for k in keys]
    return {"real": max(design.starts) / today - 1, "binding": " ".join(dict.fromkeys(keys))}


def run(machines: Sequence[str] = MACHINES, **means: Any) -> pd.DataFrame:
    """Gains with all rules and without each that binds, by machine and key."""
    every = []
    for name in machines:
        whole = ad.sweep([name], task=gains, options=[{"without": NONE}], **means).frame
        keys = [{"without": key} for key in whole["binding"].iloc[0].split()]
        every += [whole, ad.sweep([name], task=gains, options=keys, **means).frame]
    return pd.concat(every).set_index(["machine", "without"])


def main() -> None:
    """Print the table and save it."""
    table = run(workers=2, journal=JOURNAL)
    print(table["real"].to_string(float_format="{:+.1%}".format))
    table.to_csv(OUT / "each_rule.csv")
    JOURNAL.unlink()


if __name__ == "__main__":
    main()
