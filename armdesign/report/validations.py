"""Sheets of validations: linear against identified frequencies."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING

from armdesign.report.sheet import Sheet

if TYPE_CHECKING:
    from armdesign.simulation.validation import Validation


def validation_sheet(validations: dict[str, Validation]) -> Sheet:
    """Linear against identified frequencies; one validation per label.

    What failed is told below the table.
    """
    from armdesign.simulation.sweeps import AGREES, Failure, Run

    rough = any(
        run.with_friction for validation in validations.values() for run in validation.runs
    )
    columns = ["pose, load", "cylinder", "valve", "linear", "fitted", "deviation", "linear ζ", "ζ"]
    columns += ["dry"] * rough
    rows, told = [], []
    for label, validation in validations.items():
        for one in validation.sweeps:
            place = f"{label}, {one.payload}"
            cells = [place, one.cylinder]
            cells.append("–" if math.isnan(one.amplitude) else f"{100 * one.amplitude:.2g} %")
            cells.append(f"{one.linear_frequency:.4f}")
            for failed in (one, one.with_friction if isinstance(one, Run) else None):
                if isinstance(failed, Failure):
                    told.append(f"{place}, {one.cylinder}: {failed.error}")
            if isinstance(one, Failure):
                rows.append((*cells, *["–"] * (len(columns) - len(cells)), "failed"))
                continue
            cells += [f"{one.identified_frequency:.4f}", f"{100 * one.deviation:+.2f} %"]
            cells += [f"{one.linear_damping:.4f}", f"{one.identified_damping:.4f}"]
            if rough:
                other = one.with_friction
                cells.append(
                    f"{other.identified_frequency:.4f}" if isinstance(other, Run) else "failed"
                )
            rows.append((*cells, one.remark))
    note = (
        "valve: mean opening in the sweep; an open valve adds damping, so ζ falls with it;"
        f" remark: agrees within {100 * AGREES:g} %, or what the deviation is due to: amplitude"
        " (falls with it), leaks (which make other pressures, and damp), creep (of what no spool"
        " position makes up for), or a fault; oil without air is swept under a preload, p1 + p2 ="
        " supply + return or less where a relief would open, on which its frequency does not"
        " depend; oil with air under the static pressures that check and map name"
    )
    if rough:
        note += (
            "; dry friction, of which no linear answer knows, is left out; dry: fitted with the"
            " machine's own, which holds small motions"
        )
    return Sheet(
        title="Nonlinear simulation: frequency [Hz] and damping fitted to a small slow sweep",
        columns=(*columns, "remark"),
        rows=tuple(rows),
        note=". Failed: ".join([note, *told]),
    )


def verdict(validations: Sequence[Validation]) -> str:
    """How many sweeps of how many there are agree, what is said of the others, and how far off they are."""
    from armdesign.simulation.sweeps import Run

    runs = [run for validation in validations for run in validation.runs]
    remarks = Counter(run.remark for run in runs)
    agree = remarks.pop("agrees", 0)
    remarks["failed"] = sum(len(validation.failures) for validation in validations)
    others = "".join(f", {count} {remark}" for remark, count in remarks.items() if count)
    rough = [run.with_friction for run in runs if isinstance(run.with_friction, Run)]
    largest = [
        f"{100 * max(abs(run.deviation) for run in some):.2f} %" for some in (runs, rough) if some
    ]
    far = f"; largest deviation {', with dry friction '.join(largest)}" if largest else ""
    return (
        f"{agree} of all {agree + remarks.total()} sweeps at the worst, the median and the best"
        f" poses, every cylinder, agree{others}{far}"
    )
