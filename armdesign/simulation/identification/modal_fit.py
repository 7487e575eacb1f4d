"""Natural frequency and damping fitted to a measured frequency response, with the modes outside the band beside them.

The record of an arm with almost no damping ends while it still rings, and its plain spectrum is
smeared by that. For a linear system the spectra of a record of length T obey, at the frequencies
k/T and exactly,

    A(s) Y(s) = B(s) U(s) + E(s),   s = jω,

where the polynomial E holds the difference of the state at both ends of the record (Pintelon &
Schoukens 2012). A, B and E are fitted together by least squares within a band; that is where the
search starts. ``neighbours`` then fits the modes in the band as such, with neighbours and residual
terms for the modes outside, and tells how far the modes may be off: by noise, by what the residual
terms leave open, and by how far likely choices of them differ. The measured response, smeared no
more, is (Y − E/A)/U.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from armdesign.arrays import Array
from armdesign.errors import SimulationError
from armdesign.simulation.identification.residuals import Answer, Lines, answers, real

# degrees of B and E above those of a sum of modes: what modes outside the band and slow leaks add
SPARE = 3
ROUNDS = 12  # of reweighting by 1/A of the round before (Sanathanan & Koerner 1963)
LEAST_EQUATIONS = 2  # per unknown
STARTS = (0.03, 0.2)  # damping ratios from which the search starts as well
OVERDAMPED = 1.0


@dataclass(frozen=True, eq=False)
class Fit:
    """Modes fitted to a frequency response; arrays are read-only.

    Attributes:
        natural_frequencies: (m,) ascending [Hz].
        damping_ratios: (m,).
        frequency_deviations: standard deviation of the frequencies (m,) [Hz], by noise and by what
            the modes outside the band leave open. What a nonlinear plant makes wrong is not in it.
        damping_deviations: standard deviation of the damping ratios (m,).
        frequency_remainders: share of the modes outside the band in the frequencies' deviation
            (m,) [Hz]: what is left of them when neighbours and residual terms are fitted. Squared,
            it adds to the share of noise.
        damping_remainders: the same share for the damping ratios (m,).
        frequency: lines of the band (k,) [Hz].
        response: measured response there (k,), complex, freed of what rings at the record's ends.
        fitted: fitted response there (k,), complex.
        curve: the fitted response at many frequencies between, to draw: rows of frequency [Hz] and
            magnitude (2, 800).
        residual: root mean square of what the fit leaves of the output's spectrum, relative.
    """

    natural_frequencies: Array
    damping_ratios: Array
    frequency_deviations: Array
    damping_deviations: Array
    frequency_remainders: Array
    damping_remainders: Array
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
    time: Array,
    excitation: Array,
    answer: Array,
    band: tuple[float, float],
    modes: int = 1,
    part: str = "response",
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
        raise SimulationError(
            part, f"{len(time) * step:.3g} s are too short", f"record {least:.3g} s or more"
        )
    if not (
        np.all(np.isfinite(u))
        and np.all(np.isfinite(y))
        and np.abs(u).max() > 0
        and np.abs(y).max() > 0
    ):
        raise SimulationError(
            part, "nothing moves", "raise the amplitude, or choose a cylinder that moves this mode"
        )
    return _fit(frequency, u, y, np.ones(len(frequency)), _degrees(modes), part)


def fit_response(
    frequency: Array,
    response: Array,
    modes: int = 1,
    deviations: Array | None = None,
    part: str = "response",
) -> Fit:
    """Fit ``modes`` natural frequencies and damping ratios to a frequency response that was measured line by line.

    Args:
        frequency: lines (k,) [Hz], not zero.
        response: answer over excitation (k,), complex.
        modes: how many modes lie between the lines.
        deviations: standard deviation of every line's response (k,), or what is in proportion;
            default: all the same.
        part: name of the record for messages.

    Raises:
        SimulationError: too few lines, or no oscillation in them.
    """
    degrees = (*_degrees(modes)[:2], 0)
    least = LEAST_EQUATIONS * sum(degrees) // 2
    if len(frequency) < least:
        raise SimulationError(
            part, f"{len(frequency)} lines are too few", f"measure {least} or more"
        )
    weight = np.ones(len(frequency)) if deviations is None else np.median(deviations) / deviations
    order = np.argsort(frequency)
    lines, measured = (
        np.asarray(frequency, dtype=float)[order],
        np.asarray(response, dtype=complex)[order],
    )
    return _fit(lines, np.ones(len(lines), dtype=complex), measured, weight[order], degrees, part)


def spectral_peak(
    time: Array, answer: Array, band: tuple[float, float], part: str = "response"
) -> float:
    """Frequency [Hz] of the highest line that the answer's plain spectrum has within a band.

    What is often read off a sweep as "the" resonance: as coarse as 1/T, and wherever the amplitude
    has pushed it. The spectrum itself is highest too low after a short sweep, see ``bias``;
    ``fit_modes`` has no such bias.

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


def _fit(
    frequency: Array, u: Array, y: Array, weight: Array, degrees: tuple[int, int, int], part: str
) -> Fit:
    """The fit of output to input spectra at lines [Hz] of some weight.

    E has no degrees where no ends are in it.
    """
    middle, modes = math.sqrt(frequency[0] * frequency[-1]), degrees[0] // 2
    inputs, outputs = (math.sqrt(np.mean(np.abs(values * weight) ** 2)) for values in (u, y))
    s = 1j * frequency / middle
    lines = Lines(s, u / inputs, weight * y / outputs, weight, ends=degrees[2] > 0)
    found, weights = answers(lines, _starts(lines, degrees))
    poles = np.array([one.poles[:modes] for one in found])
    mean = np.einsum("i,ijk->jk", weights, poles)
    if np.any(mean[:, 1] >= OVERDAMPED):
        raise SimulationError(
            part,
            "shows no oscillation in the band",
            "it is overdamped, or the amplitude too small",
        )
    deviations, remainders = _deviations(found, weights, poles - mean)
    likeliest = found[int(np.argmax(weights))]
    fitted, ends = likeliest.spectra(lines, s)
    dense = np.linspace(frequency[0], frequency[-1], 800)
    scale = outputs / inputs
    magnitude = np.abs(likeliest.spectra(lines, 1j * dense / middle)[0]) * scale
    left = lines.y - weight * (fitted * lines.u + ends)
    return Fit(
        natural_frequencies=mean[:, 0] * middle,
        damping_ratios=mean[:, 1].copy(),
        frequency_deviations=deviations[:, 0] * middle,
        damping_deviations=deviations[:, 1].copy(),
        frequency_remainders=remainders[:, 0] * middle,
        damping_remainders=remainders[:, 1].copy(),
        frequency=frequency.copy(),
        response=(y - ends * outputs) / u,
        fitted=fitted * scale,
        curve=np.stack([dense, magnitude]),
        residual=float(np.linalg.norm(left) / np.linalg.norm(lines.y)),
    )


def _deviations(found: list[Answer], weights: Array, apart: Array) -> tuple[Array, Array]:
    """Standard deviations of ω and ζ (m, 2): all, and what is not noise.

    ``apart`` is each answer less the mean.
    """
    within = np.array([np.diag(one.covariance).reshape(-1, 2) for one in found])
    noise = np.array([np.diag(one.noise).reshape(-1, 2) for one in found])
    variance, of_noise = (
        np.einsum("i,ijk->jk", weights, each) for each in (within + apart**2, noise)
    )
    return np.sqrt(variance), np.sqrt(np.maximum(variance - of_noise, 0))


def _unknowns(modes: int) -> int:
    return sum(_degrees(modes))


def _starts(lines: Lines, degrees: tuple[int, int, int]) -> Array:
    """ω and ζ from which the search starts (·, modes, 2): those of the plain fit, and some spread over the band."""
    modes, (low, high) = degrees[0] // 2, lines.edges
    roots = np.roots([1.0, *_denominator(lines, degrees)[::-1]])
    roots = roots[roots.imag > 0][:modes]
    starts = [[[w, z] for w in np.geomspace(low, high, 2 * modes + 1)[1::2]] for z in STARTS]
    if modes == 1:
        starts = [[[w, z]] for w in np.geomspace(low, high, 7)[1:-1] for z in STARTS]
    if len(roots) == modes:
        size = np.abs(roots)
        plain = np.stack(
            [np.clip(size, low, high), np.clip(-roots.real / size, 1e-3, 0.7)], axis=1
        )
        starts.append(plain.tolist())
    return np.array(starts)


def _denominator(lines: Lines, degrees: tuple[int, int, int]) -> Array:
    """A without its leading 1, lowest first, of A y = B u + E in the sense of least squares of y − (B u + E)/A."""
    na, nb, ne = degrees
    s, weight = lines.s, np.ones(len(lines.s))
    powers = s[:, None] ** np.arange(max(na, nb, ne) + 1)
    inputs = -(lines.weight * lines.u)[:, None] * powers[:, :nb]
    columns = np.hstack(
        [lines.y[:, None] * powers[:, :na], inputs, -lines.weight[:, None] * powers[:, :ne]]
    )
    target = -lines.y * powers[:, na]
    for _ in range(ROUNDS):
        rows = real(columns * weight[:, None])
        size = np.linalg.norm(rows, axis=0)
        solution = np.linalg.lstsq(rows / size, real(target * weight), rcond=None)[0] / size
        weight = 1 / np.abs(np.polynomial.polynomial.polyval(s, [*solution[:na], 1.0]))
    return np.asarray(solution[:na])
