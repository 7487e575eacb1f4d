"""What measurements determine: the least squares of them, and intervals of the unknowns.

With the Jacobian J of the weighted residuals the covariance is (JᵀJ)⁻¹, times χ²/(m − k) where
the model misses by more than the measurements' deviations (Birge 1932).

That is the curvature of χ² at its least, and χ² may bend: another mode becomes the lowest, or a
compliance no longer matters beside the oil. So the interval of an unknown reaches on either side
to where χ², with the others found again, has risen by (quantile · scale)²: the profile likelihood.
It is sought outwards from where the curvature has it, and its farther end tells the deviation.
χ² may have several minima, and a profile may come into a lower one; where it bends over at an
interval's end, one is sought beyond. The fit goes on from the lowest that was met, and profiles
are followed anew, until they meet none. That ends, as χ² falls each time by more than ``LOWER`` of
its rise to an interval's end, and after ``ROUNDS`` in any case.

An unknown whose relative deviation exceeds ``LOOSE`` is not determined: it is held at the file's
value, the least certain one first, and the others are found again. It is held only if its profile
has the file's value in the interval: a value that the measurements refute, as a compliance of a
machine that is stiff, is no better than a vague one, and it would bend the others. Their values
are the best beside what is held, but that may be wrong: their intervals are profiles of the fit of
all, in which it varies within the schema's bounds and as its prior says.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from armdesign.arrays import Array, Flags
from armdesign.calibration.least_squares import ROUGHLY, STEP, LeastSquares, least

LOOSE = 0.5  # relative standard deviation of an unknown that is not determined
CONFIDENCE = 0.95  # of the intervals
FARTHEST = 4.0  # relative standard deviation beyond which none is sought
AGREES = 0.9  # of an interval that χ² confirms: where the curvature has its end to a tenth
APART = 0.25  # of u, within which χ² is taken to rise evenly to an interval's end
BENT = 0.5  # of a parabola's slope at an interval's end, below which χ² may fall beyond
LOWER = 1e-3  # of the rise of χ² to an interval's end, by which another minimum is a lower one
ROUNDS = 10  # of going on from a lower minimum


@dataclass(frozen=True, eq=False)
class Fit:
    """The least squares of a problem.

    Attributes:
        problem: what was fitted.
        u: the unknowns (k,).
        residuals: weighted (m,).
        jacobian: of the residuals (m, k).
        sought: how far below and above u intervals reach, by the index of the unknown.
        met: χ² below that of u, and where (k,), as profiles have come there.
    """

    problem: LeastSquares
    u: Array
    residuals: Array
    jacobian: Array
    sought: dict[int, tuple[float, float]] = field(default_factory=dict, init=False)
    met: list[tuple[float, Array]] = field(default_factory=list, init=False)

    @cached_property
    def chi_squared(self) -> float:
        """Sum of the squared residuals."""
        return float(np.sum(self.residuals**2))

    @property
    def freedom(self) -> int:
        """Residuals beyond the unknowns."""
        return len(self.residuals) - len(self.u)

    @cached_property
    def scale(self) -> float:
        """By how much the model misses more than the measurements' deviations, at least 1."""
        if self.freedom <= 0:
            return 1.0
        return max(1.0, math.sqrt(self.chi_squared / self.freedom))

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
            held[k] = self._share(k, self._of_file(k))[0] <= 1
        return held

    def _of_file(self, k: int) -> float:
        one = self.problem.unknowns[k]
        return one.coordinate(one.value)

    @cached_property
    def ends(self) -> Array:
        """How far below and above u each interval reaches (k, 2), no less than by curvature."""
        return np.array([self.reach(k) for k in range(len(self.u))])

    def reach(self, k: int) -> tuple[float, float]:
        """How far below and above u[k] its interval reaches."""
        if k not in self.sought:
            self.sought[k] = self._end(k, -1), self._end(k, 1)
        return self.sought[k]

    def interval(self, k: int) -> tuple[float, float]:
        """Least and largest u[k] in its interval."""
        below, above = self.reach(k)
        return float(self.u[k] - below), float(self.u[k] + above)

    def _end(self, k: int, side: int) -> float:
        """Distance of an interval's end from u; ``FARTHEST`` deviations, if it is beyond.

        Beyond the file's value, too, as χ² may rise near to that alone.
        """
        room = abs(self.problem.limits[max(side, 0), k] - self.u[k])
        to_file = side * (self._of_file(k) - self.u[k])
        farthest = min(max(self.quantile * FARTHEST, to_file), room)
        near, near_share = 0.0, 0.0
        far = min(self.quantile * min(self.curvature[k], LOOSE), farthest)
        share, u = self._share(k, self.u[k] + side * far)
        if share >= AGREES and self.curvature[k] <= LOOSE:
            self._look_beyond(k, u, share)
            return float(far)
        while share < 1 and far < farthest:
            near, near_share = far, share
            far = min(2 * far, farthest)
            share, u = self._share(k, self.u[k] + side * far)
        if share < 1:
            return float(far)
        self._look_beyond(k, u, share)
        while far - near > APART:
            middle = (near + far) / 2
            at_middle, _ = self._share(k, self.u[k] + side * middle)
            if at_middle < 1:
                near, near_share = middle, at_middle
            else:
                far, share = middle, at_middle
        return float(near + (far - near) * (1 - near_share) / (share - near_share))

    def _look_beyond(self, k: int, end: Array, share: float) -> None:
        """Seek another minimum beyond an interval's end (k,) at which χ² bends over.

        It does where it rises less than ``BENT`` of what a parabola would, 2 rise/change. By the
        envelope theorem the profile's slope is that with the others as they are.
        """
        change, step = end[k] - self.u[k], np.zeros(len(end))
        step[k] = math.copysign(STEP, change)
        slope = (self._rise(end + step) - share**2) / step[k]
        if slope * change < BENT * 2 * share**2:
            step[k] = change
            everything = np.full(len(end), fill_value=True)
            self._rise(least(self.problem, end + step, everything, ROUGHLY))

    def _share(self, k: int, x: float) -> tuple[float, Array]:
        """Where u[k] = x is in its interval: 0 at the best fit, 1 at an end, more outside.

        The root of the rise of χ², the others found again; and these (k,).
        """
        others, u = np.arange(len(self.u)) != k, self.u.copy()
        u[k] = x
        u = least(self.problem, u, others, ROUGHLY)
        return math.sqrt(max(self._rise(u), 0.0)), u

    def _rise(self, u: Array) -> float:
        """χ² at u (k,) less that of the fit, over what it is at an interval's end.

        Where it is lower, it is ``met``.
        """
        chi_squared = float(np.sum(self.problem.residuals(u) ** 2))
        rise = (chi_squared - self.chi_squared) / (self.scale * self.quantile) ** 2
        if rise < -LOWER:
            self.met.append((chi_squared, u))
        return rise

    @property
    def lower(self) -> Array | None:
        """Where χ² was lowest (k,), if a profile has come below that of u."""
        return min(self.met, key=lambda one: one[0])[1] if self.met else None

    def follow(self, others: Fit | None) -> None:
        """Seek the intervals of what another fit finds, which holds the rest; of None nothing."""
        if others is None or others is self:
            return
        found = dict(zip(others.problem.unknowns, others.u, strict=True))
        unknowns = self.problem.unknowns
        u = [float(found.get(one, one.coordinate(one.value))) for one in unknowns]
        self._rise(np.array(u))  # what is fitted beside held ones may be lower, too
        for one in found:
            self.reach(unknowns.index(one))

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


def settled(problem: LeastSquares, start: Array | None = None) -> Fit:
    """The fit from a start (k,) or the file's values, and on while its profiles come lower."""
    for _ in range(ROUNDS):
        fit = fitted(problem, start)
        _ = fit.loose  # follows profiles
        if fit.lower is None:
            break
        start = fit.lower
    return fit


def determined(problem: LeastSquares) -> tuple[Fit, Fit | None, dict[str, float]]:
    """The fit of all unknowns, and the fit of what the measurements determine.

    The second is None if they determine none. Beside them the relative deviation of every unknown
    that is not determined, by key path, when it was the least certain one. Intervals are those of
    the fit of all.
    """
    start = None
    for _ in range(ROUNDS):
        of_all, fit, loose = _held_in_turn(problem, start)
        of_all.follow(fit)
        if of_all.lower is None:
            break
        start = of_all.lower
    return of_all, fit, loose


def _held_in_turn(
    problem: LeastSquares, start: Array | None
) -> tuple[Fit, Fit | None, dict[str, float]]:
    """What ``determined`` tells, from a start (k,) or the file's values."""
    of_all = now = settled(problem, start)
    loose: dict[str, float] = {}
    while now.loose.any():
        loosest = int(np.argmax(np.where(now.loose, now.deviations, 0.0)))
        loose[now.problem.unknowns[loosest].path] = float(now.deviations[loosest])
        kept = np.arange(len(now.u)) != loosest
        left = tuple(one for one, k in zip(now.problem.unknowns, kept, strict=True) if k)
        if not left:
            return of_all, None, loose
        now = settled(LeastSquares(problem.machine, problem.predictor, left), now.u[kept])
    return of_all, now, loose


def left_out(fit: Fit) -> Array:
    """Relative errors (n,) of the frequencies, each predicted by a fit without its measurement.

    Unknowns that χ² hardly depends on stay as they are. NaN where none is measured, or the rest
    does not suffice.
    """
    problem, free = fit.problem, fit.curvature <= LOOSE
    measured = problem.predictor.measured
    errors = np.full(len(measured), np.nan)
    for n in map(int, np.flatnonzero(np.isfinite(measured.frequencies))):
        slopes = fit.jacobian[np.ix_(problem.rows != n, free)]
        if np.linalg.matrix_rank(slopes) < np.count_nonzero(free):
            continue
        machine = problem.at(least(problem.without(n), fit.u, free))
        errors[n] = problem.predictor(machine).frequencies[n] / measured.frequencies[n] - 1
    return errors
