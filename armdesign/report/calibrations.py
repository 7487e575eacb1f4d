"""Sheets of a calibration: values with deviations, their correlations, and every measurement."""

from __future__ import annotations

from typing import TYPE_CHECKING

from armdesign.calibration.words import sentence
from armdesign.report.sheet import Sheet
from armdesign.units import percent

if TYPE_CHECKING:
    import pandas as pd

    from armdesign.calibration.calibrate import Calibration


def calibration_sheets(calibration: Calibration) -> list[Sheet | str]:
    """Values, measurements, and the findings in words."""
    return [_values(calibration), _measurements(calibration), *map(sentence, calibration.findings)]


def _values(calibration: Calibration) -> Sheet:
    rows = []
    for path, row in calibration.values.iterrows():
        fitted = ("not determined", "–", "–")
        if row["determined"]:
            interval = f"{row['low']:.4g} … {row['high']:.4g}"
            fitted = (f"{row['value']:.4g}", f"{row['deviation']:.2g}", interval)
        rows.append((str(path), f"{row['before']:.4g}", *fitted))
    return Sheet(
        title=f"{calibration.today.name}: values fitted to the measurements",
        columns=("key path", "before", "fitted", "± deviation", "95 % within"),
        words=("key path",),
        rows=tuple(rows),
        note=_correlations(calibration.correlations),
    )


def _correlations(table: pd.DataFrame) -> str:
    """All correlations of two unknowns, as one line."""
    names = list(table.index)
    pairs = [
        f"{one} with {other} {table.loc[one, other]:+.2f}"
        for k, one in enumerate(names)
        for other in names[k + 1 :]
    ]
    return f"correlations: {', '.join(pairs)}" if pairs else ""


def _measurements(calibration: Calibration) -> Sheet:
    rows = []
    for n, row in calibration.frame.dropna(subset=["measured_hz"]).iterrows():
        errors = [
            percent(row[f"{name}_error"], 2) for name in ("before", "calibrated", "left_out")
        ]
        measured = f"{row['measured_hz']:.4f} ± {row['deviation_hz']:.4f}"
        computed = [f"{row[f'{name}_hz']:.4f}" for name in ("before", "calibrated")]
        cells = (measured, computed[0], errors[0], computed[1], *errors[1:])
        rows.append((f"{int(n) + 1}, {row['payload']}", *cells))  # type: ignore[call-overload]
    heads = ("row, load", "measured", "before", "error", "calibrated", "error", "left out")
    return Sheet(title="Frequencies [Hz] at the measured poses", columns=heads, rows=tuple(rows))
