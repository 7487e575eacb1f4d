"""Natural frequencies and damping ratios fitted to a forced response within a band.

The record of an arm with almost no damping ends while it still rings, and its plain spectrum is
smeared by that. For a linear system the spectra of a record of length T obey, at the frequencies
k/T and exactly,

    A(s) Y(s) = B(s) U(s) + E(s),   s = jω,

where the polynomial E holds the difference of the state at both ends of the record (Pintelon &
Schoukens 2012). A, B and E are fitted together by least squares within a band; that is where the
search starts. ``residual_terms`` then fits the modes in the band as such, with neighbours and
residual terms for the modes outside, and states how far the modes may be off: by noise, by what
the residual terms leave open, and by how far likely choices of them differ. The measured
response, free of that smear, is (Y − E/A)/U.

Noise of the input reaches the output through the response H: the lines then scatter by σ² + |H|²
times the input's own variance, which is largest at resonance, where few lines tell. What the input
holds above the band measures that variance; fits with and without it are averaged. An input that
is known exactly has none.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from armdesign.arguments import checked
from armdesign.arrays import Array, ReadOnly
from armdesign.errors import SimulationError
from armdesign.short_repr import short_repr
from armdesign.simulation.identification.averaging import averaged
from armdesign.simulation.identification.records import signals_of
from armdesign.simulation.identification.residual_terms import (
    Answer,
    Lines,
    answers,
    evidence,
    real,
    weights_of,
    with_known_modes,
)

if TYPE_CHECKING:
    from armdesign.plots.canvas import Figure

# degrees of B and E beyond a sum of modes: what modes outside the band and slow leaks add
SPARE = 3
ROUNDS = 12  # of reweighting by 1/A of the round before (Sanathanan & Koerner 1963)
LEAST_EQUATIONS = 2  # per unknown
STARTS = (0.03, 0.2)  # damping ratios from which the search starts as well
OVERDAMPED = 1.0
ABOVE = 1.5  # of the band's upper end: where an input holds noise alone
NOISE_ROUNDS, NEGLIGIBLE_NOISE = 2, 0.05


@dataclass(frozen=True, eq=False)
class ModalFit(ReadOnly):
    """Modes fitted to a frequency response; arrays are read-only.

    Attributes:
        natural_frequencies: (m,) ascending [Hz].
        damping_ratios: (m,).
        frequency_deviations: standard deviations of the frequencies (m,) [Hz], by noise and by
            what the modes outside the band leave open. Errors by nonlinearity are not in them.
        damping_deviations: standard deviations of the damping ratios (m,).
        frequency_remainders: part of the frequencies' deviations due to modes outside the band
            (m,) [Hz]: what neighbours and residual terms leave of them. Its square adds to the
            variance by noise.
        damping_remainders: part of the damping ratios' deviations due to them (m,).
        frequency: lines of the band (k,) [Hz].
        response: measured response there (k,), complex, freed of what rings at the record's ends.
        fitted: fitted response there (k,), complex.
        curve: the fitted response at many frequencies between, to draw: rows of frequency [Hz] and
            magnitude (2, 800).
        residual: root mean square of what the fit leaves of the output's spectrum, relative.
    """

    __repr__ = short_repr

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

    def plot(self) -> Figure:
        """Measured and fitted magnitude over frequency; returns the figure."""
        from armdesign import plots

        return plots.modal_fit(self)


@checked
def identify_forced_response(
    time: ArrayLike,
    excitation: ArrayLike,
    response: ArrayLike,
    band: tuple[float, float],
    modes: int = 1,
    part: str = "response",
    *,
    noisy_input: bool = True,
) -> ModalFit:
    """Natural frequencies and damping ratios of the modes that a forced response shows in a band.

    The record may be short and may end while the modes still ring: see the module. A swept sine
    over the band is a good excitation; a constant offset of either signal does no harm.

    Args:
        time: evenly spaced instants (n,) [s].
        excitation: input (n,), as the speed asked of a piston.
        response: output (n,), as the speed of the piston.
        band: lowest and highest frequency that counts [Hz].
        modes: how many modes the band holds.
        part: name of the record for messages.
        noisy_input: the input was measured, with noise. Without, as in a simulation, what it holds
            above the band is part of it.

    Raises:
        SimulationError: the record is too short or has no even instants, nothing moves, or the
            band shows no oscillation.

    Example:
        An oscillator of 2 Hz under a sweep from 1 to 3 Hz in 10 s:

        >>> import numpy as np, armdesign as ad
        >>> from scipy.signal import chirp, lsim
        >>> time = np.arange(0, 10, 0.01)
        >>> force = chirp(time, f0=1, t1=10, f1=3)
        >>> omega, zeta = 2 * np.pi * 2.0, 0.05
        >>> speed = lsim(([1, 0], [1, 2 * zeta * omega, omega**2]), force, time)[1]
        >>> fit = ad.identify_forced_response(time, force, speed, (1.0, 3.0))
        >>> print(fit.natural_frequencies.round(3), fit.damping_ratios.round(3))
        [2.] [0.05]
    """
    record = signals_of(part, time, excitation, response)
    frequency, u, y = _spectra_within(band, record, modes, part)
    noise = _variance_above(record[1][0], record[0], ABOVE * band[1]) if noisy_input else 0.0
    return _fit(frequency, u, y, np.ones(len(frequency)), _degrees(modes), part, noise)


def response_by_modes(
    fit: ModalFit, time: Array, excitation: Array, response: Array, band: tuple[float, float]
) -> tuple[Array, Array]:
    """Response at the lines of another record of a motion, freed of its ends by known modes.

    Args:
        fit: modes of the motion.
        time: evenly spaced instants (n,) [s].
        excitation: input (n,).
        response: output (n,).
        band: lowest and highest frequency that counts [Hz].

    Returns:
        Lines (k,) [Hz], and the response there (k,), complex.

    Raises:
        SimulationError: the record is too short, or nothing moves.
    """
    modes, part = len(fit.natural_frequencies), "response"
    frequency, u, y = _spectra_within(
        band, signals_of(part, time, excitation, response), modes, part
    )
    scaled = _Scaled.of(frequency, u, y, np.ones(len(frequency)), ends=True)
    poles = np.stack([fit.natural_frequencies / scaled.middle, fit.damping_ratios], axis=1)
    ends = with_known_modes(scaled.lines, poles).spectra(scaled.lines, scaled.lines.s)[1]
    return frequency, (y - ends * scaled.outputs) / u


def _spectra_within(
    band: tuple[float, float], record: tuple[float, list[Array]], modes: int, part: str
) -> tuple[Array, Array, Array]:
    """Lines [Hz] of a record within a band (k,), and its input's and output's spectra there.

    Raises:
        SimulationError: the record is too short for so many modes, or nothing moves.
    """
    step, (u, y) = record
    all_lines = np.fft.rfftfreq(len(y), step)
    inside = (all_lines >= band[0]) & (all_lines <= band[1])
    u, y = (np.fft.rfft(signal)[inside] / len(y) for signal in (u, y))
    frequency = all_lines[inside]
    if len(frequency) < LEAST_EQUATIONS * _unknowns(modes) / 2:
        fault = f"{len(record[1][1]) * step:.3g} s are too short"
        raise SimulationError(part, fault, f"record {record_length(band, modes):.3g} s or more")
    if not (np.abs(u).max() > 0 and np.abs(y).max() > 0):
        raise SimulationError(
            part, "nothing moves", "raise the amplitude, or choose a cylinder that moves this mode"
        )
    return frequency, u, y


@checked
def identify_frequency_response(
    frequency: ArrayLike,
    response: ArrayLike,
    modes: int = 1,
    deviations: ArrayLike | None = None,
    part: str = "response",
) -> ModalFit:
    """Natural frequencies and damping ratios fitted to a response measured line by line.

    Args:
        frequency: lines (k,) [Hz], not zero.
        response: output over input (k,), complex.
        modes: how many modes lie between the lines.
        deviations: standard deviation of the response at every line (k,), or what is in proportion
            to it; default: the same at all lines.
        part: name of the response for messages.

    Raises:
        SimulationError: lines and responses do not fit together or are too few, or show no
            oscillation.

    Example:
        >>> import numpy as np, armdesign as ad
        >>> lines = np.linspace(0.6, 1.6, 40)
        >>> response = 1 / (1 - lines**2 + 2j * 0.05 * lines)
        >>> fit = ad.identify_frequency_response(lines, response)
        >>> print(fit.natural_frequencies.round(3), fit.damping_ratios.round(3))
        [1.] [0.05]
    """
    try:
        lines, measured = np.asarray(frequency, dtype=float), np.asarray(response, dtype=complex)
        given = np.ones(lines.shape) if deviations is None else deviations
        sigma = np.asarray(given, dtype=float)
    except (TypeError, ValueError):
        raise SimulationError(part, "holds what is no number", "leave such values out") from None
    if not (lines.ndim == 1 and lines.shape == measured.shape == sigma.shape):
        fault = f"shapes {lines.shape}, {measured.shape} and {sigma.shape} differ"
        raise SimulationError(part, fault, "give one response and deviation per line")
    if not (np.all(np.isfinite(measured)) and np.all(lines > 0) and np.all(sigma > 0)):
        raise SimulationError(part, "holds lines without a response", "leave them out")
    degrees = (*_degrees(modes)[:2], 0)
    least = LEAST_EQUATIONS * sum(degrees) // 2
    if len(lines) < least:
        raise SimulationError(part, f"{len(lines)} lines are too few", f"measure {least} or more")
    order = np.argsort(lines)
    weight, one = (np.median(sigma) / sigma)[order], np.ones(len(lines), dtype=complex)
    return _fit(lines[order], one, measured[order], weight, degrees, part)


def spectral_peak(
    time: Array, response: Array, band: tuple[float, float], part: str = "response"
) -> float:
    """Frequency [Hz] of the highest line in the plain spectrum of a response within a band.

    What is often read off a sweep as "the" resonance: as coarse as 1/T, and wherever the amplitude
    has pushed it. The spectrum itself is highest too low after a short sweep, see ``sweep_bias``;
    ``identify_forced_response`` has no such bias.

    Args:
        time: evenly spaced instants (n,) [s].
        response: output (n,).
        band: lowest and highest frequency that counts [Hz].
        part: name of the record for messages.

    Raises:
        SimulationError: no line in the band, or nothing moves.
    """
    lines = np.fft.rfftfreq(len(time), time[1] - time[0])
    inside = np.flatnonzero((lines >= band[0]) & (lines <= band[1]))
    if len(inside) == 0:
        fault = f"{time[-1] - time[0]:.3g} s have no line from {band[0]:.3g} to {band[1]:.3g} Hz"
        raise SimulationError(part, fault, f"record {1 / (band[1] - band[0]):.3g} s or more")
    heights = np.abs(np.fft.rfft(response)[inside])
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
    frequency: Array,
    u: Array,
    y: Array,
    weight: Array,
    degrees: tuple[int, int, int],
    part: str,
    input_noise: float = 0.0,
) -> ModalFit:
    """The fit of output to input spectra at lines [Hz] of some weight.

    Args:
        frequency: lines (k,) [Hz], ascending.
        u: input (k,).
        y: output (k,).
        weight: of every line (k,).
        degrees: of A, B and E; 0 of E where the spectra hold no ends of a record.
        part: name of the response for messages.
        input_noise: variance of the input's lines by noise.
    """
    scaled = _Scaled.of(frequency, u, y, weight, ends=degrees[2] > 0)
    lines, middle, inputs, outputs = scaled.lines, scaled.middle, scaled.inputs, scaled.outputs
    fits = answers(lines, _starts(lines, degrees))
    if input_noise > 0:
        fits += _with_input_noise(lines, fits, input_noise / inputs**2)
    weights = weights_of(fits)
    mean, deviations, remainders = averaged(fits, weights)
    if not np.any((mean[:, 1] < OVERDAMPED) & (deviations[:, 0] < mean[:, 0])):
        remedy = "it is overdamped, or the amplitude too small"
        raise SimulationError(part, "shows no oscillation in the band", remedy)
    likeliest = fits[int(np.argmax(weights))]
    fitted, ends = likeliest.spectra(lines, lines.s)
    dense = np.linspace(frequency[0], frequency[-1], 800)
    scale = outputs / inputs
    magnitude = np.abs(likeliest.spectra(lines, 1j * dense / middle)[0]) * scale
    left = lines.y - weight * (fitted * lines.u + ends)
    return ModalFit(
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


@dataclass(frozen=True, eq=False)
class _Scaled:
    """Spectra of about size one, and by what they are scaled.

    Attributes:
        lines: the spectra.
        middle: middle of the band [Hz].
        inputs: root mean square of the input.
        outputs: root mean square of the output.
    """

    lines: Lines
    middle: float
    inputs: float
    outputs: float

    @classmethod
    def of(cls, frequency: Array, u: Array, y: Array, weight: Array, ends: bool) -> _Scaled:
        """Of spectra at lines [Hz] of some weight; whether they hold the ends of a record."""
        middle = math.sqrt(frequency[0] * frequency[-1])
        inputs, outputs = (math.sqrt(np.mean(np.abs(values * weight) ** 2)) for values in (u, y))
        s = 1j * frequency / middle
        lines = Lines(s, u / inputs, weight * y / outputs, weight, ends)
        return cls(lines, middle, inputs, outputs)


def _variance_above(signal: Array, step: float, frequency: float) -> float:
    """Variance of a signal's spectral lines, by the median of those above a frequency [Hz].

    Hann's window keeps out what leaks there from the excitation.
    """
    above = np.fft.rfftfreq(len(signal), step) > frequency
    window = np.hanning(len(signal))
    power = np.abs(np.fft.rfft((signal - signal.mean()) * window)[above]) ** 2
    if len(power) == 0:
        return 0.0
    # the median of a line's power is ln 2 of its mean, the exponential law
    return float(np.median(power) / math.log(2) / np.sum(window**2) / len(signal))


def _with_input_noise(lines: Lines, fits: list[Answer], variance: float) -> list[Answer]:
    """Answers with lines weighted by σ² + |H|² times the input's variance, unless it is small."""
    more, starts = list[Answer](), np.array([max(fits, key=evidence).poles[: fits[0].modes]])
    for _ in range(NOISE_ROUNDS):
        response, ends = max(more or fits, key=evidence).spectra(lines, lines.s)
        left = np.abs(lines.y / lines.weight - response * lines.u - ends) ** 2
        by_input = variance * np.abs(response) ** 2
        if np.max(by_input) < NEGLIGIBLE_NOISE * np.mean(left):
            return []
        sizes = np.mean(left) * np.logspace(-4, 1, 21)  # of σ²
        scatter = by_input + sizes[:, None]
        best = scatter[np.argmin(np.sum(np.log(scatter) + left / scatter, axis=1))]
        weight = np.sqrt(np.median(best) / best)
        weighted = Lines(lines.s, lines.u, weight * lines.y / lines.weight, weight, lines.ends)
        more = answers(weighted, starts)
    return more


def _unknowns(modes: int) -> int:
    return sum(_degrees(modes))


def _starts(lines: Lines, degrees: tuple[int, int, int]) -> Array:
    """ω and ζ from which the search starts (·, modes, 2): spread over the band, and A's roots."""
    modes, (low, high) = degrees[0] // 2, lines.edges
    roots = np.roots([1.0, *_denominator(lines, degrees)[::-1]])
    roots = roots[roots.imag > 0][:modes]
    starts = [[[w, z] for w in np.geomspace(low, high, 2 * modes + 1)[1::2]] for z in STARTS]
    if modes == 1:
        starts = [[[w, z]] for w in np.geomspace(low, high, 7)[1:-1] for z in STARTS]
    if len(roots) == modes:
        size = np.abs(roots)
        plain = np.clip(size, low, high), np.clip(-roots.real / size, 1e-3, 0.7)
        starts.append(np.transpose(plain).tolist())
    return np.array(starts)


def _denominator(lines: Lines, degrees: tuple[int, int, int]) -> Array:
    """Coefficients of A below its leading 1, lowest first, by least squares of y − (B u + E)/A."""
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
