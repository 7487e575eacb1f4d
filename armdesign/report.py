"""What a person reads: tables for the terminal, in workshop units (mm, bar, l, kN, deg)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from rich import box
from rich.table import Table

if TYPE_CHECKING:
    from armdesign.machine import Machine
    from armdesign.maps import FrequencyMap, WorstPose


def pose_text(machine: Machine, worst: WorstPose) -> str:
    """The worst pose in words: every joint, the load case."""
    parts = [
        f"{joint.name} {math.degrees(value):.1f}°" if joint.revolute else f"{joint.name} {value * 1000:.0f} mm"
        for joint, value in zip(machine.arm.joints, worst.q, strict=True)
    ]
    return f"{', '.join(parts)}, payload {worst.payload}"


def table(title: str, *columns: str) -> Table:
    """A plain table; all columns but the first are numbers."""
    made = Table(title=title, box=box.SIMPLE_HEAD, title_justify="left", title_style="bold", pad_edge=False)
    for index, column in enumerate(columns):
        made.add_column(column, justify="left" if index == 0 else "right")
    return made


def map_tables(frequencies: FrequencyMap) -> list[Table]:
    """Worst pose, percentiles and the cylinder that limits, of one map."""
    machine, worst, frame = frequencies.machine, frequencies.worst, frequencies.frame
    head = table(f"{machine.section.title or machine.name}: lowest natural frequency", "", "")
    head.show_header = False
    head.add_row("worst frequency", f"[bold]{worst.frequency:.3f} Hz[/bold]")
    head.add_row("at", pose_text(machine, worst))
    head.add_row("tool at", f"reach {worst.tool[0]:.2f} m, height {worst.tool[2]:.2f} m")
    head.add_row("limited by", f"{worst.cylinder} cylinder")
    spread = table("Lowest coupled frequency over the workspace [Hz]", "payload", "poses", "min", "5 %", "50 %", "95 %")
    for payload, rows in frame.groupby("payload", sort=False):
        f = rows["f1_hz"].to_numpy()
        spread.add_row(
            str(payload), f"{len(f)}", f"{f.min():.3f}", *(f"{p:.3f}" for p in np.percentile(f, [5, 50, 95]))
        )
    shares = table(
        "Which cylinder, and what simpler formulas would say",
        "cylinder",
        "limits poses",
        "locked / coupled, median",
        "rigid load / coupled, median",
    )
    for cylinder in machine.cylinders:
        limits = frequencies.limiting == cylinder.name
        ratios = [
            float(np.median((frame[f"{kind}_{cylinder.name}_hz"] / frame["f1_hz"])[limits]))
            if limits.any()
            else math.nan
            for kind in ("locked", "rigid")
        ]
        words = ["–" if math.isnan(ratio) else f"{ratio:.2f}" for ratio in ratios]
        shares.add_row(cylinder.name, f"{100 * limits.mean():.1f} %", *words)
    return [head, spread, shares]
