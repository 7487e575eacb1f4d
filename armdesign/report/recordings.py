"""Sheets of an identified recording: frequency and damping of every window."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from armdesign.report.sheet import Sheet

if TYPE_CHECKING:
    from armdesign.simulation.identified import Identified

POSES = ("_mm", "_deg")


def identified_sheets(identified: Identified) -> list[Sheet | str]:
    """Windows with frequency, damping and pose, and what a reader should know of them."""
    frame, recording = identified.frame, identified.recording
    poses = [name for name in frame.columns if name.endswith(POSES)]
    remarks, rows = (frame["remark"] != "").any(), []
    for _, row in frame.iterrows():
        cells = [recording.span_text(row["begin_s"], row["end_s"])]
        cells += [f"{row['frequency_hz']:.4f} ± {row['deviation_hz']:.4f}"]
        cells += [f"{row['damping_ratio']:.4f} ± {row['damping_deviation']:.4f}"]
        cells += ["–" if math.isnan(row["amplitude"]) else f"{row['amplitude']:.3g}"]
        cells += [row["remark"] or "–"] if remarks else []
        rows.append((*cells, *(f"{row[name]:.1f}" for name in poses)))
    heads = ["window [s]", "frequency [Hz]", "damping ratio", "amplitude [as recorded]"]
    heads += ["remark"] if remarks else []
    sheet = Sheet(
        title=f"{identified.recording.source}: {identified.signal}",
        columns=(*heads, *poses),
        rows=tuple(rows),
        words=("remark",),
        note="± one standard deviation, by noise and by what it may hide; three hold 96 % or more",
    )
    return [sheet, *(f"{line}." for line in identified.findings)]
