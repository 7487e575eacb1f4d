"""The fit recovers what is known: synthetic records of sums of modes, by an exact simulation of
their state space.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.signal import StateSpace, chirp, lsim

from armdesign import identify_forced_response, identify_frequency_response
from armdesign.errors import SimulationError
from armdesign.simulation.excitation import SweptSine
from armdesign.simulation.identification.modal_fit import record_length, response_by_modes
from tests.simulation.oscillator import answer_of, exact

BAND = (0.5, 1.6)


def record(
    modes: list[tuple[float, float, float]], cycles: float, noise: float = 0.0
) -> tuple[np.ndarray, ...]:
    """Time, input and answer of Σ g ω²/(s² + 2ζωs + ω²) over (frequency, ζ, g) to a sweep over the
    band.
    """
    time = np.arange(0, cycles, 1 / 200)
    sweep = SweptSine(amplitude=1.0, start=BAND[0], stop=BAND[1], duration=cycles)
    excitation = np.array([sweep(t) for t in time])
    answer = np.zeros_like(time)
    for frequency, zeta, gain in modes:
        omega = 2 * math.pi * frequency
        system = StateSpace(
            [[0, 1], [-(omega**2), -2 * zeta * omega]], [[0], [omega**2]], [[gain, 0]], [[0]]
        )
        answer += lsim(system, excitation, time)[1]
    answer += noise * answer.std() * np.random.default_rng(0).normal(size=len(time))
    return time, excitation, answer


@pytest.mark.parametrize(
    ("zeta", "tolerance"), [(0.0, 5e-4), (0.002, 5e-4), (0.03, 5e-4), (0.2, 1e-2)]
)
@pytest.mark.parametrize("frequency", [0.97, 1.0, 1.13])
def test_one_mode_among_others(frequency: float, zeta: float, tolerance: float) -> None:
    """A record of 16 cycles of an arm that still rings, two more modes above the band.

    With 20 % of damping in all of them their peaks run into each other, and the fit is worth less.
    """
    time, u, y = record([(frequency, zeta, 0.8), (2.4, zeta, 0.15), (8.0, zeta, 0.05)], 16)
    fit = identify_forced_response(time, u, y, BAND)
    assert fit.natural_frequencies == pytest.approx([frequency], rel=tolerance)
    assert fit.damping_ratios == pytest.approx([zeta], abs=tolerance)


def test_response_of_a_shorter_record_by_the_modes_of_the_whole() -> None:
    """Cut to whole periods of its mode it has a line on the resonance. By hand the response is
    Σ g ω²/(ω² − w² + 2jζωw).
    """
    modes = [(0.97, 0.01, 0.8), (2.4, 0.01, 0.15)]
    whole = record(modes, 16)
    fit = identify_forced_response(*whole, BAND)
    count = round(15 / 0.97 * 200)
    lines, response = response_by_modes(fit, *(signal[:count] for signal in whole), BAND)
    expected = sum(g * f**2 / (f**2 - lines**2 + 2j * zeta * f * lines) for f, zeta, g in modes)
    near = np.abs(lines / 0.97 - 1) < 0.1
    assert np.abs(lines / 0.97 - 1).min() < 1e-3
    np.testing.assert_allclose(response[near], expected[near], rtol=0.01)


def test_two_modes_in_the_band() -> None:
    time, u, y = record([(0.9, 0.01, 0.6), (1.2, 0.02, 0.4), (3.0, 0.0, 0.1)], 24)
    fit = identify_forced_response(time, u, y, BAND, modes=2)
    assert fit.natural_frequencies == pytest.approx([0.9, 1.2], rel=1e-3)
    assert fit.damping_ratios == pytest.approx([0.01, 0.02], abs=1e-3)


@pytest.mark.parametrize("seed", [4, 9, 13, 17])
def test_a_mode_asked_for_that_the_band_does_not_show_hides_no_other(seed: int) -> None:
    """Another mode lies above the band. The second of the fit has more than critical damping, for
    which the first was refused too.
    """
    random, time = np.random.default_rng(seed), np.arange(0, 10, 0.01)
    frequency, zeta, far = (
        random.uniform(1.5, 2.5),
        random.uniform(0.01, 0.05),
        random.uniform(4, 12),
    )
    u = chirp(time, f0=1, t1=10, f1=3)
    y = answer_of(frequency, zeta, time, u) + 0.3 * answer_of(far, 0.05, time, u)
    y += 1e-3 * y.std() * random.standard_normal(len(y))
    fit = identify_forced_response(time, u, y, (1.0, 3.0), modes=2)
    nearest = np.abs(fit.natural_frequencies - frequency).argmin()
    assert fit.natural_frequencies[nearest] == pytest.approx(frequency, rel=1e-4)
    assert fit.damping_ratios[nearest] == pytest.approx(zeta, abs=1e-4)


def test_the_raw_peak_would_be_wrong_where_the_fit_is_right() -> None:
    """The highest line of the plain spectrum is a whole line (1/T) or so off; the measured
    response fits its model.
    """
    time, u, y = record([(1.03, 0.001, 1.0)], 16)
    fit = identify_forced_response(time, u, y, BAND)
    spectrum = np.abs(np.fft.rfft(y))
    peak = np.fft.rfftfreq(len(time), time[1])[np.argmax(spectrum)]
    assert abs(peak / 1.03 - 1) > 0.01
    np.testing.assert_allclose(fit.response, fit.fitted, atol=1e-3 * np.abs(fit.fitted).max())
    exact = 1.03**2 / (1.03**2 - fit.frequency**2 + 2j * 0.001 * 1.03 * fit.frequency)
    np.testing.assert_allclose(fit.fitted, exact, rtol=0.02)


def test_uncertainty_covers_noise() -> None:
    """With 1 % of noise the error is within four standard deviations, and these are small."""
    time, u, y = record([(1.0, 0.01, 1.0), (2.4, 0.0, 0.1)], 16, noise=0.01)
    fit = identify_forced_response(time, u, y, BAND)
    assert abs(fit.natural_frequencies[0] - 1.0) < 4 * fit.frequency_deviations[0] < 0.02
    assert abs(fit.damping_ratios[0] - 0.01) < 4 * fit.damping_deviations[0] < 0.02


@pytest.mark.parametrize("seed", range(3))
def test_an_input_known_exactly_leaves_less_open(seed: int) -> None:
    """White noise drives two modes. What it holds above the band is no noise of its record: told
    so, the fit is as near and surer.
    """
    time = np.arange(0, 16, 1 / 40)
    u = np.random.default_rng(seed).normal(size=len(time))
    y = answer_of(1.0, 0.01, time, u) + answer_of(2.4, 0.01, time, u)
    measured, known = (
        identify_forced_response(time, u, y, BAND, noisy_input=noisy) for noisy in (True, False)
    )
    assert known.frequency_deviations[0] < measured.frequency_deviations[0]
    assert known.damping_deviations[0] < measured.damping_deviations[0]
    assert known.natural_frequencies == pytest.approx([1.0], rel=1e-6)
    assert known.damping_ratios == pytest.approx([0.01], abs=1e-6)


def test_faults() -> None:
    time, u, y = record([(1.0, 0.01, 1.0)], 16)
    with pytest.raises(SimulationError, match="nothing moves"):
        identify_forced_response(time, u, 0 * y, BAND)
    with pytest.raises(SimulationError, match=r"too short; record"):
        identify_forced_response(time[:800], u[:800], y[:800], BAND)
    assert record_length(BAND, 1) < 16
    with pytest.raises(SimulationError, match="no oscillation"):
        identify_forced_response(*record([(1.0, 8.0, 1.0)], 16), BAND, modes=2)


@pytest.mark.slow
@pytest.mark.parametrize("way", ["record", "response"])
def test_one_sigma_holds_68_percent(way: str) -> None:
    """Monte Carlo, 100 noisy records: within ± one deviation lies the normal law's share, ± 3
    binomial deviations.
    """
    random, count = np.random.default_rng(3), 100
    time = np.arange(0, 24, 1 / 40)
    sweep = SweptSine(amplitude=1.0, start=BAND[0], stop=BAND[1], duration=24)
    u = np.array([sweep(t) for t in time])
    clean = answer_of(1.0, 0.02, time, u)
    lines = np.linspace(0.6, 1.5, 31)
    inside = np.zeros(2)
    for _ in range(count):
        if way == "record":
            fit = identify_forced_response(
                time, u, clean + 0.01 * random.normal(size=len(time)), BAND
            )
        else:
            noise = 0.05 * (random.normal(size=31) + 1j * random.normal(size=31))
            fit = identify_frequency_response(lines, exact(1.0, 0.02, lines) + noise)
        inside[0] += abs(fit.natural_frequencies[0] - 1.0) < fit.frequency_deviations[0]
        inside[1] += abs(fit.damping_ratios[0] - 0.02) < fit.damping_deviations[0]
    bound = 3 * math.sqrt(0.683 * 0.317 / count)
    assert inside / count == pytest.approx([0.683, 0.683], abs=bound)
