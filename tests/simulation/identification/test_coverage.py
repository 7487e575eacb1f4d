"""The stated deviation holds: Monte Carlo over noisy records of linear systems whose modes are
known.

Three deviations are to hold the truth in 90 % of runs or more, under 1, 5 and 10 % of noise, and
must not be had by being too large: the root mean square of the error is of the size of one.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.signal import StateSpace, lfilter, lsim

from armdesign import identify_forced_response, identify_frequency_response, identify_ringdown
from armdesign.errors import SimulationError
from armdesign.simulation.excitation import SweptSine

BAND = (0.5, 1.6)
RUNS = 30


def swept(
    modes: list[tuple[float, float, float]],
    drift: float = 0.0,
    band: tuple[float, float] = BAND,
    duration: float = 16.0,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, input and speed Σ g ω s/(s² + 2ζωs + ω²) + drift/s after a sweep, exact for a linear
    input.
    """
    time = np.arange(0, duration, 1 / 40)
    sweep = SweptSine(amplitude=1.0, start=band[0], stop=band[1], duration=duration)
    u = np.array([sweep(t) for t in time])
    y = drift * lsim(StateSpace([[0.0]], [[1.0]], [[1.0]], [[0.0]]), u, time)[1]
    for frequency, zeta, gain in modes:
        omega = 2 * math.pi * frequency
        a, b = [[0, 1], [-(omega**2), -2 * zeta * omega]], [[0], [omega]]
        y = y + gain * lsim(StateSpace(a, b, [[0, 1]], [[0]]), u, time)[1]
    return time, u, y


def rang(time: np.ndarray, modes: list[tuple[float, float, float]]) -> np.ndarray:
    """Σ g exp(−ζωt) cos(ω√(1 − ζ²) t + 0.3)."""
    total = np.zeros_like(time)
    for frequency, zeta, gain in modes:
        omega = 2 * math.pi * frequency
        total += (
            gain
            * np.exp(-zeta * omega * time)
            * np.cos(omega * math.sqrt(1 - zeta**2) * time + 0.3)
        )
    return total


def check(errors: list[np.ndarray], deviations: list[np.ndarray]) -> None:
    """Shares within three deviations, and the error relative to one."""
    off, sigma = np.array(errors), np.array(deviations)
    assert np.mean(np.abs(off) <= 3 * sigma, axis=0) == pytest.approx(0.95, abs=0.05001)
    relative = np.sqrt(np.mean(off**2, axis=0)) / np.median(sigma, axis=0)
    assert np.all((relative > 0.4) & (relative < 1.9))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("zeta", "neighbours", "drift", "noise"),
    [
        (0.3, [(2.0, 0.3, 0.8)], 0.0, 0.01),
        (0.3, [(2.0, 0.01, 0.8)], 0.0, 0.05),
        (0.3, [(0.3, 0.3, 0.8)], 0.0, 0.1),
        (0.1, [(1.7, 0.3, 0.8)], 0.0, 0.05),
        (0.1, [(2.4, 0.1, 0.5)], 3.0, 0.1),
        (0.01, [(1.7, 0.3, 0.8)], 0.0, 0.1),
    ],
)
def test_sweeps_with_a_mode_outside_the_band(
    zeta: float, neighbours: list[tuple[float, float, float]], drift: float, noise: float
) -> None:
    """Above the band, below it, sharp, damped, and a load that drifts; before, ζ was held in 0 to
    52 % of runs.
    """
    random = np.random.default_rng(1)
    time, u, clean = swept([(1.0, zeta, 1.0), *neighbours], drift)
    errors, deviations = [], []
    for _ in range(RUNS):
        y = clean + noise * np.sqrt(np.mean(clean**2)) * random.normal(size=len(clean))
        fit = identify_forced_response(time, u, y, BAND)
        errors.append(np.array([fit.natural_frequencies[0] - 1, fit.damping_ratios[0] - zeta]))
        deviations.append(np.array([fit.frequency_deviations[0], fit.damping_deviations[0]]))
        assert 0 <= fit.frequency_remainders[0] < fit.frequency_deviations[0]
        assert 0 <= fit.damping_remainders[0] < fit.damping_deviations[0]
    check(errors, deviations)


@pytest.mark.slow
def test_a_narrow_band_beside_a_mode_as_damped() -> None:
    """0.75 to 1.2 Hz, ζ = 0.3, a neighbour at 1.3 Hz, noise of 10 %: one mode looks as likely as
    two.
    """
    random, band = np.random.default_rng(5), (0.75, 1.2)
    time, u, clean = swept([(1.0, 0.3, 1.0), (1.3, 0.3, 0.8)], band=band, duration=40.0)
    errors, deviations = [], []
    for _ in range(RUNS):
        fit = identify_forced_response(
            time,
            u,
            clean + 0.1 * np.sqrt(np.mean(clean**2)) * random.normal(size=len(clean)),
            band,
        )
        errors.append(np.array([fit.natural_frequencies[0] - 1, fit.damping_ratios[0] - 0.3]))
        deviations.append(np.array([fit.frequency_deviations[0], fit.damping_deviations[0]]))
    assert np.all(np.mean(np.abs(errors) <= 3 * np.array(deviations), axis=0) >= 0.9)


@pytest.mark.parametrize(("zeta", "tolerance"), [(0.01, 1e-4), (0.3, 3e-3)])
def test_without_noise_a_neighbour_costs_little(zeta: float, tolerance: float) -> None:
    """Without noise what is left of the neighbour is all that is uncertain; before, 7 % of the
    frequency.
    """
    time, u, y = swept([(1.0, zeta, 1.0), (2.0, 0.3, 0.8)])
    fit = identify_forced_response(time, u, y, BAND)
    assert fit.natural_frequencies == pytest.approx([1.0], abs=tolerance)
    assert fit.damping_ratios == pytest.approx([zeta], abs=tolerance)


@pytest.mark.slow
def test_responses_with_a_mode_outside_the_lines() -> None:
    """Lines from 0.5 to 1.6 Hz of two modes, one at 2 Hz, in closed form; noise of 5 % of the
    response.
    """
    random, lines = np.random.default_rng(2), np.linspace(0.5, 1.6, 40)
    s = 2j * math.pi * lines
    clean = np.zeros(len(s), dtype=complex)
    for frequency, zeta, gain in ((1.0, 0.3, 1.0), (2.0, 0.3, 0.8)):
        omega = 2 * math.pi * frequency
        clean += gain * omega * s / (s**2 + 2 * zeta * omega * s + omega**2)
    errors, deviations = [], []
    for _ in range(RUNS):
        size = 0.05 * np.sqrt(np.mean(np.abs(clean) ** 2) / 2)
        fit = identify_frequency_response(
            lines, clean + size * (random.normal(size=40) + 1j * random.normal(size=40))
        )
        errors.append(np.array([fit.natural_frequencies[0] - 1, fit.damping_ratios[0] - 0.3]))
        deviations.append(np.array([fit.frequency_deviations[0], fit.damping_deviations[0]]))
    check(errors, deviations)


@pytest.mark.slow
@pytest.mark.parametrize("colour", [0.0, 0.6])
@pytest.mark.parametrize(("zeta", "noise"), [(0.01, 0.1), (0.1, 0.05), (0.3, 0.01)])
def test_decays_under_white_and_coloured_noise(zeta: float, noise: float, colour: float) -> None:
    """Two modes; noise e_k = colour e_{k−1} + white: slow noise once took the deviations to half
    their due.
    """
    random, time = np.random.default_rng(3), np.arange(0, 12, 1 / 40)
    clean = rang(time, [(1.0, zeta, 1.0), (2.3, zeta, 0.6)])
    errors, deviations = [], []
    for _ in range(RUNS):
        white = random.normal(size=len(time) + 100)
        e = lfilter([math.sqrt(1 - colour**2)], [1, -colour], white)[100:]
        ringdown = identify_ringdown(time, clean + noise * np.sqrt(np.mean(clean**2)) * e, modes=2)
        errors.append(
            np.array(
                [*(ringdown.natural_frequencies - [1.0, 2.3]), *(ringdown.damping_ratios - zeta)]
            )
        )
        deviations.append(np.array([*ringdown.frequency_deviations, *ringdown.damping_deviations]))
    check(errors, deviations)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("others", "noise", "colour"),
    [
        ([(2.3, 0.1, 0.2)], 0.01, 0.0),
        ([(2.3, 0.1, 0.5)], 0.1, 0.9),
        ([(1.9, 0.1, 0.4), (3.0, 0.05, 0.2)], 0.01, 0.0),
        ([(1.9, 0.1, 0.4), (3.0, 0.05, 0.2)], 0.05, 0.6),
    ],
)
def test_a_decay_that_holds_modes_more_than_asked_for(
    others: list[tuple[float, float, float]], noise: float, colour: float
) -> None:
    """The strongest is the answer, and the others are modelled, not taken for noise: before, ζ was
    hardly ever held.
    """
    random, time = np.random.default_rng(4), np.arange(0, 12, 1 / 40)
    clean = rang(time, [(1.0, 0.1, 1.0), *others])
    errors, deviations = [], []
    for _ in range(RUNS):
        e = lfilter([math.sqrt(1 - colour**2)], [1, -colour], random.normal(size=len(time) + 100))[
            100:
        ]
        ringdown = identify_ringdown(time, clean + noise * np.sqrt(np.mean(clean**2)) * e)
        errors.append(
            np.array([ringdown.natural_frequencies[0] - 1, ringdown.damping_ratios[0] - 0.1])
        )
        deviations.append(
            np.array([ringdown.frequency_deviations[0], ringdown.damping_deviations[0]])
        )
    check(errors, deviations)


@pytest.mark.slow
@pytest.mark.parametrize("zeta", [0.01, 0.05])
def test_sweeps_whose_input_is_noisy(zeta: float) -> None:
    """The input is recorded with 5 % of noise; before, 80 % of runs held ζ."""
    random = np.random.default_rng(6)
    time, u, clean = swept([(1.0, zeta, 1.0), (2.0, zeta, 0.8)])
    errors, deviations = [], []
    for _ in range(RUNS):
        recorded = u + 0.05 * np.sqrt(np.mean(u**2)) * random.normal(size=len(u))
        y = clean + 0.01 * np.sqrt(np.mean(clean**2)) * random.normal(size=len(u))
        fit = identify_forced_response(time, recorded, y, BAND)
        errors.append(np.array([fit.natural_frequencies[0] - 1, fit.damping_ratios[0] - zeta]))
        deviations.append(np.array([fit.frequency_deviations[0], fit.damping_deviations[0]]))
    check(errors, deviations)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("zeta", "gain", "duration"), [(0.3, 0.3, 4.0), (0.3, 0.6, 4.0), (0.3, 0.3, 12.0)]
)
def test_a_decay_with_a_neighbour_that_noise_hides(
    zeta: float, gain: float, duration: float
) -> None:
    """A neighbour at 1.3 times the frequency, 10 % of noise; before, 10 to 38 % of runs held ζ."""
    random, time = np.random.default_rng(3), np.arange(0, duration, 1 / 40)
    clean = rang(time, [(1.0, zeta, 1.0), (1.3, zeta, gain)])
    errors, deviations = [], []
    for _ in range(RUNS):
        noise = 0.1 * np.sqrt(np.mean(clean**2)) * random.normal(size=len(time))
        ringdown = identify_ringdown(time, clean + noise)
        errors.append(
            np.array([ringdown.natural_frequencies[0] - 1, ringdown.damping_ratios[0] - zeta])
        )
        deviations.append(
            np.array([ringdown.frequency_deviations[0], ringdown.damping_deviations[0]])
        )
    held = np.mean(np.abs(errors) <= 3 * np.array(deviations), axis=0)
    assert np.all(held >= 0.9)


@pytest.mark.slow
def test_where_one_percent_of_noise_hides_nothing_the_deviation_stays_small() -> None:
    """Against Cramér and Rao's bound of a lone mode: near it at ζ = 0.05; at ζ = 0.3, where a
    neighbour of a hundredth could hide, not more than 2.2 times.
    """
    random, time = np.random.default_rng(8), np.arange(0, 12, 1 / 40)
    for zeta, most in ((0.3, 2.2), (0.05, 1.2)):
        clean = rang(time, [(1.0, zeta, 1.0)])
        size, ratios = 0.01 * np.sqrt(np.mean(clean**2)), []
        for _ in range(10):
            ringdown = identify_ringdown(time, clean + size * random.normal(size=len(time)))
            ratios.append(ringdown.frequency_deviations[0] / least_deviation(time, zeta, size))
        assert 0.9 < np.median(ratios) < most


def least_deviation(time: np.ndarray, zeta: float, noise: float) -> float:
    """Cramér and Rao's bound of a lone mode's frequency [Hz], by finite differences."""
    step, columns = 1e-6, []
    for at in range(3):
        both = []
        for sign in (1, -1):
            values = np.array([1.0, zeta, 1.0])
            values[at] += sign * step
            both.append(rang(time, [tuple(values)]))
        columns.append((both[0] - both[1]) / (2 * step))
    omega = 2 * math.pi
    phase = -np.exp(-zeta * omega * time) * np.sin(omega * math.sqrt(1 - zeta**2) * time + 0.3)
    slopes = np.stack([*columns, phase], axis=1)
    return noise * math.sqrt(np.linalg.inv(slopes.T @ slopes)[0, 0])


def test_a_decay_that_noise_hides_is_refused() -> None:
    """Noise alone, and a second mode that is not there."""
    random, time = np.random.default_rng(9), np.arange(0, 12, 1 / 40)
    noise = random.normal(size=len(time))
    with pytest.raises(SimulationError, match="noise hides its mode; record longer or louder"):
        identify_ringdown(time, noise)
    with pytest.raises(SimulationError, match="noise hides the weakest of 2 modes; ask"):
        identify_ringdown(time, rang(time, [(1.0, 0.3, 1.0)]) + 0.02 * noise, modes=2)
