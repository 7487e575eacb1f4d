"""Modes within a band, with neighbours and residual terms for the modes outside it.

For a linear system the spectra of a record obey, line by line and exactly (Pintelon & Schoukens
2012),

    Y = Σ [(b0 + b1 s) U + e0 + e1 s] / (s² + 2ζω s + ω²) + R U + E,   s = jω,

a sum over the modes in the band; e0, e1 and E stand for the state at both ends of the record. R
and E are what the modes outside add. They are smooth, since their poles are not in the band. Two
things stand for them together:

- *neighbours*: none, one above the band, one below it, or both, each with its own frequency and
  damping;
- *residual terms* for the rest: polynomials Σ c_k (z/ϱ)^k, one for R and one for E, of z, the
  logarithm of frequency, −1…1 over the band. A pole at the distance ϱ from the band's middle makes
  coefficients that fall as ϱ^−k. So all c_k are taken as random with one standard deviation g (a
  Gaussian process, Rasmussen & Williams 2006).

With noise of the standard deviation σ, and for a given choice of λ = (g/σ)² and neighbours, the
modes are what least squares give under the covariance I + λ C Cᵀ, C the columns of the residual
terms. The evidence of each choice, by Laplace's method (MacKay 1992), weighs its answer.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import (
    lapack,
)  # of its small matrices numpy's own calls take several times as long

from armdesign.arrays import Array
from armdesign.simulation.identification.pole_search import Problem, best_poles, left_over

DEGREE = 14  # of the polynomials
REACH = 1.3  # ϱ: where poles outside begin, in half widths of the band on a logarithmic scale
DECADES = (-2, 12)  # of λ
# g relative to the median response, and the standard deviation of its logarithm
USUAL, SPREAD = 0.3, 1.5
COARSE = (1e1, 1e3, 1e6)  # λ at which the search starts
# power of the evidence that weighs: neighbours are no random draw, so one choice alone is not
# trusted
TEMPER = 0.3
NEGLIGIBLE = 4.0  # logarithm of a weight below the largest
EQUATIONS = 1.5  # least per unknown of modes and neighbours
ROUNDS, FEW_ROUNDS = 25, 6
FARTHEST = 4.0  # a neighbour from the band's end, as a ratio of frequencies
MARGIN = 1.2  # a mode outside the band's end, as a ratio of frequencies
DAMPING = (-0.3, 1.5)  # ζ within which modes are looked for
LEAST_DAMPING = 1e-3  # of neighbours
NEIGHBOUR = 1.3  # ratio of frequencies from the band's end where the search for one starts
NEIGHBOUR_ENDS = (
    0.2  # of a neighbour, the usual size of what it adds to E, relative to what it adds to R U
)


@dataclass(frozen=True, eq=False)
class Lines:
    """Spectra to be fitted, of about size one.

    Attributes:
        s: jω relative to the band's middle (k,), ascending.
        u: input (k,), complex.
        y: output times ``weight`` (k,), complex.
        weight: of the lines (k,), about 1.
        ends: whether the output holds what the record's ends add.
    """

    s: Array
    u: Array
    y: Array
    weight: Array
    ends: bool

    @cached_property
    def observed(self) -> Array:
        """Output, real above imaginary parts (2k,)."""
        return real(self.y)

    @cached_property
    def inputs(self) -> Array:
        """Factors of a mode's numerator (k, 4 or 2): U, s U and, with the ends, 1 and s."""
        one = np.ones_like(self.s)
        columns = [self.u, self.s * self.u] + ([one, self.s] if self.ends else [])
        return np.stack(columns, axis=1) * self.weight[:, None]

    @cached_property
    def for_search(self) -> tuple[Array, Array]:
        """ω (k,), and the factors of a numerator, real above imaginary parts (2k, 4 or 2)."""
        return np.abs(self.s), np.ascontiguousarray(real(self.inputs))

    @cached_property
    def typical(self) -> float:
        """Median modulus of the response."""
        return float(np.median(np.abs(self.y / (self.weight * self.u))))

    @cached_property
    def usual_sizes(self) -> tuple[Array, Array]:
        """Usual sizes of numerators of a mode and a neighbour (4 or 2,), columns of size one."""
        own = np.full(self.inputs.shape[1], np.linalg.norm(self.observed))
        of_neighbour = np.array([1, 1, NEIGHBOUR_ENDS, NEIGHBOUR_ENDS])[: len(own)]
        return own, of_neighbour * self.typical * np.linalg.norm(self.u)

    @cached_property
    def log_weight(self) -> float:
        """Sum of the weights' logarithms."""
        return float(np.log(self.weight).sum())

    @cached_property
    def edges(self) -> tuple[float, float]:
        """Lowest and highest frequency relative to the band's middle."""
        return float(abs(self.s[0])), float(abs(self.s[-1]))

    @property
    def end_size(self) -> float:
        """Usual size of E's coefficients relative to R's: a ringing end spreads over all lines."""
        return 0.5 / math.sqrt(len(self.s))

    @cached_property
    def residual_terms(self) -> tuple[Array, Array, Array]:
        """Singular value decomposition of C: (2k, r), (r,), (r, columns)."""
        terms = self.terms(self.s) * self.weight[:, None]
        columns = np.hstack(
            [self.u[:, None] * terms] + ([self.end_size * terms] if self.ends else [])
        )
        u, size, v = np.linalg.svd(
            np.hstack([real(columns), real(1j * columns)]), full_matrices=False
        )
        return u, size, v

    def terms(self, s: Array) -> Array:
        """(z/ϱ)^k at any s (·, DEGREE + 1)."""
        edges = np.log(self.edges)
        z = (np.log(np.abs(s)) - edges.mean()) / (np.ptp(edges) / 2)
        return np.vander(z / REACH, DEGREE + 1, increasing=True)

    @cached_property
    def whitened(self) -> dict[float, tuple[float, Array, Array]]:
        """What ``_Regression`` makes of the lines by λ, as far as it has."""
        return {}


@dataclass(frozen=True, eq=False)
class Answer:
    """Modes and neighbours under one choice of residual terms.

    Attributes:
        poles: ω and ζ of the modes, ascending, then of the neighbours (m, 2), ω relative to the
            band's middle.
        modes: number of modes.
        ratio: λ.
        covariance: of the modes' ω and ζ (2 modes, 2 modes).
        noise: part of the covariance that noise causes; the residual terms cause the other part.
        evidence: its logarithm.
        numerators: of all poles (m, 4 or 2).
        remainder: output less the response of all poles (2k,).
    """

    poles: Array
    modes: int
    ratio: float
    covariance: Array
    noise: Array
    evidence: float
    numerators: Array
    remainder: Array

    def spectra(self, lines: Lines, s: Array) -> tuple[Array, Array]:
        """Response and what the ends add (·,) at any s, with the likeliest residual terms."""
        _, size, v = lines.residual_terms
        stacked = (
            self.ratio
            * size
            / (1 + self.ratio * size**2)
            * (lines.residual_terms[0].T @ self.remainder)
        ) @ v
        halves = np.split(stacked, 2)
        coefficients = np.split(halves[0] + 1j * halves[1], 2 if lines.ends else 1)
        terms, fractions, b = lines.terms(s), _fractions(self.poles, s), self.numerators
        response = terms @ coefficients[0] + fractions @ b[:, 0] + s * (fractions @ b[:, 1])
        if not lines.ends:
            return response, np.zeros_like(s)
        ends = (
            lines.end_size * (terms @ coefficients[1])
            + fractions @ b[:, 2]
            + s * (fractions @ b[:, 3])
        )
        return response, ends


def answers(lines: Lines, starts: Array) -> list[Answer]:
    """All likely answers.

    Neighbours are tried where there are lines enough.

    Args:
        lines: spectra.
        starts: ω and ζ from which the search starts (·, modes, 2).
    """
    modes, likely = starts.shape[1], list[Answer]()
    low, high = lines.edges
    below, above = low / NEIGHBOUR, high * NEIGHBOUR
    for neighbours in ((), (above,), (below,), (below, above)):
        unknowns = (modes + len(neighbours)) * (2 + lines.inputs.shape[1])
        if neighbours and len(lines.observed) < EQUATIONS * unknowns:
            continue
        if len(neighbours) == 2 and len(max(likely, key=evidence).poles) == modes:
            continue  # where one neighbour does not help, two do not either
        best = max(map(evidence, likely), default=-math.inf)
        first = max(_coarse(lines, starts, neighbours, likely), key=evidence)
        if first.evidence > best - 2 * NEGLIGIBLE / TEMPER:
            likely += _over_ratios(lines, first, best)
    return likely


def with_known_modes(lines: Lines, poles: Array) -> Answer:
    """The likeliest answer of a few λ for modes (m, 2) that are known: ω and ζ."""
    known = (_Regression(lines, ratio, len(poles)).fit(poles, rounds=0) for ratio in COARSE)
    return max(known, key=evidence).answer()


def weights_of(fits: list[Answer]) -> Array:
    """The weight of each answer (·,), in sum one."""
    logarithms = TEMPER * np.array([one.evidence for one in fits])
    weights = np.exp(logarithms - logarithms.max())
    return np.asarray(weights / weights.sum())


def evidence(answer: Answer | _Fit) -> float:
    """Its logarithm."""
    return answer.evidence


def _coarse(
    lines: Lines, starts: Array, neighbours: tuple[float, ...], known: list[Answer]
) -> list[_Fit]:
    """Fits after a few rounds, at some λ."""
    modes, ratios = starts.shape[1], list(COARSE)
    if neighbours:
        best = max(known, key=evidence)
        extras = [np.array([[omega, zeta] for omega in neighbours]) for zeta in (0.02, 0.2)]
        starts = np.array([np.vstack([best.poles[:modes], extra]) for extra in extras])
        ratios = [best.ratio, best.ratio / 100]
    coarse = []
    for ratio in ratios:
        regression = _Regression(lines, ratio, modes)
        start = starts[int(np.argmin(regression.costs(starts)))]
        coarse.append(regression.fit(start, FEW_ROUNDS))
    return coarse


def _over_ratios(lines: Lines, first: _Fit, best: float) -> list[Answer]:
    """Answers for larger and smaller λ, decade by decade, until they are negligible."""
    modes = first.regression.modes
    decade = min(max(round(math.log10(first.regression.ratio)), DECADES[0]), DECADES[1])
    fitted = [_Regression(lines, 10.0**decade, modes).fit(first.poles).answer()]
    for way in (range(decade + 1, DECADES[1] + 1), range(decade - 1, DECADES[0] - 1, -1)):
        last = fitted[0]
        for k in way:
            last = _Regression(lines, 10.0**k, modes).fit(last.poles).answer()
            fitted.append(last)
            if last.evidence < max(best, *map(evidence, fitted)) - NEGLIGIBLE / TEMPER:
                break
    return fitted


@dataclass(frozen=True, eq=False)
class _BestNumerators:
    """Numerators for given poles by least squares.

    Fractions of the poles; scaled columns, their Q and, in the upper triangle, R; what is left.
    """

    fractions: Array
    columns: Array
    sizes: Array
    basis: Array
    factors: Array
    share: Array
    left: Array
    cost: float

    @cached_property
    def numerators(self) -> Array:
        """Numerators for the columns scaled to size one."""
        triangle, each = self.factors.copy(), np.arange(len(self.factors))
        # columns that nearly coincide
        triangle[each, each] += 1e-13 * (np.abs(triangle[each, each]) < 1e-13)
        return np.asarray(lapack.dtrtrs(triangle, self.share)[0])

    def spare(self, slopes: Array) -> int:
        """How many more equations there are than unknowns, the poles of some slopes among them."""
        return len(self.left) - self.basis.shape[1] - slopes.shape[1]


class _Regression:
    """Least squares under the covariance I + λ C Cᵀ of noise and residual terms."""

    def __init__(self, lines: Lines, ratio: float, modes: int) -> None:
        self.lines, self.ratio, self.modes = lines, ratio, modes
        if ratio not in lines.whitened:
            lines.whitened[ratio] = _whitened(lines, ratio)
        # logarithm of the covariance's determinant, (I + λ C Cᵀ)^(−½), and that times the output
        self.inflation, self.white, self.y = lines.whitened[ratio]

    def problem(self, poles: Array) -> Problem:
        """The search for poles near some (m, 2), modes about the band, neighbours beside it."""
        low, high = self.lines.edges
        bounds = []
        for p, omega in enumerate(poles[:, 0].tolist()):
            if p < self.modes:
                bounds.append(((low / MARGIN, DAMPING[0]), (high * MARGIN, DAMPING[1])))
            elif omega > 1:
                bounds.append(((high, LEAST_DAMPING), (high * FARTHEST, DAMPING[1])))
            else:
                bounds.append(((low / FARTHEST, LEAST_DAMPING), (low, DAMPING[1])))
        least, most = np.ascontiguousarray(np.swapaxes(bounds, 0, 1))
        return Problem(*self.lines.for_search, self.white, self.y, least, most)

    def costs(self, starts: Array) -> list[float]:
        """Squares that each of some poles (·, m, 2) leave of the output."""
        problem = self.problem(starts[0])
        return [left_over(problem, start) for start in starts]

    def best_numerators(self, poles: Array) -> _BestNumerators:
        """Numerators for given poles, and what they leave of the output."""
        q = _fractions(poles, self.lines.s)
        columns = (q[:, :, None] * self.lines.inputs[:, None, :]).reshape(len(q), -1)
        rows = real(columns)
        sizes = np.sqrt(np.einsum("ij,ij->j", rows, rows))
        factors, reflectors, *_ = lapack.dgeqrf(self.white @ (rows / sizes))
        basis, factors = lapack.dorgqr(factors, reflectors)[0], factors[: len(sizes)]
        share = basis.T @ self.y
        left = self.y - basis @ share
        return _BestNumerators(
            q, columns / sizes, sizes, basis, factors, share, left, float(left @ left)
        )

    def slopes(self, poles: Array, now: _BestNumerators) -> Array:
        """Change of the output by ω and ζ of every pole, beyond what numerators make up for.

        Columns (2k, 2m): ω and ζ of the first pole, of the second, …
        """
        s, q = self.lines.s[:, None], now.fractions
        part = (now.columns * now.numerators).reshape(*q.shape, -1).sum(axis=2) * q
        omega, zeta = poles.T
        both = np.stack([-2 * (zeta * s + omega) * part, -2 * omega * s * part], axis=2)
        slopes = self.white @ real(both.reshape(len(q), -1))
        return np.asarray(slopes - now.basis @ (now.basis.T @ slopes))

    def fit(self, poles: Array, rounds: int = ROUNDS) -> _Fit:
        """Fit by Levenberg and Marquardt's method on ω and ζ, from some ``poles``.

        The numerators are eliminated (Golub & Pereyra 1973).
        """
        found = best_poles(self.problem(poles), poles, rounds)
        now = self.best_numerators(found)
        slopes = self.slopes(found, now)
        return _Fit(self, found, now, slopes, self._likelihood(now, slopes))

    def _likelihood(self, now: _BestNumerators, slopes: Array) -> float:
        """Logarithm of the evidence, numerators and poles integrated over usual sizes."""
        spare = now.spare(slopes)
        variance = now.cost / spare
        poles, usual = slopes.shape[1] // 2, self.lines.usual_sizes
        prior = np.concatenate([usual[0]] * self.modes + [usual[1]] * (poles - self.modes))
        linear = _determinant(np.triu(now.factors) * (prior / math.sqrt(variance)))
        other = _determinant(slopes / math.sqrt(2 * variance))
        size = math.sqrt(variance * self.ratio) / self.lines.typical
        determinants = self.inflation + linear + other
        likelihood = -0.5 * (len(self.y) * math.log(variance) + spare + determinants)
        likelihood += 2 * self.lines.log_weight  # of the output itself, not weighted
        return float(likelihood - 0.5 * (math.log(size / USUAL) / SPREAD) ** 2)


def _whitened(lines: Lines, ratio: float) -> tuple[float, Array, Array]:
    """What is the same for all poles under one λ, see ``_Regression``."""
    u, size, _ = lines.residual_terms
    shrinkage = 1 - 1 / np.sqrt(1 + ratio * size**2)
    counts = shrinkage > 0  # what is smaller than rounding leaves all as it is
    white = np.eye(len(u)) - (u[:, counts] * shrinkage[counts]) @ u[:, counts].T
    return float(np.log1p(ratio * size**2).sum()), white, white @ lines.observed


@dataclass(frozen=True, eq=False)
class _Fit:
    """Poles that a regression has found: numerators, slopes by poles, and the evidence."""

    regression: _Regression
    poles: Array
    now: _BestNumerators
    slopes: Array
    evidence: float

    def answer(self) -> Answer:
        """The modes ascending, with all that few fits are asked for."""
        one, now, slopes, modes = self.regression, self.now, self.slopes, self.regression.modes
        scale = np.sqrt(np.einsum("ij,ij->j", slopes, slopes)) + 1e-300
        inverse = _inverse_of_normal(slopes / scale) / (scale[:, None] * scale)
        order = np.argsort(self.poles[:modes, 0])
        kept = (2 * order[:, None] + np.arange(2)).ravel()
        order = np.concatenate([order, np.arange(modes, len(self.poles))])
        gain = one.white @ (slopes @ inverse[:, kept])
        tails = now.cost / max(now.spare(slopes) - 2, 1)  # variance of Student's distribution
        return Answer(
            poles=self.poles[order],
            modes=modes,
            ratio=one.ratio,
            covariance=tails * inverse[kept[:, None], kept],
            noise=tails * (gain.T @ gain),
            evidence=self.evidence,
            numerators=(now.numerators / now.sizes).reshape(len(order), -1)[order],
            remainder=one.lines.observed - real(now.columns) @ now.numerators,
        )


def _inverse_of_normal(columns: Array) -> Array:
    """(XᵀX)⁻¹ of columns X of size one, but for what is within rounding."""
    _, size, v, _ = lapack.dgesdd(columns, full_matrices=0)
    counts = size**2 > 1e-13 * size[0] ** 2
    reduced = v[counts] / size[counts, None]
    return np.asarray(reduced.T @ reduced)


def _determinant(columns: Array) -> float:
    """Logarithm of det(I + XᵀX) of columns X, by the R of X above the identity."""
    triangle = lapack.dgeqrf(np.concatenate([columns, np.eye(columns.shape[1])]))[0]
    return float(2 * np.log(np.abs(np.diagonal(triangle))).sum())


def _fractions(poles: Array, s: Array) -> Array:
    """1/(s² + 2ζω s + ω²) (k, m)."""
    omega, zeta = poles.T
    return np.asarray(1 / (s[:, None] ** 2 + 2 * zeta * omega * s[:, None] + omega**2))


def real(values: Array) -> Array:
    """Real above imaginary parts: a complex least-squares problem as a real one."""
    return np.concatenate([values.real, values.imag])
