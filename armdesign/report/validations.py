"""Sheets of validations: linear against identified frequencies."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING

from armdesign.report.sheet import Sheet

if TYPE_CHECKING:
    from armdesign.simulation.validation import Validation

SLIPPERY = "*"  # marks runs without dry friction


def validation_sheet(validations: dict[str, Validation]) -> Sheet:
    """Linear against identified frequencies; one validation per label. What failed is told below the table."""
    from armdesign.simulation.validation import AGREES, Failure

    rows, told = [], []
    for label, validation in validations.items():
        for one in validation.sweeps:
            place, mark = f"{label}, {one.payload}", SLIPPERY if one.dry_friction == "left out" else ""
            name = f"{one.cylinder}{mark}"
            valve = "–" if math.isnan(one.amplitude) else f"{100 * one.amplitude:.2g} %"
            linear = f"{one.linear_frequency:.4f}"
            if isinstance(one, Failure):
                rows.append((place, name, valve, linear, *4 * ("–",), "failed"))
                told.append(f"{place}, {name}: {one.error}")
                continue
            rows.append(
                (
                    place,
                    name,
                    valve,
                    linear,
                    f"{one.identified_frequency:.4f}",
                    f"{100 * one.deviation:+.2f} %",
                    f"{one.linear_damping:.4f}",
                    f"{one.identified_damping:.4f}",
                    one.remark,
                )
            )
    columns = ("pose, load", "cylinder", "valve", "linear", "identified", "deviation", "linear ζ", "ζ", "remark")
    note = (
        "valve: mean opening in the sweep; an open valve adds damping, so ζ falls with it; "
        f"remark: agrees within {100 * AGREES:g} %, or what the deviation is due to: amplitude (falls with it), "
        "friction (gone without dry friction), leaks (which make other pressures, and damp), creep (of what no spool "
        "position makes up for), or a fault"
    )
    if any(run.dry_friction == "left out" for validation in validations.values() for run in validation.runs):
        note += f"; {SLIPPERY}: repeated without dry friction, of which the linear answer knows nothing"
    return Sheet(
        title="Nonlinear simulation: frequency [Hz] and damping fitted to a small slow sweep",
        columns=columns,
        rows=tuple(rows),
        note=". Failed: ".join([note, *told]),
    )


def verdict(validations: Sequence[Validation]) -> str:
    """How many sweeps of how many there are agree, what is said of the others, and how far off they are."""
    runs = [run for validation in validations for run in validation.runs]
    remarks = Counter(run.remark for run in runs)
    agree = remarks.pop("agrees", 0)
    remarks["failed"] = sum(len(validation.failures) for validation in validations)
    others = "".join(f", {count} {remark}" for remark, count in remarks.items() if count)
    smooth = [run for run in runs if run.dry_friction == "left out"]
    largest = [f"{100 * max(abs(run.deviation) for run in some):.2f} %" for some in (runs, smooth) if some]
    far = f"; largest deviation {', without dry friction '.join(largest)}" if largest else ""
    return (
        f"{agree} of all {agree + remarks.total()} sweeps at the worst, the median and the best poses, every cylinder, "
        f"agree{others}{far}"
    )
