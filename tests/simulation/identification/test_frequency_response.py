"""Frequency responses against closed forms of linear systems."""

from __future__ import annotations

import numpy as np
import pytest

from armdesign import frequency_response
from armdesign.errors import SimulationError
from tests.simulation.oscillator import answer_of, exact, multisine

BAND = (0.5, 1.6)


def test_settled_multisine_gives_the_exact_response() -> None:
    lines, time = np.arange(10, 33) / 20, np.arange(0, 160, 1 / 100)
    u = multisine(time, 20.0, lines)
    y = answer_of(1.03, 0.05, time, u)
    late = time >= 80
    response = frequency_response(time[late], u[late], y[late], BAND, 20.0, periodic=True)
    np.testing.assert_allclose(response.frequency, lines)
    # lsim's straight lines
    np.testing.assert_allclose(response.response, exact(1.03, 0.05, lines), rtol=2e-3)
    np.testing.assert_allclose(response.coherence, 1, atol=1e-9)
    fit = response.fit()
    assert fit.natural_frequencies == pytest.approx([1.03], rel=1e-4)
    assert fit.damping_ratios == pytest.approx([0.05], rel=1e-2)
    size, phase, share = (ax.lines[0].get_ydata() for ax in response.plot().axes)
    np.testing.assert_allclose(size * np.exp(1j * np.radians(phase)), response.response)
    np.testing.assert_allclose(share, response.coherence)
    np.testing.assert_allclose(fit.plot().axes[0].lines[0].get_ydata(), np.abs(fit.response))


def test_coherence_is_the_share_explained() -> None:
    """White noise u through a gain of 2, noise of the same power added: γ² = 1/2; Bendat &
    Piersol's deviation.
    """
    random = np.random.default_rng(1)
    time = np.arange(40_000) / 100
    u = random.normal(size=len(time))
    y = 2 * u + 2 * random.normal(size=len(time))
    response = frequency_response(time, u, y, (5.0, 45.0), 2.0)
    assert response.coherence.mean() == pytest.approx(0.5, abs=0.02)
    # of each of both parts, and of the modulus
    spread = np.sqrt(np.mean(np.abs(response.response - 2) ** 2) / 2)
    assert np.median(response.deviations) == pytest.approx(spread, rel=0.1)
    with pytest.raises(SimulationError, match="less than two segments"):
        frequency_response(time, u, y, (5.0, 45.0), 300.0)
