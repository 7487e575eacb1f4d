"""One experiment gives the same mode under any excitation."""

from __future__ import annotations

import numpy as np
import pytest

import armdesign as ad
from armdesign.simulation.experiment import Experiment
from armdesign.simulation.simulate import simulate_all
from tests.simulation.oscillator import multisine
from tests.simulation.valves import WORST


@pytest.mark.slow
@pytest.mark.parametrize(("name", "pose"), [("paper_1dof", [0.0]), ("excavator_20t", WORST)])
def test_multisine_on_the_plant(name: str, pose: list[float]) -> None:
    """Another excitation than the sweep, the same mode."""
    one = Experiment.of(ad.load(name), np.array(pose), 0, 0)
    amplitude, period = one.default_amplitude() / 2, one.duration
    first, last = np.ceil(one.band[0] * period), np.floor(one.band[1] * period)
    lines = np.arange(first, last + 1) / period

    def excitation(time: float) -> float:
        return amplitude * float(multisine(np.array(time), period, lines)) * (time < period)

    excitation.breakpoints = (0.0, period)  # type: ignore[attr-defined]
    run = simulate_all([one.case(excitation)], tolerance=1e-7)[0]
    assert one.fit(run).natural_frequencies == pytest.approx([one.target], rel=2e-3)
