"""Natural frequency and damping fitted to a measured frequency response.

The record of an arm with almost no damping ends while it still rings, and its plain spectrum is smeared by that. For a
linear system the spectra of a record of length T obey, at the frequencies k/T and exactly,

    A(s) Y(s) = B(s) U(s) + E(s),   s = jω,

where the polynomial E holds the difference of the state at both ends of the record (Pintelon & Schoukens 2012).
A, B and E are fitted together by least squares within a band; A has one pair of roots per mode in the band, the degrees
that B and E have to spare stand for the modes outside. Then H = B/A, and the measured response, smeared no more, is
(Y − E/A)/U.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from armdesign.arrays import Array
from armdesign.errors import SimulationError

SPARE = 3  # degrees of B and E above those of a sum of modes: what modes outside the band and slow leaks add
ROUNDS = 12  # of reweighting by 1/A of the round before (Sanathanan & Koerner 1963)
LEAST_EQUATIONS = 2  # per unknown


@dataclass(frozen=True, eq=False)
class Fit:
    """Modes fitted to a frequency response; arrays are read-only.

    Attributes:
        natural_frequencies: (m,) ascending [Hz].
        damping_ratios: (m,).
        frequency_deviations: standard deviation of the frequencies by what the fit leaves over (m,) [Hz].
        damping_deviations: that of the damping ratios (m,).
        frequency: lines of the band (k,) [Hz].
        response: measured response there (k,), complex, freed of what rings at the record's ends.
        fitted: fitted response there (k,), complex.
        curve: the fitted response at many frequencies between, to draw: rows of frequency [Hz] and magnitude (2, 800).
        residual: root mean square of what the fit leaves of the output's spectrum, relative.
    """

    natural_frequencies: Array
    damping_ratios: Array
    frequency_deviations: Array
    damping_deviations: Array
    frequency: Array
    response: Array
    fitted: Array
    curve: Array
    residual: float

    def __post_init__(self) -> None:
        for value in vars(self).values():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)


def fit_modes(
    time: Array, excitation: Array, answer: Array, band: tuple[float, float], modes: int = 1, part: str = "response"
) -> Fit:
    """Fit ``modes`` natural frequencies and damping ratios to a record.

    Args:
        time: even instants (n,) [s].
        excitation: input (n,).
        answer: output (n,).
        band: lowest and highest frequency that counts [Hz].
        modes: how many modes the band holds.
        part: name of the record for messages.

    Raises:
        SimulationError: too few lines in the band, nothing in the answer, or no oscillation in it.
    """
    step = time[1] - time[0]
    all_lines = np.fft.rfftfreq(len(time), step)
    inside = (all_lines >= band[0]) & (all_lines <= band[1])
    u, y = (np.fft.rfft(signal)[inside] / len(time) for signal in (excitation, answer))
    frequency = all_lines[inside]
    least = record_length(band, modes)
    if len(frequency) < LEAST_EQUATIONS * _unknowns(modes) / 2:
        raise SimulationError(part, f"{len(time) * step:.3g} s are too short", f"record {least:.3g} s or more")
    if not (np.all(np.isfinite(u)) and np.all(np.isfinite(y)) and np.abs(u).max() > 0 and np.abs(y).max() > 0):
        raise SimulationError(part, "nothing moves", "raise the amplitude, or choose a cylinder that moves this mode")
    scale = np.abs(y).max() / np.abs(u).max()
    omega = 2 * math.pi * math.sqrt(band[0] * band[1])
    found = _solved(2j * math.pi * frequency / omega, u * scale, y, _degrees(modes), np.ones(len(frequency)))
    leftover = found.ends / found.denominator
    return _fit(found, frequency, (y - leftover) / u, omega, scale, modes, part)


def fit_response(
    frequency: Array, response: Array, modes: int = 1, deviations: Array | None = None, part: str = "response"
) -> Fit:
    """Fit ``modes`` natural frequencies and damping ratios to a frequency response that was measured line by line.

    Args:
        frequency: lines (k,) [Hz], not zero.
        response: answer over excitation (k,), complex.
        modes: how many modes lie between the lines.
        deviations: standard deviation of every line's response (k,), or what is in proportion; default: all the same.
        part: name of the record for messages.

    Raises:
        SimulationError: too few lines, or no oscillation in them.
    """
    degrees = (*_degrees(modes)[:2], 0)
    least = LEAST_EQUATIONS * sum(degrees) // 2
    if len(frequency) < least:
        raise SimulationError(part, f"{len(frequency)} lines are too few", f"measure {least} or more")
    scale = float(np.abs(response).max())
    weight = np.ones(len(frequency)) if deviations is None else np.median(deviations) / deviations
    omega = 2 * math.pi * math.sqrt(frequency.min() * frequency.max())
    ones = np.full(len(frequency), scale, dtype=complex)
    found = _solved(2j * math.pi * frequency / omega, ones, np.asarray(response, dtype=complex), degrees, weight)
    return _fit(found, frequency, np.asarray(response), omega, scale, modes, part)


def spectral_peak(time: Array, answer: Array, band: tuple[float, float], part: str = "response") -> float:
    """Frequency [Hz] of the highest line that the answer's plain spectrum has within a band.

    What is often read off a sweep as "the" resonance: as coarse as 1/T, and wherever the amplitude has pushed it. The
    spectrum itself is highest too low after a short sweep, see ``bias``; ``fit_modes`` has no such bias.

    Args:
        time: even instants (n,) [s].
        answer: output (n,).
        band: lowest and highest frequency that counts [Hz].
        part: name of the record for messages.

    Raises:
        SimulationError: no line in the band, or nothing in the answer.
    """
    lines = np.fft.rfftfreq(len(time), time[1] - time[0])
    inside = np.flatnonzero((lines >= band[0]) & (lines <= band[1]))
    if len(inside) == 0:
        problem = f"{time[-1] - time[0]:.3g} s have no line from {band[0]:.3g} to {band[1]:.3g} Hz"
        raise SimulationError(part, problem, f"record {1 / (band[1] - band[0]):.3g} s or more")
    heights = np.abs(np.fft.rfft(answer)[inside])
    if not heights.max() > 0:
        raise SimulationError(part, "nothing moves", "raise the amplitude")
    return float(lines[inside[np.argmax(heights)]])


def record_length(band: tuple[float, float], modes: int) -> float:
    """Shortest record [s] from which so many modes can be fitted in a band [Hz]."""
    return (LEAST_EQUATIONS * _unknowns(modes) / 2 + 1) / (band[1] - band[0])


def _degrees(modes: int) -> tuple[int, int, int]:
    """Numbers of coefficients: of A below its leading one, of B, of E."""
    return 2 * modes, 2 * modes - 1 + SPARE, 2 * modes + SPARE


def _fit(found: _Solution, frequency: Array, response: Array, omega: float, scale: float, modes: int, part: str) -> Fit:
    """The fit of a solution in s = jω/``omega`` and an input times ``scale``."""
    roots = np.roots([1.0, *found.a[::-1]])
    roots = roots[roots.imag > 0]
    if len(roots) < modes:
        raise SimulationError(part, "shows no oscillation in the band", "it is overdamped, or the amplitude too small")
    roots = roots[np.argsort(np.abs(roots))]
    size, zeta, size_deviation, zeta_deviation = _spread(roots, found.a, found.covariance)
    dense = np.linspace(frequency.min(), frequency.max(), 800)
    s_dense = 2j * math.pi * dense / omega
    magnitude = np.abs(_polynomial(s_dense, found.b) / _polynomial(s_dense, [*found.a, 1.0])) * scale
    return Fit(
        natural_frequencies=size * omega / (2 * math.pi),
        damping_ratios=zeta,
        frequency_deviations=size_deviation * omega / (2 * math.pi),
        damping_deviations=zeta_deviation,
        frequency=frequency.copy(),
        response=response.copy(),
        fitted=found.numerator / found.denominator * scale,
        curve=np.stack([dense, magnitude]),
        residual=found.residual,
    )


def _unknowns(modes: int) -> int:
    return sum(_degrees(modes))


@dataclass(frozen=True, eq=False)
class _Solution:
    """Coefficients of A (without its leading 1) and B, lowest first, covariance of A's, and A, B, E at the lines."""

    a: Array
    b: Array
    covariance: Array
    denominator: Array
    numerator: Array
    ends: Array
    residual: float


def _solved(s: Array, u: Array, y: Array, degrees: tuple[int, int, int], prior: Array) -> _Solution:
    """A y = B u + E at lines s, in the sense of least squares of (y − (B u + E)/A) × ``prior``."""
    na, nb, ne = degrees
    powers = s[:, None] ** np.arange(max(na, nb, ne) + 1)
    columns = np.hstack([y[:, None] * powers[:, :na], -u[:, None] * powers[:, :nb], -powers[:, :ne]])
    target = -y * powers[:, na]
    weight = prior
    for _ in range(ROUNDS):
        rows = _real(columns * weight[:, None])
        size = np.linalg.norm(rows, axis=0)
        basis, triangle = np.linalg.qr(rows / size)
        solution = np.linalg.solve(triangle, basis.T @ _real(target * weight)) / size
        weight = prior / np.abs(_polynomial(s, [*solution[:na], 1.0]))
    rest = _real(target * weight) - _real(columns * weight[:, None]) @ solution
    variance = float(rest @ rest) / (len(rest) - len(solution))
    inverse = np.linalg.inv(triangle) / size[:, None]
    a, b, e = np.split(solution, [na, na + nb])
    return _Solution(
        a=a,
        b=b,
        covariance=variance * (inverse @ inverse.T)[:na, :na],
        denominator=_polynomial(s, [*a, 1.0]),
        numerator=_polynomial(s, b),
        ends=_polynomial(s, e) if ne else np.zeros_like(s),
        residual=math.sqrt(float(rest @ rest) / float(np.sum(np.abs(prior * y) ** 2))),
    )


def _spread(roots: Array, a: Array, covariance: Array) -> tuple[Array, Array, Array, Array]:
    """|λ|, ζ and their standard deviations, from ∂λ/∂a_k = −λ^k / A'(λ)."""
    size = np.abs(roots)
    zeta = -roots.real / size
    slope = np.polyval(np.polyder([1.0, *a[::-1]]), roots)
    change = -(roots[:, None] ** np.arange(len(a))) / slope[:, None]
    d_size = (roots.conj()[:, None] * change).real / size[:, None]
    d_zeta = -(change.real + zeta[:, None] * d_size) / size[:, None]
    return size, zeta, _deviation(d_size, covariance), _deviation(d_zeta, covariance)


def _deviation(slopes: Array, covariance: Array) -> Array:
    return np.asarray(np.sqrt(np.einsum("mi,ij,mj->m", slopes, covariance, slopes)))


def _polynomial(s: Array, coefficients: Array | list[float]) -> Array:
    """Σ c_k s^k, lowest first."""
    return np.asarray(np.polynomial.polynomial.polyval(s, coefficients))


def _real(values: Array) -> Array:
    """Real above imaginary parts: a complex least-squares problem as a real one."""
    return np.concatenate([values.real, values.imag])
