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


def test_a_mode_larger_than_the_signal_is_said() -> None:
    """Coulomb's friction: the swing falls evenly, 6 bar (1 − t/5), and never is more."""
    time = np.arange(0, 5, STEP)
    swing = 6 * (1 - time / 5) * np.cos(2 * math.pi * 1.7 * time)
    noise = 0.03 * np.random.default_rng(5).normal(size=len(time))
    recording = {"time_s": time, "boom_cap_bar": 80 + swing + noise}
    identified = ad.identify(recording, [(0.05, 4.9)])
    assert identified.frame["amplitude"][0] > 6 * 1.3
    assert identified.frame["remark"].to_list() == ["modes cancel"]
    assert "friction brakes it, to no exponential decay" in identified.findings[0]
    damped = np.exp(-0.3 * 2 * math.pi * time) * np.sin(2 * math.pi * time)  # from zero
    strong = ad.identify({"time_s": time, "boom_cap_bar": 80 + 6 * damped + noise}, [(0, 4)])
    assert strong.frame["amplitude"][0] > 1.3 * 6 * damped.max()
    assert strong.frame["remark"].to_list() == [""]
