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
ROUNDS, FEW_ROUNDS, TRIALS = 25, 6, 6
CONVERGED = 1e-6  # relative change of what is left
LARGEST_STEP = np.array([0.2, 0.15])  # of ω and ζ in a round
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
    def typical(self) -> float:
        """Median modulus of the response."""
        return float(np.median(np.abs(self.y / (self.weight * self.u))))

    @property
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
        return np.asarray((z / REACH)[:, None] ** np.arange(DEGREE + 1))


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
    known = (_Regression(lines, ratio, len(poles)).answer(poles, rounds=0) for ratio in COARSE)
    return max(known, key=evidence)


def weights_of(fits: list[Answer]) -> Array:
    """The weight of each answer (·,), in sum one."""
    logarithms = TEMPER * np.array([one.evidence for one in fits])
    weights = np.exp(logarithms - logarithms.max())
    return np.asarray(weights / weights.sum())


def evidence(answer: Answer) -> float:
    """Its logarithm."""
    return answer.evidence


def _coarse(
    lines: Lines, starts: Array, neighbours: tuple[float, ...], known: list[Answer]
) -> list[Answer]:
    """Answers after a few rounds, at some λ."""
    modes, ratios = starts.shape[1], list(COARSE)
    if neighbours:
        best = max(known, key=evidence)
        extras = [np.array([[omega, zeta] for omega in neighbours]) for zeta in (0.02, 0.2)]
        starts = np.array([np.vstack([best.poles[:modes], extra]) for extra in extras])
        ratios = [best.ratio, best.ratio / 100]
    coarse = []
    for ratio in ratios:
        fit = _Regression(lines, ratio, modes)
        costs = [fit.best_numerators(start).cost for start in starts]
        coarse.append(fit.answer(starts[int(np.argmin(costs))], FEW_ROUNDS))
    return coarse


def _over_ratios(lines: Lines, first: Answer, best: float) -> list[Answer]:
    """Answers for larger and smaller λ, decade by decade, until they are negligible."""
    decade = min(max(round(math.log10(first.ratio)), DECADES[0]), DECADES[1])
    fitted = [_Regression(lines, 10.0**decade, first.modes).answer(first.poles)]
    for way in (range(decade + 1, DECADES[1] + 1), range(decade - 1, DECADES[0] - 1, -1)):
        last = fitted[0]
        for k in way:
            last = _Regression(lines, 10.0**k, first.modes).answer(last.poles)
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


class _Regression:
    """Least squares under the covariance I + λ C Cᵀ of noise and residual terms."""

    def __init__(self, lines: Lines, ratio: float, modes: int) -> None:
        u, size, _ = lines.residual_terms
        self.lines, self.ratio, self.modes = lines, ratio, modes
        # logarithm of the covariance's determinant
        self.inflation = np.log1p(ratio * size**2).sum()
        shrinkage = 1 - 1 / np.sqrt(1 + ratio * size**2)
        counts = shrinkage > 0  # what is smaller than rounding leaves all as it is
        self.u, self.shrunk = u[:, counts], u[:, counts] * shrinkage[counts]
        self.y = self.white(lines.observed)

    def white(self, values: Array) -> Array:
        """(I + λ C Cᵀ)^(−½) times columns."""
        return np.asarray(values - self.shrunk @ (self.u.T @ values))

    def bounds(self, poles: Array) -> tuple[Array, Array]:
        """Bounds of ω and ζ (m, 2): modes are about the band, neighbours on their side of it."""
        low, high = self.lines.edges
        inner, above = np.arange(len(poles)) < self.modes, poles[:, 0] > 1
        least = np.where(inner, low / MARGIN, np.where(above, high, low / FARTHEST))
        most = np.where(inner, high * MARGIN, np.where(above, high * FARTHEST, low))
        zeta = np.where(inner, DAMPING[0], LEAST_DAMPING)
        return np.stack([least, zeta], axis=1), np.stack(
            [most, np.full(len(poles), DAMPING[1])], axis=1
        )

    def best_numerators(self, poles: Array) -> _BestNumerators:
        """Numerators for given poles, and what they leave of the output."""
        q = _fractions(poles, self.lines.s)
        columns = (q[:, :, None] * self.lines.inputs[:, None, :]).reshape(len(q), -1)
        rows = real(columns)
        sizes = np.sqrt(np.einsum("ij,ij->j", rows, rows))
        factors, reflectors, *_ = lapack.dgeqrf(self.white(rows / sizes))
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
        slopes = self.white(real(both.reshape(len(q), -1)))
        return np.asarray(slopes - now.basis @ (now.basis.T @ slopes))

    def answer(self, poles: Array, rounds: int = ROUNDS) -> Answer:
        """Fit by Levenberg and Marquardt's method on ω and ζ, from some ``poles``.

        The numerators are eliminated (Golub & Pereyra 1973).
        """
        damping, (least, most) = 1e-3, self.bounds(poles)
        poles = np.minimum(np.maximum(poles, least), most)
        now = self.best_numerators(poles)
        for _ in range(rounds):
            slopes = self.slopes(poles, now)
            scale = np.sqrt(np.einsum("ij,ij->j", slopes, slopes)) + 1e-300
            slopes /= scale
            normal, gradient = slopes.T @ slopes, slopes.T @ now.left
            before = now.cost
            for _ in range(TRIALS):
                _, step, _ = lapack.dposv(normal + damping * np.eye(len(normal)), gradient)
                if gradient @ step < CONVERGED * before:
                    return self._with_covariance(poles, now)
                step = (step / scale).reshape(-1, 2)
                step *= min(1.0, 1 / float(np.max(np.abs(step) / LARGEST_STEP)))
                there = np.minimum(np.maximum(poles + step, least), most)
                new = self.best_numerators(there)
                if new.cost < before:
                    poles, now, damping = there, new, damping / 10
                    break
                damping *= 5
            if before - now.cost < CONVERGED * before:
                break
        return self._with_covariance(poles, now)

    def _with_covariance(self, poles: Array, now: _BestNumerators) -> Answer:
        slopes = self.slopes(poles, now)
        scale = np.linalg.norm(slopes, axis=0) + 1e-300
        normal = (slopes / scale).T @ (slopes / scale)
        inverse = np.linalg.pinv(normal, rcond=1e-13, hermitian=True) / np.outer(scale, scale)
        spare = len(now.left) - now.basis.shape[1] - slopes.shape[1]
        variance = now.cost / spare
        gain = self.white(slopes @ inverse)
        order = np.concatenate(
            [np.argsort(poles[: self.modes, 0]), np.arange(self.modes, len(poles))]
        )
        kept = (2 * order[: self.modes, None] + np.arange(2)).ravel()
        tails = variance * spare / max(spare - 2, 1)  # variance of Student's distribution
        return Answer(
            poles=poles[order],
            modes=self.modes,
            ratio=self.ratio,
            covariance=tails * inverse[np.ix_(kept, kept)],
            noise=tails * (gain.T @ gain)[np.ix_(kept, kept)],
            evidence=self._likelihood(now, slopes, variance, spare),
            numerators=(now.numerators / now.sizes).reshape(len(poles), -1)[order],
            remainder=self.lines.observed - real(now.columns) @ now.numerators,
        )

    def _likelihood(
        self, now: _BestNumerators, slopes: Array, variance: float, spare: int
    ) -> float:
        """Logarithm of the evidence, numerators and poles integrated over usual sizes."""
        each, poles = self.lines.inputs.shape[1], slopes.shape[1] // 2
        of_neighbour = np.array([1, 1, NEIGHBOUR_ENDS, NEIGHBOUR_ENDS])[:each]
        of_neighbour = of_neighbour * self.lines.typical * np.linalg.norm(self.lines.u)
        of_modes = np.full(self.modes * each, np.linalg.norm(self.lines.observed))
        prior = np.concatenate([of_modes, np.tile(of_neighbour, poles - self.modes)])
        linear = np.linalg.svd(np.triu(now.factors) * prior, compute_uv=False) ** 2 / variance
        other = np.linalg.svd(slopes, compute_uv=False) ** 2 / (2 * variance)
        determinants = self.inflation + np.log1p(linear).sum() + np.log1p(other).sum()
        size = math.sqrt(variance * self.ratio) / self.lines.typical
        likelihood = -0.5 * (len(self.y) * math.log(variance) + spare + determinants)
        likelihood += 2 * np.log(self.lines.weight).sum()  # of the output itself, not weighted
        return float(likelihood - 0.5 * (math.log(size / USUAL) / SPREAD) ** 2)


def _fractions(poles: Array, s: Array) -> Array:
    """1/(s² + 2ζω s + ω²) (k, m)."""
    omega, zeta = poles.T
    return np.asarray(1 / (s[:, None] ** 2 + 2 * zeta * omega * s[:, None] + omega**2))


def real(values: Array) -> Array:
    """Real above imaginary parts: a complex least-squares problem as a real one."""
    return np.concatenate([values.real, values.imag])
