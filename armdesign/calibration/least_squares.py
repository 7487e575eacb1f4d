"""Least squares of measurements over logarithms of unknowns, weighted by deviations.

The residuals are ln(f/f_measured) and load pressures over their deviations, and the priors'.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from armdesign.arrays import Array
from armdesign.calibration.prediction import Predictor, area_ratios, measured_loads
from armdesign.calibration.unknowns import Unknown, varied
from armdesign.errors import ArmDesignError
from armdesign.machine.machine import Machine
from armdesign.threads import one_blas_thread

EXACTLY, ROUGHLY = 1e-9, 1e-3  # relative tolerances of a fit, and of one for an interval
STEP = 1e-4  # of u, for differences
DECADES = range(-15, 4)  # in which the start of an unknown that the file says is 0 is sought
SLOWEST = 1e-6  # [Hz] stands for an unstable pose in logarithms
REFUSED = 1e3  # residual of a trial that no machine can be


@dataclass(frozen=True, eq=False)
class LeastSquares:
    """Residuals of a machine's variants.

    Attributes:
        machine: today's machine.
        predictor: of it and the measurements.
        unknowns: what varies (k).
    """

    machine: Machine
    predictor: Predictor
    unknowns: tuple[Unknown, ...]

    def at(self, u: Array) -> Machine:
        """The variant at u (k,)."""
        changes = {one.path: one.number(float(x)) for one, x in zip(self.unknowns, u, strict=True)}
        return varied(self.machine, changes)

    def without(self, n: int) -> LeastSquares:
        """The problem without the measurement of an index: its frequency and its loads."""
        measured, others = self.predictor.measured, np.arange(len(self.predictor.measured)) != n
        rest = replace(
            measured,
            frequencies=np.where(others, measured.frequencies, np.nan),
            pressure_deviations=np.where(others, measured.pressure_deviations, np.nan),
        )
        return replace(self, predictor=replace(self.predictor, measured=rest))

    @cached_property
    def limits(self) -> Array:
        """Least and largest u (2, k)."""
        return np.array([one.limits for one in self.unknowns]).T

    @cached_property
    def rows(self) -> Array:
        """The measurement that each residual belongs to (m,); −1 for priors."""
        loads = np.nonzero(self._fitted_loads)[0]
        own = np.flatnonzero(np.isfinite(self.predictor.measured.frequencies))
        priors = -np.ones(sum(one.prior is not None for one in self.unknowns))
        return np.concatenate([own, loads, priors]).astype(int)

    @cached_property
    def _fitted_loads(self) -> Array:
        measured = self.predictor.measured
        known = np.isfinite(measured.pressures).all(axis=2)
        return np.asarray(known & np.isfinite(measured.pressure_deviations)[:, None])

    @cached_property
    def _load_deviations(self) -> Array:
        """Of p1 − p2 A2/A1, both pressures with their own errors (n, nc) [Pa]."""
        ratios = area_ratios(self.machine)
        return self.predictor.measured.pressure_deviations[:, None] * np.sqrt(1 + ratios**2)

    def residuals(self, u: Array) -> Array:
        """Weighted residuals (m,) at u (k,), large where there is no such machine."""
        try:
            machine = self.at(u)
            predicted = self.predictor(machine)
        except ArmDesignError:
            return np.full(len(self.rows), REFUSED)
        measured = self.predictor.measured
        known = np.isfinite(measured.frequencies)
        frequencies = np.maximum(predicted.frequencies[known], SLOWEST)
        logs = np.log(frequencies / measured.frequencies[known])
        loads = predicted.load_pressures - measured_loads(machine, measured)
        pairs = zip(self.unknowns, u, strict=True)
        return np.concatenate(
            [
                logs * measured.frequencies[known] / measured.deviations[known],
                (loads / self._load_deviations)[self._fitted_loads],
                [one.surprise(float(x)) for one, x in pairs if one.prior is not None],
            ]
        )

    def jacobian(self, u: Array, free: Array | slice = slice(None)) -> Array:
        """Derivatives of the residuals by u, or some of it, (m, k), by central differences."""
        columns = []
        for step in STEP * np.eye(len(u))[free]:
            columns.append((self.residuals(u + step) - self.residuals(u - step)) / (2 * STEP))
        return np.stack(columns, axis=1)

    def rough_jacobian(self, u: Array, residuals: Array, free: Array) -> Array:
        """The same by differences from the residuals at u, in half the time."""
        steps = STEP * np.eye(len(u))[free]
        columns = [(self.residuals(u + step) - residuals) / STEP for step in steps]
        return np.stack(columns, axis=1)

    def start(self) -> Array:
        """U of the file's values (k,); where they are 0 the best decade, one after the other."""
        u = np.array([one.coordinate(one.value) for one in self.unknowns])
        for k, one in enumerate(self.unknowns):
            if one.positive and one.value == 0:
                tried = [10.0**n for n in DECADES if one.low < 10.0**n < one.high]
                trials = np.tile(u, (len(tried), 1))
                trials[:, k] = [one.coordinate(value) for value in tried]
                costs = [float(np.sum(self.residuals(trial) ** 2)) for trial in trials]
                u = trials[int(np.argmin(costs))]
        return u


@one_blas_thread()
def least(problem: LeastSquares, start: Array, free: Array, tolerance: float = EXACTLY) -> Array:
    """U (k,) of the least squares over the free unknowns (k,), from a start (k,)."""
    from scipy.optimize import least_squares

    if not free.any():
        return start
    low, high = problem.limits[:, free]
    latest = np.zeros(0), np.zeros(0)

    def whole(some: Array) -> Array:
        u = start.copy()
        u[free] = some
        return u

    def residuals(some: Array) -> Array:
        nonlocal latest
        latest = some.copy(), problem.residuals(whole(some))
        return latest[1]

    def jacobian(some: Array) -> Array:
        u = whole(some)
        if tolerance < ROUGHLY:
            return problem.jacobian(u, free)
        known = latest[1] if np.array_equal(latest[0], some) else problem.residuals(u)
        return problem.rough_jacobian(u, known, free)

    optimum = least_squares(
        residuals,
        np.clip(start[free], low + 1e-9, high - 1e-9),
        jacobian,
        bounds=(low, high),
        xtol=tolerance,
        ftol=tolerance,
    )
    return whole(optimum.x)


def refuse_too_few(problem: LeastSquares, fit: Sequence[str]) -> None:
    """Raise if there are more unknowns than measurements and priors.

    Raises:
        ArmDesignError: there are.
    """
    data = len(problem.rows)
    if len(fit) > data:
        remedy = "fit fewer, measure more poses, or give priors"
        values = f"{data} measured value" + "s" * (data != 1)
        raise ArmDesignError("fit", f"{len(fit)} unknowns, but {values}", remedy)
