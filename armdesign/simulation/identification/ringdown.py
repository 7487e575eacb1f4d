"""Modes of an arm that rings freely: eigensystem realization, refined by least squares.

Samples y_k = C A^k x_0 of a free decay fill a Hankel matrix H_0 of y_{i+j} and its neighbour H_1
of y_{i+j+1}. With the singular values H_0 = U S Vᵀ cut at two per mode, A = S^(−½) Uᵀ H_1 V S^(−½)
has the eigenvalues z = exp(λ Δt) (Juang & Pappa 1985). That is done with the record and with its
beginnings: with much damping its end holds noise alone.

From there on Re Σ c exp(λt) is fitted to the samples. What the modes leave is taken as
autoregressive, that is

    (1 + a_1 q + … + a_p q^p) (y − Re Σ c exp(λt)) = white noise,   q one sample back,

and both sides of the fit are filtered so. Each order p gives an answer. How likely the record is
under it (Schwarz 1978) weighs it, and the deviation holds how far likely answers differ. So are
further modes tried beside those asked for, as long as they make the record likelier; the strongest
are the answer.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from armdesign.arrays import Array
from armdesign.errors import SimulationError
from armdesign.simulation.identification.records import signals_of

MOST_ROWS = 400  # of the Hankel matrix
BEGINNINGS = (1, 2, 4, 8)  # shares of the record from which the search starts: all, half, …
ORDERS = (1, 2, 4)  # p, besides 0
FURTHER = 2  # modes beside those asked for
WHITE = np.zeros(0)  # no filter
NEGLIGIBLE = 4.0  # logarithm of a weight below the largest
TEMPER = 0.5  # power of the likelihood that weighs
EXACT = 1e-9  # what is left of a record without noise, relative: no colour can be told
ROUNDS, TRIALS, FILTERS = 30, 8, 2
CONVERGED = 1e-10  # relative change of what is left
LARGEST_STEP = 0.2  # of λ in a round, relative


@dataclass(frozen=True, eq=False)
class Ringdown:
    """Modes of a free decay; arrays are read-only.

    Attributes:
        natural_frequencies: (m,) ascending [Hz].
        damping_ratios: (m,).
        frequency_deviations: standard deviations of the frequencies (m,) [Hz], by noise, white or
            coloured, and by further modes. Errors by nonlinearity are not in them.
        damping_deviations: standard deviations of the damping ratios (m,).
        frequency_remainders: part of the frequencies' deviations by which likely answers differ,
            with other noise or more modes (m,) [Hz]; its square adds to the variance by noise.
        damping_remainders: the same part of the damping ratios' deviations (m,).
        amplitudes: of every mode in every output at the record's start (m, outputs).
        singular_values: of the Hankel matrix, largest first: a gap shows how many modes it holds.
        residual: root mean square of what the modes leave of the outputs, relative.
    """

    natural_frequencies: Array
    damping_ratios: Array
    frequency_deviations: Array
    damping_deviations: Array
    frequency_remainders: Array
    damping_remainders: Array
    amplitudes: Array
    singular_values: Array
    residual: float

    def __post_init__(self) -> None:
        for value in vars(self).values():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)


def identify_ringdown(
    time: ArrayLike, response: ArrayLike, modes: int = 1, part: str = "ring-down"
) -> Ringdown:
    """Natural frequencies and damping ratios of the modes that a free decay holds.

    By eigensystem realization (Juang & Pappa 1985), refined by least squares under coloured noise:
    see the module.

    Args:
        time: evenly spaced instants (n,) [s], after the excitation has ended.
        response: what rings about zero, as speeds: (n,) or (n, outputs). A constant is no mode and
            has to be taken off before.
        modes: how many modes are asked for, the strongest.
        part: name of the record for messages.

    Raises:
        SimulationError: the record is too short or has no even instants, nothing moves, or fewer
            modes oscillate.

    Example:
        >>> import numpy as np, armdesign as ad
        >>> time = np.arange(0, 8, 0.02)
        >>> speed = np.exp(-0.05 * 2 * np.pi * time) * np.cos(2 * np.pi * time)
        >>> found = ad.identify_ringdown(time, speed)
        >>> print(found.natural_frequencies.round(3), found.damping_ratios.round(3))
        [1.001] [0.05]
    """
    step, (signals,) = signals_of(part, time, response)
    signals = signals.reshape(len(signals), -1)
    scale = np.abs(signals).max(axis=0)
    if not scale.max() > 0:
        raise SimulationError(part, "nothing moves", "raise the amplitude")
    signals = signals / np.where(scale > 0, scale, 1.0)
    if len(signals) < 8 * modes:
        problem = f"{len(signals)} records are too few"
        raise SimulationError(part, problem, f"record {8 * modes} or more")
    found, singular = _answers(signals, modes, part)
    weights = np.exp(
        TEMPER * (np.array(list(map(_likelihood, found))) - max(map(_likelihood, found)))
    )
    weights /= weights.sum()
    values = np.array([one.modes(modes) for one in found])  # (·, 2, modes): |λ Δt|, ζ
    mean = np.einsum("i,ijk->jk", weights, values)
    apart = np.einsum("i,ijk->jk", weights, (values - mean) ** 2)
    within = np.einsum("i,ijk->jk", weights, np.array([one.variances(modes) for one in found]))
    deviations, remainders, unit = np.sqrt(within + apart), np.sqrt(apart), 2 * math.pi * step
    likeliest = found[int(np.argmax(weights))]
    return Ringdown(
        natural_frequencies=mean[0] / unit,
        damping_ratios=mean[1].copy(),
        frequency_deviations=deviations[0] / unit,
        damping_deviations=deviations[1].copy(),
        frequency_remainders=remainders[0] / unit,
        damping_remainders=remainders[1].copy(),
        amplitudes=np.abs(likeliest.shapes[likeliest.strongest(modes)]) * scale,
        singular_values=singular,
        residual=float(np.linalg.norm(likeliest.left) / np.linalg.norm(signals)),
    )


def _answers(signals: Array, modes: int, part: str) -> tuple[list[_Refined], Array]:
    """Fits of the modes under noise of all orders, and of further modes while these are likely.

    Colour can pass for a mode and a mode for colour: counts are compared under the same noise,
    then at their best. The second is the singular values of the Hankel matrix.
    """
    found, of_all, least, margin = list[_Refined](), np.zeros(0), -math.inf, NEGLIGIBLE / TEMPER
    for count in range(modes, modes + FURTHER + 1):
        starts, singular, most = _starts(signals, count)
        if count == modes:
            of_all = singular
        if not starts:
            break
        plain = _refined(
            signals, min(starts, key=lambda start: _eliminated(signals, start, WHITE).cost), WHITE
        )
        if plain.likelihood < least:
            break
        least = plain.likelihood - margin
        group = [plain, *(_coloured(signals, plain, order) for order in _orders(signals, plain))]
        if found and max(map(_likelihood, group)) < max(map(_likelihood, found)) - margin:
            break
        found += group
        if np.linalg.norm(plain.left) < EXACT * np.linalg.norm(signals):
            break
    if not found:
        raise SimulationError(
            part, f"holds {most} modes, not {modes}", "ask for fewer, or record longer"
        )
    return found, of_all


def _likelihood(answer: _Refined) -> float:
    return answer.likelihood


def _starts(signals: Array, modes: int) -> tuple[list[Array], Array, int]:
    """λ Δt of the modes (m,) from each beginning of the record.

    Beside them the singular values of the whole record, and the largest number of modes found.
    """
    starts, most, of_all = [], 0, np.zeros(0)
    for share in BEGINNINGS:
        some = signals[: len(signals) // share]
        rows = min(len(some) // 2, MOST_ROWS)
        if rows < 4 * modes:
            break
        factors, singular = _realised(some, 2 * modes, rows)
        of_all = singular if share == 1 else of_all
        roots = np.log(factors[np.abs(factors) > 0].astype(complex))
        above = roots[roots.imag > 1e-9]
        most = max(most, len(above))
        if len(above) == modes and np.all(np.abs(above.real) < 1):
            starts.append(above[np.argsort(np.abs(above))])
    return starts, of_all, most


def _realised(signals: Array, order: int, rows: int) -> tuple[Array, Array]:
    """Factors z by which the modes grow per sample (order,), complex, and all singular values."""
    # (rows + 1, outputs, ·)
    windows = np.lib.stride_tricks.sliding_window_view(signals, len(signals) - rows, axis=0)
    first, second = (part.reshape(-1, windows.shape[-1]) for part in (windows[:-1], windows[1:]))
    u, singular, v = np.linalg.svd(first, full_matrices=False)
    root = np.sqrt(np.maximum(singular[:order], 1e-14 * singular[0]))
    return (
        np.linalg.eigvals((u[:, :order].T @ second @ v[:order].T) / root[:, None] / root),
        singular,
    )


@dataclass(frozen=True, eq=False)
class _Refined:
    """Modes by least squares under one colour of what they leave.

    Attributes:
        roots: λ Δt (m,), ascending by size.
        shapes: c of every mode in every output (m, outputs), complex.
        left: what the modes leave of the outputs (n, outputs).
        covariance: of the real, then the imaginary parts of the roots (2m, 2m).
        likelihood: its logarithm, less Schwarz's penalty.
    """

    roots: Array
    shapes: Array
    left: Array
    covariance: Array
    likelihood: float

    @cached_property
    def shares(self) -> Array:
        """Sum of squares that each mode adds beyond what the others could make up for (m,)."""
        powers = np.exp(self.roots * np.arange(len(self.left))[:, None])
        columns = np.stack([powers.real, powers.imag], axis=2)
        found = []
        for k, shape in enumerate(self.shapes):
            own = (powers[:, k : k + 1] * shape).real
            others = np.linalg.qr(np.delete(columns, k, axis=1).reshape(len(powers), -1))[0]
            found.append(np.sum((own - others @ (others.T @ own)) ** 2))
        return np.array(found)

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


def _orders(signals: Array, plain: _Refined) -> list[int]:
    """Orders p that the record supports; none if nothing is left."""
    exact = np.linalg.norm(plain.left) < EXACT * np.linalg.norm(signals)
    return [] if exact else [order for order in ORDERS if 20 * order <= len(signals)]


def _coloured(signals: Array, plain: _Refined, order: int) -> _Refined:
    """The fit under noise of an order, its filter found from what the fit before leaves."""
    found = plain
    for _ in range(FILTERS):
        found = _refined(signals, found.roots, _filter(found.left, order))
    return found


def _filter(left: Array, order: int) -> Array:
    """a_1 … a_p (p,) by least squares, for all outputs together, each of its own size."""
    each = left / np.maximum(np.linalg.norm(left, axis=0), 1e-300)
    past = np.concatenate(
        [
            np.stack([one[order - k : len(one) - k] for k in range(1, order + 1)], 1)
            for one in each.T
        ]
    )
    return np.asarray(-np.linalg.lstsq(past, each[order:].T.ravel(), rcond=None)[0])


def _filtered(values: Array, colour: Array) -> Array:
    """1 + a_1 q + … applied along axis 0; the first p samples stay as they are."""
    found = values.copy()
    for k, a in enumerate(colour, 1):
        found[len(colour) :] += a * values[len(colour) - k : len(values) - k]
    return found


def _refined(signals: Array, roots: Array, colour: Array) -> _Refined:
    """Levenberg's and Marquardt's method on λ, the shapes eliminated (Golub & Pereyra 1973)."""
    count, damping = len(roots), 1e-3
    target = _filtered(signals, colour)
    now = _eliminated(target, roots, colour)
    for _ in range(ROUNDS):
        slopes, before = _slopes(roots, now, colour), now.cost
        normal, gradient = slopes.T @ slopes, slopes.T @ now.left.T.ravel()
        for _ in range(TRIALS):
            step = np.linalg.solve(normal + damping * np.diag(np.diag(normal) + 1e-300), gradient)
            if gradient @ step <= CONVERGED * before:
                return _with_covariance(signals, roots, colour, now, slopes)
            change = step[:count] + 1j * step[count:]
            change *= min(1.0, LARGEST_STEP / float(np.max(np.abs(change) / np.abs(roots))))
            new = _eliminated(target, roots + change, colour)
            if np.all((roots + change).imag > 0) and new.cost < before:
                roots, now, damping = roots + change, new, damping / 10
                break
            damping *= 5
        else:
            break
    return _with_covariance(signals, roots, colour, now, _slopes(roots, now, colour))


@dataclass(frozen=True, eq=False)
class _Eliminated:
    """Shapes by least squares for given roots.

    Attributes:
        basis: filtered powers, orthonormal (n, 2m).
        shapes: c (m, outputs), complex.
        left: what they leave of the filtered outputs (n, outputs).
        cost: its sum of squares.
    """

    basis: Array
    shapes: Array
    left: Array
    cost: float


def _basis(roots: Array, length: int, colour: Array) -> Array:
    """Filtered real and imaginary parts of exp(λt) (n, 2m)."""
    powers = np.exp(roots * np.arange(length)[:, None])
    return _filtered(np.hstack([powers.real, -powers.imag]), colour)


def _eliminated(target: Array, roots: Array, colour: Array) -> _Eliminated:
    """Shapes by least squares of the filtered outputs (n, outputs)."""
    basis, triangle = np.linalg.qr(_basis(roots, len(target), colour))
    share = basis.T @ target
    found, left = np.linalg.lstsq(triangle, share, rcond=None)[0], target - basis @ share
    return _Eliminated(
        basis, found[: len(roots)] + 1j * found[len(roots) :], left, float(np.sum(left**2))
    )


def _slopes(roots: Array, now: _Eliminated, colour: Array) -> Array:
    """Change of all filtered outputs (outputs n, 2m) by Re λ and Im λ, shapes eliminated."""
    instants = np.arange(len(now.left))[:, None]
    powers, found = instants * np.exp(roots * instants), []
    for shape in now.shapes.T:
        change = powers * shape
        each = _filtered(np.hstack([change.real, -change.imag]), colour)
        found.append(each - now.basis @ (now.basis.T @ each))
    return np.concatenate(found)


def _with_covariance(
    signals: Array, roots: Array, colour: Array, now: _Eliminated, slopes: Array
) -> _Refined:
    """How certain the roots are: noise of the size that is left of each output."""
    length, order = len(signals), np.argsort(np.abs(roots))
    variance = np.sum(now.left**2, axis=0) / max(length - 2 * len(roots) - len(colour), 1)
    sizes = np.repeat(np.sqrt(variance), length)
    gain = (
        np.linalg.pinv(slopes.T @ slopes, rcond=1e-15, hermitian=True)
        @ (slopes * sizes[:, None]).T
    )
    both = np.concatenate([order, len(roots) + order])
    powers = np.exp(roots * np.arange(length)[:, None])
    logarithms = np.log(np.maximum(variance, 1e-300)).sum()
    unknowns = len(colour) + len(roots) * (2 + 2 * signals.shape[1])
    return _Refined(
        roots=roots[order],
        shapes=now.shapes[order],
        left=signals - (powers @ now.shapes).real,
        covariance=(gain @ gain.T)[np.ix_(both, both)],
        likelihood=float(-0.5 * length * logarithms - 0.5 * unknowns * math.log(length)),
    )
