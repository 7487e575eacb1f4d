"""Sheets of validations: linear against identified frequencies."""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from armdesign.plots.charts import GREY, Chart, Curve
from armdesign.report.sheet import Sheet
from armdesign.units import percent, share_text

if TYPE_CHECKING:
    from armdesign.simulation.sweeps import FittedMode, SweptMode
    from armdesign.simulation.validation import Validation

COLUMNS = ("pose, load", "cylinder", "valve", "linear", "fitted", "deviation", "linear ζ", "ζ")


def validation_sheet(
    validations: Mapping[str, Validation], told: Mapping[str, Validation] | None = None
) -> Sheet:
    """Linear against fitted frequencies of validations by label; failures below the table.

    Those of the validations that are ``told``, if any are given, else of the table's.
    """
    friction = any(run.with_friction for one in validations.values() for run in one.runs)
    rows = [_row(label, one, friction) for label, of in validations.items() for one in of.sweeps]
    return Sheet(
        title="Nonlinear simulation: frequency [Hz] and damping fitted to a small slow sweep",
        columns=(*COLUMNS, *(("dry",) if friction else ()), "remark"),
        rows=tuple(rows),
        note=f"{_note(friction)}{_failed(told or validations)}",
    )


def _failed(validations: Mapping[str, Validation]) -> str:
    """Where sweeps or their repetitions failed and why, each reason once; empty if none did."""
    places: dict[tuple[str, str], dict[str, None]] = {}  # of what failed and why, in their order
    for label, validation in validations.items():
        for sweep in validation.sweeps:
            for failed in _failures(sweep):
                place = f"{label}, {sweep.payload}, {sweep.cylinder}"
                places.setdefault(failed, {})[place] = None
    pairs = places.items()
    return "".join(f". {what}: {'; '.join(of)}: {reason}" for (what, reason), of in pairs)


def _row(label: str, sweep: SweptMode, friction: bool) -> tuple[str, ...]:
    """One sweep; ``friction``: with the column of what dry friction makes of it."""
    from armdesign.simulation.sweeps import FittedMode

    valve = "–" if math.isnan(sweep.amplitude) else share_text(sweep.amplitude)
    linear = f"{sweep.linear_frequency:.4f}"
    cells = [f"{label}, {sweep.payload}", sweep.cylinder, valve, linear]
    if not isinstance(sweep, FittedMode):
        return (*cells, *["–"] * (len(COLUMNS) + friction - len(cells)), "failed")
    cells += [f"{sweep.identified_frequency:.4f}", percent(sweep.deviation, 2)]
    cells += [f"{round(x, 4) + 0.0:.4f}" for x in (sweep.linear_damping, sweep.identified_damping)]
    if friction:
        dry = sweep.with_friction
        cells.append(
            f"{dry.identified_frequency:.4f}" if isinstance(dry, FittedMode) else "failed"
        )
    return (*cells, sweep.remark)


def _failures(sweep: SweptMode) -> list[tuple[str, str]]:
    """What failed of a sweep and its repetition with dry friction, and why; else empty."""
    from armdesign.simulation.sweeps import Failure, FittedMode

    dry = sweep.with_friction if isinstance(sweep, FittedMode) else None
    both = {"Failed": sweep, "With dry friction no mode was fitted": dry}
    return [
        (what, "; ".join(filter(None, (one.error.fault, one.error.remedy))))
        for what, one in both.items()
        if isinstance(one, Failure)
    ]


def _note(friction: bool) -> str:
    from armdesign.simulation.sweeps import AGREES

    note = (
        "valve: mean opening in the sweep, which adds damping: ζ falls with it; spools are swept"
        " without overlap; remark: agrees"
        f" (within {100 * AGREES:g} %), or the cause of the deviation: amplitude (it falls with"
        " the amplitude), leaks (they change pressures, and damp), damping (strong, and unlike"
        " from mode to mode), creep (no spool position makes up for it) or a fault; oil without"
        " air is swept under a preload, p1 + p2 = supply + return or less where a relief would"
        " open: its frequency does not depend on pressure; oil with air under the static"
        " pressures, as printed by check and map"
    )
    if friction:
        note += (
            "; dry friction is in no linear model and left out of the sweep; dry: fitted with the"
            " machine's own friction, which holds small motions"
        )
    return note


def validation_chart(validation: Validation, colours: Mapping[str, str]) -> Chart:
    """Deviation of every sweep over its linear frequency; ``colours`` by actuator."""
    curves: dict[str, list[FittedMode]] = {name: [] for name in colours}
    for run in validation.runs:
        curves[run.cylinder].append(run)
    ends = [run.linear_frequency for run in validation.runs]
    return Chart(
        title="Simulated over linear natural frequency, every sweep",
        x="linear natural frequency [Hz]",
        y="deviation [%]",
        heads=("sweep", "linear, fitted", "deviation", "damping ratio", "remark"),
        curves=(
            *(
                Curve(
                    name=name,
                    colour=colours[name],
                    x=tuple(run.linear_frequency for run in runs),
                    y=tuple(100 * run.deviation for run in runs),
                    words=tuple(map(_words, runs)),
                )
                for name, runs in curves.items()
                if runs
            ),
            Curve(
                name="no deviation",
                colour=GREY,
                x=(min(ends), max(ends)),
                y=(0.0, 0.0),
                kind="line",
            ),
        ),
    )


def _words(run: FittedMode) -> tuple[str, ...]:
    """What a chart says of a sweep."""
    return (
        f"{run.pose} pose, {run.payload}: {run.cylinder}, valve {share_text(run.amplitude)}",
        f"{run.linear_frequency:.4f}, {run.identified_frequency:.4f} Hz",
        percent(run.deviation, 2),
        f"linear {run.linear_damping:.4f}, measured {run.identified_damping:.4f}",
        run.remark,
    )


def limiting_sheet(proofs: Mapping[str, Validation]) -> Sheet:
    """Of several machines, the limiting cylinder's sweeps at the worst pose, with the verdict.

    And why sweeps failed, at any pose.
    """
    worst = {label: proof.by_pose["worst"].limiting for label, proof in proofs.items()}
    every = {
        f"{k}, {pose}": one for k, proof in proofs.items() for pose, one in proof.by_pose.items()
    }
    sheet, said = validation_sheet(worst, told=every), verdict(list(proofs.values()))
    return dataclasses.replace(sheet, note=f"{said} (validation.csv); {sheet.note}")


def _largest(runs: Sequence[FittedMode]) -> str:
    return f"{100 * max(abs(run.deviation) for run in runs):.2f} %"


def verdict(validations: Sequence[Validation]) -> str:
    """Number of sweeps that agree, remarks of the others, and the largest deviation."""
    from armdesign.simulation.sweeps import FittedMode

    runs = [run for validation in validations for run in validation.runs]
    remarks = Counter(run.remark for run in runs)
    agree = remarks.pop("agrees", 0)
    others = "".join(f", {count} differ ({remark})" for remark, count in remarks.items() if count)
    remarks["failed"] = sum(len(validation.failures) for validation in validations)
    others += f", {remarks['failed']} failed" if remarks["failed"] else ""
    repeated = [run.with_friction for run in runs if run.with_friction is not None]
    dry = [run for run in repeated if isinstance(run, FittedMode)]
    deviation = f"; largest deviation {_largest(runs)}" if runs else ""
    if repeated:
        deviation += f", with dry friction {_largest(dry) if dry else 'not known'}"
    if len(dry) < len(repeated):
        deviation += f": {len(dry)} of {len(repeated)} repetitions show a mode"
    usual = any("worst" in validation.by_pose for validation in validations)
    poses = "the worst, the median and the best pose" if usual else "each given pose"
    counted = f"{agree} of {agree + remarks.total()} sweeps agree{others}"
    return f"{counted} (every cylinder at {poses}){deviation}{_unseen(validations)}"


def _unseen(validations: Sequence[Validation]) -> str:
    """At which poses no sweep is over the lowest mode; empty if there is none."""
    named = (pair for validation in validations for pair in validation.by_pose.items())
    unseen = dict.fromkeys(
        name for name, of_one in named if min(sweep.mode for sweep in of_one.sweeps) > 1
    )
    if not unseen:
        return ""
    words = f"pose{'s' if len(unseen) > 1 else ''} {', '.join(unseen)}"
    return (
        f"; at {words} no sweep is over the lowest mode: one that structure swings in alone moves"
        " no cylinder"
    )
