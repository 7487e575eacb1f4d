"""Recordings whose answers are doubtful: what is refused, and what is remarked."""

from __future__ import annotations

import math

import numpy as np
import pytest

import armdesign as ad
from armdesign.errors import SimulationError
from tests.simulation.test_identify import STEP, of


def test_hum_of_two_samples_in_a_period_is_no_answer() -> None:
    """Of 49.7 Hz at 100 Hz; its line is above those in which booms ring, so none looked there."""
    hum = 3 * np.sin(2 * math.pi * 49.7 * np.arange(0, 5, STEP))
    ringing = of(1.7, 100, 5)
    recording = {**ringing, "boom_cap_bar": ringing["boom_cap_bar"] + hum}
    with pytest.raises(
        SimulationError, match=r"only 2 samples in .* \(about 50 Hz\); record 8 in"
    ):
        ad.identify(recording, [(0.0, 5.0)])
    both = ad.identify(recording, [(0.0, 5.0)], modes=2).windows[0].fit.natural_frequencies
    assert both == pytest.approx([1.7, 49.7], rel=2e-3)
