"""Weighted least squares of measurements over logarithms of unknowns, and what it determines.

The residuals are ln(f/f_measured) and load pressures over their deviations, and the priors'.
With the Jacobian J of the weighted residuals the covariance is (JᵀJ)⁻¹, times χ²/(m − k) where
the model misses by more than the measurements' deviations (Birge 1932).

That is the curvature of χ² at its least, and χ² may bend: another mode becomes the lowest, or a
compliance no longer matters beside the oil. So the interval of an unknown reaches on either side
to where χ², with the others found again, has risen by (quantile · scale)²: the profile likelihood.
It is sought outwards from where the curvature has it, and its farther end tells the deviation.

An unknown whose relative deviation exceeds ``LOOSE`` is not determined: it is held at the file's
value, the least certain one first, and the others are found again. It is held only if its profile
has the file's value in the interval: a value that the measurements refute, as a compliance of a
machine that is stiff, is no better than a vague one, and it would bend the others. What is said of
these is so if what is held is right.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armdesign.arrays import Array, Flags
from armdesign.calibration.prediction import Predictor, measured_loads
from armdesign.calibration.unknowns import Unknown, varied
from armdesign.errors import ArmDesignError
from armdesign.machine.machine import Machine

LOOSE = 0.5  # relative standard deviation of an unknown that is not determined
CONFIDENCE = 0.95  # of the intervals
EXACTLY, ROUGHLY = 1e-9, 1e-3  # relative tolerances of a fit, and of one for an interval
STEP = 1e-4  # of u, for differences
DECADES = range(-15, 4)  # in which the start of an unknown that the file says is 0 is sought
SLOWEST = 1e-6  # [Hz] stands for an unstable pose in logarithms
REFUSED = 1e3  # residual of a trial that no machine can be
FARTHEST = 4.0  # relative standard deviation beyond which none is sought
AGREES = 0.9  # of an interval that χ² confirms: where the curvature has its end to a tenth
APART = 0.25  # of u, within which χ² is taken to rise evenly to an interval's end
LEFT_OUT_STEPS = 3  # Gauss-Newton steps from the fit of all to that without one


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
        ratios = np.array([a.annulus_area / a.bore_area for a in self.machine.actuators])
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


@dataclass(frozen=True, eq=False)
class Fit:
    """The least squares of a problem.

    Attributes:
        problem: what was fitted.
        u: the unknowns (k,).
        residuals: weighted (m,).
        jacobian: of the residuals (m, k).
    """

    problem: LeastSquares
    u: Array
    residuals: Array
    jacobian: Array

    @property
    def freedom(self) -> int:
        """Residuals beyond the unknowns."""
        return len(self.residuals) - len(self.u)

    @cached_property
    def scale(self) -> float:
        """By how much the model misses more than the measurements' deviations, at least 1."""
        if self.freedom <= 0:
            return 1.0
        return max(1.0, math.sqrt(float(np.sum(self.residuals**2)) / self.freedom))

    @cached_property
    def directions(self) -> tuple[Array, Array]:
        """Deviations along the principal directions (k,), largest first, and these (k, k)."""
        _, singular, right = np.linalg.svd(self.jacobian, full_matrices=True)
        sizes = np.zeros(len(self.u))
        sizes[: len(singular)] = singular
        with np.errstate(divide="ignore"):
            deviations = self.scale / sizes
        return deviations[::-1], right[::-1]

    @cached_property
    def covariance(self) -> Array:
        """Of u (k, k); inf where nothing depends on a direction."""
        deviations, directions = self.directions
        known = np.isfinite(deviations)
        squares = (directions[known].T * deviations[known] ** 2) @ directions[known]
        lost = np.any(np.abs(directions[~known]) > 1e-9, axis=0)
        return np.where(lost[:, None] & lost, np.inf, squares)

    @cached_property
    def curvature(self) -> Array:
        """Standard deviations of u (k,) as the curvature of χ² has them."""
        return np.sqrt(np.diag(self.covariance))

    @cached_property
    def deviations(self) -> Array:
        """Standard deviations of u (k,): the farther ends of the intervals over the quantile.

        By the curvature if that suffices to tell that an unknown is not determined.
        """
        if self._vague.any():
            return self.curvature
        return np.asarray(self.ends.max(axis=1) / self.quantile)

    @cached_property
    def loose(self) -> Flags:
        """Which unknowns are not determined (k,)."""
        return self._vague if self._vague.any() else self._held(self.deviations)

    @cached_property
    def _vague(self) -> Flags:
        return self._held(self.curvature)

    def _held(self, deviations: Array) -> Flags:
        """Which unknowns have too large deviations (k,), and the file's value in the interval."""
        held = deviations > LOOSE
        for k in map(int, np.flatnonzero(held)):
            held[k] = self._share(k, self._of_file(k)) <= 1
        return held

    def _of_file(self, k: int) -> float:
        one = self.problem.unknowns[k]
        return one.coordinate(one.value)

    @cached_property
    def ends(self) -> Array:
        """How far below and above u each interval reaches (k, 2), no less than by curvature."""
        return np.array([[self._end(k, side) for side in (-1, 1)] for k in range(len(self.u))])

    def _end(self, k: int, side: int) -> float:
        """Distance of an interval's end from u; ``FARTHEST`` deviations, if it is beyond.

        Beyond the file's value, too, as χ² may rise near to that alone.
        """
        room = abs(self.problem.limits[max(side, 0), k] - self.u[k])
        to_file = side * (self._of_file(k) - self.u[k])
        farthest = min(max(self.quantile * FARTHEST, to_file), room)
        near, near_share = 0.0, 0.0
        far = min(self.quantile * min(self.curvature[k], LOOSE), farthest)
        share = self._share(k, self.u[k] + side * far)
        if share >= AGREES:
            return float(far)
        while share < 1 and far < farthest:
            near, near_share = far, share
            far = min(2 * far, farthest)
            share = self._share(k, self.u[k] + side * far)
        if share < 1:
            return float(far)
        while far - near > APART:
            middle = (near + far) / 2
            at_middle = self._share(k, self.u[k] + side * middle)
            if at_middle < 1:
                near, near_share = middle, at_middle
            else:
                far, share = middle, at_middle
        return float(near + (far - near) * (1 - near_share) / (share - near_share))

    def _share(self, k: int, x: float) -> float:
        """Where u[k] = x is in its interval: 0 at the best fit, 1 at an end, more outside.

        The root of χ² less its least, the others found again, over what that is at the ends.
        """
        others, u = np.arange(len(self.u)) != k, self.u.copy()
        u[k] = x
        u = least(self.problem, u, others, ROUGHLY)
        rise = float(np.sum(self.problem.residuals(u) ** 2) - np.sum(self.residuals**2))
        return math.sqrt(max(rise, 0.0)) / (self.scale * self.quantile)

    @property
    def quantile(self) -> float:
        """Deviations to either end of an interval: Student's where the scale is estimated."""
        from scipy.stats import norm, t

        upper = (1 + CONFIDENCE) / 2
        return float(t.ppf(upper, self.freedom) if self.scale > 1 else norm.ppf(upper))


def fitted(problem: LeastSquares, start: Array | None = None) -> Fit:
    """The least squares of a problem, from a start (k,) or the file's values."""
    begin = problem.start() if start is None else start
    u = least(problem, begin, np.full(len(begin), fill_value=True))
    return Fit(problem, u, problem.residuals(u), problem.jacobian(u))


def least(problem: LeastSquares, start: Array, free: Array, tolerance: float = EXACTLY) -> Array:
    """U (k,) of the least squares over the free unknowns (k,), from a start (k,)."""
    from scipy.optimize import least_squares

    if not free.any():
        return start
    low, high = problem.limits[:, free]

    def whole(some: Array) -> Array:
        u = start.copy()
        u[free] = some
        return u

    optimum = least_squares(
        lambda some: problem.residuals(whole(some)),
        np.clip(start[free], low + 1e-9, high - 1e-9),
        lambda some: problem.jacobian(whole(some), free),
        bounds=(low, high),
        xtol=tolerance,
        ftol=tolerance,
    )
    return whole(optimum.x)


def determined(problem: LeastSquares) -> tuple[Fit, Fit | None, dict[str, float]]:
    """The fit of all unknowns, and the fit of what the measurements determine.

    The second is None if they determine none. Beside them the relative deviation of every unknown
    that is not determined, by key path, when it was the least certain one.
    """
    of_all = now = fitted(problem)
    loose: dict[str, float] = {}
    while True:
        if not now.loose.any():
            return of_all, now, loose
        loosest = int(np.argmax(np.where(now.loose, now.deviations, 0.0)))
        loose[now.problem.unknowns[loosest].path] = float(now.deviations[loosest])
        determined = np.arange(len(now.u)) != loosest
        pairs = zip(now.problem.unknowns, determined, strict=True)
        left = tuple(unknown for unknown, kept in pairs if kept)
        if not left:
            return of_all, None, loose
        smaller = LeastSquares(problem.machine, problem.predictor, left)
        now = fitted(smaller, now.u[determined])


def left_out(fit: Fit) -> Array:
    """Relative errors (n,) of the frequencies, each predicted by a fit without its measurement.

    Unknowns that χ² hardly depends on stay as they are. NaN where none is measured, or the rest
    does not suffice.
    """
    problem, free = fit.problem, fit.curvature <= LOOSE
    measured, rows = problem.predictor.measured, problem.rows
    errors = np.full(len(measured), np.nan)
    for n in np.flatnonzero(np.isfinite(measured.frequencies)):
        others, u = rows != n, fit.u.copy()
        slopes = fit.jacobian[np.ix_(others, free)]
        if np.linalg.matrix_rank(slopes) < np.count_nonzero(free):
            continue
        for _ in range(LEFT_OUT_STEPS):
            change = np.linalg.lstsq(slopes, problem.residuals(u)[others], rcond=None)[0]
            u[free] = np.clip(u[free] - change, *problem.limits[:, free])
        at_rest = problem.predictor(problem.at(u)).frequencies[n]
        errors[n] = at_rest / measured.frequencies[n] - 1
    return errors


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
