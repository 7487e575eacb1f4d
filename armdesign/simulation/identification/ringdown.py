"""Modes of an arm that rings freely: eigensystem realization, refined by least squares.

Samples y_k = C A^k x_0 of a free decay fill a Hankel matrix H_0 of y_{i+j} and its neighbour H_1
of y_{i+j+1}. With the singular values H_0 = U S Vᵀ cut at two per mode, A = S^(−½) Uᵀ H_1 V S^(−½)
has the eigenvalues z = exp(λ Δt) (Juang & Pappa 1985). That is done with the record and with its
beginnings: with much damping its end holds noise alone.

From there on Re Σ c exp(λt) is fitted to the samples. What the modes leave is taken as
autoregressive, that is

    (1 + a_1 q + … + a_p q^p) (y − Re Σ c exp(λt)) = white noise,   q one sample back,

and both sides of the fit are filtered so; where a trend bends, that counts as noise when its
colour is estimated. The deviations are scaled to the noise about each mode's own frequency, which
few parameters of a colour may miss. Each order p gives an answer. How likely the record is
under it (Schwarz 1978) weighs it, and the deviation holds how far likely answers differ. So are
further modes tried beside those asked for, as long as they make the record likelier; the
strongest are the answer. Where a gap in the singular values shows more modes than these, as many
are tried, too: two that lie near each other make no record likelier one by one. A mode nearby may
be too weak or too damped to show and still pull at the answer, so it is given room at 1.3 times
the frequency, above and below. About a trend, what does not ring for two periods of the record is
part of it. A record in which the modes asked for do not stand out of noise and trend is refused.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from armdesign.arguments import checked
from armdesign.arrays import Array, Flags, ReadOnly
from armdesign.errors import SimulationError
from armdesign.short_repr import short_repr
from armdesign.simulation.identification.decaying_modes import (
    NO_TREND,
    ModeFit,
    Noise,
    autoregression,
    best_shapes,
    detrended,
    fit_modes,
)
from armdesign.simulation.identification.records import signals_of

if TYPE_CHECKING:
    from armdesign.plots.canvas import Figure

MOST_ROWS = 400  # of the Hankel matrix
BEGINNINGS = (1, 2, 4, 8)  # shares of the record from which the search starts: all, half, …
ORDERS = (1, 2, 4)  # p, besides 0
FURTHER = 2  # modes beside those asked for
GAP = 20.0  # ratio of neighbouring singular values: as many modes as lie before it are tried, too
NEGLIGIBLE = 4.0  # logarithm of a weight below the largest
TEMPER = 0.5  # power of the likelihood that weighs
EXACT = 1e-9  # what is left of a record without noise, relative: no colour can be told
FILTERS = 2
LINE = 1  # degree
ROUNDING = 1e-13  # of an output's largest value: it stands, but for what is lost with its trend
HIDDEN = (1 / 1.3, 1.3)  # frequencies of modes that may be hidden, relative
HIDDEN_SHARE = 0.5  # usual amplitude of theirs, relative
APART = 0.15  # a hidden mode from those found, relative
STANDS_OUT = 5.0  # by how much a mode must raise the logarithm of the likelihood


@dataclass(frozen=True, eq=False)
class Ringdown(ReadOnly):
    """Modes of a free decay; arrays are read-only.

    Attributes:
        natural_frequencies: (m,) ascending [Hz].
        damping_ratios: (m,).
        frequency_deviations: standard deviations of the frequencies (m,) [Hz], by noise, white or
            coloured, by further modes, and by one nearby that the noise may hide. Errors by
            nonlinearity are not in them.
        damping_deviations: standard deviations of the damping ratios (m,).
        frequency_remainders: part of the frequencies' deviations by which likely answers differ,
            with other noise or more modes (m,) [Hz]; its square adds to the variance by noise.
        damping_remainders: the same part of the damping ratios' deviations (m,).
        amplitudes: of every mode in every output at the record's start (m, outputs).
        singular_values: of the Hankel matrix, largest first: a gap shows how many modes it holds.
        fitted: modes and trend (n, outputs).
        residual: root mean square of what the modes leave of the outputs, relative.
        time: of the record (n,) [s].
        response: the record (n, outputs).
    """

    __repr__ = short_repr

    natural_frequencies: Array
    damping_ratios: Array
    frequency_deviations: Array
    damping_deviations: Array
    frequency_remainders: Array
    damping_remainders: Array
    amplitudes: Array
    singular_values: Array
    fitted: Array
    residual: float
    time: Array
    response: Array

    def plot(self) -> Figure:
        """Figure of the decay, the modes fitted to it, and what they leave of it."""
        from armdesign import plots

        return plots.ringdown(self)


@checked
def identify_ringdown(
    time: ArrayLike,
    response: ArrayLike,
    modes: int = 1,
    part: str = "ring-down",
    trend: int = NO_TREND,
) -> Ringdown:
    """Natural frequencies and damping ratios of the modes that a free decay holds.

    By eigensystem realization (Juang & Pappa 1985), refined by least squares under coloured noise:
    see the module.

    Args:
        time: evenly spaced instants (n,) [s], after the excitation has ended.
        response: what rings about zero, as speeds, or about a trend: (n,) or (n, outputs).
        modes: how many modes are asked for, the strongest.
        part: name of the record for messages.
        trend: degree of the polynomial of time about which it rings, 0 for a constant; -1: zero.

    Raises:
        SimulationError: the record is too short or has no even instants, nothing moves, fewer
            modes oscillate, or noise hides one of them.

    Example:
        >>> import numpy as np, armdesign as ad
        >>> time = np.arange(0, 8, 0.02)
        >>> speed = np.exp(-0.05 * 2 * np.pi * time) * np.cos(2 * np.pi * time)
        >>> found = ad.identify_ringdown(time, speed)
        >>> print(found.natural_frequencies.round(3), found.damping_ratios.round(3))
        [1.001] [0.05]
    """
    step, (signals,) = signals_of(part, time, response)
    whole = signals.reshape(len(signals), -1)
    signals = detrended(whole, min(trend, LINE))
    scale = np.abs(signals).max(axis=0)
    moves = scale > ROUNDING * np.abs(whole).max(axis=0)
    if not moves.any():
        raise SimulationError(part, "nothing moves", "raise the amplitude")
    signals = signals[:, moves] / scale[moves]
    if len(signals) < 8 * modes:
        fault = f"{len(signals)} records are too few"
        raise SimulationError(part, fault, f"record {8 * modes} or more")
    fits, singular = _answers(signals, modes, part, trend)
    weights = np.exp(
        TEMPER * (np.array(list(map(_likelihood, fits))) - max(map(_likelihood, fits)))
    )
    weights /= weights.sum()
    values = np.array([one.modes(modes) for one in fits])  # (·, 2, modes): |λ Δt|, ζ
    mean = np.einsum("i,ijk->jk", weights, values)
    apart = np.einsum("i,ijk->jk", weights, (values - mean) ** 2)
    within = np.einsum("i,ijk->jk", weights, np.array([one.variances(modes) for one in fits]))
    deviations, remainders, unit = np.sqrt(within + apart), np.sqrt(apart), 2 * math.pi * step
    likeliest = fits[int(np.argmax(weights))]
    return Ringdown(
        natural_frequencies=mean[0] / unit,
        damping_ratios=mean[1].copy(),
        frequency_deviations=deviations[0] / unit,
        damping_deviations=deviations[1].copy(),
        frequency_remainders=remainders[0] / unit,
        damping_remainders=remainders[1].copy(),
        amplitudes=scale * _among_all(np.abs(likeliest.shapes[likeliest.strongest(modes)]), moves),
        singular_values=singular,
        fitted=whole - scale * _among_all(likeliest.residual, moves),
        residual=float(
            np.linalg.norm(likeliest.residual) / np.linalg.norm(detrended(signals, trend))
        ),
        time=np.array(time, dtype=float),
        response=whole.copy(),
    )


def _among_all(values: Array, moves: Flags) -> Array:
    """Values of the outputs that move (k, ·) among those of all outputs (k, outputs), else 0."""
    among = np.zeros((len(values), len(moves)))
    among[:, moves] = values
    return among


def _answers(signals: Array, modes: int, part: str, trend: int) -> tuple[list[ModeFit], Array]:
    """Fits of the modes under noise of all orders, and of further modes while these are likely.

    Colour can pass for a mode and a mode for colour: counts are compared under the same noise,
    then at their best. The second is the singular values of the Hankel matrix.
    """
    fits, of_all, least, margin = list[ModeFit](), np.zeros(0), -math.inf, NEGLIGIBLE / TEMPER
    most = 0
    for count in range(modes, modes + FURTHER + 1):
        starts, singular, found = _starts(detrended(signals, trend), count)
        most = max(most, found)
        if count == modes:
            of_all = singular
        group = _group(signals, starts, trend)
        if not group or group[0].likelihood < least:
            break
        least = group[0].likelihood - margin
        if fits and max(map(_likelihood, group)) < max(map(_likelihood, fits)) - margin:
            break
        fits += group
        if _exact(signals, group[0]):
            break
    count = _modes_before_gap(of_all)
    if count > modes + FURTHER and fits and not _exact(signals, fits[0]):
        fits += _group(signals, _starts(detrended(signals, trend), count)[0], trend)
    remedy = "ask for fewer, or " if modes > 1 else ""
    fewer = [one for one in fits if one.rings.sum() < modes]
    fits = [one for one in fits if one.rings.sum() >= modes]
    likelihoods = [max(map(_likelihood, some), default=-math.inf) for some in (fits, fewer)]
    if not fits or likelihoods[0] < likelihoods[1] + STANDS_OUT:
        raise _too_few(signals, modes, most, part, trend, remedy)
    if not _exact(signals, fits[0]):
        likeliest = max(fits, key=_likelihood)
        if likeliest.likelihood < _without(signals, modes, trend) + STANDS_OUT:
            fault = f"noise hides {'its mode' if modes == 1 else f'the weakest of {modes} modes'}"
            raise SimulationError(part, fault, f"{remedy}record longer or louder")
        fits += _with_hidden(signals, likeliest, modes)
    return fits, of_all


def _too_few(
    signals: Array, modes: int, most: int, part: str, trend: int, remedy: str
) -> SimulationError:
    """The error of a record in which fewer modes ring than are asked for.

    ``remedy`` is what helps besides a longer window.
    """
    if most < modes:
        fault = f"holds {most or 'no'} mode{'s' * (most > 1)}, not {modes}"
    else:
        few = "no mode rings" if modes == 1 else f"fewer than {modes} modes ring"
        fault = f"{few} in it for two periods or more"
    if trend == NO_TREND and np.any(np.abs(signals.mean(axis=0)) > signals.std(axis=0)):
        about = "give trend=0: what rings in it does so about another value than zero"
        return SimulationError(part, fault, about)
    return SimulationError(part, fault, f"{remedy}choose a longer window")


def _modes_before_gap(singular: Array) -> int:
    """How many modes a clear gap in the singular values shows; 0 if there is none."""
    pairs = singular[: 2 * ((len(singular) - 1) // 2) + 1]
    before, after = pairs[1::2], pairs[2::2]
    ratios = before / np.maximum(after, 1e-12 * pairs[0])
    k = int(ratios.argmax()) if len(ratios) else 0
    return k + 1 if len(ratios) and ratios[k] >= GAP and before[k] > 1e-6 * pairs[0] else 0


def _group(signals: Array, starts: list[Array], trend: int) -> list[ModeFit]:
    """Fits from the best start under white noise, then under noise of all orders."""
    if not starts:
        return []
    white = Noise(len(signals), np.zeros(0), trend_degree=trend)
    costs = [best_shapes(signals, start, white).cost for start in starts]
    plain = fit_modes(signals, starts[int(np.argmin(costs))], white)
    return [plain, *(_coloured(signals, plain, order) for order in _orders(signals, plain))]


def _without(signals: Array, modes: int, trend: int) -> float:
    """Likelihood of the record with one mode less than asked for."""
    level = detrended(signals, trend)
    if modes > 1:
        return max(
            map(_likelihood, _group(signals, _starts(level, modes - 1)[0], trend)),
            default=-math.inf,
        )
    likelihoods = []
    for order in (0, 1):
        noise = Noise(
            len(signals),
            autoregression(level, order) if order else np.zeros(0),
            trend_degree=trend,
        )
        left = noise.whitened(signals)
        logarithms = np.log(np.mean(left**2, axis=0)).sum()
        likelihoods.append(-0.5 * len(signals) * logarithms - 0.5 * order * math.log(len(signals)))
    return float(max(likelihoods))


def _with_hidden(signals: Array, likeliest: ModeFit, modes: int) -> list[ModeFit]:
    """Fits with a mode hidden beside one of the answer, as damped, where the fit has none."""
    fits, sizes = list[ModeFit](), np.abs(likeliest.roots)
    white = math.sqrt(likeliest.variance.sum())
    for k in likeliest.strongest(modes):
        usual = HIDDEN_SHARE * float(np.linalg.norm(likeliest.shapes[k])) / white
        for root in likeliest.roots[k] * np.array(HIDDEN):
            if root.imag < math.pi and np.all(np.abs(sizes / abs(root) - 1) > APART):
                noise = Noise(
                    len(signals),
                    likeliest.noise.colour,
                    np.array([root]),
                    usual,
                    likeliest.noise.trend_degree,
                )
                fits.append(fit_modes(signals, likeliest.roots, noise))
    return fits


def _likelihood(answer: ModeFit) -> float:
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


def _orders(signals: Array, plain: ModeFit) -> list[int]:
    """Orders p that the record supports; none if nothing is left."""
    return (
        [] if _exact(signals, plain) else [order for order in ORDERS if 20 * order <= len(signals)]
    )


def _exact(signals: Array, plain: ModeFit) -> bool:
    return bool(np.linalg.norm(plain.residual) < EXACT * np.linalg.norm(signals))


def _coloured(signals: Array, plain: ModeFit, order: int) -> ModeFit:
    """The fit under noise of an order, its filter found from what the fit before leaves.

    How a trend bends counts as noise there: a polynomial also takes what slow noise looks like.
    """
    fit, trend = plain, plain.noise.trend_degree
    for _ in range(FILTERS):
        left = detrended(fit.residual + fit.trend, min(trend, LINE))
        colour = autoregression(left, order)
        fit = fit_modes(signals, fit.roots, Noise(len(signals), colour, trend_degree=trend))
    return fit
