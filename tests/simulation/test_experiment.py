"""One experiment gives the same mode under any excitation, and with any line to its pump."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import StateSpace, lsim

import armdesign as ad
from armdesign.simulation import resting
from armdesign.simulation.experiment import Experiment, linear_answer
from armdesign.simulation.resting import REFILL
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


@pytest.mark.parametrize("count", [1, 2, 3, 700])
def test_linear_answers_are_exact(count: int) -> None:
    """scipy steps from value to value; here an integrator, an oscillator and a fast decay."""
    A = np.array([[0, 1.0, 0, 0], [0, 0, 1, 0], [0, -40, -0.1, 3], [0, 0, 0, -500]])
    column, time = np.array([0.2, 0, 0, 500]), 0.01 * np.arange(count)
    values = np.sin(3 * time**2) + 0.1
    system = StateSpace(A, column[:, None], np.eye(4), np.zeros((4, 1)))
    expected = lsim(system, values, time)[1].reshape(count, 4) if count > 1 else np.zeros((1, 4))
    np.testing.assert_allclose(linear_answer(A, column, values, 0.01), expected, atol=1e-10)


@pytest.mark.slow
def test_a_line_of_more_oil_leaves_the_modes(monkeypatch: pytest.MonkeyPatch) -> None:
    """The pump's line holds several times its oil in the sweeps; with the file's own line
    frequencies are within 1e-5 of theirs.
    """
    machine, index = ad.load("excavator_20t"), 2
    fits, volumes = [], []
    for refill in (REFILL, 1e9):
        monkeypatch.setattr(resting, "REFILL", refill)
        one = Experiment.of(machine, np.array(WORST), index, 1)
        case = one.case(one.swept_sine(one.default_amplitude()))
        volumes.append(case.machine.supply.line_volume)
        fits.append(one.fit(simulate_all([case], tolerance=1e-7)[0]))
    larger, own = fits
    assert volumes[0] > 3 * volumes[1] == 3 * machine.supply.line_volume
    assert larger.natural_frequencies == pytest.approx(own.natural_frequencies, rel=1e-5)
    assert larger.damping_ratios == pytest.approx(own.damping_ratios, rel=1e-3)
