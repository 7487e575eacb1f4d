"""Identified recordings: known rings under coloured noise, and what is refused."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

import armdesign as ad
from armdesign.errors import SimulationError

STEP = 0.01


def ring(
    duration: float = 4.0, frequency: float = 2.0, zeta: float = 0.02, size: float = 3.0
) -> tuple[np.ndarray, np.ndarray]:
    """Time [s] and a pressure [bar] that rings about a falling mean, in closed form."""
    time = np.arange(0, duration, STEP)
    omega = 2 * math.pi * frequency
    decay = np.exp(-zeta * omega * time) * np.cos(omega * math.sqrt(1 - zeta**2) * time + 0.5)
    return time, 70 - 0.8 * time + size * decay


def coloured(random: np.random.Generator, count: int, colour: float) -> np.ndarray:
    """Noise e_k = colour e_{k−1} + white, of unit variance."""
    white = random.normal(size=count + 200)
    return np.asarray(lfilter([math.sqrt(1 - colour**2)], [1, -colour], white)[200:])


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.01, 0.05, 0.1])
@pytest.mark.parametrize("colour", [0.6, 0.95])
def test_deviations_hold_under_coloured_noise(noise: float, colour: float) -> None:
    """100 recordings each; the noise is a share of the ring's root mean square."""
    random, (time, clean) = np.random.default_rng(1), ring()
    size = noise * float(np.std(clean - np.polyval(np.polyfit(time, clean, 1), time)))
    held, ratios = np.zeros(2), []
    for _ in range(100):
        noisy = clean + size * coloured(random, len(time), colour)
        found = ad.identify({"time_s": time, "boom_cap_bar": noisy}, [(0, 4)]).windows[0].fit
        errors = [found.natural_frequencies[0] - 2, found.damping_ratios[0] - 0.02]
        deviations = np.array([found.frequency_deviations[0], found.damping_deviations[0]])
        held += np.abs(errors) <= 3 * deviations
        ratios.append(np.abs(errors) / deviations)
    assert np.all(held >= 90)
    # not by being too large: the median error of a normal law is 0.67 deviations
    assert np.all(np.median(ratios, axis=0) > 0.3)


def test_found_windows_and_swings() -> None:
    pressure = ring(12.0, zeta=0.03)[1]
    before = np.full(200, pressure[0])
    columns = {"time_s": np.arange(1400) * STEP, "boom_cap_bar": np.append(before, pressure)}
    noisy = columns["boom_cap_bar"] + 0.01 * np.random.default_rng(2).normal(size=1400)
    found = ad.identify({**columns, "boom_cap_bar": noisy})
    assert len(found.windows) >= 2
    assert found.windows[0].begin > 2.0
    assert found.frame["frequency_hz"].to_numpy() == pytest.approx(2.0, rel=0.01)
    assert found.swings["amplitude"].is_monotonic_decreasing
    assert len(found.plot().axes) == 3


def test_faults_of_recordings(tmp_path: Path) -> None:
    time, pressure = ring()
    columns = {"time_s": time, "boom_cap_bar": pressure}

    def spoilt(**changes: np.ndarray) -> dict[str, np.ndarray]:
        return {**columns, **changes}

    gap, twice, back = time.copy(), time.copy(), time.copy()
    gap[150:] += 0.5
    twice[150:] -= STEP
    back[150] -= 5 * STEP
    blank = pressure.copy()
    blank[7] = np.nan
    for given, windows, message in (
        (spoilt(time_s=gap), [(0, 5)], "a gap of 0.51 s at 1.49 s"),
        (spoilt(time_s=twice), [(0, 4)], "the same time stamp twice, at 1.49 s"),
        (spoilt(time_s=back), [(0, 4)], "time steps back after 1.49 s"),
        (spoilt(boom_cap_bar=blank), [(0, 4)], "blank at 0.07 s"),
        (spoilt(boom_cap_bar=0 * time + 5), [(0, 4)], "constant"),
        (spoilt(boom_cap_bar=np.minimum(pressure, 71)), [(0, 4)], "clipped at 71"),
        (columns, [(0, 0.7)], "two periods"),
        (columns, [(9, 11)], "holds no samples"),
        (columns, [(3, 2)], "3:2 is no window"),
        ({"time_s": time, "boom": pressure}, [(0, 4)], "no column is a pressure"),
        ({"boom_cap_bar": pressure}, [(0, 4)], "has no time"),
    ):
        with pytest.raises(SimulationError, match=message):
            ad.identify(given, windows)
    with pytest.raises(SimulationError, match='has no column "boom_cap"; did you mean'):
        ad.identify(columns, [(0, 4)], signal="boom_cap")
    file = tmp_path / "r.csv"
    for text, message in (
        ("time_s,a_bar\n0,1\n1,x\n", '"x" in line 3 is no number'),
        ("time_s,a_bar\n0,1,2\n", "3 fields in line 2"),
        ("time_s,a_bar\n", "holds no samples"),
        ("time_s,a_bar,a_bar\n0,1,2\n", "there twice"),
    ):
        file.write_text(text, encoding="utf-8")
        with pytest.raises(SimulationError, match=message):
            ad.identify(file)
    with pytest.raises(SimulationError, match="cannot be read"):
        ad.identify(tmp_path / "none.csv")
