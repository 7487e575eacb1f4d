"""Decaying modes fitted to samples by least squares, under noise that may be coloured.

Re Σ c exp(λt) is fitted to the samples y. What it leaves is

    (1 + a_1 q + … + a_p q^p) (y − Re Σ c exp(λt)) = white noise + N b,   q one sample back,

where N b stands for a mode nearby that is too weak or too damped to be told apart: the columns N
are its filtered powers, b is random with a known standard deviation. A trend, a polynomial of
time of which nothing is known, is projected out. Both sides are filtered and whitened so; then the
modes are what least squares give. Beside a trend, what is slower than two periods within the
record, or has more than OVERDAMPED of damping, is part of the trend; without one, what turns by
less than a tenth of a period is an offset.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armdesign.arrays import Array, Flags

ROUNDS, TRIALS = 30, 8
CONVERGED = 1e-10  # relative change of what is left
LARGEST_STEP = 0.2  # of λ in a round, relative


# share of Occam's factor in the likelihood: a hidden mode is no random draw, so a record speaks
# against it only where it would show
OCCAM = 0.25
NO_TREND = -1  # degree
LEAST_PERIODS, OVERDAMPED = 2.0, 0.7  # of what rings about a trend
LEAST_PART = 0.1  # of a period of what rings about zero, else it is an offset
AROUND = np.arange(-6, 7)  # lines of the spectrum about a mode that tell its noise
FREE = 0.5  # share of a sine that a fit leaves
NO_ROOTS = np.zeros(0, dtype=complex)


class Noise:
    """Residual of a record without its modes, and how to whiten it.

    Attributes:
        colour: a_1 … a_p (p,); none for white noise.
        inflation: logarithm of the determinant of I + N Nᵀ, as far as it counts.
    """

    def __init__(
        self,
        length: int,
        colour: Array,
        hidden: Array = NO_ROOTS,
        ratio: float = 0.0,
        trend_degree: int = NO_TREND,
    ) -> None:
        """Noise of ``length`` samples.

        Args:
            length: n.
            colour: a_1 … a_p (p,).
            hidden: λ Δt of modes that may be hidden (h,), complex.
            ratio: standard deviation of b relative to the white noise's.
            trend_degree: degree of the polynomial that is projected out; -1 for none.
        """
        self.length, self.colour, self.trend_degree = length, colour, trend_degree
        self.trend_basis = trend = np.linalg.qr(self._filtered(polynomials(length, trend_degree)))[
            0
        ]
        columns = ratio * self._filtered(_powers(hidden, length))
        u, size, _ = np.linalg.svd(columns - trend @ (trend.T @ columns), full_matrices=False)
        self._u = np.hstack([trend, u])
        self._shrunk = np.hstack([trend, u * (1 - 1 / np.sqrt(1 + size**2))])
        self.inflation = OCCAM * float(np.log1p(size**2).sum())

    def whitened(self, values: Array) -> Array:
        """(I + N Nᵀ)^(−½) (1 + a_1 q + …) applied along axis 0."""
        filtered = self._filtered(values)
        return np.asarray(filtered - self._shrunk @ (self._u.T @ filtered))

    def _filtered(self, values: Array) -> Array:
        """1 + a_1 q + … applied along axis 0; the first p samples stay as they are."""
        filtered, order = values.copy(), len(self.colour)
        for k, a in enumerate(self.colour, 1):
            filtered[order:] += a * values[order - k : len(values) - k]
        return filtered


def polynomials(length: int, degree: int) -> Array:
    """Legendre's polynomials of time up to a degree (n, degree + 1); none for -1."""
    return np.polynomial.legendre.legvander(np.linspace(-1, 1, length), max(degree, 0))[
        :, : degree + 1
    ]


def detrended(values: Array, degree: int) -> Array:
    """Values (n, ·) less a polynomial of time, by least squares."""
    basis = np.linalg.qr(polynomials(len(values), degree))[0]
    return np.asarray(values - basis @ (basis.T @ values))


def _powers(roots: Array, length: int) -> Array:
    """Real and imaginary parts of exp(λt) (n, 2m)."""
    powers = np.exp(roots * np.arange(length)[:, None])
    return np.hstack([powers.real, -powers.imag])


@dataclass(frozen=True, eq=False)
class ModeFit:
    """Modes by least squares under one colour of what they leave.

    Attributes:
        roots: λ Δt (m,), ascending by size.
        shapes: c of every mode in every output (m, outputs), complex.
        residual: what modes and trend leave of the outputs (n, outputs).
        trend: polynomial of time (n, outputs).
        covariance: of the real, then the imaginary parts of the roots (2m, 2m).
        noise: what the modes leave is taken for.
        variance: of the white noise of every output (outputs,).
        likelihood: its logarithm, less Schwarz's penalty.
    """

    roots: Array
    shapes: Array
    residual: Array
    trend: Array
    covariance: Array
    noise: Noise
    variance: Array
    likelihood: float

    @cached_property
    def rings(self) -> Flags:
        """Which modes are no part of the trend (m,)."""
        turns = 2 * math.pi / len(self.residual)
        if self.noise.trend_degree < 0:
            return np.asarray(np.abs(self.roots) > LEAST_PART * turns)
        damped = -self.roots.real > OVERDAMPED * np.abs(self.roots)
        return np.asarray((self.roots.imag > LEAST_PERIODS * turns) & ~damped)

    @cached_property
    def shares(self) -> Array:
        """Sum of squares that each mode adds beyond what the others could make up for (m,).

        Of what does not ring: -1.
        """
        powers = np.exp(self.roots * np.arange(len(self.residual))[:, None])
        columns = np.stack([powers.real, powers.imag], axis=2)
        sizes = []
        for k, shape in enumerate(self.shapes):
            own = (powers[:, k : k + 1] * shape).real
            others = np.linalg.qr(np.delete(columns, k, axis=1).reshape(len(powers), -1))[0]
            sizes.append(np.sum((own - others @ (others.T @ own)) ** 2))
        return np.where(self.rings, sizes, -1.0)

    def strongest(self, modes: int) -> Array:
        """Which have the largest shares, ascending."""
        return np.sort(np.argsort(-self.shares)[:modes])

    def modes(self, modes: int) -> Array:
        """|λ Δt| and ζ of the strongest (2, modes)."""
        roots = self.roots[self.strongest(modes)]
        return np.array([np.abs(roots), -roots.real / np.abs(roots)])

    def variances(self, modes: int) -> Array:
        """Variances of both (2, modes)."""
        size, zeta = np.abs(self.roots), -self.roots.real / np.abs(self.roots)
        d_size = np.hstack([np.diag(self.roots.real / size), np.diag(self.roots.imag / size)])
        d_zeta = -(np.eye(len(size), 2 * len(size)) + zeta[:, None] * d_size) / size[:, None]
        both = np.einsum("imk,kl,iml->im", [d_size, d_zeta], self.covariance, [d_size, d_zeta])
        return np.asarray(both[:, self.strongest(modes)])


def fit_modes(signals: Array, roots: Array, noise: Noise) -> ModeFit:
    """Levenberg's and Marquardt's method on λ, the shapes eliminated (Golub & Pereyra 1973)."""
    count, damping = len(roots), 1e-3
    target = noise.whitened(signals)
    now = best_shapes(target, roots, noise)
    for _ in range(ROUNDS):
        slopes, before = _slopes(roots, now, noise), now.cost
        normal, gradient = slopes.T @ slopes, slopes.T @ now.residual.T.ravel()
        for _ in range(TRIALS):
            step = np.linalg.solve(normal + damping * np.diag(np.diag(normal) + 1e-300), gradient)
            if gradient @ step <= CONVERGED * before:
                return _with_covariance(signals, roots, noise, now, slopes)
            change = step[:count] + 1j * step[count:]
            change *= min(1.0, LARGEST_STEP / float(np.max(np.abs(change) / np.abs(roots))))
            new = best_shapes(target, roots + change, noise)
            if np.all((roots + change).imag > 0) and new.cost < before:
                roots, now, damping = roots + change, new, damping / 10
                break
            damping *= 5
        else:
            break
    return _with_covariance(signals, roots, noise, now, _slopes(roots, now, noise))


@dataclass(frozen=True, eq=False)
class BestShapes:
    """Shapes by least squares for given roots.

    Attributes:
        basis: filtered and whitened powers, orthonormal (n, 2m).
        shapes: c (m, outputs), complex.
        triangle: R of their QR decomposition (2m, 2m).
        residual: what they leave of the filtered and whitened outputs (n, outputs).
        cost: its sum of squares.
    """

    basis: Array
    triangle: Array
    shapes: Array
    residual: Array
    cost: float

    @property
    def unit_covariance(self) -> Array:
        """Covariance of Re c and Im c under unit noise (2m, 2m)."""
        return np.asarray(np.linalg.pinv(self.triangle.T @ self.triangle, hermitian=True))


def best_shapes(target: Array, roots: Array, noise: Noise) -> BestShapes:
    """Shapes by least squares of the filtered and whitened outputs (n, outputs)."""
    basis, triangle = np.linalg.qr(noise.whitened(_powers(roots, len(target))))
    share = basis.T @ target
    parts, residual = np.linalg.lstsq(triangle, share, rcond=None)[0], target - basis @ share
    return BestShapes(
        basis,
        triangle,
        parts[: len(roots)] + 1j * parts[len(roots) :],
        residual,
        float(np.sum(residual**2)),
    )


def _slopes(roots: Array, now: BestShapes, noise: Noise) -> Array:
    """Change of all filtered outputs (outputs n, 2m) by Re λ and Im λ, shapes eliminated."""
    instants = np.arange(len(now.residual))[:, None]
    powers, slopes = instants * np.exp(roots * instants), []
    for shape in now.shapes.T:
        change = powers * shape
        each = noise.whitened(np.hstack([change.real, -change.imag]))
        slopes.append(each - now.basis @ (now.basis.T @ each))
    return np.concatenate(slopes)


def _with_covariance(
    signals: Array, roots: Array, noise: Noise, now: BestShapes, slopes: Array
) -> ModeFit:
    """Roots and their covariance, by noise of the size that is left of each output."""
    length, order = len(signals), np.argsort(np.abs(roots))
    variance = np.sum(now.residual**2, axis=0) / max(
        length - 2 * len(roots) - len(noise.colour) - noise.trend_degree - 1, 1
    )
    sizes = np.repeat(np.sqrt(variance), length)
    gain = (
        np.linalg.pinv(slopes.T @ slopes, rcond=1e-15, hermitian=True)
        @ (slopes * sizes[:, None]).T
    )
    both = np.concatenate([order, len(roots) + order])
    levels = np.sqrt(np.tile(_levels(roots, noise, now, slopes, variance), 2))
    unfitted = signals - (np.exp(roots * np.arange(length)[:, None]) @ now.shapes).real
    residual = detrended(unfitted, noise.trend_degree)
    logarithms = np.log(np.maximum(variance, 1e-300)).sum()
    unknowns = len(noise.colour) + len(roots) * (2 + 2 * signals.shape[1])
    return ModeFit(
        roots=roots[order],
        shapes=now.shapes[order],
        residual=residual,
        trend=unfitted - residual,
        covariance=(gain @ gain.T * np.outer(levels, levels))[np.ix_(both, both)],
        noise=noise,
        variance=variance,
        likelihood=float(
            -0.5 * (length * logarithms + signals.shape[1] * noise.inflation)
            - 0.5 * unknowns * math.log(length)
        ),
    )


def _levels(roots: Array, noise: Noise, now: BestShapes, slopes: Array, variance: Array) -> Array:
    """Variance of what is left about the frequency of each mode over the whole variance (m,).

    What a mode may be off by depends on the noise near its own frequency alone, where few
    parameters of a colour may miss it. The lines ``AROUND`` it measure that, freed of
    what the fit has taken. Never below 1: few lines know little.
    """
    length, levels = len(now.residual), np.ones(len(roots))
    fits = list(zip(now.residual.T, np.split(slopes, len(variance)), variance, strict=True))
    for k, root in enumerate(roots):
        lines = np.round(root.imag * length / (2 * math.pi)) + AROUND
        lines = lines[(lines >= 1) & (lines < length / 2)]
        probes, energy, rank = _powers(2j * math.pi / length * lines, length), 0.0, 0
        for left, own, size in fits:
            taken = np.linalg.qr(np.hstack([noise.trend_basis, now.basis, own]))[0]
            free = probes - taken @ (taken.T @ probes)
            # not by its singular values: where many are equal, LAPACK's gesdd may not converge
            squares, axes = np.linalg.eigh(free.T @ free)
            kept = squares > FREE**2 * length / 2
            parts = (left @ free @ axes[:, kept]) ** 2 / squares[kept]
            energy += float(np.sum(parts)) / max(size, 1e-300)
            rank += len(parts)
        if rank > 2:  # Student's t of so many degrees of freedom has the variance n/(n − 2)
            levels[k] = max(1.0, energy / (rank - 2))
    return levels


def autoregression(left: Array, order: int) -> Array:
    """Colour a_1 … a_p (p,) of what is left of the outputs (n, outputs), by least squares.

    For all outputs together, each of its own size.
    """
    each = left / np.maximum(np.linalg.norm(left, axis=0), 1e-300)
    past = np.concatenate(
        [
            np.stack([one[order - k : len(one) - k] for k in range(1, order + 1)], 1)
            for one in each.T
        ]
    )
    return np.asarray(-np.linalg.lstsq(past, each[order:].T.ravel(), rcond=None)[0])
