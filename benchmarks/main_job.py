"""Figures that the main job must reach on excavator_20t, measured beside their targets.

Run on an otherwise idle machine: ``python -m benchmarks.main_job``. Times are the best of three in
this process.
"""

from __future__ import annotations

from functools import partial

import numpy as np

import armdesign as ad
from benchmarks.timing import best_of

MACHINE = "excavator_20t"


def report(what: str, figure: str, target: str, reached: bool) -> None:
    """One line: figure, target, whether it is reached."""
    print(f"{what:<46} {figure:>14}   target {target:<12} {'ok' if reached else 'MISSED'}")


def main() -> None:
    """Measure and print everything."""
    machine = ad.load(MACHINE)
    workspace = ad.Workspace.grid(machine)
    _ = workspace.rigid
    # imports and first compilations are not part of the figures
    ad.size_cylinders(machine, workspace)

    seconds, _, design = best_of(lambda: ad.optimize(machine, workspace))
    lowest = min(design.before.frame["f1_hz"])
    gain = design.unrounded / lowest - 1
    report("co-design, gain before rounding", f"{gain:+.1%}", "+7 %", gain >= 0.07)
    rounded = design.after.worst.frequency / design.before.worst.frequency - 1
    report("co-design, gain of the saved machine", f"{rounded:+.1%}", "", True)
    report("co-design, all starts", f"{seconds:.2f} s", "< 5 s", seconds < 5)

    poses = ad.Workspace.grid(machine, points=(16, 16, 36))
    _ = poses.rigid
    seconds = best_of(lambda: ad.size_cylinders(machine, poses)).wall
    report(f"sizing over {len(poses.q)} given poses", f"{seconds:.2f} s", "< 0.5 s", seconds < 0.5)

    identified(design)


def identified(design: ad.Design) -> None:
    """Frequencies identified in simulations beside linear ones."""
    for label, frequencies in (("before", design.before), ("after", design.after)):
        worst = frequencies.worst
        case = frequencies.machine.with_payload(worst.payload)
        seconds, _, validation = best_of(
            partial(ad.validate, case, worst.q, cylinders=[worst.cylinder]), 1
        )
        deviation = float(np.abs(validation.frame["deviation"]).max())
        report(
            f"identified against linear, {label} ({seconds:.1f} s)",
            f"{deviation:.3%}",
            "< 2 %",
            deviation < 0.02,
        )


if __name__ == "__main__":
    main()
