"""What the variables of a design buy on the excavators, measured beside the targets.

Run on an otherwise idle machine: ``python -m benchmarks.variables``. Gains are of the lowest
frequency over the default grid, before rounding and of the saved machine.
"""

from __future__ import annotations

from functools import partial

import armdesign as ad
from benchmarks.main_job import report
from benchmarks.timing import best_of

# of the gain with areas and pins, as first reached when lift was made a requirement (before: 0.36,
# 0.35 and 0.08)
TARGETS = {"excavator_20t": 0.07, "mini_excavator_2t": 0.07, "excavator_12t": 0.004}
FREEDOMS = {
    "areas": ("areas",),
    "pins": ("pins",),
    "both": ("areas", "pins"),
    "both, four-bar": ("areas", "linkages"),
}


def main() -> None:
    """Measure and print everything."""
    for name, target in TARGETS.items():
        machine = ad.load(name)
        workspace = ad.Workspace.grid(machine)
        for label, vary in FREEDOMS.items():
            seconds, _, design = best_of(partial(ad.optimize, machine, workspace, vary=vary), 1)
            lowest = design.before.frame["f1_hz"].min()
            gain = design.unrounded / lowest - 1
            saved = design.after.frame["f1_hz"].min() / lowest - 1
            wanted = f"{target:+.1%}" if label == "both" else ""
            figure = f"{gain:+.1%} {saved:+.1%}"
            report(
                f"{name}, {label} ({seconds:.1f} s)", figure, wanted, gain >= target or not wanted
            )


if __name__ == "__main__":
    main()
