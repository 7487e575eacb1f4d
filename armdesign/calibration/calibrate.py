"""Calibration of a machine file: ``calibrate``, and what measurements say of its numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from armdesign.arguments import checked
from armdesign.arrays import Array, ReadOnly
from armdesign.calibration import words
from armdesign.calibration.fit import Fit, determined, left_out
from armdesign.calibration.least_squares import LeastSquares, refuse_too_few
from armdesign.calibration.measured import Measured, measured_of, read_measured
from armdesign.calibration.prediction import Prediction, Predictor, measured_loads
from armdesign.calibration.unknowns import Unknown, unknowns_of
from armdesign.machine.changes import changed_machine
from armdesign.machine.machine import Machine
from armdesign.machine.provenance import retold
from armdesign.short_repr import short_repr
from armdesign.units import bar

if TYPE_CHECKING:
    import pandas as pd

    from armdesign.plots.canvas import Axes

DIGITS = 2  # significant, of a deviation; the value ends where it ends


@dataclass(frozen=True, eq=False, kw_only=True)
class Calibration(ReadOnly):
    """Numbers of a machine file as measurements determine them.

    Attributes:
        today: the machine before.
        machine: the machine with what the measurements determine, rounded to their deviations.
        measured: the measurements.
        unknowns: what was to be found, in the order asked for.
        of_all: the fit of all unknowns, from which follows what cannot be told apart.
        fit: the fit of the unknowns which are determined; None if none is.
        loose: relative standard deviations of the unknowns that are not, by key path.
        before: answers of today's machine at the measurements.
        after: of the calibrated one.
        left_out: relative errors of the frequencies (n,), each predicted without its measurement.
    """

    __repr__ = short_repr

    today: Machine
    machine: Machine
    measured: Measured
    unknowns: tuple[Unknown, ...]
    of_all: Fit
    fit: Fit | None
    loose: Mapping[str, float]
    before: Prediction
    after: Prediction
    left_out: Array

    @cached_property
    def values(self) -> pd.DataFrame:
        """A row for each unknown, in the file's unit, indexed by key path.

        Columns ``unit``, ``before``, ``value``, ``deviation`` (standard), ``low`` and ``high``
        (the interval that holds the truth with 95 %, if what is not fitted is right in the file),
        ``determined``. What the measurements do not determine keeps the file's value, without
        deviation; the intervals of the others allow for all that it may be.
        """
        import pandas as pd

        rows = []
        for one in self.unknowns:
            result = self._result(one)
            row = {"unit": one.unit, "before": one.value, "value": one.value}
            rows.append({**row, **(result or dict.fromkeys(KEYS[1:], math.nan))})
            rows[-1]["determined"] = result is not None
        return pd.DataFrame(rows, index=pd.Index([one.path for one in self.unknowns], name="path"))

    def _result(self, one: Unknown) -> dict[str, float] | None:
        """Value, deviation and interval of an unknown; None if it is not determined."""
        if self.fit is None or one not in self.fit.problem.unknowns:
            return None
        u = float(self.fit.u[self.fit.problem.unknowns.index(one)])
        value, low, high = map(one.number, (u, *self.of_all.interval(self.unknowns.index(one))))
        low, high = min(low, value), max(high, value)  # several held may have it outside
        deviation = max(value - low, high - value) / self.of_all.quantile
        return dict(zip(KEYS, (value, deviation, low, high), strict=True))

    @cached_property
    def correlations(self) -> pd.DataFrame:
        """Correlations of the determined unknowns, by key path."""
        import pandas as pd

        if self.fit is None:
            return pd.DataFrame()
        names = [one.path for one in self.fit.problem.unknowns]
        sizes = self.fit.curvature
        with np.errstate(invalid="ignore"):  # nothing depends on it at the best fit
            table = np.nan_to_num(self.fit.covariance / np.outer(sizes, sizes))
        np.fill_diagonal(table, 1.0)
        return pd.DataFrame(table, names, names)

    @cached_property
    def frame(self) -> pd.DataFrame:
        """A row for each measurement: pose, frequencies before and after, errors, loads.

        Errors are relative, computed over measured less one; ``left_out_error`` the error of a fit
        without the measurement.
        """
        import pandas as pd

        measured, machine = self.measured, self.machine
        rigid = Predictor(self.today, measured).rigid
        payloads = [machine.payload.name if p is None else p for p in measured.payloads]
        table: dict[str, Any] = {"payload": payloads}
        table |= dict(zip(machine.joints, rigid.q.T, strict=True))
        table |= {"mode": measured.modes + 1, "measured_hz": measured.frequencies}
        table["deviation_hz"] = measured.deviations
        for name, prediction in (("before", self.before), ("calibrated", self.after)):
            table[f"{name}_hz"] = prediction.frequencies
            table[f"{name}_error"] = prediction.frequencies / measured.frequencies - 1
        table["left_out_error"] = self.left_out
        loads = measured_loads(self.today, measured)
        for i, actuator in enumerate(machine.actuators):
            if np.isfinite(loads[:, i]).any():
                table[f"{actuator.name}_load_bar"] = loads[:, i] / bar
                computed = self.after.load_pressures[:, i]
                table[f"{actuator.name}_calibrated_load_bar"] = computed / bar
        return pd.DataFrame(table)

    @cached_property
    def findings(self) -> tuple[str, ...]:
        """In words: how well it fits, what is not determined, what cannot be told apart."""
        warnings = self.measured.warnings
        return words.findings(self.of_all, self.fit, self.loose, self.frame, warnings)

    def written_by(self, command: str) -> Machine:
        """The calibrated machine, with a file that tells where its values are from.

        Args:
            command: what made it, as typed in a terminal or in Python.
        """
        notes: dict[str, str] = {}
        for one in self.unknowns:
            result, (path, index) = self._result(one), one.place
            if result is not None:
                which = "" if index is None else f"number {index} "
                said = f", {which}fitted ± {result['deviation']:.{DIGITS}g}"
                notes[path] = notes.get(path, "") + said
        story = (
            f"Command: {command}",
            *(words.sentence(words.capital(line)) for line in self.findings),
        )
        return retold(self.machine, self.today, "calibrated", story, notes)

    def save(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write the calibrated machine file with its URDF; returns its path.

        Args:
            path: of the machine file.
            overwrite: whether files may be replaced that this package did not make.

        Raises:
            ArmDesignError: a place that cannot be written, or holds a file of somebody else.
        """
        fitted = tuple(one.path for one in self.unknowns)
        command = f"armdesign.calibrate(measured={self.measured.source!r}, fit={fitted!r})"
        return self.written_by(command).save(path, overwrite=overwrite)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Axes with measured, computed and left-out frequencies of every measurement."""
        from armdesign.plots.calibrations import measured_and_computed

        return measured_and_computed(self, ax)


KEYS = ("value", "deviation", "low", "high")


@checked
def calibrate(
    machine: Machine,
    measured: Measured | pd.DataFrame | str | Path,
    fit: Sequence[str],
    priors: Mapping[str, tuple[float, float]] | None = None,
) -> Calibration:
    """Numbers of a machine file that measured frequencies and pressures determine.

    Least squares over logarithms, weighted by the measurements' deviations; see
    ``calibration/fit.py``. What the measurements do not determine keeps its value.

    Args:
        machine: the machine as its file describes it.
        measured: a CSV file or table with the columns of ``calibration/measured.py``.
        fit: key paths of the numbers to be found, as "fluid.bulk_modulus_MPa".
        priors: what is known of them beforehand: value and standard deviation, in the file's unit.

    Raises:
        ArmDesignError: measurements that cannot be used, a path that names no number, more
            unknowns than data.

    Example:
        >>> import armdesign as ad
        >>> crane = ad.load("loader_crane")
        >>> path = crane.source.parent / "measured.csv"
        >>> found = ad.calibrate(crane, path, fit=["cylinder.lift.compliance_m_per_N"])
        >>> print(found.values["determined"].all())
        True
    """
    if not isinstance(measured, Measured):
        if isinstance(measured, str | Path):
            measured = read_measured(measured, machine)
        else:
            measured = measured_of(_rows(measured), machine)
    unknowns = unknowns_of(machine, fit, priors)
    predictor = Predictor(machine, measured)
    problem = LeastSquares(machine, predictor, unknowns)
    refuse_too_few(problem, fit)
    before = predictor(machine)
    of_all, kept, loose = determined(problem)
    calibrated = machine if kept is None else changed_machine(machine, _rounded(kept), "fit")
    after = predictor(calibrated)
    errors = after.frequencies / measured.frequencies - 1 if kept is None else left_out(kept)
    return Calibration(
        today=machine,
        machine=calibrated,
        measured=measured,
        unknowns=unknowns,
        of_all=of_all,
        fit=kept,
        loose=loose,
        before=before,
        after=after,
        left_out=errors,
    )


def _rows(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Rows of a table by column name, missing values blank as in a file."""
    values = table.astype(object).to_numpy(copy=True)
    values[table.isna().to_numpy()] = ""
    names = [str(name) for name in table.columns]
    return [dict(zip(names, row, strict=True)) for row in values.tolist()]


def _rounded(fit: Fit) -> dict[str, float]:
    """Values by key path, each with the digits that its deviation leaves it and one more."""
    changes = {}
    deviations = np.minimum(fit.curvature, 1.0)
    for one, u, sigma in zip(fit.problem.unknowns, fit.u, deviations, strict=True):
        value = one.number(float(u))
        size = float(sigma) * (value if one.positive else one.size)
        changes[one.path] = round(value, DIGITS - 1 - math.floor(math.log10(size)))
    return changes
